//! The station file as it is written: one struct a table, unknown keys refused. `check` gives the values their meaning.

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::Spanned;

/// A value with its place in the file.
pub(super) type Placed<T> = Spanned<T>;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StationFile {
    pub(super) station: StationTable,
    #[serde(default)]
    pub(super) cpu: CpuTable,
    #[serde(default)]
    pub(super) timing: TimingTable,
    pub(super) retentive: Option<RetentiveTable>,
    #[serde(default)]
    pub(super) program: ProgramTable,
    #[serde(default)]
    pub(super) library: BTreeMap<Placed<String>, Placed<String>>,
    #[serde(default)]
    pub(super) plugin: Vec<PluginTable>,
    #[serde(default)]
    pub(super) module: Vec<Placed<ModuleTable>>,
    #[serde(default)]
    pub(super) bus: Vec<BusTable>,
    #[serde(default)]
    pub(super) simulated_line: Vec<SimulatedLineTable>,
    #[serde(default)]
    pub(super) link: Vec<LinkTable>,
    #[serde(default)]
    pub(super) connection: Vec<ConnectionTable>,
    #[serde(default)]
    pub(super) trace: Vec<TraceTable>,
    #[serde(default)]
    pub(super) process_io: ProcessIoTable,
}

/// What the station records by itself.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TraceTable {
    pub(super) name: Placed<String>,
    #[serde(default)]
    pub(super) signals: Vec<Placed<String>>,
    pub(super) trigger: Option<Placed<String>>,
    pub(super) before: Option<Placed<String>>,
    #[serde(rename = "for")]
    pub(super) length: Option<Placed<String>>,
    pub(super) repeat: Option<Placed<i64>>,
    pub(super) size: Option<Placed<i64>>,
    pub(super) keep: Option<Placed<i64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ConnectionTable {
    pub(super) module: Placed<String>,
    pub(super) id: Placed<i64>,
    #[serde(rename = "type")]
    pub(super) kind: Placed<String>,
    pub(super) active: Option<bool>,
    pub(super) partner: Option<Placed<String>>,
    pub(super) local_tsap: Option<Placed<String>>,
    pub(super) remote_tsap: Option<Placed<String>>,
    pub(super) local_port: Option<Placed<i64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LinkTable {
    #[serde(rename = "type")]
    pub(super) kind: Placed<String>,
    pub(super) name: Placed<String>,
    pub(super) listen: Option<Placed<String>>,
    pub(super) broker: Option<Placed<String>>,
    pub(super) rights: Option<Placed<String>>,
    pub(super) areas: Option<Placed<Vec<String>>>,
    pub(super) blocks: Option<Placed<Vec<String>>>,
    pub(super) program: Option<Placed<bool>>,
    pub(super) password: Option<Placed<String>>,
    pub(super) password_rights: Option<Placed<String>>,
    pub(super) clients: Option<Placed<i64>>,
    pub(super) rack: Option<Placed<i64>>,
    pub(super) slot: Option<Placed<i64>>,
    pub(super) pdu: Option<Placed<i64>>,
    pub(super) idle: Option<Placed<i64>>,
    pub(super) users: Option<Placed<String>>,
    pub(super) certificate: Option<Placed<String>>,
    pub(super) key: Option<Placed<String>>,
    pub(super) audit: Option<Placed<String>>,
    pub(super) hosts: Option<Placed<Vec<String>>>,
    pub(super) origins: Option<Placed<Vec<String>>>,
    pub(super) reports: Option<Placed<String>>,
    pub(super) anonymous: Option<Placed<bool>>,
    pub(super) trust: Option<Placed<String>>,
    pub(super) items: Option<Placed<i64>>,
    pub(super) client: Option<Placed<String>>,
    pub(super) prefix: Option<Placed<String>>,
    pub(super) publish: Option<Placed<Vec<String>>>,
    pub(super) every: Option<Placed<String>>,
    pub(super) retain: Option<Placed<bool>>,
    pub(super) sparkplug: Option<Placed<String>>,
    pub(super) node: Option<Placed<String>>,
    pub(super) commands: Option<Placed<Vec<String>>>,
    pub(super) alarms: Option<Placed<bool>>,
    pub(super) store: Option<Placed<i64>>,
    pub(super) ca: Option<Placed<String>>,
    pub(super) user: Option<Placed<String>>,
    pub(super) password_file: Option<Placed<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SimulatedLineTable {
    pub(super) name: Placed<String>,
    pub(super) duplex: Option<Placed<String>>,
    #[serde(default)]
    pub(super) shared: bool,
    pub(super) seed: Option<Placed<i64>>,
    pub(super) faults: Option<RatesTable>,
    pub(super) bursts: Option<Placed<RatesTable>>,
    pub(super) partner: Option<Placed<String>>,
}

/// Fault rates, and for bursts their times.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RatesTable {
    pub(super) flip: Option<Placed<i64>>,
    pub(super) lose: Option<Placed<i64>>,
    pub(super) double: Option<Placed<i64>>,
    pub(super) delay: Option<Placed<i64>>,
    pub(super) parity: Option<Placed<i64>>,
    pub(super) framing: Option<Placed<i64>>,
    #[serde(rename = "break")]
    pub(super) break_: Option<Placed<i64>>,
    pub(super) delay_max: Option<Placed<String>>,
    pub(super) every: Option<Placed<String>>,
    pub(super) length: Option<Placed<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StationTable {
    pub(super) name: Placed<String>,
    pub(super) state: Option<Placed<String>>,
    pub(super) user: Option<Placed<String>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RetentiveTable {
    #[serde(default)]
    pub(super) memory: Vec<Placed<String>>,
    #[serde(default)]
    pub(super) timers: Vec<Placed<String>>,
    #[serde(default)]
    pub(super) counters: Vec<Placed<String>>,
    pub(super) data: Option<Vec<Placed<String>>>,
    pub(super) every: Option<Placed<String>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CpuTable {
    pub(super) min_cycle: Option<Placed<String>>,
    pub(super) missed: Option<Placed<String>>,
    pub(super) watchdog: Option<Placed<String>>,
    #[serde(default)]
    pub(super) process_image: ProcessImageTable,
    pub(super) memory_bytes: Option<Placed<i64>>,
    pub(super) timers: Option<Placed<i64>>,
    pub(super) counters: Option<Placed<i64>>,
    pub(super) local_bytes: Option<Placed<i64>>,
    pub(super) family: Option<Placed<i64>>,
    pub(super) accumulators: Option<Placed<i64>>,
    pub(super) nesting_depth: Option<Placed<i64>>,
    pub(super) engine: Option<Placed<String>>,
    pub(super) clock_memory: Option<Placed<i64>>,
    pub(super) image_errors: Option<Placed<String>>,
    pub(super) test_load: Option<Placed<i64>>,
    pub(super) order: Option<Placed<String>>,
    pub(super) serial: Option<Placed<String>>,
    pub(super) db_pool_bytes: Option<Placed<i64>>,
    #[serde(default)]
    pub(super) cyclic: Vec<CyclicTable>,
    #[serde(default)]
    pub(super) time_of_day: Vec<TimeOfDayTable>,
    #[serde(default)]
    pub(super) realtime: RealtimeTable,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TimeOfDayTable {
    pub(super) ob: Placed<i64>,
    pub(super) start: Placed<String>,
    pub(super) every: Option<Placed<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CyclicTable {
    pub(super) ob: Placed<i64>,
    pub(super) period: Placed<String>,
    pub(super) phase: Option<Placed<String>>,
    pub(super) missed: Option<Placed<String>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ProcessImageTable {
    pub(super) inputs: Option<Placed<i64>>,
    pub(super) outputs: Option<Placed<i64>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RealtimeTable {
    pub(super) priority: Option<Placed<i64>>,
    #[serde(default)]
    pub(super) affinity: Vec<Placed<i64>>,
    #[serde(default)]
    pub(super) lock_memory: bool,
    pub(super) spin: Option<Placed<String>>,
    #[serde(default)]
    pub(super) keep_awake: bool,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TimingTable {
    pub(super) late: Option<Placed<String>>,
    pub(super) long: Option<Placed<String>>,
    pub(super) recorder: Option<Placed<i64>>,
    pub(super) blocks: Option<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ProgramTable {
    #[serde(default)]
    pub(super) sources: Vec<Placed<String>>,
    #[serde(default)]
    pub(super) symbols: Vec<Placed<String>>,
    #[serde(default)]
    pub(super) mc7: Vec<Placed<String>>,
    pub(super) mnemonics: Option<Placed<String>>,
    #[serde(default)]
    pub(super) libraries: Vec<Placed<String>>,
    #[serde(default)]
    pub(super) numbers: BTreeMap<Placed<String>, Placed<String>>,
    pub(super) alarms: Option<Placed<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PluginTable {
    pub(super) path: Placed<String>,
    #[serde(default)]
    pub(super) blocks: BTreeMap<Placed<String>, Placed<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModuleTable {
    #[serde(rename = "type")]
    pub(super) kind: Placed<String>,
    pub(super) name: Placed<String>,
    pub(super) address: Option<Placed<i64>>,
    pub(super) input_address: Option<Placed<i64>>,
    pub(super) output_address: Option<Placed<i64>>,
    pub(super) bytes: Option<Placed<i64>>,
    pub(super) channels: Option<Placed<i64>>,
    pub(super) params: Option<Placed<BTreeMap<Placed<String>, Placed<toml::Value>>>>,
    pub(super) raw: Option<Placed<String>>,
    pub(super) line: Option<Placed<String>>,
    pub(super) link: Option<Placed<String>>,
    pub(super) absent: Option<Placed<String>>,
    pub(super) abd: Option<Placed<String>>,
    pub(super) interface: Option<Placed<String>>,
    pub(super) diagnostics: Option<Placed<bool>>,
    pub(super) substitute: Option<Placed<Vec<Placed<i64>>>>,
    pub(super) driver: Option<Placed<String>>,
    pub(super) bus: Option<Placed<String>>,
    pub(super) unit: Option<Placed<i64>>,
    pub(super) inputs: Option<Placed<Vec<Placed<RangeTable>>>>,
    pub(super) outputs: Option<Placed<Vec<Placed<RangeTable>>>>,
    pub(super) setup: Option<Placed<Vec<Placed<SetupTable>>>>,
    pub(super) watchdog_reset: Option<Placed<Vec<Placed<SetupTable>>>>,
    pub(super) profile: Option<Placed<String>>,
    pub(super) watchdog: Option<Placed<String>>,
    pub(super) period: Option<Placed<String>>,
    pub(super) refresh: Option<Placed<String>>,
    pub(super) lost_after: Option<Placed<String>>,
    pub(super) on_loss: Option<Placed<String>>,
    pub(super) diagnostic: Option<Placed<i64>>,
    pub(super) station: Option<Placed<i64>>,
    pub(super) gsd: Option<Placed<String>>,
    pub(super) slots: Option<Placed<Vec<Placed<SlotTable>>>>,
}

/// A module in a slot of a DP slave.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SlotTable {
    pub(super) slot: Placed<i64>,
    pub(super) module: Placed<String>,
    pub(super) inputs: Option<Placed<String>>,
    pub(super) outputs: Option<Placed<String>>,
    pub(super) params: Option<Placed<BTreeMap<Placed<String>, Placed<toml::Value>>>>,
    pub(super) raw: Option<Placed<String>>,
    pub(super) substitute: Option<Placed<Vec<Placed<i64>>>>,
}

/// A bus with remote modules.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BusTable {
    pub(super) name: Placed<String>,
    #[serde(rename = "type")]
    pub(super) kind: Placed<String>,
    pub(super) line: Option<Placed<String>>,
    pub(super) timeout: Option<Placed<String>>,
    pub(super) baud: Option<Placed<i64>>,
    pub(super) parity: Option<Placed<String>>,
    pub(super) stop_bits: Option<Placed<i64>>,
    pub(super) address: Option<Placed<i64>>,
    pub(super) hsa: Option<Placed<i64>>,
    pub(super) slot_bits: Option<Placed<i64>>,
    pub(super) retries: Option<Placed<i64>>,
    pub(super) watchdog: Option<Placed<String>>,
    pub(super) chip: Option<Placed<String>>,
}

/// Registers or bits of a coupler, and where they lie.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RangeTable {
    pub(super) at: Placed<String>,
    pub(super) from: Option<Placed<String>>,
    pub(super) to: Option<Placed<String>>,
    pub(super) registers: Option<Placed<i64>>,
    pub(super) bits: Option<Placed<i64>>,
    pub(super) order: Option<Placed<String>>,
    pub(super) lines: Option<Placed<Vec<Placed<i64>>>>,
    pub(super) active_low: Option<Placed<bool>>,
    pub(super) bias: Option<Placed<String>>,
    pub(super) debounce: Option<Placed<String>>,
    pub(super) drive: Option<Placed<String>>,
    pub(super) substitute: Option<Placed<Vec<Placed<i64>>>>,
}

/// What a coupler is written on connect.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SetupTable {
    pub(super) to: Placed<String>,
    pub(super) value: Placed<i64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ProcessIoTable {
    pub(super) stimulus: Option<Placed<String>>,
}
