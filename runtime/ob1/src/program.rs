//! From a station's files to a program: plugins are loaded, their blocks told to the compiler, sources compiled.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ob1_cpu::NativeBlock;
use ob1_host::plugin::{Plugin, PluginError, PluginModule};
use ob1_ir::Program;
use ob1_model::{BlockId, BlockKind};
use ob1_stl::{Library, Options, Severity, Source};

use crate::finding::{Finding, Level};
use crate::library::Choice;
use crate::offer;
use crate::station::{self, Mnemonics, Station};

/// What a station's files give.
#[derive(Debug)]
pub struct Loaded {
    /// The program.
    pub program: Program,
    /// The plugins and the renumbering of their blocks.
    pub plugins: Vec<(Arc<Plugin>, BTreeMap<BlockId, BlockId>)>,
    /// Standard blocks of libraries.
    pub standard: Vec<Choice>,
    /// Warnings and lints.
    pub findings: Vec<Finding>,
}

/// Why they give nothing.
#[derive(Debug)]
pub enum LoadFailure {
    /// A plugin was refused.
    Plugin(Vec<Finding>),
    /// A source or the program was rejected.
    Rejected(Vec<Finding>),
}

impl LoadFailure {
    /// What was found.
    #[must_use]
    pub fn findings(&self) -> &[Finding] {
        match self {
            LoadFailure::Plugin(findings) | LoadFailure::Rejected(findings) => findings,
        }
    }
}

/// Where plugins with a bare name are looked for, in this order: `OB1_PLUGIN_DIR`, the folder of the executable,
/// `../lib/ob1` beside it.
#[must_use]
pub fn plugin_folders() -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = std::env::var_os("OB1_PLUGIN_DIR").map(PathBuf::from).into_iter().collect();
    if let Some(beside) = std::env::current_exe().ok().as_deref().and_then(Path::parent) {
        folders.push(beside.to_owned());
        folders.push(beside.join("../lib/ob1"));
    }
    folders
}

/// Loads plugins and compiles the sources of a station.
///
/// # Errors
/// [`LoadFailure`], with everything that was found.
pub fn load(station: &Station) -> Result<Loaded, LoadFailure> {
    let plugins = load_plugins(&station.plugins).map_err(LoadFailure::Plugin)?;
    let library = library(&plugins, &station.program.library).map_err(LoadFailure::Rejected)?;
    let (program, mut findings) = compile(&station.program, &library).map_err(LoadFailure::Rejected)?;
    let of_plugins = plugins.iter().flat_map(|(plugin, renumber)| {
        plugin.info().blocks.iter().map(|block| renumber.get(&block.id).copied().unwrap_or(block.id))
    });
    findings.extend(without_ob1(&program, of_plugins));
    Ok(Loaded { program, plugins, standard: station.program.library.clone(), findings })
}

/// Number of the finding of [`without_ob1`].
pub(crate) const NO_OB1: &str = "L021";

/// A program without OB 1 can be run, but nearly never is meant to be.
pub(crate) fn without_ob1(program: &Program, natives: impl IntoIterator<Item = BlockId>) -> Option<Finding> {
    let ob1 = BlockId::new(BlockKind::Ob, 1);
    if program.blocks.iter().any(|block| block.id == ob1) || natives.into_iter().any(|id| id == ob1) {
        return None;
    }
    let file = program.sources.first().map_or("program", String::as_str);
    let message = "the program has no OB 1: in RUN nothing is executed cyclically";
    let remedy = "add ORGANIZATION_BLOCK OB 1, or name the source that has it";
    Some(Finding::whole(Level::Warning, NO_OB1, file, message, remedy))
}

impl Loaded {
    /// The native blocks for one CPU: the system blocks and those of the plugins, with memory for each of the
    /// `modules`.
    ///
    /// # Errors
    /// As [`load`]: a renumbering that cannot be.
    pub fn native_blocks(&self, modules: &[PluginModule]) -> Result<Vec<Box<dyn NativeBlock>>, LoadFailure> {
        let mut blocks = native_standard_blocks(&self.standard);
        for (plugin, renumber) in &self.plugins {
            let of_plugin = plugin.station(renumber, modules).map_err(|e| LoadFailure::Plugin(vec![of_error(&e)]))?;
            blocks.extend(of_plugin);
        }
        Ok(blocks)
    }
}

type Plugins = Vec<(Arc<Plugin>, BTreeMap<BlockId, BlockId>)>;

/// Loads the plugins of a list.
///
/// # Errors
/// One finding for each that was refused.
pub fn load_plugins(plugins: &[station::Plugin]) -> Result<Plugins, Vec<Finding>> {
    let mut loaded = Vec::new();
    let mut refused = Vec::new();
    for config in plugins {
        let Some(path) = find_plugin(config) else {
            refused.push(not_found(config));
            continue;
        };
        match Plugin::load(&path) {
            Ok(plugin) => loaded.push((plugin, config.blocks.iter().copied().collect())),
            Err(error) => refused.push(of_error(&error)),
        }
    }
    if refused.is_empty() { Ok(loaded) } else { Err(refused) }
}

fn file_name(config: &station::Plugin) -> String {
    format!("lib{}.so", config.name)
}

fn find_plugin(config: &station::Plugin) -> Option<PathBuf> {
    if config.path.is_some() {
        return config.path.clone();
    }
    plugin_folders().into_iter().map(|folder| folder.join(file_name(config))).find(|path| path.exists())
}

fn not_found(config: &station::Plugin) -> Finding {
    let searched = plugin_folders().iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ");
    let remedy = format!("looked for {} in {searched}; set OB1_PLUGIN_DIR, or give a path with a /", file_name(config));
    Finding::whole(Level::Error, "P001", &config.name, "the plugin cannot be found", remedy)
}

fn of_error(error: &PluginError) -> Finding {
    let file = error.path.display().to_string();
    Finding::whole(Level::Error, error.refusal.number(), &file, error.refusal.to_string(), error.refusal.remedy())
}

/// The blocks of the CPU itself, and the standard blocks a program has chosen.
#[must_use]
pub fn native_standard_blocks(standard: &[Choice]) -> Vec<Box<dyn NativeBlock>> {
    let mut blocks = ob1_cpu::system_blocks();
    let chosen = standard.iter().filter_map(|choice| Some((choice.id, choice.block()?)));
    // A declared block is a plugin's business.
    let ours = chosen.filter(|(_, block)| !block.origin.is_declared_only());
    blocks.extend(ours.map(|(id, block)| ob1_cpu::standard_block(id, block)));
    blocks
}

/// What the compiler is told of system blocks, standard blocks and plugins.
///
/// # Errors
/// Two plugins that bring the same block.
pub fn library(
    plugins: &[(Arc<Plugin>, BTreeMap<BlockId, BlockId>)],
    standard: &[Choice],
) -> Result<Library, Vec<Finding>> {
    let mut library = Library::new();
    offer::explain_missing(&mut library);
    for block in ob1_std::system_functions(ob1_cpu::SERVICES) {
        library.insert(block.id, block.name, block.interface);
    }
    let mut declared = BTreeMap::new();
    for choice in standard {
        if let Some(block) = choice.block() {
            if block.origin.is_declared_only() {
                declared.insert(choice.id, block.name);
            }
            library.insert(choice.id, block.name, block.interface);
        }
    }
    let mut twice = Vec::new();
    for (plugin, renumber) in plugins {
        for block in &plugin.info().blocks {
            let id = renumber.get(&block.id).copied().unwrap_or(block.id);
            let before = library.insert(id, &block.name, block.interface.clone());
            // A plugin that serves what is declared under this number is what the declaration is for.
            let serves = declared.remove(&id).is_some_and(|name| name.eq_ignore_ascii_case(&block.name));
            if before.is_some() && !serves {
                let file = plugin.path().display().to_string();
                let message = format!("{id} is brought by another plugin or library already");
                let remedy = format!("renumber it: blocks = {{ \"{}\" = \"{} 100\" }}", block.id, id.kind.name());
                twice.push(Finding::whole(Level::Error, "L002", &file, message, remedy));
            }
        }
    }
    if twice.is_empty() { Ok(library) } else { Err(twice) }
}

/// What is compiled together, and how it is read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sources {
    /// The sources.
    pub files: Vec<PathBuf>,
    /// Symbol tables.
    pub symbols: Vec<PathBuf>,
    /// Mnemonics of the sources.
    pub mnemonics: Mnemonics,
    /// Standard blocks of libraries.
    pub library: Vec<Choice>,
    /// Look for the classic porting traps too.
    pub lints: bool,
}

/// Reads and compiles sources.
///
/// # Errors
/// Everything that was found, when there is an error in it.
pub fn compile(wanted: &Sources, library: &Library) -> Result<(Program, Vec<Finding>), Vec<Finding>> {
    let mut findings = Vec::new();
    let sources = read_all(&wanted.files, &mut findings);
    compile_texts(&sources, wanted, library, findings)
}

/// As [`compile`], with the sources read already; `findings` is what was found so far.
pub(crate) fn compile_texts(
    sources: &[Source],
    wanted: &Sources,
    library: &Library,
    mut findings: Vec<Finding>,
) -> Result<(Program, Vec<Finding>), Vec<Finding>> {
    let mut symbols = Vec::new();
    let tables = read_all(&wanted.symbols, &mut findings);
    for (table, read) in tables.iter().zip(ob1_stl::read_symbol_tables(&tables)) {
        findings.extend(read.diagnostics.iter().map(|d| of_diagnostic(d, std::slice::from_ref(table))));
        symbols.extend(read.symbols);
    }
    let options = Options { mnemonics: wanted.mnemonics.into(), symbols, lints: wanted.lints };
    let output = ob1_stl::compile(sources, library, &options);
    findings.extend(output.diagnostics.iter().map(|diagnostic| of_diagnostic(diagnostic, sources)));
    if findings.iter().any(|f| f.level == Level::Error) { Err(findings) } else { Ok((output.program, findings)) }
}

/// Reads files; one finding for each that cannot be read.
pub(crate) fn read_all(paths: &[PathBuf], findings: &mut Vec<Finding>) -> Vec<Source> {
    let mut sources = Vec::with_capacity(paths.len());
    for path in paths {
        let name = path.display().to_string();
        match std::fs::read(path) {
            Ok(bytes) => sources.push(Source::new(name, bytes)),
            Err(error) => {
                let message = format!("the source cannot be read: {error}");
                let remedy = "paths count from the file that names them";
                findings.push(Finding::whole(Level::Error, "C001", &name, message, remedy));
            }
        }
    }
    sources
}

fn of_diagnostic(diagnostic: &ob1_stl::Diagnostic, sources: &[Source]) -> Finding {
    let level = match diagnostic.severity {
        Severity::Error => Level::Error,
        Severity::Warning => Level::Warning,
        Severity::Lint => Level::Lint,
    };
    let source = sources.get(diagnostic.source);
    Finding {
        level,
        code: diagnostic.code.into(),
        file: source.map(|s| s.name.clone()).unwrap_or_default(),
        line: diagnostic.line,
        column: diagnostic.column,
        message: diagnostic.message.clone(),
        remedy: diagnostic.remedy.clone(),
        text: source.map_or_else(|| diagnostic.message.clone(), |s| ob1_stl::render(diagnostic, s)),
    }
}
