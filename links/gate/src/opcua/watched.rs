//! A watched value, its items, and when the library gets it.
//!
//! The library takes a value for an item when the item's sampling interval is over. It keeps a value that comes
//! earlier, but only until it publishes next. If the interval is not over then, it forgets the value: the client would
//! never get the last of several changes. So a value is handed over again as soon as the interval of a waiting item is
//! over, and a last time when all intervals are over. An item that has taken the value ignores it: it is no change.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use ob1_access::door::Refusal;
use ob1_access::{Piece, Typed};
use opcua_server::MonitoredItemHandle;
use opcua_types::NodeId;

use crate::opcua::limits;
use crate::opcua::nodes::node_id;

/// The library's clock is read a little later than ours, or earlier.
const MARGIN: Duration = Duration::from_millis(2);

/// All watched values, by identifier.
#[derive(Default)]
pub(crate) struct All {
    pub(crate) entries: HashMap<Arc<str>, Watched>,
    pub(crate) echoes: Echoes,
}

/// See [the module](self).
pub(crate) struct Watched {
    pub(crate) id: Arc<str>,
    pub(crate) node: NodeId,
    /// `None`: a fact about the CPU.
    pub(crate) typed: Option<Typed>,
    pub(crate) piece: Option<Piece>,
    pub(crate) handles: HashMap<MonitoredItemHandle, Rate>,
    pub(crate) next: Instant,
    pub(crate) last: Option<Result<Vec<u8>, Refusal>>,
    /// The place of its bytes in the merged pieces.
    pub(crate) place: Option<(usize, u32)>,
    /// When its value is handed over again.
    echo: Option<Instant>,
    /// When the intervals of all items are over.
    until: Instant,
}

/// An item of a value.
#[derive(Clone, Copy)]
pub(crate) struct Rate {
    pub(crate) every: Duration,
    pub(crate) on: bool,
    /// The single values kept for it.
    pub(crate) kept: usize,
    /// When the library has probably taken a value for it.
    taken: Instant,
    /// The newest value came too early for it.
    waits: bool,
}

impl Rate {
    pub(crate) fn new(every: f64, on: bool, kept: usize) -> Self {
        Self { every: interval(every), on, kept, taken: Instant::now(), waits: false }
    }

    /// When its sampling interval is over.
    fn due(&self) -> Instant {
        self.taken + self.every
    }
}

/// A requested sampling interval in milliseconds, within the limits.
pub(crate) fn interval(ms: f64) -> Duration {
    // Negative: as often as the publishing interval; the server then samples as often as allowed.
    Duration::from_secs_f64(if ms.is_finite() {
        ms.clamp(limits::SAMPLING_MS, limits::SLOWEST_MS) / 1000.0
    } else {
        1.0
    })
}

impl Watched {
    pub(crate) fn new(id: &Arc<str>, typed: Option<&Typed>, piece: Option<Piece>) -> Self {
        let now = Instant::now();
        Self {
            id: Arc::clone(id),
            node: node_id(id),
            typed: typed.cloned(),
            piece,
            handles: HashMap::new(),
            next: now,
            last: None,
            place: None,
            echo: None,
            until: now,
        }
    }

    /// The shortest requested interval; `None` without an active item.
    pub(crate) fn every(&self) -> Option<Duration> {
        self.handles.values().filter(|rate| rate.on).map(|rate| rate.every).min()
    }

    /// Whether it may be published now; its next turn is then one interval later. Up to half an interval early counts
    /// as in time, because changes and readings have different clocks; over many turns the interval is kept all the
    /// same.
    pub(crate) fn turn(&mut self, now: Instant) -> bool {
        let Some(every) = self.every().filter(|every| self.next <= now + *every / 2) else { return false };
        self.next = self.next.max(now) + every;
        true
    }

    /// Its value has been handed over: when it is to be handed over again.
    fn handed(&mut self, now: Instant) -> Instant {
        self.until = now;
        for rate in self.handles.values_mut().filter(|rate| rate.on) {
            self.until = self.until.max(now + rate.every);
            rate.waits = rate.due() > now;
            if !rate.waits {
                rate.taken = now;
            }
        }
        self.next_echo()
    }

    /// The same value has been handed over again: when once more, if so.
    fn again(&mut self, now: Instant) -> Option<Instant> {
        for rate in self.handles.values_mut().filter(|rate| rate.waits && rate.due() <= now) {
            (rate.taken, rate.waits) = (rate.due(), false);
        }
        Some(self.next_echo()).filter(|next| *next > now)
    }

    /// When the interval of the first waiting item is over, else when all are.
    fn next_echo(&self) -> Instant {
        let first = self.handles.values().filter(|rate| rate.on && rate.waits).map(Rate::due).min();
        first.unwrap_or(self.until) + MARGIN
    }
}

/// The values that are to be handed over again, the next one first.
#[derive(Default)]
pub(crate) struct Echoes(BTreeSet<(Instant, Arc<str>)>);

impl Echoes {
    /// A value has been handed over.
    pub(crate) fn handed(&mut self, entry: &mut Watched, now: Instant) {
        let at = entry.handed(now);
        self.set(entry, Some(at));
    }

    /// A value is no longer watched.
    pub(crate) fn forget(&mut self, entry: &mut Watched) {
        self.set(entry, None);
    }

    fn set(&mut self, entry: &mut Watched, at: Option<Instant>) {
        if let Some(before) = entry.echo.take() {
            self.0.remove(&(before, Arc::clone(&entry.id)));
        }
        entry.echo = at;
        self.0.extend(at.map(|at| (at, Arc::clone(&entry.id))));
    }

    /// Calls `hand` with each value whose time has come.
    pub(crate) fn due(
        &mut self,
        watched: &mut HashMap<Arc<str>, Watched>,
        now: Instant,
        mut hand: impl FnMut(&Watched),
    ) {
        while self.0.first().is_some_and(|(at, _)| *at <= now) {
            let Some((_, id)) = self.0.pop_first() else { return };
            let Some(entry) = watched.get_mut(&id) else { continue };
            hand(entry);
            let next = entry.again(now);
            self.set(entry, next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn handle(number: u32) -> MonitoredItemHandle {
        MonitoredItemHandle { subscription_id: 1, monitored_item_id: number }
    }

    /// A value with items of these intervals, and when the library took the first value for them.
    fn watched(intervals: &[f64]) -> (HashMap<Arc<str>, Watched>, Instant) {
        let id = Arc::from("MW10");
        let mut entry = Watched::new(&id, None, None);
        let now = Instant::now();
        for (number, every) in (1..).zip(intervals) {
            let rate = Rate { taken: now, ..Rate::new(*every, true, 1) };
            entry.handles.insert(handle(number), rate);
        }
        (HashMap::from([(id, entry)]), now)
    }

    /// When a value that was handed over so many milliseconds after the first is handed over again.
    fn echoes(intervals: &[f64], handed: &[u32]) -> Vec<u128> {
        let (mut all, begin) = watched(intervals);
        let mut echoes = Echoes::default();
        for ms in handed {
            echoes.handed(all.get_mut("MW10").expect("watched"), begin + MS * *ms);
        }
        let mut times = Vec::new();
        for ms in 0..5_000 {
            echoes.due(&mut all, begin + MS * ms, |_| times.push(u128::from(ms)));
        }
        assert!(echoes.0.is_empty());
        times
    }

    #[test]
    fn a_value_that_comes_too_early_for_an_item_is_handed_over_again() {
        for (intervals, handed, again) in [
            // In time: once more at the end, whatever the library's clock says.
            (&[500.0][..], &[600][..], &[1102][..]),
            // Too early by 400 ms.
            (&[500.0], &[100], &[502, 602]),
            // The second one came too early.
            (&[500.0], &[600, 700], &[1102, 1202]),
            // For the slower item.
            (&[100.0, 1000.0], &[300], &[1002, 1302]),
            (&[100.0, 1000.0], &[50], &[102, 1002, 1052]),
        ] {
            assert_eq!(echoes(intervals, handed), again, "{intervals:?} {handed:?}");
        }
    }

    #[test]
    fn what_is_no_longer_watched_is_not_handed_over() {
        let (mut all, begin) = watched(&[500.0]);
        let mut echoes = Echoes::default();
        let entry = all.get_mut("MW10").expect("watched");
        echoes.handed(entry, begin);
        echoes.forget(entry);
        assert!(echoes.0.is_empty());
    }
}
