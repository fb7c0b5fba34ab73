//! The pre-decoded form: one short operation per statement at the statement's own index, so that jump targets, sites
//! and statement counts need no tables of their own.
//!
//! Fixed operands (`at` an [`ArenaByte`]) lie inside their area: that is checked at load. Based ones are checked when
//! they are reached.

use ob1_ir::{AccuOp, Compare, Jump, Logic, NumberFormat};
use ob1_model::BitAddr;

use crate::arena::ArenaByte;

/// A bit scan: how it combines with the RLO, and whether it is negated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Scan {
    /// How it combines: AND, OR or XOR.
    pub logic: Logic,
    /// The bit is negated first: `UN`, `ON`, `XN`.
    pub negate: bool,
}

/// Places that are cheap to find: the base is in a register of the engine, the address in the operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Base {
    /// Local data of the running block; inside them, as the block was verified.
    Local,
    /// The data block register.
    Db,
    /// The instance: DI register and AR2.
    Instance,
    /// An actual parameter, by the index of its formal.
    Param(u16),
    /// `[AR1,P#x]` into the area of this pointer code; [`AREA_IN_POINTER`]: the area is in the register.
    Ar1(u8),
    /// `[AR2,P#x]` into the area of this pointer code, as with AR1.
    Ar2(u8),
    /// `[MD n]`: a pointer in bit memory.
    Pointer {
        /// The area's pointer code.
        code: u8,
        /// The pointer's first byte in bit memory; all four lie in it.
        md: u16,
    },
}

/// The pointer code that stands for "in the pointer".
pub const AREA_IN_POINTER: u8 = 0;

/// One statement, ready to run.
#[derive(Clone, Copy, Debug, Hash)]
#[expect(missing_docs, reason = "each variant is the statement of the same name in ob1_ir, with its operand resolved")]
pub enum Op {
    And {
        at: ArenaByte,
        mask: u8,
    },
    AndNot {
        at: ArenaByte,
        mask: u8,
    },
    Or {
        at: ArenaByte,
        mask: u8,
    },
    OrNot {
        at: ArenaByte,
        mask: u8,
    },
    Xor {
        at: ArenaByte,
        mask: u8,
    },
    XorNot {
        at: ArenaByte,
        mask: u8,
    },
    Assign {
        at: ArenaByte,
        mask: u8,
    },
    Set {
        at: ArenaByte,
        mask: u8,
    },
    Reset {
        at: ArenaByte,
        mask: u8,
    },
    EdgePositive {
        at: ArenaByte,
        mask: u8,
    },
    EdgeNegative {
        at: ArenaByte,
        mask: u8,
    },
    ScanAt {
        scan: Scan,
        base: Base,
        at: BitAddr,
    },
    AssignAt {
        base: Base,
        at: BitAddr,
    },
    SetAt {
        base: Base,
        at: BitAddr,
    },
    ResetAt {
        base: Base,
        at: BitAddr,
    },
    /// A timer that exists.
    ScanTimer {
        scan: Scan,
        number: u16,
    },
    /// A counter that exists.
    ScanCounter {
        scan: Scan,
        number: u16,
    },
    Open {
        scan: Scan,
    },
    Close,
    OrBranch,
    SetRlo,
    ClearRlo,
    NotRlo,

    LoadByte {
        at: ArenaByte,
    },
    LoadWord {
        at: ArenaByte,
    },
    LoadDWord {
        at: ArenaByte,
    },
    StoreByte {
        at: ArenaByte,
    },
    StoreWord {
        at: ArenaByte,
    },
    StoreDWord {
        at: ArenaByte,
    },
    /// A fully qualified operand of a data block of the program: `db` is its number, which the data block register
    /// holds afterwards.
    LoadInDb {
        bits: u8,
        db: u16,
        at: ArenaByte,
    },
    StoreInDb {
        bits: u8,
        db: u16,
        at: ArenaByte,
    },
    LoadAt {
        bits: u8,
        base: Base,
        at: BitAddr,
    },
    StoreAt {
        bits: u8,
        base: Base,
        at: BitAddr,
    },
    LoadConst {
        value: u32,
    },

    /// Arithmetic on a CPU with two accumulators.
    Int(AccuOp),
    DInt(AccuOp),
    Real(AccuOp),
    /// Arithmetic on a CPU with four accumulators.
    Four(NumberFormat, AccuOp),
    CompareInt(Compare),
    CompareDInt(Compare),
    CompareReal(Compare),
    AddInt {
        value: u16,
    },
    AddDInt {
        value: u32,
    },

    Jump {
        target: u32,
    },
    JumpIf {
        target: u32,
    },
    JumpIfNot {
        target: u32,
    },
    JumpOn {
        on: Jump,
        target: u32,
    },
    Loop {
        target: u32,
    },
    /// `SPL`: index of [`super::Block::lists`].
    JumpList {
        list: u32,
    },
    /// A call; `call` is its index in [`super::Block::calls`].
    Call {
        call: u32,
    },
    /// `CALL` or `UC` of a native FC without a list of pointers; `native` is its index.
    CallNative {
        call: u32,
        native: u32,
    },
    End,
    EndIf,
    Nop,
    /// Straight from the intermediate code.
    Slow,
}

const _: () = assert!(size_of::<Op>() <= 12);

impl Op {
    /// Jumps, calls and ends: what moves the program counter. Every other statement can be executed straight from the
    /// intermediate code too.
    #[must_use]
    pub const fn is_control(&self) -> bool {
        matches!(
            self,
            Op::Jump { .. }
                | Op::JumpIf { .. }
                | Op::JumpIfNot { .. }
                | Op::JumpOn { .. }
                | Op::Loop { .. }
                | Op::JumpList { .. }
                | Op::Call { .. }
                | Op::CallNative { .. }
                | Op::End
                | Op::EndIf
                | Op::Nop
        )
    }
}
