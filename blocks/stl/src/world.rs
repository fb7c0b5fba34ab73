//! What the statements of a program can name: blocks with their interfaces, data blocks with their layout, symbols.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{DataKind, Operand};
use ob1_model::{BitAddr, BlockId, BlockKind, Component, DataType, Interface, Section};

use crate::constant::Constant;
use crate::diagnostic::{Sink, USES};
use crate::fields::FieldIndex;
use crate::identifiers::BlockWord;
use crate::library::Missing;
use crate::messages;
use crate::token::Span;

/// A block's interface, with its names ready to be looked up.
#[derive(Debug)]
pub struct Info {
    /// The name a message may call it by.
    pub name: Option<String>,
    pub interface: Interface,
    /// Names and aliases in capitals, to the index of the declaration.
    names: BTreeMap<String, usize>,
    /// For each declaration its index among the formals.
    formals: Vec<Option<u16>>,
    /// Declarations that are instances of an FB.
    pub instances: BTreeMap<usize, BlockId>,
    /// `VAR CONSTANT`, by name in capitals.
    pub constants: BTreeMap<String, Constant>,
    /// `y AT x : TYPE`, by name in capitals: the index of the underlying variable, and how it is seen.
    pub overlays: BTreeMap<String, (usize, DataType)>,
    /// Addresses into its instance are refused.
    pub optimized: bool,
    /// Its instance begins with the data block in the DI register.
    pub code_version1: bool,
    /// Of OB 1: where its input `Initial_Call` lies.
    pub initial_call: Option<BitAddr>,
    /// Inputs of an organization block that nothing supplies.
    pub unsupplied: BTreeSet<usize>,
    /// Inputs that take a data block as its number.
    pub db_any: BTreeSet<usize>,
}

/// A block's information for messages: `FC 9 (SYNCHRON_RESET)`.
pub fn called(id: BlockId, info: &Info) -> String {
    match &info.name {
        Some(name) => format!("{id} ({name})"),
        None => id.to_string(),
    }
}

impl Info {
    pub fn new(name: Option<String>, interface: Interface, instances: BTreeMap<usize, BlockId>) -> Self {
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
        let (constants, overlays) = (BTreeMap::new(), BTreeMap::new());
        Self {
            name,
            interface,
            names,
            formals,
            instances,
            constants,
            overlays,
            optimized: false,
            code_version1: false,
            initial_call: None,
            unsupplied: BTreeSet::new(),
            db_any: BTreeSet::new(),
        }
    }

    /// The index of what a name of the block means, and the type it is seen with where that is an overlay.
    pub fn declared(&self, name: &str) -> Option<(usize, Option<&DataType>)> {
        let name = name.to_uppercase();
        match self.names.get(&name) {
            Some(index) => Some((*index, None)),
            None => self.overlays.get(&name).map(|(index, ty)| (*index, Some(ty))),
        }
    }

    /// The index of a declaration by name or alias.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.names.get(&name.to_uppercase()).copied()
    }

    /// The index among the formals of a declaration.
    pub fn formal(&self, declaration: usize) -> Option<u16> {
        self.formals.get(declaration).copied().flatten()
    }
}

/// A data block, as statements can name it.
#[derive(Debug)]
pub struct Data {
    pub name: Option<String>,
    pub kind: DataKind,
    /// The declarations, composed types whole.
    pub components: Vec<Component>,
    names: BTreeMap<String, usize>,
    /// The load values, as they lie in the data block.
    pub image: Vec<u8>,
    pub read_only: bool,
    pub non_retain: bool,
    /// Addresses into it are refused.
    pub optimized: bool,
}

impl Data {
    pub fn new(kind: DataKind, components: Vec<Component>, image: Vec<u8>) -> Self {
        let names = components.iter().enumerate().map(|(i, c)| (c.path.to_uppercase(), i)).collect();
        Self { name: None, kind, components, names, image, read_only: false, non_retain: false, optimized: false }
    }

    pub fn find(&self, name: &str) -> Option<&Component> {
        self.components.get(*self.names.get(&name.to_uppercase())?)
    }
}

/// What a symbol stands for.
#[derive(Clone, Debug)]
pub enum Symbolic {
    Block(BlockWord, u16),
    Memory(Operand, Option<DataType>),
    Timer(u16),
    Counter(u16),
    /// The address in the table is not valid.
    Unknown(String),
    /// A block that could not be given a number (reported).
    Nameless,
}

/// Everything a statement can name.
#[derive(Debug, Default)]
pub struct World {
    /// The program's blocks and those of the library.
    pub blocks: BTreeMap<BlockId, Info>,
    pub data: BTreeMap<u16, Data>,
    /// By name in capitals.
    pub symbols: BTreeMap<String, Symbolic>,
    pub fields: FieldIndex,
    /// What the library says of blocks it does not have.
    pub explain: Option<fn(BlockId) -> Option<Missing>>,
    /// Names in capitals of the library's blocks, and of those that usually have one.
    pub names: BTreeMap<String, BlockId>,
    /// The program's own blocks, those with mistakes too.
    pub own: BTreeSet<BlockId>,
    /// Own data blocks that could not be made, with the block that is missing.
    pub unmade: BTreeMap<u16, BlockId>,
    /// Symbols of the peripheral area, in capitals: true for outputs.
    pub peripheral: BTreeMap<String, bool>,
}

impl World {
    /// What to say of a block that neither program nor library have, and what to do.
    pub fn unknown_block(&self, id: BlockId) -> Missing {
        self.explain.and_then(|explain| explain(id)).unwrap_or_else(|| Missing {
            message: match id.kind {
                BlockKind::Fb => {
                    format!("{id} and its instances: {USES}, and neither the program nor the library has it")
                }
                _ => format!("{id}: {USES}, and neither the program nor the library has it"),
            },
            remedy: match id.kind {
                BlockKind::Sfc | BlockKind::Sfb => {
                    "Leave the call out, or replace it: this CPU does not have it.".to_owned()
                }
                _ => messages::NO_BLOCK.remedy.to_owned(),
            },
            candidates: Vec::new(),
        })
    }

    /// Reports a use of a block that is not there, unless it is the program's own with a mistake. `given` are the
    /// parameters that a call supplies.
    pub fn report_missing(&self, id: BlockId, given: &[&str], file: usize, span: Span, sink: &mut Sink) {
        if self.own.contains(&id) {
            return;
        }
        sink.missing(&id.to_string(), file, span, &messages::NO_BLOCK, |_| {
            let missing = self.unknown_block(id);
            let remedy = missing.remedy_for(given);
            (missing.message, remedy)
        });
    }

    /// Reports a use of a data block that is not there, or of what it is made from.
    pub fn report_missing_data(&self, db: u16, name: &str, file: usize, span: Span, sink: &mut Sink) {
        if let Some(of) = self.unmade.get(&db) {
            return self.report_missing(*of, &[], file, span, sink);
        }
        if self.own.contains(&BlockId::new(BlockKind::Db, db)) {
            return;
        }
        sink.missing(&format!("DB {db}"), file, span, &messages::NO_DATA_BLOCK, |_| {
            let message = format!("DB {db} is not in the program, so it has no name {name}");
            (message, messages::NO_DATA_BLOCK.remedy.to_owned())
        });
    }

    /// Reports a use of a symbol that no table has.
    pub fn report_unknown_symbol(&self, name: &str, file: usize, span: Span, sink: &mut Sink) {
        let shown: String = name.chars().take(64).collect();
        sink.missing(&format!("\"{}", name.to_uppercase()), file, span, &messages::UNKNOWN_SYMBOL, |sink| {
            let message = format!("the symbol \"{shown}\" is in no symbol table");
            if let Some(id) = self.names.get(&name.to_uppercase()) {
                let remedy =
                    format!("Load the symbol table that has it; {shown} is also the usual name of {id}: CALL {id}.");
                return (message, remedy);
            }
            let near = sink.nearest(name, self.symbols.keys().map(String::as_str));
            let remedy =
                near.map_or_else(|| messages::UNKNOWN_SYMBOL.remedy.to_owned(), |near| format!("Did you mean {near}?"));
            (message, remedy)
        });
    }

    pub fn symbol(&self, name: &str) -> Option<&Symbolic> {
        self.symbols.get(&name.to_uppercase())
    }
}
