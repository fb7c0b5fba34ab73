//! What is asked for: an operand in either set of mnemonics, a symbol, a component, a part of one of these.

use std::fmt;
use std::ops::Deref;

use ob1_ir::{Operand, Place, Program, Symbol, Width};
use ob1_model::{Area, BlockKind, Component, Layout};

use super::extent::Wanted;
use super::{CrossReference, Reference};
use crate::diagnostic::Sink;
use crate::identifiers::{BlockWord, Identifier};
use crate::parser::split_digits;
use crate::symbols;
use crate::words::Words;
use crate::world::Symbolic;

/// All the bits of an area or a data block.
const ALL: u32 = u32::MAX;

/// What asks for everything that is known at run time only.
const AT_RUN_TIME: &str = "INDIRECT";

/// A name that is neither an operand nor a name of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unknown {
    /// As it was asked for.
    pub name: String,
    /// What may be meant.
    pub remedy: String,
}

impl fmt::Display for Unknown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{}\" is no operand and no symbol of the program", self.name)
    }
}

/// What is asked for, with the name under which an answer tells it.
pub(super) struct Question {
    pub(super) wanted: Wanted,
    /// The operand in German mnemonics.
    pub(super) name: String,
    pub(super) symbol: Option<String>,
}

pub(super) fn parse<P: Deref<Target = Program>>(text: &str, x: &CrossReference<P>) -> Result<Question, Unknown> {
    let (program, words, all) = (&*x.program, &x.words, x.all.as_slice());
    let trimmed = text.trim();
    let question = |wanted, name: String, symbol| Question { wanted, name, symbol };
    if let Some(symbol) = symbol(trimmed, program)
        && let Some((wanted, name)) = of_symbol(symbol, words)
    {
        return Ok(question(wanted, name, Some(symbol.name.clone())));
    }
    if let Some((wanted, name)) = component(trimmed, x).or_else(|| address(&trimmed.replace('"', ""), words)) {
        let symbol = x.symbols.iter().find(|(of, _)| *of == wanted).map(|(_, name)| name.clone());
        return Ok(question(wanted, name, symbol));
    }
    if trimmed.eq_ignore_ascii_case(AT_RUN_TIME) {
        return Ok(question(Wanted::AtRunTime, AT_RUN_TIME.to_lowercase(), None));
    }
    if trimmed.contains('#') {
        let name = own(trimmed);
        let wanted = Wanted::Own(name.to_uppercase());
        if all.iter().any(|r| wanted.meets(&r.extent, &r.operand, [true; 2], &super::Instances::new()).is_some()) {
            return Ok(question(wanted, name, None));
        }
    }
    Err(unknown(trimmed, program, all))
}

/// `FB20#on` as `FB 20 #on`.
fn own(text: &str) -> String {
    let (block, name) = text.split_once('#').unwrap_or((text, ""));
    let (word, digits) = split_digits(block.trim());
    if word.trim().is_empty() {
        return format!("#{name}");
    }
    format!("{} {} #{name}", word.trim().to_uppercase(), digits.trim())
}

fn symbol<'p>(text: &str, program: &'p Program) -> Option<&'p Symbol> {
    let name = text.trim_matches('"').to_uppercase();
    program.symbols.iter().find(|symbol| symbol.name.to_uppercase() == name)
}

pub(super) fn of_symbol(symbol: &Symbol, words: &Words) -> Option<(Wanted, String)> {
    match symbols::address(symbol, words) {
        Symbolic::Memory(operand, _) => of_operand(operand, &symbol.address),
        Symbolic::Timer(n) => Some((Wanted::Timers(n, n), format!("T {n}"))),
        Symbolic::Counter(n) => Some((Wanted::Counters(n, n), format!("Z {n}"))),
        Symbolic::Block(word, n) => block(word, n),
        Symbolic::Unknown(_) | Symbolic::Nameless => None,
    }
}

fn block(word: BlockWord, number: u16) -> Option<(Wanted, String)> {
    let kind = word.kind()?;
    let name = format!("{} {number}", kind.name());
    if kind == BlockKind::Db {
        return Some((Wanted::Data { db: number, at: 0, bits: ALL }, name));
    }
    Some((Wanted::Blocks(kind, number, number), name))
}

/// `written` is the text: `PAW 4` is not `PEW 4`.
fn of_operand(operand: Operand, written: &str) -> Option<(Wanted, String)> {
    let bits = u32::from(operand.width.bits());
    match operand.place {
        Place::Fixed(area @ (Area::Input | Area::Output | Area::Memory), at) => {
            Some((Wanted::Bits { area, at: at.0, bits, written: None }, operand.to_string()))
        }
        Place::Fixed(Area::Peripheral, at) => {
            let letter = written.trim().chars().nth(1).map(|letter| letter.to_ascii_uppercase());
            let (written, german) = match letter {
                Some('A' | 'Q') => (Some(true), "PA"),
                Some('E' | 'I') => (Some(false), "PE"),
                _ => (None, "P"),
            };
            let name = operand.to_string().replacen('P', german, 1);
            Some((Wanted::Bits { area: Area::Peripheral, at: at.0, bits, written }, name))
        }
        Place::InDb(db, at) | Place::InDi(db, at) => {
            Some((Wanted::Data { db, at: at.0, bits }, Operand { place: Place::InDb(db, at), ..operand }.to_string()))
        }
        _ => None,
    }
}

/// `DB10.pump[2].speed`, `"Recipe".pump`: a component or what it is part of.
fn component<P: Deref<Target = Program>>(text: &str, x: &CrossReference<P>) -> Option<(Wanted, String)> {
    let program: &Program = &x.program;
    let (block, path) = split_path(text)?;
    let block = block.trim().trim_matches('"');
    let number = |data: &&ob1_ir::DataBlock| {
        let named = data.name.as_deref().is_some_and(|name| name.eq_ignore_ascii_case(block));
        named || block.replace(' ', "").eq_ignore_ascii_case(&format!("DB{}", data.number))
    };
    let by_symbol = || match symbol(block, program).map(|s| symbols::address(s, &x.words)) {
        Some(Symbolic::Block(BlockWord::Db | BlockWord::Di, n)) => program.data.iter().find(|data| data.number == n),
        _ => None,
    };
    let data = program.data.iter().find(number).or_else(by_symbol)?;
    let db = data.number;
    let path = path.trim().replace('"', "");
    if let Some(found) = Component::find(&data.components, &path) {
        let wanted = Wanted::Data { db, at: found.at.0, bits: Layout::bits(&found.ty) };
        return Some((wanted, format!("DB{db}.{}", found.path)));
    }
    // An absolute address behind the name of the block.
    address(&format!("DB{db}.{path}"), &x.words)
}

fn split_path(text: &str) -> Option<(&str, &str)> {
    match text.strip_prefix('"') {
        Some(rest) => {
            let (name, path) = rest.split_once('"')?;
            Some((name, path.trim().strip_prefix('.')?))
        }
        None => text.split_once('.'),
    }
}

/// An address: whole, or an area, a byte without its bit, a kind of block.
fn address(text: &str, words: &Words) -> Option<(Wanted, String)> {
    let whole = Symbol { address: text.to_owned(), ..Symbol::default() };
    if let Some(found) = of_symbol(&whole, words) {
        return Some(found);
    }
    let (word, digits) = split_digits(text);
    let (word, digits) = (word.trim(), digits.trim());
    let number: Option<u32> = digits.parse().ok();
    match words.identifier(word)? {
        Identifier::Memory(area @ (Area::Input | Area::Output | Area::Memory | Area::Peripheral), Width::Bit) => {
            if digits.is_empty() {
                return Some((Wanted::Bits { area, at: 0, bits: ALL, written: None }, area.name().to_owned()));
            }
            let at = number.filter(|byte| *byte <= ob1_model::BitAddr::MAX_BYTE)? * 8;
            let name = format!("{}B {digits}", area.name());
            Some((Wanted::Bits { area, at, bits: 8, written: None }, name))
        }
        Identifier::Timer if digits.is_empty() => Some((Wanted::Timers(0, u16::MAX), "T".to_owned())),
        Identifier::Counter if digits.is_empty() => Some((Wanted::Counters(0, u16::MAX), "Z".to_owned())),
        Identifier::Block(word) if digits.is_empty() => {
            let kind = word.kind()?;
            Some((Wanted::Blocks(kind, 0, u16::MAX), kind.name().to_owned()))
        }
        _ => None,
    }
}

fn unknown(text: &str, program: &Program, all: &[Reference]) -> Unknown {
    let mut sink = Sink::new();
    let plain = text.trim_matches('"');
    let symbols = program.symbols.iter().map(|symbol| symbol.name.as_str());
    let blocks = program.data.iter().filter_map(|data| data.name.as_deref());
    let blocks = blocks.chain(program.blocks.iter().filter_map(|block| block.name.as_deref()));
    let parts = all.iter().filter_map(|reference| reference.symbol.as_deref());
    let own = all.iter().filter_map(|r| r.operand.split_once('#').map(|(_, name)| name));
    let near = sink.nearest(plain, symbols.chain(blocks)).or_else(|| sink.nearest(plain, parts));
    let remedy = near.or_else(|| sink.nearest(plain.trim_start_matches('#'), own)).map_or_else(
        || "Write an operand (E 1.0, I 1.0, MW 10, DB10.DBW 4, T 5), a symbol, or a part: DB 10, E 8, M.".to_owned(),
        |near| format!("Did you mean \"{near}\"?"),
    );
    Unknown { name: text.to_owned(), remedy }
}
