//! How a program is put together: where the parameters lie, and where, when and in which block its pieces run.

use std::fmt::Write as _;

use crate::compare::random::Random;

use super::text::{Operand, Program, Type};

/// Where parameters of a piece of program lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Store {
    /// Bit memory.
    Memory,
    /// A global data block ([`DATA_DB`]).
    Data,
    /// Static variables of a function block in which the piece runs.
    Static,
}

/// The data block of [`Store::Data`].
pub const DATA_DB: u16 = 20;
/// Its length.
const DATA_BYTES: u16 = 400;
/// Bit memory that [`Shape::operand`] gives out.
const MEMORY: std::ops::Range<u32> = 300..900;

/// Where a piece of program runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Home {
    /// In OB 1 itself.
    Ob1,
    /// In an FC that OB 1 calls.
    Fc,
    /// In an FB with an instance data block.
    Fb,
    /// In an FB that is a multi-instance of another.
    Multi,
    /// In OB 35.
    Ob35,
}

/// When a piece of program runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rhythm {
    /// In each scan.
    Always,
    /// In every n-th.
    Nth(u32),
    /// While this condition (STL that ends with an RLO) is true.
    While(String),
}

/// A piece of program with its local variables.
#[derive(Clone, Debug, Default)]
pub struct Piece {
    /// Its text.
    pub text: String,
    /// Static variables: name and type.
    pub statics: Vec<(String, Type)>,
    /// Multi-instances: name and function block.
    pub instances: Vec<(&'static str, &'static str)>,
}

/// A program being put together.
#[derive(Debug)]
pub struct Shape {
    /// Blocks and places.
    pub program: Program,
    /// What OB 1 does at its beginning, before the pieces.
    pub head: String,
    ob1: String,
    ob35: String,
    memory: u32,
    data: u32,
    numbers: u16,
}

impl Default for Shape {
    fn default() -> Self {
        Self {
            program: Program::default(),
            head: String::new(),
            ob1: String::new(),
            ob35: String::new(),
            memory: MEMORY.start,
            data: 0,
            numbers: 30,
        }
    }
}

impl Shape {
    /// A new operand of this type in `store`; `name` is that of a static variable.
    pub fn operand(&mut self, store: Store, of: Type, name: &str, piece: &mut Piece) -> Operand {
        let bytes = of.bytes().max(1).next_multiple_of(2);
        match store {
            Store::Memory => {
                self.memory += bytes;
                assert!(self.memory <= MEMORY.end, "bit memory is used up");
                Operand::Memory(self.memory - bytes, 0)
            }
            Store::Data => {
                self.data += bytes;
                assert!(self.data <= u32::from(DATA_BYTES), "the data block is used up");
                Operand::Data(DATA_DB, self.data - bytes, 0)
            }
            Store::Static => {
                let name = format!("{}{}", name.to_lowercase(), piece.statics.len());
                piece.statics.push((name.clone(), of));
                Operand::Local(name)
            }
        }
    }

    /// Bits that lie in one byte, and the byte. Static variables have no byte in common: the byte is another variable.
    pub fn bits(&mut self, store: Store, names: &[&str], piece: &mut Piece) -> (Vec<Operand>, Operand) {
        let byte = self.operand(store, Type::Byte, "control", piece);
        let bits = (0..).zip(names).map(|(bit, name)| match &byte {
            Operand::Memory(byte, _) => Operand::Memory(*byte, bit),
            Operand::Data(db, byte, _) => Operand::Data(*db, *byte, bit),
            _ => self.operand(store, Type::Bool, name, piece),
        });
        (bits.collect(), byte)
    }

    /// Puts a piece into the program. Pieces of OB 1 run in the order of these calls.
    pub fn put(&mut self, piece: Piece, home: Home, rhythm: &Rhythm) {
        let home = match home {
            Home::Ob1 | Home::Fc | Home::Ob35 if !piece.statics.is_empty() || !piece.instances.is_empty() => Home::Fb,
            home => home,
        };
        let number = self.numbers;
        self.numbers += 2;
        let statics = piece.statics.iter().map(|(name, of)| (name.as_str(), of.name()));
        let statics = statics.chain(piece.instances.iter().copied());
        let statics = statics.fold(String::from("VAR\n"), |mut out, (name, of)| {
            let _ = writeln!(out, "{name} : {of};");
            out
        }) + "END_VAR\n";
        let text = match home {
            Home::Ob1 | Home::Ob35 => piece.text,
            Home::Fc => {
                self.program.block("FUNCTION", &format!("FC {number}"), "", &piece.text);
                format!("CALL FC {number};\n")
            }
            Home::Fb => {
                self.program.block("FUNCTION_BLOCK", &format!("FB {number}"), &statics, &piece.text);
                self.program.instance(number, &format!("FB {number}"));
                format!("CALL FB {number}, DB {number};\n")
            }
            Home::Multi => {
                let (inner, outer) = (format!("FB {}", number + 1), format!("FB {number}"));
                self.program.block("FUNCTION_BLOCK", &inner, &statics, &piece.text);
                let declarations = format!("VAR\nspace : WORD;\ninner : {inner};\nEND_VAR\n");
                self.program.block("FUNCTION_BLOCK", &outer, &declarations, "CALL #inner;\n");
                self.program.instance(number, &outer);
                format!("CALL {outer}, DB {number};\n")
            }
        };
        let text = match rhythm {
            Rhythm::Always => text,
            Rhythm::Nth(n) => {
                self.memory += 2;
                let counter = self.memory - 2;
                self.program.every(*n, counter, &text)
            }
            Rhythm::While(condition) => self.program.only_if(condition, &text),
        };
        if home == Home::Ob35 { self.ob35 += &text } else { self.ob1 += &text }
    }

    /// Puts text at the end of OB 35, guarded by `condition`.
    pub fn put_ob35(&mut self, text: &str) {
        self.ob35 += text;
    }

    /// The finished text; `start` is that of OB 100.
    #[must_use]
    pub fn finish(mut self, start: &str) -> (String, Vec<super::text::Site>) {
        self.program.data_block(DATA_DB, DATA_BYTES);
        let ob1 = self.head + &self.ob1;
        self.program.block("ORGANIZATION_BLOCK", "OB 100", "", start);
        self.program.block("ORGANIZATION_BLOCK", "OB 1", "", &ob1);
        if !self.ob35.is_empty() {
            self.program.block("ORGANIZATION_BLOCK", "OB 35", "", &self.ob35);
        }
        self.program.finish()
    }
}

/// Draws a store.
pub fn store(random: &mut Random) -> Store {
    [Store::Memory, Store::Memory, Store::Data, Store::Static][random.below(4)]
}

/// Draws a place.
pub fn home(random: &mut Random) -> Home {
    [Home::Ob1, Home::Ob1, Home::Ob1, Home::Fc, Home::Fb, Home::Multi][random.below(6)]
}

/// Draws a rhythm: mostly each scan.
pub fn rhythm(random: &mut Random) -> Rhythm {
    match random.below(8) {
        0 => Rhythm::Nth(2),
        1 => Rhythm::Nth(2 + random.below(6) as u32),
        _ => Rhythm::Always,
    }
}
