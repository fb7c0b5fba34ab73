//! The socket's language: one JSON object a line, each way. Documented for other programs in `docs/access.md`.

use std::collections::BTreeMap;

use ob1_access::alarms::StandingAlarm;
use ob1_model::Command;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::debug::{DebugStatus, DebugWanted};
use super::pass::{PassStatus, PassWanted};
use super::why::{WhyStatus, WhyWanted};
use crate::download::{LoadOrder, LoadStatus};
use ob1_timing::{Recorder, Timing};

pub use super::links::{LinkStatus, Listens};

/// Longest line accepted, in bytes.
pub const LINE_BYTES: usize = 64 * 1024;

/// A request: one line of JSON.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Request {
    /// Comes back with the answer.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub id: Value,
    /// What is asked, and with which words.
    #[serde(flatten)]
    pub op: Op,
}

/// What can be asked of a station.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(tag = "op", rename_all = "snake_case")]
pub enum Op {
    /// Values of cells, all of one cycle control point.
    Get {
        /// Names of cells, symbolic or absolute.
        items: Vec<String>,
    },
    /// New values for cells.
    Set {
        /// New values, by the names of the cells.
        items: BTreeMap<String, Value>,
    },
    /// A change of the operating state.
    Command {
        /// The change, by its word.
        #[serde(with = "super::commands")]
        command: Command,
    },
    /// State, scan statistics, modules.
    Status,
    /// The newest entries of the diagnostic buffers.
    Diag {
        /// At most so many of each.
        #[serde(default = "default_count")]
        count: u32,
    },
    /// Restarts the scan statistics.
    ResetStatistics,
    /// The accounts of every scan.
    Timing {
        /// With the buckets of all distributions.
        #[serde(default)]
        histograms: bool,
    },
    /// The flight recorder: the last scans, and frozen flights.
    Recorder,
    /// The buses with their couplers and slaves.
    Buses,
    /// The links with their connections.
    Links,
    /// Program status: one pass through a block.
    Pass(PassWanted),
    /// Why a bit has its value, or a block is not called.
    Why(WhyWanted),
    /// Breakpoints and single step.
    Debug(DebugWanted),
    /// Tells what is forced, after these cells were added.
    Force {
        /// Values to force, by the names of the cells.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        items: BTreeMap<String, Value>,
        /// All forcing ends first.
        #[serde(default)]
        off: bool,
    },
    /// The alarms that are active or not acknowledged; or acknowledges some.
    Alarms {
        /// Message numbers to acknowledge; none: which alarms there are is told.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        acknowledge: Vec<u32>,
    },
    /// Changes the program to what its sources say now, or back.
    Load(LoadOrder),
}

fn default_count() -> u32 {
    20
}

/// An answer: one line of JSON.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Response {
    /// The `id` of the request.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub id: Value,
    /// False: refused, see `error`.
    pub ok: bool,
    /// Why it was refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Answer to `get`, in the order of the request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub values: Option<Vec<CellValue>>,
    /// Answer to `status`: state, statistics, modules.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<Status>,
    /// Answer to `diag`, newest first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diagnostics: Option<Vec<Diagnostic>>,
    /// Answer to `diag`: CPs with a diagnostic buffer of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cps: Option<Vec<CpBuffer>>,
    /// Answer to `timing`: the accounts of all scans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<Box<Timing>>,
    /// Answer to `recorder`: the flights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorder: Option<Box<Recorder>>,
    /// Answer to `buses`, with couplers and slaves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub buses: Option<Vec<BusStatus>>,
    /// Answer to `links`, with their connections.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<Vec<LinkStatus>>,
    /// Answer to `pass`: one pass through a block.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pass: Option<Box<PassStatus>>,
    /// Answer to `why`: statements that decide a bit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<Box<WhyStatus>>,
    /// Answer to `debug`: where the CPU holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub debug: Option<Box<DebugStatus>>,
    /// Answer to `force`: `QW4=16#00FF`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forced: Option<Vec<String>>,
    /// Answer to `alarms`, the most urgent first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alarms: Option<Vec<StandingAlarm>>,
    /// Answer to `alarms` with numbers to acknowledge: those that do not exist.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missing: Option<Vec<u32>>,
    /// Answer to `load`: what has changed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<Box<LoadStatus>>,
}

impl Response {
    /// Done, with nothing more to say.
    #[must_use]
    pub fn done(id: Value) -> Self {
        Self { id, ok: true, ..Self::default() }
    }

    /// The answer to a refused request, with the reason.
    #[must_use]
    pub fn refused(id: Value, error: impl Into<String>) -> Self {
        Self { id, error: Some(error.into()), ..Self::default() }
    }
}

/// A bus and its process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(default)]
pub struct BusStatus {
    /// Name of the bus in the station file.
    pub name: String,
    /// `modbus-tcp`, `modbus-rtu` or `dp`.
    pub kind: String,
    /// What its lines are called where they are listened to.
    pub lines: Vec<String>,
    /// Its process; 0: none.
    pub pid: u32,
    /// Times a process was started.
    pub starts: u32,
    /// Times one was lost.
    pub losses: u32,
    /// State of the process: `ready` when it exchanges.
    pub process: String,
    /// The scan drives the outputs.
    pub driven: bool,
    /// Its couplers and slaves.
    pub stations: Vec<BusStationStatus>,
}

/// A coupler or a DP slave.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(default)]
pub struct BusStationStatus {
    /// Name of the coupler or slave in the station file.
    pub name: String,
    /// Its unit, address, or place on the bus.
    pub number: u8,
    /// Its diagnostic address; 0: it has none.
    pub diagnostic: u16,
    /// `starting`, `exchange`, `lost`, `refuses`.
    pub state: String,
    /// What it refuses or reports, in words; empty: nothing.
    pub says: String,
    /// Completed rounds of exchange.
    pub exchanges: u64,
    /// Requests without an answer that can be used.
    pub failures: u64,
    /// Answers that were exceptions.
    pub exceptions: u64,
    /// Times it was lost.
    pub losses: u64,
    /// Duration of the last round.
    pub round_ns: u64,
    /// Its inputs, as it has sensed them.
    pub inputs: Vec<Piece>,
    /// Its outputs, as the program drives them.
    pub outputs: Vec<Piece>,
}

/// Bytes in a row.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(default)]
pub struct Piece {
    /// First of them in the process image, or beyond it.
    pub address: u32,
    /// Two digits a byte.
    pub hex: String,
}

/// The value of a cell.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct CellValue {
    /// Its name, as requested.
    pub item: String,
    /// S7 type by which it was read.
    #[serde(rename = "type")]
    pub type_name: String,
    /// A boolean for a bit, a number, or what the type has in JSON.
    pub value: Value,
    /// The bits in hexadecimal.
    pub hex: String,
    /// As STL writes it: `S5T#1S500MS`, `'ABC'`.
    #[serde(default)]
    pub text: String,
}

/// A running station. Also the station part of a report.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Status {
    /// Name of the station.
    pub station: String,
    /// Process id of the runtime.
    pub pid: u32,
    /// Operating state: `STOP`, `STARTUP`, `RUN`.
    pub state: String,
    /// Version of the runtime.
    #[serde(default)]
    pub version: String,
    /// Fingerprint of the program that runs now: the same program has the same, wherever it runs.
    #[serde(default)]
    pub program: String,
    /// Where others reach it: its links that listen.
    #[serde(default)]
    pub listens: Vec<Listens>,
    /// The minimum cycle time; 0: none.
    #[serde(default)]
    pub min_cycle_ns: u64,
    /// Nanoseconds since the runtime started.
    pub runtime_ns: u64,
    /// Finished cycles in RUN since the start or the last reset of the statistics.
    pub scans: u64,
    /// Statements executed in these cycles.
    pub statements: u64,
    /// The engine that runs the program now.
    #[serde(default)]
    pub engine: String,
    /// Why that is not the engine that was asked for, if it is not and none comes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub engine_lacks: Option<String>,
    /// Seconds since a cycle began that does not end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stands_s: Option<u64>,
    /// Cycles that began late because the one before took too long.
    pub overruns: u64,
    /// Deadlines no cycle began for.
    pub missed: u64,
    /// Scans that began late or took long; `timing` says why.
    pub late: u64,
    /// Expiries of the cycle watchdog.
    pub watchdogs: u64,
    /// From the start of a cycle to the start of the next.
    pub cycle: Times,
    /// From the deadline of a cycle to its start.
    pub wake: Times,
    /// From the start of a cycle to its end.
    pub execution: Times,
    /// In the order of the station file.
    pub modules: Vec<ModuleStatus>,
    /// What was asked of the operating system.
    pub posture: Vec<GrantStatus>,
    /// State of the writing of retentive memory, where it is wanted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retentive: Option<RetentiveStatus>,
    /// Memory of the process.
    pub memory: MemoryStatus,
    /// Log lines of the runtime that nobody got: its stderr was full, slow or gone.
    #[serde(default)]
    pub log_lost: u64,
    /// What is forced: `QW4=16#00FF`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub forced: Vec<String>,
    /// Blocks that were downloaded or deleted and differ from the sources.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub downloads: Vec<Download>,
    /// Why they will be lost when the station ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub downloads_not_kept: Option<String>,
}

/// A distribution of times, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Times {
    /// How many values there are.
    pub count: u64,
    /// The shortest of them.
    pub min_ns: u64,
    /// Mean, not rounded to whole nanoseconds.
    pub mean_ns: f64,
    /// Median: half of the values are at most this.
    pub p50_ns: u64,
    /// 99 % are at most this.
    pub p99_ns: u64,
    /// 99.9 % are at most this.
    pub p999_ns: u64,
    /// The longest of them.
    pub max_ns: u64,
}

/// A module of the station.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct ModuleStatus {
    /// Name of the module in the station file.
    pub name: String,
    /// Its type, as in the station file.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Logical address of its first input byte, or output byte if it has no inputs.
    pub address: u32,
    /// Process inputs: first byte and how many.
    #[serde(default)]
    pub inputs: [u32; 2],
    /// Process outputs: first byte and how many.
    #[serde(default)]
    pub outputs: [u32; 2],
    /// Whether its channels are words; of a coupler it is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub analog: Option<bool>,
    /// True while its driver answers.
    pub present: bool,
    /// LEDs that are lit, by name.
    pub leds: Vec<String>,
    /// Its driver process, for a CP.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<DriverStatus>,
    /// Its counters by name (docs/backplane.md).
    pub counters: BTreeMap<String, u64>,
    /// Where the time of its orders and telegrams goes; empty if its driver does not say it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<super::stage::StageStatus>,
    /// Why nothing happens at a CP, or what has failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<ReasonStatus>,
}

/// What a CP waits for, or what has failed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct ReasonStatus {
    /// Which reason, as one word (docs/access.md).
    pub why: String,
    /// What it is about: an end of an order, an event, a parameter byte, an error number of the system.
    pub number: u32,
    /// How often; 0 for what does not count.
    pub count: u32,
    /// Seconds since it began, or since the last time; none where the CP does not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_s: Option<u64>,
    /// The reason in words.
    pub text: String,
    /// What helps; may be empty.
    pub remedy: String,
}

/// The driver process of a module.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct DriverStatus {
    /// Its process, 0 while there is none.
    pub pid: u32,
    /// Processes that have come up.
    pub starts: u32,
    /// Processes that ended without being asked to.
    pub losses: u32,
    /// What it says: `ready`, `starting`, `no parameters`, `parameter error 5`, `line error 2`, `absent`.
    pub state: String,
}

/// What became of a request to the operating system.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct GrantStatus {
    /// What was requested of the system.
    pub what: String,
    /// `granted`, `partly` or `refused`.
    pub outcome: String,
    /// More, when it was not granted as requested.
    pub detail: String,
    /// What would grant it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

/// State of the writing of retentive memory.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct RetentiveStatus {
    /// The newest generation written by this runtime.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub generation: Option<u64>,
    /// Nanoseconds since the disk last held what memory held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_ns: Option<u64>,
    /// Why it cannot be written, while it cannot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// Memory of the process, in KiB.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct MemoryStatus {
    /// Resident memory of the process.
    pub resident_kib: u64,
    /// Highest resident so far.
    pub peak_kib: u64,
    /// Memory that is locked.
    pub locked_kib: u64,
    /// Number of threads of the process.
    pub threads: u64,
}

/// The diagnostic buffer of a CP: its own (CP 340, CP 341), or what ob1 lists of it (CP 240, CP 040).
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct CpBuffer {
    /// Name of the CP's module.
    pub name: String,
    /// Its type, as in the station file.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Logical base address of the CP.
    pub address: u32,
    /// What its driver says: as `state` in `status`.
    pub driver: String,
    /// Why the CP does nothing, as in `status`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<ReasonStatus>,
    /// Its entries, newest first.
    pub entries: Vec<CpEntry>,
}

/// An entry of the diagnostic buffer of a CP.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct CpEntry {
    /// When, in milliseconds since the runtime started.
    pub time_ms: u64,
    /// When, in nanoseconds since 1970, UTC, by the clock as it is set now.
    #[serde(default)]
    pub unix_ns: u64,
    /// Event class and number, `0703h`.
    pub number: String,
    /// True: the event has come; false: it has gone.
    pub incoming: bool,
    /// The event in words.
    pub text: String,
    /// What helps; empty for mere information.
    pub remedy: String,
}

/// An entry of the diagnostic buffer.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Diagnostic {
    /// Counts all entries, from 1.
    pub number: u64,
    /// When, in nanoseconds since the runtime started.
    pub time_ns: u64,
    /// When, in nanoseconds since 1970, UTC, by the clock as it is set now.
    #[serde(default)]
    pub unix_ns: u64,
    /// The event number, `4302h`.
    pub event: String,
    /// The entry in words.
    pub text: String,
    /// File and line of the statement, `press.awl:14`; empty for an entry about none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub place: String,
    /// What made the cycle too long, if the cycle monitoring has expired and the cause is known: `of 182.0 ms 180.1 ms
    /// kernel: waited 180.100 ms for a core`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub because: String,
    /// What helps; empty for mere information.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub remedy: String,
}

impl Diagnostic {
    /// The entry in one line, with its place and its cause.
    #[must_use]
    pub fn told(&self) -> String {
        let mut told = self.text.clone();
        for (gap, more) in [(", ", &self.place), ("; ", &self.because)] {
            if !more.is_empty() {
                told += gap;
                told += more;
            }
        }
        told
    }
}

/// How a block differs from the sources, for `status`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Download {
    /// Kind and number: `FC 5`.
    pub block: String,
    /// `new`, `changed`, `deleted`, or `not used`: a plugin or a library serves it.
    pub what: String,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn requests_are_what_the_document_says() {
        let parse = |text: &str| serde_json::from_str::<Request>(text);
        let get = parse(r#"{"op":"get","items":["M1.0"],"id":7}"#).expect("a request");
        assert_eq!((get.id, get.op), (json!(7), Op::Get { items: vec!["M1.0".into()] }));
        let set = parse(r#"{"op":"set","items":{"M1.0":true}}"#).expect("a request");
        assert_eq!(set.op, Op::Set { items: [("M1.0".to_owned(), json!(true))].into() });
        let command = parse(r#"{"op":"command","command":"warm"}"#).expect("a request");
        assert_eq!(command.op, Op::Command { command: Command::Warm });
        assert_eq!(parse(r#"{"op":"diag"}"#).expect("a request").op, Op::Diag { count: 20 });
        assert!(parse(r#"{"op":"explode"}"#).is_err());
        assert!(parse("{}").is_err());
    }

    #[test]
    fn answers_leave_out_what_they_have_not() {
        let text = serde_json::to_string(&Response::refused(Value::Null, "no")).expect("serializable");
        assert_eq!(text, r#"{"ok":false,"error":"no"}"#);
    }
}
