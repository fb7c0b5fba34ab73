//! Interfaces of blocks that come from elsewhere: plugins, system blocks, blocks in Rust.

use std::collections::{BTreeMap, BTreeSet};

use ob1_model::{BlockId, Interface};

/// A block of the library.
#[derive(Clone, Debug)]
pub struct LibraryBlock {
    /// Name of the block: `SEND`.
    pub name: String,
    /// Its parameters; for an FB with the layout of its instance (see [`Interface::lay_out`]).
    pub interface: Interface,
    /// Who brings it, for messages: `plugin libob1_cp240.so`.
    pub origin: String,
    /// It yields to a block of the program that has its number.
    pub yields: bool,
}

/// What to say of a block that is not in the library but is called.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Missing {
    /// What it is, and why it is not there: `SFC 54 RALRM: this CPU has no alarms of modules`.
    pub message: String,
    /// What to do; [`CANDIDATES`] and [`KEY`] stand for those that fit a call, and for the key of the first.
    pub remedy: String,
    /// Blocks of this number that may be meant.
    pub candidates: Vec<Candidate>,
}

/// A block that may be meant by a call.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidate {
    /// What chooses it: `IEC:FC2`.
    pub key: String,
    /// Its name: `CONCAT`.
    pub name: String,
    /// Names of its parameters.
    pub formals: Vec<String>,
}

/// The place in a remedy for the candidates.
pub const CANDIDATES: &str = "{candidates}";
/// The place in a remedy for the key of the first candidate.
pub const KEY: &str = "{key}";

impl Missing {
    /// What to do of a call with these parameters: candidates without one of them are not meant, if others have all.
    pub(crate) fn remedy_for(&self, given: &[&str]) -> String {
        let has = |candidate: &Candidate, name: &str| candidate.formals.iter().any(|f| f.eq_ignore_ascii_case(name));
        let fitting: Vec<&Candidate> =
            self.candidates.iter().filter(|candidate| given.iter().all(|name| has(candidate, name))).collect();
        let meant = if fitting.is_empty() { self.candidates.iter().collect() } else { fitting };
        let list: Vec<String> = meant.iter().map(|one| format!("{} {}", one.key, one.name)).collect();
        let first = meant.first().map_or("", |one| one.key.as_str());
        self.remedy.replace(CANDIDATES, &list.join(", ")).replace(KEY, first)
    }
}

/// The blocks a program may call besides its own.
#[derive(Clone, Debug, Default)]
pub struct Library {
    blocks: BTreeMap<BlockId, LibraryBlock>,
    /// What is said of blocks that are not here.
    explain: Option<fn(BlockId) -> Option<Missing>>,
    /// Names in capitals of blocks that are not here, with their usual number.
    named: BTreeMap<String, BlockId>,
    /// The usual numbers, those of blocks with the same name too.
    usual: BTreeSet<BlockId>,
    /// Blocks by their name in capitals that come when a program calls them by it, under their usual number.
    on_demand: BTreeMap<String, (BlockId, LibraryBlock)>,
}

impl Library {
    /// A library without blocks.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a block. An FB or SFB whose interface has not been laid out is laid out here. The block that had this
    /// number is given back.
    pub fn insert(&mut self, id: BlockId, name: &str, mut interface: Interface) -> Option<LibraryBlock> {
        if id.kind.has_instance() && interface.instance_bytes == 0 {
            interface.lay_out(true);
        }
        let origin = String::new();
        self.blocks.insert(id, LibraryBlock { name: name.to_owned(), interface, origin, yields: false })
    }

    /// Sets who brings a block, and whether it yields to one of the program with its number.
    pub fn set_origin(&mut self, id: BlockId, origin: &str, yields: bool) {
        if let Some(block) = self.blocks.get_mut(&id) {
            origin.clone_into(&mut block.origin);
            block.yields = yields;
        }
    }

    /// The usual name of a block that is not here: a program that uses the name without a symbol table gets the
    /// block's number.
    pub fn name(&mut self, id: BlockId, name: &str) {
        self.usual.insert(id);
        self.named.entry(name.to_uppercase()).or_insert(id);
    }

    /// A block that comes when a program calls it by its bare name, as TIA Portal does.
    pub fn offer(&mut self, id: BlockId, name: &str, mut interface: Interface) {
        if id.kind.has_instance() && interface.instance_bytes == 0 {
            interface.lay_out(true);
        }
        let block = LibraryBlock { name: name.to_owned(), interface, origin: String::new(), yields: true };
        self.on_demand.entry(name.to_uppercase()).or_insert((id, block));
    }

    pub(crate) fn offered(&self, name: &str) -> Option<&(BlockId, LibraryBlock)> {
        self.on_demand.get(&name.to_uppercase())
    }

    /// Names in capitals with the numbers of all blocks that are here or usual.
    pub(crate) fn names(&self) -> BTreeMap<String, BlockId> {
        let here = self.blocks.iter().map(|(id, block)| (block.name.to_uppercase(), *id));
        self.named.iter().map(|(name, id)| (name.clone(), *id)).chain(here).collect()
    }

    /// The numbers of all blocks that are here or usual.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = BlockId> {
        self.blocks.keys().chain(&self.usual).copied()
    }

    /// A block by kind and number.
    pub fn get(&self, id: BlockId) -> Option<&LibraryBlock> {
        self.blocks.get(&id)
    }

    /// Who knows what is to be said of calls of blocks that neither program nor library have.
    pub fn explain(&mut self, explain: fn(BlockId) -> Option<Missing>) {
        self.explain = Some(explain);
    }

    pub(crate) const fn explained(&self) -> Option<fn(BlockId) -> Option<Missing>> {
        self.explain
    }

    /// All blocks in order.
    pub fn iter(&self) -> impl Iterator<Item = (BlockId, &LibraryBlock)> {
        self.blocks.iter().map(|(id, block)| (*id, block))
    }
}
