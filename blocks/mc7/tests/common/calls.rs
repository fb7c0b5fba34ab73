//! Calls of every kind with actual parameters of every kind.

use ob1_ir::{Arg, Call, CallMode, Number, Op, Operand, Place, Target, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Param, Section};

use super::{FB, FC, FC_NONE, Made, SFB, SFC};

impl Made<'_> {
    pub(super) fn call(&mut self) -> Op {
        let id = self.bytes.of(&[FC, FC, FC_NONE, SFC, FB, FB, SFB]);
        let call = match self.bytes.byte() % 4 {
            0 => self.uncond(id),
            1 if id.kind.has_instance() && self.id.kind == BlockKind::Fb => {
                let name = if id == FB { "pump" } else { "delay" };
                let at = self.interface.find(name).map_or(BitAddr(0), |p| p.at);
                let args = self.actuals(id);
                Call { mode: CallMode::Call, target: Target::Local(id, at), instance: None, args }
            }
            _ => {
                let instance = id.kind.has_instance().then(|| Number::Fixed(1 + self.bytes.word() % 400));
                // Each data block is the instance of one function block.
                let instance = instance.map(|n| match n {
                    Number::Fixed(n) => Number::Fixed(n * 2 + u16::from(id == SFB)),
                    other => other,
                });
                let args = self.actuals(id);
                Call { mode: CallMode::Call, target: Target::Block(id), instance, args }
            }
        };
        Op::Call(Box::new(call))
    }

    /// `UC` and `CC`, direct and indirect, with the list of pointers as it comes.
    fn uncond(&mut self, id: BlockId) -> Call {
        let mode = self.bytes.of(&[CallMode::Unconditional, CallMode::Conditional]);
        let fc = self.interface.formals().position(|p| p.ty == DataType::BlockFc);
        let indirect = matches!(id.kind, BlockKind::Fc | BlockKind::Fb) && self.bytes.flag();
        let target = match (indirect, fc) {
            (false, _) => Target::Block(id),
            (true, Some(index)) if id.kind == BlockKind::Fc && mode == CallMode::Unconditional => {
                Target::Indirect(id.kind, Number::Param(index as u16))
            }
            (true, _) => Target::Indirect(id.kind, Number::Memory(self.pointer())),
        };
        let pointers = if id.kind.has_instance() { 0 } else { self.bytes.byte() % 5 };
        let args = (0..pointers).map(|_| Arg::Raw(self.raw_pointer())).collect();
        Call { mode, target, instance: None, args }
    }

    /// Any pointer. One into the local data says how much of it the block has, and that is 64 KiB at most.
    fn raw_pointer(&mut self) -> u32 {
        let bits = self.bytes.double();
        let is_local = Area::from_pointer_code((bits >> 24) as u8) == Some(Area::PreviousLocal);
        if is_local { bits & 0xFF03_FFFF } else { bits }
    }

    fn actuals(&mut self, id: BlockId) -> Vec<Arg> {
        let formals: Vec<Param> =
            self.callees.get(&id).map(|i: &Interface| i.formals().cloned().collect()).unwrap_or_default();
        formals.iter().map(|formal| self.actual(formal, id.kind.has_instance())).collect()
    }

    fn actual(&mut self, formal: &Param, instance: bool) -> Arg {
        if instance && self.bytes.flag() {
            return Arg::Open;
        }
        if formal.ty.is_parameter_type() {
            return Arg::Number(Number::Fixed(1 + u16::from(self.bytes.byte())));
        }
        let Some(width) = Width::of(&formal.ty) else { return self.composed(formal, instance) };
        if formal.section == Section::Input && self.bytes.flag() {
            let value = self.bytes.double();
            return Arg::Const(match (&formal.ty, width) {
                // Not a number has no constant.
                (DataType::Real, _) => f32::from(value as i16).to_bits(),
                (DataType::TimeOfDay, _) => value % 86_400_000,
                (_, Width::Bit) => value & 1,
                (_, Width::Byte) => value & 0xFF,
                (_, Width::Word) => value & 0xFFFF,
                _ => value,
            });
        }
        let place = match self.bytes.byte() % 6 {
            0 => match self.fixed(Area::Db, width) {
                Place::Fixed(_, at) => Some(Place::InDb(1 + self.bytes.word() % 300, at)),
                _ => None,
            },
            1 => self.variable(width).filter(|p| !matches!(p, Place::Param { index, .. } if self.is_composed(*index))),
            2 if width != Width::Bit => {
                Some(self.fixed(Area::Peripheral, width)).filter(|_| !instance || formal.section == Section::Input)
            }
            3 if !instance => {
                let area = self.bytes.of(&[Area::Db, Area::Di]);
                Some(self.fixed(area, width))
            }
            _ => None,
        };
        let area = self.bytes.of(&[Area::Input, Area::Output, Area::Memory, Area::Local]);
        let place = place.unwrap_or_else(|| self.fixed(area, width));
        Arg::Operand(Operand { width, place })
    }

    fn is_composed(&self, index: u16) -> bool {
        self.interface.formals().nth(usize::from(index)).is_some_and(|p| p.ty.is_composed())
    }

    fn composed(&mut self, formal: &Param, instance: bool) -> Arg {
        let db = 1 + self.bytes.word() % 300;
        let at = BitAddr::new(u32::from(self.bytes.byte()), 0);
        let (code, db) = self.bytes.of(&[(0x84u8, db), (0x83, 0), (0x87, 0), (0x81, 0)]);
        let pointer = [&db.to_be_bytes()[..], &(u32::from(code) << 24 | at.0).to_be_bytes()].concat();
        match formal.ty {
            DataType::Any if !instance && self.bytes.flag() => self.temp("any", Width::Byte),
            DataType::Any => {
                let ty = self.bytes.of(&[1u8, 2, 4, 5, 6, 7, 8, 0x0B, 0x13]);
                let count = self.bytes.word().to_be_bytes();
                Arg::Bytes([&[0x10, ty][..], &count, &pointer].concat().into())
            }
            DataType::Pointer => Arg::Bytes(pointer.into()),
            _ if instance && formal.is_pointer() => Arg::Bytes(pointer.into()),
            _ if instance => Arg::Open,
            DataType::Struct(_) if self.bytes.flag() => self.temp("s", Width::Byte),
            DataType::Struct(_) if self.id.kind == BlockKind::Fb && self.bytes.flag() => {
                let at = self.interface.find("kept").map_or(BitAddr(0), |p| p.at);
                Arg::Operand(Operand { width: Width::Byte, place: Place::Instance(at) })
            }
            _ => {
                let place = match code {
                    0x84 => Place::InDb(db, at),
                    0x83 => Place::Fixed(Area::Memory, at),
                    0x81 => Place::Fixed(Area::Input, at),
                    _ => Place::Fixed(Area::Local, at),
                };
                Arg::Operand(Operand { width: Width::Byte, place })
            }
        }
    }

    fn temp(&self, name: &str, width: Width) -> Arg {
        let at = self.interface.find(name).map_or(BitAddr(0), |p| p.at);
        Arg::Operand(Operand { width, place: Place::Fixed(Area::Local, at) })
    }
}
