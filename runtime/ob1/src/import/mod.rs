//! `ob1 import`: a STEP 7 project becomes a station that runs.

mod block_files;
mod disk;
mod download;
mod hardware;
mod names;
mod output;
mod profibus;
mod replace;
mod report;
mod scl;
mod station;
mod upload;
mod used;
mod wire;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use ob1_ir::Symbol;
use ob1_mc7::CompiledInterface;
use ob1_model::{BlockId, BlockKind};
use ob1_project::{
    Choice, CodePage, FileSource, Folder, Language, Notes, Project, Root, SclSource, SymbolRow, Translation, Tree,
    Wanted, scl_sources, translate,
};
use ob1_stl::Library;
use ob1_stl::print::{Declared, Heading, Listing, Printer};
use serde_json::json;

use crate::diff::Side;
use crate::exit::ImportExit;
use profibus::GsdFiles;

pub use download::{DownloadArgs, download};
pub use upload::{CompareArgs, UploadArgs, compare, upload};

pub(crate) use block_files::is_machine_code;
pub(crate) use upload::{program_of_blocks, program_of_cpu};
pub(crate) use wire::{CpuArgs, Socket, Unit, observe};

/// Make a station of a STEP 7 project
///
/// Reads a project or library of STEP 7 V5: its folder, its .s7p or .s7l, or a .zip of it. The sources need not be in
/// it: STL is made from the machine code, and compared with it. The station runs as it is; report.txt says what was
/// replaced, assumed or left out, and why.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 import plant.zip --list\n  ob1 import plant/ --program \"CPU 315-2 DP\" --out press\n  ob1 run press/station.toml\n  \
    ob1 import plant/ --listing FC5\n  \
    ob1 import press/ --names-from old.s7p --out named\n\n\
    Exit codes: 0 the whole program was imported, 1 blocks were left out or the\nstation does not start yet, 2 nothing could be read or written.\n\nMore: docs/import.md."
)]
pub struct ImportArgs {
    /// The project: its folder, its .s7p or .s7l, or a .zip of it; or a folder of blocks out of a CPU (.mc7)
    pub project: PathBuf,
    /// The program: its name, its CPU's or its station's, STATION/CPU/PROGRAM, or the number of its block folder; of
    /// --names-from where that is given
    #[arg(long, value_name = "NAME")]
    pub program: Option<String>,
    /// Where the station is written: a folder that is not there yet, or is empty
    #[arg(long, value_name = "DIR", required_unless_present_any = ["list", "listing"])]
    pub out: Option<PathBuf>,
    /// Write over a station that lies there already
    #[arg(long, requires = "out")]
    pub overwrite: bool,
    /// The GSD files of its DP slaves: a folder; with them slaves become [[bus]] and [[module]]
    #[arg(long, value_name = "DIR", requires = "out")]
    pub gsd: Option<PathBuf>,
    /// Of blocks out of a CPU (.mc7): an old project of the plant, for its names, symbols and comments
    #[arg(long, value_name = "PROJECT", requires = "out")]
    pub names_from: Option<PathBuf>,
    /// Run the project's SCL sources in the place of the machine code, where they compile and declare the same
    /// interface; without it they lie beside the station
    #[arg(long, requires = "out")]
    pub scl: bool,
    /// Draw the networks, too: drawings/FC_5.txt beside the blocks
    #[arg(long, requires = "out")]
    pub drawings: bool,
    /// Print the programs and their blocks, write nothing
    #[arg(long, conflicts_with_all = ["out", "listing"])]
    pub list: bool,
    /// Print a block or a UDT as STL, write nothing
    #[arg(long, value_name = "BLOCK", conflicts_with = "out")]
    pub listing: Option<String>,
    /// Mnemonics of the sources that are made
    #[arg(long, value_enum, default_value_t = crate::language::Language::Auto, hide_default_value = true)]
    pub mnemonics: crate::language::Language,
    /// The Windows code page of the project's texts, if they come out wrong: 1251
    #[arg(long, value_name = "NUMBER", value_parser = code_page)]
    pub code_page: Option<CodePage>,
    /// Print the outcome as JSON: programs, program, blocks, decoded, left_out, files, errors
    #[arg(long)]
    pub json: bool,
}

fn code_page(text: &str) -> Result<CodePage, String> {
    text.parse().ok().and_then(CodePage::of_number).ok_or_else(|| {
        let numbers: Vec<String> = CodePage::numbers().map(|number| number.to_string()).collect();
        format!("it is one of {}", numbers.join(", "))
    })
}

/// The set of mnemonics of what is made, if none is asked for.
pub(crate) const INTERNATIONAL: ob1_stl::Mnemonics = ob1_stl::Mnemonics::International;

/// A station is named after the folder that it is written to.
pub(crate) fn station_name(out: &Path) -> Option<String> {
    Some(out.file_name()?.to_string_lossy().into_owned())
}

/// What is taken of a project.
struct Taken {
    project: Project,
    choice: Choice,
    title: String,
    folder: Folder,
}

/// Imports, lists or prints; prints what there is to print.
pub fn import(args: &ImportArgs) -> ImportExit {
    match run(args) {
        Ok(exit) => exit,
        Err(text) => {
            if args.json {
                say!("{}", outcome(&[], None, &Translation::default(), None));
            }
            err!("ob1: {text}");
            ImportExit::Nothing
        }
    }
}

/// The projects at a place, and the titles of their programs.
fn projects(
    path: &Path,
    source: &dyn FileSource,
    tree: &Tree<'_>,
    page: Option<CodePage>,
) -> Result<(Vec<Project>, Vec<String>), String> {
    let mut roots = tree.roots();
    // A .s7p stands for its own folder, whatever projects lie below it.
    if disk::is_project_file(path) && roots.iter().any(|root| root.folder.is_empty()) {
        roots.retain(|root| root.folder.is_empty());
    }
    if roots.is_empty() {
        let other = |path: String| disk::other(&path).map(|what| format!("; {path} is {what}"));
        return Err(format!(
            "{}: there is no STEP 7 project in it (no .s7p, no .s7l, no ombstx/offline){}",
            path.display(),
            source.paths().into_iter().find_map(other).unwrap_or_default()
        ));
    }
    let mut projects: Vec<Project> = roots.iter().map(|root: &Root| Project::read_as(tree, root, page)).collect();
    tell_apart(&mut projects, &roots);
    let titles = projects.iter().flat_map(|p| p.choices().into_iter().map(|c| title(p, c, projects.len()))).collect();
    Ok((projects, titles))
}

/// The program of a project.
///
/// # Errors
/// Why there is none, or which of several must be named.
pub(crate) fn program_of_project(path: &Path, name: Option<&str>) -> Result<Side, String> {
    let (taken, rows) = taken_of(path, name)?;
    let (_, library, translation) =
        translated(&taken.folder, taken.project.page, output::symbol_table(&rows).1, INTERNATIONAL)?;
    Ok(side(path.display().to_string(), &taken.folder, &translation, library))
}

/// A program of a project with its symbols.
fn taken_of(path: &Path, name: Option<&str>) -> Result<(Taken, Vec<SymbolRow>), String> {
    let source = disk::open(path)?;
    let tree = Tree::new(&*source);
    let (projects, titles) = projects(path, &*source, &tree, None)?;
    let taken = take(name, &tree, projects, &titles)?;
    let rows = taken.project.symbols(&tree, taken.choice, &mut Notes::new());
    Ok((taken, rows))
}

/// A translated folder, with the sources made of its blocks.
fn side(title: String, folder: &Folder, translation: &Translation, library: Library) -> Side {
    let drawn = folder.blocks.iter().filter(|(_, block)| matches!(block.language, Language::Lad | Language::Fbd));
    let lined = |block: &ob1_project::Block| block.comments.networks.iter().map(|n| !n.lines.is_empty()).collect();
    let made = drawn.map(|(id, block)| (*id, (block.language, lined(block)))).collect();
    let sources = folder.blocks.iter().filter(|(_, block)| !block.know_how).filter_map(|(id, _)| {
        let file = format!("{}_{}.awl", id.kind.name(), id.number);
        let source = translation.sources.iter().find(|source| source.name == file)?;
        Some((*id, String::from_utf8_lossy(&source.bytes).into_owned()))
    });
    let sources = sources.collect();
    let protected = folder.blocks.iter().filter(|(_, block)| block.know_how).map(|(id, _)| *id).collect();
    let side = Side::of_program(title, translation.program.clone(), library);
    Side { sources, of_project: true, protected, made, ..side }
}

/// A folder as a program: what is replaced, what the program may call, and itself.
fn translated(
    folder: &Folder,
    page: CodePage,
    symbols: Vec<Symbol>,
    mnemonics: ob1_stl::Mnemonics,
) -> Result<(replace::Replaced, Library, Translation), String> {
    let replaced = replace::find(folder);
    let library = replaced.library()?;
    let wanted = Wanted { page, library: &library, replaced: &replaced.ids(), symbols, mnemonics };
    let translation = translate(folder, &wanted);
    Ok((replaced, library, translation))
}

fn run(args: &ImportArgs) -> Result<ImportExit, String> {
    if let (true, Some(out)) = (is_machine_code(&args.project), &args.out) {
        let wanted = upload::OfBlocks {
            title: args.project.display().to_string(),
            out: (out, args.overwrite),
            names: args.names_from.as_deref().map(|path| (path, args.program.as_deref())),
            set: args.mnemonics.or(INTERNATIONAL),
            json: args.json,
        };
        let blocks = block_files::collect(std::slice::from_ref(&args.project))?;
        return upload::station_of(&wanted, &blocks, BTreeMap::new(), Notes::new());
    }
    if args.names_from.is_some() {
        return Err(format!(
            "{}: it is a project, which has its own names\n  = --names-from is for blocks out of a CPU: .mc7 files, or \
             the folder of an `ob1 upload`",
            args.project.display()
        ));
    }
    let source = disk::open(&args.project)?;
    let tree = Tree::new(&*source);
    let (projects, titles) = projects(&args.project, &*source, &tree, args.code_page)?;
    if args.list {
        return Ok(list(args, &tree, &projects, &titles));
    }
    let taken = take(args.program.as_deref(), &tree, projects, &titles)?;
    let modules = hardware::of_choice(&taken.project, taken.choice);
    let mut notes = taken.project.notes.clone();
    let rows = taken.project.symbols(&tree, taken.choice, &mut notes);
    let symbols = output::symbol_table(&rows);
    let (replaced, library, translation) =
        translated(&taken.folder, taken.project.page, symbols.1, args.mnemonics.or(INTERNATIONAL))?;
    if let Some(block) = &args.listing {
        return listing(block, &taken.folder, &translation, &library, args.mnemonics.or(INTERNATIONAL));
    }
    let Some(out) = &args.out else { return Err("--out is missing".to_owned()) };
    let gsds = match &args.gsd {
        Some(folder) => GsdFiles::read(folder, &mut notes)?,
        None => GsdFiles::default(),
    };
    let set = args.mnemonics.or(INTERNATIONAL);
    let texts = taken.project.sources(&tree, taken.choice);
    let sources = scl_sources(&texts, &translation, &library, &translation.program.symbols, set);
    let instead: Vec<&SclSource> = sources.iter().filter(|s| args.scl && s.why_not.is_none()).collect();
    let named = station::Named { title: &taken.title, name: station_name(out), set, scl: &instead };
    let mut made = station::make(&named, (&taken.folder, &translation), &modules, &replaced, &gsds);
    scl::lay_beside(&mut made, &sources, args.scl);
    notes.extend(replaced.notes.clone());
    let mut written = output::write((out, args.overwrite), &taken.title, &translation, &symbols.0, &made, &notes)?;
    if args.drawings {
        let side = side(taken.title.clone(), &taken.folder, &translation, library.clone());
        written.files.extend(output::draw(out, side)?);
    }
    if args.json {
        say!("{}", outcome(&titles, Some(&taken.title), &translation, Some(&written)));
    } else {
        says!("{}", report::summary(&taken.title, &translation, out, &written.errors));
    }
    Ok(exit(&translation, &written))
}

fn exit(translation: &Translation, written: &output::Written) -> ImportExit {
    if translation.left_out.is_empty() && written.errors.is_empty() {
        ImportExit::Whole
    } else {
        ImportExit::Incomplete
    }
}

fn title(project: &Project, choice: Choice, projects: usize) -> String {
    let title = project.title(choice);
    if projects > 1 { format!("{}: {title}", project.name) } else { title }
}

/// Projects of the same name, a copy beside the original for example, have their folders in their names.
fn tell_apart(projects: &mut [Project], roots: &[Root]) {
    let names: Vec<String> = projects.iter().map(|project| project.name.to_lowercase()).collect();
    for ((project, root), name) in projects.iter_mut().zip(roots).zip(&names) {
        let folder = root.folder.trim_end_matches(['/', '\\']);
        if !folder.is_empty() && names.iter().filter(|other| *other == name).count() > 1 {
            project.name = format!("{} ({folder})", project.name);
        }
    }
}

/// What is taken of several projects when no name is given: programs with blocks that belong to a CPU; else programs
/// with blocks; else block folders that have some.
fn preferred(found: Vec<(usize, Choice)>, projects: &[Project]) -> Vec<(usize, Choice)> {
    let with = |test: &dyn Fn(&Project, &Choice) -> bool| {
        let of = |(index, choice): &&(usize, Choice)| projects.get(*index).is_some_and(|project| test(project, choice));
        found.iter().filter(of).copied().collect::<Vec<_>>()
    };
    let blocks = |project: &Project, choice: &Choice| project.folders.get(choice.folder).is_some_and(|f| f.blocks > 0);
    let of_cpu = |project: &Project, choice: &Choice| {
        let program = choice.program.and_then(|index| project.programs.get(index));
        blocks(project, choice) && program.is_some_and(|program| program.cpu.is_some())
    };
    let of_program = |project: &Project, choice: &Choice| blocks(project, choice) && choice.program.is_some();
    [with(&of_cpu), with(&of_program), with(&blocks)].into_iter().find(|kept| !kept.is_empty()).unwrap_or(found)
}

/// The one program that is meant.
fn take(name: Option<&str>, tree: &Tree<'_>, projects: Vec<Project>, titles: &[String]) -> Result<Taken, String> {
    let several = projects.len();
    let mut found: Vec<(usize, Choice)> = Vec::new();
    for (index, project) in projects.iter().enumerate() {
        let choices = match name {
            None => project.default_choice(),
            Some(name) => {
                // `PROJECT: PROGRAM`, where there are several projects.
                let own = name.split_once(": ").filter(|(of, _)| several > 1 && *of == project.name);
                project.named(own.map_or(name, |(_, rest)| rest))
            }
        };
        found.extend(choices.into_iter().map(|choice| (index, choice)));
    }
    if name.is_none() {
        found = preferred(found, &projects);
    }
    let list = |of: &[String]| of.iter().map(|t| format!("\n  --program \"{t}\"")).collect::<String>();
    let (index, choice) = match (found.as_slice(), name) {
        ([one], _) => *one,
        ([], Some(name)) => return Err(format!("there is no program \"{name}\"; there are{}", list(titles))),
        ([], None) => return Err("the project has no block folder".to_owned()),
        (several_found, _) => {
            let titles: Vec<String> =
                several_found.iter().map(|(i, choice)| title(&projects[*i], *choice, several)).collect();
            return Err(format!("several programs are meant; choose one with{}", list(&titles)));
        }
    };
    let project = projects.into_iter().nth(index).ok_or("the project is gone")?;
    let title = title(&project, choice, several);
    let folder = project.blocks(tree, choice)?;
    if folder.blocks.is_empty() && folder.damaged.is_empty() {
        return Err(format!("{title} has no blocks"));
    }
    if folder.blocks.is_empty() {
        let why = folder.damaged.values().next().map_or("", String::as_str);
        return Err(format!("{title}: none of its {} blocks can be read: {why}", folder.damaged.len()));
    }
    Ok(Taken { project, choice, title, folder })
}

fn list(args: &ImportArgs, tree: &Tree<'_>, projects: &[Project], titles: &[String]) -> ImportExit {
    let mut translation = Translation::default();
    let mut names = titles.iter();
    for project in projects {
        if !args.json {
            say!("{} (code page {})", project.name, project.page.number());
        }
        for choice in project.choices() {
            let title = names.next().map_or("", String::as_str);
            let folder = project.blocks(tree, choice);
            if let Ok(folder) = &folder {
                translation.blocks += folder.blocks.len() + folder.damaged.len();
                translation.left_out.extend(folder.damaged.clone());
            }
            if !args.json {
                say!("  {title}");
                match folder {
                    Ok(folder) => says!("{}", report::blocks(&folder)),
                    Err(why) => say!("    {why}"),
                }
            }
        }
        if !args.json {
            report::together(&project.notes).for_each(|line| say!("  {line}"));
        }
    }
    if args.json {
        say!("{}", outcome(titles, None, &translation, None));
    }
    ImportExit::Whole
}

fn listing(
    wanted: &str,
    folder: &Folder,
    translation: &Translation,
    library: &Library,
    set: ob1_stl::Mnemonics,
) -> Result<ImportExit, String> {
    let (name, file, id, is_protected) = match udt_number(wanted) {
        Some(number) => (format!("UDT {number}"), format!("UDT_{number}.awl"), None, false),
        None => {
            let id = BlockId::parse(wanted)
                .ok_or_else(|| format!("\"{wanted}\" is not a block; write FC5, DB 10 or UDT 1"))?;
            let is_protected = folder.blocks.get(&id).is_some_and(|block| block.know_how);
            (id.to_string(), format!("{}_{}.awl", id.kind.name(), id.number), Some(id), is_protected)
        }
    };
    if let Some(why) = translation.left_out.get(&name) {
        return Err(why.clone());
    }
    if is_protected {
        return Err(format!("{name} is know-how protected: it runs, and its statements are not printed"));
    }
    let text = match (translation.sources.iter().find(|source| source.name == file), id) {
        (Some(source), _) => String::from_utf8_lossy(&source.bytes).into_owned(),
        (None, Some(id)) => of_machine_code(id, folder, translation, library, set)?,
        (None, None) => return Err(format!("{name} is not in this program")),
    };
    says!("{text}");
    Ok(ImportExit::Whole)
}

/// The text of a block that has no source: with the names of its compiled form.
fn of_machine_code(
    id: BlockId,
    folder: &Folder,
    translation: &Translation,
    library: &Library,
    set: ob1_stl::Mnemonics,
) -> Result<String, String> {
    let program = &translation.program;
    let of_program = |id: BlockId| program.blocks.iter().find(|block| block.id == id).map(|block| &block.interface);
    let callees = |id: BlockId| of_program(id).or_else(|| library.get(id).map(|block| &block.interface));
    let printer = Printer::new(set, &callees);
    let compiled = folder.blocks.get(&id).and_then(|block| CompiledInterface::read(&block.interface).ok());
    let instances = compiled.map(|compiled| compiled.instances()).unwrap_or_default();
    let declared = Declared { instances, ..Declared::default() };
    let heading = Heading::default();
    let block = program.blocks.iter().find(|block| block.id == id);
    let data = program.data.iter().find(|data| id.kind == BlockKind::Db && data.number == id.number);
    let text = match (block, data) {
        (Some(block), _) => printer.block(block, &heading, &declared, &Listing::default()),
        (None, Some(data)) => printer.data(data, &heading),
        (None, None) => return Err(format!("{id} is not in this program")),
    };
    text.map_err(|why| format!("{id} stays in machine code: {why}"))
}

/// The number of a UDT: `UDT 1`, `udt1`.
fn udt_number(wanted: &str) -> Option<u16> {
    let (kind, number) = wanted.trim().split_at_checked(3)?;
    kind.eq_ignore_ascii_case("UDT").then(|| number.trim().parse().ok())?
}

fn outcome(
    programs: &[String],
    program: Option<&str>,
    translation: &Translation,
    written: Option<&output::Written>,
) -> String {
    let left_out: Vec<_> =
        translation.left_out.iter().map(|(block, reason)| json!({ "block": block, "reason": reason })).collect();
    json!({
        "programs": programs,
        "program": program,
        "blocks": translation.blocks,
        "decoded": translation.decoded,
        "left_out": left_out,
        "files": written.map_or(&[][..], |written| &written.files),
        "errors": written.map_or(&[][..], |written| &written.errors),
    })
    .to_string()
}
