//! Actual parameters with a fixed address, a number or a constant, as the formals take them.

use ob1_ir::compose::any_length;
use ob1_ir::{Arg, Number, Operand, Place, Width};
use ob1_model::{Area, DataType, Param};

use crate::constant::{Constant, Encoded, PointerConstant, any_of_number};
use crate::identifiers::BlockWord;
use crate::value::Value;

/// Why an actual parameter does not fit.
pub(crate) enum Misfit {
    /// What it is instead.
    Type(String),
    /// What is wrong with the constant.
    Constant(String),
}

/// The actual as the formal takes it; `instance`: the callee keeps its parameters in an instance data block.
pub(crate) fn fit(formal: &Param, value: Value<'_>, instance: bool) -> Result<Arg, Misfit> {
    let ty = &formal.ty;
    let described = value.describe();
    let misfit = || Misfit::Type(described.clone());
    if ty.is_parameter_type() {
        return by_number(ty, value, misfit);
    }
    match value {
        Value::Constant(Constant::Pointer(p))
            if ty.is_composed() && !matches!(ty, DataType::Pointer | DataType::Any) =>
        {
            // P#DB10.DBX0.0 names the place of a structure, an array or a string.
            let operand = composed_place(p).ok_or_else(misfit)?;
            if instance && formal.is_pointer() {
                return pointer_to(&DataType::Pointer, operand, None).ok_or_else(misfit);
            }
            Ok(Arg::Operand(operand))
        }
        Value::Constant(constant) => match constant.encode(ty).map_err(Misfit::Constant)? {
            Encoded::Bits(bits) => Ok(Arg::Const(bits)),
            Encoded::Bytes(bytes) => Ok(Arg::Bytes(bytes.into())),
        },
        Value::Memory { operand, ty: actual } => match ty {
            DataType::Pointer | DataType::Any => pointer_to(ty, operand, actual).ok_or_else(misfit),
            _ if ty.is_composed() => {
                let same = actual.is_some_and(|actual| same_layout(ty, actual));
                match same {
                    // The instance keeps a POINTER to the actual.
                    true if instance && formal.is_pointer() => {
                        pointer_to(&DataType::Pointer, operand, actual).ok_or_else(misfit)
                    }
                    true => Ok(Arg::Operand(operand)),
                    false => Err(misfit()),
                }
            }
            _ => {
                let fits = Width::of(ty) == Some(operand.width) && actual.is_none_or(|a| !a.is_composed());
                if fits { Ok(Arg::Operand(operand)) } else { Err(misfit()) }
            }
        },
        Value::Timer(Number::Fixed(n)) if *ty == DataType::Any => Ok(Arg::Bytes(any_of_number(0x1D, n).into())),
        Value::Counter(Number::Fixed(n)) if *ty == DataType::Any => Ok(Arg::Bytes(any_of_number(0x1C, n).into())),
        Value::Block(word, Number::Fixed(n)) if *ty == DataType::Any => match word {
            BlockWord::Db => Ok(Arg::Bytes(any_of_number(0x19, n).into())),
            BlockWord::Fc => Ok(Arg::Bytes(any_of_number(0x18, n).into())),
            BlockWord::Fb => Ok(Arg::Bytes(any_of_number(0x17, n).into())),
            _ => Err(misfit()),
        },
        Value::Block(BlockWord::Db, Number::Fixed(db)) if *ty == DataType::Pointer => {
            let pointer = PointerConstant { area: Some(Area::Db), at: ob1_model::BitAddr(0), db, any: None, own: None };
            Ok(Arg::Bytes(pointer.pointer_bytes().into()))
        }
        _ => Err(misfit()),
    }
}

/// True for two types of one width whose bits mean different numbers. WORD and DWORD hold anything, and a time of 32
/// bits is a whole number of milliseconds.
pub(crate) fn misread(formal: &DataType, actual: &DataType) -> bool {
    use DataType::{DInt, Date, Int, Real, S5Time, Time, TimeOfDay};
    match formal {
        Real => matches!(actual, DInt | Time | TimeOfDay),
        DInt | Time | TimeOfDay => *actual == Real,
        S5Time => matches!(actual, Int | Date),
        Int | Date => *actual == S5Time,
        _ => false,
    }
}

/// Timers, counters and blocks.
fn by_number(ty: &DataType, value: Value<'_>, misfit: impl Fn() -> Misfit) -> Result<Arg, Misfit> {
    match (ty, value) {
        (DataType::Timer | DataType::TimerOrWord, Value::Timer(n)) => Ok(Arg::Number(n)),
        (DataType::Counter, Value::Counter(n)) => Ok(Arg::Number(n)),
        (DataType::BlockDb, Value::Block(BlockWord::Db, n)) => Ok(Arg::Number(n)),
        (DataType::BlockFb, Value::Block(BlockWord::Fb, n)) => Ok(Arg::Number(n)),
        (DataType::BlockFc, Value::Block(BlockWord::Fc, n)) => Ok(Arg::Number(n)),
        (DataType::TimerOrWord, Value::Constant(constant)) => match constant.encode(ty) {
            Ok(Encoded::Bits(bits)) => Ok(Arg::Const(bits)),
            Ok(Encoded::Bytes(_)) => Err(misfit()),
            Err(message) => Err(Misfit::Constant(message)),
        },
        (DataType::TimerOrWord, Value::Memory { operand, .. }) if operand.width == Width::Word => {
            Ok(Arg::Operand(operand))
        }
        _ => Err(misfit()),
    }
}

/// The place that `P#DB10.DBX0.0` names.
fn composed_place(pointer: PointerConstant) -> Option<Operand> {
    let place = match (pointer.area?, pointer.db) {
        (Area::Db, db) if db > 0 => Place::InDb(db, pointer.at),
        (area, 0) => Place::Fixed(area, pointer.at),
        _ => return None,
    };
    Some(Operand { width: Width::Byte, place })
}

/// A POINTER or ANY to an operand. Own parameters of these types are passed on as they are.
fn pointer_to(ty: &DataType, operand: Operand, actual: Option<&DataType>) -> Option<Arg> {
    if actual.is_some_and(|a| a == ty) {
        return Some(Arg::Operand(operand));
    }
    let (area, at, db) = match operand.place {
        // The callee sees the caller's local data as the area V.
        Place::Fixed(Area::Local, at) => (Area::PreviousLocal, at, 0),
        Place::Fixed(area, at) => (area, at, 0),
        Place::InDb(db, at) => (Area::Db, at, db),
        _ => return None,
    };
    let pointer = PointerConstant { area: Some(area), at, db, any: Some(any_length(operand, actual)), own: None };
    Some(Arg::Bytes(if *ty == DataType::Any { pointer.any_bytes() } else { pointer.pointer_bytes() }.into()))
}

/// True for types that mean the same bytes: names and start values do not count, the length of a STRING neither.
pub fn same_layout(a: &DataType, b: &DataType) -> bool {
    match (a, b) {
        (DataType::Struct(a), DataType::Struct(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same_layout(&a.ty, &b.ty))
        }
        (DataType::Array(da, a), DataType::Array(db, b)) => da == db && same_layout(a, b),
        (DataType::String(_), DataType::String(_)) => true,
        _ => a == b,
    }
}
