//! What anyone in the runtime may look at, from any thread: the supervisor, the access port, the report.

use crate::buffer::{self, BufferEntry};
use crate::cells::{BoxesCells, SegmentCells};
use crate::counters::{Counters, book_lost};
use crate::fault::Fault;
use crate::header;
use crate::registers::IoBytes;
use crate::segment::Segment;
use crate::sync::Ordering;
use crate::words::{self, DriverState, Leds, ModemInputs};

/// A view of one CP that disturbs nobody. Every value is a single word, checked.
#[derive(Clone, Debug)]
pub struct Monitor {
    segment: Segment,
    io: IoBytes,
}

impl Monitor {
    pub(crate) fn new(segment: Segment, io: IoBytes) -> Self {
        Self { segment, io }
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

    /// Another number with every driver that attaches; 0 before the first. Nothing follows from its size.
    #[inline]
    #[must_use]
    pub fn generation(&self) -> u64 {
        // Pairs with the store(Release) in `CpSide::attach`: who sees the new number sees everything reset.
        self.cells().cp.generation.load(Ordering::Acquire)
    }

    /// A number the driver changes with every pass of its loop: a driver that leaves it alone for long hangs.
    #[must_use]
    pub fn cp_heartbeat(&self) -> u64 {
        self.cells().cp.heartbeat.load(Ordering::Relaxed)
    }

    /// A number the CPU changes with every scan.
    #[must_use]
    pub fn cpu_heartbeat(&self) -> u64 {
        self.cells().cpu.heartbeat.load(Ordering::Relaxed)
    }

    /// The LEDs of the CP.
    #[must_use]
    pub fn leds(&self) -> Leds {
        words::leds_from_word(self.cells().cp.leds.load(Ordering::Relaxed))
    }

    /// State of the modem lines at the CP.
    #[must_use]
    pub fn modem_inputs(&self) -> ModemInputs {
        ModemInputs::from_word(self.cells().cp.modem_inputs.load(Ordering::Relaxed))
    }

    /// The counters of the CP.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters::read(&self.cells().counters)
    }

    /// Events the driver had to drop because the ring was full.
    #[must_use]
    pub fn events_lost(&self) -> u64 {
        self.cells().events.lost.load(Ordering::Relaxed)
    }

    /// The CP's diagnostic buffer, newest entry first: at most [`crate::layout::BUFFER_ENTRIES`]. It outlives its
    /// drivers.
    pub fn buffer(&self) -> impl Iterator<Item = BufferEntry> {
        buffer::read(&self.cells().buffer)
    }

    /// Whether the driver sleeps, as far as one can see. The decision to ring is [`crate::CpuSide::take_doorbell`].
    #[must_use]
    pub fn driver_sleeps(&self) -> bool {
        self.cells().doorbell.sleeping.load(Ordering::Relaxed) != 0
    }

    /// Writes the header once more: a driver attaches to nothing else. Without damage it changes nothing. Call it
    /// before each start of a driver; what the CPU's side has put in besides is restored by
    /// [`crate::CpuSide::restore`].
    pub fn restore_header(&self) {
        header::write(&self.segment, self.io);
    }

    /// Clears what a dead driver has left: input registers, LEDs and modem lines read 0, the state is
    /// [`DriverState::Absent`], orders in its buffers are booked as lost. The generation stays.
    ///
    /// Only for whoever knows that the driver's process has ended (its pidfd has said so) and has not started another:
    /// it writes in the driver's place.
    pub fn driver_gone(&self) {
        let cells = self.cells();
        // Before the registers: who sees their zeros no longer sees a driver.
        cells.cp.state.store(DriverState::Absent.to_word(), Ordering::Release);
        cells.inputs.registers.write([0; crate::cells::IO_WORDS].into_iter());
        cells.doorbell.sleeping.store(0, Ordering::Relaxed);
        cells.cp.leds.store(0, Ordering::Relaxed);
        cells.cp.modem_inputs.store(0, Ordering::Relaxed);
        book_lost(&cells.counters);
    }
}
