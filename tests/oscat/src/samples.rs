//! The sample projects: their SCL sources, symbols and machine code.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ob1_ir::{Program, Symbol};
use ob1_model::{BlockId, BlockKind};
use ob1_project::{Archive, CodePage, Notes, Project, Tree, Wanted, translate};
use ob1_std::standard_blocks;
use ob1_stl::{Library, Mnemonics, Source, read_symbols};

/// One release.
pub struct Release {
    pub name: String,
    /// SCL texts by the block they make; those of other sources.
    pub scl: Vec<(Option<BlockId>, Source)>,
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

/// What a source makes: the first word and the name behind it.
fn head(text: &str) -> Option<(&'static str, String)> {
    for line in text.lines() {
        let line = line.trim_start_matches('\u{feff}').trim();
        for word in ["FUNCTION_BLOCK", "FUNCTION", "TYPE", "DATA_BLOCK", "ORGANIZATION_BLOCK"] {
            let Some(start) = line.get(..word.len()) else { continue };
            if !start.eq_ignore_ascii_case(word) || !line[word.len()..].starts_with([' ', '\t']) {
                continue;
            }
            let name = line[word.len()..].trim().trim_start_matches('"');
            let name: String = name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            return Some((word, name));
        }
    }
    None
}

/// Reads one archive. `None` where it holds no program with SCL sources.
pub fn read(path: &Path) -> Option<Release> {
    let archive = Archive::open(std::fs::read(path).ok()?).ok()?;
    let tree = Tree::new(&archive);
    let root = tree.roots().into_iter().next()?;
    let project = Project::read(&tree, &root);
    let choice = project
        .choices()
        .into_iter()
        .max_by_key(|c| project.sources(&tree, *c).iter().filter(|s| !s.stl).count())?;
    let texts = project.sources(&tree, choice);
    let rows = project.symbols(&tree, choice, &mut Notes::new());
    let symbols = read_symbols(&Source::new("symbols.sdf", symbol_text(&rows).as_bytes())).symbols;
    let folder = project.blocks(&tree, choice).ok()?;
    let iec: BTreeSet<BlockId> =
        standard_blocks().into_iter().filter(|b| b.origin == ob1_std::Origin::Iec).map(|b| b.id).collect();
    let named: BTreeMap<BlockId, &str> = standard_blocks()
        .into_iter()
        .filter(|b| b.origin == ob1_std::Origin::Iec)
        .map(|b| (b.id, b.name))
        .collect();
    let replaced: BTreeSet<BlockId> = folder
        .blocks
        .iter()
        .filter(|(id, b)| iec.contains(id) && named.get(id).is_some_and(|n| n.get(..8.min(n.len())) == Some(b.head.name.trim())))
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
    let mut scl = Vec::new();
    let mut taken = BTreeSet::new();
    for text in texts.iter().filter(|t| !t.stl) {
        let Some((word, name)) = head(&text.text) else { continue };
        let address = by_name.get(&name.to_uppercase()).map_or(name.clone(), |s| s.address.clone());
        let compact: String = address.chars().filter(|c| !c.is_whitespace()).collect();
        let id = compact.find(|c: char| c.is_ascii_digit()).and_then(|at| {
            let kind = match &compact[..at] {
                "FC" => BlockKind::Fc,
                "FB" => BlockKind::Fb,
                "OB" => BlockKind::Ob,
                "DB" => BlockKind::Db,
                _ => return None,
            };
            Some(BlockId::new(kind, compact[at..].parse().ok()?))
        });
        if !taken.insert(compact.clone()) && word != "TYPE" {
            continue;
        }
        let id = id.filter(|_| word != "TYPE");
        scl.push((id, Source::new(format!("{name}.scl"), text.text.as_bytes())));
        if word == "TYPE" {
            taken.insert(compact);
        }
    }
    let rest = translation
        .sources
        .iter()
        .filter(|file| {
            let name = file.name.split('.').next().unwrap_or("").replace('_', "");
            !taken.contains(&name)
        })
        .map(|file| Source::new(file.name.clone(), file.bytes.clone()))
        .collect();
    let name = path.file_stem()?.to_string_lossy().into_owned();
    Some(Release { name, scl, reference: translation.program, rest, symbols, library, replaced })
}
