//! `CALL` of a function or system function: pointers to the actuals follow the `UC`.

use ob1_ir::compose::{Handed, SHARED};
use ob1_ir::{AddressRegister, Arg, Call, CallMode, DbRegister, Number, Op, Operand, Place, Target, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Param};

use super::caller::Caller;
use super::values::{
    Copies, Cursor, Given, Put, Source, Taken, bytes, fits, formal_width, given, handed_bytes, local_holds, pointed,
    taken_by,
};
use crate::block::{Callees, list_order};
use crate::parts;
use crate::statement::{Mc7Op, Uncond};

/// The call between the `BLD`, behind what hands over pointers into the own instance.
pub(super) fn call(kind: BlockKind, ops: &[&Mc7Op], caller: &Caller<'_, '_>, callees: &Callees<'_>) -> Option<Vec<Op>> {
    let own = caller.block.interface.declared_temps();
    let mut cursor = Cursor::new(ops);
    let rlo = cursor.save_rlo()?;
    let saved = cursor.save_ar2();
    let puts = inputs(&mut cursor, caller, saved)?;
    let Mc7Op::Call(Uncond { kind: called, number: Number::Fixed(number), conditional: false, list: Some(list) }) =
        cursor.next()?
    else {
        return None;
    };
    if let Some(saved) = saved {
        cursor.restore_ar2(saved)?;
    }
    let taken = outputs(&mut cursor, caller)?;
    let mut places = puts.iter().map(|p| p.at).chain(saved).chain([rlo]);
    if *called != kind || places.any(|at| at.byte() < own) {
        return None;
    }
    let id = BlockId::new(kind, *number);
    let callee = callees(id)?;
    let order = list_order(callee);
    if order.len() != list.len() {
        return None;
    }
    let mut copies = Copies { puts, taken, handed: Vec::new() };
    let mut args: Vec<Option<Arg>> = vec![None; order.len()];
    let formals: Vec<&Param> = callee.formals().collect();
    for (formal, pointer) in order.iter().zip(list) {
        let arg = argument(formals.get(usize::from(*formal))?, *pointer, &mut copies, caller)?;
        *args.get_mut(usize::from(*formal))? = Some(arg);
    }
    let args = args.into_iter().collect::<Option<Vec<Arg>>>()?;
    let call = Call { mode: CallMode::Call, target: Target::Block(id), instance: None, args };
    let before = copies.handed.iter().flat_map(Handed::ops);
    copies.all_used().then(|| before.chain([Op::Call(Box::new(call))]).collect())
}

/// What a data block opened just before makes of an operand; own variables by AR2.
fn opened(operand: Operand, db: Option<u16>, caller: &Caller<'_, '_>) -> Option<Operand> {
    let place = match (operand.place, db) {
        (Place::Fixed(Area::Db, at), Some(db)) => Place::InDb(db, at),
        // DBX without a data block needs no copy; a copy of it means something else.
        (Place::Fixed(Area::Db, _), None) => return None,
        (Place::Register(Some(Area::Di), AddressRegister::Ar2, at), _) if caller.block.multi_instance => {
            Place::Instance(at)
        }
        (place @ (Place::Fixed(..) | Place::Param { .. }), _) => place,
        _ => return None,
    };
    Some(Operand { place, ..operand })
}

/// What is put into the local data before the call.
fn inputs(cursor: &mut Cursor<'_>, caller: &Caller<'_, '_>, saved: Option<BitAddr>) -> Option<Vec<Put>> {
    let mut puts = Vec::new();
    while !matches!(cursor.peek()?, Mc7Op::Call(_)) {
        if let Some(put) = instance_pointer(cursor, saved) {
            puts.push(put);
            continue;
        }
        let (first, db) = open(cursor)?;
        let value = match given(first)? {
            Given::Wide(Source::From(operand), width) => Given::Wide(Source::From(opened(operand, db, caller)?), width),
            Given::Bit(Source::From(operand)) => Given::Bit(Source::From(opened(operand, db, caller)?)),
            other => other,
        };
        let to = taken_by(cursor.next()?)?;
        let Place::Fixed(Area::Local, at) = to.place else { return None };
        puts.push(Put { at, width: to.width, source: fits(value, to.width)?, used: false });
    }
    Some(puts)
}

/// `AUF DB n` where it stands, and the statement after it.
fn open<'o>(cursor: &mut Cursor<'o>) -> Option<(&'o Mc7Op, Option<u16>)> {
    let first = cursor.next()?;
    match first {
        Mc7Op::Plain(Op::OpenDb(DbRegister::Db, Number::Fixed(n))) if *n > 0 => Some((cursor.next()?, Some(*n))),
        other => Some((other, None)),
    }
}

/// `+AR2 P#x; TAR2; LAR2 LD s; T LD t`, or the same by `TAR2 LD t`: the pointer into the caller's instance.
fn instance_pointer(cursor: &mut Cursor<'_>, saved: Option<BitAddr>) -> Option<Put> {
    let saved = saved?;
    let offset = match cursor.peek()? {
        Mc7Op::Plain(Op::AddArConst(AddressRegister::Ar2, offset)) => Some(*offset),
        Mc7Op::Plain(Op::TransferAr(AddressRegister::Ar2) | Op::TransferArTo(AddressRegister::Ar2, _)) => None,
        _ => return None,
    };
    if offset.is_some() {
        cursor.next();
    }
    let direct = match cursor.next()? {
        Mc7Op::Plain(Op::TransferArTo(_, Operand { place: Place::Fixed(Area::Local, at), .. })) => Some(*at),
        Mc7Op::Plain(Op::TransferAr(AddressRegister::Ar2)) => None,
        _ => return None,
    };
    if offset.is_some() {
        cursor.restore_ar2(saved)?;
    }
    let at = match direct {
        Some(at) => at,
        None => parts::local_transfer(cursor.next()?, Width::DWord)?,
    };
    let source = Source::InstancePointer(offset.unwrap_or(BitAddr(0)));
    Some(Put { at, width: Width::DWord, source, used: false })
}

/// What is taken back after the call.
fn outputs(cursor: &mut Cursor<'_>, caller: &Caller<'_, '_>) -> Option<Vec<Taken>> {
    let mut taken = Vec::new();
    while let Some(first) = cursor.next() {
        let (Given::Wide(Source::From(Operand { width, place: Place::Fixed(Area::Local, at) }), _)
        | Given::Bit(Source::From(Operand { width, place: Place::Fixed(Area::Local, at) }))) = given(first)?
        else {
            return None;
        };
        let (last, db) = open(cursor)?;
        let to = taken_by(last)?;
        if to.width != width {
            return None;
        }
        taken.push(Taken { at, width, to: opened(to, db, caller)?.place, used: false });
    }
    Some(taken)
}

/// The actual of one formal.
fn argument(formal: &Param, pointer: u32, copies: &mut Copies, caller: &Caller<'_, '_>) -> Option<Arg> {
    if formal.ty.is_parameter_type() && (formal.ty != DataType::TimerOrWord || pointer >> 31 == 0) {
        return (pointer & 0xFFFF == 0).then_some(Arg::Number(Number::Fixed((pointer >> 16) as u16)));
    }
    let area = Area::from_pointer_code((pointer >> 24) as u8)?;
    let at = BitAddr(pointer & 0x00FF_FFFF);
    if at.byte() > BitAddr::MAX_BYTE {
        return None;
    }
    let Some(width) = formal_width(formal) else {
        return composed(formal, area, at, copies, caller);
    };
    if width != Width::Bit && at.bit() != 0 {
        return None;
    }
    if area != Area::PreviousLocal {
        // The list cannot name the local data of the block called.
        let place = Place::Fixed(area, at);
        let named = area != Area::Local && (width != Width::Bit || area != Area::Peripheral);
        return named.then_some(Arg::Operand(Operand { width, place }));
    }
    let own = Operand { width, place: Place::Fixed(Area::Local, at) };
    caller.copied(formal, width, at, copies, Arg::Operand(own))
}

/// The actual of a composed formal: its POINTER or ANY lies in the local data.
fn composed(formal: &Param, area: Area, at: BitAddr, copies: &mut Copies, caller: &Caller<'_, '_>) -> Option<Arg> {
    let Copies { puts, handed, .. } = copies;
    let own = matches!(formal.ty, DataType::Any | DataType::Pointer);
    let count = handed_bytes(&formal.ty);
    if area != Area::PreviousLocal || at.bit() != 0 {
        return None;
    }
    let within = |p: &Put| (at.0..at.0 + count * 8).contains(&p.at.0);
    if !puts.iter().any(within) {
        // A temporary of the same type is handed over as it is.
        let operand = Operand { width: Width::Byte, place: Place::Fixed(Area::Local, at) };
        return (own && local_holds(&formal.ty, at)).then_some(Arg::Operand(operand));
    }
    // An ANY begins with type and count.
    let pointer = BitAddr(at.0 + (count - 6) * 8);
    let number = puts.iter().position(|p| p.at == pointer && p.source == Source::InstanceNumber);
    if let Some(number) = number {
        let instance = |p: &Put| matches!(p.source, Source::InstancePointer(_)).then_some(p.at.0);
        let pointer = puts.iter().position(|p| instance(p) == Some(pointer.0 + 16))?;
        let Source::InstancePointer(offset) = puts.get(pointer)?.source else { return None };
        let (param, into) = caller.block.interface.in_instance(offset)?;
        if !caller.block.multi_instance {
            return None;
        }
        puts.get_mut(number)?.used = true;
        puts.get_mut(pointer)?.used = true;
        if own {
            let any = match *bytes(puts, at, count - 6)? {
                [0x10, code, high, low] => Some((code, u16::from_be_bytes([high, low]))),
                [] => None,
                _ => return None,
            };
            let byte = SHARED + handed.iter().map(|one| if one.any.is_some() { 10 } else { 6 }).sum::<u32>();
            let one = Handed { byte, any, to: offset };
            let named = !param.is_pointer() && !param.name.is_empty();
            if !named || !parts::begins(&param.ty, into, &|ty| one.fits(ty)) {
                return None;
            }
            handed.push(one);
            return Some(one.arg());
        }
        let same = into == 0 && param.ty == formal.ty;
        return same.then_some(Arg::Operand(Operand { width: Width::Byte, place: Place::Instance(offset) }));
    }
    let bytes = bytes(puts, at, count)?;
    if own { Some(Arg::Bytes(bytes.into())) } else { pointed(&bytes).map(Arg::Operand) }
}
