//! Conversions: which are implicit, which have a function, and what each is made of.

use ob1_ir::{Convert, Op, WordLogic};
use ob1_model::DataType;

use crate::tree::{Check, Kind, Typed};
use crate::types::{is_bits, rank, short};

fn mask(bits: u32) -> Op {
    Op::DWordLogic(WordLogic::And, Some(bits))
}

/// Operations on ACCU1, as a function of it.
pub(crate) fn by<'w>(ops: Vec<Op>, check: Check, value: Typed<'w>, ty: &'w DataType) -> Typed<'w> {
    let span = value.span;
    // The width of an access is that of the variable, and an operation is that of its own type.
    let bits = value.ty.elementary_bits();
    let same =
        matches!(value.kind, Kind::Constant(_)) || matches!(value.kind, Kind::Var(_)) && bits == ty.elementary_bits();
    let kind = match (ops.is_empty() && check == Check::Never && same, value) {
        (true, Typed { kind, .. }) => kind,
        (false, value) => Kind::Convert(ops, check, Box::new(value)),
    };
    Typed::new(kind, ty, span)
}

/// A value as a wider one of its class; `None` where the conversion is not implicit.
pub(crate) fn implicit<'w>(value: Typed<'w>, to: &'w DataType) -> Result<Typed<'w>, Typed<'w>> {
    use DataType::{Bool, DInt, Int, Real};
    if value.ty == to {
        return Ok(Typed { ty: to, ..value });
    }
    Ok(match (value.ty, to) {
        (Bool, _) if is_bits(to) => {
            let span = value.span;
            Typed::new(Kind::FromBool(Box::new(value)), to, span)
        }
        (from, to) if is_bits(from) && is_bits(to) && rank(from) < rank(to) => widened(value, to),
        (Int, DInt) => by(vec![Op::Convert(Convert::Itd)], Check::Never, value, to),
        (Int, Real) => {
            let ops = vec![Op::Convert(Convert::Itd), Op::Convert(Convert::Dtr)];
            by(ops, Check::Never, value, to)
        }
        (DInt, Real) => by(vec![Op::Convert(Convert::Dtr)], Check::Never, value, to),
        _ => return Err(value),
    })
}

/// A shorter value with zeros in front.
fn widened<'w>(value: Typed<'w>, to: &'w DataType) -> Typed<'w> {
    // What is loaded from memory has zeros there already.
    let plain = matches!(value.kind, Kind::Var(_) | Kind::Constant(_));
    let bits = value.ty.elementary_bits().unwrap_or(32);
    let ops = if plain || bits >= 32 { Vec::new() } else { vec![mask(u32::MAX >> (32 - bits))] };
    by(ops, Check::Never, value, to)
}

/// The name of the function that converts, for a remedy.
pub(crate) fn function(from: &DataType, to: &DataType) -> Option<String> {
    let elementary = |ty: &DataType| ty.elementary_bits().is_some();
    (elementary(from) && elementary(to) && path(from, to).is_some())
        .then(|| format!("{}_TO_{}", short(from), short(to)))
}

/// What a conversion is made of: operations on ACCU1, and when OK is cleared. `None`: there is none of this name, or it
/// is a block.
fn path(from: &DataType, to: &DataType) -> Option<(Vec<Op>, Check)> {
    use DataType::{Byte, Char, DInt, DWord, Date, Int, Real, S5Time, Time, TimeOfDay, Word};
    let rounded = || Op::Convert(Convert::Rnd);
    let low_byte = || (vec![mask(0xFF)], Check::Bits(0xFF00));
    let low_word = || (vec![mask(0xFFFF)], Check::Never);
    Some(match (from, to) {
        (from, to) if from == to => (Vec::new(), Check::Never),
        (Byte, Int | DInt | Word | DWord | Real | Char) if *to != Real => (vec![mask(0xFF)], Check::Never),
        (Char, Byte | Int | Word | DWord | DInt) => (vec![mask(0xFF)], Check::Never),
        (Word, DInt | DWord) | (Int, DWord) | (Date, DInt | DWord) => low_word(),
        (Word | S5Time, Int | Date | S5Time | Word) | (Int, Word | Date | S5Time) | (Date, Int | Word) => {
            (Vec::new(), Check::Never)
        }
        (DWord | DInt, TimeOfDay) => (Vec::new(), Check::Day),
        (DWord | DInt, Time | DInt | DWord) | (Time | TimeOfDay, DInt | DWord) => (Vec::new(), Check::Never),
        (Time, TimeOfDay) | (TimeOfDay, Time) | (DWord, Real) | (Real, DWord) => (Vec::new(), Check::Never),
        (Int, DInt | Time) => (vec![Op::Convert(Convert::Itd)], Check::Never),
        (Int, Real) => (vec![Op::Convert(Convert::Itd), Op::Convert(Convert::Dtr)], Check::Never),
        (DInt, Real) => (vec![Op::Convert(Convert::Dtr)], Check::Never),
        (Int | Word, Byte) => low_byte(),
        (DWord | DInt, Byte) => (vec![mask(0xFF)], Check::Bits(0xFFFF_FF00)),
        (Int | Word, Char) => low_byte(),
        (DInt, Int) => (Vec::new(), Check::Int),
        (DWord, Int | Word) | (DInt, Word) => (vec![mask(0xFFFF)], Check::Bits(0xFFFF_0000)),
        (DInt | DWord, Date) => (vec![mask(0xFFFF)], Check::Bits(0xFFFF_0000)),
        (Time, Int) => (Vec::new(), Check::Int),
        (Time, Word) | (Byte | Word, Time) => (vec![mask(0xFFFF)], Check::Never),
        (Real, DInt) => (vec![rounded()], Check::Overflow),
        (Real, Int) => (vec![rounded()], Check::OverflowOrInt),
        (Byte, Real) => (vec![mask(0xFF), Op::Convert(Convert::Dtr)], Check::Never),
        (Word, Real) => (vec![mask(0xFFFF), Op::Convert(Convert::Dtr)], Check::Never),
        (Real, Word) => (vec![rounded(), mask(0xFFFF)], Check::Overflow),
        (Real, Byte) => (vec![rounded(), mask(0xFF)], Check::Overflow),
        _ => return None,
    })
}

/// A value converted by `FROM_TO_TO`. `None`: there is no such conversion.
pub(crate) fn explicit<'w>(value: Typed<'w>, to: &'w DataType) -> Option<Typed<'w>> {
    let span = value.span;
    match (value.ty, to) {
        (DataType::Bool, _) if is_bits(to) || matches!(to, DataType::Int | DataType::DInt) => {
            return Some(Typed::new(Kind::FromBool(Box::new(value)), to, span));
        }
        (from, DataType::Bool) if is_bits(from) || matches!(from, DataType::Int | DataType::DInt) => {
            return Some(Typed::new(Kind::ToBool(Box::new(value)), to, span));
        }
        _ => {}
    }
    let (ops, check) = path(value.ty, to)?;
    // Zeros in front are there already.
    let plain = matches!(value.kind, Kind::Var(_) | Kind::Constant(_));
    let bits = value.ty.elementary_bits().unwrap_or(32);
    let needless = |op: &Op| matches!(op, Op::DWordLogic(WordLogic::And, Some(kept)) if bits < 32 && *kept >= u32::MAX >> (32 - bits));
    let ops = if plain && check == Check::Never { ops.into_iter().filter(|op| !needless(op)).collect() } else { ops };
    Some(by(ops, check, value, to))
}
