//! What the services of the standard blocks keep: masks, locks, interrupts by time, meters, signals of messages.

use ob1_model::moment::Moment;
use ob1_std::services::{
    Alarm, AlarmError, DelayInterrupt, ErrorFilter, InUse, InterruptLocks, RunTimeMeter, TimeOfDayInterrupt,
};
use ob1_time::Instant;

/// Message numbers that can be in use at one time.
const NUMBERS: usize = 64;

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
    /// Signals of block-related messages.
    pub(crate) signals: Signals,
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
            signals: Signals::default(),
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
        self.signals = Signals::default();
    }

    /// The CPU was in STOP between two times. A hot restart continues the run-time meters, the other ones leave them to
    /// the program.
    pub(crate) fn meters_stood(&mut self, from: Instant, to: Instant, hot: bool) {
        self.meters.iter_mut().for_each(|meter| meter.stood(from, to, hot));
    }
}

/// The message numbers seen, with their signals.
#[derive(Debug)]
pub(crate) struct Signals {
    list: [InUse; NUMBERS],
    used: usize,
}

impl Default for Signals {
    fn default() -> Self {
        Self { list: [InUse::default(); NUMBERS], used: 0 }
    }
}

impl Signals {
    /// Notes the signal of a number. A number whose signal has gone makes room when another needs it.
    pub(crate) fn change(&mut self, alarm: Alarm<'_>) -> Result<(), AlarmError> {
        // With nobody logged on, a message that waits for an acknowledgement has it at once.
        let Alarm { sfc, id, component, signal, acknowledge: acknowledged, .. } = alarm;
        if let Some(known) = self.list[..self.used].iter_mut().find(|known| known.id == id) {
            if known.signal == signal {
                return Err(AlarmError::NoChange);
            }
            (known.signal, known.acknowledged) = (signal, acknowledged);
            return Ok(());
        }
        if !signal {
            return Err(AlarmError::FirstIsZero);
        }
        let place = match self.list[..self.used].iter().position(|number| !number.signal) {
            _ if self.used < NUMBERS => {
                self.used += 1;
                self.used - 1
            }
            Some(gone) => gone,
            None => return Err(AlarmError::NoResources),
        };
        self.list[place] = InUse { sfc, id, component, signal, acknowledged };
        Ok(())
    }

    /// The numbers that have a place.
    pub(crate) fn in_use(&self) -> &[InUse] {
        &self.list[..self.used]
    }

    /// Sets numbers free for which `which` is true.
    pub(crate) fn release(&mut self, which: &dyn Fn(InUse) -> bool) {
        let mut at = 0;
        while at < self.used {
            if which(self.list[at]) {
                self.used -= 1;
                self.list[at] = self.list[self.used];
            } else {
                at += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_change_and_make_room() {
        let mut signals = Signals::default();
        let alarm = |id, signal| Alarm { sfc: 108, id, component: id % 2, signal, acknowledge: false, value: &[] };
        assert_eq!(signals.change(alarm(1, false)), Err(AlarmError::FirstIsZero));
        for id in 1..=NUMBERS as u32 {
            assert_eq!(signals.change(alarm(id, true)), Ok(()));
        }
        assert_eq!(signals.change(alarm(1, true)), Err(AlarmError::NoChange));
        assert_eq!(signals.change(alarm(1000, true)), Err(AlarmError::NoResources));
        assert_eq!(signals.change(alarm(7, false)), Ok(()));
        assert_eq!(signals.change(alarm(1000, true)), Ok(()));
        assert_eq!(signals.change(alarm(7, false)), Err(AlarmError::FirstIsZero), "its place is another's");
        signals.release(&|number| number.component == 0);
        assert_eq!(signals.used, NUMBERS / 2 - 1);
        assert!(signals.list[..signals.used].iter().all(|number| number.id % 2 == 1));
        assert_eq!(signals.change(alarm(2, true)), Ok(()), "set free, so it is a new one");
    }
}
