//! What is known of the timing of a running station.

use std::sync::Arc;

use ob1_cpu::{Accounts, CpuConfig, Figures, Flight, MissedCycle};
use ob1_rt::MonotonicClock;
use ob1_time::{Instant, Span};
use parking_lot::Mutex;

use super::cause::Class;
use super::ledger::Ledger;
use super::snapshot::{self, FlightDump, LateEntry, Recorder, Spread, TIMING_SCHEMA, Timing};
use super::text;

/// What is known of the timing of a running station. Copies share it.
#[derive(Clone, Debug)]
pub struct Timings {
    pub(super) accounts: Arc<Accounts>,
    pub(super) clock: MonotonicClock,
    min_cycle: Span,
    missed: MissedCycle,
    pub(super) state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
pub(super) struct State {
    /// The figures at the last reset, and when that was.
    before: Figures,
    since: Instant,
    pub(super) ledger: Ledger,
    /// Flights the recorder froze: the newest, and the one that ended in the longest delay.
    newest: Option<Flight>,
    worst: Option<Flight>,
    frozen: u64,
}

impl Timings {
    /// For a CPU with these accounts.
    pub fn new(accounts: Arc<Accounts>, config: &CpuConfig, clock: MonotonicClock) -> Self {
        let (min_cycle, missed) = (config.min_cycle, config.missed);
        Self { accounts, clock, min_cycle, missed, state: Arc::default() }
    }

    /// The minimum cycle time; zero: none.
    pub fn min_cycle(&self) -> Span {
        self.min_cycle
    }

    /// The figures since the start or the last reset.
    pub fn figures(&self) -> Figures {
        self.accounts.figures().since(&self.state.lock().before)
    }

    /// From here on everything is counted from 0. This does not disturb the scan.
    pub fn reset(&self) {
        let before = self.accounts.figures();
        *self.state.lock() = State { before, since: self.clock.time(), ..State::default() };
    }

    /// Everything that is known, with the buckets of all distributions or without.
    pub fn snapshot(&self, histograms: bool) -> Timing {
        let figures = self.figures();
        let (late_from, long_from) = self.accounts.thresholds();
        let state = self.state.lock();
        let spread = |histogram| Spread::new(histogram, histograms);
        Timing {
            schema: TIMING_SCHEMA,
            time_ns: self.clock.time().nanos(),
            since_ns: state.since.nanos(),
            min_cycle_ns: self.min_cycle.nanos(),
            missed_rule: rule(self.missed).into(),
            late_from_ns: late_from.nanos(),
            long_from_ns: long_from.nanos(),
            scans: figures.scans,
            statements: figures.statements,
            overruns: figures.overruns,
            missed: figures.missed,
            watchdogs: figures.watchdogs,
            cycle: spread(&figures.cycle),
            wake: spread(&figures.wake),
            deadlines: spread(&figures.deadlines),
            execution: spread(&figures.execution),
            inputs: spread(&figures.inputs),
            outputs: spread(&figures.outputs),
            links: spread(&figures.links),
            obs: figures.obs.iter().map(|ob| snapshot::ObTiming::new(ob, histograms)).collect(),
            blocks: figures.blocks.iter().map(|block| snapshot::BlockTiming::new(block, histograms)).collect(),
            late: state.ledger.report(figures.late),
        }
    }

    /// The flight recorder: the last scans, and the flights that overruns have frozen.
    pub fn recorder(&self) -> Recorder {
        let state = self.state.lock();
        let dump = |flight: &Option<Flight>| flight.as_ref().map(FlightDump::new);
        Recorder {
            schema: TIMING_SCHEMA,
            frozen: state.frozen,
            not_frozen: self.accounts.freezes_skipped(),
            worst: dump(&state.worst),
            newest: dump(&state.newest),
            now: FlightDump::new(&Flight { scans: self.accounts.flight() }),
        }
    }

    /// The late scans after this one, as far as they are kept and explained.
    pub fn late_after(&self, scan: u64) -> Vec<LateEntry> {
        self.state.lock().ledger.after(scan)
    }

    /// Why the scan was late in which the watchdog expired at this time; known a tenth of a second later.
    pub fn watchdog(&self, expired: Instant) -> Option<String> {
        self.state.lock().ledger.watchdog(expired).map(text::cause)
    }

    /// The class of what the scan with the expired cycle monitoring stood for.
    pub fn watchdog_class(&self, expired: Instant) -> Option<Class> {
        self.state.lock().ledger.watchdog(expired).map(|entry| entry.class)
    }

    /// Takes the flight that an overrun has frozen, if there is one.
    pub(super) fn keep_frozen(&self) {
        let Some(flight) = self.accounts.take_frozen() else { return };
        let delay = |flight: &Flight| flight.scans.last().map_or(Span::ZERO, |scan| scan.end.since(scan.planned));
        let mut state = self.state.lock();
        state.frozen += 1;
        if state.worst.as_ref().is_none_or(|worst| delay(&flight) > delay(worst)) {
            state.worst = Some(flight.clone());
        }
        state.newest = Some(flight);
    }
}

/// As in the station file.
const fn rule(missed: MissedCycle) -> &'static str {
    match missed {
        MissedCycle::Now => "now",
        MissedCycle::Skip => "skip",
        MissedCycle::CatchUp => "catch-up",
    }
}
