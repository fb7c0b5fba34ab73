//! One statement of MC7. Its bytes, there and back: the opcode pages.

use std::fmt;

use ob1_ir::{Jump, Number, Op};
use ob1_model::BlockKind;

/// The form of a constant in the code: its width, and a sub-code that only says how it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ConstForm {
    /// 28: a constant of one byte.
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
    /// Number of the block, or where it is.
    pub number: Number,
    /// True for `CC`, false for `UC`.
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
    /// `LOOP` by so many words, likewise.
    Loop(i16),
    /// `SPL` with the number of `SPA`s that follow.
    JumpList(u16),
    /// A call without parameters: `UC` or `CC`.
    Call(Uncond),
    /// `BLD n`: a mark, without effect.
    Build(u8),
    /// `NOP 0`, without effect.
    Nop0,
    /// `NOP 1`, without effect.
    Nop1,
    /// `BE`: the last statement of a block.
    BlockEnd,
    /// `BEA`: ends the block before its last statement.
    End,
}

/// One statement of machine code.
#[derive(Clone, Debug, PartialEq)]
pub struct Statement {
    /// What it does, with its operands.
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
