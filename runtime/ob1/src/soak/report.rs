//! The report of a soak: the checkpoints of each minute and the last report have the same form.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::load::LoadReport;
use super::verdict::{Ended, Finding, Verdict};
use crate::statistics::{PERCENTILES, Percentile, Shift, Slope, percentile};
use ob1_station::access::protocol::{Diagnostic, GrantStatus, ModuleStatus};
use ob1_timing::snapshot::{Spread, Timing};

/// Version of the form: raised when a field changes its meaning or goes. Fields may be added.
pub const SOAK_SCHEMA: u32 = 1;

/// A soak, finished or under way.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of this form, [`SOAK_SCHEMA`].
    pub schema: u32,
    /// Version of the `ob1` that has measured.
    pub version: String,
    /// Name of the station.
    pub station: String,
    /// Name of the machine; empty in a report of many.
    #[serde(default)]
    pub host: String,
    /// The machines of a report that was merged of theirs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub machines: Vec<Machine>,
    /// When it began, in seconds since 1970.
    pub began_unix_s: u64,
    /// How long was wanted.
    pub wanted_ns: u64,
    /// Time in RUN before the measurement began.
    pub warm_up_ns: u64,
    /// How long has been measured.
    pub measured_ns: u64,
    /// Length of an interval of the time series.
    pub interval_ns: u64,
    /// How it ended, or that it is under way.
    pub ended: Ended,
    /// More about an end that nobody wanted.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub end: String,
    /// Somebody else has reset the statistics meanwhile: the figures are not those of all scans.
    #[serde(default)]
    pub reset_outside: bool,
    /// The verdict of all findings.
    pub verdict: Verdict,
    /// What was judged, in the order of the budget.
    pub findings: Vec<Finding>,
    /// What the station was put under.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load: Option<LoadReport>,
    /// Percentiles of all distributions.
    pub percentiles: Vec<Percentiles>,
    /// Growth of the series an hour: nanoseconds, bytes or counts.
    pub slopes: Vec<NamedSlope>,
    /// What each CP has counted.
    pub telegrams: Vec<CpLedger>,
    /// Cells of the program.
    pub cells: Vec<CellLedger>,
    /// What the operating system granted.
    pub posture: Vec<GrantStatus>,
    /// The diagnostic buffer, newest first.
    pub diagnostics: Vec<Diagnostic>,
    /// The time series: an interval after the other, without gaps.
    pub intervals: Vec<Interval>,
    /// The accounts of all scans that were measured, with the buckets of all distributions; none before the first
    /// reading.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<Timing>,
}

/// A machine of a merged report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Its name, or that of its report where names are not unique.
    pub name: String,
    /// Finished cycles.
    pub scans: u64,
    /// How many of them were late.
    pub late: u64,
    /// Deadlines missed.
    pub missed: u64,
    /// The verdict on it alone.
    pub verdict: Verdict,
    /// What it broke alone: the limits with what was measured.
    pub broken: Vec<String>,
    /// Growth of its series an hour.
    pub slopes: Vec<NamedSlope>,
    /// Each series beside the machine in the middle.
    pub beside: Vec<Beside>,
}

/// A series of a machine beside that of the others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beside {
    /// As in a budget.
    pub series: String,
    /// The median of its intervals, in nanoseconds.
    pub median_ns: f64,
    /// How it differs from the machine in the middle; none with too few intervals.
    pub shift: Option<Shift>,
    /// How far it lies from the median of the machines, in units of their spread; none with less than 5 machines.
    pub score: Option<f64>,
}

/// The percentiles of a distribution.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Its name, as in a budget.
    pub name: String,
    /// How many values the distribution has.
    pub count: u64,
    /// The greatest, in nanoseconds.
    pub max_ns: u64,
    /// The percentiles `p50` to `p99.999`, by these names.
    pub values: Vec<(String, Percentile)>,
}

/// The growth of a series.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedSlope {
    /// As in a budget, without `.slope`.
    pub series: String,
    /// Values are times, in nanoseconds.
    pub is_time: bool,
    /// Growth an hour; none with too few intervals.
    pub slope: Option<Slope>,
}

/// What a CP has counted since the measurement began.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CpLedger {
    /// Name of the CP's module.
    pub cp: String,
    /// Send orders taken over.
    pub accepted: u64,
    /// Done: the protocol's last acknowledgement has arrived.
    pub done: u64,
    /// Ended with an error.
    pub error: u64,
    /// Dropped by a reset of the CP.
    pub aborted: u64,
    /// Lay in the buffers of a driver that died.
    pub lost: u64,
    /// Telegrams of the partner received.
    pub received: u64,
    /// Handed over to the CPU.
    pub delivered: u64,
    /// Received and lost with a driver that died, or dropped by a reset.
    pub receive_lost: u64,
    /// Attempts of the partner that failed.
    pub receive_errors: u64,
    /// Driver processes that ended without being asked to.
    pub drivers_lost: u64,
}

/// A cell of the program, a counter of its own such as `DB20.WRONG`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CellLedger {
    /// Name of the cell, as the budget writes it.
    pub name: String,
    /// What its value stands for.
    #[serde(default)]
    pub role: Role,
    /// When the measurement began.
    pub first: f64,
    /// At the last reading.
    pub last: f64,
}

impl CpLedger {
    /// Takes over what the CP of that name has counted on another machine.
    pub(super) fn merge(&mut self, other: &Self) {
        let fields: [fn(&mut Self) -> &mut u64; 10] = [
            |cp| &mut cp.accepted,
            |cp| &mut cp.done,
            |cp| &mut cp.error,
            |cp| &mut cp.aborted,
            |cp| &mut cp.lost,
            |cp| &mut cp.received,
            |cp| &mut cp.delivered,
            |cp| &mut cp.receive_lost,
            |cp| &mut cp.receive_errors,
            |cp| &mut cp.drivers_lost,
        ];
        let mut other = other.clone();
        for field in fields {
            *field(self) = field(self).saturating_add(*field(&mut other));
        }
    }

    /// Orders that have no end so far.
    pub fn open(&self) -> u64 {
        self.accepted.saturating_sub(self.done + self.error + self.aborted + self.lost)
    }

    /// What a CP's module has counted from one reading to another.
    pub(super) fn between(first: &ModuleStatus, last: &ModuleStatus) -> Self {
        let counted = |name: &str| {
            let of = |module: &ModuleStatus| module.counters.get(name).copied().unwrap_or(0);
            of(last).saturating_sub(of(first))
        };
        let losses = |module: &ModuleStatus| module.driver.as_ref().map_or(0, |driver| u64::from(driver.losses));
        Self {
            cp: last.name.clone(),
            accepted: counted("orders_accepted"),
            done: counted("telegrams_sent"),
            error: counted("send_errors"),
            aborted: counted("orders_aborted"),
            lost: counted("orders_lost"),
            received: counted("telegrams_received"),
            delivered: counted("telegrams_delivered"),
            receive_lost: counted("receive_lost") + counted("receive_aborted"),
            receive_errors: counted("receive_errors"),
            drivers_lost: losses(last).saturating_sub(losses(first)),
        }
    }
}

/// What a cell of the program counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Something of its own.
    #[default]
    Own,
    /// Telegrams that arrived twice.
    Doubled,
    /// Telegrams that arrived with another content.
    Wrong,
}

impl CellLedger {
    /// How much it has grown.
    pub fn grown(&self) -> f64 {
        self.last - self.first
    }
}

/// One interval of the time series.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Interval {
    /// Its end, from the beginning of the measurement.
    pub end_ns: u64,
    /// Scans that ended in the interval.
    pub scans: u64,
    /// How many of them were late.
    pub late: u64,
    /// Deadlines missed in the interval.
    pub missed: u64,
    /// Cycle time: from one start to the next.
    pub cycle: Brief,
    /// Wake-up: from the deadline to the start.
    pub wake: Brief,
    /// Execution: from the start to the end.
    pub execution: Brief,
    /// Resident memory of the station's process.
    pub rss_bytes: u64,
    /// Open file descriptors of the station's process.
    pub fds: u64,
    /// Resident memory of the drivers.
    pub drivers_rss_bytes: u64,
    /// Telegrams done by all CPs in the interval.
    pub done: u64,
}

/// A distribution within an interval, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Brief {
    /// Median: half of the values are at most this.
    pub p50_ns: u64,
    /// 99 % are at most this.
    pub p99_ns: u64,
    /// The greatest value of the interval.
    pub max_ns: u64,
}

impl Report {
    /// Reads a report from its file, and checks its version.
    ///
    /// # Errors
    /// What is wrong with the file, in one sentence.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = ob1_process::files::read_text(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let report: Self = serde_json::from_str(&text)
            .map_err(|e| format!("{} is not a report of `ob1 soak`: {e}", path.display()))?;
        if report.schema != SOAK_SCHEMA {
            let schema = report.schema;
            return Err(format!("{} has schema {schema}; this ob1 reads {SOAK_SCHEMA}", path.display()));
        }
        Ok(report)
    }

    /// The distribution of that name, as in a budget.
    pub fn distribution(&self, name: &str) -> Option<&Spread> {
        distributions(self.timing.as_ref()?).into_iter().find(|(known, _)| known == name).map(|(_, spread)| spread)
    }

    /// The values of a series over time: hours and values.
    pub fn series(&self, name: &str) -> Vec<(f64, f64)> {
        let value = |i: &Interval| match name {
            "rss" => i.rss_bytes,
            "fds" => i.fds,
            "drivers.rss" => i.drivers_rss_bytes,
            "cycle.p50" => i.cycle.p50_ns,
            "cycle.p99" => i.cycle.p99_ns,
            "wake.p50" => i.wake.p50_ns,
            "wake.p99" => i.wake.p99_ns,
            "execution.p50" => i.execution.p50_ns,
            _ => i.execution.p99_ns,
        };
        self.intervals.iter().map(|i| (i.end_ns as f64 / 3.6e12, value(i) as f64)).collect()
    }
}

/// All distributions that hold something, by their names in a budget.
pub(super) fn distributions(timing: &Timing) -> Vec<(String, &Spread)> {
    let mut all = vec![
        ("cycle".to_owned(), &timing.cycle),
        ("wake".to_owned(), &timing.wake),
        ("deadlines".to_owned(), &timing.deadlines),
        ("execution".to_owned(), &timing.execution),
        ("inputs".to_owned(), &timing.inputs),
        ("outputs".to_owned(), &timing.outputs),
        ("links".to_owned(), &timing.links),
    ];
    for ob in &timing.obs {
        all.push((format!("ob{}", ob.ob), &ob.execution));
        all.push((format!("ob{}.late", ob.ob), &ob.lateness));
    }
    for block in &timing.blocks {
        all.push((block.block.replace(' ', "").to_lowercase(), &block.execution));
    }
    all.retain(|(_, spread)| spread.count > 0);
    all
}

/// The percentiles of all distributions.
pub(super) fn percentiles(timing: &Timing) -> Vec<Percentiles> {
    let of = |spread: &Spread| {
        PERCENTILES.iter().map(|(name, share)| ((*name).to_owned(), percentile(&spread.buckets, *share))).collect()
    };
    let all = distributions(timing).into_iter();
    all.map(|(name, s)| Percentiles { name, count: s.count, max_ns: s.max_ns, values: of(s) }).collect()
}
