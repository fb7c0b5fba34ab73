//! What the statements of a program can name: blocks with their interfaces, data blocks with their layout, symbols.

use std::collections::BTreeMap;

use ob1_ir::{DataKind, Operand};
use ob1_model::{BlockId, BlockKind, Component, DataType, Interface, Section};

use crate::library::Missing;
use crate::mnemonics::BlockWord;
use crate::path::FieldIndex;

/// A block's interface, with its names ready to be looked up.
#[derive(Debug)]
pub(crate) struct Info {
    /// The name a message may call it by.
    pub(crate) name: Option<String>,
    pub(crate) interface: Interface,
    /// Names and aliases in capitals, to the index of the declaration.
    names: BTreeMap<String, usize>,
    /// For each declaration its index among the formals.
    formals: Vec<Option<u16>>,
    /// Declarations that are instances of an FB.
    pub(crate) instances: BTreeMap<usize, BlockId>,
}

impl Info {
    pub(crate) fn new(name: Option<String>, interface: Interface, instances: BTreeMap<usize, BlockId>) -> Self {
        let mut names = BTreeMap::new();
        let mut formals = Vec::with_capacity(interface.params.len());
        let mut next = 0u16;
        for (index, param) in interface.params.iter().enumerate() {
            for name in std::iter::once(&param.name).chain(&param.aliases) {
                names.entry(name.to_uppercase()).or_insert(index);
            }
            let is_formal = !matches!(param.section, Section::Static | Section::Temp);
            formals.push(is_formal.then_some(next));
            next += u16::from(is_formal);
        }
        Self { name, interface, names, formals, instances }
    }

    /// The index of a declaration by name or alias.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.names.get(&name.to_uppercase()).copied()
    }

    /// The index among the formals of a declaration.
    pub(crate) fn formal(&self, declaration: usize) -> Option<u16> {
        self.formals.get(declaration).copied().flatten()
    }
}

/// A data block.
#[derive(Debug)]
pub(crate) struct Data {
    pub(crate) name: Option<String>,
    pub(crate) kind: DataKind,
    /// The declarations, composed types whole.
    pub(crate) components: Vec<Component>,
    names: BTreeMap<String, usize>,
    /// The load values.
    pub(crate) image: Vec<u8>,
    pub(crate) read_only: bool,
}

impl Data {
    pub(crate) fn new(kind: DataKind, components: Vec<Component>, image: Vec<u8>) -> Self {
        let names = components.iter().enumerate().map(|(i, c)| (c.path.to_uppercase(), i)).collect();
        Self { name: None, kind, components, names, image, read_only: false }
    }

    pub(crate) fn find(&self, name: &str) -> Option<&Component> {
        self.components.get(*self.names.get(&name.to_uppercase())?)
    }
}

/// What a symbol stands for.
#[derive(Clone, Debug)]
pub(crate) enum Symbolic {
    Block(BlockWord, u16),
    Memory(Operand, Option<DataType>),
    Timer(u16),
    Counter(u16),
    /// The table gives an address that is none.
    Unknown(String),
}

/// Everything a statement can name.
#[derive(Debug, Default)]
pub(crate) struct World {
    /// The program's blocks and those of the library.
    pub(crate) blocks: BTreeMap<BlockId, Info>,
    pub(crate) data: BTreeMap<u16, Data>,
    /// By name in capitals.
    pub(crate) symbols: BTreeMap<String, Symbolic>,
    pub(crate) fields: FieldIndex,
    /// What the library says of blocks it does not have.
    pub(crate) missing: BTreeMap<BlockId, Missing>,
}

impl World {
    /// What to say of a block that neither program nor library have, and what to do.
    pub(crate) fn unknown_block(&self, id: BlockId) -> Missing {
        self.missing.get(&id).cloned().unwrap_or_else(|| Missing {
            message: format!("{id} is neither in the program nor in the library"),
            remedy: match id.kind {
                BlockKind::Sfc | BlockKind::Sfb => {
                    "Leave the call out, or replace it: this CPU does not have it.".to_owned()
                }
                _ => "Add its source, or load the plugin that has it, e.g. --plugin libob1_cp240.so".to_owned(),
            },
        })
    }

    pub(crate) fn symbol(&self, name: &str) -> Option<&Symbolic> {
        self.symbols.get(&name.to_uppercase())
    }
}
