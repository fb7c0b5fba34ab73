//! Interfaces of blocks that come from elsewhere: plugins, system blocks, blocks in Rust.

use std::collections::BTreeMap;

use ob1_model::{BlockId, Interface};

/// A block of the library.
#[derive(Clone, Debug)]
pub struct LibraryBlock {
    /// Its name: `SEND`.
    pub name: String,
    /// Its parameters; for an FB with the layout of its instance (see [`Interface::lay_out`]).
    pub interface: Interface,
}

/// What to say of a block that is not in the library but is called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// What it is, and why it is not there: `SFC 54 RALRM: this CPU has no alarms of modules`.
    pub message: String,
    /// What to do.
    pub remedy: String,
}

/// The blocks a program may call beside its own.
#[derive(Clone, Debug, Default)]
pub struct Library {
    blocks: BTreeMap<BlockId, LibraryBlock>,
    missing: BTreeMap<BlockId, Missing>,
}

impl Library {
    /// No blocks.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a block. An FB or SFB whose interface has not been laid out is laid out here. The block that had this
    /// number is given back.
    pub fn insert(&mut self, id: BlockId, name: &str, mut interface: Interface) -> Option<LibraryBlock> {
        if id.kind.has_instance() && interface.instance_bytes == 0 {
            interface.lay_out(true);
        }
        self.blocks.insert(id, LibraryBlock { name: name.to_owned(), interface })
    }

    /// A block by kind and number.
    #[must_use]
    pub fn get(&self, id: BlockId) -> Option<&LibraryBlock> {
        self.blocks.get(&id)
    }

    /// A call of the block, which neither program nor library have, is to be reported with these words.
    pub fn explain(&mut self, id: BlockId, missing: Missing) {
        self.missing.insert(id, missing);
    }

    pub(crate) const fn all_missing(&self) -> &BTreeMap<BlockId, Missing> {
        &self.missing
    }

    /// All blocks in order.
    pub fn iter(&self) -> impl Iterator<Item = (BlockId, &LibraryBlock)> {
        self.blocks.iter().map(|(id, block)| (*id, block))
    }
}
