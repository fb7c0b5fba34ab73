//! Classes of types, and the types that expressions get.

use ob1_ir::NumberFormat;
use ob1_model::DataType;
use ob1_stl::front::simple_types;

pub(crate) static BOOL: DataType = DataType::Bool;
pub(crate) static BYTE: DataType = DataType::Byte;
pub(crate) static CHAR: DataType = DataType::Char;
pub(crate) static WORD: DataType = DataType::Word;
pub(crate) static INT: DataType = DataType::Int;
pub(crate) static DWORD: DataType = DataType::DWord;
pub(crate) static DINT: DataType = DataType::DInt;
pub(crate) static REAL: DataType = DataType::Real;
pub(crate) static S5TIME: DataType = DataType::S5Time;
pub(crate) static TIME: DataType = DataType::Time;
pub(crate) static DATE: DataType = DataType::Date;
pub(crate) static TOD: DataType = DataType::TimeOfDay;
pub(crate) static DT: DataType = DataType::DateAndTime;
pub(crate) static STRING: DataType = DataType::String(254);
pub(crate) static POINTER: DataType = DataType::Pointer;
pub(crate) static ANY: DataType = DataType::Any;
pub(crate) static BLOCK_DB: DataType = DataType::BlockDb;
pub(crate) static TIMER: DataType = DataType::Timer;
pub(crate) static COUNTER: DataType = DataType::Counter;

/// The type with this name that conversions may have: `X_TO_Y`.
pub(crate) fn named(word: &str) -> Option<&'static DataType> {
    let of_tia = [("STRING", &STRING), ("USINT", &BYTE), ("UINT", &WORD), ("UDINT", &DWORD)];
    let value =
        |ty: &DataType| ty.elementary_bits().is_some() || matches!(ty, DataType::DateAndTime | DataType::BlockDb);
    let mut all = simple_types().filter(|(_, ty)| value(ty)).chain(of_tia);
    all.find(|(name, _)| name.eq_ignore_ascii_case(word)).map(|(_, ty)| ty)
}

pub(crate) const fn is_bits(ty: &DataType) -> bool {
    matches!(ty, DataType::Byte | DataType::Word | DataType::DWord)
}

pub(crate) const fn is_whole(ty: &DataType) -> bool {
    matches!(ty, DataType::Int | DataType::DInt)
}

pub(crate) const fn is_number(ty: &DataType) -> bool {
    matches!(ty, DataType::Int | DataType::DInt | DataType::Real)
}

/// Where each type stands among those that widen into each other: bit strings, then numbers.
pub(crate) const fn rank(ty: &DataType) -> u8 {
    match ty {
        DataType::Byte | DataType::Int => 1,
        DataType::Word | DataType::DInt => 2,
        DataType::DWord | DataType::Real => 3,
        _ => 0,
    }
}

/// How a type is compared and calculated with.
pub(crate) const fn format(ty: &DataType) -> NumberFormat {
    match ty {
        DataType::Real => NumberFormat::Real,
        DataType::DInt | DataType::DWord | DataType::Time | DataType::TimeOfDay => NumberFormat::DInt,
        _ => NumberFormat::Int,
    }
}

/// The name of a type in a message and in a conversion.
pub(crate) const fn short(ty: &DataType) -> &'static str {
    match ty {
        DataType::TimeOfDay => "TOD",
        DataType::DateAndTime => "DT",
        other => other.name(),
    }
}

/// What a block without function value gives.
pub(crate) static NOTHING: DataType = DataType::Struct(Vec::new());
