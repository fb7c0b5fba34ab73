//! Start values: the bytes a data block begins with.

use ob1_ir::Number;
use ob1_model::calendar::{self, DAYS_TO_1990};
use ob1_model::{BitAddr, DataType, Layout, cells};

use crate::constant::{Constant, Encoded};
use crate::identifiers::BlockWord;
use crate::messages;
use crate::operand::Resolver;
use crate::parser::split_digits;
use crate::reader::Reader;
use crate::token::Kind;
use crate::type_words::with_article;
use crate::value::Value;

/// Bytes a value of `ty` takes; a BOOL takes one.
pub(crate) fn size(ty: &DataType) -> usize {
    Layout::bits(ty).div_ceil(8) as usize
}

/// Writes the value a type has when the source gives none: 0, but a blank for CHAR, the length for STRING,
/// 1990-01-01 for DATE_AND_TIME, and what the components of a structure declare.
pub fn write_default(ty: &DataType, at: BitAddr, image: &mut [u8]) {
    match ty {
        DataType::Char => put(image, at, ty, b" "),
        DataType::String(max) => put(image, at, ty, &[*max]),
        DataType::DateAndTime => put(image, at, ty, &calendar::date_and_time(DAYS_TO_1990, 0)),
        DataType::Struct(fields) => {
            let mut layout = Layout::new();
            for field in fields {
                let at = BitAddr(at.0 + layout.place(&field.ty).0);
                match &field.initial {
                    Some(bytes) => put(image, at, &field.ty, bytes),
                    None => write_default(&field.ty, at, image),
                }
            }
        }
        DataType::Array(dims, element) => {
            let mut one = vec![0; size(element)];
            write_default(element, BitAddr(0), &mut one);
            if one.iter().all(|b| *b == 0) {
                return;
            }
            for offset in Layout::places(dims, element) {
                put(image, BitAddr(at.0 + offset.0), element, &one);
            }
        }
        _ => {}
    }
}

/// Puts laid-out bytes of a value at its place; a BOOL is bit 0 of its one byte. What lies outside the image is
/// dropped.
pub(crate) fn put(image: &mut [u8], at: BitAddr, ty: &DataType, bytes: &[u8]) {
    if *ty == DataType::Bool {
        let _ = cells::set_bit(image, at.0 as usize, bytes.first().is_some_and(|b| b & 1 == 1));
        return;
    }
    let start = at.byte() as usize;
    if let Some(target) = image.get_mut(start..start + bytes.len()) {
        target.copy_from_slice(bytes);
    }
}

/// Reads a start value for `ty`: a constant, or a list of them for an array, `1, 2, 3(0)`. `None`: reported.
pub(crate) fn read(resolver: &Resolver<'_>, reader: &mut Reader<'_, '_>, ty: &DataType) -> Option<Vec<u8>> {
    let value = match ty {
        DataType::Array(dims, element) => array(resolver, reader, dims, element, size(ty))?,
        _ => constant(resolver, reader, ty)?,
    };
    reader.finish(&messages::INITIAL_VALUE).then_some(value)
}

fn constant(resolver: &Resolver<'_>, reader: &mut Reader<'_, '_>, ty: &DataType) -> Option<Vec<u8>> {
    let span = reader.rest();
    if ty.is_parameter_type() {
        return number(resolver, reader, ty);
    }
    let constant = match (resolver.constant(reader)?, ty) {
        // A number without its decimal point, as TIA Portal and hands write it.
        (Constant::Integer(v), DataType::Real) => Constant::Real(v as f32),
        (Constant::Text(text), DataType::Word | DataType::DWord) if text.len() == size(ty) => {
            let value = text.iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
            Constant::Bits(value, size(ty) as u8 * 8)
        }
        (constant, _) => constant,
    };
    match constant.encode(ty) {
        Ok(Encoded::Bytes(bytes)) => Some(bytes),
        Ok(Encoded::Bits(bits)) => {
            let bytes = bits.to_be_bytes();
            Some(bytes[4 - size(ty).min(4)..].to_vec())
        }
        Err(message) => {
            reader.report(span, &messages::CONSTANT_TYPE, message);
            None
        }
    }
}

/// The value of a TIMER, COUNTER or BLOCK parameter in an instance data block: `T 5`, `Z 3`, `FC 4`.
fn number(resolver: &Resolver<'_>, reader: &mut Reader<'_, '_>, ty: &DataType) -> Option<Vec<u8>> {
    let span = reader.rest();
    if let Some(number) = not_an_operand(reader, ty) {
        return Some(number.to_be_bytes().to_vec());
    }
    let value = resolver.operand(reader)?;
    let fits = match (&value, ty) {
        (Value::Timer(n), DataType::Timer | DataType::TimerOrWord)
        | (Value::Counter(n), DataType::Counter)
        | (Value::Block(BlockWord::Db | BlockWord::Di, n), DataType::BlockDb)
        | (Value::Block(BlockWord::Fb, n), DataType::BlockFb)
        | (Value::Block(BlockWord::Fc, n), DataType::BlockFc)
        | (Value::Block(_, n), DataType::BlockSdb) => match n {
            Number::Fixed(n) => Some(*n),
            _ => None,
        },
        (Value::Constant(constant), _) => match constant.encode(&DataType::Word) {
            Ok(Encoded::Bits(bits)) => u16::try_from(bits).ok(),
            _ => None,
        },
        _ => None,
    };
    if fits.is_none() {
        let message = format!("{} is given by its number, this is {}", with_article(ty.name()), value.describe());
        reader.report(span, &messages::CONSTANT_TYPE, message);
    }
    fits.map(|n| n.to_be_bytes().to_vec())
}

/// `DB 0`, which stands for no data block, and `SDB 5`: start values that no statement can have.
fn not_an_operand(reader: &mut Reader<'_, '_>, ty: &DataType) -> Option<u16> {
    let token = reader.peek().filter(|t| t.kind == Kind::Word)?;
    let (word, digits) = split_digits(reader.text(token));
    let second = reader.peek_second().filter(|t| digits.is_empty() && t.kind == Kind::Number);
    let number: u16 = second.map_or(digits, |t| reader.text(t)).parse().ok()?;
    let fits = match ty {
        DataType::BlockDb => word.eq_ignore_ascii_case("DB") && number == 0,
        DataType::BlockSdb => word.eq_ignore_ascii_case("SDB"),
        _ => false,
    };
    if !fits {
        return None;
    }
    reader.next();
    if second.is_some() {
        reader.next();
    }
    Some(number)
}

fn array(
    resolver: &Resolver<'_>,
    reader: &mut Reader<'_, '_>,
    dims: &[ob1_model::Dimension],
    element: &DataType,
    bytes: usize,
) -> Option<Vec<u8>> {
    let mut image = vec![0; bytes];
    let places = Layout::places(dims, element);
    let start = reader.here();
    // TIA Portal puts the list into brackets.
    let bracket = reader.eat(Kind::LeftBracket).is_some();
    let mut given = 0usize;
    loop {
        let repeated = reader.peek_second().is_some_and(|t| t.kind == Kind::LeftParen);
        let count = match reader.peek().filter(|t| repeated && t.kind == Kind::Number) {
            Some(number) => {
                reader.next();
                reader.next();
                reader.text(number).parse::<usize>().ok()
            }
            None => None,
        };
        let mut group = vec![constant(resolver, reader, element)?];
        while count.is_some() && reader.eat(Kind::Comma).is_some() {
            group.push(constant(resolver, reader, element)?);
        }
        if count.is_some() && reader.eat(Kind::RightParen).is_none() {
            let span = reader.here();
            reader.report(span, &messages::INITIAL_VALUE, "the repeated value is not closed with )");
            return None;
        }
        for value in group.iter().cycle().take(group.len().saturating_mul(count.unwrap_or(1)).min(places.len() + 1)) {
            match places.get(given) {
                Some(at) => put(&mut image, *at, element, value),
                None => {
                    let message = format!("the array has {} elements, more values are given", places.len());
                    reader.report(start, &messages::INITIAL_VALUE, message);
                    return None;
                }
            }
            given += 1;
        }
        if reader.eat(Kind::Comma).is_none() {
            break;
        }
    }
    if bracket && reader.eat(Kind::RightBracket).is_none() {
        reader.report(start, &messages::INITIAL_VALUE, "the list of values is not closed with ]");
        return None;
    }
    let mut one = vec![0; size(element)];
    write_default(element, BitAddr(0), &mut one);
    for at in places.iter().skip(given) {
        put(&mut image, *at, element, &one);
    }
    Some(image)
}
