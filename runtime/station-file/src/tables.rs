//! The station file as it is written: one struct a table, unknown keys refused. `check` gives the values their meaning.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

/// A value with its place in the file.
pub(super) type Placed<T> = Spanned<T>;

/// A table of the file whose keys lie together, with the places of keys and values.
pub(super) type Table = BTreeMap<Placed<String>, Placed<toml::Value>>;

/// A value with its place, which the file may leave out.
trait MayBeGiven {
    fn place(&self) -> Option<Range<usize>>;
}

impl<T> MayBeGiven for Placed<T> {
    fn place(&self) -> Option<Range<usize>> {
        Some(self.span())
    }
}

impl<T> MayBeGiven for Option<Placed<T>> {
    fn place(&self) -> Option<Range<usize>> {
        self.as_ref().map(Placed::span)
    }
}

/// Makes the structs of the tables with a header, and [`KEYS`]. A key stands in front of its field if that cannot have
/// its name. A table that is `shared` by several kinds says which of its keys the file gives: not each kind has all.
macro_rules! tables {
    ($($(#[$on:meta])* struct $table:ident in $header:literal $($shared:ident)? {
        $($(#[$attribute:meta])* $($key:literal =)? $field:ident: $ty:ty,)*
    })*) => {
        $(#[derive(Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        $(#[$on])*
        pub(super) struct $table { $($(#[$attribute])* $(#[serde(rename = $key)])? pub(super) $field: $ty,)* }
        tables!(keys [$($shared)?] $table $([$($key)? $field])*);)*

        /// The headers of tables, each with its keys.
        pub(super) const KEYS: &[(&str, &[&str])] =
            &[$(($header, &[$(tables!(key $($key)? $field)),*])),*];
    };
    (key $key:literal $field:ident) => { $key };
    (key $field:ident) => { stringify!($field) };
    (keys [] $($rest:tt)*) => {};
    (keys [shared] $table:ident $([$($key:literal)? $field:ident])*) => {
        impl $table {
            /// The keys that the file gives, each with its place.
            pub(super) fn given(&self) -> impl Iterator<Item = (&'static str, Range<usize>)> + use<> {
                let all = [$((tables!(key $($key)? $field), self.$field.place())),*];
                all.into_iter().filter_map(|(key, at)| Some((key, at?)))
            }
        }
    };
}

tables! {
    /// What the station records by itself.
    struct TraceTable in "[[trace]]" {
        name: Placed<String>,
        #[serde(default)]
        signals: Vec<Placed<String>>,
        trigger: Option<Placed<String>>,
        before: Option<Placed<String>>,
        "for" = length: Option<Placed<String>>,
        repeat: Option<Placed<i64>>,
        size: Option<Placed<i64>>,
        keep: Option<Placed<i64>>,
    }

    struct ConnectionTable in "[[connection]]" {
        module: Placed<String>,
        id: Placed<i64>,
        "type" = kind: Placed<String>,
        active: Option<bool>,
        partner: Option<Placed<String>>,
        local_tsap: Option<Placed<String>>,
        remote_tsap: Option<Placed<String>>,
        local_port: Option<Placed<i64>>,
    }

    struct SimulatedLineTable in "[[simulated_line]]" {
        name: Placed<String>,
        duplex: Option<Placed<String>>,
        #[serde(default)]
        shared: bool,
        seed: Option<Placed<i64>>,
        faults: Option<RatesTable>,
        bursts: Option<Placed<RatesTable>>,
        partner: Option<Placed<String>>,
    }

    struct StationTable in "[station]" {
        name: Placed<String>,
        state: Option<Placed<String>>,
        user: Option<Placed<String>>,
    }

    #[derive(Default)]
    #[serde(default)]
    struct RetentiveTable in "[retentive]" {
        memory: Vec<Placed<String>>,
        timers: Vec<Placed<String>>,
        counters: Vec<Placed<String>>,
        data: Option<Vec<Placed<String>>>,
        every: Option<Placed<String>>,
    }

    #[derive(Default)]
    #[serde(default)]
    struct CpuTable in "[cpu]" {
        min_cycle: Option<Placed<String>>,
        missed: Option<Placed<String>>,
        watchdog: Option<Placed<String>>,
        process_image: ProcessImageTable,
        memory_bytes: Option<Placed<i64>>,
        timers: Option<Placed<i64>>,
        counters: Option<Placed<i64>>,
        local_bytes: Option<Placed<i64>>,
        family: Option<Placed<i64>>,
        accumulators: Option<Placed<i64>>,
        nesting_depth: Option<Placed<i64>>,
        engine: Option<Placed<String>>,
        clock_memory: Option<Placed<i64>>,
        image_errors: Option<Placed<String>>,
        test_load: Option<Placed<i64>>,
        order: Option<Placed<String>>,
        serial: Option<Placed<String>>,
        db_pool_bytes: Option<Placed<i64>>,
        cyclic: Vec<CyclicTable>,
        time_of_day: Vec<TimeOfDayTable>,
        realtime: RealtimeTable,
    }

    struct TimeOfDayTable in "[[cpu.time_of_day]]" {
        ob: Placed<i64>,
        start: Placed<String>,
        every: Option<Placed<String>>,
    }

    struct CyclicTable in "[[cpu.cyclic]]" {
        ob: Placed<i64>,
        period: Placed<String>,
        phase: Option<Placed<String>>,
        missed: Option<Placed<String>>,
    }

    #[derive(Default)]
    struct ProcessImageTable in "[cpu.process_image]" {
        inputs: Option<Placed<i64>>,
        outputs: Option<Placed<i64>>,
    }

    #[derive(Default)]
    #[serde(default)]
    struct RealtimeTable in "[cpu.realtime]" {
        priority: Option<Placed<i64>>,
        affinity: Vec<Placed<i64>>,
        lock_memory: bool,
        spin: Option<Placed<String>>,
        keep_awake: bool,
    }

    #[derive(Default)]
    struct TimingTable in "[timing]" {
        late: Option<Placed<String>>,
        long: Option<Placed<String>>,
        recorder: Option<Placed<i64>>,
        blocks: Option<bool>,
    }

    #[derive(Default)]
    #[serde(default)]
    struct ProgramTable in "[program]" {
        sources: Vec<Placed<String>>,
        symbols: Vec<Placed<String>>,
        mc7: Vec<Placed<String>>,
        mnemonics: Option<Placed<String>>,
        libraries: Vec<Placed<String>>,
        numbers: BTreeMap<Placed<String>, Placed<String>>,
        alarms: Option<Placed<String>>,
    }

    struct PluginTable in "[[plugin]]" {
        path: Placed<String>,
        #[serde(default)]
        blocks: BTreeMap<Placed<String>, Placed<String>>,
    }

    struct ModuleTable in "[[module]]" shared {
        "type" = kind: Placed<String>,
        name: Placed<String>,
        address: Option<Placed<i64>>,
        input_address: Option<Placed<i64>>,
        output_address: Option<Placed<i64>>,
        bytes: Option<Placed<i64>>,
        channels: Option<Placed<i64>>,
        params: Option<Placed<Table>>,
        raw: Option<Placed<String>>,
        line: Option<Placed<String>>,
        link: Option<Placed<String>>,
        absent: Option<Placed<String>>,
        abd: Option<Placed<String>>,
        interface: Option<Placed<String>>,
        diagnostics: Option<Placed<bool>>,
        substitute: Option<Placed<Vec<Placed<i64>>>>,
        driver: Option<Placed<String>>,
        bus: Option<Placed<String>>,
        unit: Option<Placed<i64>>,
        inputs: Option<Placed<Vec<Placed<RangeTable>>>>,
        outputs: Option<Placed<Vec<Placed<RangeTable>>>>,
        setup: Option<Placed<Vec<Placed<SetupTable>>>>,
        watchdog_reset: Option<Placed<Vec<Placed<SetupTable>>>>,
        profile: Option<Placed<String>>,
        watchdog: Option<Placed<String>>,
        period: Option<Placed<String>>,
        refresh: Option<Placed<String>>,
        lost_after: Option<Placed<String>>,
        on_loss: Option<Placed<String>>,
        diagnostic: Option<Placed<i64>>,
        station: Option<Placed<i64>>,
        gsd: Option<Placed<String>>,
        slots: Option<Placed<Vec<Placed<SlotTable>>>>,
    }

    /// A bus with remote modules.
    struct BusTable in "[[bus]]" shared {
        name: Placed<String>,
        "type" = kind: Placed<String>,
        line: Option<Placed<String>>,
        timeout: Option<Placed<String>>,
        baud: Option<Placed<i64>>,
        parity: Option<Placed<String>>,
        stop_bits: Option<Placed<i64>>,
        address: Option<Placed<i64>>,
        hsa: Option<Placed<i64>>,
        slot_bits: Option<Placed<i64>>,
        retries: Option<Placed<i64>>,
        watchdog: Option<Placed<String>>,
        chip: Option<Placed<String>>,
    }

    #[derive(Default)]
    struct ProcessIoTable in "[process_io]" {
        stimulus: Option<Placed<String>>,
    }
}

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
    pub(super) link: Vec<Placed<Table>>,
    #[serde(default)]
    pub(super) connection: Vec<ConnectionTable>,
    #[serde(default)]
    pub(super) trace: Vec<TraceTable>,
    #[serde(default)]
    pub(super) process_io: ProcessIoTable,
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

/// A module in a slot of a DP slave.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SlotTable {
    pub(super) slot: Placed<i64>,
    pub(super) module: Placed<String>,
    pub(super) inputs: Option<Placed<String>>,
    pub(super) outputs: Option<Placed<String>>,
    pub(super) params: Option<Placed<Table>>,
    pub(super) raw: Option<Placed<String>>,
    pub(super) substitute: Option<Placed<Vec<Placed<i64>>>>,
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

tables!(keys [shared] RangeTable [at] [from] [to] [registers] [bits] [order] [lines] [active_low] [bias] [debounce]
    [drive] [substitute]);

/// What a coupler is written on connect.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SetupTable {
    pub(super) to: Placed<String>,
    pub(super) value: Placed<i64>,
}
