//! Operations of UDINT that DINT does not have.

use ob1_ir::{AccuOp, Compare, Convert, Jump, NumberFormat, Op, Operand, Shift, Width, WordLogic};

use crate::code::{Code, Label};
use crate::tree::{Typed, Unsigned};

/// 2 to the power of 16 and of 31.
const OF_16: f32 = 65_536.0;
const OF_31: f32 = 2_147_483_648.0;
/// The highest bit.
const HIGHEST: u32 = 0x8000_0000;

impl Code {
    pub(crate) fn unsigned(&mut self, operation: Unsigned, values: &[Typed<'_>]) {
        match (operation, values) {
            (Unsigned::Divide | Unsigned::Mod, [left, right]) => {
                self.two(left, right);
                let (quotient, rest) = self.divide();
                self.op(Op::Load(if operation == Unsigned::Divide { quotient } else { rest }));
            }
            (Unsigned::ToReal, [value]) => {
                self.value(value);
                let whole = self.keep();
                self.op(Op::Shift(Shift::RightDWord, Some(16)));
                self.op(Op::Convert(Convert::Dtr));
                self.op(Op::LoadConst(OF_16.to_bits()));
                self.op(Op::Arithmetic(NumberFormat::Real, AccuOp::Mul));
                self.op(Op::Load(whole));
                self.op(Op::DWordLogic(WordLogic::And, Some(0xFFFF)));
                self.op(Op::Convert(Convert::Dtr));
                self.op(Op::Arithmetic(NumberFormat::Real, AccuOp::Add));
            }
            (Unsigned::OfReal, [value]) => {
                self.value(value);
                let real = self.keep();
                let (high, end) = (self.label(), self.label());
                self.op(Op::LoadConst(OF_31.to_bits()));
                self.op(Op::Compare(NumberFormat::Real, Compare::GreaterEqual));
                self.op(Op::Load(real));
                self.jump(Jump::IfRlo, high);
                self.op(Op::Convert(Convert::Rnd));
                self.check_overflow();
                self.jump(Jump::Always, end);
                self.set(high);
                self.op(Op::LoadConst(OF_31.to_bits()));
                self.op(Op::Arithmetic(NumberFormat::Real, AccuOp::Sub));
                self.op(Op::Convert(Convert::Rnd));
                self.check_overflow();
                self.op(Op::DWordLogic(WordLogic::Xor, Some(HIGHEST)));
                self.set(end);
            }
            _ => self.lose(),
        }
    }

    /// ACCU2 by ACCU1: half of the dividend is divided with sign, and twice that quotient is at most one too small. A
    /// divisor with the highest bit fits once or not at all.
    fn divide(&mut self) -> (Operand, Operand) {
        let divisor = self.keep();
        self.op(Op::ExchangeAccus);
        let rest = self.keep();
        let quotient = self.temp(Width::DWord);
        let (large, compare, more, end) = (self.label(), self.label(), self.label(), self.label());
        self.op(Op::LoadConst(0));
        self.op(Op::Transfer(quotient));
        self.below_zero(divisor, large);
        self.op(Op::Load(rest));
        self.op(Op::Shift(Shift::RightDWord, Some(1)));
        self.op(Op::Load(divisor));
        self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Div));
        self.check_overflow();
        self.op(Op::Shift(Shift::LeftDWord, Some(1)));
        self.op(Op::Transfer(quotient));
        self.op(Op::Load(divisor));
        self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Mul));
        let taken = self.keep();
        self.op(Op::Load(rest));
        self.op(Op::Load(taken));
        self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Sub));
        self.op(Op::Transfer(rest));
        self.below_zero(rest, more);
        self.jump(Jump::Always, compare);
        self.set(large);
        self.below_zero(rest, compare);
        self.jump(Jump::Always, end);
        self.set(compare);
        self.op(Op::Load(rest));
        self.op(Op::Load(divisor));
        self.op(Op::Compare(NumberFormat::DInt, Compare::GreaterEqual));
        self.jump(Jump::IfNotRlo, end);
        self.set(more);
        self.op(Op::Load(quotient));
        self.op(Op::AddConst { format: NumberFormat::DInt, value: 1 });
        self.op(Op::Transfer(quotient));
        self.op(Op::Load(rest));
        self.op(Op::Load(divisor));
        self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Sub));
        self.op(Op::Transfer(rest));
        self.set(end);
        (quotient, rest)
    }

    /// Jumps where a DINT is negative.
    pub(crate) fn below_zero(&mut self, number: Operand, to: Label) {
        self.op(Op::Load(number));
        self.op(Op::LoadConst(0));
        self.op(Op::Compare(NumberFormat::DInt, Compare::Less));
        self.jump(Jump::IfRlo, to);
    }
}
