//! What others may read from outside the scan: names, monitors of the CPs, drivers, the posture.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time;

use ob1_access::alarms::AlarmTexts;
use ob1_access::door::Diagnosis;
use ob1_backplane::{BufferEntry, Counter, Monitor};
use ob1_cpu::{DiagEntry, Distribution, Family, OperatingState};
use ob1_host::driver;
use ob1_model::Event;
use ob1_params::CpKind;
use ob1_rt::{Grant, MonotonicClock};

use crate::access::protocol::{
    CpBuffer, CpEntry, Diagnostic, DriverStatus, GrantStatus, Listens, MemoryStatus, ModuleStatus, ReasonStatus,
    Status, Times,
};
use crate::access::stage::StageStatus;
use crate::bus_view::BusView;
use crate::download::Loads;
use crate::drivers::state_text;
use crate::engine::InUse;
use crate::forced::Forces;
use crate::io::Panel;
use crate::program_facts::Known;
use crate::reason_texts;
use crate::retentive::health::Health;
use crate::wall_clock::unix_now;
use ob1_station_file::{ModuleConfig, ModuleKind};
use ob1_time::Instant;
use ob1_timing::{Class, Timings};

/// Among the counters of a module: events that the ring of its segment had no room for.
pub const EVENTS_LOST: &str = "events_lost";

/// A running station, as seen from other threads than the scan.
#[derive(Clone, Debug)]
pub struct StationView {
    /// Name of the station.
    pub name: String,
    /// Its links that listen.
    pub listens: Vec<Listens>,
    /// The family of its CPU.
    pub family: Family,
    /// The program that runs now, and what is known of it.
    pub known: Known,
    /// What its alarms mean.
    pub alarm_texts: Arc<AlarmTexts>,
    /// Its modules, in the order of the CPU.
    pub modules: Vec<ModuleView>,
    /// Its buses, in the order of the station file.
    pub buses: Vec<BusView>,
    /// The inputs of its process I/O modules.
    pub panel: Option<Panel>,
    /// What the operating system granted; set by the scan thread when it has asked.
    pub posture: Arc<OnceLock<Vec<Grant>>>,
    /// What is forced, and may be changed here.
    pub forces: Forces,
    /// Where changes of the program are ordered, once the station is at work.
    pub loads: Arc<OnceLock<Loads>>,
    /// State of the writing of retentive memory, where the station file wants it.
    pub retentive: Option<Health>,
    /// The clock of this runtime.
    pub clock: MonotonicClock,
    /// The accounts of every scan.
    pub timings: Timings,
    /// The engine that runs its program.
    pub engine: Arc<InUse>,
    /// Seconds since a cycle began that does not end; 0: cycles end.
    pub stands: Arc<AtomicU64>,
}

/// A module, as seen from other threads than the scan.
#[derive(Clone, Debug)]
pub struct ModuleView {
    /// Name of the module in the station file.
    pub name: String,
    /// Which communication processor it is; none for process I/O.
    pub cp: Option<CpKind>,
    /// Its type, as in the station file.
    pub type_name: &'static str,
    /// Its first byte: logical base address.
    pub address: u32,
    /// Process inputs and outputs: first byte and how many.
    pub channels: [[u32; 2]; 2],
    /// Whether they are words; of a coupler it is not known.
    pub analog: Option<bool>,
    /// The segment of a CP.
    pub monitor: Option<Monitor>,
    /// The driver of a CP.
    pub driver: Option<Arc<driver::DriverStatus>>,
}

impl ModuleView {
    /// Of a module without a driver.
    #[must_use]
    pub fn new(config: &ModuleConfig) -> Self {
        let cp = config.kind.cp();
        let (type_name, address) = match (cp, &config.kind) {
            (Some(cp), _) => (cp.name(), config.input_address),
            (None, ModuleKind::DpMaster { .. }) => ("cp342-5", config.input_address),
            (None, ModuleKind::Outputs { .. }) => ("outputs", config.output_address),
            (None, ModuleKind::Remote { .. }) if config.input_bytes() == 0 => ("coupler", config.output_address),
            (None, ModuleKind::Remote { .. }) => ("coupler", config.input_address),
            (None, _) => ("inputs", config.input_address),
        };
        let channels = match config.kind {
            ModuleKind::Inputs { .. } | ModuleKind::Outputs { .. } | ModuleKind::Remote { .. } => [
                [config.input_address, config.input_bytes().into()],
                [config.output_address, config.output_bytes().into()],
            ],
            _ => [[0; 2]; 2],
        };
        let analog = match config.kind {
            ModuleKind::Inputs { analog, .. } | ModuleKind::Outputs { analog, .. } => Some(analog),
            _ => None,
        };
        Self { name: config.name.clone(), cp, type_name, address, channels, analog, monitor: None, driver: None }
    }

    fn status(&self, present: bool, now: Instant) -> ModuleStatus {
        let monitor = self.monitor.as_ref();
        let driver = self.driver.as_ref().map(|driver| DriverStatus {
            pid: driver.pid(),
            starts: driver.starts(),
            losses: driver.losses(),
            state: monitor.map_or_else(String::new, state_text),
        });
        let counters = monitor.map(|monitor| {
            let counters = monitor.counters();
            let named = Counter::ALL.iter().map(|counter| (counter.name().to_owned(), counters.get(*counter)));
            let ends = monitor.ends().map(|ends| (reason_texts::end_counter(ends.number), ends.count));
            named.chain([(EVENTS_LOST.to_owned(), monitor.events_lost())]).chain(ends).collect()
        });
        ModuleStatus {
            name: self.name.clone(),
            type_name: self.type_name.to_owned(),
            address: self.address,
            inputs: self.channels[0],
            outputs: self.channels[1],
            analog: self.analog,
            present,
            leds: self.cp.zip(monitor).map(|(cp, monitor)| leds(cp, monitor)).unwrap_or_default(),
            driver,
            counters: counters.unwrap_or_default(),
            stages: monitor.map(|monitor| monitor.spreads().map(StageStatus::of).collect()).unwrap_or_default(),
            reason: self.reason(now),
        }
    }

    /// What a CP waits for, or what has failed; `now` by the clock of the runtime.
    pub(crate) fn reason(&self, now: Instant) -> Option<ReasonStatus> {
        reason_texts::of(self.cp?, self.monitor.as_ref()?, now)
    }
}

/// The LEDs that are lit, by the names on the front.
fn leds(cp: CpKind, monitor: &Monitor) -> Vec<String> {
    let leds = monitor.leds();
    let lit = cp.row().leds.into_iter().zip([leds.power, leds.error, leds.transmit, leds.receive]);
    lit.filter(|(name, on)| *on && !name.is_empty()).map(|(name, _)| name.to_owned()).collect()
}

impl StationView {
    /// The diagnostic buffers of the CPs, and what ob1 lists of those that have none by their manual: at most `count`
    /// entries of each, newest first.
    #[must_use]
    pub fn buffers(&self, count: u32) -> Vec<CpBuffer> {
        let now = self.clock.time();
        let buffer = |module: &ModuleView| {
            // A CP 343 lists nothing: its jobs have their own STATUS.
            let cp = module.cp.filter(|cp| !cp.row().has_boxes)?;
            let monitor = module.monitor.as_ref()?;
            let is_own = cp.row().has_channels;
            Some(CpBuffer {
                name: module.name.clone(),
                type_name: module.type_name.to_owned(),
                address: module.address,
                driver: state_text(monitor),
                reason: module.reason(now),
                entries: monitor.buffer().take(count as usize).map(|entry| self.cp_entry(entry, is_own)).collect(),
            })
        };
        self.modules.iter().filter_map(buffer).collect()
    }

    /// An entry of the CPU's diagnostic buffer as others see it.
    #[must_use]
    pub fn diagnostic(&self, entry: Diagnosis) -> Diagnostic {
        Diagnostic {
            number: entry.number,
            time_ns: entry.time,
            unix_ns: self.unix_at(Instant::from_nanos(entry.time)),
            event: event_number(entry.event),
            text: entry.text,
            place: entry.place,
            because: entry.because,
            remedy: entry.remedy,
        }
    }

    /// What helps: against a cycle that was too long what its cause asks for.
    #[must_use]
    pub fn remedy(&self, entry: &DiagEntry) -> &'static str {
        let class = || self.timings.watchdog_class(entry.time);
        let too_long = entry.event == Event::CYCLE_TIME_EXCEEDED;
        too_long.then(class).flatten().and_then(Class::remedy).unwrap_or_else(|| entry.event.remedy())
    }

    /// What made the cycle too long, if the entry is about one.
    #[must_use]
    pub fn stood_in_the_way(&self, entry: &DiagEntry) -> Option<String> {
        if entry.event == Event::CYCLE_TIME_EXCEEDED { self.timings.watchdog(entry.time) } else { None }
    }

    /// Nanoseconds since 1970 at a time of this runtime, by the clock as it is set now.
    pub(crate) fn unix_at(&self, time: Instant) -> u64 {
        unix_now().saturating_sub(self.clock.time().since(time).nanos())
    }

    /// What an entry of a CP's buffer says, in words.
    pub(crate) fn cp_text(&self, module: &ModuleView, entry: BufferEntry) -> String {
        self.cp_entry(entry, module.cp.is_some_and(|cp| cp.row().has_channels)).text
    }

    /// An entry of a CP; `is_own`: of its own buffer. In ob1's list are also the codes with which orders have ended.
    fn cp_entry(&self, entry: BufferEntry, is_own: bool) -> CpEntry {
        let unix_ns = self.unix_at(Instant::from_millis(entry.time_ms));
        let told = CpEntry { unix_ns, ..entry.into() };
        match u8::try_from(entry.number) {
            Ok(code) if !is_own => {
                let (text, remedy) = reason_texts::code(code);
                let number = reason_texts::number_text(entry.number);
                CpEntry { number, text: format!("order ended: {text}"), remedy: remedy.to_owned(), ..told }
            }
            _ => told,
        }
    }

    /// The station as others see it. `present` has one entry a module.
    #[must_use]
    pub fn status(&self, state: OperatingState, present: &[bool]) -> Status {
        let memory = ob1_rt::memory();
        let figures = self.timings.figures();
        let statistics = figures.statistics();
        let now = self.clock.time();
        let module = |(index, module): (usize, &ModuleView)| module.status(present.get(index) == Some(&true), now);
        let known = self.known.get();
        Status {
            station: self.name.clone(),
            pid: std::process::id(),
            state: state.name().to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            program: format!("{:08x}", known.sums()[1]),
            listens: self.listens.clone(),
            min_cycle_ns: self.timings.min_cycle().nanos(),
            runtime_ns: now.nanos(),
            scans: statistics.scans,
            statements: statistics.statements,
            engine: self.engine.name().to_owned(),
            engine_lacks: self.engine.lacks(),
            stands_s: Some(self.stands.load(Ordering::Relaxed)).filter(|seconds| *seconds > 0),
            overruns: statistics.overruns,
            missed: figures.missed,
            late: figures.late,
            watchdogs: statistics.watchdogs,
            cycle: times(&statistics.cycle),
            wake: times(&figures.wake.distribution()),
            execution: times(&statistics.execution),
            modules: self.modules.iter().enumerate().map(module).collect(),
            posture: self.posture.get().into_iter().flatten().map(GrantStatus::from).collect(),
            retentive: self.retentive.as_ref().map(|health| health.status(time::Instant::now())),
            memory: MemoryStatus {
                resident_kib: memory.resident_kib,
                peak_kib: memory.peak_kib,
                locked_kib: memory.locked_kib,
                threads: memory.threads,
            },
            log_lost: ob1_process::log::lost(),
            forced: self.forces.now().iter().map(ToString::to_string).collect(),
            downloads: known.downloads.clone(),
            downloads_not_kept: known.not_kept.clone(),
        }
    }
}

/// Number of an event: `4302h`.
pub(crate) fn event_number(event: u16) -> String {
    format!("{event:04X}h")
}

fn times(d: &Distribution) -> Times {
    Times {
        count: d.count,
        min_ns: d.min.nanos(),
        mean_ns: d.mean,
        p50_ns: d.p50.nanos(),
        p99_ns: d.p99.nanos(),
        p999_ns: d.p999.nanos(),
        max_ns: d.max.nanos(),
    }
}

impl From<BufferEntry> for CpEntry {
    fn from(entry: BufferEntry) -> Self {
        // Shared memory can hold any number.
        let row = ob1_words::cp341_events::row(entry.number);
        Self {
            time_ms: entry.time_ms,
            unix_ns: 0,
            number: format!("{:04X}h", entry.number),
            incoming: entry.incoming,
            text: row.map_or("unknown event", |row| row.text).to_owned(),
            remedy: row.map_or("", |row| row.remedy).to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use ob1_backplane::{CpSide, CpuSide, Event, EventKind, Segment};

    use super::*;

    #[test]
    fn the_counters_of_a_module_say_what_its_event_ring_has_lost() {
        let segment = Segment::heap();
        let side = CpuSide::create(&segment, 16).expect("16 bytes are allowed");
        let mut cp = CpSide::attach(&segment).expect("a fresh segment");
        for number in 0..70 {
            cp.emit_event(Event::new(number, EventKind::Message, 1, &[]));
        }
        let monitor = Some(side.monitor().clone());
        let view = ModuleView {
            name: "cp".into(),
            cp: None,
            type_name: "cp240",
            address: 256,
            channels: [[0; 2]; 2],
            analog: None,
            monitor,
            driver: None,
        };
        let counters = view.status(true, Instant::START).counters;
        assert_eq!((counters.len(), counters.get(EVENTS_LOST)), (Counter::ALL.len() + 1, Some(&6)));
        for number in [0x07, 0x07, 0x0708] {
            cp.count_end(number);
        }
        let counters = view.status(true, Instant::START).counters;
        assert_eq!((counters.get("ended_07h"), counters.get("ended_0708h")), (Some(&2), Some(&1)));
    }
}
