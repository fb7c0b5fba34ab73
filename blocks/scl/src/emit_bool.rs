//! Truth values into the RLO.

use ob1_ir::{BitTest, Compare, Logic, NumberFormat, Op, Place, StatusBit, WordLogic};

use crate::code::Code;
use crate::tree::{Check, Kind, Typed};
use crate::types::format;

/// One input of a chain.
enum Input<'i, 'w> {
    /// One statement scans it.
    Bit(&'i Typed<'w>),
    /// It was calculated before.
    Kept(Place),
}

impl Code {
    /// The value of a BOOL into the RLO.
    pub(crate) fn bits(&mut self, value: &Typed<'_>) {
        match &value.kind {
            Kind::Constant(0) => self.op(Op::ClearRlo),
            Kind::Constant(_) => self.op(Op::SetRlo),
            _ if value.is_bit() => self.scan(Logic::And, value),
            Kind::Var(var) => {
                let place = self.place(var);
                self.op(Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(place) });
            }
            Kind::Not(inner) => {
                self.bits(inner);
                self.op(Op::NotRlo);
            }
            Kind::Compare(relation, left, right) => {
                self.two(left, right);
                self.op(Op::Compare(format(left.ty), *relation));
            }
            Kind::ToBool(inner) => {
                self.convert(&[], Check::Bits(0xFFFF_FFFE), inner);
                self.op(Op::DWordLogic(WordLogic::And, Some(1)));
                self.op(Op::LoadConst(0));
                self.op(Op::Compare(NumberFormat::DInt, Compare::NotEqual));
            }
            Kind::Logic(logic, inputs) => self.chain(*logic, inputs),
            Kind::Select(all) => self.select_bit(all),
            Kind::Call(call) => match self.call(call, None) {
                Some(place) => self.op(Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(place) }),
                None => self.lose(),
            },
            _ => self.lose(),
        }
    }

    /// One scan of a single bit.
    fn scan(&mut self, logic: Logic, value: &Typed<'_>) {
        let (value, negate) = match &value.kind {
            Kind::Not(inner) => (&**inner, true),
            _ => (value, false),
        };
        let test = match &value.kind {
            Kind::Var(var) => BitTest::Bit(self.place(var)),
            Kind::Ok => match self.ok {
                Some(ok) => BitTest::Bit(ok),
                None => return self.op(Op::SetRlo),
            },
            Kind::Timer(number) => BitTest::Timer(*number),
            Kind::Counter(number) => BitTest::Counter(*number),
            Kind::Eno => BitTest::Status(StatusBit::BinaryResult),
            _ => return self.lose(),
        };
        self.op(Op::Scan { logic, negate, test });
    }

    /// A truth value in a bit of the local data.
    pub(crate) fn kept_bit(&mut self, value: &Typed<'_>) -> Place {
        self.bits(value);
        let bit = self.take_bit();
        self.op(Op::Assign(bit));
        bit
    }

    /// All inputs are calculated, from left to right; what takes more than a scan comes first, into the local data. The
    /// last of these stays in the RLO.
    fn chain(&mut self, logic: Logic, values: &[Typed<'_>]) {
        let last = values.iter().rposition(|v| !v.is_bit());
        let mut inputs = Vec::with_capacity(values.len());
        for (at, value) in values.iter().enumerate() {
            if value.is_bit() {
                inputs.push(Input::Bit(value));
            } else if Some(at) != last || value.is_constant() {
                inputs.push(Input::Kept(self.kept_bit(value)));
            }
        }
        let mut begun = false;
        if let Some(value) = last.and_then(|at| values.get(at)).filter(|v| !v.is_constant()) {
            self.bits(value);
            begun = true;
        }
        for input in inputs {
            let logic = if begun { logic } else { Logic::And };
            begun = true;
            match input {
                Input::Bit(value) => self.scan(logic, value),
                Input::Kept(bit) => self.op(Op::Scan { logic, negate: false, test: BitTest::Bit(bit) }),
            }
        }
    }

    fn select_bit(&mut self, all: &[Typed<'_>; 3]) {
        let [g, zero, one] = all.each_ref().map(|value| self.kept_bit(value));
        let scan = |logic, negate, bit| Op::Scan { logic, negate, test: BitTest::Bit(bit) };
        let chosen = self.take_bit();
        self.op(scan(Logic::And, false, g));
        self.op(scan(Logic::And, false, one));
        self.op(Op::Assign(chosen));
        self.op(scan(Logic::And, true, g));
        self.op(scan(Logic::And, false, zero));
        self.op(scan(Logic::Or, false, chosen));
    }
}
