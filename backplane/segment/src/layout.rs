//! The memory map of a segment in numbers: what `docs/backplane.md` documents and a driver in C or Python relies on.
//!
//! Every field is made of 64-bit words in the byte order of the machine. [`FIELDS`] names them all; a test compares the
//! document, this table and the code.

/// The first word of a segment: the bytes `OB1BPLN` and a zero.
pub const MAGIC: u64 = u64::from_ne_bytes(*b"OB1BPLN\0");

/// Version of this memory map. It is the last word written when a segment is created.
pub const LAYOUT_VERSION: u64 = 1;

/// Size of a segment in bytes.
pub const SEGMENT_BYTES: usize = 0x3000;

/// Size of a segment with boxes, which follow everything else. A segment of any other size than these two is refused.
pub const SEGMENT_BYTES_BOXES: usize = 0x17000;

/// Smallest number of register bytes of a module, each way.
pub const IO_BYTES_MIN: usize = 8;

/// Largest number of register bytes of a module, each way.
pub const IO_BYTES_MAX: usize = 64;

/// The parameter bytes of a module, as the hardware configurator writes them.
pub const PARAMETER_BYTES: usize = 16;

/// Room for the driver's configuration as JSON text, in bytes.
pub const JSON_BYTES: usize = if cfg!(loom) { 17 } else { 4096 };

/// Room of a data record, in bytes: the longest record an S7 module has.
pub const RECORD_BYTES: usize = if cfg!(loom) { 17 } else { 240 };

/// Version of the channels' layout (`docs/cp341-channels.md`).
pub const CHANNELS_VERSION: u64 = 1;

/// Bytes of a channel's block, each way: 32 that describe it, 32 of user data.
pub const CHANNEL_BYTES: usize = ob1_words::channels::BLOCK_BYTES;

/// Boxes of a CP 343 (`docs/cp343.md`).
pub const BOXES: usize = if cfg!(loom) { 1 } else { ob1_words::boxes::BOXES };

/// Bytes of a box, each way.
pub const BOX_BYTES: usize = ob1_words::boxes::BOX_BYTES;

/// Bytes from one box to the next: its sequence, its data and padding to a cache line.
pub const BOX_STRIDE: usize = 640;

/// Bytes of data in one event record.
pub const EVENT_DATA_BYTES: usize = 16;

/// Slots of the event ring.
pub const EVENT_SLOTS: usize = if cfg!(loom) { 2 } else { 64 };

/// Entries of a CP's diagnostic buffer.
pub const BUFFER_ENTRIES: usize = if cfg!(loom) { 2 } else { 64 };

/// Slots of that ring: one more, for the entry being written.
pub const BUFFER_SLOTS: usize = BUFFER_ENTRIES + 1;

/// Words for counters; those without a name are reserved.
pub const COUNTER_WORDS: usize = if cfg!(loom) { 17 } else { 32 };

/// Words for the ends of orders: one for each number, the last for all that find no word of their own.
pub const ENDS: usize = if cfg!(loom) { 2 } else { 16 };

/// Slots of the ring of times: one more than entries, for the one being written.
pub const TIMES_SLOTS: usize = if cfg!(loom) { 2 } else { 16 };

/// Words of an entry of that ring.
pub const TIMES_WORDS: usize = 8;

/// Who may write a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writer {
    /// The runtime, once, when it makes the segment.
    Maker,
    /// The CPU side: the runtime, in each scan.
    Cpu,
    /// The driver process. While it is down, the runtime clears the fields that show its state.
    Cp,
    /// The driver sets it, the CPU side clears it.
    Both,
    /// Any program outside, at any time; no content is a fault.
    Anyone,
}

/// One line of the memory map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Offset from the start of the segment, in bytes; a multiple of 8.
    pub offset: usize,
    /// Size in bytes; a multiple of 8.
    pub size: usize,
    /// Name, as in the document.
    pub name: &'static str,
    /// Who may write it.
    pub writer: Writer,
}

#[cfg(not(loom))]
pub(crate) const fn field(offset: usize, size: usize, name: &'static str, writer: Writer) -> Field {
    Field { offset, size, name, writer }
}

/// The memory map, in rising order. Bytes between two fields are reserved and zero. Fields from [`SEGMENT_BYTES`] on
/// are those of a segment with boxes. The fields `record.*` are reserved, too: they keep their place for drivers that
/// read them.
#[cfg(not(loom))]
pub const FIELDS: &[Field] = &[
    field(0x0000, 8, "header.magic", Writer::Maker),
    field(0x0008, 8, "header.version", Writer::Maker),
    field(0x0010, 8, "header.total_bytes", Writer::Maker),
    field(0x0018, 8, "header.io_bytes", Writer::Maker),
    field(0x0020, 8, "header.json_bytes", Writer::Maker),
    field(0x0028, 8, "header.record_bytes", Writer::Maker),
    field(0x0030, 8, "header.event_slots", Writer::Maker),
    field(0x0038, 8, "header.counter_words", Writer::Maker),
    field(0x0080, 8, "outputs.sequence", Writer::Cpu),
    field(0x0088, 64, "outputs.data", Writer::Cpu),
    field(0x00c8, 8, "outputs.changes", Writer::Cpu),
    field(0x0100, 8, "inputs.sequence", Writer::Cp),
    field(0x0108, 64, "inputs.data", Writer::Cp),
    field(0x0180, 8, "cpu.heartbeat", Writer::Cpu),
    field(0x0188, 8, "cpu.state", Writer::Cpu),
    field(0x0190, 8, "cpu.modem_outputs", Writer::Cpu),
    field(0x0198, 8, "cpu.time", Writer::Cpu),
    field(0x0200, 8, "cp.generation", Writer::Cp),
    field(0x0208, 8, "cp.heartbeat", Writer::Cp),
    field(0x0210, 8, "cp.state", Writer::Cp),
    field(0x0218, 8, "cp.leds", Writer::Cp),
    field(0x0220, 8, "cp.modem_inputs", Writer::Cp),
    field(0x0228, 8, "cp.reason", Writer::Cp),
    field(0x0280, 8, "doorbell.sleeping", Writer::Both),
    field(0x0300, 128, "ends", Writer::Cp),
    field(0x0500, 256, "counters", Writer::Cp),
    field(0x0600, 8, "diagnosis.sequence", Writer::Cp),
    field(0x0608, 8, "diagnosis.number", Writer::Cp),
    field(0x0610, 8, "diagnosis.length", Writer::Cp),
    field(0x0618, 240, "diagnosis.data", Writer::Cp),
    field(0x0780, 8, "record.sequence", Writer::Cpu),
    field(0x0788, 8, "record.number", Writer::Cpu),
    field(0x0790, 8, "record.length", Writer::Cpu),
    field(0x0798, 240, "record.data", Writer::Cpu),
    field(0x0900, 8, "events.produced", Writer::Cp),
    field(0x0908, 8, "events.lost", Writer::Cp),
    field(0x0980, 8, "events.consumed", Writer::Cpu),
    field(0x0a00, 2048, "events.slots", Writer::Cp),
    field(0x1200, 8, "params.sequence", Writer::Cpu),
    field(0x1208, 8, "params.json_length", Writer::Cpu),
    field(0x1210, 16, "params.bytes", Writer::Cpu),
    field(0x1220, 4096, "params.json", Writer::Cpu),
    field(0x2280, 8, "channels.version", Writer::Maker),
    field(0x2300, 8, "send_to_cp.sequence", Writer::Cpu),
    field(0x2308, 64, "send_to_cp.data", Writer::Cpu),
    field(0x2380, 8, "receive_to_cp.sequence", Writer::Cpu),
    field(0x2388, 64, "receive_to_cp.data", Writer::Cpu),
    field(0x2400, 8, "send_to_cpu.sequence", Writer::Cp),
    field(0x2408, 64, "send_to_cpu.data", Writer::Cp),
    field(0x2480, 8, "receive_to_cpu.sequence", Writer::Cp),
    field(0x2488, 64, "receive_to_cpu.data", Writer::Cp),
    field(0x2500, 8, "buffer.written", Writer::Cp),
    field(0x2580, 520, "buffer.entries", Writer::Cp),
    field(0x2800, 8, "times.posted", Writer::Cpu),
    field(0x2880, 8, "times.written", Writer::Cp),
    field(0x28c0, 1024, "times.entries", Writer::Cp),
    field(0x3000, BOXES * BOX_STRIDE, "boxes.to_cp", Writer::Cpu),
    field(0xd000, BOXES * BOX_STRIDE, "boxes.to_cpu", Writer::Cp),
];
