//! Values of every S7 type, including texts, times and arrays: read from the bytes of a CPU, and converted to writes.
//!
//! [`crate::value`] is about single values of up to 32 bits, as people write them; this module is about whole types, as
//! programs exchange them.

use std::fmt;

use ob1_model::calendar::DAY_MS;
use ob1_model::calendar::{self, DAYS_TO_1990};
use ob1_model::moment::Moment;
use ob1_model::{Cell, DataType, GROUP_ENTRIES, Layout, Piece, Put, S5Time, WRITE_BYTES, Width};
use serde_json::{Value, json};
use thiserror::Error;

use crate::Typed;
use crate::value::{narrowed, real_of};

/// Milliseconds from 1970-01-01 to 1990-01-01, where DATE and DATE_AND_TIME begin.
const MS_TO_1990: i64 = DAYS_TO_1990 as i64 * DAY_MS as i64;

/// A value of an S7 type, as programs exchange it.
#[derive(Clone, Debug, PartialEq)]
pub enum Datum {
    /// BOOL: a single bit.
    Bool(bool),
    /// BYTE, CHAR: eight bits.
    Byte(u8),
    /// WORD: 16 bits; a counter, 0 to 999.
    Word(u16),
    /// DWORD: 32 bits without sign.
    DWord(u32),
    /// INT: 16 bits with sign.
    Int(i16),
    /// DINT: 32 bits with sign.
    DInt(i32),
    /// REAL: IEEE 754 of 32 bits.
    Real(f32),
    /// TIME, S5TIME, a timer, TIME_OF_DAY (since midnight): milliseconds.
    Duration(i64),
    /// DATE, DATE_AND_TIME: milliseconds since 1970-01-01, by the CPU's clock.
    Moment(i64),
    /// STRING, each byte a character of ISO 8859-1.
    Text(String),
    /// POINTER, ANY: their bytes as they lie in memory.
    Bytes(Vec<u8>),
    /// ARRAY of these, the last dimension fastest.
    List(Vec<Datum>),
}

impl Datum {
    /// As JSON: durations in milliseconds, moments as `"2026-01-31T06:00:00.000"`, bytes in hexadecimal. JSON has no
    /// infinity: those are texts.
    #[must_use]
    pub fn json(&self) -> Value {
        match self {
            Datum::Bool(v) => json!(v),
            Datum::Byte(v) => json!(v),
            Datum::Word(v) => json!(v),
            Datum::DWord(v) => json!(v),
            Datum::Int(v) => json!(v),
            Datum::DInt(v) => json!(v),
            Datum::Real(v) => real(*v),
            Datum::Duration(ms) => json!(ms),
            Datum::Moment(ms) => json!(moment_text(*ms)),
            Datum::Text(v) => json!(v),
            Datum::Bytes(v) => json!(v.iter().map(|byte| format!("{byte:02X}")).collect::<String>()),
            Datum::List(values) => Value::Array(values.iter().map(Datum::json).collect()),
        }
    }

    /// From JSON as [`Datum::json`] writes it, for a place of this type. Bits may be 0 and 1.
    ///
    /// # Errors
    /// [`Unfit`]: the value has another type, does not fit into this one, or the type cannot be written.
    pub fn of_json(value: &Value, ty: &DataType) -> Result<Self, Unfit> {
        let number = || value.as_i64().ok_or(Unfit::Type);
        let fit = |_: std::num::TryFromIntError| Unfit::Range;
        Ok(match ty {
            DataType::Bool => match (value.as_bool(), value.as_i64()) {
                (Some(bit), _) => Datum::Bool(bit),
                (None, Some(bit @ (0 | 1))) => Datum::Bool(bit == 1),
                _ => return Err(Unfit::Type),
            },
            DataType::Byte | DataType::Char => Datum::Byte(number()?.try_into().map_err(fit)?),
            DataType::Word | DataType::Counter => Datum::Word(number()?.try_into().map_err(fit)?),
            DataType::DWord => Datum::DWord(number()?.try_into().map_err(fit)?),
            DataType::Int => Datum::Int(number()?.try_into().map_err(fit)?),
            DataType::DInt => Datum::DInt(number()?.try_into().map_err(fit)?),
            DataType::Real => match (value.as_f64(), value.as_str()) {
                (Some(number), _) => Datum::Real(narrowed(number).ok_or(Unfit::Range)?),
                (None, Some(text)) => Datum::Real(real_of(text).ok_or(Unfit::Type)?),
                _ => return Err(Unfit::Type),
            },
            DataType::Time | DataType::S5Time | DataType::TimeOfDay => Datum::Duration(number()?),
            DataType::Date | DataType::DateAndTime => {
                Datum::Moment(value.as_str().and_then(moment_of).ok_or(Unfit::Type)?)
            }
            DataType::String(_) => Datum::Text(value.as_str().ok_or(Unfit::Type)?.to_owned()),
            DataType::Array(_, element) => {
                let values = value.as_array().ok_or(Unfit::Type)?;
                Datum::List(values.iter().map(|value| Self::of_json(value, element)).collect::<Result<_, _>>()?)
            }
            _ => return Err(Unfit::Never),
        })
    }
}

/// As JSON has it.
impl fmt::Display for Datum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.json().fmt(f)
    }
}

/// The number with the shortest digits that parse to the same value.
pub(crate) fn real(value: f32) -> Value {
    let text = value.to_string();
    text.parse().ok().and_then(serde_json::Number::from_f64).map_or_else(|| json!(text), Value::Number)
}

fn moment_text(ms: i64) -> String {
    let (days, of_day) = (ms.div_euclid(DAY_MS as i64), ms.rem_euclid(DAY_MS as i64));
    let (year, month, day) = calendar::date_of(u32::try_from(days).unwrap_or(0));
    let (hour, minute, second) = (of_day / 3_600_000, of_day / 60_000 % 60, of_day / 1000 % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{:03}", of_day % 1000)
}

/// `2026-01-31`, optionally followed by `T06:00:00` and a fraction.
fn moment_of(text: &str) -> Option<i64> {
    let (date, time) = text.split_once('T').unwrap_or((text, "00:00:00"));
    let mut date = date.splitn(3, '-').map(str::parse::<u32>);
    let days = calendar::days_of(date.next()?.ok()?, date.next()?.ok()?, date.next()?.ok()?)?;
    let (clock, fraction) = time.split_once('.').unwrap_or((time, "0"));
    let mut clock = clock.splitn(3, ':').map(str::parse::<i64>);
    let (hour, minute, second) = (clock.next()?.ok()?, clock.next()?.ok()?, clock.next()?.ok()?);
    let digits = fraction.bytes().all(|digit| digit.is_ascii_digit());
    let legal = (0..24).contains(&hour) && (0..60).contains(&minute) && (0..60).contains(&second) && digits;
    let ms: i64 = format!("{fraction:0<3}").get(..3)?.parse().ok()?;
    legal.then_some(i64::from(days) * DAY_MS as i64 + ((hour * 60 + minute) * 60 + second) * 1000 + ms)
}

/// Why a value cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Unfit {
    /// The value is of another type, or an array of another length.
    #[error("the value is of another type")]
    Type,
    /// The value does not fit: too large, too long, no such date, no such character.
    #[error("the value does not fit")]
    Range,
    /// Nothing of this type can be written: a structure, a pointer.
    #[error("this type cannot be written")]
    Never,
    /// It does not fit one group of writes.
    #[error("more than {GROUP_ENTRIES} bits or {WRITE_BYTES} bytes at once")]
    TooLong,
}

impl Typed {
    /// Whether the place has a value, that is, not a structure or an array of structures.
    #[must_use]
    pub fn has_value(&self) -> bool {
        has_value(&self.ty)
    }

    /// The piece to read for its value; `None` if it has none.
    #[must_use]
    pub fn piece(&self) -> Option<Piece> {
        if !self.has_value() {
            return None;
        }
        let bits = Layout::bits(&self.ty);
        Some(match self.cell {
            Cell::Timer(_) | Cell::Counter(_) => Piece::Value(self.cell, Width::Word),
            Cell::Peripheral(_) => Piece::Value(self.cell, Width::of_bits(bits)?),
            Cell::Area(..) | Cell::Db(..) => {
                let bit = self.cell.bit() % 8;
                Piece::Bytes { at: self.cell.at_bit(self.cell.bit() - bit), len: (bit + bits).div_ceil(8) }
            }
        })
    }

    /// The value in the bytes of [`Typed::piece`]. `None` when they are too few or invalid for the type: a date of 31
    /// February, an S5TIME without digits.
    #[must_use]
    pub fn value(&self, bytes: &[u8]) -> Option<Datum> {
        let bit = match self.cell {
            Cell::Area(..) | Cell::Db(..) => self.cell.bit() % 8,
            Cell::Peripheral(_) | Cell::Timer(_) | Cell::Counter(_) => 0,
        };
        read(&self.ty, bytes, bit)
    }

    /// The writes for this value.
    ///
    /// # Errors
    /// [`Unfit`]: the value has another type, does not fit into this one, cannot be written, or is too long for one
    /// group.
    pub fn puts(&self, value: &Datum) -> Result<Vec<Put>, Unfit> {
        if matches!(self.cell, Cell::Timer(_) | Cell::Counter(_) | Cell::Peripheral(_)) {
            let bytes = write(&self.ty, value)?;
            let number = bytes.iter().fold(0, |number, byte| number << 8 | u32::from(*byte));
            let width = Width::of_bits(bytes.len() as u32 * 8).ok_or(Unfit::Never)?;
            return Ok(vec![Put::Value(self.cell, width, number)]);
        }
        let mut puts = Vec::new();
        self.put_into(value, &mut puts)?;
        let fits = puts.len() <= GROUP_ENTRIES && puts.iter().map(Put::bytes).sum::<usize>() <= WRITE_BYTES;
        if fits { Ok(puts) } else { Err(Unfit::TooLong) }
    }

    fn put_into(&self, value: &Datum, puts: &mut Vec<Put>) -> Result<(), Unfit> {
        match (&self.ty, value) {
            (DataType::Array(dims, element), Datum::List(values)) => {
                let places = Layout::places(dims, element);
                if !has_value(&self.ty) || places.len() != values.len() {
                    return Err(Unfit::Type);
                }
                // Adjacent elements are one entry; bits go one by one, so that no neighbour is touched.
                if element.elementary_bits() == Some(1) || Layout::bits(element) != Layout::stride(element) {
                    for (place, value) in places.iter().zip(values) {
                        self.at(place.0, element).put_into(value, puts)?;
                    }
                    return Ok(());
                }
                let row = dims.last().map_or(1, |dim| dim.len()).max(1) as usize;
                for (places, values) in places.chunks(row).zip(values.chunks(row)) {
                    let mut bytes = Vec::new();
                    for value in values {
                        bytes.extend(write(element, value)?);
                    }
                    let at = places.first().map_or(0, |place| place.0);
                    puts.push(Put::Bytes(self.cell.at_bit(self.cell.bit() + at), bytes.into()));
                }
            }
            (DataType::Array(..), _) => return Err(Unfit::Type),
            (DataType::Bool, Datum::Bool(bit)) => {
                puts.push(Put::Value(self.cell, Width::Bit, u32::from(*bit)));
            }
            (ty, value) => puts.push(Put::Bytes(self.cell, write(ty, value)?.into())),
        }
        Ok(())
    }

    fn at(&self, bit: u32, ty: &DataType) -> Self {
        Self { name: String::new(), cell: self.cell.at_bit(self.cell.bit() + bit), ty: ty.clone() }
    }
}

fn has_value(ty: &DataType) -> bool {
    match ty {
        DataType::Array(_, element) => !matches!(**element, DataType::Array(..)) && has_value(element),
        DataType::Struct(_)
        | DataType::BlockDb
        | DataType::BlockFb
        | DataType::BlockFc
        | DataType::BlockSdb
        | DataType::Timer
        | DataType::TimerOrWord => false,
        _ => true,
    }
}

/// A value of a type whose first bit is bit `bit` of the bytes.
pub(crate) fn read(ty: &DataType, bytes: &[u8], bit: u32) -> Option<Datum> {
    let bytes = bytes.get((bit / 8) as usize..)?;
    let take = |len: usize| bytes.get(..len);
    let word = || take(2).and_then(|b| b.try_into().ok()).map(u16::from_be_bytes);
    let dword = || take(4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes);
    Some(match ty {
        DataType::Bool => Datum::Bool(bytes.first()? >> (bit % 8) & 1 != 0),
        DataType::Byte | DataType::Char => Datum::Byte(*bytes.first()?),
        DataType::Word | DataType::Counter => Datum::Word(word()?),
        DataType::Int => Datum::Int(word()? as i16),
        DataType::DWord => Datum::DWord(dword()?),
        DataType::DInt => Datum::DInt(dword()? as i32),
        DataType::Real => Datum::Real(f32::from_bits(dword()?)),
        DataType::S5Time => Datum::Duration(i64::from(S5Time(word()?).to_ms()?)),
        DataType::Time => Datum::Duration(i64::from(dword()? as i32)),
        DataType::TimeOfDay => Datum::Duration(i64::from(dword()?)),
        DataType::Date => Datum::Moment(MS_TO_1990 + i64::from(word()?) * DAY_MS as i64),
        DataType::DateAndTime => {
            let moment = Moment::from_bytes(take(8)?.try_into().ok()?).ok()?;
            Datum::Moment(MS_TO_1990 + moment.ms() as i64)
        }
        DataType::String(most) => {
            let text = take(usize::from(*most) + 2)?;
            // A program may have written any length.
            let len = usize::from(*text.get(1)?).min(usize::from(*most));
            Datum::Text(text.get(2..2 + len)?.iter().map(|byte| char::from(*byte)).collect())
        }
        DataType::Pointer => Datum::Bytes(take(6)?.to_vec()),
        DataType::Any => Datum::Bytes(take(10)?.to_vec()),
        DataType::Array(dims, element) => {
            let places = Layout::places(dims, element);
            Datum::List(places.iter().map(|place| read(element, bytes, place.0)).collect::<Option<_>>()?)
        }
        _ => return None,
    })
}

/// The bytes of a value of a type; a BOOL takes one byte.
pub(crate) fn write(ty: &DataType, value: &Datum) -> Result<Vec<u8>, Unfit> {
    Ok(match (ty, value) {
        (DataType::Bool, Datum::Bool(bit)) => vec![u8::from(*bit)],
        (DataType::Byte | DataType::Char, Datum::Byte(byte)) => vec![*byte],
        (DataType::Word | DataType::Counter, Datum::Word(word)) => word.to_be_bytes().to_vec(),
        (DataType::Int, Datum::Int(int)) => int.to_be_bytes().to_vec(),
        (DataType::DWord, Datum::DWord(dword)) => dword.to_be_bytes().to_vec(),
        (DataType::DInt, Datum::DInt(dint)) => dint.to_be_bytes().to_vec(),
        (DataType::Real, Datum::Real(real)) => real.to_be_bytes().to_vec(),
        (DataType::S5Time, Datum::Duration(ms)) => {
            let time = u32::try_from(*ms).ok().and_then(S5Time::from_ms).ok_or(Unfit::Range)?;
            time.0.to_be_bytes().to_vec()
        }
        (DataType::Time, Datum::Duration(ms)) => i32::try_from(*ms).map_err(|_| Unfit::Range)?.to_be_bytes().to_vec(),
        (DataType::TimeOfDay, Datum::Duration(ms)) => {
            let ms = u32::try_from(*ms).ok().filter(|ms| u64::from(*ms) < DAY_MS).ok_or(Unfit::Range)?;
            ms.to_be_bytes().to_vec()
        }
        (DataType::Date, Datum::Moment(ms)) => {
            let days = (ms - MS_TO_1990).div_euclid(DAY_MS as i64);
            u16::try_from(days).map_err(|_| Unfit::Range)?.to_be_bytes().to_vec()
        }
        (DataType::DateAndTime, Datum::Moment(ms)) => {
            let ms = u64::try_from(ms - MS_TO_1990).map_err(|_| Unfit::Range)?;
            Moment::from_ms(ms).ok_or(Unfit::Range)?.to_bytes().to_vec()
        }
        (DataType::String(most), Datum::Text(text)) => {
            let chars: Vec<u8> = text.chars().map(u8::try_from).collect::<Result<_, _>>().map_err(|_| Unfit::Range)?;
            let len = u8::try_from(chars.len()).ok().filter(|len| len <= most).ok_or(Unfit::Range)?;
            // The rest of the text stays as it is, because the length says where it ends.
            [&[*most, len], chars.as_slice()].concat()
        }
        (DataType::Struct(_) | DataType::Pointer | DataType::Any, _) => return Err(Unfit::Never),
        _ => return Err(Unfit::Type),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::{Area, Dimension, Field};

    fn typed(ty: DataType) -> Typed {
        Typed { name: "x".into(), cell: Cell::Db(1, 160), ty }
    }

    fn list(low: i32, high: i32, element: DataType) -> DataType {
        DataType::Array(vec![Dimension { low, high }], Box::new(element))
    }

    #[test]
    fn what_is_written_is_read_again() {
        let moment = MS_TO_1990 + 36 * 365 * DAY_MS as i64;
        for (ty, value, bytes) in [
            (DataType::Byte, Datum::Byte(7), vec![7]),
            (DataType::Char, Datum::Byte(b'A'), vec![b'A']),
            (DataType::Word, Datum::Word(0x1234), vec![0x12, 0x34]),
            (DataType::Int, Datum::Int(-2), vec![0xFF, 0xFE]),
            (DataType::DWord, Datum::DWord(1), vec![0, 0, 0, 1]),
            (DataType::DInt, Datum::DInt(-1), vec![0xFF; 4]),
            (DataType::Real, Datum::Real(1.5), vec![0x3F, 0xC0, 0, 0]),
            (DataType::S5Time, Datum::Duration(2_000), vec![0x02, 0x00]),
            (DataType::Time, Datum::Duration(-5), vec![0xFF, 0xFF, 0xFF, 0xFB]),
            (DataType::TimeOfDay, Datum::Duration(1), vec![0, 0, 0, 1]),
            (DataType::Date, Datum::Moment(MS_TO_1990 + DAY_MS as i64), vec![0, 1]),
            (DataType::String(4), Datum::Text("Hä".into()), vec![4, 2, b'H', 0xE4]),
            (list(0, 2, DataType::Int), Datum::List([1, 2, 3].map(Datum::Int).into()), vec![0, 1, 0, 2, 0, 3]),
        ] {
            let typed = typed(ty);
            assert_eq!(typed.puts(&value), Ok(vec![Put::Bytes(typed.cell, bytes.clone().into())]), "{typed:?}");
            let mut padded = bytes;
            padded.resize(padded.len() + 8, 0);
            assert_eq!(typed.value(&padded), Some(value), "{typed:?}");
        }
        let when = typed(DataType::DateAndTime);
        let [Put::Bytes(_, bytes)] = &when.puts(&Datum::Moment(moment)).expect("fits")[..] else { panic!("one entry") };
        assert_eq!((bytes[0], when.value(bytes)), (0x25, Some(Datum::Moment(moment))));
    }

    #[test]
    fn values_are_json_and_back() {
        let moment = MS_TO_1990 + 86_400_123;
        for (ty, value, text) in [
            (DataType::Bool, Datum::Bool(true), "true"),
            (DataType::Int, Datum::Int(-7), "-7"),
            (DataType::DWord, Datum::DWord(u32::MAX), "4294967295"),
            (DataType::Real, Datum::Real(0.1), "0.1"),
            (DataType::Real, Datum::Real(f32::NEG_INFINITY), "\"-inf\""),
            (DataType::Time, Datum::Duration(-5), "-5"),
            (DataType::Date, Datum::Moment(moment), "\"1990-01-02T00:00:00.123\""),
            (DataType::String(9), Datum::Text("a\"b".into()), "\"a\\\"b\""),
            (list(0, 1, DataType::Int), Datum::List([1, 2].map(Datum::Int).into()), "[1,2]"),
        ] {
            assert_eq!(value.to_string(), text);
            assert_eq!(Datum::of_json(&serde_json::from_str(text).expect("JSON"), &ty), Ok(value));
        }
        for (ty, text, why) in [
            (DataType::Int, "40000", Unfit::Range),
            (DataType::Int, "1.5", Unfit::Type),
            (DataType::Bool, "2", Unfit::Type),
            (DataType::Word, "-1", Unfit::Range),
            (DataType::Real, "1e39", Unfit::Range),
            (DataType::Real, "\"-1e39\"", Unfit::Type),
            (DataType::Date, "\"2026-02-30\"", Unfit::Type),
            (DataType::DateAndTime, "\"2026-01-01T24:00:00\"", Unfit::Type),
            (DataType::DateAndTime, "\"2026-01-01T00:00:00.\u{e4}\"", Unfit::Type),
            (DataType::Any, "\"00\"", Unfit::Never),
            (list(0, 1, DataType::Int), "1", Unfit::Type),
        ] {
            assert_eq!(Datum::of_json(&serde_json::from_str(text).expect("JSON"), &ty), Err(why), "{text}");
        }
        assert_eq!(Datum::of_json(&json!(1), &DataType::Bool), Ok(Datum::Bool(true)));
    }

    #[test]
    fn bits_touch_nothing_beside_them() {
        let bit = Typed { name: "x".into(), cell: Cell::Area(Area::Memory, 13), ty: DataType::Bool };
        assert_eq!(bit.piece(), Some(Piece::Bytes { at: Cell::Area(Area::Memory, 8), len: 1 }));
        assert_eq!(bit.value(&[0x20]), Some(Datum::Bool(true)));
        assert_eq!(bit.puts(&Datum::Bool(true)), Ok(vec![Put::Value(bit.cell, Width::Bit, 1)]));
        let bits = typed(list(1, 3, DataType::Bool));
        let puts = bits.puts(&Datum::List([true, false, true].map(Datum::Bool).into())).expect("fits");
        assert_eq!(puts[2], Put::Value(Cell::Db(1, 162), Width::Bit, 1));
        assert_eq!(bits.value(&[5, 0]), Some(Datum::List([true, false, true].map(Datum::Bool).into())));
        let many = |count: usize| {
            let bits = typed(list(1, count as i32, DataType::Bool));
            bits.puts(&Datum::List(vec![Datum::Bool(true); count])).map(|puts| puts.len())
        };
        assert_eq!(many(GROUP_ENTRIES), Ok(GROUP_ENTRIES));
        assert_eq!(many(GROUP_ENTRIES + 1), Err(Unfit::TooLong));
    }

    #[test]
    fn timers_counters_and_peripherals_are_values() {
        let timer = Typed { name: "T2".into(), cell: Cell::Timer(2), ty: DataType::S5Time };
        assert_eq!(timer.piece(), Some(Piece::Value(timer.cell, Width::Word)));
        assert_eq!(timer.value(&[0x02, 0x00]), Some(Datum::Duration(2_000)));
        assert_eq!(timer.puts(&Datum::Duration(2_000)), Ok(vec![Put::Value(timer.cell, Width::Word, 0x200)]));
        let input = Typed { name: "PEB".into(), cell: Cell::Peripheral(2051), ty: DataType::Byte };
        assert_eq!(input.value(&[9]), Some(Datum::Byte(9)), "the bit of a byte's address is no shift");
    }

    #[test]
    fn what_is_no_value_is_none_and_what_does_not_fit_is_refused() {
        let field = Field { name: "a".into(), ty: DataType::Int, initial: None };
        assert_eq!(typed(DataType::Struct(vec![field.clone()])).piece(), None);
        assert_eq!(typed(list(0, 1, DataType::Struct(vec![field]))).piece(), None);
        assert_eq!(typed(DataType::DateAndTime).value(&[0x25, 0x02, 0x31, 0, 0, 0, 0, 0]), None);
        assert_eq!(typed(DataType::S5Time).value(&[0x0F, 0xFF]), None);
        assert_eq!(typed(DataType::Real).value(&[0, 0, 0]), None, "too few bytes");
        assert_eq!(typed(DataType::String(2)).value(&[2, 200, b'a', b'b']), Some(Datum::Text("ab".into())));
        for (ty, value, why) in [
            (DataType::Int, Datum::Word(1), Unfit::Type),
            (DataType::String(2), Datum::Text("abc".into()), Unfit::Range),
            (DataType::String(2), Datum::Text("€".into()), Unfit::Range),
            (DataType::S5Time, Datum::Duration(-1), Unfit::Range),
            (DataType::S5Time, Datum::Duration(i64::MAX), Unfit::Range),
            (DataType::TimeOfDay, Datum::Duration(DAY_MS as i64), Unfit::Range),
            (DataType::Date, Datum::Moment(0), Unfit::Range),
            (DataType::DateAndTime, Datum::Moment(i64::MIN / 2), Unfit::Range),
            (DataType::Any, Datum::Bytes(vec![0; 10]), Unfit::Never),
            (list(0, 1, DataType::Int), Datum::List(vec![Datum::Int(1)]), Unfit::Type),
            (list(0, 1, DataType::Int), Datum::Int(1), Unfit::Type),
        ] {
            assert_eq!(typed(ty.clone()).puts(&value), Err(why), "{ty:?} {value:?}");
        }
    }
}
