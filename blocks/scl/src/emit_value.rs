//! Values into ACCU1.

use ob1_ir::{
    AccuOp, BitTest, Compare, Convert, DbRegister, Jump, Logic, MathFn, Number, NumberFormat, Op, Operand, Place,
    Shift, StatusBit, Width, WordLogic,
};
use ob1_model::DataType;

use crate::code::Code;
use crate::tree::{Check, Kind, Shifted, Term, Typed};
use crate::types::format;

/// Milliseconds of a day.
const DAY: u32 = 86_400_000;

impl Code {
    /// The value of an elementary expression into ACCU1.
    pub(crate) fn value(&mut self, value: &Typed<'_>) {
        match &value.kind {
            Kind::Constant(bits) => self.op(Op::LoadConst(*bits)),
            Kind::Flexible(constant) => match constant.load() {
                Ok(bits) => self.op(Op::LoadConst(bits)),
                Err(_) => self.lose(),
            },
            _ if *value.ty == DataType::Bool => self.number_of_bit(value),
            Kind::Var(var) => {
                let operand = self.operand(var, value.ty);
                self.op(Op::Load(operand));
            }
            Kind::Convert(ops, check, inner) => self.convert(ops, *check, inner),
            Kind::FromBool(inner) => self.number_of_bit(inner),
            Kind::Arithmetic(op, left, right) => {
                self.two(left, right);
                self.op(Op::Arithmetic(format(left.ty), *op));
                self.check_overflow();
            }
            Kind::WithinDay(op, left, right) => self.within_day(*op, left, right),
            Kind::Power(base, exponent) => self.power(base, exponent),
            Kind::Bits(logic, left, right) => self.bit_string(*logic, left, right, value.ty),
            Kind::Shift(shifted, value, count) => self.shift(*shifted, value, count),
            Kind::Abs(inner) => self.abs(inner),
            Kind::Select(all) => self.select(all),
            Kind::Mux(k, values) => self.mux(k, values, value.ty),
            Kind::Extreme(relation, values) => self.extreme(*relation, values, value.ty),
            Kind::Limit(all) => self.limit(all, value.ty),
            Kind::Call(call) => match (self.call(call, None), Width::of(value.ty)) {
                (Some(place), Some(width)) => self.op(Op::Load(Operand { width, place })),
                _ => self.lose(),
            },
            Kind::Block(number) => self.block_number(*number),
            Kind::Unsigned(operation, values) => self.unsigned(*operation, values),
            Kind::Clock(read) => self.read_clock(read, value.span),
            Kind::Timed(timed) => self.timed(timed),
            Kind::Timer(number) => self.op(Op::LoadTimerBcd(*number)),
            Kind::Counter(number) => self.op(Op::LoadCounter(*number)),
            _ => self.lose(),
        }
    }

    fn block_number(&mut self, number: Number) {
        match number {
            Number::Fixed(n) => self.op(Op::LoadConst(u32::from(n))),
            Number::Instance(at) => self.op(Op::Load(Operand { width: Width::Word, place: Place::Instance(at) })),
            Number::Memory(pointer) => {
                self.op(Op::Load(Operand { width: Width::Word, place: Place::Fixed(pointer.area, pointer.at) }));
            }
            Number::Param(_) => {
                self.op(Op::OpenDb(DbRegister::Db, number));
                self.op(Op::LoadDbNumber(DbRegister::Db));
            }
        }
    }

    /// The left value in ACCU2, the right one in ACCU1.
    pub(crate) fn two(&mut self, left: &Typed<'_>, right: &Typed<'_>) {
        if right.is_leaf() {
            self.value(left);
            self.value(right);
        } else if left.is_leaf() {
            self.value(right);
            self.value(left);
            self.op(Op::ExchangeAccus);
        } else {
            self.value(left);
            let kept = self.temp(Width::DWord);
            self.op(Op::Transfer(kept));
            self.value(right);
            self.op(Op::Load(kept));
            self.op(Op::ExchangeAccus);
        }
    }

    /// After an operation that sets OV: clears OK, where the option says so.
    pub(crate) fn check_overflow(&mut self) {
        let Some(ok) = self.ok.filter(|_| self.options.set_ok) else { return };
        let test = BitTest::Status(StatusBit::Overflow);
        self.op(Op::Scan { logic: Logic::And, negate: false, test });
        self.op(Op::Reset(ok));
    }

    /// Clears OK where an index lies outside its array. ACCU1 keeps the index.
    pub(crate) fn check_limits(&mut self, term: &Term<'_>) {
        let Some(ok) = self.ok else { return };
        let index = self.temp(Width::DWord);
        self.op(Op::Transfer(index));
        for (bound, relation) in [(term.low, Compare::Less), (term.high, Compare::Greater)] {
            self.op(Op::Load(index));
            self.op(Op::LoadConst(bound as u32));
            self.op(Op::Compare(NumberFormat::DInt, relation));
            self.op(Op::Reset(ok));
        }
        self.op(Op::Load(index));
    }

    pub(crate) fn convert(&mut self, ops: &[Op], check: Check, inner: &Typed<'_>) {
        self.value(inner);
        let ok = self.ok.filter(|_| self.options.set_ok && check != Check::Never);
        let Some(ok) = ok else {
            for op in ops {
                self.op(op.clone());
            }
            return;
        };
        match check {
            Check::Bits(bits) => {
                let kept = self.keep();
                self.op(Op::DWordLogic(WordLogic::And, Some(bits)));
                self.op(Op::LoadConst(0));
                self.op(Op::Compare(NumberFormat::DInt, Compare::NotEqual));
                self.op(Op::Reset(ok));
                self.op(Op::Load(kept));
            }
            Check::Int => self.check_int(ok),
            Check::Day => {
                let kept = self.keep();
                for (bound, relation) in [(0, Compare::Less), (DAY - 1, Compare::Greater)] {
                    self.op(Op::Load(kept));
                    self.op(Op::LoadConst(bound));
                    self.op(Op::Compare(NumberFormat::DInt, relation));
                    self.op(Op::Reset(ok));
                }
                self.op(Op::Load(kept));
            }
            _ => {}
        }
        for op in ops {
            self.op(op.clone());
        }
        match check {
            Check::Overflow => {
                self.check_overflow();
                // A standard function behaves like a block: ENO behind it is OK.
                if matches!(ops, [Op::Math(_)]) {
                    self.op(Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(ok) });
                    self.op(Op::SaveRlo);
                    // SAVE leaves the chain open.
                    self.op(Op::SetRlo);
                }
            }
            Check::OverflowOrInt => {
                self.check_overflow();
                self.check_int(ok);
            }
            _ => {}
        }
    }

    pub(crate) fn keep(&mut self) -> Operand {
        let kept = self.temp(Width::DWord);
        self.op(Op::Transfer(kept));
        kept
    }

    /// Clears OK where ACCU1 is no INT.
    fn check_int(&mut self, ok: Place) {
        let kept = self.keep();
        self.op(Op::Convert(Convert::Itd));
        self.op(Op::Load(kept));
        self.op(Op::Compare(NumberFormat::DInt, Compare::NotEqual));
        self.op(Op::Reset(ok));
        self.op(Op::Load(kept));
    }

    fn number_of_bit(&mut self, inner: &Typed<'_>) {
        self.bits(inner);
        let (zero, end) = (self.label(), self.label());
        self.jump(Jump::IfNotRlo, zero);
        self.op(Op::LoadConst(1));
        self.jump(Jump::Always, end);
        self.set(zero);
        self.op(Op::LoadConst(0));
        self.set(end);
    }

    fn within_day(&mut self, op: AccuOp, left: &Typed<'_>, right: &Typed<'_>) {
        self.two(left, right);
        self.op(Op::Arithmetic(NumberFormat::DInt, op));
        self.check_overflow();
        self.op(Op::LoadConst(DAY));
        self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Mod));
        let end = self.label();
        self.op(Op::LoadConst(0));
        self.op(Op::ExchangeAccus);
        self.op(Op::Compare(NumberFormat::DInt, Compare::LessEqual));
        self.jump(Jump::IfRlo, end);
        self.op(Op::AddConst { format: NumberFormat::DInt, value: DAY as i32 });
        self.set(end);
    }

    /// EXP(exponent * LN(base)).
    fn power(&mut self, base: &Typed<'_>, exponent: &Typed<'_>) {
        self.value(base);
        self.op(Op::Math(MathFn::Ln));
        self.check_overflow();
        if exponent.is_leaf() {
            self.value(exponent);
        } else {
            let kept = self.keep();
            self.value(exponent);
            self.op(Op::Load(kept));
        }
        self.op(Op::Arithmetic(NumberFormat::Real, AccuOp::Mul));
        self.check_overflow();
        self.op(Op::Math(MathFn::Exp));
        self.check_overflow();
    }

    fn bit_string(&mut self, logic: Logic, left: &Typed<'_>, right: &Typed<'_>, ty: &DataType) {
        let op = match logic {
            Logic::And => WordLogic::And,
            Logic::Or => WordLogic::Or,
            Logic::Xor => WordLogic::Xor,
        };
        let long = *ty == DataType::DWord;
        let constant = match (&left.kind, &right.kind) {
            (_, Kind::Constant(bits)) => Some((left, *bits)),
            (Kind::Constant(bits), _) => Some((right, *bits)),
            _ => None,
        };
        if let Some((value, bits)) = constant {
            self.value(value);
            self.op(if long { Op::DWordLogic(op, Some(bits)) } else { Op::WordLogic(op, Some(bits as u16)) });
            return;
        }
        self.two(left, right);
        self.op(if long { Op::DWordLogic(op, None) } else { Op::WordLogic(op, None) });
    }

    fn shift(&mut self, shifted: Shifted, value: &Typed<'_>, count: &Typed<'_>) {
        let bits = value.ty.elementary_bits().unwrap_or(32);
        if matches!(shifted, Shifted::RotateLeft | Shifted::RotateRight) {
            return self.rotate(shifted == Shifted::RotateLeft, bits, value, count);
        }
        let op = match (shifted, bits) {
            (Shifted::Left, 32) => Shift::LeftDWord,
            (Shifted::Left, _) => Shift::LeftWord,
            (_, 32) => Shift::RightDWord,
            _ => Shift::RightWord,
        };
        if let Kind::Constant(n) = count.kind {
            let n = u32::from(n as u16);
            if n >= bits {
                self.value(value);
                self.op(Op::LoadConst(0));
            } else {
                self.value(value);
                self.op(Op::Shift(op, Some(n as u8)));
                self.mask(bits);
            }
            return;
        }
        self.two(count, value);
        let ok = self.ok.filter(|_| self.options.set_ok);
        // The lowest byte of the number counts, as the statement takes it.
        if bits == 32 && ok.is_none() {
            self.op(Op::Shift(op, None));
            return;
        }
        let kept = self.keep();
        let (zero, end) = (self.label(), self.label());
        self.op(Op::ExchangeAccus);
        let n = self.temp(Width::Word);
        self.op(Op::Transfer(n));
        if let Some(ok) = ok {
            self.op(Op::LoadConst(0));
            self.op(Op::Compare(NumberFormat::Int, Compare::Less));
            self.op(Op::Reset(ok));
            self.jump(Jump::IfRlo, zero);
            self.op(Op::Load(n));
        }
        if bits < 32 {
            self.op(Op::LoadConst(16));
            self.op(Op::Compare(NumberFormat::Int, Compare::GreaterEqual));
            self.jump(Jump::IfRlo, zero);
            self.op(Op::Load(n));
        }
        self.op(Op::Load(kept));
        self.op(Op::Shift(op, None));
        self.mask(bits);
        self.jump(Jump::Always, end);
        self.set(zero);
        self.op(Op::LoadConst(0));
        self.set(end);
    }

    fn mask(&mut self, bits: u32) {
        if bits < 32 {
            self.op(Op::DWordLogic(WordLogic::And, Some(u32::MAX >> (32 - bits))));
        }
    }

    fn rotate(&mut self, left: bool, bits: u32, value: &Typed<'_>, count: &Typed<'_>) {
        let op = if left { Shift::RotateLeft } else { Shift::RotateRight };
        self.two(value, count);
        // The value as often as it fits into 32 bits: the places that leave one copy come in from the next.
        let n = self.temp(Width::Word);
        self.op(Op::DWordLogic(WordLogic::And, Some(bits - 1)));
        self.op(Op::Transfer(n));
        self.op(Op::ExchangeAccus);
        let mut width = bits;
        while width < 32 {
            let kept = self.keep();
            self.op(Op::Shift(Shift::LeftDWord, Some(width as u8)));
            self.op(Op::Load(kept));
            self.op(Op::DWordLogic(WordLogic::Or, None));
            width *= 2;
        }
        let kept = self.keep();
        self.op(Op::Load(n));
        self.op(Op::Load(kept));
        self.op(Op::Shift(op, None));
        self.mask(bits);
    }

    fn abs(&mut self, inner: &Typed<'_>) {
        self.value(inner);
        let kept = self.keep();
        let end = self.label();
        let format = format(inner.ty);
        self.op(Op::LoadConst(0));
        self.op(Op::Compare(format, Compare::GreaterEqual));
        self.op(Op::Load(kept));
        self.jump(Jump::IfRlo, end);
        self.op(Op::Convert(if format == NumberFormat::Int { Convert::Negi } else { Convert::Negd }));
        self.check_overflow();
        self.set(end);
    }

    /// Both inputs are calculated, then one is taken.
    fn select(&mut self, all: &[Typed<'_>; 3]) {
        let [g, zero, one] = all;
        if zero.is_leaf() && one.is_leaf() {
            self.bits(g);
            return self.either(|code| code.value(one), |code| code.value(zero));
        }
        self.bits(g);
        let bit = self.take_bit();
        self.op(Op::Assign(bit));
        self.value(zero);
        let zero = self.keep();
        self.value(one);
        let one = self.keep();
        self.op(Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(bit) });
        self.either(|code| code.op(Op::Load(one)), |code| code.op(Op::Load(zero)));
    }

    /// One of two, by the RLO.
    fn either(&mut self, yes: impl FnOnce(&mut Self), no: impl FnOnce(&mut Self)) {
        let (otherwise, end) = (self.label(), self.label());
        self.jump(Jump::IfNotRlo, otherwise);
        yes(self);
        self.jump(Jump::Always, end);
        self.set(otherwise);
        no(self);
        self.set(end);
    }

    /// All inputs are calculated; with a number beyond them the last is taken.
    fn mux(&mut self, k: &Typed<'_>, values: &[Typed<'_>], ty: &DataType) {
        let width = Width::of(ty).unwrap_or(Width::DWord);
        let mut kept = Vec::with_capacity(values.len());
        self.value(k);
        let number = self.temp(Width::Word);
        self.op(Op::Transfer(number));
        for value in values {
            self.value(value);
            let place = self.temp(width);
            self.op(Op::Transfer(place));
            kept.push(place);
        }
        let end = self.label();
        for (at, place) in (0u32..).zip(&kept) {
            let next = self.label();
            if at + 1 < kept.len() as u32 {
                self.op(Op::Load(number));
                self.op(Op::LoadConst(at));
                self.op(Op::Compare(NumberFormat::Int, Compare::Equal));
                self.jump(Jump::IfNotRlo, next);
            }
            self.op(Op::Load(*place));
            self.jump(Jump::Always, end);
            self.set(next);
        }
        self.set(end);
    }

    /// The first of the values that stands in the relation to all behind it.
    fn extreme(&mut self, relation: Compare, values: &[Typed<'_>], ty: &DataType) {
        let Some((first, rest)) = values.split_first() else { return self.lose() };
        self.value(first);
        for value in rest {
            let best = self.keep();
            self.value(value);
            let other = self.keep();
            let end = self.label();
            self.op(Op::Load(best));
            self.op(Op::Load(other));
            self.op(Op::Compare(format(ty), relation));
            self.op(Op::Load(best));
            self.jump(Jump::IfRlo, end);
            self.op(Op::Load(other));
            self.set(end);
        }
    }

    /// MN if not IN >= MN; MX if not IN <= MX; else IN.
    fn limit(&mut self, all: &[Typed<'_>; 3], ty: &DataType) {
        let mut kept = Vec::with_capacity(3);
        for value in all {
            self.value(value);
            kept.push(self.keep());
        }
        let [low, value, high] = kept.as_slice() else { return self.lose() };
        let (below, above, end) = (self.label(), self.label(), self.label());
        self.op(Op::Load(*value));
        self.op(Op::Load(*low));
        self.op(Op::Compare(format(ty), Compare::GreaterEqual));
        self.jump(Jump::IfNotRlo, below);
        self.op(Op::Load(*value));
        self.op(Op::Load(*high));
        self.op(Op::Compare(format(ty), Compare::LessEqual));
        self.jump(Jump::IfNotRlo, above);
        self.op(Op::Load(*value));
        self.jump(Jump::Always, end);
        self.set(below);
        self.op(Op::Load(*low));
        self.jump(Jump::Always, end);
        self.set(above);
        self.op(Op::Load(*high));
        self.set(end);
    }
}
