//! Calls with their parameters resolved.

use ob1_ir::{CallMode, Place};
use ob1_model::BlockKind;

use super::Callee;
use crate::arena::{ArenaBit, ArenaByte};
use crate::scan_position::Packed;

/// Which block a call enters.
#[derive(Clone, Copy, Debug, Hash)]
pub enum CallTarget {
    /// Known at load: every execution calls the same block.
    Known(Callee),
    /// `UC FC [MW 4]`: found when it is called.
    Indirect(BlockKind, ob1_ir::Number),
}

/// On which data a function block runs.
#[derive(Clone, Copy, Debug, Hash)]
pub enum InstanceOf {
    /// An FC, or `UC`/`CC`: registers stay.
    None,
    /// `CALL FB n, DB m`.
    Db(ob1_ir::Number),
    /// A multi-instance at this bit of the caller's instance.
    Local(u32),
    /// At this bit of a data block.
    Within(ob1_ir::Number, u32),
}

/// The reference to an actual parameter of an FC.
#[derive(Clone, Copy, Debug, Hash)]
pub enum RefArg {
    /// Bit of the caller's local data.
    Local(u32),
    /// The caller's own formal, plus an offset.
    Param {
        /// Index of the formal in the caller's interface, from 0.
        index: u16,
        /// Bits to add to what it refers to.
        at: u32,
    },
    /// A bit of the opened data block: a reference, checked for `bits` at the call.
    Db {
        /// Bit of the data block, from its begin.
        at: u32,
        /// Bits it must have.
        bits: u32,
    },
    /// The number of a timer, counter or block.
    Number(ob1_ir::Number),
    /// The value of an operand, for a number given as a WORD.
    Value(Place),
    /// Copied into the call's scratch at this bit, and back when `out`.
    Copy {
        /// The operand that is copied.
        place: Place,
        /// Its bits, 32 at most.
        bits: u32,
        /// Bit of the call's scratch.
        scratch: u32,
        /// It goes back after the call.
        out: bool,
    },
    /// A composed actual of an indirect place or data block: referred to where it lies.
    Located {
        /// The operand that is referred to.
        place: Place,
        /// Bits it must have.
        bits: u32,
        /// The callee writes it.
        out: bool,
    },
    /// A composed constant the callee may overwrite: its bytes in the arena, and how many.
    Bytes {
        /// First byte of the constant.
        at: ArenaByte,
        /// Length of the constant in bytes.
        len: u32,
        /// Bit of the call's scratch.
        scratch: u32,
    },
    /// A constant the callee may overwrite.
    Scratch {
        /// Value of the constant, right-aligned.
        value: u32,
        /// How many bits the constant has, 32 at most.
        bits: u8,
        /// Bit of the call's scratch.
        scratch: u32,
    },
}

/// What goes into an instance before a call of an FB.
#[derive(Clone, Copy, Debug, Hash)]
pub enum InSource {
    /// A value known at load, right-aligned.
    Const(u32),
    /// A bit of the arena.
    Arena(ArenaBit),
    /// Bytes of the constants.
    Bytes {
        /// First byte of the constant in the arena.
        at: ArenaByte,
        /// Length of the constant in bytes.
        len: u32,
    },
    /// An operand, found at the call.
    Place(Place),
    /// The number of a timer, counter or block.
    Number(ob1_ir::Number),
}

/// One copy between an actual and the instance.
#[derive(Clone, Copy, Debug, Hash)]
pub struct InstanceIn {
    /// What is copied into the instance.
    pub from: InSource,
    /// Bit of the instance.
    pub at: u32,
    /// Bits; above 32 they are copied as bytes.
    pub bits: u32,
}

/// Where a result goes.
#[derive(Clone, Copy, Debug, Hash)]
pub enum OutTarget {
    /// A bit of the arena.
    Arena(ArenaBit),
    /// An operand, found after the call.
    Place(Place),
}

/// One copy from the instance to an actual, after the call.
#[derive(Clone, Copy, Debug, Hash)]
pub struct InstanceOut {
    /// The actual that gets the result.
    pub to: OutTarget,
    /// Bit of the instance.
    pub at: u32,
    /// Bits; above 32 they are copied as bytes.
    pub bits: u32,
}

/// The list of pointers of a call.
#[derive(Clone, Debug, Hash)]
pub struct List {
    /// The pointers, as they follow the call.
    pub pointers: Box<[u32]>,
    /// Index of the signature of the block called, when it is known at load.
    pub signature: Option<u32>,
}

/// A call, ready to run.
#[derive(Clone, Debug, Hash)]
pub struct Call {
    /// `CALL`, `UC` or `CC`.
    pub mode: CallMode,
    /// Which block it enters.
    pub target: CallTarget,
    /// On which data the block runs.
    pub instance: InstanceOf,
    /// Bytes the callee's instance needs.
    pub instance_bytes: u32,
    /// References known at load; the others are patched in.
    pub refs: Box<[u32]>,
    /// Those found at the call, by the index of the parameter.
    pub patches: Box<[(u16, RefArg)]>,
    /// `UC`/`CC` of an FC or SFC: its list of pointers.
    pub list: Option<List>,
    /// Bytes of scratch that the call needs.
    pub scratch: u32,
    /// Copies into the instance.
    pub ins: Box<[InstanceIn]>,
    /// Copies out of it.
    pub outs: Box<[InstanceOut]>,
    /// Bit n: parameter n was supplied.
    pub given: u64,
    /// Something is to be copied back.
    pub copies_out: bool,
    /// The clock may be looked at before it.
    pub safe_point: bool,
    /// The statement of the call, as [`ScanPosition`](crate::ScanPosition) keep it.
    pub(crate) site: Packed,
}
