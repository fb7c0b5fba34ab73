//! Paths into composed types: `.name` and `[i, j]`.

use ob1_ir::{Operand, Place, Width};
use ob1_model::{BitAddr, DataType, Dimension, Layout};

use crate::fields::FieldIndex;
use crate::messages;
use crate::parser::unquote;
use crate::reader::Reader;
use crate::token::{Kind, Span};
use crate::type_words::with_article;
use crate::value::{Term, Value};

/// What may be in `[ ]` besides a number.
pub(crate) trait Indices {
    /// A whole number of `VAR CONSTANT`.
    fn whole_number(&self, name: &str) -> Option<i32>;

    /// Reads a variable. `None`: reported.
    fn variable(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<Value<'_>>;
}

/// Reads `.name` and `[i]` as far as they go, from `ty` at `base`. Indices that are known at run time only go to
/// `terms`. `None` when a step leads nowhere (reported).
pub(crate) fn follow<'t>(
    indices: &dyn Indices,
    reader: &mut Reader<'_, '_>,
    fields: &FieldIndex,
    mut ty: &'t DataType,
    mut base: BitAddr,
    terms: &mut Vec<Term>,
) -> Option<(&'t DataType, BitAddr)> {
    loop {
        match reader.peek_kind() {
            Some(Kind::Dot) => {
                reader.next();
                let (inner, at) = component(reader, fields, ty)?;
                (ty, base) = (inner, BitAddr(base.0 + at.0));
            }
            Some(Kind::LeftBracket) => {
                let (inner, at) = element(indices, reader, ty, terms)?;
                (ty, base) = (inner, BitAddr(base.0 + at.0));
            }
            _ => return Some((ty, base)),
        }
    }
}

fn component<'t>(
    reader: &mut Reader<'_, '_>,
    fields: &FieldIndex,
    ty: &'t DataType,
) -> Option<(&'t DataType, BitAddr)> {
    let span = reader.here();
    let name = match reader.peek_kind() {
        Some(Kind::Word | Kind::Symbol) => reader.next().map(|t| unquote(reader.text(t))),
        _ => None,
    };
    let Some(name) = name else {
        reader.report(span, &messages::COMPONENT, "the name of a component is missing after the point");
        return None;
    };
    if let Some(found) = ty.elementary_bits().and_then(|bits| slice(bits, name)) {
        return Some(found);
    }
    let DataType::Struct(inner) = ty else {
        reader.report(span, &messages::COMPONENT, format!("{} has no component {name}", with_article(ty.name())));
        return None;
    };
    let found = fields.find(inner, name);
    if found.is_none() {
        let known = inner.iter().map(|f| f.name.as_str());
        let message = format!("the structure has no component {name}");
        reader.sink.report_unknown(reader.index, span, &messages::COMPONENT, message, name, known);
    }
    found
}

/// An index of the dimension `at` that is known at run time only, as STL of an S7-1500 has it: a variable. Gives the
/// lowest index too. `None`: reported.
fn at_run_time(indices: &dyn Indices, reader: &mut Reader<'_, '_>, ty: &DataType, at: usize) -> Option<(Term, i32)> {
    let span = reader.here();
    let value = indices.variable(reader, span)?;
    let (DataType::Array(_, element), Some((dim, inner))) = (ty, dims_from(ty, at)) else {
        reader.report(span, &messages::ARRAY_INDEX, "only an array can have an index that is known at run time");
        return None;
    };
    // Rows begin on even bytes, as `Layout` places them.
    let stride = match inner.split_last() {
        None => Layout::stride(element),
        Some((last, outer)) => {
            let row = ob1_model::align_to(last.len() * Layout::stride(element), 16);
            outer.iter().map(|d| d.len()).product::<u32>() * row
        }
    };
    let fits = match &value {
        Value::Memory { operand, ty } if operand.width != Width::Bit => {
            let whole = matches!(
                ty,
                None | Some(DataType::Int | DataType::DInt | DataType::Byte | DataType::Word | DataType::DWord)
            );
            whole.then(|| (*operand, operand.width == Width::Word && !matches!(ty, Some(DataType::Word))))
        }
        _ => None,
    };
    let Some((index, int)) = fits else {
        let message = format!("an index is a number, an INT or a DINT, this is {}", value.describe());
        reader.report(span, &messages::ARRAY_INDEX, message);
        return None;
    };
    Some((Term { index, int, low: dim.low, stride }, dim.low))
}

/// A dimension of an array, and those within it.
fn dims_from(ty: &DataType, at: usize) -> Option<(Dimension, &[Dimension])> {
    let DataType::Array(dims, _) = ty else { return None };
    let (dim, inner) = dims.get(at..)?.split_first()?;
    Some((*dim, inner))
}

/// A part of an elementary value, as TIA Portal writes it: `X3` is bit 3, `B1` byte 1, `W0` word 0 of `bits` bits, all
/// counted from the least significant one.
pub fn slice(bits: u32, name: &str) -> Option<(&'static DataType, BitAddr)> {
    let (kind, number) = (name.get(..1)?, name.get(1..)?);
    let (ty, part) = match kind {
        "X" | "x" => (&DataType::Bool, 1),
        "B" | "b" => (&DataType::Byte, 8),
        "W" | "w" => (&DataType::Word, 16),
        _ => return None,
    };
    let number: u32 = number.parse().ok().filter(|n| bits > 1 && *n < bits / part)?;
    let least = number * part;
    // The least significant byte is the last.
    let at = if part == 1 { bits - 8 - least / 8 * 8 + least % 8 } else { bits - least - part };
    Some((ty, BitAddr(at)))
}

/// A slice of an address or tag of its own: `"Tag".%X3`. The operand as it is where none follows.
pub(crate) fn sliced(reader: &mut Reader<'_, '_>, operand: Operand) -> (Operand, Option<&'static DataType>) {
    let bits = u32::from(operand.width.bits());
    let name = reader.peek_second().filter(|t| reader.peek_kind() == Some(Kind::Dot) && t.kind == Kind::Word);
    let Some((ty, at)) = name.and_then(|t| slice(bits, reader.text(t))) else { return (operand, None) };
    let beyond = |start: BitAddr| BitAddr(start.0 + at.0);
    let place = match operand.place {
        Place::Fixed(area, start) => Place::Fixed(area, beyond(start)),
        Place::InDb(db, start) => Place::InDb(db, beyond(start)),
        _ => return (operand, None),
    };
    reader.next();
    reader.next();
    (Operand { width: Width::of(ty).unwrap_or(operand.width), place }, Some(ty))
}

/// What a STRING is made of.
static CHARACTER: DataType = DataType::Char;

/// `[1, -2]` on an array; `[3]` on a STRING.
fn element<'t>(
    known: &dyn Indices,
    reader: &mut Reader<'_, '_>,
    ty: &'t DataType,
    terms: &mut Vec<Term>,
) -> Option<(&'t DataType, BitAddr)> {
    let span = reader.here();
    reader.next();
    let mut indices = Vec::new();
    loop {
        let negative = reader.eat(Kind::Operator).is_some_and(|t| reader.text(t) == "-");
        let constant = reader.peek().filter(|t| t.kind == Kind::Local);
        let number = match constant.and_then(|t| known.whole_number(unquote(reader.text(t)))) {
            Some(number) => reader.next().and(Some(number)),
            None => reader.eat(Kind::Number).and_then(|t| reader.text(t).parse::<i32>().ok()),
        };
        // More indices than an array can have are counted, not kept.
        match number {
            Some(n) if indices.len() < 8 => indices.push(if negative { -n } else { n }),
            Some(_) => {}
            None if !negative && matches!(reader.peek_kind(), Some(Kind::Local | Kind::Symbol | Kind::Word)) => {
                let (term, low) = at_run_time(known, reader, ty, indices.len())?;
                terms.push(term);
                // Its dimension counts from its first element.
                indices.push(low);
            }
            None => {
                reader.report(span, &messages::ARRAY_INDEX, "the index of an array element is a number");
                return None;
            }
        }
        if reader.eat(Kind::Comma).is_none() {
            break;
        }
    }
    if reader.eat(Kind::RightBracket).is_none() {
        reader.report(span, &messages::ARRAY_INDEX, "the index is not closed with ]");
        return None;
    }
    // A character of a STRING lies after the two bytes of its lengths.
    if let (DataType::String(max), [index]) = (ty, indices.as_slice()) {
        let at = u32::try_from(*index).ok().filter(|i| (1..=u32::from(*max)).contains(i));
        if at.is_none() {
            let message = format!("the index is outside the STRING, which has {max} characters from 1");
            reader.report(span, &messages::ARRAY_INDEX, message);
        }
        return at.map(|i| (&CHARACTER, BitAddr::byte_addr(i + 1)));
    }
    let DataType::Array(dims, inner) = ty else {
        reader.report(span, &messages::ARRAY_INDEX, format!("{} has no elements", with_article(ty.name())));
        return None;
    };
    let at = Layout::element(dims, inner, &indices);
    if at.is_none() {
        let bounds: Vec<_> = dims.iter().map(|d| format!("{}..{}", d.low, d.high)).collect();
        let bounds = bounds.join(", ");
        let message = format!("the index is outside the array's bounds [{bounds}]");
        // Too few or too many indices are another mistake.
        if dims.len() == indices.len() {
            let remedy = format!("Write an index within [{bounds}], or declare a larger array.");
            reader.sink.report_with(reader.index, span, &messages::ARRAY_INDEX, message, remedy);
        } else {
            reader.report(span, &messages::ARRAY_INDEX, message);
        }
    }
    at.map(|at| (&**inner, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_count_from_the_least_significant_bit() {
        for (bits, name, at) in [
            (16, "X0", Some(8)),
            (16, "X7", Some(15)),
            (16, "X8", Some(0)),
            (16, "X15", Some(7)),
            (16, "x3", Some(11)),
            (8, "X3", Some(3)),
            (32, "X31", Some(7)),
            (32, "B0", Some(24)),
            (32, "B3", Some(0)),
            (32, "W0", Some(16)),
            (32, "W1", Some(0)),
            (16, "B1", Some(0)),
            (16, "X16", None),
            (32, "W2", None),
            (1, "X0", None),
            (16, "Y0", None),
            (16, "X", None),
        ] {
            assert_eq!(slice(bits, name).map(|(_, at)| at.0), at, "{bits} {name}");
        }
    }
}
