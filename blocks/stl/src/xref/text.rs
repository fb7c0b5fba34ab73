//! The cross-reference as text.

use std::fmt::Write as _;

use ob1_ir::Program;

use super::{Access, Reference};
use crate::identifiers::IDENTIFIERS;
use crate::mnemonics::Mnemonics;

/// An operand in German mnemonics, `E 8.0`, in another set: `I 8.0`.
pub fn in_set(operand: &str, set: Mnemonics) -> String {
    let end = operand.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(operand.len());
    let (word, rest) = operand.split_at(end);
    let row = IDENTIFIERS.iter().find(|(german, ..)| *german == word).filter(|_| set == Mnemonics::International);
    format!("{}{rest}", row.map_or(word, |(_, international, _)| international))
}

/// An address of a symbol table, as either set and any spelling have it (`I   8.0`, `ew4`), in a set: `E 8.0`. `None`:
/// it has no number.
pub fn address_in_set(address: &str, set: Mnemonics) -> Option<String> {
    let address = address.trim();
    let (word, number) = address.split_at(address.find(|c: char| c.is_ascii_digit())?);
    let word = word.trim().to_ascii_uppercase();
    let row = IDENTIFIERS.iter().find(|(german, international, ..)| [*german, *international].contains(&word.as_str()));
    let word = row.map_or(
        word.as_str(),
        |(german, international, ..)| {
            if set == Mnemonics::International { international } else { german }
        },
    );
    Some(format!("{word} {number}"))
}

impl Reference {
    /// Whether it certainly writes the operand.
    pub const fn writes(&self) -> bool {
        matches!(self.access, Access::Write | Access::ReadWrite)
    }

    /// The operand in a set of mnemonics.
    pub fn operand_in(&self, set: Mnemonics) -> String {
        in_set(&self.operand, set)
    }

    /// Where it is: `FB 20, network 1, press.awl:23`.
    pub fn place(&self, program: &Program) -> String {
        let Self { block, network, line, source, .. } = self;
        match program.sources.get(*source as usize) {
            Some(file) => format!("{block}, network {network}, {file}:{line}"),
            None => format!("{block}, network {network}, line {line}"),
        }
    }
}

/// References as text: each operand with its symbol, below it one line for each place.
pub fn render_xref<'r>(
    references: impl IntoIterator<Item = &'r Reference>,
    program: &Program,
    set: Mnemonics,
) -> String {
    let mut out = String::new();
    let mut last: Option<&str> = None;
    for reference in references {
        let Reference { operand, symbol, indirect, access, via, .. } = reference;
        if last != Some(operand.as_str()) {
            let symbol = symbol.as_ref().map(|s| format!("  \"{s}\"")).unwrap_or_default();
            let indirect = if *indirect { "  (indirect)" } else { "" };
            let _ = writeln!(out, "{}{symbol}{indirect}", in_set(operand, set));
            last = Some(operand);
        }
        let via = via.as_ref().map(|v| format!("  as {v}")).unwrap_or_default();
        let _ = writeln!(out, "    {:<4}  {}{via}", access.name(), reference.place(program));
    }
    out
}
