//! The sample projects: their SCL sources, symbols and machine code.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ob1_ir::{Program, Symbol};
use ob1_model::BlockId;
use ob1_project::{Archive, Choice, CodePage, Notes, OK_FLAG, Project, Tree, Wanted, has_ok, heads, translate};
use ob1_std::standard_blocks;
use ob1_stl::{Library, Mnemonics, Source, read_symbols};

/// One release.
pub struct Release {
    pub name: String,
    /// `311` of 3.11.
    pub digits: String,
    /// SCL texts by the block they make; those of other sources.
    pub scl: Vec<(Option<BlockId>, Source)>,
    /// Further sources of blocks that have one already, by the index of that.
    pub second: Vec<(usize, Source)>,
    /// The program as Siemens' compiler made it.
    pub reference: Program,
    /// STL of the blocks that have no SCL source.
    pub rest: Vec<Source>,
    pub symbols: Vec<Symbol>,
    pub library: Library,
    /// Blocks of the project that are ours.
    pub replaced: BTreeSet<BlockId>,
}

/// Archives below a folder, by name.
pub fn archives(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zip")) {
                out.push(path);
            }
        }
    }
    out.sort();
    out
}

/// The library that both programs run with: system functions and the IEC functions.
fn library(replaced: &BTreeSet<BlockId>) -> Library {
    let mut library = Library::new();
    for block in standard_blocks() {
        let system = block.origin == ob1_std::Origin::System;
        if system || replaced.contains(&block.id) && block.origin == ob1_std::Origin::Iec {
            library.insert(block.id, block.name, block.interface);
        }
    }
    library
}

fn symbol_text(rows: &[ob1_project::SymbolRow]) -> String {
    let clean = |text: &str| text.replace(['"', '\r', '\n'], " ");
    rows.iter()
        .map(|r| format!("\"{}\",\"{}\",\"{}\",\"\"\n", clean(&r.name), clean(&r.international), clean(&r.ty)))
        .collect()
}

/// The number of a release in the name of its archive.
pub fn digits(path: &Path) -> String {
    let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let runs = stem.split(|c: char| !c.is_ascii_digit());
    runs.max_by_key(|run| run.len()).unwrap_or_default().to_owned()
}

/// The programs of one archive that have SCL sources.
pub fn read(path: &Path) -> Vec<Release> {
    let Some(archive) = std::fs::read(path).ok().and_then(|bytes| Archive::open(bytes).ok()) else { return Vec::new() };
    let tree = Tree::new(&archive);
    let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let mut out = Vec::new();
    for root in tree.roots() {
        let project = Project::read(&tree, &root);
        for choice in project.choices() {
            let release = program(&tree, &project, choice, &format!("{stem}/{}", project.title(choice)));
            out.extend(release.map(|release| Release { digits: digits(path), ..release }));
        }
    }
    out
}

/// One program. `None` where it has no SCL sources.
fn program(tree: &Tree<'_>, project: &Project, choice: Choice, name: &str) -> Option<Release> {
    let texts = project.sources(tree, choice);
    if texts.iter().all(|t| t.stl) {
        return None;
    }
    let rows = project.symbols(tree, choice, &mut Notes::new());
    let symbols = read_symbols(&Source::new("symbols.sdf", symbol_text(&rows).as_bytes())).symbols;
    let folder = project.blocks(tree, choice).ok()?;
    let named: BTreeMap<BlockId, &str> =
        standard_blocks().into_iter().filter(|b| b.origin == ob1_std::Origin::Iec).map(|b| (b.id, b.name)).collect();
    let replaced: BTreeSet<BlockId> = folder
        .blocks
        .iter()
        .filter(|(id, b)| named.get(id).is_some_and(|n| n.get(..8.min(n.len())) == Some(b.head.name.trim())))
        .map(|(id, _)| *id)
        .collect();
    let library = library(&replaced);
    let wanted = Wanted {
        page: CodePage::default(),
        library: &library,
        replaced: &replaced,
        symbols: symbols.clone(),
        mnemonics: Mnemonics::International,
    };
    let translation = translate(&folder, &wanted);
    let by_name: BTreeMap<String, &Symbol> = symbols.iter().map(|s| (s.name.to_uppercase(), s)).collect();
    let (mut scl, mut second, mut taken) = (Vec::new(), Vec::new(), BTreeMap::new());
    for text in texts.iter().filter(|t| !t.stl) {
        let mut ids = Vec::new();
        for (word, name) in heads(&text.text) {
            let address = by_name.get(&name.to_uppercase()).map_or(name.clone(), |s| s.address.clone());
            let compact: String = address.chars().filter(|c| !c.is_whitespace()).collect();
            ids.push((word, compact));
        }
        let Some((word, first)) = ids.first() else {
            // A list of sources to compile.
            continue;
        };
        let id = if *word == "TYPE" { None } else { BlockId::parse(first) };
        let option = if id.is_some_and(|id| has_ok(&translation.program, id)) { OK_FLAG } else { "" };
        let source = Source::new(format!("{}.scl", text.name), format!("{option}{}", text.text).as_bytes());
        if let Some(at) = ids.iter().find_map(|(_, id)| taken.get(id)) {
            second.push((*at, source));
            continue;
        }
        taken.extend(ids.iter().map(|(_, id)| (id.clone(), scl.len())));
        scl.push((id, source));
    }
    let is_rest = |file: &&ob1_project::ProgramFile| {
        !taken.contains_key(&file.name.split('.').next().unwrap_or("").replace('_', ""))
    };
    let rest =
        translation.sources.iter().filter(is_rest).map(|f| Source::new(f.name.clone(), f.bytes.clone())).collect();
    let digits = String::new();
    Some(Release {
        name: name.to_owned(),
        digits,
        scl,
        second,
        reference: translation.program,
        rest,
        symbols,
        library,
        replaced,
    })
}
