//! What an operation reads and writes, and the numbers it names.

use ob1_model::{Area, BitAddr, Width};

use crate::call::{Arg, Target};
use crate::op::{BitTest, Op};
use crate::place::{Number, Operand, Place};

/// The number in an operation, shared or exclusive as the operation is.
macro_rules! number_in {
    ($op:expr) => {
        match $op {
            Op::Scan { test: BitTest::Timer(n) | BitTest::Counter(n), .. }
            | Op::LoadTimer(n)
            | Op::LoadTimerBcd(n)
            | Op::LoadCounter(n)
            | Op::LoadCounterBcd(n)
            | Op::OpenDb(_, n)
            | Op::StartTimer(_, n)
            | Op::ResetTimer(n)
            | Op::EnableTimer(n)
            | Op::CountUp(n)
            | Op::CountDown(n)
            | Op::SetCounter(n)
            | Op::ResetCounter(n)
            | Op::EnableCounter(n) => Some(n),
            _ => None,
        }
    };
}

/// The place an operation other than a call reads or writes, shared or exclusive as the operation is, with the width
/// of the access.
macro_rules! place_in {
    ($op:expr $(, $exclusive:tt)?) => {
        match $op {
            Op::Scan { test: BitTest::Bit(place), .. }
            | Op::Assign(place)
            | Op::Set(place)
            | Op::Reset(place)
            | Op::EdgePositive(place)
            | Op::EdgeNegative(place) => Some((place, Width::Bit)),
            Op::Load(operand) | Op::Transfer(operand) | Op::LoadArFrom(_, operand) | Op::TransferArTo(_, operand) => {
                Some((&$($exclusive)? operand.place, operand.width))
            }
            _ => None,
        }
    };
}

/// What has a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Numbered {
    /// `T 5`.
    Timer,
    /// `Z 5`.
    Counter,
    /// `DB 10`.
    DataBlock,
}

impl Op {
    /// The operand that an operation other than a call reads or writes.
    #[must_use]
    pub const fn operand(&self) -> Option<Operand> {
        match place_in!(self) {
            Some((place, width)) => Some(Operand { width, place: *place }),
            None => None,
        }
    }

    /// The place of that operand, to be exchanged.
    pub const fn place_mut(&mut self) -> Option<&mut Place> {
        match place_in!(self, mut) {
            Some((place, _)) => Some(place),
            None => None,
        }
    }

    /// True when the operation writes its [`Op::operand`]; edges read and write it.
    #[must_use]
    pub const fn writes(&self) -> bool {
        matches!(
            self,
            Op::Assign(_)
                | Op::Set(_)
                | Op::Reset(_)
                | Op::EdgePositive(_)
                | Op::EdgeNegative(_)
                | Op::Transfer(_)
                | Op::TransferArTo(..)
        )
    }

    /// True for `L` and `LC`: a new value comes into ACCU1, the old one into ACCU2.
    #[must_use]
    pub const fn loads(&self) -> bool {
        matches!(
            self,
            Op::Load(_)
                | Op::LoadConst(_)
                | Op::LoadParamPointer { .. }
                | Op::LoadParamCopy { .. }
                | Op::LoadStatus
                | Op::LoadTimer(_)
                | Op::LoadTimerBcd(_)
                | Op::LoadCounter(_)
                | Op::LoadCounterBcd(_)
                | Op::LoadDbLength(_)
                | Op::LoadDbNumber(_)
        )
    }

    /// Shows `see` every place this operation reads or writes, those of pointers and numbers in memory included, with
    /// the width of the access.
    pub fn places(&self, see: &mut dyn FnMut(Place, Width)) {
        let place = |p: Place, width: Width, see: &mut dyn FnMut(Place, Width)| {
            if let Place::Memory(_, pointer) = p {
                see(Place::Fixed(pointer.area, pointer.at), Width::DWord);
            }
            see(p, width);
        };
        if let Some(operand) = self.operand() {
            place(operand.place, operand.width, see);
        }
        match self {
            Op::Call(call) => {
                for arg in &call.args {
                    if let Arg::Operand(o) = arg {
                        place(o.place, o.width, see);
                    }
                }
            }
            Op::LoadParamPointer { index, at } => {
                see(Place::Param { index: *index, at: BitAddr(0) }, Width::Byte);
                if let Some(at) = at {
                    see(Place::Fixed(Area::Local, *at), Width::Word);
                    see(Place::Fixed(Area::Local, BitAddr(at.0 + 16)), Width::DWord);
                }
            }
            Op::LoadParamCopy { index, bytes, at } => {
                see(Place::Param { index: *index, at: BitAddr(0) }, Width::Byte);
                see(Place::Fixed(Area::Local, *at), Width::Word);
                see(Place::Fixed(Area::Local, BitAddr(at.0 + u32::from(*bytes).saturating_sub(4) * 8)), Width::DWord);
            }
            _ => {}
        }
        self.numbers(&mut |number| match number {
            Number::Memory(pointer) => see(Place::Fixed(pointer.area, pointer.at), Width::Word),
            Number::Instance(at) => see(Place::Instance(*at), Width::Word),
            Number::Fixed(_) | Number::Param(_) => {}
        });
    }

    /// The number of the timer, counter or data block that an operation other than a call names.
    #[must_use]
    pub const fn number(&self) -> Option<&Number> {
        number_in!(self)
    }

    /// The same number, to be exchanged.
    pub const fn number_mut(&mut self) -> Option<&mut Number> {
        number_in!(self)
    }

    /// What [`Op::number`] is the number of.
    #[must_use]
    pub const fn numbered(&self) -> Option<Numbered> {
        Some(match self {
            Op::Scan { test: BitTest::Timer(_), .. }
            | Op::LoadTimer(_)
            | Op::LoadTimerBcd(_)
            | Op::StartTimer(..)
            | Op::ResetTimer(_)
            | Op::EnableTimer(_) => Numbered::Timer,
            Op::Scan { test: BitTest::Counter(_), .. }
            | Op::LoadCounter(_)
            | Op::LoadCounterBcd(_)
            | Op::CountUp(_)
            | Op::CountDown(_)
            | Op::SetCounter(_)
            | Op::ResetCounter(_)
            | Op::EnableCounter(_) => Numbered::Counter,
            Op::OpenDb(..) => Numbered::DataBlock,
            _ => return None,
        })
    }

    /// Shows `see` the number of every timer, counter and block this operation names.
    pub fn numbers(&self, see: &mut dyn FnMut(&Number)) {
        let Op::Call(call) = self else { return self.number().into_iter().for_each(see) };
        if let Target::Indirect(_, n) = &call.target {
            see(n);
        }
        if let Some(n) = &call.instance {
            see(n);
        }
        for arg in &call.args {
            if let Arg::Number(n) = arg {
                see(n);
            }
        }
    }
}
