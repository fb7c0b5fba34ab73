//! The ledgers of the programs of the examples: DB 20 of the demo's stations, and similar ones.

use std::fmt;
use std::ops::Index;

use super::Guard;
use super::station::Running;

const A: &[&str] = &[
    "NUMBER",
    "CONFIRMED",
    "STARTED",
    "DONE",
    "ERROR",
    "ABORTED",
    "GOOD",
    "WRONG",
    "DOUBLED",
    "LATE",
    "LOST",
    "PAFE_SEND",
    "PAFE_RECEIVE",
    "SYNCS",
    "STATE",
];
const B: &[&str] = &[
    "RECEIVED",
    "STARTED",
    "DONE",
    "ERROR",
    "ABORTED",
    "BUSY",
    "TOO_LONG",
    "PAFE_SEND",
    "PAFE_RECEIVE",
    "SYNCS",
    "STATE",
];

/// A ledger, read between two scans.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Ledger {
    names: &'static [&'static str],
    values: Vec<i64>,
}

impl Ledger {
    /// The ledger of station A, which sends and compares.
    pub(crate) fn of_a(station: &Running) -> Self {
        Self::read(station, "DB20", A)
    }

    /// The ledger of station B, which sends back.
    pub(crate) fn of_b(station: &Running) -> Self {
        Self::read(station, "DB20", B)
    }

    /// These columns of a data block.
    pub(crate) fn read(station: &Running, db: &str, names: &'static [&'static str]) -> Self {
        let items: Vec<String> = names.iter().map(|name| format!("{db}.{name}")).collect();
        let items: Vec<&str> = items.iter().map(String::as_str).collect();
        Self { names, values: station.cells(&items) }
    }

    /// Number of echoes received by A's program, independent of the state of the telegram.
    pub(crate) fn echoes(&self) -> i64 {
        self["GOOD"] + self["LATE"] + self["DOUBLED"]
    }
}

impl Index<&str> for Ledger {
    type Output = i64;

    fn index(&self, name: &str) -> &i64 {
        let at = self.names.iter().position(|known| *known == name);
        &self.values[at.unwrap_or_else(|| panic!("no {name} in this ledger"))]
    }
}

impl fmt::Debug for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(self.names.iter().zip(&self.values)).finish()
    }
}

/// Waits until `more` telegrams have returned correctly.
pub(crate) fn flow(a: &Running, more: i64) {
    let good = a.cell("DB20.GOOD");
    a.until("telegrams flow", |a| (a.cell("DB20.GOOD") >= good + more).then_some(()));
}

/// Both are idle if neither ledger changes for this many scans: a telegram in a CP needs a few dozen to reach the
/// program.
const REST: u64 = 500;

/// Waits for the end of the last telegram and reads both ledgers. `pause(a, false)` continues.
pub(crate) fn rest(a: &Running, b: &Running) -> (Ledger, Ledger) {
    pause(a, true);
    let look = || (Ledger::of_a(a), Ledger::of_b(b));
    at_rest([a, b], look, |(of_a, of_b)| of_a["STATE"] == 0 && of_b["STATE"] == 0)
}

/// Waits until the result of `look` is idle for both stations and does not change any more.
pub(crate) fn at_rest<T: PartialEq + fmt::Debug>(
    stations: [&Running; 2],
    look: impl Fn() -> T,
    is_idle: impl Fn(&T) -> bool,
) -> T {
    let guard = Guard::begin();
    loop {
        let before = look();
        stations.iter().for_each(|station| station.scans(REST));
        let now = look();
        if is_idle(&now) && before == now {
            return now;
        }
        assert!(!guard.is_over(), "no rest: {now:?}");
    }
}

/// Sets whether A pauses, so that it sends no new telegrams.
pub(crate) fn pause(a: &Running, on: bool) {
    a.set("DB20.PAUSE", i64::from(on));
}
