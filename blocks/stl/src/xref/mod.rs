//! The cross-reference: who reads and writes what.

mod assignment;
mod calls;
mod collect;
mod extent;
mod open;
mod query;
mod text;
mod writers;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Deref;

use ob1_ir::{Number, Op, Program, Symbol, Target};
use ob1_model::{BlockId, Interface, named};

use crate::library::Library;
use crate::words::Words;
use extent::{Extent, Instances, Wanted};

pub use assignment::{AREAS, Assignment, ByteUse, WrittenTwice};
pub use extent::Match;
pub use query::Unknown;
pub use text::{address_in_set, in_set, render_xref};

named! {
    /// What a statement does to an operand.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Access {
        /// It reads the operand.
        Read = "R",
        /// It writes the operand.
        Write = "W",
        /// Both: edge bits, in/outs, parameters of blocks that are not known.
        ReadWrite = "RW",
        /// It calls the block.
        Call = "call",
        /// It opens the data block, or runs a function block on it.
        Open = "open",
        /// It loads a pointer to it.
        Point = "ptr",
    }
}

impl Access {
    /// Whether it may read and whether it may write.
    const fn does(self) -> [bool; 2] {
        match self {
            Access::Read => [true, false],
            Access::Write => [false, true],
            _ => [true, true],
        }
    }
}

/// One use of an operand.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Reference {
    /// Puts operands in the order of a cross-reference: E, A, M, peripheral, T, Z, DB, blocks, then what is indirect,
    /// then the names of single blocks; by number and address within.
    order: (u8, u32, u32, u8),
    /// The operand in German mnemonics: `M 1.0`, `DB10.DBW 20`, `T 5`, `FC 9`; `FB 3 #speed` for a name of a block;
    /// `DBW [MD 184]` where it is known at run time only. [`in_set`] has it in the other set.
    pub operand: String,
    /// Its symbol, or the component's name in a data block.
    pub symbol: Option<String>,
    extent: Extent,
    /// The address is known at run time only.
    pub indirect: bool,
    /// The block with the statement.
    pub block: BlockId,
    /// The network, from 1.
    pub network: u16,
    /// The line, from 1.
    pub line: u32,
    /// What is done to the operand.
    pub access: Access,
    /// The formal it is supplied to, for actual parameters: `FC 9.ANL`.
    pub via: Option<String>,
    /// The index of the block's source among those of the program.
    pub source: u32,
    /// It gives a value each time, as `=` and `T` do and `S` and `R` do not.
    assigns: bool,
}

/// The cross-reference of a program, sorted by operand, then by place. Parameters of blocks outside the program count
/// as read and written; [`xref_with`] is more exact.
pub fn xref(program: &Program) -> Vec<Reference> {
    xref_with(program, &Library::new())
}

/// The cross-reference of a program that calls blocks of a library.
pub fn xref_with(program: &Program, library: &Library) -> Vec<Reference> {
    let interfaces: BTreeMap<BlockId, &Interface> = library
        .iter()
        .map(|(id, block)| (id, &block.interface))
        .chain(program.blocks.iter().map(|b| (b.id, &b.interface)))
        .collect();
    collect::collect(program, &interfaces)
}

/// A cross-reference that can be asked. `P` leads to its program: `&Program`, or `Arc<Program>` for one that is kept.
#[derive(Debug)]
pub struct CrossReference<P> {
    program: P,
    /// All uses, sorted by operand, then by place.
    pub all: Vec<Reference>,
    instances: Instances,
    words: Words,
    /// What the symbols of the table stand for.
    symbols: Vec<(Wanted, String)>,
}

/// The uses of one operand.
#[derive(Clone, Debug)]
pub struct Uses<'x> {
    /// What was asked for, in German mnemonics.
    pub operand: String,
    /// Its symbol; `None`: it has none.
    pub symbol: Option<String>,
    /// Each use, with how it meets what was asked for.
    pub found: Vec<(Match, &'x Reference)>,
}

impl<P: Deref<Target = Program>> CrossReference<P> {
    /// Of a program that calls blocks of a library.
    pub fn new(program: P, library: &Library) -> Self {
        let words = Words::of_both();
        let meaning = |symbol: &Symbol| Some((query::of_symbol(symbol, &words)?.0, symbol.name.clone()));
        let symbols = program.symbols.iter().filter_map(meaning).collect();
        let (all, instances) = (xref_with(&program, library), instances(&program));
        Self { program, all, instances, words, symbols }
    }

    /// The program that it is about.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The uses of an operand, in either set of mnemonics; of a symbol, a component, a block; of a part: `DB 10`, `E
    /// 8`, `M`. Whatever reaches a bit of it is found, and whatever may, because its address is known at run time
    /// only.
    ///
    /// # Errors
    /// [`Unknown`]: there is no such thing.
    pub fn find(&self, text: &str) -> Result<Uses<'_>, Unknown> {
        let question = query::parse(text, self)?;
        let found = self.meeting(&question.wanted).collect();
        Ok(Uses { operand: question.name, symbol: question.symbol, found })
    }

    fn meeting(&self, wanted: &Wanted) -> impl Iterator<Item = (Match, &Reference)> {
        self.all.iter().filter_map(|reference| {
            let access = reference.access.does();
            let how = wanted.meets(&reference.extent, &reference.operand, access, &self.instances)?;
            Some((how, reference))
        })
    }
}

/// The function blocks whose instances each data block holds, those within them too.
fn instances(program: &Program) -> Instances {
    let mut within: BTreeMap<BlockId, BTreeSet<(BlockId, u32)>> = BTreeMap::new();
    let mut roots: BTreeSet<(u16, BlockId, u32)> = BTreeSet::new();
    for data in &program.data {
        if let ob1_ir::DataKind::Instance(fb) = data.kind {
            roots.insert((data.number, fb, 0));
        }
    }
    for block in &program.blocks {
        for stmt in &block.code {
            let Op::Call(call) = &stmt.op else { continue };
            match (call.target, call.instance) {
                (Target::Block(fb), Some(Number::Fixed(db))) => {
                    roots.insert((db, fb, 0));
                }
                (Target::Local(fb, at), Some(Number::Fixed(db))) => {
                    roots.insert((db, fb, at.0));
                }
                (Target::Local(fb, at), None) => {
                    within.entry(block.id).or_default().insert((fb, at.0));
                }
                _ => {}
            }
        }
    }
    let mut all = Instances::new();
    for (db, fb, at) in roots {
        // A block cannot hold itself, but a wrong program may say so: each place is entered once.
        let (mut seen, mut open) = (BTreeSet::new(), vec![(fb, at)]);
        while let Some(place) = open.pop() {
            if place.1 >= 1 << 19 || !seen.insert(place) {
                continue;
            }
            open.extend(within.get(&place.0).into_iter().flatten().map(|(fb, at)| (*fb, place.1.saturating_add(*at))));
        }
        all.entry(db).or_default().extend(seen);
    }
    all
}
