//! What can be set about a CPU besides its sizes: family, interrupts by time, missed deadlines, what is retentive.

use ob1_model::moment::Moment;
use ob1_std::services::Period;
use ob1_time::Span;

/// The family whose rules apply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Family {
    /// Two accumulators; image errors are silent; no hot restart.
    #[default]
    S7_300,
    /// Four accumulators; an image error calls OB 85 at each access, STOP without it; hot restart through OB 101.
    S7_400,
}

impl Family {
    /// The number of accumulators, 2 or 4.
    #[must_use]
    pub const fn accumulators(self) -> u8 {
        match self {
            Family::S7_300 => 2,
            Family::S7_400 => 4,
        }
    }
}

/// What happens to a cyclic interrupt that is due while its OB is still being executed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Missed {
    /// It runs once afterwards, as on the hardware.
    #[default]
    CatchUp,
    /// It is left out.
    Skip,
}

/// What happens to the schedule of the cycles when one has not ended, or could not begin, before the next was due.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MissedCycle {
    /// The next cycle begins at once, and the minimum cycle time counts from there, as on the hardware.
    #[default]
    Now,
    /// The schedule stays: deadlines that have passed are left out, the next cycle begins at the next one.
    Skip,
    /// The schedule stays: cycles begin at once until it has been caught up with. More than [`MissedCycle::MOST`]
    /// behind are left out.
    CatchUp,
}

impl MissedCycle {
    /// Most cycles that are caught up.
    pub const MOST: u64 = 1000;
}

/// A cyclic interrupt. OB 30 to 38 that are loaded but not configured run every 5 s, 2 s, 1 s, 500, 200, 100, 50, 20
/// and 10 ms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CyclicInterrupt {
    /// The organization block, 30 to 38.
    pub ob: u16,
    /// The interval, 1 ns to 60 s. It begins at the transition to RUN.
    pub period: Span,
    /// How much later than the interval the OB starts, 0 to 60 s.
    pub phase: Span,
    /// What happens to a due time that is missed. Both ways it is counted and OB 80 is called.
    pub missed: Missed,
}

impl CyclicInterrupt {
    /// Without phase offset, caught up when missed.
    #[must_use]
    pub const fn new(ob: u16, period: Span) -> Self {
        Self { ob, period, phase: Span::ZERO, missed: Missed::CatchUp }
    }
}

/// A time-of-day interrupt that is set and activated at each start-up, as the hardware configuration does it. SFC 28 to
/// 30 may change it until the next one. Without its OB it has no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeOfDay {
    /// The organization block, 10 to 17.
    pub ob: u16,
    /// The first time. One that has passed counts as the origin of the period.
    pub start: Moment,
    /// How often it comes after `start`.
    pub period: Period,
}

/// What keeps its value over a warm restart and a power cycle. The default is no bit memory, timers or counters, and
/// all data blocks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Retentive {
    /// Bytes of bit memory.
    pub memory: Vec<std::ops::Range<u32>>,
    /// Timers. A running one continues with the time that was left.
    pub timers: Vec<std::ops::Range<u16>>,
    /// Counters, by their numbers.
    pub counters: Vec<std::ops::Range<u16>>,
    /// Data blocks, or bytes of them.
    pub data: RetentiveData,
}

/// Which data blocks are retentive.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum RetentiveData {
    /// All, those the program makes itself too.
    #[default]
    All,
    /// These. The others get their load values at a warm restart.
    Only(Vec<DataRange>),
}

/// A data block, or bytes of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataRange {
    /// Number of the data block.
    pub db: u16,
    /// Bytes of it; `None`: all.
    pub bytes: Option<std::ops::Range<u32>>,
}
