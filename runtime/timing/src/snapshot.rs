//! What the observer reports: versioned, and the same in the socket's answers and in reports.

use std::collections::BTreeMap;

use ob1_cpu::{BlockFigures, Flight, Histogram, ObFigures, ScanRecord};
use serde::{Deserialize, Serialize};

use super::cause::{Cause, Class, Evidence};

/// Version of the form: raised when a field changes its meaning or goes. Fields may be added.
pub const TIMING_SCHEMA: u32 = 2;

/// The accounts of every scan since the start or the last reset. Times in nanoseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Version of this form, [`TIMING_SCHEMA`].
    pub schema: u32,
    /// When this was read, by the runtime's clock.
    pub time_ns: u64,
    /// The time from which the figures count.
    pub since_ns: u64,
    /// The minimum cycle time; 0: none.
    pub min_cycle_ns: u64,
    /// What happens to a missed deadline: `now`, `skip`, `catch-up`.
    pub missed_rule: String,
    /// A scan that begins this long after its deadline is late.
    pub late_from_ns: u64,
    /// A scan that takes this long is late.
    pub long_from_ns: u64,
    /// Finished cycles in RUN.
    pub scans: u64,
    /// Statements executed in these cycles.
    pub statements: u64,
    /// Cycles that had not ended when the next was due.
    pub overruns: u64,
    /// Deadlines no cycle began for.
    pub missed: u64,
    /// Expiries of the watchdog.
    pub watchdogs: u64,
    /// From the start of a cycle to the start of the next.
    pub cycle: Spread,
    /// From the deadline of a cycle to its start, one value a cycle.
    pub wake: Spread,
    /// The same, with one more value for each missed deadline: the distribution does not leave out scans that never
    /// began.
    pub deadlines: Spread,
    /// From the start of a cycle to its end.
    pub execution: Spread,
    /// Back plane and process image before OB 1.
    pub inputs: Spread,
    /// Process image and back plane after OB 1.
    pub outputs: Spread,
    /// The exchange with links that read or write, as part of `inputs`: their writes, and the copy of what they watch.
    #[serde(default)]
    pub links: Spread,
    /// Each loaded organization block.
    pub obs: Vec<ObTiming>,
    /// Each block of a plugin.
    pub blocks: Vec<BlockTiming>,
    /// The late scans and their causes.
    pub late: LateReport,
}

/// A distribution. Values are known to within 0.4 %.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// How many values there are.
    pub count: u64,
    /// The least value; 0 without values.
    pub min_ns: u64,
    /// Mean, not rounded to whole nanoseconds.
    pub mean_ns: f64,
    /// Median: half of the values are at most this.
    pub p50_ns: u64,
    /// 90 % are at most this.
    pub p90_ns: u64,
    /// 99 % are at most this.
    pub p99_ns: u64,
    /// 99.9 % are at most this.
    pub p999_ns: u64,
    /// 99.99 % are at most this.
    pub p9999_ns: u64,
    /// The greatest value, exactly.
    pub max_ns: u64,
    /// Each bucket that holds something, ascending: its greatest value, and how many. Where they were asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub buckets: Vec<(u64, u64)>,
}

impl Spread {
    pub(super) fn new(histogram: &Histogram, buckets: bool) -> Self {
        let at = |quantile| histogram.quantile(quantile).nanos();
        Self {
            count: histogram.count(),
            min_ns: histogram.min().nanos(),
            mean_ns: histogram.mean(),
            p50_ns: at(0.5),
            p90_ns: at(0.9),
            p99_ns: at(0.99),
            p999_ns: at(0.999),
            p9999_ns: at(0.9999),
            max_ns: histogram.max().nanos(),
            buckets: if buckets {
                histogram.buckets().map(|(time, count)| (time.nanos(), count)).collect()
            } else {
                Vec::new()
            },
        }
    }
}

/// The figures of one organization block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObTiming {
    /// Number of the organization block.
    pub ob: u16,
    /// Priority class of the organization block.
    pub priority: u8,
    /// Completed runs of it.
    pub runs: u64,
    /// Requests lost, periods skipped, and requests that came while it was still being executed.
    pub overruns: u64,
    /// From start to end, without higher classes.
    pub execution: Spread,
    /// From the due time to the start.
    pub lateness: Spread,
}

impl ObTiming {
    pub(super) fn new(figures: &ObFigures, buckets: bool) -> Self {
        Self {
            ob: figures.ob,
            priority: figures.priority,
            runs: figures.runs,
            overruns: figures.overruns,
            execution: Spread::new(&figures.execution, buckets),
            lateness: Spread::new(&figures.lateness, buckets),
        }
    }
}

/// A block of a plugin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockTiming {
    /// Kind and number: `FC 0`.
    pub block: String,
    /// Name of the block, as the plugin gives it.
    pub name: String,
    /// Each call, without organization blocks and plugin blocks within it.
    pub execution: Spread,
}

impl BlockTiming {
    pub(super) fn new(figures: &BlockFigures, buckets: bool) -> Self {
        let (block, name) = (figures.block.to_string(), figures.name.to_string());
        Self { block, name, execution: Spread::new(&figures.execution, buckets) }
    }
}

/// The late scans by cause, and some of them one by one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LateReport {
    /// How many scans were late.
    pub scans: u64,
    /// Not explained yet: at most a tenth of a second old.
    pub pending: u64,
    /// Came too fast to be recorded.
    pub lost: u64,
    /// Share of those explained that remain unexplained, 0 to 1: the host is suspected.
    pub unexplained_share: f64,
    /// By class; those that occurred.
    pub classes: BTreeMap<Class, ClassTotal>,
    /// The longest delays, longest first.
    pub worst: Vec<LateEntry>,
    /// The newest, newest last.
    pub newest: Vec<LateEntry>,
    /// The newest of those that nothing explains, newest last.
    #[serde(default)]
    pub unexplained: Vec<LateEntry>,
}

/// The late scans of a class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClassTotal {
    /// How many late scans it has.
    pub scans: u64,
    /// Sum of their delays.
    pub time_ns: u64,
    /// The longest of their delays.
    pub worst_ns: u64,
}

/// A late scan with its cause.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LateEntry {
    /// Number of the scan, from 1.
    pub scan: u64,
    /// Its deadline, by the runtime's clock.
    pub planned_ns: u64,
    /// From its deadline to its start.
    pub lateness_ns: u64,
    /// From its start to its end.
    pub execution_ns: u64,
    /// The class of its cause.
    pub class: Class,
    /// What exactly, in words: a block, a process, a counter.
    pub what: String,
    /// How much of the delay that is.
    pub size_ns: u64,
    /// What the kernel counted.
    pub evidence: Evidence,
}

impl LateEntry {
    pub(super) fn new(record: &ScanRecord, evidence: &Evidence, cause: Cause) -> Self {
        Self {
            scan: record.scan,
            planned_ns: record.planned.nanos(),
            lateness_ns: record.lateness().nanos(),
            execution_ns: record.execution().nanos(),
            class: cause.class,
            what: cause.what,
            size_ns: cause.size.nanos(),
            evidence: *evidence,
        }
    }
}

/// The flight recorder, as it is asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recorder {
    /// Version of this form, [`TIMING_SCHEMA`].
    pub schema: u32,
    /// Flights frozen so far.
    pub frozen: u64,
    /// Overruns that came while a frozen flight had not been taken yet (at most 50 ms).
    pub not_frozen: u64,
    /// The flight with the longest delay at its end.
    pub worst: Option<FlightDump>,
    /// The flight that was frozen last.
    pub newest: Option<FlightDump>,
    /// The scans up to now.
    pub now: FlightDump,
}

/// Scans in their order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FlightDump {
    /// Oldest first; of a frozen flight the last one overran.
    pub scans: Vec<ScanDump>,
}

impl FlightDump {
    pub(super) fn new(flight: &Flight) -> Self {
        Self { scans: flight.scans.iter().map(ScanDump::new).collect() }
    }
}

/// One scan in the flight recorder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ScanDump {
    /// Number of the scan, from 1.
    pub scan: u64,
    /// Its deadline, by the runtime's clock.
    pub planned_ns: u64,
    /// From its deadline to its start.
    pub lateness_ns: u64,
    /// Of that, the scan before.
    pub carried_ns: u64,
    /// Of that, organization blocks between the two scans.
    pub between_ns: u64,
    /// From its start to its end.
    pub execution_ns: u64,
    /// Back plane and process image before OB 1.
    pub inputs_ns: u64,
    /// All organization blocks, plugins included.
    pub program_ns: u64,
    /// All blocks of plugins.
    pub plugins_ns: u64,
    /// Process image and back plane after OB 1.
    pub outputs_ns: u64,
    /// Statements executed in it.
    pub statements: u64,
    /// The organization block that took longest.
    pub longest_ob: u16,
    /// How long that block took.
    pub longest_ob_ns: u64,
    /// The plugin block with the longest call.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longest_plugin: Option<String>,
    /// How long that call took.
    pub longest_plugin_ns: u64,
    /// The block that ran when the scan had become long.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub long_in: Option<String>,
    /// Line of its source; 0: it has none.
    pub long_at_line: u32,
    /// Deadlines skipped after it.
    pub missed: u64,
    /// `late`, `long`, `overran`, `watchdog`.
    pub flags: Vec<String>,
}

impl ScanDump {
    fn new(record: &ScanRecord) -> Self {
        let flags = record.flags;
        let named = [
            (flags.began_late, "late"),
            (flags.took_long, "long"),
            (flags.overran, "overran"),
            (flags.watchdog, "watchdog"),
        ];
        Self {
            scan: record.scan,
            planned_ns: record.planned.nanos(),
            lateness_ns: record.lateness().nanos(),
            carried_ns: record.carried.nanos(),
            between_ns: record.between.nanos(),
            execution_ns: record.execution().nanos(),
            inputs_ns: record.inputs.nanos(),
            program_ns: record.program.nanos(),
            plugins_ns: record.plugins.nanos(),
            outputs_ns: record.outputs.nanos(),
            statements: record.statements,
            longest_ob: record.longest_ob,
            longest_ob_ns: record.longest_ob_time.nanos(),
            longest_plugin: record.longest_plugin.map(|block| block.to_string()),
            longest_plugin_ns: record.longest_plugin_time.nanos(),
            long_in: record.long_in.map(|block| block.to_string()),
            long_at_line: record.long_at_line,
            missed: record.missed,
            flags: named.into_iter().filter(|(set, _)| *set).map(|(_, name)| name.to_owned()).collect(),
        }
    }
}
