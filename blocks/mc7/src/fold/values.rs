//! Values on their way into and out of a frame.

use ob1_ir::compose::Handed;
use ob1_ir::{AddressRegister, BitTest, DbRegister, Logic, Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr, DataType, Layout, Param};

use crate::statement::Mc7Op;

/// Where a value comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Source {
    /// A constant; for a bit `SET` and `CLR`.
    Const(u32),
    /// An operand of the caller.
    From(Operand),
    /// `L DINO`: number of the instance data block.
    InstanceNumber,
    /// `TAR2` after `+AR2`: the pointer into the caller's instance.
    InstancePointer(BitAddr),
}

/// A value put down in the local data or the instance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Put {
    pub(super) at: BitAddr,
    pub(super) width: Width,
    pub(super) source: Source,
    pub(super) used: bool,
}

/// A value taken back after the call.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taken {
    pub(super) at: BitAddr,
    pub(super) width: Width,
    pub(super) to: Place,
    pub(super) used: bool,
}

/// What a frame copies before and after its call.
#[derive(Clone, Debug)]
pub(super) struct Copies {
    pub(super) puts: Vec<Put>,
    pub(super) taken: Vec<Taken>,
    /// POINTER and ANY to variables of the own instance, in the order of the list.
    pub(super) handed: Vec<Handed>,
}

impl Copies {
    /// True when every copy belongs to a formal.
    pub(super) fn all_used(&self) -> bool {
        self.puts.iter().all(|p| p.used) && self.taken.iter().all(|t| t.used)
    }
}

/// The statements of a frame, read from the front.
pub(super) struct Cursor<'o> {
    ops: &'o [&'o Mc7Op],
}

impl<'o> Cursor<'o> {
    pub(super) const fn new(ops: &'o [&'o Mc7Op]) -> Self {
        Self { ops }
    }

    pub(super) fn peek(&self) -> Option<&'o Mc7Op> {
        self.ops.first().copied()
    }

    pub(super) fn next(&mut self) -> Option<&'o Mc7Op> {
        let (first, rest) = self.ops.split_first()?;
        self.ops = rest;
        Some(first)
    }

    /// Takes the next statement when it is this one.
    pub(super) fn eat(&mut self, op: &Op) -> Option<()> {
        match self.peek()? {
            Mc7Op::Plain(next) if next == op => {
                self.next();
                Some(())
            }
            _ => None,
        }
    }

    /// Takes `TAR2 LD s` and gives `s`.
    pub(super) fn save_ar2(&mut self) -> Option<BitAddr> {
        let Mc7Op::Plain(Op::TransferArTo(AddressRegister::Ar2, Operand { place: Place::Fixed(Area::Local, at), .. })) =
            self.peek()?
        else {
            return None;
        };
        self.next();
        Some(*at)
    }

    /// Takes `LAR2 LD s`.
    pub(super) fn restore_ar2(&mut self, at: BitAddr) -> Option<()> {
        let operand = Operand { width: Width::DWord, place: Place::Fixed(Area::Local, at) };
        self.eat(&Op::LoadArFrom(AddressRegister::Ar2, operand))
    }

    /// Takes `= L t.0`, which ends the logic string, and gives the place.
    pub(super) fn save_rlo(&mut self) -> Option<BitAddr> {
        let Mc7Op::Plain(Op::Assign(Place::Fixed(Area::Local, at))) = self.peek()? else { return None };
        self.next();
        Some(*at)
    }
}

/// A statement that gives a value.
#[derive(Clone, Copy, Debug)]
pub(super) enum Given {
    /// `L` of a value of this width.
    Wide(Source, Width),
    /// `SET`, `CLR`, `U` something.
    Bit(Source),
}

/// The value a statement gives.
pub(super) fn given(op: &Mc7Op) -> Option<Given> {
    Some(match op {
        Mc7Op::Constant(_, value) => Given::Wide(Source::Const(*value), Width::DWord),
        Mc7Op::Plain(Op::Load(operand)) => Given::Wide(Source::From(*operand), operand.width),
        Mc7Op::Plain(Op::LoadDbNumber(DbRegister::Di)) => Given::Wide(Source::InstanceNumber, Width::Word),
        Mc7Op::Plain(Op::SetRlo) => Given::Bit(Source::Const(1)),
        Mc7Op::Plain(Op::ClearRlo) => Given::Bit(Source::Const(0)),
        Mc7Op::Plain(Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(place) }) => {
            Given::Bit(Source::From(Operand { width: Width::Bit, place: *place }))
        }
        _ => return None,
    })
}

/// The operand a statement puts a value into.
pub(super) const fn taken_by(op: &Mc7Op) -> Option<Operand> {
    match op {
        Mc7Op::Plain(Op::Transfer(operand)) => Some(*operand),
        Mc7Op::Plain(Op::Assign(place)) => Some(Operand { width: Width::Bit, place: *place }),
        _ => None,
    }
}

/// The value as an operation's operand takes it, when widths agree.
pub(super) fn fits(given: Given, to: Width) -> Option<Source> {
    match given {
        Given::Bit(source) if to == Width::Bit => Some(source),
        Given::Wide(source @ Source::Const(value), _) if to != Width::Bit => {
            // A constant wider than its place would be cut.
            let bits = u32::from(to.bits());
            (bits == 32 || value >> bits == 0 || bits < 16 && value >> 16 == 0).then_some(match source {
                Source::Const(v) if bits < 32 => Source::Const(v & ((1 << bits) - 1)),
                other => other,
            })
        }
        Given::Wide(source, width) if to == width => Some(source),
        _ => None,
    }
}

/// Takes the constants that fill so many bytes from `at` on; `None` where they do not.
pub(super) fn bytes(puts: &mut [Put], at: BitAddr, count: u32) -> Option<Vec<u8>> {
    let mut out = vec![None; count as usize];
    for put in puts.iter_mut() {
        let Source::Const(value) = put.source else { continue };
        let Some(offset) = put.at.0.checked_sub(at.0).filter(|o| *o < count * 8 && o % 8 == 0) else { continue };
        let length = put.width.bytes();
        if put.width == Width::Bit || offset / 8 + length > count {
            return None;
        }
        for (slot, byte) in (offset / 8..).zip(value.to_be_bytes().iter().skip(4 - length as usize)) {
            *out.get_mut(slot as usize)? = Some(*byte);
        }
        put.used = true;
    }
    out.into_iter().collect()
}

/// The operand that the six bytes of a POINTER name; it has the width of a byte, as all of composed types.
pub(super) fn pointed(bytes: &[u8]) -> Option<Operand> {
    let [d0, d1, area, high, middle, low] = *<&[u8; 6]>::try_from(bytes).ok()?;
    let db = u16::from_be_bytes([d0, d1]);
    let at = BitAddr(u32::from_be_bytes([0, high, middle, low]));
    let place = match (Area::from_pointer_code(area)?, db) {
        (Area::Db, db) if db > 0 => Place::InDb(db, at),
        (Area::PreviousLocal, 0) => Place::Fixed(Area::Local, at),
        (Area::Input | Area::Output | Area::Memory, 0) => Place::Fixed(Area::from_pointer_code(area)?, at),
        _ => return None,
    };
    // What is composed begins at a whole byte.
    (at.byte() <= BitAddr::MAX_BYTE && at.bit() == 0).then_some(Operand { width: Width::Byte, place })
}

/// Bytes of a composed actual as a call hands it over: of a POINTER, unless it is an ANY.
pub(super) const fn handed_bytes(ty: &DataType) -> u32 {
    if matches!(ty, DataType::Any) { 10 } else { 6 }
}

/// Bits of an elementary or number formal.
pub(super) fn formal_width(formal: &Param) -> Option<Width> {
    if formal.ty.is_parameter_type() { Some(Width::Word) } else { Width::of(&formal.ty) }
}

/// True when a type is so long that a place of the local data could hold it.
pub(super) fn local_holds(ty: &DataType, at: BitAddr) -> bool {
    at.byte() + Layout::bits(ty).div_ceil(8) <= BitAddr::MAX_BYTE + 1
}
