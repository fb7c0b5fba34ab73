//! Constants as text.

use std::fmt::Write as _;

use ob1_ir::Notation;
use ob1_ir::compose::ANY_TYPES;
use ob1_model::{Area, BitAddr, DataType, Layout, S5Time};

use super::printer::Printer;
use crate::constant::any_of_number;
use crate::identifiers::Identifier;
use crate::time;

/// The constant that stands for laid-out bytes of a type; `None` where there is none: NaN, times of a second form,
/// texts whose lengths are wrong, structures.
pub fn constant(ty: &DataType, bytes: &[u8]) -> Option<String> {
    let value = || {
        let wanted = ty.elementary_bits()?.div_ceil(8) as usize;
        (bytes.len() == wanted).then(|| bytes.iter().fold(0u32, |n, b| n << 8 | u32::from(*b)))
    };
    match ty {
        DataType::String(max) => {
            let (head, rest) = bytes.split_at_checked(2)?;
            let (used, padding) = rest.split_at_checked(usize::from(*head.get(1)?))?;
            let whole = head.first() == Some(max) && bytes.len() == Layout::bits(ty) as usize / 8;
            (whole && used.len() <= usize::from(*max) && padding.iter().all(|b| *b == 0)).then(|| text(used))
        }
        DataType::DateAndTime => {
            let written = time::written_date_and_time(bytes)?;
            (time::date_and_time(&written)?.as_slice() == bytes).then(|| format!("DT#{written}"))
        }
        _ => elementary(ty, value()?),
    }
}

/// A constant of an elementary type.
pub(super) fn elementary(ty: &DataType, value: u32) -> Option<String> {
    let notation = match ty {
        DataType::Bool => return Some(if value & 1 == 1 { "TRUE" } else { "FALSE" }.to_owned()).filter(|_| value < 2),
        DataType::Char => return u8::try_from(value).ok().map(|byte| text(&[byte])),
        DataType::Byte => Notation::Byte,
        DataType::Int => Notation::Int,
        DataType::DWord => Notation::DWord,
        DataType::DInt => Notation::DInt,
        DataType::Real => Notation::Real,
        DataType::S5Time => Notation::S5Time,
        DataType::Time => Notation::Time,
        DataType::Date => Notation::Date,
        DataType::TimeOfDay => Notation::TimeOfDay,
        _ => Notation::Word,
    };
    noted(notation, value).or_else(|| match ty {
        // A word stands for any 16 bits.
        DataType::S5Time | DataType::Date | DataType::Word | DataType::Int | DataType::TimerOrWord => {
            noted(Notation::Word, value)
        }
        DataType::Time | DataType::TimeOfDay => noted(Notation::DWord, value),
        _ => None,
    })
}

/// A value in a notation; `None` where that notation does not give this very value.
pub(super) fn noted(notation: Notation, value: u32) -> Option<String> {
    let word = u16::try_from(value).ok();
    Some(match notation {
        Notation::Byte => format!("B#16#{:X}", u8::try_from(value).ok()?),
        Notation::Word => format!("W#16#{:X}", word?),
        Notation::DWord => format!("DW#16#{value:X}"),
        Notation::Binary => format!("2#{value:b}"),
        Notation::Int => (word? as i16).to_string(),
        Notation::DInt => format!("L#{}", value as i32),
        Notation::Real => real(value)?,
        Notation::Text => {
            let bytes = value.to_be_bytes();
            let used: Vec<u8> = bytes.into_iter().skip_while(|b| *b == 0).collect();
            if used.is_empty() {
                return None;
            }
            text(&used)
        }
        Notation::Bytes => {
            let bytes = value.to_be_bytes();
            let used = bytes.get(if word.is_some() { 2 } else { 0 }..).unwrap_or_default();
            format!("B#({})", used.iter().map(u8::to_string).collect::<Vec<_>>().join(","))
        }
        Notation::Count => {
            let digits = [8, 4, 0].map(|shift| value >> shift & 15);
            let decimal = value >> 12 == 0 && digits.iter().all(|d| *d < 10);
            decimal.then(|| format!("C#{}", digits.iter().fold(0, |n, d| n * 10 + d)))?
        }
        Notation::Date => format!("D#{}", time::written_date(word?)?),
        Notation::S5Time => {
            let ms = S5Time(word?).to_ms()?;
            // The same time in another base is another word.
            (S5Time::from_ms(ms) == word.map(S5Time))
                .then(|| format!("S5T#{}", time::written_duration(i64::from(ms))))?
        }
        Notation::Time => format!("T#{}", time::written_duration(i64::from(value as i32))),
        Notation::TimeOfDay => format!("TOD#{}", time::written_time_of_day(value)?),
        Notation::Pointer => return None,
    })
}

/// A number with its point; NaN and infinity have no form.
fn real(bits: u32) -> Option<String> {
    let value = f32::from_bits(bits);
    let text = format!("{value:e}");
    let (mantissa, exponent) = text.split_once('e')?;
    let point = if mantissa.contains('.') { "" } else { ".0" };
    value.is_finite().then(|| format!("{mantissa}{point}e{exponent}"))
}

/// Characters in quotes; what is not printable ASCII by its code.
pub(super) fn text(bytes: &[u8]) -> String {
    let mut out = String::from("'");
    for byte in bytes {
        match byte {
            b'\'' | b'$' => out.extend(['$', char::from(*byte)]),
            b' '..=b'~' => out.push(char::from(*byte)),
            _ => {
                let _ = write!(out, "${byte:02X}");
            }
        }
    }
    out.push('\'');
    out
}

impl Printer<'_> {
    /// The constant of `L`: in its notation, else as a number.
    pub(super) fn loaded(&self, notation: Option<Notation>, value: u32) -> String {
        let noted = match notation {
            Some(Notation::Pointer) => self.pointer(value, 0),
            Some(notation) => noted(notation, value),
            None => None,
        };
        noted.unwrap_or_else(|| match value {
            0..=0x7FFF => value.to_string(),
            0x8000..=0xFFFF => format!("W#16#{value:X}"),
            _ => format!("DW#16#{value:X}"),
        })
    }

    /// `P#M 1.0`, `P#DB10.DBX 0.0`; `None` where the bits name no area or more than an address.
    pub(super) fn pointer(&self, bits: u32, db: u16) -> Option<String> {
        let at = BitAddr(bits & 0x00FF_FFFF);
        if at.byte() > BitAddr::MAX_BYTE {
            return None;
        }
        let code = (bits >> 24) as u8;
        if code == 0 {
            return (db == 0).then(|| format!("P#{at}"));
        }
        let area = Area::from_pointer_code(code)?;
        let name = match area {
            Area::Peripheral => "P",
            Area::PreviousLocal => "V",
            area => self.identifier(Identifier::Memory(area, ob1_ir::Width::Bit), false)?,
        };
        match (db, area) {
            (0, _) => Some(format!("P#{name} {at}")),
            (db, Area::Db) => Some(format!("P#DB{db}.{name} {at}")),
            _ => None,
        }
    }

    /// The 6 bytes of a POINTER or the 10 of an ANY.
    pub(super) fn pointer_bytes(&self, bytes: &[u8]) -> Option<String> {
        let double = |at: usize| bytes.get(at..at + 4).map(|b| b.iter().fold(0u32, |n, b| n << 8 | u32::from(*b)));
        let word = |at: usize| bytes.get(at..at + 2).map(|b| u16::from_be_bytes([b[0], b[1]]));
        match bytes.len() {
            // A pointer without area has no bytes of its own.
            6 => self.pointer(double(2)?, word(0)?).filter(|_| double(2).is_some_and(|p| p >> 24 != 0)),
            10 => {
                let (code, count) = (*bytes.get(1)?, word(2)?);
                let number = word(8)?;
                let of_number = [(0x1D, "T"), (0x1C, "C"), (0x19, "DB"), (0x18, "FC"), (0x17, "FB")];
                if let Some((_, letters)) = of_number.iter().find(|(c, _)| any_of_number(*c, number) == bytes) {
                    let letters = match *letters {
                        "C" => self.identifier(Identifier::Counter, false)?,
                        other => other,
                    };
                    return Some(format!("{letters} {number}"));
                }
                if code == 0 {
                    return (bytes == [0x10, 0, 0, 0, 0, 0, 0, 0, 0, 0]).then(|| "P#P 0.0 VOID 0".to_owned());
                }
                let (name, _) = ANY_TYPES.iter().find(|(_, c)| *c == code)?;
                let pointer = self.pointer(double(6)?, word(4)?).filter(|_| double(6).is_some_and(|p| p >> 24 != 0))?;
                (bytes.first() == Some(&0x10)).then(|| format!("{pointer} {name} {count}"))
            }
            _ => None,
        }
    }
}
