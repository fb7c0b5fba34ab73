//! The accumulators: arithmetic, comparison, logic, shifts, conversions. Their results are defined by the reference
//! (`ob1_cpu::engine::arith`, `convert`, `shift`).

use std::mem::offset_of;

use cranelift_codegen::ir::{
    InstBuilder, Value,
    condcodes::{FloatCC, IntCC},
    types,
};
use ob1_cpu::engine::{CC0, CC1, Regs};
use ob1_ir::{AccuOp, Compare, Convert, MathFn, NumberFormat, Op, WordLogic};

use super::Translation;
use super::state::{self, Accu, Bit, Cc};
use crate::flow;

/// A comparison of signed numbers, in Cranelift's words.
pub(crate) const fn condition(compare: Compare) -> IntCC {
    match compare {
        Compare::Equal => IntCC::Equal,
        Compare::NotEqual => IntCC::NotEqual,
        Compare::Greater => IntCC::SignedGreaterThan,
        Compare::Less => IntCC::SignedLessThan,
        Compare::GreaterEqual => IntCC::SignedGreaterThanOrEqual,
        Compare::LessEqual => IntCC::SignedLessThanOrEqual,
    }
}

/// A factor and a shift that divide 16 bits with their sign: `(x * factor >> shift) + (x < 0)` is `x / divisor`,
/// rounded towards 0, and the product has 32 bits. Powers of two need no factor; the compiler shifts.
///
/// The factor is a little above `2^shift / divisor`. What that adds is less than `1 / divisor`, as `shift` is 15 bits
/// of `x` more than the bits of the divisor.
const fn reciprocal(divisor: i32) -> Option<(i32, u32)> {
    if divisor < 3 || divisor > i16::MAX as i32 || divisor.count_ones() == 1 {
        return None;
    }
    let shift = 15 + (i32::BITS - divisor.leading_zeros());
    Some((((1i64 << shift) / divisor as i64 + 1) as i32, shift))
}

/// What an overflow sets.
const OVERFLOW: flow::Set = flow::OV | flow::OS;

impl Translation<'_, '_> {
    /// CC1 and CC0 of a result, and OV, which also sets OS.
    fn set_cc(&mut self, cc: Cc, ov: Bit) {
        self.now.cc = cc;
        self.set_ov(ov);
    }

    /// OV, which also sets OS.
    fn set_ov(&mut self, ov: Bit) {
        self.now.ov = ov;
        if ov != Bit::Known(false) && self.wanted & flow::OS != 0 {
            let os = self.now.os;
            let os = self.read_bit(os, self.vars.os);
            self.now.os = state::or(os, ov, &mut self.b);
        }
    }

    /// One of these registers is used after the statement.
    const fn seen(&self, set: flow::Set) -> bool {
        self.wanted & set != 0
    }

    /// CC1 = `bit`, CC0 = 0, OV = 0; OS stays.
    pub(super) fn set_cc1(&mut self, bit: impl FnOnce(&mut Self) -> Value) {
        if self.seen(flow::CC) {
            let (bit, zero) = (bit(self), self.b.iconst(types::I8, 0));
            self.now.cc = Cc::Pair(bit, zero);
        }
        self.now.ov = Bit::Known(false);
    }

    /// The low word of a result, sign-extended, and whether it differs from the result.
    fn cut(&mut self, whole: Value) -> (Value, Bit) {
        if !self.seen(flow::CC | OVERFLOW) {
            return (whole, Bit::Known(false));
        }
        let word = self.b.ins().ireduce(types::I16, whole);
        let kept = self.b.ins().sextend(types::I32, word);
        let other = self.overflow(|t| t.b.ins().icmp(IntCC::NotEqual, kept, whole));
        (kept, other)
    }

    /// OV, if it is read.
    fn overflow(&mut self, ov: impl FnOnce(&mut Self) -> Value) -> Bit {
        if self.seen(OVERFLOW) { Bit::Val(ov(self)) } else { Bit::Known(false) }
    }

    fn is_zero(&mut self, v: Value, how: IntCC) -> Value {
        let ty = self.b.func.dfg.value_type(v);
        let zero = self.b.iconst(ty, 0);
        self.b.ins().icmp(how, v, zero)
    }

    pub(super) fn signed(&mut self, i: usize) -> Value {
        state::signed(self.now.a[i], self.vars.a[i], &mut self.b)
    }

    pub(super) fn set_low(&mut self, lo: Value) {
        let hi = state::high(self.now.a[0], self.vars.a[0], &mut self.b);
        self.now.a[0] = Accu::Split { hi, lo };
    }

    pub(super) fn set_full(&mut self, v: Value) {
        self.now.a[0] = Accu::Full(v);
    }

    /// An accumulator that only memory has: ACCU3, ACCU4.
    fn third(&mut self, at: usize) -> Value {
        self.load_state(types::I32, self.run, Self::reg(at))
    }

    fn set_third(&mut self, at: usize, v: Value) {
        self.store_state(v, self.run, Self::reg(at));
    }

    fn four(&self) -> bool {
        self.plan.accumulators == 4
    }

    /// Every statement that works on the accumulators alone.
    pub(crate) fn accumulators(&mut self, op: &Op) {
        match op {
            Op::Arithmetic(format, op) => {
                match format {
                    NumberFormat::Int => self.int(*op),
                    NumberFormat::DInt => self.dint(*op),
                    NumberFormat::Real => self.real(*op),
                }
                if self.four() {
                    let (a3, a4) = (self.third(offset_of!(Regs, a3)), self.third(offset_of!(Regs, a4)));
                    self.now.a[1] = Accu::Full(a3);
                    self.set_third(offset_of!(Regs, a3), a4);
                }
            }
            Op::AddConst { format: NumberFormat::Int, value } => {
                let low = self.accu_low(0);
                let value = self.word(*value as u32);
                let sum = self.b.ins().iadd(low, value);
                self.set_low(sum);
            }
            Op::AddConst { value, .. } => {
                let v = self.accu(0);
                let value = self.word(*value as u32);
                let sum = self.b.ins().iadd(v, value);
                self.set_full(sum);
            }
            Op::Compare(format, compare) => self.compare(*format, *compare),
            Op::WordLogic(op, with) => {
                let x = self.accu_low(0);
                let y = match with {
                    Some(value) => self.word(u32::from(*value)),
                    None => self.accu_low(1),
                };
                let result = self.logic(*op, x, y);
                self.set_low(result);
                self.set_cc1(|t| {
                    let word = t.b.ins().ireduce(types::I16, result);
                    t.is_zero(word, IntCC::NotEqual)
                });
            }
            Op::DWordLogic(op, with) => {
                let x = self.accu(0);
                let y = match with {
                    Some(value) => self.word(*value),
                    None => self.accu(1),
                };
                let result = self.logic(*op, x, y);
                self.set_full(result);
                self.set_cc1(|t| t.is_zero(result, IntCC::NotEqual));
            }
            Op::Shift(kind, Some(count)) => self.shift(*kind, *count),
            Op::RotateLeftCc1 | Op::RotateRightCc1 => self.rotate_cc1(*op == Op::RotateLeftCc1),
            Op::Convert(kind) => self.convert(*kind),
            Op::Math(function) => {
                let x = state::real(self.now.a[0], self.vars.a[0], &mut self.b);
                let result = match function {
                    MathFn::Sqr => self.b.ins().fmul(x, x),
                    _ => self.b.ins().sqrt(x),
                };
                self.set_real(result);
            }
            Op::ExchangeAccus => {
                for i in 0..2 {
                    if self.now.a[i] == Accu::Var {
                        let v = self.b.use_var(self.vars.a[i]);
                        self.now.a[i] = Accu::Full(v);
                    }
                }
                self.now.a.swap(0, 1);
            }
            Op::Push => {
                let a3 = self.third(offset_of!(Regs, a3));
                let a2 = self.accu(1);
                self.set_third(offset_of!(Regs, a4), a3);
                self.set_third(offset_of!(Regs, a3), a2);
                let a1 = self.accu(0);
                self.now.a[1] = Accu::Full(a1);
            }
            Op::Pop => {
                let a2 = self.accu(1);
                let a3 = self.third(offset_of!(Regs, a3));
                let a4 = self.third(offset_of!(Regs, a4));
                self.set_full(a2);
                self.now.a[1] = Accu::Full(if self.four() { a3 } else { a2 });
                self.set_third(offset_of!(Regs, a3), a4);
            }
            Op::Enter => {
                let a3 = self.third(offset_of!(Regs, a3));
                let a2 = self.accu(1);
                self.set_third(offset_of!(Regs, a4), a3);
                self.set_third(offset_of!(Regs, a3), a2);
            }
            Op::Leave => {
                let (a3, a4) = (self.third(offset_of!(Regs, a3)), self.third(offset_of!(Regs, a4)));
                self.now.a[1] = Accu::Full(a3);
                self.set_third(offset_of!(Regs, a3), a4);
            }
            Op::Increment(n) => self.add_byte(u32::from(*n)),
            Op::Decrement(n) => self.add_byte(u32::from(*n).wrapping_neg()),
            other => debug_assert!(false, "{other:?} is not compiled"),
        }
    }

    fn add_byte(&mut self, n: u32) {
        let low = self.accu_low(0);
        let n = self.word(n);
        let sum = self.b.ins().iadd(low, n);
        let byte = self.word(0xFF);
        let sum = self.b.ins().band(sum, byte);
        let rest = self.b.ins().band_not(low, byte);
        let result = self.b.ins().bor(rest, sum);
        self.set_low(result);
    }

    fn logic(&mut self, op: WordLogic, x: Value, y: Value) -> Value {
        match op {
            WordLogic::And => self.b.ins().band(x, y),
            WordLogic::Or => self.b.ins().bor(x, y),
            WordLogic::Xor => self.b.ins().bxor(x, y),
        }
    }

    fn int(&mut self, op: AccuOp) {
        let (x, y) = (self.signed(1), self.signed(0));
        match op {
            AccuOp::Add | AccuOp::Sub => {
                let sum = if op == AccuOp::Add { self.b.ins().iadd(x, y) } else { self.b.ins().isub(x, y) };
                let (kept, ov) = self.cut(sum);
                self.set_low(sum);
                self.set_cc(Cc::Sign(kept), ov);
            }
            AccuOp::Mul => {
                let full = self.product(x, y);
                let ov = self.cut(full).1;
                self.now.a[0] = if self.seen(flow::CC | OVERFLOW) {
                    Accu::Full(full)
                } else {
                    // Of most products the low word is used, which needs no sign before.
                    let (x, y) = (self.low_word(1), self.low_word(0));
                    let word = self.product(x, y);
                    Accu::Low { full, lo: self.b.ins().uextend(types::I32, word) }
                };
                self.set_cc(Cc::Sign(full), ov);
            }
            AccuOp::Div | AccuOp::Mod => {
                let (zero, divisor) = self.divisor(y);
                let quotient = match state::constant(&self.b, divisor).and_then(|c| reciprocal(c as i32)) {
                    Some((factor, shift)) if zero.is_none() => self.times_reciprocal(x, factor, shift),
                    _ => self.b.ins().sdiv(x, divisor),
                };
                let back = self.b.ins().imul(quotient, divisor);
                let rest = self.b.ins().isub(x, back);
                let sixteen = self.word(16);
                let hi = self.b.ins().ishl(rest, sixteen);
                let most = self.word(0x7FFF);
                let ov = self.b.ins().icmp(IntCC::SignedGreaterThan, quotient, most);
                let Some(zero) = zero else {
                    self.now.a[0] = Accu::Split { hi, lo: quotient };
                    self.set_cc(Cc::Sign(quotient), Bit::Val(ov));
                    return;
                };
                let made = state::full(Accu::Split { hi, lo: quotient }, self.vars.a[0], &mut self.b);
                self.divided(zero, made, quotient, ov);
            }
        }
    }

    /// The product of two numbers of 16 bits with their sign. A sum of two shifts is ready sooner than a product.
    fn product(&mut self, x: Value, y: Value) -> Value {
        let known = [(x, y), (y, x)].into_iter().find_map(|(c, v)| Some((state::constant(&self.b, c)? as u32, v)));
        let Some((factor, v)) = known.filter(|(factor, _)| factor.count_ones() == 2) else {
            return self.b.ins().imul(x, y);
        };
        let ty = self.b.func.dfg.value_type(v);
        let [low, high] = [factor, factor & (factor - 1)].map(|bits| match bits.trailing_zeros() {
            0 => v,
            by => {
                let by = self.b.iconst(ty, i64::from(by));
                self.b.ins().ishl(v, by)
            }
        });
        self.b.ins().iadd(low, high)
    }

    /// The quotient of 16 bits with their sign, by a product of 32 bits.
    fn times_reciprocal(&mut self, x: Value, factor: i32, shift: u32) -> Value {
        let (factor, shift, sign) = (self.word(factor as u32), self.word(shift), self.word(31));
        let product = self.b.ins().imul(x, factor);
        let floor = self.b.ins().sshr(product, shift);
        let below = self.b.ins().sshr(x, sign);
        self.b.ins().isub(floor, below)
    }

    /// Whether the divisor is 0, unless that is known; and a divisor that is never 0.
    fn divisor(&mut self, y: Value) -> (Option<Value>, Value) {
        if state::constant(&self.b, y).is_some_and(|c| c as i32 != 0) {
            return (None, y);
        }
        let zero = self.is_zero(y, IntCC::Equal);
        let ty = self.b.func.dfg.value_type(y);
        let one = self.b.iconst(ty, 1);
        (Some(zero), self.b.ins().select(zero, one, y))
    }

    /// The result of a division: by 0 leaves ACCU1 and sets all of CC1, CC0 and OV.
    fn divided(&mut self, zero: Value, result: Value, sign: Value, ov: Value) {
        let before = self.accu(0);
        let kept = self.b.ins().select(zero, before, result);
        self.set_full(kept);
        let word = state::word(Cc::Sign(sign), self.vars.cc, &mut self.b);
        let both = self.word(CC1 | CC0);
        let cc = self.b.ins().select(zero, both, word);
        let ov = self.b.ins().bor(ov, zero);
        self.set_cc(Cc::Word(cc), Bit::Val(ov));
    }

    fn dint(&mut self, op: AccuOp) {
        let (x, y) = (self.accu(1), self.accu(0));
        match op {
            AccuOp::Add | AccuOp::Sub => {
                let sum = if op == AccuOp::Add { self.b.ins().iadd(x, y) } else { self.b.ins().isub(x, y) };
                // Overflow: the signs of the operands demand another sign than the sum's.
                let ov = self.overflow(|t| {
                    let p = t.b.ins().bxor(sum, x);
                    let q = if op == AccuOp::Add { t.b.ins().bxor(sum, y) } else { t.b.ins().bxor(x, y) };
                    let both = t.b.ins().band(p, q);
                    t.is_zero(both, IntCC::SignedLessThan)
                });
                self.set_full(sum);
                self.set_cc(Cc::Sign(sum), ov);
            }
            AccuOp::Mul if !self.seen(flow::CC | OVERFLOW) => {
                let product = self.b.ins().imul(x, y);
                self.set_full(product);
            }
            AccuOp::Mul => {
                let (x, y) = (self.b.ins().sextend(types::I64, x), self.b.ins().sextend(types::I64, y));
                let product = self.b.ins().imul(x, y);
                let low = self.b.ins().ireduce(types::I32, product);
                let kept = self.b.ins().sextend(types::I64, low);
                let ov = self.b.ins().icmp(IntCC::NotEqual, kept, product);
                self.set_full(low);
                self.set_cc(Cc::Sign(product), Bit::Val(ov));
            }
            AccuOp::Div | AccuOp::Mod => {
                // In 64 bits the quotient always fits.
                let (x, y) = (self.b.ins().sextend(types::I64, x), self.b.ins().sextend(types::I64, y));
                let (zero, divisor) = self.divisor(y);
                let quotient = self.b.ins().sdiv(x, divisor);
                let (sign, ov) = if op == AccuOp::Div {
                    let most = self.b.iconst(types::I64, i64::from(i32::MAX));
                    (quotient, self.b.ins().icmp(IntCC::SignedGreaterThan, quotient, most))
                } else {
                    let back = self.b.ins().imul(quotient, divisor);
                    (self.b.ins().isub(x, back), self.b.iconst(types::I8, 0))
                };
                let result = self.b.ins().ireduce(types::I32, sign);
                match zero {
                    Some(zero) => self.divided(zero, result, sign, ov),
                    None => {
                        self.set_full(result);
                        self.set_cc(Cc::Sign(sign), Bit::Val(ov));
                    }
                }
            }
        }
    }

    fn real(&mut self, op: AccuOp) {
        let x = state::real(self.now.a[1], self.vars.a[1], &mut self.b);
        let y = state::real(self.now.a[0], self.vars.a[0], &mut self.b);
        let result = match op {
            AccuOp::Add => self.b.ins().fadd(x, y),
            AccuOp::Sub => self.b.ins().fsub(x, y),
            AccuOp::Mul => self.b.ins().fmul(x, y),
            AccuOp::Div | AccuOp::Mod => self.b.ins().fdiv(x, y),
        };
        self.set_real(result);
    }

    /// A floating-point result: 0 and denormalised numbers have no sign, a NaN sets both codes.
    fn set_real(&mut self, result: Value) {
        self.now.a[0] = Accu::Real(result);
        if !self.seen(flow::CC | OVERFLOW) {
            return;
        }
        let least = self.b.ins().f32const(f32::MIN_POSITIVE);
        let negative = self.b.ins().f32const(-f32::MIN_POSITIVE);
        let most = self.b.ins().f32const(f32::MAX);
        let zero = self.b.ins().f32const(0.0);
        let cc1 = self.b.ins().fcmp(FloatCC::UnorderedOrGreaterThanOrEqual, result, least);
        let cc0 = self.b.ins().fcmp(FloatCC::UnorderedOrLessThanOrEqual, result, negative);
        let size = self.b.ins().fabs(result);
        let large = self.b.ins().fcmp(FloatCC::GreaterThanOrEqual, size, least);
        let finite = self.b.ins().fcmp(FloatCC::LessThanOrEqual, size, most);
        let normal = self.b.ins().band(large, finite);
        let none = self.b.ins().fcmp(FloatCC::Equal, result, zero);
        let good = self.b.ins().bor(normal, none);
        let ov = state::not(Bit::Val(good), &mut self.b);
        self.set_cc(Cc::Pair(cc1, cc0), ov);
    }

    fn compare(&mut self, format: NumberFormat, compare: Compare) {
        let how = condition(compare);
        let (x, y) = match format {
            NumberFormat::Int => (self.low_word(1), self.low_word(0)),
            NumberFormat::DInt => (self.accu(1), self.accu(0)),
            NumberFormat::Real => {
                self.compare_real(compare);
                return;
            }
        };
        let rlo = self.b.ins().icmp(how, x, y);
        if self.seen(flow::CC) {
            let mut code = |wanted: IntCC| if wanted == how { rlo } else { self.b.ins().icmp(wanted, x, y) };
            let (greater, less) = (code(IntCC::SignedGreaterThan), code(IntCC::SignedLessThan));
            self.now.cc = Cc::Pair(greater, less);
        }
        self.set_ov(Bit::Known(false));
        self.set_result(Bit::Val(rlo));
    }

    /// With a NaN every comparison is false.
    fn compare_real(&mut self, compare: Compare) {
        let x = state::real(self.now.a[1], self.vars.a[1], &mut self.b);
        let y = state::real(self.now.a[0], self.vars.a[0], &mut self.b);
        let how = match compare {
            Compare::Equal => FloatCC::Equal,
            Compare::NotEqual => FloatCC::OrderedNotEqual,
            Compare::Greater => FloatCC::GreaterThan,
            Compare::Less => FloatCC::LessThan,
            Compare::GreaterEqual => FloatCC::GreaterThanOrEqual,
            Compare::LessEqual => FloatCC::LessThanOrEqual,
        };
        let rlo = self.b.ins().fcmp(how, x, y);
        if self.seen(flow::CC) {
            let cc1 = self.b.ins().fcmp(FloatCC::UnorderedOrGreaterThan, x, y);
            let cc0 = self.b.ins().fcmp(FloatCC::UnorderedOrLessThan, x, y);
            self.now.cc = Cc::Pair(cc1, cc0);
        }
        let ov = self.overflow(|t| t.b.ins().fcmp(FloatCC::Unordered, x, y));
        self.set_ov(ov);
        self.set_result(Bit::Val(rlo));
    }

    fn convert(&mut self, kind: Convert) {
        match kind {
            Convert::Itd => {
                let v = self.signed(0);
                self.set_full(v);
            }
            Convert::Dtr => {
                let v = self.accu(0);
                let real = self.b.ins().fcvt_from_sint(types::F32, v);
                self.now.a[0] = Accu::Real(real);
            }
            Convert::Rnd | Convert::RndPlus | Convert::RndMinus | Convert::Trunc => self.round(kind),
            Convert::Invi => {
                let v = self.accu_low(0);
                let v = self.b.ins().bnot(v);
                self.set_low(v);
            }
            Convert::Invd => {
                let v = self.accu(0);
                let v = self.b.ins().bnot(v);
                self.set_full(v);
            }
            Convert::Negi => {
                let v = self.signed(0);
                let negated = self.b.ins().ineg(v);
                let (kept, ov) = self.cut(negated);
                self.set_low(negated);
                self.set_cc(Cc::Sign(kept), ov);
            }
            Convert::Negd => {
                let v = self.accu(0);
                let negated = self.b.ins().ineg(v);
                let ov = self.overflow(|t| {
                    let least = t.word(0x8000_0000);
                    t.b.ins().icmp(IntCC::Equal, v, least)
                });
                self.set_full(negated);
                self.set_cc(Cc::Sign(negated), ov);
            }
            Convert::Negr => {
                let v = self.accu(0);
                let sign = self.word(0x8000_0000);
                let v = self.b.ins().bxor(v, sign);
                self.set_full(v);
            }
            Convert::Abs => {
                // A NaN becomes the CPU's one, whose sign is 0.
                if let Accu::Real(v) = self.now.a[0] {
                    let v = self.b.ins().fabs(v);
                    self.now.a[0] = Accu::Real(v);
                    return;
                }
                let v = self.accu(0);
                let mask = self.word(0x7FFF_FFFF);
                let v = self.b.ins().band(v, mask);
                self.set_full(v);
            }
            Convert::Taw => {
                let v = self.accu_low(0);
                let word = self.b.ins().ireduce(types::I16, v);
                let word = self.b.ins().bswap(word);
                let v = self.b.ins().uextend(types::I32, word);
                self.set_low(v);
            }
            Convert::Tad => {
                let v = self.accu(0);
                let v = self.b.ins().bswap(v);
                self.set_full(v);
            }
            other => debug_assert!(false, "{other:?} is not compiled"),
        }
    }

    /// Out of range or NaN: ACCU1 stays, OV and OS are set. CC1 and CC0 stay.
    fn round(&mut self, kind: Convert) {
        let x = state::real(self.now.a[0], self.vars.a[0], &mut self.b);
        let before = self.accu(0);
        let whole = match kind {
            Convert::Rnd => self.b.ins().nearest(x),
            Convert::RndPlus => self.b.ins().ceil(x),
            Convert::RndMinus => self.b.ins().floor(x),
            _ => self.b.ins().trunc(x),
        };
        // Those from -2^31 to below 2^31 have a result; beyond 2^23 all are whole. The sign goes behind the size, and
        // decides at 2^31.
        let (one, least) = (self.word(1), self.word((-2_147_483_648f32).to_bits().rotate_left(1) ^ 1));
        let size = self.b.ins().rotl(before, one);
        let size = self.b.ins().bxor(size, one);
        let good = self.b.ins().icmp(IntCC::UnsignedLessThanOrEqual, size, least);
        let number = self.b.ins().fcvt_to_sint_sat(types::I32, whole);
        let result = self.b.ins().select(good, number, before);
        self.set_full(result);
        let ov = state::not(Bit::Val(good), &mut self.b);
        self.set_ov(ov);
    }
}

#[cfg(test)]
mod tests {
    use super::reciprocal;

    #[test]
    fn a_product_is_the_quotient_of_each_word() {
        let mut divided = 0;
        for divisor in 2..=i32::from(i16::MAX) {
            let Some((factor, shift)) = reciprocal(divisor) else {
                assert_eq!(divisor.count_ones(), 1, "{divisor}");
                continue;
            };
            let near = |x: i32| (x - 1..=x + 1).chain(-x - 1..=1 - x);
            let most = i32::from(i16::MAX) / divisor * divisor;
            let all = (divisor < 300 || divisor % 997 == 0).then_some(-32768..=32767);
            for x in all.into_iter().flatten().chain(near(0)).chain(near(divisor)).chain(near(most)).chain(near(32767))
            {
                let x = x.clamp(-32768, 32767);
                let product = x.checked_mul(factor).expect("32 bits");
                assert_eq!((product >> shift) + i32::from(x < 0), x / divisor, "{x} / {divisor}");
                divided += 1;
            }
        }
        assert!(divided > 20_000_000, "{divided}");
        assert_eq!([-7, -1, 0, 1, 2, 1024].map(reciprocal), [None; 6]);
    }
}
