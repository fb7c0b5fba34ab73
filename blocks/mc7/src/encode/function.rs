//! The frame of a `CALL` of a function or system function.

use ob1_ir::{AddressRegister, Arg, Call, DbRegister, Number, Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr, BlockId, DataType, Param, Section};

use super::frame::behind;
use super::parameter::local;
use super::{Encoder, operand};
use crate::block::list_order;
use crate::fold::Frame;
use crate::statement::{Mc7Op, Uncond};

/// A result that is copied out after the call.
struct Result {
    from: Operand,
    to: Operand,
}

/// What the frame has used so far.
struct Used {
    /// The byte of bits, and how many are used.
    bits: (u32, u8),
    /// Where AR2 is kept.
    ar2: Option<Operand>,
    results: Vec<Result>,
}

/// The pointer to a place.
fn pointer(area: Area, at: BitAddr) -> Option<u32> {
    (at.byte() <= BitAddr::MAX_BYTE).then(|| u32::from(area.pointer_code()) << 24 | at.0)
}

impl Encoder<'_, '_> {
    pub(super) fn function_call(&mut self, id: BlockId, call: &Call) -> Option<()> {
        let callee = (self.callees)(id)?;
        let close = self.open(Frame::Function, id.kind)? + 1;
        let bits = (self.end_logic(), 1);
        let ar2 = self.block.id.kind.has_instance().then(|| local(Width::DWord, self.take(4)));
        if let Some(ar2) = ar2 {
            self.plain(Op::TransferArTo(AddressRegister::Ar2, ar2));
        }
        let mut used = Used { bits, ar2, results: Vec::new() };
        let formals: Vec<&Param> = callee.formals().collect();
        let mut list = Vec::with_capacity(formals.len());
        for index in list_order(callee) {
            let (formal, arg) = (formals.get(usize::from(index))?, call.args.get(usize::from(index))?);
            list.push(self.actual(formal, arg, &mut used)?);
        }
        if list.len() != call.args.len() || call.instance.is_some() {
            return None;
        }
        let number = Number::Fixed(id.number);
        self.put(Mc7Op::Call(Uncond { kind: id.kind, number, conditional: false, list: Some(list) }));
        if let Some(ar2) = ar2 {
            self.plain(Op::LoadArFrom(AddressRegister::Ar2, ar2));
        }
        for Result { from, to } in used.results {
            self.load(from);
            let to = self.reach(to)?;
            self.store(to);
        }
        self.put(Mc7Op::Build(close));
        Some(())
    }

    /// An operand as the machine reaches it; opens its data block first.
    fn reach(&mut self, operand: Operand) -> Option<Operand> {
        let place = match operand.place {
            Place::InDb(db, at) => {
                self.plain(Op::OpenDb(DbRegister::Db, Number::Fixed(db)));
                Place::Fixed(Area::Db, at)
            }
            Place::Instance(at) if self.written.multi_instance => self.own(at)?,
            Place::Param { index, at: BitAddr(0) } => Place::Param { index: self.place(index)?, at: BitAddr(0) },
            Place::Fixed(Area::Local, _) => operand.place,
            _ => return None,
        };
        Some(Operand { place, ..operand })
    }

    /// The pointer in the list for an actual; what it needs before the call is put there.
    fn actual(&mut self, formal: &Param, arg: &Arg, used: &mut Used) -> Option<u32> {
        match arg {
            Arg::Number(Number::Fixed(n)) if formal.ty.is_parameter_type() => Some(u32::from(*n) << 16),
            Arg::Const(value) => {
                let width = Width::of(&formal.ty)?;
                let at = self.copy(width, used);
                self.load_const(width, *value)?;
                self.store(at);
                self.caller(at)
            }
            Arg::Bytes(bytes) if matches!(formal.ty, DataType::Any | DataType::Pointer) => {
                let at = self.take(bytes.len() as u32);
                self.pointer_bytes(bytes, &behind(|at| Place::Fixed(Area::Local, at), BitAddr::byte_addr(at)))?;
                pointer(Area::PreviousLocal, BitAddr::byte_addr(at))
            }
            Arg::Operand(from) if formal.ty.is_composed() => self.composed(formal, *from, used),
            Arg::Operand(from) => self.elementary(formal, *from, used),
            _ => None,
        }
    }

    /// The pointer to a place in the caller's local data.
    fn caller(&self, at: Operand) -> Option<u32> {
        match at.place {
            Place::Fixed(Area::Local, at) => pointer(Area::PreviousLocal, at),
            _ => None,
        }
    }

    /// Room for a copy: bits side by side.
    fn copy(&mut self, width: Width, used: &mut Used) -> Operand {
        if width != Width::Bit {
            return local(width, self.take(width.bytes()));
        }
        if used.bits.1 == 8 {
            used.bits = (self.take(1), 0);
        }
        let at = BitAddr::new(used.bits.0, used.bits.1);
        used.bits.1 += 1;
        operand(width, Place::Fixed(Area::Local, at))
    }

    fn elementary(&mut self, formal: &Param, from: Operand, used: &mut Used) -> Option<u32> {
        if Width::of(&formal.ty)? != from.width {
            return None;
        }
        match from.place {
            Place::Fixed(Area::Local, at) => pointer(Area::PreviousLocal, at),
            Place::Fixed(Area::Peripheral, _) if from.width == Width::Bit => None,
            Place::Fixed(Area::PreviousLocal, _) => None,
            Place::Fixed(area, at) => pointer(area, at),
            Place::InDb(..) | Place::Instance(_) | Place::Param { .. } => {
                let at = self.copy(from.width, used);
                if matches!(formal.section, Section::Input | Section::InOut) {
                    let there = self.reach(from)?;
                    self.load(there);
                    self.store(at);
                }
                if formal.section != Section::Input {
                    used.results.push(Result { from: at, to: from });
                }
                self.caller(at)
            }
            _ => None,
        }
    }

    /// A composed actual: its POINTER is put into the local data, an own ANY or POINTER is handed over as it is.
    fn composed(&mut self, formal: &Param, from: Operand, used: &Used) -> Option<u32> {
        let own = matches!(formal.ty, DataType::Any | DataType::Pointer);
        let (db, bits) = match from.place {
            Place::Fixed(Area::Local, at) if own => return pointer(Area::PreviousLocal, at),
            _ if own => return None,
            Place::InDb(db, at) => (db, pointer(Area::Db, at)?),
            Place::Fixed(Area::Local, at) => (0, pointer(Area::PreviousLocal, at)?),
            Place::Fixed(area @ (Area::Input | Area::Output | Area::Memory), at) => (0, pointer(area, at)?),
            Place::Instance(at) => return self.of_instance(formal, at, used),
            _ => return None,
        };
        let at = self.take(6);
        let bytes = [&db.to_be_bytes()[..], &bits.to_be_bytes()].concat();
        self.pointer_bytes(&bytes, &behind(|at| Place::Fixed(Area::Local, at), BitAddr::byte_addr(at)))?;
        pointer(Area::PreviousLocal, BitAddr::byte_addr(at))
    }

    /// The POINTER to a variable of the own instance: data block and AR2 as they are.
    fn of_instance(&mut self, formal: &Param, offset: BitAddr, used: &Used) -> Option<u32> {
        let (param, into) = self.block.interface.in_instance(offset)?;
        let ar2 = used.ar2.filter(|_| self.written.multi_instance && into == 0 && param.ty == formal.ty)?;
        let at = self.take(6);
        self.plain(Op::LoadDbNumber(DbRegister::Di));
        self.store(local(Width::Word, at));
        self.plain(Op::AddArConst(AddressRegister::Ar2, offset));
        self.plain(Op::TransferAr(AddressRegister::Ar2));
        self.plain(Op::LoadArFrom(AddressRegister::Ar2, ar2));
        self.store(local(Width::DWord, at + 2));
        pointer(Area::PreviousLocal, BitAddr::byte_addr(at))
    }
}
