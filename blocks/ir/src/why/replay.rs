//! A recorded pass, run again with some bits the other way. What cannot be known from the record is `None`.
//!
//! The meaning of bit logic is that of the reference engine (`runtime/cpu/src/engine/statement.rs`); a test compares.

use ob1_model::{Area, Width};

use super::{FC, Observed, RLO, is_plain};
use crate::call::{Call, CallMode};
use crate::op::{BitTest, Jump, Logic, Op, StatusBit};
use crate::place::Place;

/// True, false or not known.
type Bit = Option<bool>;

fn not(a: Bit) -> Bit {
    a.map(|a| !a)
}

fn and(a: Bit, b: Bit) -> Bit {
    match (a, b) {
        (Some(false), _) | (_, Some(false)) => Some(false),
        (Some(true), Some(true)) => Some(true),
        _ => None,
    }
}

fn or(a: Bit, b: Bit) -> Bit {
    not(and(not(a), not(b)))
}

fn xor(a: Bit, b: Bit) -> Bit {
    Some(a? != b?)
}

/// A bit that is the other way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Flip {
    /// Of an operand, at the begin of the pass.
    Everywhere(BitTest),
    /// Of one scan, whatever has written it.
    Here(usize),
}

/// What an open bracket keeps for its end.
#[derive(Clone, Copy, Debug)]
struct Nested {
    rlo: Bit,
    or: Bit,
    negate: bool,
    logic: Logic,
}

pub(super) struct Replay<'p, 'o> {
    pass: &'o Observed<'p>,
    wanted: Option<(Place, bool)>,
    rlo: Bit,
    fc: Bit,
    or: Bit,
    nest: Vec<Nested>,
    /// What the pass has written, newest last.
    written: Vec<(Place, Bit)>,
    /// A bit that was written through a parameter or a pointer differs from the record.
    is_wild: bool,
    /// Bits of data blocks that differ from the record: others may name them in another way.
    other_data: Vec<Place>,
    /// A word or a result that the record has may be another one.
    is_poisoned: bool,
    /// BR differs from the record.
    other_br: bool,
    /// Timers and counters of which a statement had another RLO.
    stirred: Vec<BitTest>,
    calls: Vec<&'p Call>,
    /// Another way would have been taken.
    is_lost: bool,
}

impl<'p, 'o> Replay<'p, 'o> {
    /// For the value of a place behind the pass; `now` is what it was.
    pub(super) fn new(pass: &'o Observed<'p>, place: Place, now: bool) -> Self {
        Self {
            pass,
            wanted: Some((place, now)),
            rlo: None,
            fc: Some(false),
            or: Some(false),
            nest: Vec::new(),
            written: Vec::new(),
            is_wild: false,
            other_data: Vec::new(),
            is_poisoned: false,
            other_br: false,
            stirred: Vec::new(),
            calls: Vec::new(),
            is_lost: false,
        }
    }

    /// The RLO in front of a statement.
    pub(super) fn rlo(pass: &'o Observed<'p>, statement: usize, flips: &[Flip]) -> Bit {
        let mut replay =
            Self { wanted: None, ..Self::new(pass, Place::Fixed(Area::Memory, ob1_model::BitAddr(0)), false) };
        replay.go(statement, flips);
        if replay.is_lost { None } else { replay.rlo }
    }

    /// The value of the wanted place behind the pass.
    pub(super) fn run(mut self, end: usize, flips: &[Flip]) -> Bit {
        self.go(end, flips);
        let (place, now) = self.wanted?;
        if self.is_lost || self.is_wild {
            return None;
        }
        let last = self.written.iter().rev().find(|(of, _)| *of == place).map(|(_, value)| *value);
        last.unwrap_or(Some(now))
    }

    fn go(&mut self, end: usize, flips: &[Flip]) {
        for at in 0..end.min(self.pass.code.len()) {
            if self.is_lost || !self.pass.ran(at) {
                continue;
            }
            if let Some(stmt) = self.pass.code.get(at) {
                self.statement(at, &stmt.op, flips);
            }
        }
    }

    fn statement(&mut self, at: usize, op: &'p Op, flips: &[Flip]) {
        match op {
            Op::Scan { logic, negate, test } => {
                let bit = self.scanned(at, test, flips);
                self.scan(*logic, if *negate { not(bit) } else { bit });
            }
            Op::Open { logic, negate } => {
                let start = Some(*logic == Logic::And);
                let rlo = or(and(self.fc, self.rlo), and(not(self.fc), start));
                self.nest.push(Nested { rlo, or: self.or, negate: *negate, logic: *logic });
                self.end_chain();
            }
            Op::Close => self.close(),
            Op::OrBranch => {
                self.or = and(self.fc, self.rlo);
                self.fc = self.or;
            }
            Op::Assign(place) => {
                self.write(at, *place, self.rlo);
                self.end_chain();
            }
            Op::Set(place) => self.set(at, *place, true),
            Op::Reset(place) => self.set(at, *place, false),
            Op::EdgePositive(place) => self.edge(at, *place, true),
            Op::EdgeNegative(place) => self.edge(at, *place, false),
            Op::SetRlo => {
                self.rlo = Some(true);
                self.end_chain();
            }
            Op::ClearRlo => {
                self.rlo = Some(false);
                self.end_chain();
            }
            Op::NotRlo => self.rlo = not(self.rlo),
            Op::SaveRlo => self.other_br = self.rlo != Some(self.recorded_before(at)),
            Op::StartTimer(_, n) | Op::ResetTimer(n) | Op::EnableTimer(n) => self.stir(at, BitTest::Timer(*n)),
            Op::CountUp(n) | Op::CountDown(n) | Op::SetCounter(n) | Op::ResetCounter(n) | Op::EnableCounter(n) => {
                self.stir(at, BitTest::Counter(*n));
            }
            Op::Jump(jump, _) => self.jump(at, *jump),
            // In the path of the record.
            Op::EndIf => {
                self.is_lost |= self.rlo != Some(self.recorded_before(at));
                self.end_chain();
            }
            Op::Call(call) => {
                if call.mode == CallMode::Conditional {
                    self.is_lost |= self.rlo != Some(self.recorded_before(at));
                }
                if !flips.is_empty() {
                    self.calls.push(call);
                }
                self.take_recorded(at);
            }
            Op::McrActivate | Op::McrOpen => self.is_lost = true,
            op => self.other(at, op, flips),
        }
    }

    /// Statements that the record knows better: loads, comparisons, transfers.
    fn other(&mut self, at: usize, op: &Op, flips: &[Flip]) {
        let flipped = |place: Place, width: Width| {
            flips.iter().any(|flip| matches!(flip, Flip::Everywhere(BitTest::Bit(of)) if may_touch(place, width, *of)))
        };
        if let Some(operand) = op.operand() {
            if op.writes() {
                self.is_wild |= self.is_poisoned;
                // A word is over the bits that were written before.
                self.written.retain(|(place, _)| !may_touch(operand.place, operand.width, *place));
            } else {
                let other = self.written.iter().any(|(place, value)| {
                    may_touch(operand.place, operand.width, *place)
                        && (value.is_none() || *value != self.record_of(*place, at))
                });
                self.is_poisoned |= other || flipped(operand.place, operand.width);
            }
        }
        let number = |of: &BitTest| match (op, of) {
            (Op::LoadTimer(n) | Op::LoadTimerBcd(n), BitTest::Timer(of))
            | (Op::LoadCounter(n) | Op::LoadCounterBcd(n), BitTest::Counter(of)) => n == of,
            _ => false,
        };
        self.is_poisoned |= self.stirred.iter().any(number);
        self.is_poisoned |= flips.iter().any(|flip| matches!(flip, Flip::Everywhere(test) if number(test)));
        let before = self.recorded_status(at);
        let after = self.pass.lines.get(at).map_or(0, |line| line.status);
        if matches!(op, Op::Compare(..) | Op::TransferStatus | Op::Loop(_) | Op::JumpList { .. })
            || (before ^ after) & FC != 0
        {
            self.is_lost |= self.is_poisoned && matches!(op, Op::Loop(_) | Op::JumpList { .. });
            self.take_recorded(at);
        }
    }

    fn scanned(&self, at: usize, test: &BitTest, flips: &[Flip]) -> Bit {
        let recorded = self.pass.bit(at);
        let here = flips.contains(&Flip::Here(at));
        if here {
            return Some(!recorded);
        }
        match test {
            BitTest::Bit(place) => {
                if let Some((_, value)) = self.written.iter().rev().find(|(of, _)| of == place) {
                    return *value;
                }
                let indirect = !is_plain(*place) && (self.is_poisoned || !flips.is_empty());
                let other = self.other_data.iter().any(|of| may_touch(*of, Width::Bit, *place));
                if self.is_wild || indirect || other || self.is_disturbed(test) {
                    return None;
                }
            }
            BitTest::Timer(_) | BitTest::Counter(_) => {
                if self.stirred.contains(test) || self.is_disturbed(test) {
                    return None;
                }
            }
            BitTest::Status(StatusBit::BinaryResult) if self.other_br || self.is_poisoned => return None,
            BitTest::Status(_) if self.is_poisoned => return None,
            BitTest::Status(_) => {}
        }
        Some(recorded != flips.contains(&Flip::Everywhere(*test)))
    }

    fn is_disturbed(&self, test: &BitTest) -> bool {
        self.calls.iter().any(|call| (self.pass.disturbs)(call, test))
    }

    fn scan(&mut self, logic: Logic, bit: Bit) {
        let so_far = and(self.fc, self.rlo);
        match logic {
            Logic::And => self.rlo = or(and(or(not(self.fc), self.rlo), bit), self.or),
            Logic::Or => (self.rlo, self.or) = (or(so_far, bit), Some(false)),
            Logic::Xor => (self.rlo, self.or) = (xor(so_far, bit), Some(false)),
        }
        self.fc = Some(true);
    }

    fn close(&mut self) {
        let Some(Nested { rlo, or: saved_or, negate, logic }) = self.nest.pop() else { return };
        let inner = if negate { not(self.rlo) } else { self.rlo };
        self.or = saved_or;
        match logic {
            Logic::And => self.rlo = or(and(rlo, inner), saved_or),
            Logic::Or => (self.rlo, self.or) = (or(rlo, inner), Some(false)),
            Logic::Xor => (self.rlo, self.or) = (xor(rlo, inner), Some(false)),
        }
        self.fc = Some(true);
    }

    fn end_chain(&mut self) {
        (self.fc, self.or) = (Some(false), Some(false));
    }

    fn set(&mut self, at: usize, place: Place, value: bool) {
        let before = self.value(place);
        let after = match self.rlo {
            Some(true) => Some(value),
            Some(false) => before,
            None if before == Some(value) => Some(value),
            None => None,
        };
        // Nothing written is no news of a bit that only the record knows.
        if self.rlo != Some(false) || self.written.iter().any(|(of, _)| *of == place) {
            self.write(at, place, after);
        } else if self.recorded_before(at) {
            self.write(at, place, None);
        }
        self.end_chain();
    }

    /// The value of a place now; none: not known, as nothing has written or told it.
    fn value(&self, place: Place) -> Bit {
        self.written.iter().rev().find(|(of, _)| *of == place).and_then(|(_, value)| *value)
    }

    /// FP and FN: the bit they keep is known as far as the record lets it be.
    fn edge(&mut self, at: usize, place: Place, rising: bool) {
        let (recorded_now, result) =
            (self.recorded_before(at), self.pass.lines.get(at).is_some_and(|l| l.status & RLO != 0));
        // With the RLO it had, the result tells what was kept.
        let told = if rising == recorded_now { Some(result != rising) } else { None };
        let kept = self.value(place).or(told);
        let now = self.rlo;
        self.rlo = match now {
            now if now == Some(recorded_now) && self.value(place).is_none() => Some(result),
            now if rising => and(now, not(kept)),
            now => and(not(now), kept),
        };
        self.write(at, place, now);
        self.fc = self.recorded_fc(at);
        self.or = Some(false);
    }

    fn write(&mut self, at: usize, place: Place, value: Bit) {
        let recorded = match self.pass.code.get(at).map(|stmt| &stmt.op) {
            Some(Op::Set(_)) if self.recorded_before(at) => Some(true),
            Some(Op::Reset(_)) if self.recorded_before(at) => Some(false),
            Some(Op::Set(_) | Op::Reset(_)) => None,
            _ => Some(self.recorded_before(at)),
        };
        let differs = value.is_none() || value != recorded;
        if differs && self.wanted.is_none_or(|(wanted, _)| wanted != place) {
            match place {
                Place::Fixed(area, _) if is_image(area) => {}
                Place::Param { .. } | Place::Memory(..) | Place::Register(..) => self.is_wild = true,
                Place::Fixed(..) | Place::InDb(..) | Place::InDi(..) | Place::Instance(_) => {
                    self.other_data.push(place);
                }
            }
        }
        self.written.retain(|(of, _)| *of != place);
        self.written.push((place, value));
    }

    /// What the record says of a place that was written: the value its last writer gave.
    fn record_of(&self, place: Place, before: usize) -> Bit {
        let writer = self.pass.last_writer(place, before)?;
        Some(match self.pass.code.get(writer).map(|stmt| &stmt.op) {
            Some(Op::Set(_)) => true,
            Some(Op::Reset(_)) => false,
            _ => self.recorded_before(writer),
        })
    }

    fn stir(&mut self, at: usize, test: BitTest) {
        if self.rlo != Some(self.recorded_before(at)) || self.is_poisoned {
            self.stirred.push(test);
        }
        self.end_chain();
    }

    fn jump(&mut self, at: usize, jump: Jump) {
        let by_rlo = matches!(jump, Jump::IfRlo | Jump::IfNotRlo | Jump::IfRloSaveBr | Jump::IfNotRloSaveBr);
        self.is_lost |= match jump {
            Jump::Always => false,
            _ if by_rlo => self.rlo != Some(self.recorded_before(at)),
            Jump::IfBr | Jump::IfNotBr => self.other_br || self.is_poisoned,
            _ => self.is_poisoned,
        };
        if by_rlo {
            self.rlo = Some(true);
            self.end_chain();
        } else if matches!(jump, Jump::IfBr | Jump::IfNotBr) {
            self.end_chain();
        }
    }

    /// RLO and /FC as the record has them behind a statement.
    fn take_recorded(&mut self, at: usize) {
        let status = self.pass.lines.get(at).map_or(0, |line| line.status);
        self.rlo = if self.is_poisoned { None } else { Some(status & RLO != 0) };
        self.fc = Some(status & FC != 0);
        self.or = Some(status & (1 << 3) != 0);
    }

    fn recorded_before(&self, at: usize) -> bool {
        self.pass.rlo_before(at)
    }

    fn recorded_fc(&self, at: usize) -> Bit {
        self.pass.lines.get(at).map(|line| line.status & FC != 0)
    }

    /// The status word in front of a statement.
    fn recorded_status(&self, at: usize) -> u16 {
        let before = (0..at).rev().find(|before| self.pass.ran(*before));
        before.and_then(|before| self.pass.lines.get(before)).map_or(0, |line| line.status)
    }
}

/// Whether a place of this width may hold a bit.
fn may_touch(place: Place, width: Width, bit: Place) -> bool {
    match (place, bit) {
        (Place::Fixed(a, at), Place::Fixed(b, of)) if a == b => of.0 >= at.0 && of.0 < at.0 + u32::from(width.bits()),
        (Place::Fixed(a, _), Place::Fixed(b, _)) if is_image(a) && is_image(b) => false,
        (Place::InDb(db, at), Place::InDb(other, of)) => {
            db == other && of.0 >= at.0 && of.0 < at.0 + u32::from(width.bits())
        }
        (Place::Instance(at), Place::Instance(of)) => of.0 >= at.0 && of.0 < at.0 + u32::from(width.bits()),
        (Place::Fixed(area, _), Place::InDb(..) | Place::Instance(_))
        | (Place::InDb(..) | Place::Instance(_), Place::Fixed(area, _))
            if is_image(area) =>
        {
            false
        }
        _ => true,
    }
}

const fn is_image(area: Area) -> bool {
    matches!(area, Area::Input | Area::Output | Area::Memory | Area::Local)
}
