//! The organization blocks as the scan knows them: their place in the accounts, and the times of their last run.

use std::sync::Arc;

use ob1_std::services::RunTimes;
use ob1_time::{Instant, Span};

use crate::accounts::{Accounts, ObAccount};

/// One loaded organization block.
#[derive(Debug)]
pub(crate) struct ObRecord {
    place: usize,
    accounts: Arc<Accounts>,
    /// Times of the last completed run: without and with the higher classes.
    last: Option<(Span, Span)>,
    /// How late the next run begins.
    waited: Span,
    current: Option<Current>,
}

/// A run under way.
#[derive(Clone, Copy, Debug)]
struct Current {
    began: Instant,
    requested: Instant,
    /// Set while a higher class runs: since when, and how long others had run before.
    paused: Option<(Instant, Span)>,
    /// It has requested its own times.
    asked: bool,
}

impl ObRecord {
    fn account(&self) -> &ObAccount {
        &self.accounts.obs[self.place]
    }

    /// A run has ended.
    pub(crate) fn ran(&mut self, run: Span, whole: Span) {
        (self.last, self.current) = (Some((run, whole)), None);
        self.account().runs.add(1);
        if !self.accounts.off {
            self.account().execution.record(run);
        }
    }

    /// The next run begins this late.
    pub(crate) fn late(&mut self, by: Span) {
        self.waited = by;
        if !self.accounts.off {
            self.account().lateness.record(by);
        }
    }

    /// The last completed run, with the higher classes; 0: none.
    pub(crate) fn last_whole(&self) -> Span {
        self.last.map_or(Span::ZERO, |(_, whole)| whole)
    }

    /// A run begins; it was requested as long ago as it waited.
    pub(crate) fn begin(&mut self, now: Instant) {
        let requested = now.saturating_sub(std::mem::take(&mut self.waited));
        self.current = Some(Current { began: now, requested, paused: None, asked: false });
    }

    /// A higher class begins; others have had `inside` of the time before.
    pub(crate) fn pause(&mut self, now: Instant, inside: Span) {
        if let Some(current) = &mut self.current {
            current.paused = Some((now, inside));
        }
    }

    /// The times for SFC 78. `inside`: the block is running, and others have used this much of its time. `own`: it asks
    /// for its own times, and gets those of the last run once.
    pub(crate) fn times(&mut self, now: Instant, inside: Option<Span>, own: bool, into: &mut RunTimes) {
        let micros = |time: Span| u32::try_from(time.micros()).unwrap_or(u32::MAX >> 1);
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
            (None, None) => (now, Span::ZERO),
        };
        into.request = micros(current.requested.since_start()) & (u32::MAX >> 1);
        into.current_whole = micros(now.since(current.began));
        into.current_run = micros(until.since(current.began).saturating_sub(inside));
    }
}

/// The loaded organization blocks, in ascending order.
#[derive(Debug)]
pub(crate) struct ObRecords {
    list: Box<[ObRecord]>,
    /// Number to place in `list`, +1; 0: not loaded.
    places: [u8; 128],
}

impl ObRecords {
    /// For the organization blocks that have an account.
    pub(crate) fn new(accounts: &Arc<Accounts>) -> Self {
        let mut places = [0; 128];
        for (place, account) in (1..).zip(&accounts.obs) {
            if let Some(entry) = places.get_mut(usize::from(account.ob)) {
                *entry = place;
            }
        }
        let record =
            |place| ObRecord { place, accounts: Arc::clone(accounts), last: None, waited: Span::ZERO, current: None };
        Self { list: (0..accounts.obs.len()).map(record).collect(), places }
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accounts::AccountsConfig;

    #[test]
    fn records_by_number() {
        let accounts =
            Arc::new(Accounts::new(&AccountsConfig::default(), Span::ZERO, &[1, 35, 121], std::iter::empty()));
        let mut records = ObRecords::new(&accounts);
        assert!(records.of(2).is_none() && records.of(500).is_none());
        let record = records.of(35).expect("loaded");
        let [run, whole, late] = [700, 900, 50].map(Span::from_nanos);
        record.ran(run, whole);
        record.late(late);
        assert_eq!((record.last, record.last_whole()), (Some((run, whole)), whole));
        let figures = &accounts.figures().obs[1];
        assert_eq!((figures.ob, figures.runs, figures.priority), (35, 1, 12));
        assert_eq!((figures.execution.max(), figures.lateness.max()), (run, late));
    }
}
