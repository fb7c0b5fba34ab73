//! The frame of a `CALL` of a function block with its data block, or of a multi-instance.

use ob1_ir::{AddressRegister, Arg, Call, DbRegister, Number, Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr, BlockId, DataType, Param, Section};

use super::frame::behind;
use super::parameter::{local, number_at};
use super::{Encoder, operand};
use crate::fold::{Frame, INSTANCE_START};
use crate::statement::{Mc7Op, Uncond};

/// The instance that is called.
#[derive(Clone, Copy)]
struct Instance {
    /// Opens its data block.
    number: Number,
    /// Where it begins, relative to AR2; `None` in a data block of its own.
    start: Option<BitAddr>,
}

impl Instance {
    /// An address in the instance.
    fn place(self, at: BitAddr) -> Place {
        match self.start {
            Some(start) => Place::Register(Some(Area::Di), AddressRegister::Ar2, BitAddr(start.0 + at.0)),
            None => Place::Fixed(Area::Di, at),
        }
    }
}

impl Encoder<'_, '_> {
    pub(super) fn instance_call(&mut self, id: BlockId, start: Option<BitAddr>, call: &Call) -> Option<()> {
        let callee = (self.callees)(id)?;
        let kind = if start.is_some() { Frame::Multi } else { Frame::DataBlock };
        if start.is_some() && !(self.written.multi_instance && self.block.id.kind.has_instance()) {
            return None;
        }
        let close = self.open(kind, id.kind)? + 1;
        self.end_logic();
        let number = match (start, call.instance) {
            (Some(_), None) => {
                let word = self.take(2);
                self.plain(Op::LoadDbNumber(DbRegister::Di));
                self.store(local(Width::Word, word));
                number_at(word)
            }
            (None, Some(number @ Number::Fixed(1..))) => number,
            _ => return None,
        };
        let instance = Instance { number, start };
        self.plain(Op::ExchangeDbs);
        self.plain(Op::OpenDb(DbRegister::Di, number));
        let ar2 = local(Width::DWord, self.take(4));
        self.plain(Op::TransferArTo(AddressRegister::Ar2, ar2));
        let formals: Vec<&Param> = callee.formals().collect();
        if formals.len() != call.args.len() {
            return None;
        }
        for (formal, arg) in formals.iter().zip(&call.args) {
            self.input(formal, arg, instance)?;
        }
        self.plain(match start {
            Some(start) => Op::AddArConst(AddressRegister::Ar2, start),
            None => Op::LoadArConst(AddressRegister::Ar2, INSTANCE_START),
        });
        let called = Uncond { kind: id.kind, number: Number::Fixed(id.number), conditional: false, list: None };
        self.put(Mc7Op::Call(called));
        self.plain(Op::LoadArFrom(AddressRegister::Ar2, ar2));
        for (formal, arg) in formals.iter().zip(&call.args) {
            self.output(formal, arg, instance)?;
        }
        self.plain(Op::ExchangeDbs);
        self.put(Mc7Op::Build(close));
        Some(())
    }

    /// Where an operand of the caller lies while the caller's instance is in the DB register, and the data block that
    /// has to be opened for it.
    fn outside(&self, from: Operand) -> Option<(Operand, Option<u16>)> {
        let (place, db) = match from.place {
            Place::InDb(db, at) => (Place::Fixed(Area::Di, at), Some(db)),
            Place::Instance(at) if self.written.multi_instance && self.block.id.kind.has_instance() => {
                (Place::Register(Some(Area::Db), AddressRegister::Ar2, at), None)
            }
            Place::Param { index, at: BitAddr(0) } => {
                (Place::Param { index: self.place(index)?, at: BitAddr(0) }, None)
            }
            Place::Fixed(Area::Db | Area::Di | Area::PreviousLocal, _) => return None,
            place @ Place::Fixed(..) => (place, None),
            _ => return None,
        };
        Some((Operand { place, ..from }, db))
    }

    /// An actual into the instance.
    fn input(&mut self, formal: &Param, arg: &Arg, instance: Instance) -> Option<()> {
        if matches!(formal.section, Section::Output | Section::Return) {
            // What is handed in there is lost.
            return matches!(arg, Arg::Open | Arg::Operand(_)).then_some(());
        }
        let to = |width| operand(width, instance.place(formal.at));
        match arg {
            Arg::Open => return Some(()),
            Arg::Const(value) => {
                let width = Width::of(&formal.ty)?;
                self.load_const(width, *value)?;
                self.store(to(width));
            }
            Arg::Number(Number::Fixed(n)) if formal.ty.is_parameter_type() => {
                self.load_const(Width::Word, u32::from(*n))?;
                self.store(to(Width::Word));
            }
            Arg::Number(Number::Instance(at)) if formal.ty.is_parameter_type() => {
                let (from, _) = self.outside(operand(Width::Word, Place::Instance(*at)))?;
                self.load(from);
                self.store(to(Width::Word));
            }
            Arg::Bytes(bytes) => {
                let wanted = match formal.ty {
                    DataType::Any => 10,
                    DataType::Pointer => 6,
                    _ if formal.is_pointer() => 6,
                    _ => return None,
                };
                if bytes.len() != wanted {
                    return None;
                }
                self.pointer_bytes(bytes, &behind(|at| instance.place(at), formal.at))?;
            }
            Arg::Operand(from) if Width::of(&formal.ty) == Some(from.width) && !formal.ty.is_parameter_type() => {
                let (there, db) = self.outside(*from)?;
                if let Some(db) = db {
                    self.plain(Op::OpenDb(DbRegister::Di, Number::Fixed(db)));
                }
                self.load(there);
                if db.is_some() {
                    self.plain(Op::OpenDb(DbRegister::Di, instance.number));
                }
                self.store(to(from.width));
            }
            _ => return None,
        }
        Some(())
    }

    /// A result out of the instance.
    fn output(&mut self, formal: &Param, arg: &Arg, instance: Instance) -> Option<()> {
        let Arg::Operand(to) = arg else { return Some(()) };
        if formal.section == Section::Input {
            return Some(());
        }
        if Width::of(&formal.ty) != Some(to.width) {
            return None;
        }
        let (there, db) = self.outside(*to)?;
        self.load(operand(to.width, instance.place(formal.at)));
        if let Some(db) = db {
            self.plain(Op::OpenDb(DbRegister::Di, Number::Fixed(db)));
        }
        self.store(there);
        if db.is_some() {
            self.plain(Op::OpenDb(DbRegister::Di, instance.number));
        }
        Some(())
    }
}
