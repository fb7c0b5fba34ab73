//! Constants: as written, and as the bits a cell of a given type stores.

use ob1_ir::compose::ANY_TYPES;
use ob1_model::bcd::to_bcd;
use ob1_model::{Area, BitAddr, DataType, Layout, S5Time};

use crate::parse_types::simple_type;
use crate::source::to_byte;
use crate::time;
use crate::type_words::with_article;

/// A constant as written.
#[derive(Clone, Debug, PartialEq)]
pub enum Constant {
    /// A BOOL: `TRUE` or `FALSE`.
    Bool(bool),
    /// A decimal number without prefix.
    Integer(i64),
    /// A DINT with its prefix `L#`.
    DInt(i32),
    /// `B#16#`, `W#16#`, `DW#16#`, `B#(..)`: value and its width in bits.
    Bits(u32, u8),
    /// `2#`, `16#`: as wide as it is used.
    Radix(u32),
    /// `C#`: three BCD digits.
    Count(u16),
    Real(f32),
    S5Time(u16),
    /// `T#`: milliseconds, with sign.
    Time(i32),
    /// `D#`: days since 1990-01-01.
    Date(u16),
    /// `TOD#`: milliseconds since midnight.
    TimeOfDay(u32),
    DateTime([u8; 8]),
    /// `DTL#`: the 12 bytes of TIA Portal's date and time.
    Dtl([u8; 12]),
    /// A text in quotes: characters in CP1252.
    Text(Vec<u8>),
    Pointer(PointerConstant),
    /// `P##name` of a function's own parameter.
    ToParam {
        index: u16,
        kind: ToParam,
    },
}

/// What `P##` of a function's parameter points to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToParam {
    /// The elementary actual itself.
    Actual,
    /// A POINTER to the composed actual, in the local data.
    Pointer,
    /// A copy of so many bytes in the local data: of the actual that is a POINTER (6) or ANY (10).
    Copy(u8),
}

/// `P#12.0`, `P#M 3.0`, `P#DB10.DBX0.0 BYTE 12`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointerConstant {
    /// The area; `None`: an area-internal pointer.
    pub area: Option<Area>,
    pub at: BitAddr,
    /// 0 when no data block is named.
    pub db: u16,
    /// Type code and number of elements of an ANY.
    pub any: Option<(u8, u16)>,
    /// The same of the component it points to, where it names one.
    pub own: Option<(u8, u16)>,
}

impl PointerConstant {
    /// The 32-bit pointer: area code, byte and bit.
    pub fn bits(self) -> u32 {
        self.area.map_or(0, |a| u32::from(a.pointer_code()) << 24) | self.at.0
    }

    /// The 6 bytes of a POINTER: data block, pointer.
    pub fn pointer_bytes(self) -> Vec<u8> {
        [&self.db.to_be_bytes()[..], &self.bits().to_be_bytes()].concat()
    }

    /// How many bits an ANY names; `None`: elements without a length of their own.
    pub fn any_bits(self) -> Option<u64> {
        let (code, count) = self.any_or_byte();
        let (name, _) = ANY_TYPES.iter().find(|(_, known)| *known == code)?;
        let ty = simple_type(name).filter(|ty| !ty.is_parameter_type())?;
        Some(u64::from(Layout::bits(&ty)) * u64::from(count))
    }

    /// One BYTE when no type is written.
    fn any_or_byte(self) -> (u8, u16) {
        self.any.or(self.own).unwrap_or((2, 1))
    }

    /// The 10 bytes of an ANY: 10h, type, count, data block, pointer.
    pub fn any_bytes(self) -> Vec<u8> {
        let (code, count) = self.any_or_byte();
        if code == 0 {
            // The null pointer, P#P 0.0 VOID 0, has nothing but its first byte.
            return [&[0x10][..], &[0; 9]].concat();
        }
        [&[0x10, code], &count.to_be_bytes()[..], &self.pointer_bytes()].concat()
    }
}

/// The ANY of a timer, counter or block: type code, number ["ANY Format for Parameter Types": the count is 1, bytes 4,
/// 5 and 7 are 0, byte 6 repeats the type].
pub(crate) fn any_of_number(code: u8, number: u16) -> Vec<u8> {
    let [high, low] = number.to_be_bytes();
    vec![0x10, code, 0, 1, 0, 0, code, 0, high, low]
}

/// Parses a number without sign, or a constant with prefix. The error is the sentence to report.
pub(crate) fn parse(text: &str, negative: bool) -> Result<Constant, String> {
    let Some((prefix, body)) = text.split_once('#') else { return number(text, negative) };
    let wrong = |what: &str| Err(format!("{} is no {what}", clip(text)));
    match prefix.to_ascii_uppercase().as_str() {
        "BOOL" => match body.to_ascii_uppercase().as_str() {
            "TRUE" | "1" => Ok(Constant::Bool(true)),
            "FALSE" | "0" => Ok(Constant::Bool(false)),
            _ => wrong("truth value, BOOL#TRUE or BOOL#FALSE"),
        },
        "REAL" => number(body, false).map(|c| if let Constant::Integer(v) = c { Constant::Real(v as f32) } else { c }),
        "SINT" | "USINT" | "UINT" | "UDINT" => unsigned(prefix, body),
        "2" | "16" | "8" if !negative => match radix(prefix, body) {
            Some(value) => Ok(Constant::Radix(value)),
            None => wrong("number of at most 32 bits"),
        },
        "B" | "BYTE" => hex(body, 8).map_or_else(|| wrong("byte, B#16#0 to B#16#FF"), |v| Ok(Constant::Bits(v, 8))),
        "W" | "WORD" => hex(body, 16).map_or_else(|| wrong("word, W#16#0 to W#16#FFFF"), |v| Ok(Constant::Bits(v, 16))),
        "DW" | "DWORD" => {
            hex(body, 32).map_or_else(|| wrong("double word, DW#16#0 to DW#16#FFFFFFFF"), |v| Ok(Constant::Bits(v, 32)))
        }
        "L" | "DINT" => decimal(body).map_or_else(|| wrong("double integer"), |v| Ok(Constant::DInt(v))),
        "INT" => decimal(body).map_or_else(|| wrong("integer"), |v| Ok(Constant::Integer(i64::from(v)))),
        "C" => match plain(body).filter(|v| *v <= 999) {
            Some(v) => Ok(Constant::Count(to_bcd(v) as u16)),
            None => wrong("counter value, C#0 to C#999"),
        },
        "S5T" | "S5TIME" => {
            let time = time::duration(body).and_then(|ms| u32::try_from(ms).ok()).and_then(S5Time::from_ms);
            time.map_or_else(|| wrong("S5 time, S5T#10MS to S5T#2H46M30S"), |t| Ok(Constant::S5Time(t.0)))
        }
        "T" | "TIME" => time::signed_duration(body)
            .map_or_else(|| wrong("time, T#-24D20H31M23S648MS to T#24D20H31M23S647MS"), |ms| Ok(Constant::Time(ms))),
        "D" | "DATE" => {
            time::date(body).map_or_else(|| wrong("date, D#1990-1-1 to D#2168-12-31"), |d| Ok(Constant::Date(d)))
        }
        "TOD" | "TIME_OF_DAY" => time::time_of_day(body)
            .map_or_else(|| wrong("time of day, TOD#0:0:0.0 to TOD#23:59:59.999"), |ms| Ok(Constant::TimeOfDay(ms))),
        "DTL" => time::dtl(body)
            .map_or_else(|| wrong("date and time, DTL#1970-1-1-0:0:0.0"), |bytes| Ok(Constant::Dtl(bytes))),
        "DT" | "DATE_AND_TIME" => time::date_and_time(body)
            .map_or_else(|| wrong("date and time, DT#90-1-1-0:0:0.0"), |bytes| Ok(Constant::DateTime(bytes))),
        _ => wrong("constant"),
    }
}

/// A whole number with the name of a type of TIA Portal, in its own range.
fn unsigned(prefix: &str, body: &str) -> Result<Constant, String> {
    let (low, high, bits) = match prefix.to_ascii_uppercase().as_str() {
        "SINT" => (-128, 127, 8),
        "USINT" => (0, 0xFF, 8),
        "UINT" => (0, 0xFFFF, 16),
        _ => (0, 0xFFFF_FFFF, 32),
    };
    let value = match body.split_once('#') {
        Some((base @ ("2" | "8" | "16"), digits)) => radix(base, digits).map(i64::from),
        _ => body.replace('_', "").parse().ok(),
    };
    match value.filter(|v| (low..=high).contains(v)) {
        Some(value) => Ok(Constant::Bits(value as u32 & (u32::MAX >> (32 - bits)), bits)),
        None => Err(format!("{prefix}#{} is not from {low} to {high}", clip(body))),
    }
}

fn clip(text: &str) -> String {
    text.chars().take(40).collect()
}

fn number(text: &str, negative: bool) -> Result<Constant, String> {
    let digits = text.replace('_', "");
    if digits.contains(['.', 'e', 'E']) {
        let value: f32 = digits.parse().map_err(|_| format!("{} is not a real number", clip(text)))?;
        if value.is_infinite() {
            return Err(format!("{} is beyond the largest real number, 3.402823e+38", clip(text)));
        }
        let mantissa = digits.split(['e', 'E']).next().unwrap_or("");
        if value == 0.0 && mantissa.bytes().any(|b| (b'1'..=b'9').contains(&b)) {
            return Err(format!("{} is below the smallest real number, 1.175495e-38", clip(text)));
        }
        return Ok(Constant::Real(if negative { -value } else { value }));
    }
    match digits.parse::<i64>() {
        Ok(value) => Ok(Constant::Integer(if negative { -value } else { value })),
        Err(_) => Err(format!("{} is not a number of at most 32 bits", clip(text))),
    }
}

fn radix(prefix: &str, body: &str) -> Option<u32> {
    u32::from_str_radix(&body.replace('_', ""), prefix.parse().ok()?).ok()
}

/// `16#FF`, `2#01` or decimal digits, within `bits`.
fn hex(body: &str, bits: u32) -> Option<u32> {
    let value = match body.split_once('#') {
        Some((prefix @ ("16" | "2" | "8"), digits)) => radix(prefix, digits)?,
        Some(_) => return None,
        None => plain(body)?,
    };
    (bits == 32 || value >> bits == 0).then_some(value)
}

fn plain(body: &str) -> Option<u32> {
    body.replace('_', "").parse().ok()
}

fn decimal(body: &str) -> Option<i32> {
    body.replace('_', "").parse().ok()
}

/// Characters of a text between its quotes, before which `CHAR#` may stand; `$` escapes as in STEP 7.
pub(crate) fn text(quoted: &str) -> Result<Vec<u8>, String> {
    let inner = quoted.split_once('\'').map_or(quoted, |(_, inner)| inner);
    let inner = inner.strip_suffix('\'').unwrap_or(inner);
    let mut out = Vec::with_capacity(inner.len());
    let mut chars = inner.chars();
    while let Some(c) = chars.next() {
        let c = match c {
            '$' => match chars.next() {
                Some('L' | 'l') => '\n',
                // A new line is two characters.
                Some('N' | 'n') => {
                    out.push(b'\r');
                    '\n'
                }
                Some('P' | 'p') => '\u{c}',
                Some('R' | 'r') => '\r',
                Some('T' | 't') => '\t',
                Some(high) if high.is_ascii_hexdigit() => {
                    let low = chars.next().and_then(|c| c.to_digit(16));
                    let byte = low.and_then(|low| Some(high.to_digit(16)? * 16 + low));
                    out.push(
                        byte.ok_or_else(|| "a character code after $ has two hexadecimal digits".to_owned())? as u8
                    );
                    continue;
                }
                Some(other) => other,
                None => '$',
            },
            c => c,
        };
        out.push(to_byte(c).ok_or_else(|| format!("{c} is not a character of the S7 (CP1252, CP1250 or CP1251)"))?);
    }
    Ok(out)
}

/// What a constant becomes in a cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Encoded {
    /// An elementary value, right-aligned.
    Bits(u32),
    /// A composed value, laid out.
    Bytes(Vec<u8>),
}

impl Constant {
    /// Its value, when it is a whole number.
    pub fn whole(&self) -> Option<i32> {
        match self {
            Constant::Integer(v) => i32::try_from(*v).ok(),
            Constant::DInt(v) => Some(*v),
            Constant::Bits(v, _) | Constant::Radix(v) => i32::try_from(*v).ok(),
            _ => None,
        }
    }

    /// What `L` puts into ACCU1. An integer without prefix is 16 bits wide and not sign-extended.
    pub fn load(&self) -> Result<u32, String> {
        Ok(match self {
            Constant::Integer(v) => match i16::try_from(*v) {
                Ok(v) => u32::from(v as u16),
                // What does not fit an integer is a double integer, as STEP 7's editor takes it: L 100000 is
                // L L#100000.
                Err(_) => i32::try_from(*v).map_err(|_| format!("{v} does not fit 32 bits"))? as u32,
            },
            Constant::DInt(v) | Constant::Time(v) => *v as u32,
            Constant::Bits(v, _) | Constant::Radix(v) | Constant::TimeOfDay(v) => *v,
            Constant::Count(v) | Constant::S5Time(v) | Constant::Date(v) => u32::from(*v),
            Constant::Real(v) => v.to_bits(),
            Constant::Text(bytes) if (1..=4).contains(&bytes.len()) => {
                bytes.iter().fold(0, |acc, b| acc << 8 | u32::from(*b))
            }
            Constant::Text(_) => return Err("L takes a text of 1 to 4 characters".into()),
            Constant::Pointer(p) if p.any.is_none() && p.db == 0 => p.bits(),
            Constant::Pointer(_) => return Err("L takes a pointer without data block and length: P#DBX 0.0".into()),
            Constant::Bool(_) => return Err("a truth value cannot be loaded; use SET or CLR".into()),
            Constant::Dtl(_) => return Err("a DTL has 12 bytes and cannot be loaded".into()),
            Constant::DateTime(_) => return Err("a date and time has 8 bytes and cannot be loaded".into()),
            Constant::ToParam { .. } => return Err("only L and LAR1 take a pointer to a parameter".into()),
        })
    }

    /// The constant as a value of type `ty`; the error says why it is not one.
    pub fn encode(&self, ty: &DataType) -> Result<Encoded, String> {
        let encoded = match ty {
            DataType::Bool => match self {
                Constant::Bool(v) => Some(u32::from(*v)),
                Constant::Integer(v @ (0 | 1)) => Some(*v as u32),
                Constant::Radix(v @ (0 | 1)) | Constant::Bits(v @ (0 | 1), _) => Some(*v),
                _ => None,
            },
            DataType::Byte | DataType::Char => self.byte(),
            DataType::Word | DataType::Int | DataType::S5Time | DataType::Date | DataType::TimerOrWord => {
                if let (Constant::Integer(v), DataType::Word) = (self, ty)
                    && let Ok(v) = u16::try_from(*v)
                {
                    return Ok(Encoded::Bits(u32::from(v)));
                }
                return self.word(ty).map(Encoded::Bits);
            }
            DataType::DWord | DataType::DInt | DataType::Time | DataType::TimeOfDay => self.double_word(ty),
            DataType::Real => match self {
                Constant::Real(v) => Some(v.to_bits()),
                _ => None,
            },
            _ => return self.composed(ty).map(Encoded::Bytes).ok_or_else(|| refusal(ty)),
        };
        encoded.map(Encoded::Bits).ok_or_else(|| refusal(ty))
    }

    fn byte(&self) -> Option<u32> {
        match self {
            Constant::Bits(v, 8) => Some(*v),
            Constant::Radix(v) if *v <= 0xFF => Some(*v),
            Constant::Integer(v) => {
                i16::try_from(*v).ok().filter(|v| (-128..=255).contains(v)).map(|v| u32::from(v as u8))
            }
            Constant::Text(bytes) if bytes.len() == 1 => bytes.first().map(|b| u32::from(*b)),
            _ => None,
        }
    }

    fn word(&self, ty: &DataType) -> Result<u32, String> {
        Ok(match self {
            Constant::Integer(v) => u32::from(int16(*v)?),
            Constant::Bits(v, 8 | 16) => *v,
            Constant::Radix(v) if *v <= 0xFFFF => *v,
            Constant::Count(v) | Constant::S5Time(v) | Constant::Date(v) => u32::from(*v),
            _ => return Err(refusal(ty)),
        })
    }

    fn double_word(&self, ty: &DataType) -> Option<u32> {
        match self {
            Constant::Integer(v) if *ty == DataType::DWord && *v >= 0 => u32::try_from(*v).ok(),
            Constant::Integer(v) => i32::try_from(*v).ok().map(|v| v as u32),
            Constant::DInt(v) | Constant::Time(v) => Some(*v as u32),
            Constant::Bits(v, _) | Constant::Radix(v) | Constant::TimeOfDay(v) => Some(*v),
            Constant::Pointer(p) if p.any.is_none() && p.db == 0 => Some(p.bits()),
            _ => None,
        }
    }

    fn composed(&self, ty: &DataType) -> Option<Vec<u8>> {
        match (self, ty) {
            (Constant::DateTime(bytes), DataType::DateAndTime) => Some(bytes.to_vec()),
            (Constant::Dtl(bytes), ty) if *ty == crate::tia::dtl() => Some(bytes.to_vec()),
            (Constant::Text(text), DataType::String(max)) if text.len() <= usize::from(*max) => {
                let mut bytes = vec![*max, text.len() as u8];
                bytes.extend_from_slice(text);
                bytes.resize(Layout::bits(ty) as usize / 8, 0);
                Some(bytes)
            }
            (Constant::Pointer(p), DataType::Pointer) if p.any.is_none() && p.area.is_some() => Some(p.pointer_bytes()),
            (Constant::Pointer(p), DataType::Any) if p.area.is_some() => Some(p.any_bytes()),
            _ => None,
        }
    }
}

/// -32768 to 32767 as a word.
fn int16(value: i64) -> Result<u16, String> {
    i16::try_from(value).map(|v| v as u16).map_err(|_| {
        format!("{value} does not fit 16 bits, -32768 to 32767; write L#{value} for a double integer, W#16# for a word")
    })
}

fn refusal(ty: &DataType) -> String {
    let example = match ty {
        DataType::Bool => "TRUE or FALSE",
        DataType::Byte => "B#16#0 to B#16#FF",
        DataType::Char => "one character, 'A'",
        DataType::Word => "W#16#0 to W#16#FFFF",
        DataType::Int => "-32768 to 32767",
        DataType::DWord => "DW#16#0 to DW#16#FFFFFFFF",
        DataType::DInt => "L#5",
        DataType::Real => "1.0 (with its decimal point)",
        DataType::S5Time => "S5T#2S",
        DataType::Time => "T#2S",
        DataType::Date => "D#1994-3-15",
        DataType::TimeOfDay => "TOD#12:30:0.0",
        DataType::DateAndTime => "DT#94-3-15-12:30:0.0",
        DataType::String(_) => "a text in quotes, not longer than the STRING",
        DataType::Pointer => "P#M 3.0",
        DataType::Any => "P#DB10.DBX0.0 BYTE 12",
        _ => "no constant",
    };
    format!("{} takes {example}", with_article(ty.name()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_l_loads() {
        for (text, accu1) in [
            ("5", 5),
            ("W#16#0FF0", 0x0FF0),
            ("B#16#6B", 0x6B),
            ("DW#16#1234_5678", 0x1234_5678),
            ("2#0101", 5),
            ("L#-1", 0xFFFF_FFFF),
            ("L#12345", 12_345),
            ("S5T#2S500MS", 0x0250),
            ("S5T#100MS", 0x0010),
            ("T#1D_2H", 26 * 3_600_000),
            ("C#127", 0x127),
            ("D#1990-1-2", 1),
            ("TOD#1:00:00.5", 3_600_500),
            ("1.5", 0x3FC0_0000),
        ] {
            let got = parse(text, false).and_then(|c| c.load());
            assert_eq!(got, Ok(accu1), "{text}");
        }
        assert_eq!(parse("5", true).and_then(|c| c.load()), Ok(0xFFFB));
        assert_eq!(Constant::Text(b"AB".to_vec()).load(), Ok(0x4142));
    }

    #[test]
    fn what_does_not_fit_is_refused_with_its_range() {
        for (text, part) in [
            ("4000000000", "32 bits"),
            ("W#16#12345", "W#16#FFFF"),
            ("B#16#100", "B#16#FF"),
            ("S5T#3H", "2H46M30S"),
            ("C#1000", "C#999"),
            ("D#1989-1-1", "1990"),
            ("99999999999999999999", "number"),
            ("1e99", "largest"),
            ("1.5e-60", "smallest"),
            ("W#16#", "W#16#FFFF"),
        ] {
            let error = parse(text, false).and_then(|c| c.load()).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn texts_and_strings() {
        assert_eq!(text("'a$'b$0Aä'"), Ok(b"a'b\n\xE4".to_vec()));
        assert_eq!(text("'$L$N$r$P$t$$'"), Ok(b"\n\r\n\r\x0C\t$".to_vec()));
        let string = Constant::Text(b"ab".to_vec()).encode(&DataType::String(3));
        assert_eq!(string, Ok(Encoded::Bytes(vec![3, 2, b'a', b'b', 0, 0])));
        assert!(Constant::Text(b"abcd".to_vec()).encode(&DataType::String(3)).is_err());
    }

    #[test]
    fn pointers() {
        let p = PointerConstant { area: Some(Area::Memory), at: BitAddr::new(3, 0), db: 0, any: None, own: None };
        assert_eq!(p.bits(), 0x8300_0018);
        let any =
            PointerConstant { area: Some(Area::Db), at: BitAddr::new(0, 0), db: 10, any: Some((2, 12)), own: None };
        assert_eq!(any.any_bytes(), [0x10, 2, 0, 12, 0, 10, 0x84, 0, 0, 0]);
        let null =
            PointerConstant { area: Some(Area::Peripheral), at: BitAddr(0), db: 0, any: Some((0, 0)), own: None };
        assert_eq!(null.any_bytes(), [0x10, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(any_of_number(0x1D, 300), [0x10, 0x1D, 0, 1, 0, 0, 0x1D, 0, 1, 44]);
    }
}
