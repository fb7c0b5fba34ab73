//! A program as others see it: names, places, blocks, what differs from the sources.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use ob1_access::Names;
use ob1_access::door::BlockFact;
use ob1_cpu::DiagEntry;
use ob1_ir::{CodeBlock, Program};
use ob1_model::{BlockId, BlockKind};
use ob1_stl::{CrossReference, Library};
use parking_lot::RwLock;

use crate::access::protocol::Download;

/// The language of a block as its head has it. [the list of block types of S7 communication]
const STL: u8 = 1;
const DATA: u8 = 5;
/// Where the language is in the head of a block.
const LANGUAGE_AT: usize = 4;

/// The source files of a program's blocks.
#[derive(Debug, Default)]
pub struct Places(BTreeMap<BlockId, String>);

impl Places {
    /// The places of the blocks of a program; blocks without a source have none.
    #[must_use]
    pub fn new(program: &Program) -> Self {
        let file = |block: &CodeBlock| Some((block.id, program.sources.get(block.source as usize)?.clone()));
        Self(program.blocks.iter().filter_map(file).collect())
    }

    /// The file of a block.
    #[must_use]
    pub fn file(&self, block: BlockId) -> Option<&str> {
        self.0.get(&block).map(String::as_str)
    }

    /// `press.awl:14`, where an entry is about a statement.
    #[must_use]
    pub fn of(&self, entry: &DiagEntry) -> Option<String> {
        let site = entry.site.filter(|site| site.line > 0)?;
        Some(format!("{}:{}", self.file(site.block)?, site.line))
    }

    /// An entry in words, with its file.
    #[must_use]
    pub fn told(&self, entry: &DiagEntry) -> String {
        let place = self.of(entry).map_or_else(String::new, |place| format!(", {place}"));
        format!("{entry}{place}")
    }
}

/// A program as others see it: names, places, blocks.
#[derive(Debug, Default)]
pub struct KnownProgram {
    /// The names of its cells.
    pub names: Names,
    /// Where its blocks stand.
    pub places: Places,
    /// Its blocks, as links list them.
    pub blocks: Vec<BlockFact>,
    /// The program that the CPU runs.
    pub program: Arc<Program>,
    /// Blocks it calls that are not its own.
    pub library: Arc<Library>,
    /// How it differs from the sources.
    pub downloads: Vec<Download>,
    /// Those blocks as they came.
    pub images: BTreeMap<BlockId, Vec<u8>>,
    /// Why that will be lost when the station ends.
    pub not_kept: Option<String>,
    /// Checksum of the system data.
    pub(crate) data_sum: u32,
    /// That of the program, made when it is asked for first: it is a matter of milliseconds, and the start waits.
    pub(crate) program_sum: OnceLock<u32>,
    /// Made when it is asked for first: see [`KnownProgram::cross_reference`].
    pub(crate) cross_reference: OnceLock<CrossReference<Arc<Program>>>,
    /// The document of its sources, made when it is asked for first.
    pub(crate) sources: OnceLock<String>,
    /// That is under way.
    pub(crate) is_read: AtomicBool,
}

impl KnownProgram {
    /// Of a program that is as its sources.
    #[must_use]
    pub fn new(program: Arc<Program>, library: Arc<Library>) -> Self {
        Self {
            names: Names::new(&program),
            places: Places::new(&program),
            blocks: blocks(&program, &library),
            data_sum: 0,
            program_sum: OnceLock::new(),
            program,
            library,
            downloads: Vec::new(),
            images: BTreeMap::new(),
            not_kept: None,
            cross_reference: OnceLock::new(),
            sources: OnceLock::new(),
            is_read: AtomicBool::new(false),
        }
    }

    /// Who uses what: made when it is asked for first, by the thread that asks.
    pub fn cross_reference(&self) -> &CrossReference<Arc<Program>> {
        self.cross_reference.get_or_init(|| CrossReference::new(Arc::clone(&self.program), &self.library))
    }

    /// Checksums of system data and of the program, each of 32 bits: another program has others.
    #[must_use]
    pub fn sums(&self) -> [u32; 2] {
        let of_program = || folded(without_paths(&ob1_ir::write(&self.program)).as_bytes());
        [self.data_sum, *self.program_sum.get_or_init(of_program)]
    }

    /// Lists the system data blocks among the images.
    pub fn add_system_data(&mut self) {
        for (&id, bytes) in self.images.iter().filter(|(id, _)| id.kind == BlockKind::Sdb) {
            let language = bytes.get(LANGUAGE_AT).copied().unwrap_or(0);
            self.blocks.push(BlockFact { id, bytes: bytes.len() as u32, language, name: String::new() });
            self.data_sum = self.data_sum.rotate_left(1) ^ folded(bytes);
        }
    }
}

/// A program in its file form without the places of its sources: it is the same program on another machine.
fn without_paths(text: &str) -> String {
    text.lines().filter(|line| !line.starts_with("source ")).map(|line| format!("{line}\n")).collect()
}

fn folded(bytes: &[u8]) -> u32 {
    let sum = ob1_process::files::checksum(bytes.iter().copied());
    (sum >> 32) as u32 ^ sum as u32
}

/// The program that runs, as others see it. A download sets another one.
#[derive(Clone, Debug, Default)]
pub struct Known(Arc<RwLock<Arc<KnownProgram>>>);

impl Known {
    /// The program from now on.
    pub fn set(&self, program: KnownProgram) {
        *self.0.write() = Arc::new(program);
    }

    /// The one that runs.
    #[must_use]
    pub fn get(&self) -> Arc<KnownProgram> {
        Arc::clone(&self.0.read())
    }
}

/// The blocks of a program and those of the CPU, in ascending order.
fn blocks(program: &Program, library: &Library) -> Vec<BlockFact> {
    let own = library.iter().filter(|(id, _)| id.kind.is_system());
    let own = own.map(|(id, block)| BlockFact { id, bytes: 0, language: STL, name: block.name.clone() });
    let code = program.blocks.iter().map(|block| BlockFact {
        id: block.id,
        bytes: 0,
        language: STL,
        name: block.name.clone().unwrap_or_default(),
    });
    let data = program.data.iter().map(|block| BlockFact {
        id: BlockId::new(BlockKind::Db, block.number),
        bytes: block.bytes.len() as u32,
        language: DATA,
        name: block.name.clone().unwrap_or_default(),
    });
    let mut all: Vec<BlockFact> = code.chain(data).chain(own).collect();
    all.sort_by_key(|fact| fact.id);
    all
}
