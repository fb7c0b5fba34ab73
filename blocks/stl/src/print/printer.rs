//! What prints, what it is given, and why it cannot.

use std::collections::BTreeMap;
use std::fmt;

use ob1_ir::Notation;
use ob1_model::{BlockId, Interface};

use crate::Mnemonics;
use crate::identifiers::{IDENTIFIERS, Identifier};
use crate::mnemonics::{ROWS, Shape};

/// What a listing shows besides the statements, by the index of the statement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Listing {
    /// Labels; a target without one gets `M001` and so on.
    pub labels: BTreeMap<u32, String>,
    /// How constants are written.
    pub notations: BTreeMap<u32, Notation>,
    /// Comment lines before a statement.
    pub before: BTreeMap<u32, Vec<String>>,
    /// Comments at the end of a statement's line.
    pub beside: BTreeMap<u32, String>,
    /// Title and comment of each network, from network 1 on. Networks without statements are shown too.
    pub networks: Vec<(String, String)>,
}

/// Why a block cannot be printed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unprintable {
    /// Kind and number of the block.
    pub block: BlockId,
    /// The statement; `None` for the declarations.
    pub statement: Option<u32>,
    /// What no source can express.
    pub what: String,
}

impl fmt::Display for Unprintable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.block)?;
        if let Some(statement) = self.statement {
            write!(f, ", statement {statement}")?;
        }
        write!(f, ": no source says {}", self.what)
    }
}

impl std::error::Error for Unprintable {}

/// Interfaces of the blocks that are called.
pub type Callees<'c> = dyn Fn(BlockId) -> Option<&'c Interface> + 'c;

/// Prints blocks in one set of mnemonics.
#[derive(Clone, Copy)]
pub struct Printer<'p> {
    mnemonics: Mnemonics,
    pub(super) callees: &'p Callees<'p>,
    /// Symbols of absolute operands, `M 1.0` to `Motor`; without one the address is printed.
    pub(super) symbols: Option<&'p BTreeMap<String, String>>,
}

impl fmt::Debug for Printer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Printer").field("mnemonics", &self.mnemonics).finish_non_exhaustive()
    }
}

impl<'p> Printer<'p> {
    /// A printer; `callees` gives the names of parameters. [`Mnemonics::Auto`] prints German.
    pub fn new(mnemonics: Mnemonics, callees: &'p Callees<'p>) -> Self {
        Self { mnemonics, callees, symbols: None }
    }

    /// Prints symbols for absolute operands: the key is the operand as this printer writes it.
    #[must_use]
    pub const fn with_symbols(self, symbols: &'p BTreeMap<String, String>) -> Self {
        Self { symbols: Some(symbols), ..self }
    }

    pub(super) fn international(&self) -> bool {
        self.mnemonics == Mnemonics::International
    }

    /// The last mnemonic of a shape: `BEA` comes after `BE`.
    pub(super) fn mnemonic(&self, shape: &dyn Fn(&Shape) -> bool) -> &'static str {
        let row = ROWS.iter().rev().find(|row| shape(&row.shape));
        row.map_or("", |row| if self.international() { row.international } else { row.german })
    }

    /// The first identifier that names this, the last when `last`.
    pub(super) fn identifier(&self, wanted: Identifier, last: bool) -> Option<&'static str> {
        let mut found = IDENTIFIERS.iter().filter(|(_, _, identifier)| *identifier == wanted);
        let (german, international, _) = if last { found.next_back() } else { found.next() }?;
        Some(if self.international() { international } else { german })
    }
}

/// A name as it may be in a source: as it is, or in quotes.
pub(super) fn quoted(name: &str) -> String {
    let mut chars = name.chars();
    let plain =
        chars.next().is_some_and(|c| c.is_alphabetic() || c == '_') && chars.all(|c| c.is_alphanumeric() || c == '_');
    if plain { name.to_owned() } else { format!("\"{name}\"") }
}
