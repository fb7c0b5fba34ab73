//! One of the two programs, from wherever it is.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use ob1_ir::Program;
use ob1_model::{BlockId, Interface};
use ob1_project::Language;
use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::program_files;
use ob1_station_file::sources::Sources;
use ob1_stl::print::Printer;
use ob1_stl::{Library, Mnemonics, Source};

use super::blocks::{Text, difference, nameless, texts};
use crate::import::{self, CpuArgs, Unit};
use crate::xref::Asked;

/// What stands before the name of a CPU on the network.
const CPU: &str = "cpu:";
/// The station file of a folder.
const STATION: &str = "station.toml";

/// One of the two programs that are compared; see [the module](self).
#[derive(Clone)]
pub(crate) struct Side {
    pub(crate) title: String,
    /// A CPU: its data blocks have their present values.
    pub(crate) runs: bool,
    pub(crate) program: Program,
    pub(crate) library: Library,
    /// The texts of its blocks, of a project those made of them.
    pub(crate) sources: BTreeMap<BlockId, String>,
    /// It is a project, which says how its blocks were made.
    pub(crate) of_project: bool,
    /// Blocks that are know-how protected: their statements are not shown.
    pub(crate) protected: BTreeSet<BlockId>,
    /// The language of each block that was made in LAD or FBD, and for each of its networks whether it was edited as
    /// statements: its comments then have records of lines.
    pub(crate) made: BTreeMap<BlockId, (Language, Vec<bool>)>,
}

impl Side {
    /// # Errors
    /// Why it cannot be read.
    pub(crate) fn read(path: &Path, program: Option<&str>, unit: &Unit) -> Result<Self, String> {
        let title = path.display().to_string();
        let host = title.strip_prefix(CPU);
        let (program, library) = if let Some(host) = host {
            import::program_of_cpu(&CpuArgs { host: host.to_owned(), unit: unit.clone() })?
        } else if ob1_station_file::is_station_file(path) {
            station(path)?
        } else if path.join(STATION).is_file() {
            station(&path.join(STATION))?
        } else if import::is_machine_code(path) {
            import::program_of_blocks(path)?
        } else if program_files::is_known(path) {
            sources(path)?
        } else {
            match import::program_of_project(path, program) {
                // A folder of sources is no project.
                Err(_) if path.is_dir() && !program_files::expand(&[path.to_owned()], &[]).0.is_empty() => {
                    sources(path)?
                }
                project => return project,
            }
        };
        let sources = texts_of(&program);
        Ok(Self { runs: host.is_some(), sources, ..Self::of_program(title, program, library) })
    }

    /// The program of a CPU on the network.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub(crate) fn of_cpu(cpu: &CpuArgs) -> Result<Self, String> {
        let (program, library) = import::program_of_cpu(cpu)?;
        Ok(Self { runs: true, ..Self::of_program(cpu.host.clone(), program, library) })
    }

    /// A program that calls blocks of a library.
    pub(crate) fn of_program(title: String, program: Program, library: Library) -> Self {
        let (sources, protected, made) = (BTreeMap::new(), BTreeSet::new(), BTreeMap::new());
        Self { title, runs: false, program, library, sources, of_project: false, protected, made }
    }

    /// Where a block of this program (`-`) first differs from that of another one (`+`): its part and the lines. None
    /// if it is the same in both, or only one has it.
    pub(crate) fn first_difference(&self, other: &Self, block: BlockId) -> Option<(String, Vec<String>)> {
        let [mine, its] = [self, other].map(|side| side.texts(&[block], false).remove(&block));
        let (mine, its) = (mine?, its?);
        let change = difference(&mine, &its).into_iter().next()?;
        let lines = change.lines.iter().map(|(side, line)| format!("{side} {}", line.trim())).collect();
        Some((change.at, lines))
    }

    /// Its blocks as text; only `wanted`, if there are any. `values`: those of data blocks, too.
    pub(super) fn texts(&self, wanted: &[BlockId], values: bool) -> BTreeMap<BlockId, Text> {
        let own = self.program.blocks.iter().map(|block| (block.id, &block.interface));
        let bare: BTreeMap<BlockId, Interface> = own.clone().map(|(id, interface)| (id, nameless(interface))).collect();
        let own: BTreeMap<BlockId, &Interface> = own.collect();
        let library = |id: BlockId| self.library.get(id).map(|block| &block.interface);
        let shown = |id: BlockId| own.get(&id).copied().or_else(|| library(id));
        let meant = |id: BlockId| bare.get(&id).or_else(|| library(id));
        let symbols = self.program.symbols.iter().map(|symbol| (symbol.address.clone(), symbol.name.clone())).collect();
        let shown = Printer::new(Mnemonics::International, &shown).with_symbols(&symbols);
        let meant = Printer::new(Mnemonics::International, &meant);
        let texts = texts(&self.program, &shown, &meant).into_iter();
        let texts = texts.filter(|text| wanted.is_empty() || wanted.contains(&text.id));
        texts.map(|text| (text.id, if values { text } else { text.without_values() })).collect()
    }
}

/// The text of each block's source, as far as the files are there.
fn texts_of(program: &Program) -> BTreeMap<BlockId, String> {
    let read = |name: &String| {
        let bytes = ob1_process::files::read(Path::new(name), ob1_process::files::LONGEST).ok()?;
        Some(Source::new(name.as_str(), bytes).text().into_owned())
    };
    let texts: Vec<Option<String>> = program.sources.iter().map(read).collect();
    let text = |source: u32| texts.get(source as usize).cloned().flatten();
    program.blocks.iter().filter_map(|block| Some((block.id, text(block.source)?))).collect()
}

fn station(path: &Path) -> Result<(Program, Library), String> {
    let asked = Asked::of_station(path).map_err(|findings| told(&findings))?;
    Ok((asked.program, asked.library))
}

fn sources(path: &Path) -> Result<(Program, Library), String> {
    let wanted = Sources { files: vec![path.to_owned()], ..Sources::default() };
    let asked = Asked::of_sources(&wanted, &[]).map_err(|findings| told(&findings))?;
    Ok((asked.program, asked.library))
}

fn told(findings: &[Finding]) -> String {
    findings.iter().filter(|finding| finding.level == Level::Error).map(ToString::to_string).collect()
}
