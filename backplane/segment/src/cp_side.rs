//! The driver's end of a segment: the CP's side of the back plane. It trusts the CPU side as little as the CPU side
//! trusts the driver.

use crate::boxes::BoxEnd;
use crate::buffer::{BufferEntry, BufferWriter};
use crate::bytes::copy_out;
use crate::cells::{IO_WORDS, PARAMS_WORDS, SegmentCells};
use crate::channel::{Channel, ChannelBlock, ChannelEnd, Way};
use crate::counters::{self, Counter, Counters, book_lost};
use crate::events::{Event, Producer};
use crate::fault::{Fault, SegmentError, TooLong};
use crate::header;
use crate::layout::JSON_BYTES;
use crate::record::{Params, clear_record, read_params, write_record};
use crate::registers::{IoBytes, RegisterWriter};
use crate::segment::Segment;
use crate::seqlock::{Freshness, SeqReader};
use crate::sync::{Ordering, fence};
use crate::times::{self, OrderTimes};
use crate::words::{self, CpuState, DriverState, Leds, ModemInputs, ModemOutputs, Reason};

/// A point in the CPU side's history, for [`CpSide::prepare_sleep`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChangeMark(u64);

/// The driver's end of a segment. There is one at a time.
pub struct CpSide {
    segment: Segment,
    io: IoBytes,
    generation: u64,
    inputs: RegisterWriter,
    outputs: SeqReader<IO_WORDS>,
    params: Box<SeqReader<PARAMS_WORDS>>,
    json: Box<[u8; JSON_BYTES]>,
    events: Producer,
    channels: ChannelEnd,
    boxes: BoxEnd,
    buffer: BufferWriter,
}

impl CpSide {
    /// Attaches a driver: checks the header, clears what an earlier driver has left (its input registers and channels
    /// read 0, its diagnostic record is empty, orders in its buffers are booked as lost), sets
    /// [`DriverState::Starting`] and increments the generation, which tells the CPU side that all this is done.
    /// Complete events of an earlier driver stay.
    ///
    /// # Errors
    /// [`SegmentError::Header`] if this is not a segment of this layout version; [`SegmentError::InUse`] if another
    /// process is its driver.
    pub fn attach(segment: &Segment) -> Result<Self, SegmentError> {
        let cells = segment.cells();
        let io = header::check(segment)?;
        segment.claim()?;
        cells.doorbell.sleeping.store(0, Ordering::Relaxed);
        cells.cp.state.store(DriverState::Starting.to_word(), Ordering::Relaxed);
        cells.cp.leds.store(0, Ordering::Relaxed);
        cells.cp.modem_inputs.store(0, Ordering::Relaxed);
        cells.cp.reason.store(0, Ordering::Relaxed);
        let mut inputs = RegisterWriter::new(io);
        inputs.clear(&cells.inputs.registers);
        let mut channels = ChannelEnd::new(Way::ToCpu);
        channels.clear(&cells.channels);
        let boxes = BoxEnd::new(Way::ToCpu, segment.boxes());
        boxes.clear(segment.boxes());
        clear_record(&cells.diagnosis);
        book_lost(&cells.counters);
        counters::add(&cells.counters, Counter::DriverStarts, 1);
        let events = Producer::resume(&cells.events);
        // 0 means "never attached".
        let generation = cells.cp.generation.load(Ordering::Relaxed).wrapping_add(1).max(1);
        // Pairs with the load(Acquire) in `Monitor::generation`.
        cells.cp.generation.store(generation, Ordering::Release);
        Ok(Self {
            segment: segment.clone(),
            io,
            generation,
            inputs,
            outputs: SeqReader::new(),
            params: Box::new(SeqReader::new()),
            json: Box::new([0; JSON_BYTES]),
            events,
            channels,
            boxes,
            buffer: BufferWriter::resume(&cells.buffer),
        })
    }

    #[inline]
    fn cells(&self) -> &SegmentCells {
        self.segment.cells()
    }

    /// Register bytes each way.
    pub fn io_bytes(&self) -> usize {
        self.io.get()
    }

    /// The number of this driver: attachments are counted. Never 0.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// The CPU side's current mark. Take it first in each pass, then look at everything, then call
    /// [`Self::prepare_sleep`].
    #[inline]
    pub fn changes(&self) -> ChangeMark {
        // Pairs with the store(Release) in `CpuSide::changed`: all changes up to this mark are visible after it.
        ChangeMark(self.cells().outputs.changes.load(Ordering::Acquire))
    }

    /// Announces sleep. True: nothing has changed since `seen`, and the CPU side rings for the next change: wait on the
    /// doorbell. False: there is something new, make another pass. In both cases [`Self::awake`] ends it.
    #[must_use]
    pub fn prepare_sleep(&mut self, seen: ChangeMark) -> bool {
        let cells = self.segment.cells();
        cells.doorbell.sleeping.store(1, Ordering::Relaxed);
        // The other half is in `CpuSide::take_doorbell`.
        fence(Ordering::SeqCst);
        if cells.outputs.changes.load(Ordering::Relaxed) == seen.0 {
            return true;
        }
        cells.doorbell.sleeping.store(0, Ordering::Relaxed);
        false
    }

    /// Withdraws the announcement: the driver is running. The doorbell may still contain a byte.
    pub fn awake(&mut self) {
        self.cells().doorbell.sleeping.store(0, Ordering::Relaxed);
    }

    /// Whether the output registers have changed since [`Self::read_outputs`] was last fresh.
    #[inline]
    pub fn outputs_changed(&self) -> bool {
        self.outputs.is_outdated(&self.cells().outputs.registers)
    }

    /// Copies the output registers into `into` (as far as either reaches). A stale copy is whole, but not the newest.
    #[inline]
    pub fn read_outputs(&mut self, into: &mut [u8]) -> Freshness {
        let freshness = self.outputs.read(&self.segment.cells().outputs.registers, self.io.words());
        let len = into.len().min(self.io.get());
        copy_out(self.outputs.last(), into.get_mut(..len).unwrap_or_default());
        freshness
    }

    /// Writes the input registers; true if that changed anything. Bytes that `data` does not reach keep their value,
    /// bytes beyond `io_bytes` are ignored.
    #[inline]
    pub fn write_inputs(&mut self, data: &[u8]) -> bool {
        self.inputs.write(&self.segment.cells().inputs.registers, data)
    }

    /// Whether parameters have been transferred since [`Self::read_params`] was last fresh.
    pub fn params_changed(&self) -> bool {
        self.params.is_outdated(&self.cells().params)
    }

    /// The parameter record. Its revision is 0 before the first transfer.
    ///
    /// # Errors
    /// [`Fault::ParameterLength`] if it claims more text than fits.
    pub fn read_params(&mut self) -> Result<Params<'_>, Fault> {
        read_params(&mut self.params, &self.segment.cells().params, &mut self.json)
    }

    /// Writes a diagnostic record (the CPU reads it with SFC 51 or 59).
    ///
    /// # Errors
    /// [`TooLong`] beyond 240 bytes; then nothing is written.
    pub fn write_diagnosis(&mut self, number: u32, data: &[u8]) -> Result<(), TooLong> {
        write_record(&self.cells().diagnosis, number, data)
    }

    /// Enters an event into the CP's diagnostic buffer, with the CPU's time: class and number, and whether it comes or
    /// goes.
    pub fn enter(&mut self, number: u16, incoming: bool) {
        let cells = self.segment.cells();
        let time_ms = cells.cpu.time.load(Ordering::Relaxed) / 1_000_000;
        self.buffer.enter(&cells.buffer, BufferEntry { number, incoming, time_ms });
    }

    /// When the CPU has written what this driver finds now: CLOCK_MONOTONIC in nanoseconds, as of the beginning of that
    /// scan; 0: not said.
    pub fn posted(&self) -> u64 {
        self.cells().times.posted.load(Ordering::Relaxed)
    }

    /// Says where the time of an order went that has ended, or of a telegram that was handed over.
    pub fn enter_times(&mut self, times: OrderTimes) {
        times::enter(&self.cells().times, times);
    }

    /// Emits an event. False: the ring is full, and the event is counted as lost.
    pub fn emit_event(&mut self, event: Event) -> bool {
        self.events.emit(&self.segment.cells().events, event)
    }

    /// Writes a block of a channel for the CPU; true if it differs from the last one.
    pub fn write_channel(&mut self, channel: Channel, block: &ChannelBlock) -> bool {
        self.channels.write(&self.segment.cells().channels, channel, block)
    }

    /// Whether the CPU has written a block of the channel since the last read.
    pub fn channel_changed(&self, channel: Channel) -> bool {
        self.channels.changed(&self.cells().channels, channel)
    }

    /// Copies the CPU's block of a channel. A stale copy is whole, but not the newest.
    pub fn read_channel(&mut self, channel: Channel, into: &mut ChannelBlock) -> Freshness {
        self.channels.read(&self.segment.cells().channels, channel, into)
    }

    /// Whether the CP has boxes.
    pub fn has_boxes(&self) -> bool {
        self.segment.boxes().is_some()
    }

    /// Writes bytes into a box for the CPU, from its first byte on. Does nothing without boxes.
    pub fn write_box(&mut self, index: usize, bytes: &[u8]) {
        self.boxes.write(self.segment.boxes(), index, bytes);
    }

    /// Whether the CPU has written to a box since the last read.
    pub fn box_changed(&self, index: usize) -> bool {
        self.boxes.changed(self.segment.boxes(), index)
    }

    /// Copies the CPU's content of a box, as many bytes as `into` has. A stale copy is whole, but not the newest.
    pub fn read_box(&mut self, index: usize, into: &mut [u8]) -> Freshness {
        self.boxes.read(self.segment.boxes(), index, into)
    }

    /// Adds to a counter.
    #[inline]
    pub fn count(&mut self, counter: Counter, count: u64) {
        counters::add(&self.cells().counters, counter, count);
    }

    /// Counts an order that ended with this error number.
    pub fn count_end(&mut self, number: u16) {
        counters::add_end(&self.cells().ends, number);
    }

    /// The counters of this CP, those of earlier drivers included.
    pub fn counters(&self) -> Counters {
        Counters::read(&self.cells().counters)
    }

    /// Shows the driver's state.
    pub fn set_state(&mut self, state: DriverState) {
        self.cells().cp.state.store(state.to_word(), Ordering::Release);
    }

    /// Shows the LEDs of the CP's front; the CPU only displays them.
    pub fn set_leds(&mut self, leds: Leds) {
        self.cells().cp.leds.store(words::leds_to_word(leds), Ordering::Relaxed);
    }

    /// Shows what the CP waits for or what has failed, with the CPU's time.
    pub fn set_reason(&mut self, reason: Option<Reason>) {
        let cells = self.cells();
        let seconds = cells.cpu.time.load(Ordering::Relaxed) / 1_000_000_000;
        let word = reason.map_or(0, |reason| words::reason_to_word(reason, seconds));
        cells.cp.reason.store(word, Ordering::Relaxed);
    }

    /// Shows the modem lines.
    pub fn set_modem_inputs(&mut self, lines: ModemInputs) {
        self.cells().cp.modem_inputs.store(lines.to_word(), Ordering::Relaxed);
    }

    /// Modem lines as set by the CPU.
    pub fn modem_outputs(&self) -> ModemOutputs {
        ModemOutputs::from_word(self.cells().cpu.modem_outputs.load(Ordering::Acquire))
    }

    /// State of the CPU.
    ///
    /// # Errors
    /// [`Fault::CpuState`] if the word has no meaning.
    pub fn cpu_state(&self) -> Result<CpuState, Fault> {
        CpuState::from_word(self.cells().cpu.state.load(Ordering::Acquire))
    }

    /// A number the CPU changes with every scan.
    pub fn cpu_heartbeat(&self) -> u64 {
        self.cells().cpu.heartbeat.load(Ordering::Relaxed)
    }

    /// Counts one more pass of the driver's loop. A driver that sleeps long wakes up from time to time to do this.
    #[inline]
    pub fn beat(&mut self) {
        let heartbeat = &self.cells().cp.heartbeat;
        heartbeat.store(heartbeat.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
    }
}
