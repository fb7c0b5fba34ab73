//! One statement of MC7 and its bytes, exactly invertible.

use std::fmt;

use ob1_ir::{Jump, Number, Op};
use ob1_model::BlockKind;

use crate::bytes::Bytes;
use crate::pages::{bits, blocks, fixed, jumps, loads, registers, shifts, times};

/// The form of a constant in the code: its width, and a sub-code that only says how it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ConstForm {
    /// 28: one byte.
    Byte,
    /// 30, sub-code: 16 bits.
    Word(u8),
    /// 38, sub-code: 32 bits.
    DWord(u8),
}

/// `UC` or `CC` with what follows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncond {
    /// FC, FB, SFC or SFB.
    pub kind: BlockKind,
    /// Its number.
    pub number: Number,
    /// `CC`.
    pub conditional: bool,
    /// The pointers after a call of an FC or SFC; `None` after one of an FB or SFB.
    pub list: Option<Vec<u32>>,
}

/// What a statement does.
#[derive(Clone, Debug, PartialEq)]
pub enum Mc7Op {
    /// One operation of the instruction set. Its places have the forms of the machine: fixed, memory-indirect,
    /// register-indirect, or a whole formal parameter, counted in the order of the pointer list.
    Plain(Op),
    /// `L` of a constant.
    Constant(ConstForm, u32),
    /// `L P##parameter`: the pointer of the caller's list. `other` is FB CA, which is the same to all that is known.
    ParamPointer {
        /// The parameter, in the order of the list.
        index: u16,
        /// FB CA instead of FB CB.
        other: bool,
    },
    /// A jump by so many words from its own first byte.
    Jump(Jump, i16),
    /// `LOOP`, likewise.
    Loop(i16),
    /// `SPL` with the number of `SPA`s that follow.
    JumpList(u16),
    /// `UC`, `CC`.
    Call(Uncond),
    /// `BLD n`: a mark, without effect.
    Build(u8),
    /// `NOP 0`.
    Nop0,
    /// `NOP 1`.
    Nop1,
    /// `BE`.
    BlockEnd,
    /// `BEA`.
    End,
}

/// One statement.
#[derive(Clone, Debug, PartialEq)]
pub struct Statement {
    /// What it does.
    pub op: Mc7Op,
    /// The code has the long form, though the operand fits the short one.
    pub long: bool,
}

/// Why bytes are not a statement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoStatement {
    /// No statement begins like this.
    Unknown,
    /// The code ends within the statement.
    Cut,
}

impl fmt::Display for NoStatement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            NoStatement::Unknown => "no statement begins with these bytes",
            NoStatement::Cut => "the code ends within a statement",
        })
    }
}

impl From<Mc7Op> for Statement {
    fn from(op: Mc7Op) -> Self {
        Self { op, long: false }
    }
}

impl Statement {
    /// Reads the statement at the beginning of `code` and its length in bytes.
    ///
    /// # Errors
    /// [`NoStatement`] where none begins there, or where the code ends within it.
    pub fn read(code: &[u8]) -> Result<(Self, usize), NoStatement> {
        let b = Bytes(code);
        if code.len() < 2 {
            return Err(NoStatement::Cut);
        }
        let op = fixed::read(b.head());
        let found = op.map(|op| (Self { op: Mc7Op::Plain(op), long: false }, 2));
        // Pages that share first bytes tell each other apart by the second.
        let found = found
            .or_else(|| jumps::read(&b))
            .or_else(|| bits::read(&b))
            .or_else(|| loads::read(&b))
            .or_else(|| times::read(&b))
            .or_else(|| shifts::read(&b))
            .or_else(|| registers::read(&b))
            .or_else(|| blocks::read(&b));
        match found {
            None => Err(NoStatement::Unknown),
            Some((_, length)) if length > code.len() => Err(NoStatement::Cut),
            Some(found) => Ok(found),
        }
    }

    /// The bytes of the statement; `None` for what the machine has no form of.
    #[must_use]
    pub fn bytes(&self) -> Option<Vec<u8>> {
        match &self.op {
            Mc7Op::Plain(op) => fixed::write(op)
                .map(|word| word.to_be_bytes().to_vec())
                .or_else(|| bits::write(op, self.long))
                .or_else(|| loads::write(op, self.long))
                .or_else(|| times::write(op, self.long))
                .or_else(|| shifts::write(op))
                .or_else(|| registers::write(op))
                .or_else(|| blocks::write(op, self.long)),
            Mc7Op::Constant(form, value) => loads::write_constant(*form, *value),
            Mc7Op::ParamPointer { index, other } => blocks::write_pointer(*index, *other),
            Mc7Op::Call(call) => blocks::write_call(call, self.long),
            Mc7Op::Build(n) => Some(vec![0x10, *n]),
            Mc7Op::BlockEnd => Some(vec![0x65, 0]),
            Mc7Op::End => Some(vec![0x65, 1]),
            jump => jumps::write(jump),
        }
    }
}
