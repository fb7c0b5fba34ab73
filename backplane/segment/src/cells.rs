//! The memory map as one `repr(C)` structure of atomic words: what both ends lay over the raw memory.
//!
//! It contains nothing but atomics, reserved words included, so a reference to it never promises that the memory does
//! not change.

use crate::layout::{
    BOX_BYTES, BOXES, BUFFER_SLOTS, COUNTER_WORDS, ENDS, EVENT_SLOTS, IO_BYTES_MAX, JSON_BYTES, PARAMETER_BYTES,
    RECORD_BYTES, TIMES_SLOTS, TIMES_WORDS,
};
use crate::seqlock::SeqCell;
use crate::sync::{AtomicU64, Pad, Words};

/// Words of register data.
pub(crate) const IO_WORDS: usize = IO_BYTES_MAX / 8;
/// Words of a record: number, length, data.
pub(crate) const RECORD_WORDS: usize = 2 + RECORD_BYTES / 8;
/// Words of the parameter record: JSON length, parameter bytes, JSON text.
pub(crate) const PARAMS_WORDS: usize = 1 + (PARAMETER_BYTES + JSON_BYTES) / 8;

/// What the creator of the segment writes about it.
#[repr(C)]
#[derive(Default)]
pub(crate) struct HeaderCells {
    pub(crate) magic: AtomicU64,
    pub(crate) version: AtomicU64,
    pub(crate) total_bytes: AtomicU64,
    pub(crate) io_bytes: AtomicU64,
    pub(crate) json_bytes: AtomicU64,
    pub(crate) record_bytes: AtomicU64,
    pub(crate) event_slots: AtomicU64,
    pub(crate) counter_words: AtomicU64,
    pad: Pad<8>,
}

/// Output registers (CPU -> CP), and the count of everything the CPU side has changed for the driver.
#[repr(C)]
#[derive(Default)]
pub(crate) struct OutputCells {
    pub(crate) registers: SeqCell<IO_WORDS>,
    pub(crate) changes: AtomicU64,
    pad: Pad<6>,
}

/// Input registers (CP -> CPU).
#[repr(C)]
#[derive(Default)]
pub(crate) struct InputCells {
    pub(crate) registers: SeqCell<IO_WORDS>,
    pad: Pad<7>,
}

/// The state of the CPU, written by the CPU.
#[repr(C)]
#[derive(Default)]
pub(crate) struct CpuCells {
    pub(crate) heartbeat: AtomicU64,
    pub(crate) state: AtomicU64,
    pub(crate) modem_outputs: AtomicU64,
    pub(crate) time: AtomicU64,
    pad: Pad<12>,
}

/// The state of the driver, written by the driver.
#[repr(C)]
#[derive(Default)]
pub(crate) struct CpCells {
    pub(crate) generation: AtomicU64,
    pub(crate) heartbeat: AtomicU64,
    pub(crate) state: AtomicU64,
    pub(crate) leds: AtomicU64,
    pub(crate) modem_inputs: AtomicU64,
    pub(crate) reason: AtomicU64,
    pad: Pad<10>,
}

/// Whether the driver sleeps and wants a doorbell.
#[repr(C)]
#[derive(Default)]
pub(crate) struct DoorbellCells {
    pub(crate) sleeping: AtomicU64,
    pad: Pad<15>,
}

/// One data record under a sequence lock.
#[repr(C)]
#[derive(Default)]
pub(crate) struct RecordCells {
    pub(crate) record: SeqCell<RECORD_WORDS>,
    pad: Pad<15>,
}

/// The event ring: producer's line, consumer's line, slots.
#[repr(C)]
#[derive(Default)]
pub(crate) struct EventCells {
    pub(crate) produced: AtomicU64,
    pub(crate) lost: AtomicU64,
    pad: Pad<14>,
    pub(crate) consumed: AtomicU64,
    pad_consumer: Pad<15>,
    pub(crate) slots: EventSlots,
}

/// The slots of the event ring, each 32 bytes.
#[repr(transparent)]
pub(crate) struct EventSlots(pub(crate) [Words<4>; EVENT_SLOTS]);

impl Default for EventSlots {
    fn default() -> Self {
        Self(core::array::from_fn(|_| Words::default()))
    }
}

/// One direction of a channel.
#[repr(C)]
#[derive(Default)]
pub(crate) struct ChannelCells {
    pub(crate) block: SeqCell<IO_WORDS>,
    pad: Pad<7>,
}

/// The channels of a CP 341: what the CPU writes for P_SND_RK and P_RCV_RK, and what the CP answers to each.
#[repr(C)]
#[derive(Default)]
pub(crate) struct ChannelsCells {
    pub(crate) version: AtomicU64,
    pad: Pad<15>,
    pub(crate) send_to_cp: ChannelCells,
    pub(crate) receive_to_cp: ChannelCells,
    pub(crate) send_to_cpu: ChannelCells,
    pub(crate) receive_to_cpu: ChannelCells,
}

/// The CP's diagnostic buffer.
#[repr(C)]
#[derive(Default)]
pub(crate) struct BufferCells {
    pub(crate) written: AtomicU64,
    pad: Pad<15>,
    pub(crate) entries: Words<BUFFER_SLOTS>,
}

/// Where the time of an order goes: when the CPU wrote last, and what the driver says of each order.
#[repr(C)]
#[derive(Default)]
pub(crate) struct TimesCells {
    pub(crate) posted: AtomicU64,
    pad: Pad<15>,
    pub(crate) written: AtomicU64,
    pad_written: Pad<7>,
    pub(crate) entries: [Words<TIMES_WORDS>; TIMES_SLOTS],
}

/// Words of a box.
pub(crate) const BOX_WORDS: usize = BOX_BYTES / 8;

/// One direction of a box of a CP 343.
#[repr(C)]
#[derive(Default)]
pub(crate) struct BoxCells {
    pub(crate) content: SeqCell<BOX_WORDS>,
    pad: Pad<15>,
}

/// One direction of all boxes.
#[repr(transparent)]
pub(crate) struct BoxRow(pub(crate) [BoxCells; BOXES]);

impl Default for BoxRow {
    fn default() -> Self {
        Self(core::array::from_fn(|_| BoxCells::default()))
    }
}

/// The boxes of a CP 343.
#[repr(C)]
#[derive(Default)]
pub(crate) struct BoxesCells {
    pub(crate) to_cp: BoxRow,
    pub(crate) to_cpu: BoxRow,
}

/// The whole segment; in a segment with boxes, the part before them.
#[repr(C, align(128))]
#[derive(Default)]
pub(crate) struct SegmentCells {
    pub(crate) header: HeaderCells,
    pub(crate) outputs: OutputCells,
    pub(crate) inputs: InputCells,
    pub(crate) cpu: CpuCells,
    pub(crate) cp: CpCells,
    pub(crate) doorbell: DoorbellCells,
    pub(crate) ends: Words<ENDS>,
    pad_counters: Pad<48>,
    pub(crate) counters: Words<COUNTER_WORDS>,
    pub(crate) diagnosis: RecordCells,
    /// Reserved: nothing writes it.
    pub(crate) record: RecordCells,
    pub(crate) events: EventCells,
    pub(crate) params: SeqCell<PARAMS_WORDS>,
    pad: Pad<12>,
    pub(crate) channels: ChannelsCells,
    pub(crate) buffer: BufferCells,
    pad_buffer: Pad<15>,
    pub(crate) times: TimesCells,
    pad_times: Pad<104>,
}

/// A segment with boxes.
#[repr(C)]
#[derive(Default)]
pub(crate) struct BoxedCells {
    pub(crate) segment: SegmentCells,
    pub(crate) boxes: BoxesCells,
}

/// The same memory as one row of words.
#[cfg(not(loom))]
pub(crate) fn as_words(cells: &SegmentCells) -> &[AtomicU64; size_of::<SegmentCells>() / 8] {
    // SAFETY: `SegmentCells` is repr(C) and made of `AtomicU64` alone, without padding (size and offsets are asserted
    // below), so it is an array of them; the reference lives as long as the one it comes from.
    unsafe { core::ptr::NonNull::from(cells).cast().as_ref() }
}

/// The boxes as one row of words.
#[cfg(not(loom))]
pub(crate) fn box_words(boxes: &BoxesCells) -> &[AtomicU64; size_of::<BoxesCells>() / 8] {
    // SAFETY: as in `as_words`: `BoxesCells` too is repr(C), made of `AtomicU64` alone, without padding.
    unsafe { core::ptr::NonNull::from(boxes).cast().as_ref() }
}

/// `offset_of` through nested fields, against the numbers of `layout::FIELDS`.
#[cfg(not(loom))]
pub(crate) const OFFSETS: &[(usize, &str)] = {
    use core::mem::offset_of;
    &[
        (offset_of!(SegmentCells, header.magic), "header.magic"),
        (offset_of!(SegmentCells, header.version), "header.version"),
        (offset_of!(SegmentCells, header.total_bytes), "header.total_bytes"),
        (offset_of!(SegmentCells, header.io_bytes), "header.io_bytes"),
        (offset_of!(SegmentCells, header.json_bytes), "header.json_bytes"),
        (offset_of!(SegmentCells, header.record_bytes), "header.record_bytes"),
        (offset_of!(SegmentCells, header.event_slots), "header.event_slots"),
        (offset_of!(SegmentCells, header.counter_words), "header.counter_words"),
        (offset_of!(SegmentCells, outputs.registers.sequence), "outputs.sequence"),
        (offset_of!(SegmentCells, outputs.registers.data), "outputs.data"),
        (offset_of!(SegmentCells, outputs.changes), "outputs.changes"),
        (offset_of!(SegmentCells, inputs.registers.sequence), "inputs.sequence"),
        (offset_of!(SegmentCells, inputs.registers.data), "inputs.data"),
        (offset_of!(SegmentCells, cpu.heartbeat), "cpu.heartbeat"),
        (offset_of!(SegmentCells, cpu.state), "cpu.state"),
        (offset_of!(SegmentCells, cpu.modem_outputs), "cpu.modem_outputs"),
        (offset_of!(SegmentCells, cpu.time), "cpu.time"),
        (offset_of!(SegmentCells, cp.generation), "cp.generation"),
        (offset_of!(SegmentCells, cp.heartbeat), "cp.heartbeat"),
        (offset_of!(SegmentCells, cp.state), "cp.state"),
        (offset_of!(SegmentCells, cp.leds), "cp.leds"),
        (offset_of!(SegmentCells, cp.modem_inputs), "cp.modem_inputs"),
        (offset_of!(SegmentCells, cp.reason), "cp.reason"),
        (offset_of!(SegmentCells, doorbell.sleeping), "doorbell.sleeping"),
        (offset_of!(SegmentCells, ends), "ends"),
        (offset_of!(SegmentCells, counters), "counters"),
        (offset_of!(SegmentCells, diagnosis.record.sequence), "diagnosis.sequence"),
        (offset_of!(SegmentCells, diagnosis.record.data), "diagnosis.number"),
        (offset_of!(SegmentCells, diagnosis.record.data) + 8, "diagnosis.length"),
        (offset_of!(SegmentCells, diagnosis.record.data) + 16, "diagnosis.data"),
        (offset_of!(SegmentCells, record.record.sequence), "record.sequence"),
        (offset_of!(SegmentCells, record.record.data), "record.number"),
        (offset_of!(SegmentCells, record.record.data) + 8, "record.length"),
        (offset_of!(SegmentCells, record.record.data) + 16, "record.data"),
        (offset_of!(SegmentCells, events.produced), "events.produced"),
        (offset_of!(SegmentCells, events.lost), "events.lost"),
        (offset_of!(SegmentCells, events.consumed), "events.consumed"),
        (offset_of!(SegmentCells, events.slots), "events.slots"),
        (offset_of!(SegmentCells, params.sequence), "params.sequence"),
        (offset_of!(SegmentCells, params.data), "params.json_length"),
        (offset_of!(SegmentCells, params.data) + 8, "params.bytes"),
        (offset_of!(SegmentCells, params.data) + 24, "params.json"),
        (offset_of!(SegmentCells, channels.version), "channels.version"),
        (offset_of!(SegmentCells, channels.send_to_cp.block.sequence), "send_to_cp.sequence"),
        (offset_of!(SegmentCells, channels.send_to_cp.block.data), "send_to_cp.data"),
        (offset_of!(SegmentCells, channels.receive_to_cp.block.sequence), "receive_to_cp.sequence"),
        (offset_of!(SegmentCells, channels.receive_to_cp.block.data), "receive_to_cp.data"),
        (offset_of!(SegmentCells, channels.send_to_cpu.block.sequence), "send_to_cpu.sequence"),
        (offset_of!(SegmentCells, channels.send_to_cpu.block.data), "send_to_cpu.data"),
        (offset_of!(SegmentCells, channels.receive_to_cpu.block.sequence), "receive_to_cpu.sequence"),
        (offset_of!(SegmentCells, channels.receive_to_cpu.block.data), "receive_to_cpu.data"),
        (offset_of!(SegmentCells, buffer.written), "buffer.written"),
        (offset_of!(SegmentCells, buffer.entries), "buffer.entries"),
        (offset_of!(SegmentCells, times.posted), "times.posted"),
        (offset_of!(SegmentCells, times.written), "times.written"),
        (offset_of!(SegmentCells, times.entries), "times.entries"),
        (offset_of!(BoxedCells, boxes.to_cp), "boxes.to_cp"),
        (offset_of!(BoxedCells, boxes.to_cpu), "boxes.to_cpu"),
    ]
};

#[cfg(not(loom))]
const _: () = {
    assert!(size_of::<SegmentCells>() == crate::layout::SEGMENT_BYTES);
    assert!(size_of::<BoxedCells>() == crate::layout::SEGMENT_BYTES_BOXES);
    assert!(size_of::<BoxCells>() == crate::layout::BOX_STRIDE);
    assert!(OFFSETS.len() == crate::layout::FIELDS.len());
    let mut index = 0;
    while index < OFFSETS.len() {
        assert!(OFFSETS[index].0 == crate::layout::FIELDS[index].offset, "the memory map has moved");
        index += 1;
    }
};
