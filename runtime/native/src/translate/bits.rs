//! Bit logic.

use cranelift_codegen::ir::{InstBuilder, Value, condcodes::IntCC, types};
use cranelift_frontend::Variable;
use ob1_ir::{BitTest, Logic, Op, Place, StatusBit};

use super::Translation;
use super::state::{self, Bit, Bracket};

impl Translation<'_, '_> {
    /// Reads a bit out of its variable, so that it can be combined.
    pub(crate) fn read_bit(&mut self, bit: Bit, var: Variable) -> Bit {
        match bit {
            Bit::Var => Bit::Val(self.b.use_var(var)),
            other => other,
        }
    }

    pub(crate) fn rlo(&mut self) -> Bit {
        let bit = self.now.rlo;
        self.read_bit(bit, self.vars.rlo)
    }

    fn fc(&mut self) -> Bit {
        let bit = self.now.fc;
        self.read_bit(bit, self.vars.fc)
    }

    fn or_bit(&mut self) -> Bit {
        let bit = self.now.or;
        self.read_bit(bit, self.vars.or)
    }

    pub(crate) fn end_chain(&mut self, sta: Bit) {
        self.now.fc = Bit::Known(false);
        self.now.or = Bit::Known(false);
        self.now.sta = sta;
    }

    pub(crate) fn set_result(&mut self, rlo: Bit) {
        self.now.rlo = rlo;
        self.now.sta = rlo;
        self.now.or = Bit::Known(false);
        self.now.fc = Bit::Known(true);
    }

    /// True when the statement is one of bit logic.
    pub(crate) fn bit_statement(&mut self, op: &Op, pc: usize) -> bool {
        match op {
            Op::Scan { logic, negate, test } => self.scan(*logic, *negate, test, pc),
            Op::Open { logic, negate } => self.open_bracket(*logic, *negate),
            Op::Close => self.close_bracket(),
            Op::OrBranch => {
                let (fc, rlo) = (self.fc(), self.rlo());
                let or = state::and(fc, rlo, &mut self.b);
                self.now.or = or;
                self.now.fc = or;
                self.now.sta = Bit::Known(true);
            }
            Op::Assign(place) => {
                let spot = self.spot(place, 1, true, pc);
                let rlo = self.rlo();
                self.put_bit(spot, rlo);
                self.end_chain(rlo);
            }
            Op::Set(place) => self.set_reset(place, true, pc),
            Op::Reset(place) => self.set_reset(place, false, pc),
            Op::EdgePositive(place) => self.edge(place, true, pc),
            Op::EdgeNegative(place) => self.edge(place, false, pc),
            Op::SetRlo => {
                self.now.rlo = Bit::Known(true);
                self.end_chain(Bit::Known(true));
            }
            Op::ClearRlo => {
                self.now.rlo = Bit::Known(false);
                self.end_chain(Bit::Known(false));
            }
            Op::NotRlo => {
                let rlo = self.rlo();
                self.now.rlo = state::not(rlo, &mut self.b);
                self.now.sta = Bit::Known(true);
            }
            Op::SaveRlo => self.now.br = self.rlo(),
            _ => return false,
        }
        true
    }

    fn set_reset(&mut self, place: &Place, set: bool, pc: usize) {
        let rlo = self.rlo();
        let spot = self.spot(place, 1, true, pc);
        match rlo {
            Bit::Known(false) => {}
            Bit::Known(true) => self.put_bit(spot, Bit::Known(set)),
            rlo => self.change_bit(spot, set, rlo),
        }
        self.end_chain(rlo);
    }

    fn edge(&mut self, place: &Place, positive: bool, pc: usize) {
        let spot = self.spot(place, 1, true, pc);
        let before = self.bit(spot);
        let rlo = self.rlo();
        self.put_bit(spot, rlo);
        let result = if positive {
            let was_off = state::not(before, &mut self.b);
            state::and(rlo, was_off, &mut self.b)
        } else {
            let off = state::not(rlo, &mut self.b);
            state::and(off, before, &mut self.b)
        };
        self.set_result(result);
        self.now.sta = rlo;
    }

    fn scan(&mut self, logic: Logic, negate: bool, test: &BitTest, pc: usize) {
        let bit = match test {
            BitTest::Bit(place) => {
                let spot = self.spot(place, 1, false, pc);
                self.bit(spot)
            }
            BitTest::Status(bit) => self.status(*bit),
            BitTest::Timer(n) => self.timer_output(*n),
            BitTest::Counter(n) => self.counter_output(*n),
        };
        let tested = if negate { state::not(bit, &mut self.b) } else { bit };
        let fc = self.fc();
        let rlo = match fc {
            // The first scan of a chain does not use the RLO.
            Bit::Known(false) => Bit::Known(false),
            _ => self.rlo(),
        };
        let result = match logic {
            Logic::And => {
                let first = state::not(fc, &mut self.b);
                let held = state::or(first, rlo, &mut self.b);
                let result = state::and(held, tested, &mut self.b);
                let or = self.or_bit();
                state::or(result, or, &mut self.b)
            }
            Logic::Or => {
                let held = state::and(fc, rlo, &mut self.b);
                state::or(held, tested, &mut self.b)
            }
            Logic::Xor => {
                let held = state::and(fc, rlo, &mut self.b);
                state::xor(held, tested, &mut self.b)
            }
        };
        self.now.rlo = result;
        if logic != Logic::And {
            self.now.or = Bit::Known(false);
        }
        self.now.sta = bit;
        self.now.fc = Bit::Known(true);
    }

    /// A condition of the status word.
    pub(crate) fn status(&mut self, bit: StatusBit) -> Bit {
        match bit {
            StatusBit::Overflow => {
                let bit = self.now.ov;
                self.read_bit(bit, self.vars.ov)
            }
            StatusBit::StoredOverflow => {
                let bit = self.now.os;
                self.read_bit(bit, self.vars.os)
            }
            StatusBit::BinaryResult => {
                let bit = self.now.br;
                self.read_bit(bit, self.vars.br)
            }
            other => state::condition(other, self.now.cc, self.vars.cc, &mut self.b),
        }
    }

    fn open_bracket(&mut self, logic: Logic, negate: bool) {
        let fc = self.fc();
        let rlo = match (fc, logic) {
            (Bit::Known(false), _) => Bit::Known(logic == Logic::And),
            (_, Logic::And) => {
                let rlo = self.rlo();
                let first = state::not(fc, &mut self.b);
                state::or(first, rlo, &mut self.b)
            }
            _ => {
                let rlo = self.rlo();
                state::and(fc, rlo, &mut self.b)
            }
        };
        let or = self.or_bit();
        self.now.brackets.push(Bracket { rlo, or, negate, logic });
        self.end_chain(Bit::Known(true));
    }

    fn close_bracket(&mut self) {
        let rlo = self.rlo();
        let Some(open) = self.now.brackets.pop() else {
            self.close_unknown(rlo);
            return;
        };
        let inner = if open.negate { state::not(rlo, &mut self.b) } else { rlo };
        let (result, or) = match open.logic {
            Logic::And => {
                let both = state::and(open.rlo, inner, &mut self.b);
                (state::or(both, open.or, &mut self.b), open.or)
            }
            Logic::Or => (state::or(open.rlo, inner, &mut self.b), Bit::Known(false)),
            Logic::Xor => (state::xor(open.rlo, inner, &mut self.b), Bit::Known(false)),
        };
        self.now.rlo = result;
        self.now.or = or;
        self.now.sta = Bit::Known(true);
        self.now.fc = Bit::Known(true);
    }

    /// `)` of a bracket that was opened before a place where jumps meet.
    fn close_unknown(&mut self, rlo: Bit) {
        let nest = self.outer_nest();
        let eight = self.b.iconst(types::I64, 8);
        let rest = self.b.ins().ushr(nest, eight);
        self.b.def_var(self.vars.nest, rest);
        let entry = self.b.ins().ireduce(types::I8, nest);
        let bit = |t: &mut Self, n: i64| -> Value {
            let shift = t.b.iconst(types::I8, n);
            let v = t.b.ins().ushr(entry, shift);
            let one = t.b.iconst(types::I8, 1);
            t.b.ins().band(v, one)
        };
        let (saved, or, negate) = (bit(self, 0), bit(self, 1), bit(self, 2));
        let three = self.b.iconst(types::I8, 3);
        let kind = self.b.ins().ushr(entry, three);
        let kind = self.b.ins().band(kind, three);
        let rlo = rlo.value(self.vars.rlo, &mut self.b);
        let inner = self.b.ins().bxor(rlo, negate);
        let both = self.b.ins().band(saved, inner);
        let anded = self.b.ins().bor(both, or);
        let ored = self.b.ins().bor(saved, inner);
        let xored = self.b.ins().bxor(saved, inner);
        let zero = self.b.iconst(types::I8, 0);
        let one = self.b.iconst(types::I8, 1);
        let is_and = self.b.ins().icmp(IntCC::Equal, kind, zero);
        let is_or = self.b.ins().icmp(IntCC::Equal, kind, one);
        let other = self.b.ins().select(is_or, ored, xored);
        let result = self.b.ins().select(is_and, anded, other);
        let or = self.b.ins().select(is_and, or, zero);
        self.now.rlo = Bit::Val(result);
        self.now.or = Bit::Val(or);
        self.now.sta = Bit::Known(true);
        self.now.fc = Bit::Known(true);
    }
}
