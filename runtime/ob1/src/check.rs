//! `ob1 check`: everything that is wrong with sources, plugins or a whole station, without running it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use ob1_cpu::{Cpu, CpuConfig, LoadError, Module};
use ob1_host::bus::area_bytes;
use ob1_model::Section;
use ob1_params::{CpKind, Interface, Value};

use crate::exit::Exit;
use crate::language::Language;
use crate::remote::print_json;
use ob1_station::assembly;
use ob1_station::compiling;
use ob1_station::io::{ProcessIo, Stimulus};
use ob1_station::numbers;
use ob1_station::plugins;
use ob1_station::posture;
use ob1_station::program::{self, Loaded};
use ob1_station::source_view;
use ob1_station_file::EngineChoice;
use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::findings::MISPLACED;
use ob1_station_file::library::{Choice, Chosen};
use ob1_station_file::sources::Sources;
use ob1_station_file::{self, ModuleConfig, ModuleKind, Plugin, Station};

/// Check sources or a station file
///
/// A station file is checked with its program and its plugins. With sources alone, --plugin names the plugins whose
/// blocks they call.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 check station.toml\n  ob1 check station.toml --verbose      both forms of the CPs' parameters\n  \
    ob1 check station.toml --posture      what the system grants the scan (as root it may grant more)\n  \
    ob1 check main.awl lib.awl --plugin ob1_cp240 --json\n  ob1 check plant/ --library TI-S7        a folder of sources and symbol tables\n  ob1 check --plugin ./libmine.so         the blocks of a plugin\n\n\
    Exit codes: 0 no error, 1 an error was found."
)]
pub struct CheckArgs {
    /// Sources (.awl) and symbol tables (.sdf), folders of them, or one station file (.toml)
    #[arg(required_unless_present = "plugin")]
    pub files: Vec<PathBuf>,
    /// A plugin whose blocks the sources call: a path, or a bare name like ob1_cp240
    #[arg(long, value_name = "PATH")]
    pub plugin: Vec<String>,
    /// A source of library blocks: compiled with the others, its own warnings are not shown
    #[arg(long, value_name = "FILE")]
    pub library_source: Vec<PathBuf>,
    /// A symbol table of the sources: SDF, ASC, SEQ or DIF (a station file names its own)
    #[arg(long, value_name = "FILE")]
    pub symbols: Vec<PathBuf>,
    /// Standard blocks of the sources: FC4=IEC:FC4, or a whole library: IEC
    #[arg(long, alias = "standard", value_name = "FC4=IEC:FC4,...", value_delimiter = ',', value_parser = Chosen::parse)]
    pub library: Vec<Chosen>,
    /// Keep the numbers of blocks that have a name only in this file (a station keeps them beside its file)
    #[arg(long, value_name = "FILE")]
    pub numbers: Option<PathBuf>,
    /// Show every message, not 20 of a file and 100 in all
    #[arg(long)]
    pub all_messages: bool,
    /// Also print the program: the blocks as their sources have them, with the symbols of operands given by address
    #[arg(long)]
    pub listing: bool,
    /// Also print the compiler's view of the program: blocks, layout of data, statements
    #[arg(long)]
    pub compiled: bool,
    /// With --compiled: also the machine code that the native engine makes of each block, and its bytes by statement
    #[arg(long, requires = "compiled")]
    pub native: bool,
    /// Look for the classic porting traps too
    #[arg(long)]
    pub lints: bool,
    /// Mnemonics of the sources (a station file has its own key); with --listing and a station file, of the listing
    #[arg(long, value_enum, default_value_t = Language::Auto)]
    pub mnemonics: Language,
    /// Findings as a JSON array
    #[arg(long)]
    pub json: bool,
    /// Ask the system for what the station file wants for its scan, and say what was granted, what was refused, and the
    /// command that would grant it
    #[arg(long, conflicts_with_all = ["plugin", "listing", "compiled", "lints"])]
    pub posture: bool,
    /// Also print modules, and the parameters of CPs as keys and as bytes
    #[arg(long, short)]
    pub verbose: bool,
}

impl CheckArgs {
    /// The options that are for sources only, and whether they were given.
    fn for_sources(&self) -> [(&'static str, bool); 6] {
        [
            ("--plugin", !self.plugin.is_empty()),
            ("--library-source", !self.library_source.is_empty()),
            ("--symbols", !self.symbols.is_empty()),
            ("--library", !self.library.is_empty()),
            ("--numbers", self.numbers.is_some()),
            ("--mnemonics", !self.listing && self.mnemonics.wanted().is_some()),
        ]
    }
}

/// An option for sources that is given with a station file, where it would have no effect.
pub(crate) fn misplaced(station: &Path, options: &[(&str, bool)]) -> Option<Finding> {
    let (option, _) = options.iter().find(|(_, given)| *given)?;
    let message = format!("{option} is for sources, and this is a station file");
    let remedy = "write it into the station file (docs/station-file.md), or name the sources instead";
    Some(Finding::whole(Level::Error, MISPLACED, &station.display().to_string(), message, remedy))
}

/// What a check has found, and the text it prints about what is right.
#[derive(Debug, Default)]
struct Checked {
    findings: Vec<Finding>,
    text: String,
}

/// Asks the system for the posture of a station's scan and prints what became of it.
fn posture(files: &[PathBuf], json: bool) -> Exit {
    let [file] = files else {
        err!("ob1: --posture takes one station file");
        return Exit::Usage;
    };
    match ob1_station_file::load(file) {
        Ok(station) => posture::check(&station, json),
        Err(findings) => {
            findings.iter().for_each(|finding| err!("{finding}"));
            Exit::Usage
        }
    }
}

/// Runs `ob1 check`: prints the findings, and says how it ended.
pub fn check(args: &CheckArgs) -> Exit {
    if args.posture {
        return posture(&args.files, args.json);
    }
    let checked = match args.files.as_slice() {
        [file] if ob1_station_file::is_station_file(file) => match misplaced(file, &args.for_sources()) {
            Some(finding) => Checked { findings: vec![finding], ..Checked::default() },
            None => check_station(file, args),
        },
        files => check_sources(files, args),
    };
    let count = |f: &Finding| f.count;
    let errors: usize = checked.findings.iter().filter(|f| f.level == Level::Error).map(count).sum();
    let all: usize = checked.findings.iter().map(count).sum();
    if args.json {
        print_json(&checked.findings);
    } else {
        for finding in &checked.findings {
            err!("{finding}");
        }
        says!("{}", checked.text);
        say!("{}", verdict(errors, all - errors));
    }
    if errors == 0 { Exit::Ok } else { Exit::Usage }
}

fn verdict(errors: usize, others: usize) -> String {
    let count = |n: usize, one: &str| if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") };
    match (errors, others) {
        (0, 0) => "ok".into(),
        (0, _) => format!("ok, {}", count(others, "warning")),
        (_, 0) => count(errors, "error"),
        _ => format!("{}, {}", count(errors, "error"), count(others, "warning")),
    }
}

/// Sources with the plugins and libraries of the command line.
fn check_sources(files: &[PathBuf], args: &CheckArgs) -> Checked {
    if let Some(finding) = program::station_among_sources(files) {
        return Checked { findings: vec![finding], ..Checked::default() };
    }
    let plugins: Vec<Plugin> = args.plugin.iter().map(|name| Plugin::of_name(name)).collect();
    let loaded = match plugins::load(&plugins) {
        Ok(loaded) => loaded,
        Err(findings) => return Checked { findings, ..Checked::default() },
    };
    let mut text = String::new();
    if files.is_empty() || args.verbose {
        for (plugin, _) in &loaded {
            describe_plugin(&mut text, plugin.info());
        }
    }
    let standard = Chosen::settled(&args.library);
    let library = standard.and_then(|standard| Ok((program::library(&loaded, &standard)?, standard)));
    let (library, standard) = match library {
        Ok(both) => both,
        Err(findings) => return Checked { findings, text },
    };
    let sources = Sources {
        files: args.library_source.iter().chain(files).cloned().collect(),
        symbols: args.symbols.clone(),
        mnemonics: args.mnemonics.into(),
        library: standard,
        lints: args.lints,
        numbers: args.numbers.clone(),
        all_messages: args.all_messages,
        ..Sources::default()
    };
    let mut findings = match program::compile(&sources, &library) {
        Ok(compiled) => {
            text += &numbers::note(&compiled.numbers, args.numbers.as_deref());
            if args.listing {
                text += &sources_text(&compiled.program, &library, Language::Auto);
            }
            if args.compiled {
                text += &ob1_stl::listing(&compiled.program);
            }
            if args.native {
                let standard = program::in_use(&compiled.program, &sources.library, &compiled.demanded);
                text += &machine_code(&compiled.program, &standard);
            }
            compiled.findings
        }
        Err(findings) => findings,
    };
    let of_library = |f: &Finding| args.library_source.iter().any(|path| path.display().to_string() == f.file);
    findings.retain(|f| f.level == Level::Error || !of_library(f));
    Checked { findings, text }
}

/// The program as its sources have it.
fn sources_text(program: &ob1_ir::Program, library: &ob1_stl::Library, language: Language) -> String {
    let read = |file: &str| {
        Some(ob1_stl::Source::new(file, ob1_process::files::read(Path::new(file), ob1_process::files::LONGEST).ok()?))
    };
    let all = ob1_stl::CrossReference::new(program, library);
    source_view::text(&source_view::view(&all, library, &read, language.wanted()), program)
}

fn describe_plugin(text: &mut String, info: &ob1_host::plugin::PluginInfo) {
    let _ = writeln!(text, "plugin {} {}, interface {}.{}", info.name, info.version, info.abi.0, info.abi.1);
    for block in &info.blocks {
        let _ = writeln!(text, "  {} {}", block.id, block.name);
        for param in block.interface.formals() {
            let section = match param.section {
                Section::Input => "in",
                Section::Output => "out",
                Section::InOut => "in_out",
                Section::Return => "ret",
                Section::Static | Section::Temp => continue,
            };
            let _ = writeln!(text, "    {section:<7} {:<16} {}", param.name, param.ty.name());
        }
    }
}

/// A station with its program, plugins, stimulus; loaded into a CPU to find what does not fit together.
fn check_station(path: &Path, args: &CheckArgs) -> Checked {
    let (station, mut devices) = match ob1_station::look::load(path) {
        Ok((mut station, devices)) => {
            station.program.lints |= args.lints;
            station.program.all_messages |= args.all_messages;
            (station, devices)
        }
        Err(findings) => return Checked { findings, ..Checked::default() },
    };
    if let Some(starves) = posture::starves(&station, &ob1_rt::isolated_cores(), &path.display().to_string()) {
        return Checked { findings: vec![starves], ..Checked::default() };
    }
    let mut text = if args.verbose { describe(&station) } else { String::new() };
    let mut findings = match check_program(&station) {
        Ok((loaded, cpu)) => {
            text += &numbers::note(&loaded.numbers, station.program.numbers.as_deref());
            if args.listing {
                let library = program::library(&loaded.plugins, &loaded.standard).unwrap_or_default();
                text += &sources_text(&loaded.program, &library, args.mnemonics);
            }
            if args.compiled {
                text += &ob1_stl::listing(&loaded.program);
            }
            if args.native {
                text += &compiling::listing(cpu.plan()).unwrap_or_else(|why| format!("no machine code: {why}\n"));
            }
            loaded.findings
        }
        Err(findings) => findings,
    };
    findings.append(&mut devices);
    Checked { findings, text }
}

/// What keeps a station from starting: the errors that a check of its file finds.
pub(crate) fn station_errors(path: &Path) -> Vec<Finding> {
    let mut found = match ob1_station::look::load(path) {
        Ok((station, devices)) => {
            let program = check_program(&station).map_or_else(|findings| findings, |(loaded, _)| loaded.findings);
            [program, devices].concat()
        }
        Err(findings) => findings,
    };
    found.retain(|finding| finding.level == Level::Error);
    found
}

/// The machine code of sources without a station.
fn machine_code(program: &ob1_ir::Program, standard: &[Choice]) -> String {
    let natives = program::native_standard_blocks(standard);
    let cpu = Cpu::new(
        CpuConfig::default(),
        program,
        natives,
        Vec::new(),
        ob1_station::engine::factory(EngineChoice::Reference),
    );
    let listing = cpu.map_err(|errors| LoadError::together(&errors)).and_then(|cpu| compiling::listing(cpu.plan()));
    listing.unwrap_or_else(|why| format!("no machine code: {why}\n"))
}

fn check_program(station: &Station) -> Result<(Loaded, Cpu), Vec<Finding>> {
    let stimulus = match &station.stimulus {
        Some((path, place)) => Stimulus::load(path, place)?,
        None => Stimulus::default(),
    };
    let loaded = program::load(station)?;
    let seen: Vec<_> = station.modules.iter().map(assembly::plugin_module).collect();
    let natives = loaded.native_blocks(&seen)?;
    let io = ProcessIo::new(ob1_backplane::IoImage::heap(), stimulus);
    let modules =
        station.modules.iter().filter_map(|m| Some((assembly::slot(m), dummy(&io, &station.name, m)?))).collect();
    let cpu = assembly::load_cpu(station.cpu.clone(), (&loaded, &loaded.program), natives, modules, station.engine)
        .map_err(|failure| [failure.into(), loaded.findings.clone()].concat())?;
    Ok((loaded, cpu))
}

/// A module over memory of this process, without a driver.
pub(crate) fn dummy(io: &ProcessIo, station: &str, config: &ModuleConfig) -> Option<Box<dyn Module>> {
    let Some(settings) = assembly::cp_settings(station, config, None) else { return io.module(config, false) };
    let make = if settings.boxes { ob1_backplane::Segment::heap_with_boxes } else { ob1_backplane::Segment::heap };
    let segment = make();
    let side = ob1_backplane::CpuSide::create(&segment, usize::from(config.input_bytes())).ok()?;
    let link = Box::new(ob1_host::module::AlwaysThere);
    Some(Box::new(ob1_host::module::CpModule::new(side, link, settings).ok()?))
}

/// `256..271`.
fn span(first: u32, len: u16) -> String {
    format!("{first}..{}", first + u32::from(len) - 1)
}

/// Where the registers of a CP lie.
fn both(module: &ModuleConfig) -> String {
    let inputs = span(module.input_address, module.input_bytes());
    format!("inputs {inputs}, outputs {}", span(module.output_address, module.output_bytes()))
}

/// Parameters as a station file has them.
fn written(keys: &[(&'static str, Value)]) -> String {
    keys.iter().map(|(key, value)| format!("{key} = {value}")).collect::<Vec<_>>().join(", ")
}

/// The modules, and both forms of the parameters of each CP.
fn describe(station: &Station) -> String {
    let mut text = String::new();
    for module in &station.modules {
        match &module.kind {
            ModuleKind::Inputs { bytes, .. } => {
                let _ = writeln!(text, "{}: inputs, bytes {}", module.name, span(module.input_address, *bytes));
            }
            ModuleKind::DpMaster { bus, areas } => {
                let name = station.buses.get(*bus).map_or("", |bus| bus.name.as_str());
                let (send, receive) = (area_bytes(&areas.outputs), area_bytes(&areas.inputs));
                let at = module.input_address;
                let _ = writeln!(
                    text,
                    "{}: cp342-5 on {name}, CPLADDR {at}, DP_SEND {send} bytes, DP_RECV {receive} bytes",
                    module.name
                );
            }
            ModuleKind::Remote { bus, .. } => {
                let bus = station.buses.get(*bus).map_or("", |bus| bus.name.as_str());
                let _ = write!(text, "{}: coupler on {bus}", module.name);
                if module.input_bytes() == 0 && module.output_bytes() == 0 {
                    let _ = write!(text, ", diagnostic address {}", module.input_address);
                }
                for (what, first, len) in [
                    ("inputs", module.input_address, module.input_bytes()),
                    ("outputs", module.output_address, module.output_bytes()),
                ] {
                    if len > 0 {
                        let _ = write!(text, ", {what} {}", span(first, len));
                    }
                }
                text.push('\n');
            }
            ModuleKind::Outputs { bytes, .. } => {
                let _ = writeln!(text, "{}: outputs, bytes {}", module.name, span(module.output_address, *bytes));
            }
            ModuleKind::Cp240 { bytes, line, .. } | ModuleKind::Cp040 { bytes, line, .. } => {
                let (name, keys) = match &module.kind {
                    ModuleKind::Cp040 { params, .. } => (CpKind::Cp040.name(), params.to_keys()),
                    ModuleKind::Cp240 { params, .. } => (CpKind::Cp240.name(), params.to_keys()),
                    _ => continue,
                };
                let _ = writeln!(text, "{}: {name}, {}, line {line}", module.name, both(module));
                if let ModuleKind::Cp240 { params, .. } = &module.kind
                    && params.interface != Interface::Rs232
                {
                    let _ = writeln!(text, "  interface = \"{}\"", params.interface.name());
                }
                let _ = writeln!(text, "  raw = \"{}\"", crate::units::hex(bytes.as_slice()));
                let _ = writeln!(text, "  params = {{ {} }}", written(&keys));
            }
            ModuleKind::Ethernet { .. } => {
                let _ = writeln!(text, "{}: cp343, {}", module.name, both(module));
            }
            ModuleKind::Keyed { params, line, .. } => {
                let _ = writeln!(text, "{}: {}, {}, line {line}", module.name, params.kind.name(), both(module));
                let _ = writeln!(text, "  params = {{ {} }}", written(params.to_keys()));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use ob1_host::plugin::{BlockInfo, PluginInfo};
    use ob1_model::{BlockId, BlockKind, DataType, Interface, Param};

    use super::*;

    #[test]
    fn a_plugin_is_described_with_its_function_values() {
        let param = |(name, section)| Param::new(name, section, DataType::Int);
        let params =
            [("A", Section::Input), ("RET_VAL", Section::Return), ("B", Section::Output), ("C", Section::InOut)];
        let interface = Interface { params: params.map(param).to_vec(), ..Interface::default() };
        let block = BlockInfo { id: BlockId::new(BlockKind::Fc, 7), name: "SEVEN".into(), interface };
        let info = PluginInfo { name: "p".into(), version: "1".into(), abi: (1, 0), blocks: vec![block] };
        let mut text = String::new();
        describe_plugin(&mut text, &info);
        let rows: Vec<Vec<&str>> = text.lines().skip(2).map(|line| line.split_whitespace().collect()).collect();
        assert_eq!(rows, [["in", "A", "INT"], ["ret", "RET_VAL", "INT"], ["out", "B", "INT"], ["in_out", "C", "INT"]]);
    }
}
