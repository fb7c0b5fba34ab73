//! Numbers for blocks that have none: a name at a block's own head, in no symbol table. Each gets the first number of
//! its kind that nothing in the program, its symbol tables and its libraries mentions.

mod demand;
pub use demand::OF_FUNCTIONS;
pub(crate) mod numbered;
mod ob_names;

use std::collections::{BTreeMap, BTreeSet};

use ob1_model::BlockId;

use crate::elaborate::Elaborator;
use crate::identifiers::BlockWord;
use crate::library::Library;
use crate::messages;
use crate::parser::{split_digits, unquote};
use crate::syntax::{Frame, NameRef};
use crate::token::{File, Kind, Span};
use crate::world::Symbolic;

pub use numbered::Numbered;

/// Numbers begin here: below it are those that people give.
const FIRST: u16 = 1000;

/// The numbers of a kind of block that are mentioned somewhere.
type Mentioned = BTreeMap<BlockWord, BTreeSet<u16>>;

/// A name without a number: as it is written first, what it names, and where.
struct Wanted {
    name: String,
    word: BlockWord,
    file: usize,
    span: Span,
}

impl Elaborator<'_> {
    /// Makes a symbol of each name that has no number: those the user has fixed, those of before, and new ones. Gives
    /// the ones that were given.
    pub(crate) fn number_names(&mut self, fixed: &[Numbered], kept: &[Numbered]) -> Vec<Numbered> {
        for one in fixed {
            self.world
                .symbols
                .insert(one.name.to_uppercase(), Symbolic::Block(BlockWord::of(one.id.kind), one.id.number));
        }
        let wanted = self.wanted();
        if wanted.is_empty() {
            return Vec::new();
        }
        let mut mentioned = mentioned(self.files, self.library, self.world.symbols.values());
        let kept: BTreeMap<String, BlockId> = kept.iter().map(|k| (k.name.to_uppercase(), k.id)).collect();
        for id in kept.values() {
            mentioned.entry(BlockWord::of(id.kind)).or_default().insert(id.number);
        }
        let mut next: BTreeMap<BlockWord, u16> = BTreeMap::new();
        let mut without_number = BTreeSet::new();
        let mut given = Vec::new();
        for (key, Wanted { name, word, file, span }) in wanted {
            self.sink.steps += 1;
            let before = kept.get(&key).filter(|id| BlockWord::of(id.kind) == word).map(|id| id.number);
            let Some(number) =
                before.or_else(|| free(mentioned.entry(word).or_default(), next.entry(word).or_insert(FIRST)))
            else {
                // Said once for each kind: what has no number is not there, and nothing else is said of it.
                if without_number.insert(word) {
                    let message = format!("there is no number left for \"{name}\" and those after it");
                    self.sink.report(file, span, &messages::NO_NUMBER, message);
                }
                self.world.symbols.insert(key, Symbolic::Nameless);
                continue;
            };
            self.world.symbols.insert(key, Symbolic::Block(word, number));
            if let Some(kind) = word.kind() {
                given.push(Numbered { name, id: BlockId::new(kind, number) });
            }
        }
        given
    }

    /// The names without a number, by their capitals.
    fn wanted(&mut self) -> BTreeMap<String, Wanted> {
        let mut wanted = BTreeMap::new();
        for block in self.blocks {
            let (NameRef::Symbol(name) | NameRef::Bare(name)) = &block.name else { continue };
            let key = name.to_uppercase();
            if name.is_empty() || self.world.symbols.contains_key(&key) {
                continue;
            }
            let word = match block.frame {
                Frame::Ob => {
                    self.name_ob(key, name, block.file, block.span);
                    continue;
                }
                Frame::Fc => BlockWord::Fc,
                Frame::Fb => BlockWord::Fb,
                Frame::Db => BlockWord::Db,
                Frame::Udt => BlockWord::Udt,
            };
            let (file, span) = (block.file, block.span);
            wanted.entry(key).or_insert_with(|| Wanted { name: name.clone(), word, file, span });
        }
        // Instance data blocks that only a call names.
        for block in self.blocks {
            let Some(file) = self.files.get(block.file) else { continue };
            for (fb, name, span) in scl_instances(file, block) {
                let key = name.to_uppercase();
                if self.is_function_block(fb) && !self.world.symbols.contains_key(&key) && is_no_address(name) {
                    let (file, word) = (block.file, BlockWord::Db);
                    wanted.entry(key).or_insert_with(|| Wanted { name: name.to_owned(), word, file, span });
                }
            }
            for statement in block.calls() {
                let tokens = file.tokens.get(statement.operand.clone()).unwrap_or_default();
                let Some(comma) = tokens.iter().position(|t| t.kind == Kind::Comma) else { continue };
                let Some(symbol) = tokens.iter().skip(comma + 1).find(|t| t.kind != Kind::Newline) else { continue };
                if symbol.kind != Kind::Symbol {
                    continue;
                }
                let name = unquote(file.of(*symbol));
                let key = name.to_uppercase();
                if !self.world.symbols.contains_key(&key) {
                    let (file, span) = (block.file, symbol.span);
                    let word = BlockWord::Db;
                    wanted.entry(key).or_insert_with(|| Wanted { name: name.to_owned(), word, file, span });
                }
            }
        }
        wanted
    }

    /// True for a function block of the sources, the symbol tables or the library.
    fn is_function_block(&self, name: &str) -> bool {
        let own = |block: &crate::syntax::Block| {
            let called = match &block.name {
                NameRef::Symbol(own) | NameRef::Bare(own) => own.eq_ignore_ascii_case(name),
                NameRef::Absolute(..) => false,
            };
            block.frame == Frame::Fb && called
        };
        match self.world.symbol(name) {
            Some(Symbolic::Block(word, _)) => matches!(word, BlockWord::Fb | BlockWord::Sfb),
            Some(_) => false,
            None => {
                let number = split_digits(name);
                let absolute = matches!(BlockWord::parse(number.0), Some(BlockWord::Fb | BlockWord::Sfb));
                absolute && !number.1.is_empty()
                    || self.blocks.iter().any(own)
                    || self.library.names().get(&name.to_uppercase()).is_some_and(|id| id.kind.has_instance())
            }
        }
    }

    /// An organization block gets its number by its name.
    fn name_ob(&mut self, key: String, name: &str, file: usize, span: Span) {
        match ob_names::number(name) {
            Some(number) => {
                self.world.symbols.insert(key, Symbolic::Block(BlockWord::Ob, number));
            }
            None => {
                let message = format!("\"{name}\" is not a name that STEP 7 or TIA Portal gives an organization block");
                let remedy =
                    format!("Write its number in the station file: [program] numbers = {{ \"{name}\" = \"OB 35\" }}");
                self.sink.report_with(file, span, &messages::OB_NAME, message, remedy);
                self.world.symbols.insert(key, Symbolic::Nameless);
            }
        }
    }
}

/// False for `DB5`, a data block by its number.
fn is_no_address(name: &str) -> bool {
    let (letters, digits) = split_digits(name);
    digits.is_empty() || BlockWord::parse(letters).is_none()
}

/// `FB.DB(` in statements of SCL: the name of the function block, and that of the data block with its place.
fn scl_instances<'f>(file: &'f File<'_>, block: &crate::syntax::Block) -> Vec<(&'f str, &'f str, Span)> {
    let tokens = block.scl.clone().and_then(|range| file.tokens.get(range)).unwrap_or_default();
    let is_name = |t: &crate::token::Token| matches!(t.kind, Kind::Word | Kind::Symbol);
    let calls = tokens.array_windows::<4>().filter(|[fb, dot, db, open]| {
        is_name(fb) && dot.kind == Kind::Dot && is_name(db) && open.kind == Kind::LeftParen
    });
    calls.map(|[fb, _, db, _]| (unquote(file.of(*fb)), unquote(file.of(*db)), db.span)).collect()
}

/// The first number from `next` on that is not taken; it is then. 0 in `next`: there is none left, nobody looks again.
fn free(taken: &mut BTreeSet<u16>, next: &mut u16) -> Option<u16> {
    if *next == 0 {
        return None;
    }
    let Some(number) = (*next..=u16::MAX).chain(1..FIRST).find(|n| !taken.contains(n)) else {
        *next = 0;
        return None;
    };
    taken.insert(number);
    *next = number.saturating_add(1);
    Some(number)
}

/// Every number that follows the word of a block.
fn mentioned<'s>(files: &[File<'_>], library: &Library, symbols: impl Iterator<Item = &'s Symbolic>) -> Mentioned {
    let mut mentioned = Mentioned::new();
    let mut mention = |word: BlockWord, number: u16| {
        let word = if word == BlockWord::Di { BlockWord::Db } else { word };
        mentioned.entry(word).or_default().insert(number);
    };
    for file in files {
        for (at, token) in file.tokens.iter().enumerate() {
            // All words of blocks have two or three letters.
            if token.kind != Kind::Word || token.span.end - token.span.start > 8 {
                continue;
            }
            let (letters, digits) = split_digits(file.of(*token));
            let Some(word) = BlockWord::parse(letters) else { continue };
            let next = file.tokens.get(at + 1).filter(|t| digits.is_empty() && t.kind == Kind::Number);
            if let Ok(number) = next.map_or(digits, |t| file.of(*t)).parse() {
                mention(word, number);
            }
        }
    }
    for id in library.numbers() {
        mention(BlockWord::of(id.kind), id.number);
    }
    for symbol in symbols {
        if let Symbolic::Block(word, number) = symbol {
            mention(*word, *number);
        }
    }
    mentioned
}
