//! The statements that work on the accumulators.

use cranelift_codegen::ir::{InstBuilder, Value, condcodes::IntCC, types};
use ob1_ir::{AccuOp, Compare, NumberFormat, WordLogic};

use super::{A1, A2, Bare, CC0, CC1, OS, OV};

impl Bare<'_, '_> {
    /// The low word of an accumulator with its sign.
    fn int(&mut self, register: usize) -> Value {
        let value = self.get(register);
        let word = self.b.ins().ireduce(types::I16, value);
        self.b.ins().sextend(types::I32, word)
    }

    /// A new low word of ACCU1.
    fn set_low(&mut self, value: Value) {
        let (high, low) = (self.word(0xFFFF_0000), self.word(0xFFFF));
        let before = self.get(A1);
        let (before, value) = (self.b.ins().band(before, high), self.b.ins().band(value, low));
        let both = self.b.ins().bor(before, value);
        self.set(A1, both);
    }

    fn codes(&mut self, x: Value, y: Value) {
        let more = self.b.ins().icmp(IntCC::SignedGreaterThan, x, y);
        let less = self.b.ins().icmp(IntCC::SignedLessThan, x, y);
        self.set(CC1, more);
        self.set(CC0, less);
    }

    fn overflow(&mut self, ov: Value) {
        self.set(OV, ov);
        let os = self.get(OS);
        let os = self.b.ins().bor(os, ov);
        self.set(OS, os);
    }

    pub(super) fn arithmetic(&mut self, format: NumberFormat, op: AccuOp) {
        let (x, y) = match format {
            NumberFormat::Int => (self.int(A2), self.int(A1)),
            NumberFormat::DInt => (self.get(A2), self.get(A1)),
            NumberFormat::Real => return self.others(3),
        };
        let whole = match op {
            AccuOp::Add => self.b.ins().iadd(x, y),
            AccuOp::Sub => self.b.ins().isub(x, y),
            AccuOp::Mul => self.b.ins().imul(x, y),
            _ => return self.others(3),
        };
        let zero = self.word(0);
        if format == NumberFormat::DInt {
            let (p, q) = (self.b.ins().bxor(whole, x), self.b.ins().bxor(whole, y));
            let both = self.b.ins().band(p, q);
            let ov = self.b.ins().icmp(IntCC::SignedLessThan, both, zero);
            self.set(A1, whole);
            self.codes(whole, zero);
            return self.overflow(ov);
        }
        let word = self.b.ins().ireduce(types::I16, whole);
        let kept = self.b.ins().sextend(types::I32, word);
        let ov = self.b.ins().icmp(IntCC::NotEqual, kept, whole);
        self.set_low(whole);
        self.codes(kept, zero);
        self.overflow(ov);
    }

    pub(super) fn logic(&mut self, logic: WordLogic, with: Option<u32>, word: bool) {
        let x = self.get(A1);
        let y = match with {
            Some(value) => self.word(value),
            None => self.get(A2),
        };
        let result = match logic {
            WordLogic::And => self.b.ins().band(x, y),
            WordLogic::Or => self.b.ins().bor(x, y),
            WordLogic::Xor => self.b.ins().bxor(x, y),
        };
        let (seen, ty) =
            if word { (self.b.ins().ireduce(types::I16, result), types::I16) } else { (result, types::I32) };
        let zero = self.b.ins().iconst(ty, 0);
        let any = self.b.ins().icmp(IntCC::NotEqual, seen, zero);
        if word {
            self.set_low(result);
        } else {
            self.set(A1, result);
        }
        self.clear(&[CC0, OV]);
        self.set(CC1, any);
    }

    pub(super) fn compare(&mut self, format: NumberFormat, compare: Compare) {
        let (x, y) = match format {
            NumberFormat::Int => (self.int(A2), self.int(A1)),
            NumberFormat::DInt => (self.get(A2), self.get(A1)),
            NumberFormat::Real => return self.others(3),
        };
        let how = condition(compare);
        let result = self.b.ins().icmp(how, x, y);
        self.codes(x, y);
        self.clear(&[OV]);
        self.result(result);
    }
}

/// A comparison of signed numbers, in Cranelift's words.
fn condition(compare: Compare) -> IntCC {
    match compare {
        Compare::Equal => IntCC::Equal,
        Compare::NotEqual => IntCC::NotEqual,
        Compare::Greater => IntCC::SignedGreaterThan,
        Compare::Less => IntCC::SignedLessThan,
        Compare::GreaterEqual => IntCC::SignedGreaterThanOrEqual,
        Compare::LessEqual => IntCC::SignedLessThanOrEqual,
    }
}
