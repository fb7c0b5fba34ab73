//! What any part of the runtime may read, from any thread: the supervisor, the control socket, the report.

use std::sync::Arc;

use crate::buffer::{self, BufferEntry};
use crate::cells::{BoxesCells, SegmentCells};
use crate::counters::{self, Counters, Ends, book_lost};
use crate::fault::Fault;
use crate::header;
use crate::registers::IoBytes;
use crate::segment::Segment;
use crate::sync::Ordering;
use crate::times::{Spread, TimesAccount};
use crate::words::{self, DriverState, Leds, ModemInputs, Reason};

/// A view of one CP that does not disturb it. Every value is a single word, checked.
#[derive(Clone, Debug)]
pub struct Monitor {
    segment: Segment,
    io: IoBytes,
    account: Arc<TimesAccount>,
}

impl Monitor {
    pub(crate) fn new(segment: Segment, io: IoBytes) -> Self {
        Self { segment, io, account: Arc::default() }
    }

    #[inline]
    pub(crate) fn cells(&self) -> &SegmentCells {
        self.segment.cells()
    }

    #[inline]
    pub(crate) fn boxes(&self) -> Option<&BoxesCells> {
        self.segment.boxes()
    }

    /// State of the driver.
    ///
    /// # Errors
    /// [`Fault::DriverState`] if the word has no meaning.
    #[inline]
    pub fn driver_state(&self) -> Result<DriverState, Fault> {
        DriverState::from_word(self.cells().cp.state.load(Ordering::Acquire))
    }

    /// Changes with every driver that attaches; 0 before the first. Its magnitude has no meaning.
    #[inline]
    pub fn generation(&self) -> u64 {
        // Pairs with the store(Release) in `CpSide::attach`: a reader that sees the new number sees everything reset.
        self.cells().cp.generation.load(Ordering::Acquire)
    }

    /// A number the driver changes with every pass of its loop. If it stays the same for long, the driver hangs.
    pub fn cp_heartbeat(&self) -> u64 {
        self.cells().cp.heartbeat.load(Ordering::Relaxed)
    }

    /// A number the CPU changes with every scan.
    pub fn cpu_heartbeat(&self) -> u64 {
        self.cells().cpu.heartbeat.load(Ordering::Relaxed)
    }

    /// The LEDs of the CP.
    pub fn leds(&self) -> Leds {
        words::leds_from_word(self.cells().cp.leds.load(Ordering::Relaxed))
    }

    /// What the CP says it waits for or what has failed, and the CPU's time in seconds when that last changed. A driver
    /// that does not know the field says nothing.
    pub fn reason(&self) -> Option<(Reason, u64)> {
        words::reason_from_word(self.cells().cp.reason.load(Ordering::Relaxed))
    }

    /// With which numbers orders have ended, and how many of them.
    pub fn ends(&self) -> impl Iterator<Item = Ends> {
        counters::ends(&self.cells().ends)
    }

    /// State of the modem lines at the CP.
    pub fn modem_inputs(&self) -> ModemInputs {
        ModemInputs::from_word(self.cells().cp.modem_inputs.load(Ordering::Relaxed))
    }

    /// The counters of the CP.
    pub fn counters(&self) -> Counters {
        Counters::read(&self.cells().counters)
    }

    /// Events the driver had to drop because the ring was full.
    pub fn events_lost(&self) -> u64 {
        self.cells().events.lost.load(Ordering::Relaxed)
    }

    /// The CP's diagnostic buffer, newest entry first: at most [`crate::layout::BUFFER_ENTRIES`]. It outlives its
    /// drivers.
    pub fn buffer(&self) -> impl Iterator<Item = BufferEntry> {
        buffer::read(&self.cells().buffer)
    }

    /// How long the stages of orders and telegrams took, all so far; empty if the driver does not say it.
    pub fn spreads(&self) -> impl Iterator<Item = Spread> {
        self.account.spreads()
    }

    pub(crate) fn account(&self) -> &TimesAccount {
        &self.account
    }

    /// Whether the driver seems to sleep. The decision to ring is [`crate::CpuSide::take_doorbell`].
    pub fn driver_sleeps(&self) -> bool {
        self.cells().doorbell.sleeping.load(Ordering::Relaxed) != 0
    }

    /// Writes the header again: a driver attaches only to a correct one. Without damage it changes nothing. Call it
    /// before each start of a driver; [`crate::CpuSide::restore`] restores everything else the CPU side has written.
    pub fn restore_header(&self) {
        header::write(&self.segment, self.io);
    }

    /// Clears what a dead driver has left: input registers, LEDs and modem lines read 0, the state is
    /// [`DriverState::Absent`], orders in its buffers are booked as lost. The generation stays.
    ///
    /// Call it only when the driver's process is known to have ended (by its pidfd) and no other was started: it writes
    /// in the driver's place.
    pub fn driver_gone(&self) {
        let cells = self.cells();
        // Before the registers: a reader that sees their zeros no longer sees a driver.
        cells.cp.state.store(DriverState::Absent.to_word(), Ordering::Release);
        cells.inputs.registers.write([0; crate::cells::IO_WORDS].into_iter());
        cells.doorbell.sleeping.store(0, Ordering::Relaxed);
        cells.cp.leds.store(0, Ordering::Relaxed);
        cells.cp.modem_inputs.store(0, Ordering::Relaxed);
        cells.cp.reason.store(0, Ordering::Relaxed);
        book_lost(&cells.counters);
    }
}
