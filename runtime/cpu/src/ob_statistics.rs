//! Figures of each loaded organization block: runs, execution time, lateness, requests lost. Recording allocates nothing.

use hdrhistogram::Histogram;
use ob1_std::services::RunTimes;

use crate::Nanos;
use crate::statistics::{Distribution, LONGEST, distribution};

/// Figures of one organization block since the start or the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObStatistics {
    /// Its number.
    pub ob: u16,
    /// Its priority class.
    pub priority: u8,
    /// Completed runs.
    pub runs: u64,
    /// Requests lost, periods skipped, and requests that came while it was still being executed.
    pub overruns: u64,
    /// From start to end, without the higher classes that ran meanwhile.
    pub execution: Distribution,
    /// From the due time to the start: OB 1 against its deadline, interrupts against theirs. Empty for the others.
    pub lateness: Distribution,
}

/// What is recorded of one block.
#[derive(Debug)]
pub(crate) struct ObRecord {
    pub(crate) ob: u16,
    pub(crate) runs: u64,
    execution: Histogram<u64>,
    lateness: Histogram<u64>,
    longest: Nanos,
    latest: Nanos,
    /// Of the last completed run: without and with the higher classes.
    last: Option<(Nanos, Nanos)>,
    /// How late the next run begins.
    waited: Nanos,
    current: Option<Current>,
}

/// A run under way.
#[derive(Clone, Copy, Debug)]
struct Current {
    began: Nanos,
    requested: Nanos,
    /// Since when a higher class runs, and how long others had before.
    paused: Option<(Nanos, Nanos)>,
    /// It has asked for its own times.
    asked: bool,
}

impl ObRecord {
    fn new(ob: u16) -> Self {
        let histogram =
            || Histogram::new_with_bounds(1, LONGEST, 3).expect("constant bounds that hdrhistogram accepts");
        Self {
            ob,
            runs: 0,
            execution: histogram(),
            lateness: histogram(),
            longest: 0,
            latest: 0,
            last: None,
            waited: 0,
            current: None,
        }
    }

    /// A run has ended.
    pub(crate) fn ran(&mut self, run: Nanos, whole: Nanos) {
        self.runs += 1;
        (self.last, self.current) = (Some((run, whole)), None);
        self.longest = self.longest.max(run);
        self.execution.saturating_record(run.clamp(1, LONGEST));
    }

    /// A run begins so late.
    pub(crate) fn late(&mut self, by: Nanos) {
        self.waited = by;
        self.latest = self.latest.max(by);
        self.lateness.saturating_record(by.clamp(1, LONGEST));
    }

    /// A run begins.
    pub(crate) fn begin(&mut self, now: Nanos) {
        let requested = now.saturating_sub(std::mem::take(&mut self.waited));
        self.current = Some(Current { began: now, requested, paused: None, asked: false });
    }

    /// A higher class begins; others have had `inside` of the time before.
    pub(crate) fn pause(&mut self, now: Nanos, inside: Nanos) {
        if let Some(current) = &mut self.current {
            current.paused = Some((now, inside));
        }
    }

    /// The times SFC 78 tells. `inside`: the block is the running one, and others have had so much of its time. `own`: it asks for
    /// its own times, and gets those of the last run once.
    pub(crate) fn times(&mut self, now: Nanos, inside: Option<Nanos>, own: bool, into: &mut RunTimes) {
        let micros = |time: Nanos| u32::try_from(time / 1000).unwrap_or(u32::MAX >> 1);
        if let Some((run, whole)) = self.last {
            (into.last_run, into.last_whole) = (micros(run), micros(whole));
        }
        let Some(current) = &mut self.current else { return };
        if current.asked {
            (into.last_run, into.last_whole) = (u32::MAX, u32::MAX);
        }
        current.asked |= own;
        let (until, inside) = match (inside, current.paused) {
            (Some(inside), _) => (now, inside),
            (None, Some(paused)) => paused,
            (None, None) => (now, 0),
        };
        into.request = micros(current.requested) & (u32::MAX >> 1);
        into.current_whole = micros(now.saturating_sub(current.began));
        into.current_run = micros(until.saturating_sub(current.began).saturating_sub(inside));
    }

    pub(crate) fn reset(&mut self) {
        self.execution.reset();
        self.lateness.reset();
        (self.runs, self.longest, self.latest) = (0, 0, 0);
    }

    pub(crate) fn figures(&self, priority: u8, overruns: u64) -> ObStatistics {
        ObStatistics {
            ob: self.ob,
            priority,
            runs: self.runs,
            overruns,
            execution: distribution(&self.execution, self.longest),
            lateness: distribution(&self.lateness, self.latest),
        }
    }
}

/// The records of the loaded organization blocks, in ascending order.
#[derive(Debug)]
pub(crate) struct ObRecords {
    pub(crate) list: Box<[ObRecord]>,
    /// Number to place in `list`, +1; 0: not loaded.
    places: [u8; 128],
}

impl ObRecords {
    pub(crate) fn new(obs: impl Iterator<Item = u16>) -> Self {
        let mut numbers: Vec<u16> = obs.filter(|ob| *ob < 128).collect();
        numbers.sort_unstable();
        let mut places = [0; 128];
        for (place, ob) in (1..).zip(&numbers) {
            places[usize::from(*ob)] = place;
        }
        Self { list: numbers.into_iter().map(ObRecord::new).collect(), places }
    }

    #[inline]
    pub(crate) fn of(&mut self, ob: u16) -> Option<&mut ObRecord> {
        let place = usize::from(*self.places.get(usize::from(ob))?);
        self.list.get_mut(place.checked_sub(1)?)
    }

    /// A start-up begins: nothing is under way, and what SFC 78 knows of last runs is gone.
    pub(crate) fn restart(&mut self) {
        self.list.iter_mut().for_each(|record| (record.last, record.current) = (None, None));
    }

    pub(crate) fn reset(&mut self) {
        self.list.iter_mut().for_each(ObRecord::reset);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_by_number() {
        let mut records = ObRecords::new([35, 1, 121].into_iter());
        assert!(records.of(2).is_none() && records.of(500).is_none());
        let record = records.of(35).expect("loaded");
        record.ran(700, 900);
        record.late(50);
        let figures = records.list[1].figures(12, 3);
        assert_eq!((figures.ob, figures.runs, figures.overruns, figures.priority), (35, 1, 3, 12));
        assert_eq!((figures.execution.max, figures.lateness.max), (700, 50));
        records.reset();
        assert_eq!(records.list[1].figures(12, 0).runs, 0);
    }
}
