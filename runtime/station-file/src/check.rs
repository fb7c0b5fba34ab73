//! From the tables of the file to a [`Station`]: ranges, names, times, paths, blocks.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ob1_access::alarms::AlarmTexts;
use ob1_cpu::{AccountsConfig, CpuConfig, Family, ImageErrors, MissedCycle};
use ob1_model::{BlockId, BlockKind};
use ob1_time::Span;

use super::building::Buses;
use super::findings::{CONTRADICTION, Findings, TWICE, VALUE};
use super::tables::{CpuTable, Placed, PluginTable, StationFile, TimingTable};
use super::types::{Plugin, Realtime, Station};
use super::values::{choice, name, number, place, places, time};
use super::{connection, interrupts, link, modules, retentive, simulated, traces};
use crate::EngineChoice;
use crate::finding::{Finding, Text};
use crate::library::{self, Choice};
use crate::sources::{Mnemonics, Sources};

/// The station, and warnings about it.
pub(super) fn check(
    file: &StationFile,
    source: Text<'_>,
    folder: &Path,
) -> Result<(Station, Vec<Finding>), Vec<Finding>> {
    let mut findings = Findings::new(source);
    let f = &mut findings;
    let mut cpu = cpu(f, &file.cpu);
    cpu.accounts = accounts(f, &file.timing);
    let retentive = retentive::retentive(f, file.retentive.as_ref(), &file.station, folder, &mut cpu);
    let mut buses = Buses::new(f, &file.bus, &cpu, folder);
    let mut modules = modules::modules(f, &file.module, &mut buses, folder);
    let buses = buses.finish(f, &file.module, &mut modules);
    let mut links =
        link::links(f, &file.link, file.station.name.get_ref(), folder, &retentive::folder_of(&file.station, folder));
    connection::connections(f, &file.connection, &file.module, &modules, &mut links);
    let keeps = retentive.is_some() || !file.trace.is_empty();
    let downloads = retentive::downloads(f, keeps, &links, &file.station, folder);
    let mut library = standard(f, &file.program.libraries, &file.library);
    if cpu.family == Family::S7_400 {
        library.extend(library::of_s7_400(&library));
    }
    let station = Station {
        name: name(f, "station", &file.station.name),
        cpu,
        engine: choice(f, "engine", file.cpu.engine.as_ref(), &EngineChoice::WORDS).unwrap_or_default(),
        retentive,
        state: retentive::folder_of(&file.station, folder),
        downloads,
        realtime: realtime(f, &file.cpu),
        program: Sources {
            files: file.program.sources.iter().map(|s| folder.join(s.get_ref())).collect(),
            symbols: file.program.symbols.iter().map(|s| folder.join(s.get_ref())).collect(),
            mc7: file.program.mc7.iter().map(|s| folder.join(s.get_ref())).collect(),
            mnemonics: mnemonics(f, file.program.mnemonics.as_ref()),
            library,
            fixed: fixed_numbers(f, &file.program.numbers),
            numbers: Some(Path::new(source.file).with_extension("numbers")),
            places: places(f, &[&file.program.sources, &file.program.symbols, &file.program.mc7], folder),
            ..Sources::default()
        },
        plugins: plugins(f, &file.plugin, folder),
        modules,
        buses,
        links,
        traces: traces::traces(f, &file.trace),
        simulated_lines: simulated::lines(f, file, folder),
        stimulus: file.process_io.stimulus.as_ref().map(|s| place(f, s, folder)),
        alarms: file.program.alarms.as_ref().map(|table| place(f, table, folder)),
        alarm_texts: AlarmTexts::default(),
    };
    let warnings = findings.take_warnings();
    findings.into_result((station, warnings))
}

fn cpu(f: &mut Findings<'_>, table: &CpuTable) -> CpuConfig {
    let d = CpuConfig::of(family(f, table.family.as_ref()));
    let image = &table.process_image;
    let config = CpuConfig {
        input_bytes: number(f, "inputs", image.inputs.as_ref(), 0..=8192, d.input_bytes),
        output_bytes: number(f, "outputs", image.outputs.as_ref(), 0..=8192, d.output_bytes),
        memory_bytes: number(f, "memory_bytes", table.memory_bytes.as_ref(), 0..=65_536, d.memory_bytes),
        timers: number(f, "timers", table.timers.as_ref(), 0..=2048, d.timers),
        counters: number(f, "counters", table.counters.as_ref(), 0..=2048, d.counters),
        local_bytes: number(f, "local_bytes", table.local_bytes.as_ref(), 1024..=1_048_576, d.local_bytes),
        accumulators: number(f, "accumulators", table.accumulators.as_ref(), 2..=4, d.accumulators),
        db_pool_bytes: number(f, "db_pool_bytes", table.db_pool_bytes.as_ref(), 0..=0x400_0000, d.db_pool_bytes),
        cyclic: interrupts::cyclic(f, &table.cyclic),
        time_of_day: interrupts::time_of_day(f, &table.time_of_day),
        nesting_depth: number(f, "nesting_depth", table.nesting_depth.as_ref(), 1..=64, d.nesting_depth),
        min_cycle: time(f, table.min_cycle.as_ref(), Span::MILLISECOND),
        missed: missed(f, table.missed.as_ref()),
        watchdog: time(f, table.watchdog.as_ref(), d.watchdog),
        image_errors: choice(f, "image_errors", table.image_errors.as_ref(), &IMAGE_ERRORS).unwrap_or(d.image_errors),
        test_load: number(f, "test_load", table.test_load.as_ref(), 0..=1000, d.test_load),
        order: told(f, "order", table.order.as_ref(), 20, d.order),
        serial: told(f, "serial", table.serial.as_ref(), 24, d.serial),
        clock_memory: table
            .clock_memory
            .as_ref()
            .map(|byte| number(f, "clock_memory", Some(byte), 0..=i64::from(u16::MAX), 0)),
        ..d
    };
    if let Some(three) = table.accumulators.as_ref().filter(|a| *a.get_ref() == 3) {
        f.error(VALUE, three.span(), "no CPU has 3 accumulators", "2 (S7-300) or 4 (S7-400)");
    }
    if let Some(byte) = table.clock_memory.as_ref()
        && u32::try_from(*byte.get_ref()).is_ok_and(|b| b >= config.memory_bytes)
    {
        let message =
            format!("clock_memory = {} is outside the {} bytes of bit memory", byte.get_ref(), config.memory_bytes);
        f.error(CONTRADICTION, byte.span(), message, "name a byte that exists, or raise memory_bytes");
    }
    if !config.watchdog.is_zero() && config.watchdog < config.min_cycle {
        let at = table.watchdog.as_ref().or(table.min_cycle.as_ref()).map_or(0..0, Placed::span);
        f.error(
            CONTRADICTION,
            at,
            "the watchdog expires within the minimum cycle time",
            "make watchdog longer than min_cycle",
        );
    }
    config
}

/// A text that programming devices read: letters they can show, and not longer than its place.
fn told(f: &mut Findings<'_>, key: &str, value: Option<&Placed<String>>, most: usize, default: String) -> String {
    let Some(value) = value else { return default };
    let text = value.get_ref();
    if text.is_empty() || text.len() > most || !text.bytes().all(|byte| (b' '..=b'~').contains(&byte)) {
        let message = format!("{key} = \"{text}\" is not a number that a programming device can show");
        f.error(VALUE, value.span(), message, format!("1 to {most} letters, digits and signs"));
    }
    text.clone()
}

/// When OB 85 is called for a part of the process image that is not transferred.
const IMAGE_ERRORS: [(&str, ImageErrors); 3] =
    [("none", ImageErrors::None), ("each", ImageErrors::Each), ("changes", ImageErrors::Changes)];

fn family(f: &mut Findings<'_>, value: Option<&Placed<i64>>) -> Family {
    match value.map(|family| (*family.get_ref(), family.span())) {
        None | Some((300, _)) => Family::S7_300,
        Some((400, _)) => Family::S7_400,
        Some((other, at)) => {
            f.error(VALUE, at, format!("family = {other} does not exist"), "300 (S7-300) or 400 (S7-400)");
            Family::S7_300
        }
    }
}

fn missed(f: &mut Findings<'_>, value: Option<&Placed<String>>) -> MissedCycle {
    let words = [("now", MissedCycle::Now), ("skip", MissedCycle::Skip), ("catch-up", MissedCycle::CatchUp)];
    choice(f, "missed", value, &words).unwrap_or_default()
}

/// What is kept of every scan. The defaults of `late` and `long` depend on the cycle: 0 stands for them.
fn accounts(f: &mut Findings<'_>, table: &TimingTable) -> AccountsConfig {
    let d = AccountsConfig::default();
    AccountsConfig {
        late: time(f, table.late.as_ref(), d.late),
        long: time(f, table.long.as_ref(), d.long),
        recorder: number(f, "recorder", table.recorder.as_ref(), 1..=65_536, d.recorder),
        blocks: table.blocks.unwrap_or(d.blocks),
        off: d.off,
    }
}

fn realtime(f: &mut Findings<'_>, table: &CpuTable) -> Realtime {
    let asked = &table.realtime;
    let priority = asked.priority.as_ref().map(|p| number(f, "priority", Some(p), 1..=99, 1u8));
    let affinity = asked.affinity.iter().map(|core| number(f, "affinity", Some(core), 0..=1023, 0)).collect();
    let spin = time(f, asked.spin.as_ref(), Span::ZERO);
    Realtime { priority, affinity, lock_memory: asked.lock_memory, spin, keep_awake: asked.keep_awake }
}

/// The standard blocks: whole libraries, and single ones by number, which may stand for those of a library.
pub fn standard(
    f: &mut Findings<'_>,
    libraries: &[Placed<String>],
    single: &BTreeMap<Placed<String>, Placed<String>>,
) -> Vec<Choice> {
    const REMEDY: &str =
        "libraries = [\"IEC\"] takes a whole library, [library] single blocks: \"FC 104\" = \"IEC:FC4\"";
    let (mut chosen, mut of_libraries) = (Vec::new(), Vec::new());
    for (number, key) in single {
        match Choice::new(number.get_ref(), key.get_ref()) {
            Ok(choice) => chosen.push(choice),
            Err(message) => f.error(VALUE, number.span().start..key.span().end, message, REMEDY),
        }
    }
    for name in libraries {
        match library::whole(name.get_ref()) {
            Ok(whole) => of_libraries.extend(whole),
            Err(message) => f.error(VALUE, name.span(), message, REMEDY),
        }
    }
    let settled = library::merge(chosen, of_libraries);
    settled.unwrap_or_else(|clashes| {
        let at = libraries.last().map_or(0..0, Placed::span);
        for clash in clashes {
            let remedy = format!("say which one in [library]: \"{}\" = \"{}\"", clash.id, clash.first);
            f.error(TWICE, at.clone(), clash.to_string(), remedy);
        }
        Vec::new()
    })
}

/// `[program] numbers`: numbers of blocks that have a name only.
fn fixed_numbers(f: &mut Findings<'_>, table: &BTreeMap<Placed<String>, Placed<String>>) -> Vec<(String, BlockId)> {
    let mut fixed = Vec::with_capacity(table.len());
    for (name, number) in table {
        match BlockId::parse(number.get_ref()) {
            Some(id) => fixed.push((name.get_ref().clone(), id)),
            None => {
                let message = format!("\"{}\" is not a block", number.get_ref());
                f.error(VALUE, number.span(), message, "write numbers = { \"Pump\" = \"FB 35\" }");
            }
        }
    }
    fixed
}

fn mnemonics(f: &mut Findings<'_>, value: Option<&Placed<String>>) -> Mnemonics {
    let words = [("de", Mnemonics::German), ("en", Mnemonics::International), ("auto", Mnemonics::Auto)];
    choice(f, "mnemonics", value, &words).unwrap_or_default()
}

fn plugins(f: &mut Findings<'_>, tables: &[PluginTable], folder: &Path) -> Vec<Plugin> {
    let mut plugins: Vec<Plugin> = Vec::with_capacity(tables.len());
    for table in tables {
        let name = table.path.get_ref().clone();
        if name.is_empty() {
            f.error(
                VALUE,
                table.path.span(),
                "a plugin without a path",
                "a path, or a bare name such as \"ob1_cp240\"",
            );
        }
        if plugins.iter().any(|p| p.name == name) {
            let message = format!("the plugin \"{name}\" is named twice");
            f.error(TWICE, table.path.span(), message, "one table, with all renumbering in its `blocks`");
        }
        let is_path = name.contains('/') || Path::new(&name).extension().is_some();
        let path: Option<PathBuf> = is_path.then(|| folder.join(&name));
        let blocks = table
            .blocks
            .iter()
            .filter_map(|(from, to)| Some((block(f, from)?, block(f, to)?)).filter(|pair| same_kind(f, to, *pair)))
            .collect();
        plugins.push(Plugin { name, path, blocks, place: Some(f.spot(table.path.span())) });
    }
    plugins
}

fn same_kind(f: &mut Findings<'_>, at: &Placed<String>, (from, to): (BlockId, BlockId)) -> bool {
    if from.kind == to.kind {
        return true;
    }
    f.error(VALUE, at.span(), format!("{from} cannot become {to}"), "another number, but the same kind of block");
    false
}

fn block(f: &mut Findings<'_>, text: &Placed<String>) -> Option<BlockId> {
    let id = BlockId::parse(text.get_ref()).filter(|id| id.kind != BlockKind::Db);
    if id.is_none() {
        let message = format!("\"{}\" is not a block", text.get_ref());
        f.error(VALUE, text.span(), message, "a kind and a number: \"FC 0\", \"FB 60\"");
    }
    id
}
