//! From a station's files to a program: plugins are loaded, their blocks told to the compiler, sources compiled.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ob1_cpu::Natives;
use ob1_host::plugin::{Plugin, PluginModule};
use ob1_ir::Program;
use ob1_mc7::BlockImage;
use ob1_model::{BlockId, BlockKind};
use ob1_project::Image;
use ob1_std::{Origin, StandardBlock, standard_blocks};
use ob1_stl::{Library, Limit, Numbered, Options, Rest, Severity, Source};

use crate::plugins::{self, Plugins};
use crate::{area_check, handling_check, missing_blocks, numbers, recording, retentive};
use ob1_station_file::finding::{Finding, Level, Spot};
use ob1_station_file::findings::{EMPTY, MACHINE_CODE, MISPLACED, REST, UNREADABLE, unreadable};
use ob1_station_file::library::{self, Choice};
use ob1_station_file::program_files;
use ob1_station_file::sources::Sources;
use ob1_station_file::{self, Station};

/// What a station's files give.
#[derive(Debug)]
pub struct Loaded {
    /// The program of all sources.
    pub program: Arc<Program>,
    /// The plugins and the renumbering of their blocks.
    pub plugins: Plugins,
    /// Standard blocks of libraries.
    pub standard: Vec<Choice>,
    /// Warnings and lints: errors give no program.
    pub findings: Vec<Finding>,
    /// Blocks that have a name only, with the numbers they were given.
    pub numbers: Vec<Numbered>,
    /// The set of mnemonics of most sources.
    pub mnemonics: ob1_stl::Mnemonics,
}

/// Why they give no program.
#[derive(Debug)]
pub enum LoadFailure {
    /// A plugin was refused.
    Plugin(Vec<Finding>),
    /// A source or the program was rejected.
    Rejected(Vec<Finding>),
}

impl From<LoadFailure> for Vec<Finding> {
    /// What was found: at least one error.
    fn from(failure: LoadFailure) -> Self {
        match failure {
            LoadFailure::Plugin(findings) | LoadFailure::Rejected(findings) => findings,
        }
    }
}

/// Loads plugins and compiles the sources of a station.
///
/// # Errors
/// [`LoadFailure`]: plugins or sources are rejected, with everything that was found.
pub fn load(station: &Station) -> Result<Loaded, LoadFailure> {
    let plugins = plugins::load(&station.plugins).map_err(LoadFailure::Plugin)?;
    let library = library(&plugins, &station.program.library).map_err(LoadFailure::Rejected)?;
    let mut compiled = compile(&station.program, &library).map_err(LoadFailure::Rejected)?;
    let of_plugins = plugins.iter().flat_map(|(plugin, renumber)| {
        plugin.info().blocks.iter().map(|block| renumber.get(&block.id).copied().unwrap_or(block.id))
    });
    compiled.findings.extend(without_ob1(&compiled.program, of_plugins));
    let handling = handling_check::blocks_of(&plugins);
    compiled.findings.extend(handling_check::findings(&compiled.program, &handling, station));
    compiled.findings.extend(area_check::findings(&compiled.program, station));
    let wrong = recording::findings(&compiled.program, station);
    if !wrong.is_empty() {
        return Err(LoadFailure::Rejected(wrong));
    }
    if let Some(file) = &station.retentive {
        compiled.findings.extend(retentive::not_kept(&compiled.program, file));
    }
    Ok(Loaded::new(compiled, plugins, &station.program.library))
}

/// Number of the finding of [`without_ob1`].
pub const NO_OB1: &str = "L021";

/// A program without OB 1 can be run, but nearly never is meant to be.
pub fn without_ob1(program: &Program, natives: impl IntoIterator<Item = BlockId>) -> Option<Finding> {
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
    /// A compiled program with its plugins and the standard blocks chosen for it.
    #[must_use]
    pub fn new(compiled: Compiled, plugins: Plugins, chosen: &[Choice]) -> Self {
        let Compiled { program, findings, numbers, demanded, mnemonics } = compiled;
        let (standard, program) = (in_use(&program, chosen, &demanded), Arc::new(program));
        Self { standard, program, plugins, findings, numbers, mnemonics }
    }

    /// The native blocks for one CPU: the system blocks and those of the plugins, with memory for each of the
    /// `modules`.
    ///
    /// # Errors
    /// As [`load`]: an impossible renumbering.
    pub fn native_blocks(&self, modules: &[PluginModule]) -> Result<Natives, LoadFailure> {
        let mut blocks = native_standard_blocks(&self.standard);
        for (plugin, renumber) in &self.plugins {
            let mut of_plugin =
                plugin.station(renumber, modules).map_err(|e| LoadFailure::Plugin(vec![plugins::of_error(&e)]))?;
            let own: BTreeMap<BlockId, BlockId> = renumber.iter().map(|(own, given)| (*given, *own)).collect();
            of_plugin.retain(|id| library::is_of_this_cpu(own.get(&id).copied().unwrap_or(id), &self.standard));
            blocks.extend(of_plugin);
        }
        Ok(blocks)
    }
}

/// The standard blocks of a program: those chosen, except offered ones that it has itself, and those it calls by name.
#[must_use]
pub fn in_use(program: &Program, chosen: &[Choice], demanded: &[Choice]) -> Vec<Choice> {
    let own = |choice: &Choice| choice.offered && program.blocks.iter().any(|block| block.id == choice.id);
    chosen.iter().filter(|choice| !own(choice)).chain(demanded).cloned().collect()
}

/// The blocks of the CPU itself, and the standard blocks a program has chosen.
#[must_use]
pub fn native_standard_blocks(standard: &[Choice]) -> Natives {
    let mut blocks = ob1_cpu::system_blocks();
    let chosen = standard.iter().filter_map(|choice| Some((choice.id, choice.block()?)));
    // Declared blocks come from plugins.
    let ours = chosen.filter(|(_, block)| !block.origin.is_declared_only());
    blocks.extend(ours.map(|(id, block)| ob1_cpu::standard_block(id, block)));
    blocks.into()
}

/// What the compiler knows of system blocks, standard blocks and plugins.
///
/// # Errors
/// Two plugins that bring the same block.
pub fn library(
    plugins: &[(Arc<Plugin>, BTreeMap<BlockId, BlockId>)],
    standard: &[Choice],
) -> Result<Library, Vec<Finding>> {
    let mut library = Library::new();
    missing_blocks::explain_missing(&mut library);
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    let mut declared = BTreeMap::new();
    for choice in standard {
        if let Some(block) = choice.block() {
            if block.origin.is_declared_only() {
                declared.insert(choice.id, block.name);
            }
            library.insert(choice.id, block.name, block.interface);
            library.set_origin(choice.id, &format!("[library] \"{}\" = \"{}\"", choice.id, choice.key), choice.offered);
        }
    }
    let mut twice = Vec::new();
    for (plugin, renumber) in plugins {
        for block in plugin.info().blocks.iter().filter(|block| library::is_of_this_cpu(block.id, standard)) {
            let id = renumber.get(&block.id).copied().unwrap_or(block.id);
            let before = library.insert(id, &block.name, block.interface.clone());
            library.set_origin(id, &format!("the plugin {}", plugin.info().name), false);
            // A plugin that serves the block declared under this number is not a conflict: the declaration is for it.
            let serves = declared.remove(&id).is_some_and(|name| name.eq_ignore_ascii_case(&block.name));
            if before.is_some() && !serves {
                let file = plugin.path().display().to_string();
                let message = format!("{id} is already in another plugin or library");
                let remedy = format!("renumber it: blocks = {{ \"{}\" = \"{} 100\" }}", block.id, id.kind.name());
                twice.push(Finding::whole(Level::Error, "L002", &file, message, remedy));
            }
        }
    }
    if twice.is_empty() { Ok(library) } else { Err(twice) }
}

/// A compiled program and what is to be reported about it.
#[derive(Debug)]
pub struct Compiled {
    /// The program of all sources.
    pub program: Program,
    /// Warnings and lints: errors give no program.
    pub findings: Vec<Finding>,
    /// Blocks that have a name only, with the numbers they were given.
    pub numbers: Vec<Numbered>,
    /// Standard blocks that are called by name.
    pub demanded: Vec<Choice>,
    /// The set of mnemonics of most sources.
    pub mnemonics: ob1_stl::Mnemonics,
}

/// Findings that are shown of one file, and of all.
const LIMIT: Limit = Limit { file: 20, run: 100 };

/// Reads and compiles sources.
///
/// # Errors
/// Everything that was found, when there is an error in it.
pub fn compile(wanted: &Sources, library: &Library) -> Result<Compiled, Vec<Finding>> {
    if let Some(finding) = station_among_sources(&wanted.files) {
        return Err(vec![finding]);
    }
    let mut findings = Vec::new();
    let (files, symbols) = program_files::expand(&wanted.files, &wanted.symbols);
    if files.is_empty() && !wanted.files.is_empty() {
        let name = wanted.files.first().map(|f| f.display().to_string()).unwrap_or_default();
        let remedy =
            "name sources (.awl .stl .db .udt) or a folder of them; symbol tables (.sdf .asc .seq .dif) go with them";
        return Err(vec![Finding::whole(Level::Error, UNREADABLE, &name, "there is no source", remedy)]);
    }
    let folders = &wanted.files;
    let wanted = Sources { files, symbols, ..wanted.clone() };
    let level = |left: &[Source]| if left.is_empty() { Level::Error } else { Level::Warning };
    let sources = read_filled(&wanted.files, &wanted.places, level, &mut findings);
    compile_texts(&sources, &wanted, library, findings).map_err(|mut findings| {
        if findings.iter().any(|finding| ob1_stl::names_no_symbol(&finding.code)) {
            findings.extend(program_files::unread_tables(folders).iter().map(|table| unread_table(table)));
        }
        findings
    })
}

/// A tag table in a folder of sources that is not read, while symbols are missing.
fn unread_table(path: &Path) -> Finding {
    let message = "this tag table is not read; the missing symbols may be in it";
    Finding::whole(Level::Warning, UNREADABLE, &path.display().to_string(), message, ob1_stl::EXPORT_TAGS)
}

/// The finding about a station file among sources, when there is one.
#[must_use]
pub fn station_among_sources(files: &[PathBuf]) -> Option<Finding> {
    let station = files.iter().find(|file| ob1_station_file::is_station_file(file))?;
    let remedy = "a station names its own sources: give its file alone, to `ob1 run`, `ob1 check` or `ob1 xref`";
    Some(Finding::whole(
        Level::Error,
        MISPLACED,
        &station.display().to_string(),
        "a station file among sources",
        remedy,
    ))
}

/// As [`compile`], with the sources read already; `findings` is what was found so far.
pub fn compile_texts(
    sources: &[Source],
    wanted: &Sources,
    library: &Library,
    mut findings: Vec<Finding>,
) -> Result<Compiled, Vec<Finding>> {
    let mut symbols = Vec::new();
    let tables = read_filled(&wanted.symbols, &wanted.places, |_| Level::Warning, &mut findings);
    for (table, read) in tables.iter().zip(ob1_stl::read_symbol_tables(&tables)) {
        findings.extend(read.diagnostics.iter().map(|d| of_diagnostic(d, std::slice::from_ref(table))));
        symbols.extend(read.symbols);
    }
    let kept = wanted.numbers.as_deref().map_or(Ok(Vec::new()), numbers::read)?;
    let fixed = wanted.fixed.iter().map(|(name, id)| Numbered { name: name.clone(), id: *id }).collect();
    let limit = (!wanted.all_messages).then_some(LIMIT);
    let options = Options { mnemonics: wanted.mnemonics.into(), symbols, lints: wanted.lints, fixed, kept, limit };
    let images = read_images(wanted, &mut findings);
    let mut output = ob1_scl::compile(sources, library, &options);
    let mut library = Cow::Borrowed(library);
    if !images.is_empty() {
        let declared: BTreeSet<BlockId> = output.program.blocks.iter().map(|block| block.id).collect();
        let stands = |id| declared.contains(&id);
        if images.iter().filter_map(Image::id).any(|id| id.kind != BlockKind::Db && !stands(id)) {
            ob1_project::announce(&images, &stands, library.to_mut());
            output = ob1_scl::compile(sources, &library, &options);
        }
    }
    if let Err(refused) = ob1_project::overlay(&mut output.program, &images, &library) {
        let remedy = "import it again from the project, or leave it out of `mc7`";
        findings.extend(refused.iter().map(|r| Finding::whole(Level::Error, MACHINE_CODE, &r.file, &r.reason, remedy)));
    }
    findings.extend(output.diagnostics.iter().map(|diagnostic| of_diagnostic(diagnostic, sources)));
    findings.extend(of_rest(&output.rest));
    if findings.iter().any(|f| f.level == Level::Error) {
        return Err(findings);
    }
    if let Some(path) = &wanted.numbers {
        findings.extend(numbers::write(path, &options.kept, &output.numbers));
    }
    let demanded = output.demanded.iter().filter_map(demanded_choice).collect();
    let mnemonics = ob1_stl::most(&output.mnemonics);
    Ok(Compiled { program: output.program, findings, numbers: output.numbers, demanded, mnemonics })
}

/// A standard block that a program calls by its name.
fn demanded_choice(called: &Numbered) -> Option<Choice> {
    let is_it = |block: &&StandardBlock| {
        block.origin != Origin::System
            && !block.origin.is_declared_only()
            && block.name.eq_ignore_ascii_case(&called.name)
    };
    let key = standard_blocks().iter().find(is_it)?.key();
    Some(Choice { id: called.id, key, offered: false })
}

/// The findings beyond the limit: how many in all, and how many of each number.
fn of_rest(rest: &Rest) -> Option<Finding> {
    let count = rest.count();
    if count == 0 {
        return None;
    }
    let title = |code: &str| ob1_stl::messages::ALL.iter().find(|c| c.number == code).map_or("", |c| c.title);
    let mut kinds: Vec<(&str, usize)> = rest.by_code.iter().map(|(code, n)| (*code, *n)).collect();
    kinds.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    let mut text = format!("and {count} more:\n");
    for (code, n) in &kinds {
        text.push_str(&format!("  {n:>6} {code} {}\n", title(code)));
    }
    text.push_str("  = --all-messages shows every one\n");
    let kinds: Vec<String> = kinds.iter().map(|(code, n)| format!("{n} {code}")).collect();
    let level = if rest.errors > 0 { Level::Error } else { Level::Lint };
    let message = format!("and {count} more: {}", kinds.join(", "));
    let finding = Finding::whole(level, REST, "", message, "--all-messages shows every one");
    Some(Finding { text, count, ..finding })
}

/// Reads blocks in machine code: a file may hold several, one after another.
fn read_images(wanted: &Sources, findings: &mut Vec<Finding>) -> Vec<Image> {
    let mut images = Vec::new();
    // A block whose machine code is lost would do nothing.
    for file in read_filled(&wanted.mc7, &wanted.places, |_| Level::Error, findings) {
        let mut rest = file.bytes.as_slice();
        while !rest.is_empty() {
            match BlockImage::read(rest) {
                Ok((block, length)) => {
                    images.push(Image { file: file.name.clone(), block });
                    rest = rest.get(length..).unwrap_or_default();
                }
                Err(error) => {
                    let remedy =
                        "a .mc7 holds blocks as a CPU does: head, code, interface, segments, foot (docs/import.md)";
                    findings.push(Finding::whole(Level::Error, MACHINE_CODE, &file.name, error.to_string(), remedy));
                    break;
                }
            }
        }
    }
    images
}

/// As [`read_all`], without the files that have nothing in them, because a copy broke off or a disk was full. Each of
/// these is a finding; `level` decides by the other files how grave it is.
fn read_filled(
    paths: &[PathBuf],
    places: &[(PathBuf, Spot)],
    level: impl Fn(&[Source]) -> Level,
    findings: &mut Vec<Finding>,
) -> Vec<Source> {
    let (empty, filled): (Vec<_>, Vec<_>) = read_all(paths, places, findings).into_iter().partition(is_empty);
    let (level, remedy) = (level(&filled), "copy it again, or leave it out");
    findings.extend(empty.iter().map(|file| Finding::whole(level, EMPTY, &file.name, "the file is empty", remedy)));
    filled
}

/// Whether its text is nothing but white space, or the zeros of a file whose content never reached the disk.
fn is_empty(file: &Source) -> bool {
    file.text().chars().all(|c| c.is_whitespace() || c == '\0')
}

/// Reads files; one finding for each that cannot be read.
pub fn read_all(paths: &[PathBuf], places: &[(PathBuf, Spot)], findings: &mut Vec<Finding>) -> Vec<Source> {
    let mut sources = Vec::with_capacity(paths.len());
    for path in paths {
        let name = path.display().to_string();
        match ob1_process::files::read(path, ob1_process::files::LONGEST) {
            Ok(bytes) => sources.push(Source::new(name, bytes)),
            Err(error) => {
                let place = places.iter().find(|(named, _)| named == path);
                findings.push(match place {
                    Some((_, place)) => unreadable(place, path, &error),
                    None => named_nowhere(&name, &error),
                });
            }
        }
    }
    sources
}

/// The finding about a file of the command line, or within a folder, that cannot be read.
fn named_nowhere(name: &str, error: &io::Error) -> Finding {
    let remedy = match error.kind() {
        ErrorKind::NotFound => {
            "paths of the command line count from the current folder, those in a file from its folder"
        }
        ErrorKind::PermissionDenied => "make it readable for this user",
        _ => "name a source, or a symbol table",
    };
    Finding::whole(Level::Error, UNREADABLE, name, format!("the file cannot be read: {error}"), remedy)
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
        count: 1,
        text: source.map_or_else(|| diagnostic.message.clone(), |s| ob1_stl::render(diagnostic, s)),
    }
}
