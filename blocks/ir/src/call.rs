//! Calls: the called block, the kind of the call, and its parameters.

use ob1_model::{BitAddr, BlockId, BlockKind};

use crate::place::{Number, Operand};

/// Which block is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Target {
    /// A block known by number.
    Block(BlockId),
    /// `UC FC [MW 2]`, `UC FB [..]`, or a block given by parameter.
    Indirect(BlockKind, Number),
    /// A multi-instance: `CALL #pump`: the FB and where its instance begins within the caller's; with an instance data
    /// block within that: `CALL TON, "Data".delay` of TIA Portal.
    Local(BlockId, BitAddr),
}

/// How it is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CallMode {
    /// `CALL`: with actual parameters.
    Call,
    /// `UC`: with the pointers of [`Arg::Raw`], or nothing.
    Unconditional,
    /// `CC`: the same, when RLO = 1.
    Conditional,
}

/// An actual parameter, as the callee gets it.
#[derive(Clone, Debug, PartialEq, Hash)]
pub enum Arg {
    /// Not supplied (allowed for an FB's parameters: the instance keeps its value).
    Open,
    /// A constant of an elementary type, right-aligned in 32 bits.
    Const(u32),
    /// A constant of a composed type (STRING, DATE_AND_TIME, POINTER, ANY), as laid-out bytes. Operands supplied to
    /// POINTER and ANY come as such a constant; so does the actual of an FB's composed in/out, whose instance keeps a
    /// POINTER (`ob1_model::Param::is_pointer`). What is known at run time only comes otherwise: a POINTER or ANY to
    /// instance data is composed in the local data and handed over as an operand, and the POINTER of a composed
    /// in/out is written into the instance before the call, whose argument then is `Open`.
    Bytes(Box<[u8]>),
    /// An operand. M, E, A, L and DBX through the DB register go by reference; fully qualified data operands (`InDb`),
    /// peripheral, indirect and instance operands are copied before and after the call, as STEP 7 does. An operand of a
    /// composed type has the width of a byte and names its first; its length is that of the formal's type.
    Operand(Operand),
    /// A timer, counter or block number.
    Number(Number),
    /// `UC FC 5 { P#M 1.0 }`: one double word of the list that follows the call in machine code: the pointer to an
    /// elementary actual, the pointer to the POINTER or ANY of a composed one, or the number of a timer, counter or
    /// block in the high word. Area V is the caller's local data.
    Raw(u32),
}

/// A call statement with its actuals.
#[derive(Clone, Debug, PartialEq, Hash)]
pub struct Call {
    /// How it is called: `CALL`, `UC` or `CC`.
    pub mode: CallMode,
    /// Which block it enters.
    pub target: Target,
    /// Instance data block of an FB, or the data block that a [`Target::Local`] lies in.
    pub instance: Option<Number>,
    /// One entry per formal of the callee's interface, in its order. For `UC`/`CC` of an FC or SFC any number of
    /// [`Arg::Raw`], in the order of [`list_places`](ob1_model::Interface::list_places); else none.
    pub args: Vec<Arg>,
}
