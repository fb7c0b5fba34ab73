//! A name with the number it was given.

use ob1_ir::Symbol;
use ob1_model::BlockId;

/// A block's name with its number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Numbered {
    /// The name, without quotes.
    pub name: String,
    /// Kind and number that it was given.
    pub id: BlockId,
}

impl Numbered {
    /// The name as a symbol.
    pub fn symbol(&self) -> Symbol {
        Symbol { name: self.name.clone(), address: self.id.to_string(), ..Symbol::default() }
    }
}
