//! What the services of the standard blocks keep: masks, locks, interrupts by time, meters.

use ob1_model::moment::Moment;
use ob1_std::services::{DelayInterrupt, ErrorFilter, InterruptLocks, RunTimeMeter, TimeOfDayInterrupt};
use ob1_time::Instant;

/// What the CPU keeps of a time-of-day interrupt besides what is set.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Course {
    /// When it is due next, by the clock.
    pub(crate) next: Option<Moment>,
    /// The first and the last time it was due, since it was set or the clock was set forward.
    pub(crate) called: Option<(Moment, Moment)>,
    /// At this time of the CPU the clock was set past this moment, at which it was due.
    pub(crate) skipped: Option<(Instant, Moment)>,
}

/// State of the services.
#[derive(Debug)]
pub(crate) struct ServiceState {
    pub(crate) filter: ErrorFilter,
    pub(crate) locks: InterruptLocks,
    pub(crate) time_of_day: [TimeOfDayInterrupt; 8],
    pub(crate) courses: [Course; 8],
    /// Time-of-day interrupts skipped by a clock that was set, which OB 80 has not been told, one bit each.
    pub(crate) skipped: u8,
    pub(crate) delays: [DelayInterrupt; 4],
    pub(crate) meters: [RunTimeMeter; 8],
    /// Start information of the last start-up OB.
    pub(crate) start_up: [u8; 20],
    /// A block has used a service that can change due times.
    pub(crate) touched: bool,
}

impl ServiceState {
    pub(crate) fn new(loaded: impl Fn(u16) -> bool) -> Self {
        Self {
            filter: ErrorFilter::default(),
            locks: InterruptLocks::default(),
            time_of_day: std::array::from_fn(|i| TimeOfDayInterrupt {
                loaded: loaded(10 + i as u16),
                ..Default::default()
            }),
            courses: [Course::default(); 8],
            skipped: 0,
            delays: std::array::from_fn(|i| DelayInterrupt { loaded: loaded(20 + i as u16), ..Default::default() }),
            meters: [RunTimeMeter::default(); 8],
            start_up: [0; 20],
            touched: false,
        }
    }

    /// Another program: these organization blocks are loaded now.
    pub(crate) fn loaded(&mut self, loaded: impl Fn(u16) -> bool) {
        for (ob, interrupt) in (10..).zip(&mut self.time_of_day) {
            interrupt.loaded = loaded(ob);
        }
        for (ob, delay) in (20..).zip(&mut self.delays) {
            delay.loaded = loaded(ob);
        }
    }

    /// A start-up begins: masks, locks and interrupts by time that the program has set are gone. Run-time meters keep
    /// their count.
    pub(crate) fn clear(&mut self) {
        (self.filter, self.locks) = (ErrorFilter::default(), InterruptLocks::default());
        self.time_of_day.iter_mut().for_each(|i| (i.set, i.active, i.withdrawn) = (None, false, false));
        (self.courses, self.skipped) = ([Course::default(); 8], 0);
        self.delays.iter_mut().for_each(|i| i.due = None);
        self.touched = false;
    }

    /// The CPU was in STOP between two times. A hot restart continues the run-time meters, the other ones leave them to
    /// the program.
    pub(crate) fn meters_stood(&mut self, from: Instant, to: Instant, hot: bool) {
        self.meters.iter_mut().for_each(|meter| meter.stood(from, to, hot));
    }
}
