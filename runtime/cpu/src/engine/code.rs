//! The pre-decoded form: one short operation per statement at the statement's own index, so that jump targets, sites
//! and statement counts need no tables of their own.

use ob1_ir::{AccuOp, CallMode, Compare, Jump, Logic, NumberFormat, Place, Stmt};
use ob1_model::{BlockId, BlockKind, Site};

use super::Callee;

/// Bit scans with the negation folded in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Scan {
    pub(crate) logic: Logic,
    pub(crate) negate: bool,
}

/// Places that are cheap to find: the base is in a register of the engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Base {
    /// Local data of the running block.
    Local,
    /// The data block register.
    Db,
    /// The instance: DI register and AR2.
    Instance,
    /// An actual parameter.
    Param(u16),
    /// `[AR1,P#x]` with the area in the pointer, or in the operand (pointer code).
    Ar1(u8),
    /// `[AR2,P#x]`.
    Ar2(u8),
    /// `[MD n]` into the area of this pointer code; `at` is the pointer's byte in the arena.
    Pointer(u8),
}

/// One statement, ready to run. Arena addresses are bytes; `at` of a based place is a bit address.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Op {
    And {
        at: u32,
        mask: u8,
    },
    AndNot {
        at: u32,
        mask: u8,
    },
    Or {
        at: u32,
        mask: u8,
    },
    OrNot {
        at: u32,
        mask: u8,
    },
    Xor {
        at: u32,
        mask: u8,
    },
    XorNot {
        at: u32,
        mask: u8,
    },
    Assign {
        at: u32,
        mask: u8,
    },
    Set {
        at: u32,
        mask: u8,
    },
    Reset {
        at: u32,
        mask: u8,
    },
    EdgePositive {
        at: u32,
        mask: u8,
    },
    EdgeNegative {
        at: u32,
        mask: u8,
    },
    ScanAt {
        scan: Scan,
        base: Base,
        at: u32,
    },
    AssignAt {
        base: Base,
        at: u32,
    },
    SetAt {
        base: Base,
        at: u32,
    },
    ResetAt {
        base: Base,
        at: u32,
    },
    ScanTimer {
        scan: Scan,
        number: u16,
    },
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
        at: u32,
    },
    LoadWord {
        at: u32,
    },
    LoadDWord {
        at: u32,
    },
    StoreByte {
        at: u32,
    },
    StoreWord {
        at: u32,
    },
    StoreDWord {
        at: u32,
    },
    /// A fully qualified operand: `db` is its number, `at` its place in the arena.
    LoadInDb {
        bits: u8,
        db: u16,
        at: u32,
    },
    StoreInDb {
        bits: u8,
        db: u16,
        at: u32,
    },
    LoadAt {
        bits: u8,
        base: Base,
        at: u32,
    },
    StoreAt {
        bits: u8,
        base: Base,
        at: u32,
    },
    LoadConst {
        value: u32,
    },

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
    JumpList {
        list: u32,
    },
    Call {
        call: u32,
    },
    /// `CALL` or `UC` of a native FC.
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

/// A block, ready to run.
#[derive(Debug)]
pub(crate) struct Block {
    pub(crate) id: BlockId,
    /// One per statement, and the block's end, which counts as the `BE` it is on the CPU.
    pub(crate) ops: Box<[Op]>,
    /// The statements themselves.
    pub(crate) stmts: Box<[Stmt]>,
    /// Bytes of local data.
    pub(crate) local_len: u32,
    pub(crate) calls: Box<[Call]>,
    /// Targets of `SPL`, the last one for numbers beyond the list.
    pub(crate) lists: Box<[Box<[u32]>]>,
}

impl Block {
    /// Where a statement stands in the source.
    pub(crate) fn site(&self, index: usize) -> Site {
        let stmt = self.stmts.get(index);
        Site { block: self.id, network: stmt.map_or(0, |s| s.network), line: stmt.map_or(0, |s| s.line) }
    }
}

/// Who is called.
#[derive(Clone, Copy, Debug)]
pub(crate) enum CallTarget {
    Known(Callee),
    Indirect(BlockKind, ob1_ir::Number),
}

/// On which data a function block runs.
#[derive(Clone, Copy, Debug)]
pub(crate) enum InstanceOf {
    /// An FC, or `UC`/`CC`: registers stay.
    None,
    /// `CALL FB n, DB m`.
    Db(ob1_ir::Number),
    /// A multi-instance at this bit of the caller's instance.
    Local(u32),
}

/// The reference to an actual parameter of an FC.
#[derive(Clone, Copy, Debug)]
pub(crate) enum RefArg {
    /// Bit of the caller's local data.
    Local(u32),
    /// The caller's own formal, plus an offset.
    Param { index: u16, at: u32 },
    /// A bit of the opened data block: a reference, checked for `bits` at the call.
    Db { at: u32, bits: u32 },
    /// The number of a timer, counter or block.
    Number(ob1_ir::Number),
    /// The value of an operand, for a number given as a WORD.
    Value(Place),
    /// Copied into the call's scratch at this bit, and back when `out`.
    Copy { place: Place, bits: u32, scratch: u32, out: bool },
    /// A composed actual of an indirect place or data block: referred to where it lies.
    Located { place: Place, bits: u32, out: bool },
    /// A composed constant the callee may overwrite: its bytes in the arena, and how many.
    Bytes { at: u32, len: u32, scratch: u32 },
    /// A constant the callee may overwrite.
    Scratch { value: u32, bits: u8, scratch: u32 },
}

/// What goes into an instance before a call of an FB.
#[derive(Clone, Copy, Debug)]
pub(crate) enum InSource {
    Const(u32),
    /// A bit of the arena.
    Arena(u32),
    /// Bytes of the constants.
    Bytes {
        at: u32,
        len: u32,
    },
    Place(Place),
    Number(ob1_ir::Number),
}

/// One copy between an actual and the instance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InstanceIn {
    pub(crate) from: InSource,
    /// Bit of the instance.
    pub(crate) at: u32,
    /// Bits; above 32 they are copied as bytes.
    pub(crate) bits: u32,
}

/// Where a result goes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum OutTarget {
    /// A bit of the arena.
    Arena(u32),
    Place(Place),
}

/// One copy back.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InstanceOut {
    pub(crate) to: OutTarget,
    pub(crate) at: u32,
    pub(crate) bits: u32,
}

/// The list of pointers of a call.
#[derive(Debug)]
pub(crate) struct List {
    pub(crate) pointers: Box<[u32]>,
    /// Index of the signature of the block called, when it is known at load.
    pub(crate) signature: Option<u32>,
}

/// A call, ready to run.
#[derive(Debug)]
pub(crate) struct Call {
    pub(crate) mode: CallMode,
    pub(crate) target: CallTarget,
    pub(crate) instance: InstanceOf,
    /// Bytes the callee's instance needs.
    pub(crate) instance_bytes: u32,
    /// References known at load; the others are patched in.
    pub(crate) refs: Box<[u32]>,
    pub(crate) patches: Box<[(u16, RefArg)]>,
    /// `UC`/`CC` of an FC or SFC: its list of pointers.
    pub(crate) list: Option<List>,
    /// Bytes of scratch.
    pub(crate) scratch: u32,
    pub(crate) ins: Box<[InstanceIn]>,
    pub(crate) outs: Box<[InstanceOut]>,
    /// Bit n: parameter n was supplied.
    pub(crate) given: u64,
    /// Something is to be copied back.
    pub(crate) copies_out: bool,
}

const _: () = assert!(std::mem::size_of::<Op>() <= 16);

/// The pointer code that stands for "in the pointer".
pub(crate) const AREA_IN_POINTER: u8 = 0;

/// Maps the formats to their operation.
pub(crate) const fn arithmetic(format: NumberFormat, op: AccuOp) -> Op {
    match format {
        NumberFormat::Int => Op::Int(op),
        NumberFormat::DInt => Op::DInt(op),
        NumberFormat::Real => Op::Real(op),
    }
}
