//! Floating-point numbers. Their results are defined by the reference (`ob1_cpu::engine::arith`, `convert`).

use cranelift_codegen::ir::{
    InstBuilder, Value,
    condcodes::{FloatCC, IntCC},
    types,
};
use ob1_ir::{AccuOp, Compare, Convert};

use super::Translation;
use super::arithmetic::OVERFLOW;
use super::state::{self, Accu, Bit, Cc};
use crate::flow;

impl Translation<'_, '_> {
    pub(super) fn real(&mut self, op: AccuOp) {
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
    pub(super) fn set_real(&mut self, result: Value) {
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

    /// With a NaN every comparison is false.
    pub(super) fn compare_real(&mut self, compare: Compare) {
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

    /// Out of range or NaN: ACCU1 stays, OV and OS are set. CC1 and CC0 stay.
    pub(super) fn round(&mut self, kind: Convert) {
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
