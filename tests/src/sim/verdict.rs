//! The rules that must hold after a run with any faults: checked with the ledgers in DB 20 of the stations' programs
//! (`examples/two-stations/README.md`) and with the counters of the drivers.

use std::fmt::{self, Write as _};

use ob1_cpu::OperatingState;
use ob1_time::Instant;

use super::driver::Driver;
use super::station::SimStation;

/// Station A's ledger, DB 20: byte and name.
const LEDGER_A: [(usize, &str); 11] = [
    (8, "started"),
    (12, "done"),
    (16, "error"),
    (20, "aborted"),
    (24, "good"),
    (28, "wrong"),
    (32, "doubled"),
    (36, "late"),
    (40, "lost"),
    (44, "pafe_send"),
    (48, "pafe_receive"),
];
const LEDGER_DB: u16 = 20;

/// Watches the ledger during the simulation, so that the log shows when something changed.
#[derive(Debug, Default)]
pub struct Watch {
    last: [u32; LEDGER_A.len()],
    /// The whole data block: most scans leave it alone.
    bytes: Vec<u8>,
    /// Time of the last good echo.
    pub last_good: Instant,
}

impl Watch {
    /// To be called after each cycle of a station.
    pub fn look(&mut self, now: Instant, station: &SimStation, log: &mut String) {
        let Some(ledger) = station.cpu.data_block(LEDGER_DB).filter(|ledger| **ledger != *self.bytes) else { return };
        if !is_a(station) {
            return;
        }
        self.bytes.clear();
        self.bytes.extend_from_slice(ledger);
        for ((byte, name), last) in LEDGER_A.into_iter().zip(&mut self.last) {
            let value = station.ledger(LEDGER_DB, byte);
            if value != *last {
                *last = value;
                if name == "good" {
                    self.last_good = now;
                }
                // Writing into a String cannot fail.
                let _ = writeln!(log, "{:>12} {} {name} {value}", now.micros(), station.name);
            }
        }
    }
}

fn is_a(station: &SimStation) -> bool {
    station.name.ends_with("-a")
}

/// The ledger at the end, and every violated rule.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verdict {
    /// Column and value.
    pub ledger: Vec<(&'static str, u64)>,
    /// The violated rules. Empty: passed.
    pub broken: Vec<String>,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, value) in &self.ledger {
            writeln!(f, "{name:>20} {value}")?;
        }
        for broken in &self.broken {
            writeln!(f, "BROKEN: {broken}")?;
        }
        Ok(())
    }
}

impl Verdict {
    /// A column of the ledger.
    #[must_use]
    pub fn get(&self, name: &str) -> u64 {
        self.ledger.iter().find(|(column, _)| *column == name).map_or(0, |(_, value)| *value)
    }

    fn must(&mut self, holds: bool, rule: impl FnOnce() -> String) {
        if !holds {
            self.broken.push(rule());
        }
    }
}

/// Checks a finished run.
#[must_use]
pub fn judge(stations: &[SimStation], drivers: &[Driver], undetectable: u64, kills: u64, watch: &Watch) -> Verdict {
    let mut verdict = Verdict::default();
    if let Some(a) = stations.iter().find(|s| is_a(s)) {
        verdict.ledger.extend(LEDGER_A.map(|(byte, name)| (name, u64::from(a.ledger(LEDGER_DB, byte)))));
    }
    let lost_in_cp: u64 = drivers.iter().map(|d| d.counters().open_orders()).sum();
    verdict.ledger.extend([("lost_in_cp", lost_in_cp), ("undetectable", undetectable), ("kills", kills)]);

    let [started, done, error, aborted] = ["started", "done", "error", "aborted"].map(|c| verdict.get(c));
    let ended = done + error + aborted;
    verdict.must(ended <= started && started <= ended + 1, || {
        format!("each order ends exactly once: {started} started, {ended} ended")
    });
    let (wrong, good) = (verdict.get("wrong"), verdict.get("good"));
    verdict.must(wrong <= undetectable, || {
        format!("{wrong} wrong telegrams, but the check character could have caught all but {undetectable}")
    });
    verdict.must(good > 0, || "no telegram came back".into());
    verdict.must(verdict.get("pafe_send") + verdict.get("pafe_receive") == 0, || "PAFE was not 0".into());
    if kills == 0 {
        verdict.must(aborted == 0, || format!("{aborted} orders aborted although no driver was killed"));
        // At the end one may still be in transit.
        verdict.must(lost_in_cp <= drivers.len() as u64, || {
            format!("{lost_in_cp} orders lost in a CP that was not killed")
        });
    }
    for station in stations {
        let statistics = station.cpu.statistics();
        let name = &station.name;
        verdict.must(station.cpu.state() == OperatingState::Run, || format!("{name} is not in RUN"));
        verdict.must(statistics.watchdogs == 0, || format!("{name}: the watchdog expired"));
    }
    let end = stations.iter().map(|s| s.due).max().unwrap_or(Instant::START);
    verdict.must(end.since(watch.last_good) < 3 * super::SECOND, || {
        format!("no good echo since {} ms, although nothing goes wrong any more", watch.last_good.millis())
    });
    verdict
}
