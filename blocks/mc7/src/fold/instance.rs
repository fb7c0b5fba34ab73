//! `CALL` of a function block with its data block, or of a multi-instance: actuals are copied into the instance before
//! the call and out of it after.

use ob1_ir::{AddressRegister, Arg, Call, CallMode, DbRegister, Number, Op, Operand, Place, Pointer, Target, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Param};

use super::caller::Caller;
use super::values::{Copies, Cursor, Given, Put, Source, Taken, bytes, fits, formal_width, given, taken_by};
use crate::block::Callees;
use crate::parts;
use crate::statement::{Mc7Op, Uncond};

/// `P#DBX 0.0`, with which AR2 begins in an instance of its own.
pub(crate) const INSTANCE_START: u32 = 0x8400_0000;

/// What is known while the frame is read.
struct InstanceFrame<'f> {
    caller: &'f Caller<'f, 'f>,
    /// The data block that the frame opens as instance.
    instance: Number,
    /// Multi-instance: everything is addressed relative to AR2.
    multi: bool,
}

/// The call between the `BLD`.
pub(super) fn call(
    kind: BlockKind,
    multi: bool,
    ops: &[&Mc7Op],
    caller: &Caller<'_, '_>,
    callees: &Callees<'_>,
) -> Option<Call> {
    let mut cursor = Cursor::new(ops);
    let mut own = vec![cursor.save_rlo()?];
    let instance = if multi {
        cursor.eat(&Op::LoadDbNumber(DbRegister::Di))?;
        let at = parts::local_transfer(cursor.next()?, Width::Word)?;
        own.push(at);
        Some(Number::Memory(Pointer { area: Area::Local, at }))
    } else {
        None
    };
    cursor.eat(&Op::ExchangeDbs)?;
    let Mc7Op::Plain(Op::OpenDb(DbRegister::Di, number)) = cursor.next()? else { return None };
    let instance = match instance {
        Some(instance) => Some(instance).filter(|i| i == number)?,
        None => *number,
    };
    let saved = cursor.save_ar2()?;
    own.push(saved);
    let frame = InstanceFrame { caller, instance, multi };
    let puts = frame.inputs(&mut cursor)?;
    let start = match cursor.next()? {
        Mc7Op::Plain(Op::LoadArConst(AddressRegister::Ar2, INSTANCE_START)) if !multi => BitAddr(0),
        Mc7Op::Plain(Op::AddArConst(AddressRegister::Ar2, at)) if multi => *at,
        _ => return None,
    };
    let Mc7Op::Call(Uncond { kind: called, number: Number::Fixed(number), conditional: false, list: None }) =
        cursor.next()?
    else {
        return None;
    };
    // After the call AR2 may be put back by a negative offset instead of from what was saved.
    let back = BitAddr((0x1_0000 - start.0) & 0xFFFF);
    if cursor.restore_ar2(saved).is_none() {
        cursor.eat(&Op::AddArConst(AddressRegister::Ar2, back)).filter(|()| multi)?;
    }
    let taken = frame.outputs(&mut cursor)?;
    if *called != kind || own.iter().any(|at| at.byte() < caller.block.interface.declared_temps()) {
        return None;
    }
    let id = BlockId::new(kind, *number);
    let callee = callees(id)?;
    let mut copies = Copies { puts, taken, handed: Vec::new() };
    let mut args = Vec::new();
    for formal in callee.formals() {
        args.push(argument(formal, start, &mut copies, caller)?);
    }
    if !copies.all_used() {
        return None;
    }
    let (target, instance) = if multi {
        let inside = start.byte() + callee.instance_bytes <= caller.block.interface.instance_bytes;
        if start.bit() != 0 || !inside || !caller.block.multi_instance {
            return None;
        }
        (Target::Local(id, start), None)
    } else {
        let Number::Fixed(1..) = instance else { return None };
        (Target::Block(id), Some(instance))
    };
    Some(Call { mode: CallMode::Call, target, instance, args })
}

impl InstanceFrame<'_> {
    /// `AUF DI n` of another data block.
    fn foreign(&self, op: &Mc7Op) -> Option<u16> {
        match op {
            Mc7Op::Plain(Op::OpenDb(DbRegister::Di, Number::Fixed(n))) if *n > 0 => Some(*n),
            _ => None,
        }
    }

    fn reopen(&self, cursor: &mut Cursor<'_>) -> Option<()> {
        cursor.eat(&Op::OpenDb(DbRegister::Di, self.instance))
    }

    /// The address in the instance that an operand names.
    fn inside(&self, operand: Operand) -> Option<BitAddr> {
        match operand.place {
            Place::Fixed(Area::Di, at) if !self.multi => Some(at),
            Place::Register(Some(Area::Di), AddressRegister::Ar2, at) if self.multi => Some(at),
            _ => None,
        }
    }

    /// An operand of the caller, whose own instance is in the DB register here.
    fn outside(&self, operand: Operand, foreign: Option<u16>) -> Option<Operand> {
        let own = self.caller.block.multi_instance;
        let place = match (operand.place, foreign) {
            (Place::Fixed(Area::Di, at), Some(db)) => Place::InDb(db, at),
            (Place::Fixed(Area::Di | Area::Db, _), _) => return None,
            (Place::Register(Some(Area::Db), AddressRegister::Ar2, at), None) if own => Place::Instance(at),
            (place @ (Place::Fixed(..) | Place::Param { .. }), None) => place,
            _ => return None,
        };
        Some(Operand { place, ..operand })
    }

    /// What is put into the instance before the call.
    fn inputs(&self, cursor: &mut Cursor<'_>) -> Option<Vec<Put>> {
        let mut puts = Vec::new();
        loop {
            let first = cursor.peek()?;
            let foreign = self.foreign(first);
            if foreign.is_some() {
                cursor.next();
            }
            let Some(value) = cursor.peek().and_then(given) else {
                return foreign.is_none().then_some(puts);
            };
            cursor.next();
            let value = match value {
                Given::Wide(Source::From(operand), width) => {
                    Given::Wide(Source::From(self.outside(operand, foreign)?), width)
                }
                Given::Bit(Source::From(operand)) => Given::Bit(Source::From(self.outside(operand, foreign)?)),
                other => other,
            };
            if foreign.is_some() {
                self.reopen(cursor)?;
            }
            let to = taken_by(cursor.next()?)?;
            let at = self.inside(to)?;
            puts.push(Put { at, width: to.width, source: fits(value, to.width)?, used: false });
        }
    }

    /// What is taken out of it after.
    fn outputs(&self, cursor: &mut Cursor<'_>) -> Option<Vec<Taken>> {
        let mut taken = Vec::new();
        loop {
            let first = cursor.next()?;
            if *first == Mc7Op::Plain(Op::ExchangeDbs) {
                return cursor.peek().is_none().then_some(taken);
            }
            let (at, width) = match given(first)? {
                Given::Wide(Source::From(operand), _) | Given::Bit(Source::From(operand)) => {
                    (self.inside(operand)?, operand.width)
                }
                _ => return None,
            };
            let foreign = self.foreign(cursor.peek()?);
            if foreign.is_some() {
                cursor.next();
            }
            let to = taken_by(cursor.next()?)?;
            if foreign.is_some() {
                self.reopen(cursor)?;
            }
            if to.width != width {
                return None;
            }
            taken.push(Taken { at, width, to: self.outside(to, foreign)?.place, used: false });
        }
    }
}

/// The actual of one formal, which lies in the instance.
fn argument(formal: &Param, start: BitAddr, copies: &mut Copies, caller: &Caller<'_, '_>) -> Option<Arg> {
    let at = BitAddr(start.0 + formal.at.0);
    let Some(width) = formal_width(formal) else {
        let count = match formal.ty {
            DataType::Any => 10,
            DataType::Pointer => 6,
            _ if formal.is_pointer() => 6,
            _ => 0,
        };
        let puts = &mut copies.puts;
        let given = puts.iter().any(|p| (at.0..at.0 + count * 8).contains(&p.at.0));
        return if given { bytes(puts, at, count).map(|bytes| Arg::Bytes(bytes.into())) } else { Some(Arg::Open) };
    };
    caller.copied(formal, width, at, copies, Arg::Open)
}
