//! The CPU's end of a segment. It belongs to the scan: it does not allocate, wait or make system calls, and trusts
//! nothing the driver writes.

use crate::boxes::BoxEnd;
use crate::bytes::copy_out_from;
use crate::cells::{IO_WORDS, RECORD_WORDS, SegmentCells};
use crate::channel::{Channel, ChannelBlock, ChannelEnd, Way};
use crate::events::{Consumer, Event};
use crate::fault::{Fault, SegmentError, TooLong};
use crate::header;
use crate::layout::PARAMETER_BYTES;
use crate::monitor::Monitor;
use crate::record::{Record, read_record, write_params};
use crate::registers::{IoBytes, RegisterWriter};
use crate::segment::Segment;
use crate::seqlock::{Freshness, SeqReader};
use crate::sync::{Ordering, fence};
use crate::times::{OrderTimes, TimesReader};
use crate::words::{CpuState, ModemOutputs};

/// The CPU's end of a segment. There is one for each segment.
pub struct CpuSide {
    monitor: Monitor,
    io: IoBytes,
    outputs: RegisterWriter,
    inputs: SeqReader<IO_WORDS>,
    diagnosis: SeqReader<RECORD_WORDS>,
    events: Consumer,
    channels: ChannelEnd,
    boxes: BoxEnd,
    state: CpuState,
    modem: ModemOutputs,
    changes: u64,
    bell_due: bool,
    times: TimesReader,
    /// CLOCK_MONOTONIC at the zero of the CPU's clock, and the beginning of the scan by the former.
    origin: Option<u64>,
    begun: u64,
}

impl CpuSide {
    /// Formats an empty segment for a module with `io_bytes` register bytes each way (8 to 64). No driver may be
    /// attached yet.
    ///
    /// # Errors
    /// [`SegmentError::IoBytes`] for a number outside that range.
    pub fn create(segment: &Segment, io_bytes: usize) -> Result<Self, SegmentError> {
        let io = IoBytes::new(io_bytes).ok_or(SegmentError::IoBytes(io_bytes))?;
        header::format(segment, io);
        Ok(Self {
            monitor: Monitor::new(segment.clone(), io),
            io,
            outputs: RegisterWriter::new(io),
            inputs: SeqReader::new(),
            diagnosis: SeqReader::new(),
            events: Consumer::new(),
            channels: ChannelEnd::new(Way::ToCp),
            boxes: BoxEnd::new(Way::ToCp, segment.boxes()),
            state: CpuState::Stop,
            modem: ModemOutputs::default(),
            changes: 0,
            bell_due: false,
            times: TimesReader::default(),
            origin: None,
            begun: 0,
        })
    }

    /// Writes everything of the CPU side again, header included, except the parameters and the record, of which it
    /// keeps no copy. Call it before a driver is restarted, then transfer the parameters: the last driver may have
    /// overwritten words that are not its own. Without such damage it changes nothing.
    pub fn restore(&mut self) {
        let cells = self.monitor.cells();
        self.monitor.restore_header();
        self.outputs.rewrite(&cells.outputs.registers);
        self.events.publish(&cells.events);
        self.channels.rewrite(&cells.channels);
        // Jobs do not outlive a driver: the handling blocks notice its successor and start again.
        self.boxes.clear(self.monitor.boxes());
        self.set_modem_outputs(self.modem);
        self.set_cpu_state(self.state);
    }

    /// The read-only view: state, generation, LEDs, counters. Clones of it may go to other threads.
    #[inline]
    pub fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// Register bytes each way.
    pub fn io_bytes(&self) -> usize {
        self.io.get()
    }

    #[inline]
    fn cells(&self) -> &SegmentCells {
        self.monitor.cells()
    }

    /// Tells the driver that something has changed: the doorbell protocol relies on one call after each change.
    #[inline]
    fn changed(&mut self) {
        self.changes = self.changes.wrapping_add(1);
        self.cells().times.posted.store(self.begun, Ordering::Relaxed);
        self.cells().outputs.changes.store(self.changes, Ordering::Release);
        self.bell_due = true;
    }

    /// Writes the output registers; true if that changed anything (if not, nothing is written). Bytes that `data` does
    /// not reach keep their value, bytes beyond `io_bytes` are ignored.
    #[inline]
    pub fn write_outputs(&mut self, data: &[u8]) -> bool {
        let changed = self.outputs.write(&self.monitor.cells().outputs.registers, data);
        if changed {
            self.changed();
        }
        changed
    }

    /// Copies the input registers into `into` (as far as either reaches). A stale copy is whole, but not the newest.
    #[inline]
    pub fn read_inputs(&mut self, into: &mut [u8]) -> Freshness {
        self.read_inputs_from(0, into)
    }

    /// The same, from register byte `at` on.
    #[inline]
    pub fn read_inputs_from(&mut self, at: usize, into: &mut [u8]) -> Freshness {
        let registers = &self.monitor.cells().inputs.registers;
        // The 16 bytes of a CP are passed on from processor registers. The copy has just been written in 8-byte pieces;
        // a wider read of it would stall the processor. The first of them are the count words, which idle blocks read.
        if self.io.get() == 16
            && let Some([first, second]) = self.inputs.try_two(registers)
        {
            let (first, second) = (first.to_ne_bytes(), second.to_ne_bytes());
            if let (0, ([low, high], [])) = (at, into.as_chunks_mut::<8>()) {
                (*low, *high) = (first, second);
                return Freshness::Fresh;
            }
            if let Some(from) = first.get(at..at + into.len()) {
                into.copy_from_slice(from);
                return Freshness::Fresh;
            }
        }
        let freshness = self.inputs.read(registers, self.io.words());
        let len = into.len().min(self.io.get().saturating_sub(at));
        copy_out_from(self.inputs.last(), at, into.get_mut(..len).unwrap_or_default());
        freshness
    }

    /// Whether the driver has written its registers since the last [`Self::read_inputs`]: one load, for callers that
    /// spin.
    #[inline]
    pub fn inputs_changed(&self) -> bool {
        self.inputs.is_outdated(&self.monitor.cells().inputs.registers)
    }

    /// Whether the driver sleeps and must be woken for what was written since the last call; true at most once per
    /// sleep. Call it once per scan, after the last write; it costs nothing if nothing was written.
    #[inline]
    pub fn take_doorbell(&mut self) -> bool {
        if !self.bell_due {
            return false;
        }
        self.bell_due = false;
        // Either we see the driver's flag, or the driver sees our change after its own fence in
        // `CpSide::prepare_sleep`: both fences are SeqCst, so one of them comes first.
        fence(Ordering::SeqCst);
        let sleeping = &self.cells().doorbell.sleeping;
        if sleeping.load(Ordering::Relaxed) == 0 {
            return false;
        }
        sleeping.store(0, Ordering::Relaxed);
        true
    }

    /// Writes the output registers, and does what [`Self::take_doorbell`] does, with nothing between: for a test that
    /// meets a driver that goes to sleep.
    #[inline(never)]
    pub fn post(&mut self, data: &[u8]) -> bool {
        self.write_outputs(data) && self.take_doorbell()
    }

    /// Transfers parameters: the module's 16 bytes and the driver's configuration as JSON text. A driver notices every
    /// transfer, even one of the same content.
    ///
    /// # Errors
    /// [`TooLong`] if the text does not fit; then nothing is written.
    pub fn write_params(&mut self, bytes: &[u8; PARAMETER_BYTES], json: &[u8]) -> Result<(), TooLong> {
        write_params(&self.cells().params, bytes, json)?;
        self.changed();
        Ok(())
    }

    /// The diagnostic record of the CP (SFC 51, 59).
    ///
    /// # Errors
    /// [`Fault::RecordLength`] if it claims to be longer than fits.
    pub fn read_diagnosis(&mut self) -> Result<Record, Fault> {
        read_record(&mut self.diagnosis, &self.monitor.cells().diagnosis)
    }

    /// Takes the oldest event of the CP. A driver can produce events as fast as this is called: limit the calls per
    /// scan.
    ///
    /// # Errors
    /// [`Fault::EventRing`] or [`Fault::Event`]; the next call continues after it.
    #[inline]
    pub fn poll_event(&mut self) -> Result<Option<Event>, Fault> {
        self.events.poll(&self.monitor.cells().events)
    }

    /// Writes a block of a channel for the CP; true if it differs from the last one (if not, nothing is written).
    pub fn write_channel(&mut self, channel: Channel, block: &ChannelBlock) -> bool {
        let changed = self.channels.write(&self.monitor.cells().channels, channel, block);
        if changed {
            self.changed();
        }
        changed
    }

    /// Copies the CP's block of a channel. A stale copy is whole, but not the newest.
    pub fn read_channel(&mut self, channel: Channel, into: &mut ChannelBlock) -> Freshness {
        self.channels.read(&self.monitor.cells().channels, channel, into)
    }

    /// Writes bytes into a box for the CP, from its first byte on. Does nothing without boxes.
    pub fn write_box(&mut self, index: usize, bytes: &[u8]) {
        self.boxes.write(self.monitor.boxes(), index, bytes);
        self.changed();
    }

    /// Copies the CP's content of a box, as many bytes as `into` has. A stale copy is whole, but not the newest.
    pub fn read_box(&mut self, index: usize, into: &mut [u8]) -> Freshness {
        self.boxes.read(self.monitor.boxes(), index, into)
    }

    /// Tells the CP the state of the CPU.
    pub fn set_cpu_state(&mut self, state: CpuState) {
        self.state = state;
        self.cells().cpu.state.store(state.to_word(), Ordering::Release);
        self.changed();
    }

    /// Drives modem lines of the CP.
    pub fn set_modem_outputs(&mut self, lines: ModemOutputs) {
        self.modem = lines;
        self.cells().cpu.modem_outputs.store(lines.to_word(), Ordering::Release);
        self.changed();
    }

    /// Says what CLOCK_MONOTONIC shows, in nanoseconds, when the CPU's clock shows 0. Without it no time of an order is
    /// said.
    pub fn set_origin(&mut self, monotonic: u64) {
        self.origin = Some(monotonic);
    }

    /// A scan begins, by the CPU's clock: what it writes is posted now.
    #[inline]
    pub fn begin_scan(&mut self, now: u64) {
        self.begun = self.origin.map_or(0, |origin| origin.saturating_add(now));
    }

    /// The scan has ended, by the CPU's clock: takes what the driver has said of orders into the account; `told` gets
    /// each order and telegram that the program could see now for the first time. At most as many as the ring holds.
    #[inline]
    pub fn end_scan(&mut self, now: u64, told: impl FnMut(&OrderTimes)) {
        let Some(origin) = self.origin else { return };
        let scan = (self.begun, origin.saturating_add(now));
        self.times.take(&self.monitor.cells().times, scan, self.monitor.account(), told);
    }

    /// Publishes the CPU's time, in nanoseconds since the runtime started: the clock of the CP's diagnostic buffer.
    /// Does not wake the driver.
    #[inline]
    pub fn set_time(&mut self, now: u64) {
        self.cells().cpu.time.store(now, Ordering::Relaxed);
    }

    /// Counts one more scan. Does not wake the driver.
    #[inline]
    pub fn beat(&mut self) {
        let heartbeat = &self.cells().cpu.heartbeat;
        heartbeat.store(heartbeat.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
    }
}
