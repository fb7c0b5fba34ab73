//! Assignments: elementary values, texts, whole structures and arrays.

use ob1_ir::{
    AddressRegister, Arg, Call as IrCall, CallMode, Compare, Jump, NumberFormat, Op, Operand, Place, Target, Width,
};
use ob1_model::{Area, BitAddr, DataType, Layout};

use crate::code::Code;
use crate::tree::{Base, Kind, Side, Typed, Var};

/// Bytes up to which a structure is moved by single statements.
const SHORT: u32 = 128;

impl Code {
    /// `target := value`.
    pub(crate) fn assign(&mut self, target: &Var<'_>, ty: &DataType, value: &Typed<'_>) {
        match ty {
            DataType::Bool => self.assign_bit(target, value),
            DataType::String(max) => self.assign_text(target, *max, value),
            _ if ty.is_composed() => self.assign_composed(target, ty, value),
            _ => self.assign_value(target, ty, value),
        }
    }

    fn assign_bit(&mut self, target: &Var<'_>, value: &Typed<'_>) {
        if target.is_direct() {
            self.bits(value);
            let place = self.place(target);
            self.op(Op::Assign(place));
            return;
        }
        let bit = self.kept_bit(value);
        let place = self.place(target);
        self.op(Op::Scan { logic: ob1_ir::Logic::And, negate: false, test: ob1_ir::BitTest::Bit(bit) });
        self.op(Op::Assign(place));
    }

    fn assign_value(&mut self, target: &Var<'_>, ty: &DataType, value: &Typed<'_>) {
        let width = Width::of(ty).unwrap_or(Width::Word);
        if target.is_direct() {
            self.value(value);
            let place = self.place(target);
            self.op(Op::Transfer(Operand { width, place }));
            return;
        }
        // A data block that is opened for the value would not be that of the target.
        let simple = match &value.kind {
            Kind::Constant(_) => true,
            Kind::Var(var) => value.is_leaf() && !matches!(var.base, Base::Db(_)),
            _ => false,
        };
        if simple {
            let place = self.place(target);
            self.value(value);
            self.op(Op::Transfer(Operand { width, place }));
            return;
        }
        self.value(value);
        let kept = self.temp(width);
        self.op(Op::Transfer(kept));
        let place = self.place(target);
        self.op(Op::Load(kept));
        self.op(Op::Transfer(Operand { width, place }));
    }

    /// A whole structure, array, DATE_AND_TIME, POINTER or ANY.
    fn assign_composed(&mut self, target: &Var<'_>, ty: &DataType, value: &Typed<'_>) {
        match &value.kind {
            Kind::Bytes(bytes) => {
                let place = self.place(target);
                self.write_bytes(place, 0, bytes);
            }
            Kind::Var(source) => self.copy(target, source, ty),
            Kind::Call(call) => {
                let direct = matches!(target.base, Base::Fixed(Area::Local)) && target.is_direct();
                let into = if direct { Some(self.place(target)) } else { None };
                match (into, self.call(call, into)) {
                    (Some(_), Some(_)) => {}
                    (None, Some(Place::Fixed(_, at))) => self.copy(target, &in_local(at), ty),
                    _ => self.lose(),
                }
            }
            _ => self.lose(),
        }
    }

    /// Bytes from one variable to another of the same type.
    pub(crate) fn copy(&mut self, target: &Var<'_>, source: &Var<'_>, ty: &DataType) {
        let bytes = Layout::bits(ty).div_ceil(8);
        let fixed = |var: &Var<'_>| var.is_direct() && !matches!(var.base, Base::Param(_));
        if bytes > SHORT
            && fixed(target)
            && fixed(source)
            && let Some(id) = self.move_block
        {
            return self.move_any(id, target, source, (2, bytes as u16));
        }
        if target.is_direct()
            || source.is_direct() && matches!(source.base, Base::Fixed(_) | Base::Instance | Base::Param(_))
        {
            // Only one of them needs AR1 or the DB register.
            let db = matches!(target.base, Base::Db(_)) && !source.is_direct();
            if !db {
                let (from, to) = (self.place(source), self.place(target));
                return self.move_words(from, to, bytes);
            }
        }
        let between = in_local(self.take(bytes));
        let from = self.place(source);
        let kept = Place::Fixed(Area::Local, between.at);
        self.move_words(from, kept, bytes);
        let to = self.place(target);
        self.move_words(kept, to, bytes);
    }

    fn move_words(&mut self, from: Place, to: Place, bytes: u32) {
        for (at, width) in pieces(bytes) {
            self.op(Op::Load(Operand { width, place: beyond(from, at) }));
            self.op(Op::Transfer(Operand { width, place: beyond(to, at) }));
        }
    }

    /// SFC 20 between variables of this type and count.
    fn move_any(&mut self, id: ob1_model::BlockId, target: &Var<'_>, source: &Var<'_>, any: (u8, u16)) {
        let from = self.any(source, Some(any));
        let to = self.any(target, Some(any));
        let result = self.temp(Width::Word);
        self.native(id, vec![from, Arg::Operand(result), to]);
    }

    /// Constant bytes into memory.
    pub(crate) fn write_bytes(&mut self, place: Place, from: u32, bytes: &[u8]) {
        for (at, width) in pieces(bytes.len() as u32) {
            let part = bytes.get(at as usize..(at + width.bytes()) as usize).unwrap_or_default();
            let value = part.iter().fold(0u32, |value, byte| value << 8 | u32::from(*byte));
            self.op(Op::LoadConst(value));
            self.op(Op::Transfer(Operand { width, place: beyond(place, from + at) }));
        }
    }

    /// These bytes into the local data from an even address: short ones by single statements, else zeros by a loop and
    /// what is not zero behind it.
    pub(crate) fn fill_local(&mut self, first: u32, image: &[u8]) {
        let here = Place::Fixed(Area::Local, BitAddr::byte_addr(first));
        if image.len() as u32 <= SHORT {
            return self.write_bytes(here, 0, image);
        }
        let words = image.len() as u32 / 4;
        let pointer = self.temp(Width::DWord);
        let again = self.label();
        self.op(Op::LoadConst(BitAddr::byte_addr(first).0));
        self.op(Op::Transfer(pointer));
        self.set(again);
        self.op(Op::LoadArFrom(AddressRegister::Ar1, pointer));
        self.op(Op::LoadConst(0));
        let place = Place::Register(Some(Area::Local), AddressRegister::Ar1, BitAddr(0));
        self.op(Op::Transfer(Operand { width: Width::DWord, place }));
        self.op(Op::Load(pointer));
        self.op(Op::AddConst { format: NumberFormat::DInt, value: 32 });
        self.op(Op::Transfer(pointer));
        self.op(Op::LoadConst(BitAddr::byte_addr(first + words * 4).0));
        self.op(Op::Compare(NumberFormat::DInt, Compare::Less));
        self.jump(Jump::IfRlo, again);
        for (at, part) in (0u32..).step_by(4).zip(image.chunks(4)) {
            if part.len() < 4 || part.iter().any(|byte| *byte != 0) {
                self.write_bytes(here, at, part);
            }
        }
    }

    /// A text: the target keeps its maximum length; what is longer is cut off.
    fn assign_text(&mut self, target: &Var<'_>, max: u8, value: &Typed<'_>) {
        let temporary = matches!(target.base, Base::Fixed(Area::Local)) && target.is_direct();
        match &value.kind {
            _ if *value.ty == DataType::Char => {
                self.value(value);
                let kept = self.temp(Width::Byte);
                self.op(Op::Transfer(kept));
                let place = self.place(target);
                self.write_bytes(place, 0, &[max, 1]);
                self.op(Op::Load(kept));
                self.op(Op::Transfer(Operand { width: Width::Byte, place: beyond(place, 2) }));
            }
            Kind::Bytes(bytes) => {
                let length = bytes.get(1).copied().unwrap_or(0).min(max);
                let text = bytes.get(2..2 + usize::from(length)).unwrap_or_default();
                let place = self.place(target);
                let head = [max, length];
                self.write_bytes(place, 0, &head);
                self.write_bytes(place, 2, text);
            }
            // Not into a component: that has the result cut by an assignment.
            Kind::Call(call) if temporary && target.declared.is_none_or(|at| self.texts.contains(&at)) => {
                let place = self.place(target);
                if self.call(call, Some(place)).is_none() {
                    self.lose();
                }
            }
            Kind::Call(call) => {
                let result = self.call(call, None);
                if temporary {
                    let place = self.place(target);
                    self.write_bytes(place, 0, &[max]);
                }
                match result {
                    Some(Place::Fixed(_, at)) => self.join(&in_local(at), target),
                    _ => self.lose(),
                }
            }
            Kind::Var(source) => {
                if temporary {
                    let place = self.place(target);
                    self.write_bytes(place, 0, &[max]);
                }
                self.join(source, target);
            }
            _ => self.lose(),
        }
    }

    /// A text in the local data, when it has no fixed address.
    pub(crate) fn text_copy(&mut self, source: &Var<'_>) -> Place {
        let at = self.take(256);
        let kept = Place::Fixed(Area::Local, at);
        self.write_bytes(kept, 0, &[254, 0]);
        self.join(source, &in_local(at));
        kept
    }

    /// `target := CONCAT(source, '')`, which cuts to the target's length and is safe for texts over each other. Without
    /// that function SFC 20 does it.
    fn join(&mut self, source: &Var<'_>, target: &Var<'_>) {
        let Some(id) = self.concat else {
            return match self.move_block {
                Some(id) => self.move_any(id, target, source, (0x13, 1)),
                None => {
                    self.lacks_texts = true;
                    self.lose();
                }
            };
        };
        let both = source.is_direct() || target.is_direct() && !matches!(target.base, Base::Db(_));
        let from = if both { self.place(source) } else { self.text_copy(source) };
        let to = self.place(target);
        let operand = |place| Arg::Operand(Operand { width: Width::Byte, place });
        let empty = Arg::Bytes(vec![1, 0, 0, 0].into());
        self.native(id, vec![operand(from), empty, operand(to)]);
    }

    /// A call of a function of the library with all its arguments.
    pub(crate) fn native(&mut self, id: ob1_model::BlockId, args: Vec<Arg>) {
        let call = IrCall { mode: CallMode::Call, target: Target::Block(id), instance: None, args };
        self.op(Op::Call(Box::new(call)));
    }
}

/// A variable in the local data.
pub(crate) const fn in_local<'w>(at: BitAddr) -> Var<'w> {
    Var { base: Base::Fixed(Area::Local), at, terms: Vec::new(), declared: None, side: Side::Both }
}

/// So many bytes behind a place.
pub(crate) const fn beyond(place: Place, bytes: u32) -> Place {
    match place {
        Place::Fixed(area, at) => Place::Fixed(area, BitAddr(at.0 + bytes * 8)),
        Place::InDb(db, at) => Place::InDb(db, BitAddr(at.0 + bytes * 8)),
        Place::InDi(db, at) => Place::InDi(db, BitAddr(at.0 + bytes * 8)),
        Place::Param { index, at } => Place::Param { index, at: BitAddr(at.0 + bytes * 8) },
        Place::Instance(at) => Place::Instance(BitAddr(at.0 + bytes * 8)),
        Place::Register(area, register, at) => Place::Register(area, register, BitAddr(at.0 + bytes * 8)),
        Place::Memory(..) => place,
    }
}

/// A length in double words, a word and a byte.
fn pieces(bytes: u32) -> Vec<(u32, Width)> {
    let mut out = Vec::new();
    let mut at = 0;
    while at < bytes {
        let width = match bytes - at {
            4.. => Width::DWord,
            2..=3 => Width::Word,
            _ => Width::Byte,
        };
        out.push((at, width));
        at += width.bytes();
    }
    out
}
