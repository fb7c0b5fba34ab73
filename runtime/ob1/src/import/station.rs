//! The station file of an imported program.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use ob1_backplane::io_layout::IO_AREA_BYTES;
use ob1_ir::Program;
use ob1_model::{BlockId, BlockKind};
use ob1_project::{Area, Folder, Module, Note, Notes, SclSource, Translation, awl};
use ob1_station::posture;
use ob1_std::standard_blocks;

use ob1_station::source_view;

use super::hardware::{Hardware, cp_type, merged};
use super::names::{BLOCKS, SCL, SYMBOLS, clean, line, unique};
use super::profibus::{GsdFiles, Slaves};
use super::replace::{Replaced, plugin_of};
use super::used::{Used, areas};

/// A station file, and what there is to say of it.
#[derive(Debug, Default)]
pub(super) struct Made {
    pub(super) text: String,
    pub(super) notes: Notes,
    /// Files beside it: path below the station, content.
    pub(super) files: Vec<(String, Vec<u8>)>,
}

/// The least an S7-300 has; programs reach further through pointers than their statements say.
const MEMORY: u32 = 8192;
const NUMBERS: u32 = 512;
const IMAGE: u32 = 256;
/// The most a station can have of each.
const MOST_MEMORY: u32 = 65_536;
const MOST_NUMBERS: u32 = 2048;
const MOST_IMAGE: u32 = 8192;
/// Cycle monitoring time of a CPU that says nothing else.
const MONITORING_MS: u16 = 150;

/// What a station is called.
pub(super) struct Named<'n> {
    /// The title of its program.
    pub(super) title: &'n str,
    /// Its own name, if it has one.
    pub(super) name: Option<String>,
    /// The mnemonics of its sources.
    pub(super) set: ob1_stl::Mnemonics,
    /// The SCL sources that stand in the place of their blocks.
    pub(super) scl: &'n [&'n SclSource],
}

/// Writes the station file of a program.
pub(super) fn make(
    named: &Named<'_>,
    (folder, translation): (&Folder, &Translation),
    hardware: &Hardware,
    replaced: &Replaced,
    gsds: &GsdFiles,
) -> Made {
    let used = Used::of(&translation.program);
    let mut made = Made::default();
    let slaves = Slaves::of(hardware, gsds, &mut made.notes);
    let mut modules = Modules { names: slaves.names.clone(), ..Modules::default() };
    modules.of_hardware(hardware, replaced, &slaves, &mut made.notes);
    modules.of_operands(&used, hardware, &mut made.notes);
    head(&mut made, named, &used, hardware);
    cyclic(&mut made.text, &translation.program, hardware);
    program(&mut made.text, translation, replaced, named);
    plugins(&mut made, folder, translation, replaced);
    made.text.push_str(&modules.text);
    made.text.push_str(&slaves.text);
    made.files = slaves.files;
    made
}

fn head(made: &mut Made, named: &Named<'_>, used: &Used, hardware: &Hardware) {
    let title = named.title;
    let cpu = hardware.cpu.as_ref();
    let parameters = cpu.map(|cpu| cpu.parameters.clone()).unwrap_or_default();
    let family = if cpu.is_some_and(|cpu| cpu.s7_400 || cpu.name.starts_with("CPU 4")) { 400 } else { 300 };
    let image = |named: u32| named.max(IMAGE).next_multiple_of(2).min(MOST_IMAGE);
    let numbers = |named: u32| named.clamp(NUMBERS, MOST_NUMBERS);
    let text = &mut made.text;
    let _ = writeln!(text, "# Made by `ob1 import` of {}; report.txt says what was assumed.", line(title));
    let _ = writeln!(
        text,
        "[station]\nname = \"{}\"\n\n[cpu]",
        station_name(named.name.as_deref().unwrap_or(title), title)
    );
    if let Some(cpu) = cpu {
        let _ = writeln!(text, "# {}", line(&cpu.name));
    }
    if family == 400 {
        let _ = writeln!(text, "family = 400");
    }
    let watchdog = parameters.monitoring_ms.unwrap_or(MONITORING_MS);
    let _ = writeln!(text, "watchdog = \"{watchdog}ms\"");
    let _ = writeln!(text, "process_image = {{ inputs = {}, outputs = {} }}", image(used.inputs), image(used.outputs));
    let _ = writeln!(text, "memory_bytes = {}", used.memory.next_multiple_of(2).clamp(MEMORY, MOST_MEMORY));
    let _ = writeln!(text, "timers = {}\ncounters = {}", numbers(used.timers), numbers(used.counters));
    if let Some(byte) = parameters.clock_memory {
        let _ = writeln!(text, "clock_memory = {byte}");
    }
    let _ = write!(text, "\n{}", posture::best_table(&[]));
    if cpu.is_none() {
        made.notes.push(Note::info("station", "the program belongs to no CPU: the settings are those of an S7-300"));
    } else {
        let what = "retentive ranges and the settings of time-of-day interrupts are not read; [retentive] and \
                    [[cpu.time_of_day]] of station.toml take them";
        made.notes.push(Note::info("station", what));
    }
}

fn cyclic(text: &mut String, program: &Program, hardware: &Hardware) {
    let Some(cpu) = &hardware.cpu else { return };
    for c in &cpu.parameters.cyclic {
        let there = program.blocks.iter().any(|b| b.id == BlockId::new(BlockKind::Ob, u16::from(c.ob)));
        if there {
            let _ = writeln!(text, "\n[[cpu.cyclic]]\nob = {}\nperiod = \"{}ms\"", c.ob, c.period_ms.min(60_000));
            if c.phase_ms > 0 {
                let _ = writeln!(text, "phase = \"{}ms\"", c.phase_ms);
            }
        }
    }
}

fn program(text: &mut String, translation: &Translation, replaced: &Replaced, named: &Named<'_>) {
    let list = |key: &str, names: &[String]| {
        let names: String = names.iter().map(|name| format!("    \"{name}\",\n")).collect();
        format!("{key} = [\n{names}]\n")
    };
    let stem = |file: &str| file.split('.').next().unwrap_or_default().to_owned();
    let instead: BTreeSet<String> = named.scl.iter().flat_map(|s| s.blocks.iter().map(|id| stem(&awl(*id)))).collect();
    let names = |files: &'_ [ob1_project::ProgramFile]| -> Vec<String> {
        let kept = files.iter().filter(|f| !instead.contains(&stem(&f.name)));
        kept.map(|f| format!("{BLOCKS}/{}", f.name)).collect()
    };
    let (mut sources, images) = (names(&translation.sources), names(&translation.images));
    sources.extend(named.scl.iter().map(|source| format!("{SCL}/{}", source.name)));
    let _ = writeln!(text, "\n[program]");
    if !translation.program.symbols.is_empty() {
        let _ = writeln!(text, "symbols = [\"{SYMBOLS}\"]");
    }
    let _ = writeln!(text, "mnemonics = \"{}\"", source_view::word(named.set));
    text.push_str(&list("sources", &sources));
    if !images.is_empty() {
        text.push_str(&list("mc7", &images));
    }
    if replaced.blocks.is_empty() {
        return;
    }
    text.push_str("\n[library]\n");
    for (id, block) in &replaced.blocks {
        let _ = writeln!(text, "\"{id}\" = \"{}\"", block.key());
    }
}

/// The first number that a block of a plugin gets whose own number the project has.
const OUT_OF_THE_WAY: u16 = 1000;

/// The plugins of the handling blocks. A plugin brings all its blocks: those that the project does not call move to
/// free numbers where the project or another plugin has theirs.
fn plugins(made: &mut Made, folder: &Folder, translation: &Translation, replaced: &Replaced) {
    let of_program = translation.program.blocks.iter().map(|block| block.id);
    let mut taken: BTreeSet<BlockId> = folder.blocks.keys().copied().chain(of_program).collect();
    taken.extend(replaced.ids());
    let plugins: BTreeSet<String> = replaced.blocks.values().map(plugin_of).collect();
    for plugin in plugins {
        let mut numbers = Vec::new();
        // Those of the CPU have their numbers on every CPU that has them.
        for ours in standard_blocks().iter().filter(|block| plugin_of(block) == plugin && !block.id.kind.is_system()) {
            let id = match replaced.blocks.iter().find(|(_, block)| block.key() == ours.key()) {
                Some((id, _)) => *id,
                None if taken.insert(ours.id) => ours.id,
                None => {
                    let free = |number: &u16| taken.insert(BlockId::new(ours.id.kind, *number));
                    let Some(number) = (OUT_OF_THE_WAY..).find(free) else { continue };
                    let id = BlockId::new(ours.id.kind, number);
                    let what = format!("the plugin's {} {} is {id} here: its own number is taken", ours.id, ours.name);
                    made.notes.push(Note::info(plugin.clone(), what));
                    id
                }
            };
            if id != ours.id {
                numbers.push(format!("\"{}\" = \"{id}\"", ours.id));
            }
        }
        let _ = writeln!(made.text, "\n[[plugin]]\npath = \"{plugin}\"");
        if !numbers.is_empty() {
            let _ = writeln!(made.text, "blocks = {{ {} }}", numbers.join(", "));
        }
    }
}

/// The modules of the station file.
#[derive(Debug, Default)]
struct Modules {
    text: String,
    names: BTreeSet<String>,
    inputs: Vec<Area>,
    outputs: Vec<Area>,
}

/// Bytes of registers a communication processor has in the address space.
const CP_BYTES: u32 = 16;

impl Modules {
    fn of_hardware(&mut self, hardware: &Hardware, replaced: &Replaced, slaves: &Slaves, notes: &mut Notes) {
        let (own, others): (Vec<&Module>, Vec<&Module>) =
            hardware.modules.iter().partition(|m| slaves.has(m).is_some());
        for module in own.into_iter().filter(|m| slaves.has(m) == Some(true)) {
            self.inputs.extend_from_slice(&module.inputs);
            self.outputs.extend_from_slice(&module.outputs);
        }
        let (cps, plain): (Vec<&Module>, Vec<&Module>) =
            others.into_iter().partition(|m| cp_type(m).is_some() && !replaced.blocks.is_empty());
        for module in cps {
            self.cp(module, notes);
        }
        for (input, digital, analog) in [(true, "di", "ai"), (false, "do", "ao")] {
            let of = |m: &&Module| if input { m.inputs.clone() } else { m.outputs.clone() };
            for area in merged(plain.iter().flat_map(of)) {
                let owner = plain.iter().find(|m| of(m).iter().any(|a| a.first == area.first));
                // What overlaps others is no channels.
                let channels = owner.is_some_and(|m| is_analog(m) && of(m).contains(&area) && area.bytes % 2 == 0);
                let word = if channels { analog } else { digital };
                let (name, comment) = owner.map_or(("module".to_owned(), String::new()), |m| {
                    let (rack, slot, _) = m.place;
                    (format!("{word}-{rack}-{slot}"), format!("{} {}, rack {rack}, slot {slot}", m.name, m.order))
                });
                self.plain(&name, word, area, &comment, notes);
            }
        }
    }

    fn cp(&mut self, module: &Module, notes: &mut Notes) {
        let Some(ty) = cp_type(module) else { return };
        let Some(area) = module.inputs.iter().chain(&module.outputs).next() else { return };
        let (rack, slot, _) = module.place;
        let name = self.name(&format!("{ty}-{rack}-{slot}"));
        let _ = write!(
            self.text,
            "\n# {}, rack {rack}, slot {slot}\n[[module]]\ntype = \"{ty}\"\nname = \"{name}\"\naddress = {}\n\
             line = \"sim:{name}\"\nparams = {{ protocol = \"3964r\" }}\n\n[[simulated_line]]\nname = \"{name}\"\n",
            line(&module.name),
            area.first
        );
        let taken = Area { first: area.first, bytes: CP_BYTES };
        self.inputs.push(taken);
        self.outputs.push(taken);
        let what = format!(
            "{} at address {} is a {ty}: protocol and line are made up (3964R on a simulated line); set `params` and `line`",
            module.name, area.first
        );
        notes.push(Note::warning(name, what));
    }

    /// Modules for addresses that no module has. If no module could be read, every byte gets one: no statement says
    /// which bytes pointers reach.
    fn of_operands(&mut self, used: &Used, hardware: &Hardware, notes: &mut Notes) {
        if hardware.modules.is_empty() {
            let all = Area { first: 0, bytes: IO_AREA_BYTES as u32 };
            let list = |bytes: &BTreeSet<u32>| {
                let found: Vec<String> =
                    areas(bytes).iter().map(|a| format!("{}..{}", a.first, a.first + a.bytes - 1)).collect();
                if found.is_empty() { "none".to_owned() } else { found.join(", ") }
            };
            let read = list(&used.read.union(&used.peripheral_read).copied().collect());
            let written = list(&used.written.union(&used.peripheral_written).copied().collect());
            let what = format!(
                "no modules could be read: all peripheral bytes are plain inputs and outputs; the program and its symbols name \
                 input bytes {read} and output bytes {written}"
            );
            notes.push(Note::info("station", what));
            self.plain("inputs", "di", all, "no modules could be read: all inputs there are", notes);
            self.plain("outputs", "do", all, "no modules could be read: all outputs there are", notes);
            return;
        }
        for (input, word) in [(true, "di"), (false, "do")] {
            let reached = if input { &used.peripheral_read } else { &used.peripheral_written };
            let taken = if input { &self.inputs } else { &self.outputs };
            let is_free = |byte: &&u32| !taken.iter().any(|a| (a.first..a.first + a.bytes).contains(byte));
            let bytes: BTreeSet<u32> = reached.iter().filter(is_free).copied().collect();
            for area in areas(&bytes) {
                let kind = if input { "input" } else { "output" };
                let what = format!(
                    "peripheral {kind} bytes {}..{}: the program or its symbols name them, and no module of the project has them",
                    area.first,
                    area.first + area.bytes - 1
                );
                notes.push(Note::info("station", what));
                self.plain(&format!("{word}-{}", area.first), word, area, "named by the program or its symbols", notes);
            }
        }
    }

    fn plain(&mut self, name: &str, word: &str, area: Area, comment: &str, notes: &mut Notes) {
        let end = (area.first + area.bytes).min(IO_AREA_BYTES as u32);
        if area.first >= end {
            let what = format!(
                "bytes {}..{}: process I/O ends at {}; {}",
                area.first,
                area.first + area.bytes - 1,
                IO_AREA_BYTES - 1,
                line(comment)
            );
            notes.push(Note::warning("station", what));
            return;
        }
        let name = self.name(name);
        let (key, count) =
            if word.starts_with('a') { ("channels", (end - area.first) / 2) } else { ("bytes", end - area.first) };
        let _ = write!(
            self.text,
            "\n# {}\n[[module]]\ntype = \"{word}\"\nname = \"{name}\"\naddress = {}\n{key} = {count}\n",
            line(comment),
            area.first,
        );
        if word.ends_with('i') { self.inputs.push(area) } else { self.outputs.push(area) }
    }

    /// A name that is not taken yet.
    fn name(&mut self, wanted: &str) -> String {
        unique(&mut self.names, &clean(wanted, 30))
    }
}

/// SM 331 to 336 of an S7-300, SM 431 and 432 of an S7-400: a word a channel.
fn is_analog(module: &Module) -> bool {
    const ANALOG: [&str; 7] = ["331", "332", "334", "335", "336", "431", "432"];
    module.order.strip_prefix("6ES7 ").is_some_and(|rest| ANALOG.iter().any(|number| rest.starts_with(number)))
}

/// The name of a station, from the first of these that has letters for one.
fn station_name(name: &str, title: &str) -> String {
    let names = [name, title].map(|name| clean(name, 40));
    names.into_iter().find(|name| !name.is_empty()).unwrap_or_else(|| "imported".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_a_station_file_takes() {
        let title = "SIMATIC 300(1)/CPU 315-2 DP";
        assert_eq!(station_name("Cooker 2", title), "cooker-2");
        assert_eq!(station_name(title, title), "simatic-300-1-cpu-315-2-dp");
        assert_eq!(station_name("硬件", "硬件"), "imported");
        let mut modules = Modules::default();
        assert_eq!((modules.name("a b"), modules.name("a b")), ("a-b".to_owned(), "a-b-2".to_owned()));
    }
}
