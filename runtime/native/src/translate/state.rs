//! What the translation knows of the registers at a place of the code: values in machine registers, parts of them, or
//! constants. A `Var` is in the variable of its register, as at places where jumps meet.

use cranelift_codegen::ir::{
    InstBuilder, Type, Value,
    condcodes::{FloatCC, IntCC},
    types,
};
use cranelift_frontend::Variable;
use ob1_cpu::engine::{CC0, CC1, Db};
use ob1_ir::StatusBit;

use super::builder::Builder;
use crate::flow::{self, Set};

/// The bits of every NaN result.
const NO_NUMBER: i64 = 0x7FFF_FFFF;

/// A bit of the status word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bit {
    Var,
    Known(bool),
    /// 0 or 1 in eight bits.
    Val(Value),
    /// One of eight bits; the others mean nothing. Bits of one place in their bytes are combined without a shift.
    At(Value, u8),
}

/// What is known of an accumulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Accu {
    Var,
    Full(Value),
    /// The high word of one value and the low word of another.
    Split {
        hi: Value,
        lo: Value,
    },
    /// A value, and another with the same low word that is ready sooner.
    Low {
        full: Value,
        lo: Value,
    },
    /// A floating-point result. A NaN is replaced by the CPU's one when its bits are needed.
    Real(Value),
}

/// What is known of an address register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reg {
    Var,
    Known(u32),
    Val(Value),
}

/// What is known of CC1 and CC0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cc {
    Var,
    /// Those of a number: greater than 0, less than 0.
    Sign(Value),
    /// CC1 and CC0 as bits.
    Pair(Value, Value),
    /// In their places of the status word.
    Word(Value),
}

/// A data block register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Data {
    /// As memory has it.
    Var,
    Known(Db),
}

/// What an open bracket keeps for its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bracket {
    pub(crate) rlo: Bit,
    pub(crate) or: Bit,
    pub(crate) negate: bool,
    pub(crate) logic: ob1_ir::Logic,
}

/// Everything known of the registers at one place of the code.
#[derive(Clone, Debug)]
pub(crate) struct State {
    pub(crate) a: [Accu; 2],
    pub(crate) ar: [Reg; 2],
    pub(crate) rlo: Bit,
    pub(crate) fc: Bit,
    pub(crate) or: Bit,
    pub(crate) sta: Bit,
    pub(crate) cc: Cc,
    pub(crate) ov: Bit,
    pub(crate) os: Bit,
    pub(crate) br: Bit,
    pub(crate) db: Data,
    pub(crate) di: Data,
    /// Brackets opened since the last place where jumps meet; others are in the variable.
    pub(crate) brackets: Vec<Bracket>,
    /// Statements that the variable does not count yet. The variable may count too many: only the sum has to be right.
    pub(crate) uncounted: u32,
    /// Registers that are in memory instead of their variables, unless this state gives them a value.
    pub(crate) stored: Set,
    /// Values that memory has, too, by the places of registers in a [`Set`].
    pub(crate) fresh: [Option<Value>; 12],
    /// Memory has the known data blocks of the registers DB and DI.
    pub(crate) saved: [bool; 2],
}

impl State {
    /// Everything in its variable.
    pub(crate) fn variables() -> Self {
        Self {
            a: [Accu::Var; 2],
            ar: [Reg::Var; 2],
            rlo: Bit::Var,
            fc: Bit::Var,
            or: Bit::Var,
            sta: Bit::Var,
            cc: Cc::Var,
            ov: Bit::Var,
            os: Bit::Var,
            br: Bit::Var,
            db: Data::Var,
            di: Data::Var,
            brackets: Vec::new(),
            uncounted: 0,
            stored: 0,
            fresh: [None; 12],
            saved: [false; 2],
        }
    }

    /// Everything as memory has it.
    pub(crate) fn memory() -> Self {
        Self { stored: flow::ALL | flow::COUNT, ..Self::variables() }
    }
}

/// The variables of the registers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vars {
    pub(crate) a: [Variable; 2],
    pub(crate) ar: [Variable; 2],
    pub(crate) rlo: Variable,
    pub(crate) fc: Variable,
    pub(crate) or: Variable,
    pub(crate) sta: Variable,
    pub(crate) cc: Variable,
    pub(crate) ov: Variable,
    pub(crate) os: Variable,
    pub(crate) br: Variable,
    pub(crate) nest: Variable,
    pub(crate) executed: Variable,
}

impl Vars {
    pub(crate) fn declare(b: &mut Builder<'_>) -> Self {
        let mut word = |ty: Type| b.declare_var(ty);
        let (i8, i32, i64) = (types::I8, types::I32, types::I64);
        Self {
            a: [word(i32), word(i32)],
            ar: [word(i32), word(i32)],
            rlo: word(i8),
            fc: word(i8),
            or: word(i8),
            sta: word(i8),
            cc: word(i32),
            ov: word(i8),
            os: word(i8),
            br: word(i8),
            nest: word(i64),
            executed: word(i32),
        }
    }
}

/// A constant, when the value is one.
pub(crate) fn constant(b: &Builder<'_>, v: Value) -> Option<i64> {
    use cranelift_codegen::ir::{InstructionData, Opcode, ValueDef};
    let ValueDef::Result(inst, 0) = b.func.dfg.value_def(v) else { return None };
    match b.func.dfg.insts[inst] {
        InstructionData::UnaryImm { opcode: Opcode::Iconst, imm } => Some(imm.bits()),
        _ => None,
    }
}

impl Bit {
    /// The bit as a value of 0 or 1.
    pub(crate) fn value(self, var: Variable, b: &mut Builder<'_>) -> Value {
        match self {
            Bit::Var => b.use_var(var),
            Bit::Known(bit) => b.iconst(types::I8, i64::from(bit)),
            Bit::Val(v) => v,
            Bit::At(v, n) => {
                let low = moved(v, n, 0, b);
                let one = b.iconst(types::I8, 1);
                b.ins().band(low, one)
            }
        }
    }

    /// A value that is 0 when the bit is.
    pub(crate) fn condition(self, var: Variable, b: &mut Builder<'_>) -> Value {
        match self {
            Bit::At(v, n) => masked(v, n, b),
            other => other.value(var, b),
        }
    }

    /// A value with this bit at place `to`, and zeros.
    pub(crate) fn alone_at(self, to: u8, var: Variable, b: &mut Builder<'_>) -> Value {
        match self {
            Bit::At(v, n) => {
                let v = moved(v, n, to, b);
                masked(v, to, b)
            }
            other => {
                let v = other.value(var, b);
                moved(v, 0, to, b)
            }
        }
    }
}

/// Eight bits, moved so that bit `from` is bit `to`.
fn moved(v: Value, from: u8, to: u8, b: &mut Builder<'_>) -> Value {
    if from == to {
        return v;
    }
    let by = b.iconst(types::I8, i64::from(from.abs_diff(to)));
    if from > to { b.ins().ushr(v, by) } else { b.ins().ishl(v, by) }
}

/// Bit `n` of a value, the others 0.
fn masked(v: Value, n: u8, b: &mut Builder<'_>) -> Value {
    let mask = b.iconst(types::I8, 1 << n);
    b.ins().band(v, mask)
}

/// Two bits moved to one place, the lower of the two; and whether the other bits of both values are 0.
fn side_by_side(x: Bit, y: Bit, b: &mut Builder<'_>) -> Option<(Value, Value, u8, bool)> {
    match (x, y) {
        (Bit::Val(x), Bit::Val(y)) => Some((x, y, 0, true)),
        (Bit::Val(x), Bit::At(y, n)) => Some((x, moved(y, n, 0, b), 0, false)),
        (Bit::At(x, n), Bit::Val(y)) => Some((moved(x, n, 0, b), y, 0, false)),
        (Bit::At(x, n), Bit::At(y, m)) => {
            let to = n.min(m);
            Some((moved(x, n, to, b), moved(y, m, to, b), to, false))
        }
        _ => None,
    }
}

/// The result of combining two bits.
fn combined(result: Value, at: u8, clean: bool) -> Bit {
    if clean { Bit::Val(result) } else { Bit::At(result, at) }
}

/// `x & y`, without an instruction where one of them is known.
pub(crate) fn and(x: Bit, y: Bit, b: &mut Builder<'_>) -> Bit {
    match (x, y) {
        (Bit::Known(false), _) | (_, Bit::Known(false)) => Bit::Known(false),
        (Bit::Known(true), other) | (other, Bit::Known(true)) => other,
        _ => {
            let Some((u, v, at, clean)) = side_by_side(x, y, b) else { return unreachable_bit() };
            // A value without other bits clears those of the other.
            let clean = clean || matches!(x, Bit::Val(_)) || matches!(y, Bit::Val(_));
            combined(b.ins().band(u, v), at, clean)
        }
    }
}

/// `x | y`, without an instruction where one of them is known.
pub(crate) fn or(x: Bit, y: Bit, b: &mut Builder<'_>) -> Bit {
    match (x, y) {
        (Bit::Known(true), _) | (_, Bit::Known(true)) => Bit::Known(true),
        (Bit::Known(false), other) | (other, Bit::Known(false)) => other,
        _ => {
            let Some((u, v, at, clean)) = side_by_side(x, y, b) else { return unreachable_bit() };
            combined(b.ins().bor(u, v), at, clean)
        }
    }
}

/// `x ^ y`, with at most a `not` where one of them is known.
pub(crate) fn xor(x: Bit, y: Bit, b: &mut Builder<'_>) -> Bit {
    match (x, y) {
        (Bit::Known(x), Bit::Known(y)) => Bit::Known(x != y),
        (Bit::Known(false), other) | (other, Bit::Known(false)) => other,
        (Bit::Known(true), other) | (other, Bit::Known(true)) => not(other, b),
        _ => {
            let Some((u, v, at, clean)) = side_by_side(x, y, b) else { return unreachable_bit() };
            combined(b.ins().bxor(u, v), at, clean)
        }
    }
}

/// `!x`; of a bit within a value the value is inverted.
pub(crate) fn not(x: Bit, b: &mut Builder<'_>) -> Bit {
    match x {
        Bit::Known(x) => Bit::Known(!x),
        Bit::Val(x) => {
            let one = b.iconst(types::I8, 1);
            Bit::Val(b.ins().bxor(x, one))
        }
        Bit::At(x, n) => Bit::At(b.ins().bnot(x), n),
        Bit::Var => unreachable_bit(),
    }
}

/// Variables are read before bits are combined.
fn unreachable_bit() -> Bit {
    debug_assert!(false, "a bit in its variable");
    Bit::Known(false)
}

/// CC1 and CC0 as bits.
pub(crate) fn pair(cc: Cc, var: Variable, b: &mut Builder<'_>) -> (Bit, Bit) {
    let word = match cc {
        Cc::Sign(v) => {
            let ty = b.func.dfg.value_type(v);
            let zero = b.iconst(ty, 0);
            let positive = b.ins().icmp(IntCC::SignedGreaterThan, v, zero);
            let negative = b.ins().icmp(IntCC::SignedLessThan, v, zero);
            return (Bit::Val(positive), Bit::Val(negative));
        }
        Cc::Pair(cc1, cc0) => {
            let bit = |b: &Builder<'_>, v| match constant(b, v) {
                Some(c) => Bit::Known(c & 1 == 1),
                None => Bit::Val(v),
            };
            return (bit(b, cc1), bit(b, cc0));
        }
        Cc::Word(v) => v,
        Cc::Var => b.use_var(var),
    };
    let bit = |b: &mut Builder<'_>, mask: u32| {
        let shift = b.iconst(types::I32, i64::from(mask.trailing_zeros()));
        let shifted = b.ins().ushr(word, shift);
        let one = b.iconst(types::I32, 1);
        let one_bit = b.ins().band(shifted, one);
        Bit::Val(b.ins().ireduce(types::I8, one_bit))
    };
    (bit(b, CC1), bit(b, CC0))
}

/// CC1 and CC0 in their places of the status word.
pub(crate) fn word(cc: Cc, var: Variable, b: &mut Builder<'_>) -> Value {
    match cc {
        Cc::Var => b.use_var(var),
        Cc::Word(v) => v,
        _ => {
            let (cc1, cc0) = pair(cc, var, b);
            let high = placed(cc1, CC1, b);
            let low = placed(cc0, CC0, b);
            b.ins().bor(high, low)
        }
    }
}

/// A bit at its place of the status word.
pub(crate) fn placed(bit: Bit, mask: u32, b: &mut Builder<'_>) -> Value {
    match bit {
        Bit::Known(bit) => b.iconst(types::I32, i64::from(if bit { mask } else { 0 })),
        Bit::At(v, n) => {
            let low = moved(v, n, 0, b);
            let low = masked(low, 0, b);
            placed(Bit::Val(low), mask, b)
        }
        Bit::Val(v) => {
            let wide = b.ins().uextend(types::I32, v);
            let shift = b.iconst(types::I32, i64::from(mask.trailing_zeros()));
            b.ins().ishl(wide, shift)
        }
        Bit::Var => b.iconst(types::I32, 0),
    }
}

/// A condition of CC1 and CC0.
pub(crate) fn condition(bit: StatusBit, cc: Cc, var: Variable, b: &mut Builder<'_>) -> Bit {
    if let Cc::Sign(v) = cc {
        let how = match bit {
            StatusBit::Zero => IntCC::Equal,
            StatusBit::Positive => IntCC::SignedGreaterThan,
            StatusBit::Negative => IntCC::SignedLessThan,
            StatusBit::NotZero => IntCC::NotEqual,
            StatusBit::NotNegative => IntCC::SignedGreaterThanOrEqual,
            StatusBit::NotPositive => IntCC::SignedLessThanOrEqual,
            _ => return Bit::Known(false),
        };
        let ty = b.func.dfg.value_type(v);
        let zero = b.iconst(ty, 0);
        return Bit::Val(b.ins().icmp(how, v, zero));
    }
    let (cc1, cc0) = pair(cc, var, b);
    match bit {
        StatusBit::Zero => {
            let any = or(cc1, cc0, b);
            not(any, b)
        }
        StatusBit::Positive => {
            let other = not(cc0, b);
            and(cc1, other, b)
        }
        StatusBit::Negative => {
            let other = not(cc1, b);
            and(cc0, other, b)
        }
        StatusBit::NotZero => xor(cc1, cc0, b),
        StatusBit::NotNegative => not(cc0, b),
        StatusBit::NotPositive => not(cc1, b),
        _ => and(cc1, cc0, b),
    }
}

/// All 32 bits of an accumulator.
pub(crate) fn full(accu: Accu, var: Variable, b: &mut Builder<'_>) -> Value {
    match accu {
        Accu::Var => b.use_var(var),
        Accu::Full(v) | Accu::Low { full: v, .. } => v,
        Accu::Split { hi, lo } => {
            let mask = b.iconst(types::I32, 0xFFFF);
            let low = b.ins().band(lo, mask);
            if constant(b, hi).is_some_and(|hi| hi & 0xFFFF_0000 == 0) {
                return low;
            }
            let mask = b.iconst(types::I32, 0xFFFF_0000);
            let high = b.ins().band(hi, mask);
            b.ins().bor(high, low)
        }
        Accu::Real(v) => {
            let bits = b.ins().bitcast(types::I32, cranelift_codegen::ir::MemFlagsData::new(), v);
            let no_number = b.ins().fcmp(FloatCC::Unordered, v, v);
            let known = b.iconst(types::I32, NO_NUMBER);
            b.ins().select(no_number, known, bits)
        }
    }
}

/// An accumulator whose low word is right.
pub(crate) fn low(accu: Accu, var: Variable, b: &mut Builder<'_>) -> Value {
    match accu {
        Accu::Split { lo, .. } | Accu::Low { lo, .. } => lo,
        other => full(other, var, b),
    }
}

/// The low word with its sign.
pub(crate) fn signed(accu: Accu, var: Variable, b: &mut Builder<'_>) -> Value {
    let v = low(accu, var, b);
    if let Some(c) = constant(b, v) {
        return b.iconst(types::I32, i64::from(c as i16));
    }
    let word = word_of(v, b).unwrap_or_else(|| b.ins().ireduce(types::I16, v));
    b.ins().sextend(types::I32, word)
}

/// The 16-bit value that a value of 32 bits was extended from.
pub(crate) fn word_of(v: Value, b: &Builder<'_>) -> Option<Value> {
    use cranelift_codegen::ir::{InstructionData, Opcode, ValueDef};
    let ValueDef::Result(inst, 0) = b.func.dfg.value_def(v) else { return None };
    match b.func.dfg.insts[inst] {
        InstructionData::Unary { opcode: Opcode::Uextend | Opcode::Sextend, arg }
            if b.func.dfg.value_type(arg) == types::I16 =>
        {
            Some(arg)
        }
        _ => None,
    }
}

/// An accumulator as floating-point number.
pub(crate) fn real(accu: Accu, var: Variable, b: &mut Builder<'_>) -> Value {
    match accu {
        Accu::Real(v) => v,
        other => {
            let bits = full(other, var, b);
            if let Some(v) = real_of(bits, b) {
                return v;
            }
            b.ins().bitcast(types::F32, cranelift_codegen::ir::MemFlagsData::new(), bits)
        }
    }
}

/// The floating-point result whose bits these are, made by [`full`]. A NaN stays a NaN, whichever it is.
fn real_of(bits: Value, b: &Builder<'_>) -> Option<Value> {
    use cranelift_codegen::ir::{InstructionData, Opcode, ValueDef};
    let made = |v: Value| match b.func.dfg.value_def(v) {
        ValueDef::Result(inst, 0) => Some(b.func.dfg.insts[inst]),
        _ => None,
    };
    let InstructionData::Ternary { opcode: Opcode::Select, args: [no_number, known, bits] } = made(bits)? else {
        return None;
    };
    let InstructionData::FloatCompare { cond: FloatCC::Unordered, args: [x, y], .. } = made(no_number)? else {
        return None;
    };
    let InstructionData::LoadNoOffset { opcode: Opcode::Bitcast, arg, .. } = made(bits)? else { return None };
    (x == y && x == arg && constant(b, known) == Some(NO_NUMBER)).then_some(x)
}

/// Where a value's high word comes from.
pub(crate) fn high(accu: Accu, var: Variable, b: &mut Builder<'_>) -> Value {
    match accu {
        Accu::Split { hi, .. } => hi,
        other => full(other, var, b),
    }
}
