//! Values as text and JSON, both ways.

use ob1_model::{DataType, Width};
use serde_json::{Value, json};

use crate::datum::real;
use crate::{Item, Reading};

/// The bits of a cell as JSON: a boolean, a whole number, or a real.
#[must_use]
pub fn to_json(item: &Item, bits: u32) -> Value {
    match item.reading {
        Reading::Bool => json!(bits != 0),
        Reading::Unsigned => json!(bits),
        Reading::Signed => json!(match item.width {
            Width::Bit | Width::Byte => i32::from(bits as u8 as i8),
            Width::Word => i32::from(bits as u16 as i16),
            Width::DWord => bits as i32,
        }),
        // JSON has no infinities; they become a word.
        Reading::Real => real(f32::from_bits(bits)),
    }
}

/// The bits of a value given as JSON: a boolean, a number, or a text in the notation of STL.
///
/// # Errors
/// The error in it, in one sentence.
pub fn from_json(item: &Item, value: &Value) -> Result<u32, String> {
    match value {
        Value::Bool(bit) => fit(item, i64::from(*bit)),
        Value::Number(number) => {
            let unfit = || format!("{number} does not fit {}, a {}", item.name, item.ty.name());
            match (number.as_i64(), number.as_f64()) {
                (_, Some(number)) if item.reading == Reading::Real => {
                    narrowed(number).map(f32::to_bits).ok_or_else(unfit)
                }
                (Some(number), _) => fit(item, number),
                // A double word without a type may be a REAL.
                (None, Some(number)) if item.ty == DataType::DWord => {
                    narrowed(number).map(f32::to_bits).ok_or_else(unfit)
                }
                _ => Err(unfit()),
            }
        }
        Value::String(text) => from_text(item, text),
        other => Err(format!("{other} is not a value for {}", item.name)),
    }
}

/// The bits of a value as text: `1`, `true`, `-5`, `16#1A`, `2#1010`, `1.5`, and every constant of STL.
///
/// # Errors
/// The error in it, in one sentence.
pub fn from_text(item: &Item, text: &str) -> Result<u32, String> {
    let upper: String = text.trim().to_ascii_uppercase().chars().filter(|c| *c != '_').collect();
    let wrong = || {
        let forms = forms(item);
        format!("\"{text}\" is not a value for {}, which is {}; write {forms}", item.name, item.ty.name())
    };
    let plain = ["DW#16#", "W#16#", "B#16#", "16#"].into_iter().find_map(|prefix| upper.strip_prefix(prefix));
    if let Some(hex) = plain {
        let bits = u32::from_str_radix(hex, 16).map_err(|_| wrong())?;
        return fit(item, i64::from(bits));
    }
    if let Some(binary) = upper.strip_prefix("2#") {
        let bits = u32::from_str_radix(binary, 2).map_err(|_| wrong())?;
        return fit(item, i64::from(bits));
    }
    if item.reading == Reading::Real {
        return real_of(&upper).map(f32::to_bits).ok_or_else(wrong);
    }
    match upper.strip_prefix("L#").unwrap_or(&upper) {
        "TRUE" => return fit(item, 1),
        "FALSE" => return fit(item, 0),
        number => {
            if let Ok(number) = number.parse() {
                return fit(item, number);
            }
        }
    }
    constant(item, text.trim()).ok_or_else(wrong)
}

/// A constant of STL for this cell: of its type, or of its width where it has none.
fn constant(item: &Item, text: &str) -> Option<u32> {
    if item.ty == DataType::Counter {
        let number = text.get(..2).filter(|prefix| prefix.eq_ignore_ascii_case("C#")).and_then(|_| text.get(2..))?;
        return number.parse().ok().and_then(|number| fit(item, number).ok());
    }
    if let Ok(bytes) = ob1_stl::constant_bytes(text, &item.ty) {
        return Some(bytes.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte)));
    }
    let untyped = matches!(item.ty, DataType::Byte | DataType::Word | DataType::DWord);
    let (bits, width) = ob1_stl::constant_bits(text).ok().filter(|_| untyped)?;
    (width <= u32::from(item.width.bits())).then_some(bits)
}

/// What may be written for a cell.
fn forms(item: &Item) -> &'static str {
    crate::text::form(&item.ty).unwrap_or(match item.ty {
        DataType::DWord => "1, -5, 16#1A, 2#1010, 1.5 or T#2S",
        _ => "1, -5, 16#1A or 2#1010",
    })
}

/// A number as a REAL; `None`: it is beyond the range.
pub(crate) fn narrowed(number: f64) -> Option<f32> {
    let real = number as f32;
    real.is_finite().then_some(real)
}

/// A text as a REAL; `None`: it is not one, or beyond the range. Infinity is a word: `inf`.
pub(crate) fn real_of(text: &str) -> Option<f32> {
    let real: f32 = text.parse().ok()?;
    (real.is_finite() || !text.contains(|c: char| c.is_ascii_digit())).then_some(real)
}

/// The bits of a cell in hexadecimal, as wide as it is.
#[must_use]
pub fn to_hex(item: &Item, bits: u32) -> String {
    format!("{bits:0width$X}", width = usize::from(item.width.bits()).div_ceil(4))
}

/// The lowest bits of a number if the cell can hold it, with or without a sign.
fn fit(item: &Item, number: i64) -> Result<u32, String> {
    let bits = u32::from(item.width.bits());
    let least = if bits == 1 { 0 } else { -(1i64 << (bits - 1)) };
    let most = (1i64 << bits) - 1;
    if (least..=most).contains(&number) {
        Ok((number as u32) & (most as u32))
    } else {
        Err(format!("{number} does not fit {}: {least} to {most}", item.name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::Cell;

    fn item(width: Width, reading: Reading) -> Item {
        let ty = match (width, reading) {
            (Width::Bit, _) => DataType::Bool,
            (Width::Byte, _) => DataType::Byte,
            (Width::Word, Reading::Signed) => DataType::Int,
            (Width::Word, _) => DataType::Word,
            (Width::DWord, Reading::Real) => DataType::Real,
            (Width::DWord, _) => DataType::DWord,
        };
        Item { name: "X".into(), cell: Cell::Area(ob1_model::Area::Memory, 0), width, reading, ty }
    }

    #[test]
    fn values_go_both_ways() {
        let word = item(Width::Word, Reading::Unsigned);
        let int = item(Width::Word, Reading::Signed);
        let bit = item(Width::Bit, Reading::Bool);
        let real = item(Width::DWord, Reading::Real);
        let dword = item(Width::DWord, Reading::Unsigned);
        for (item, text, bits) in [
            (&word, "16#1234", 0x1234),
            (&word, "w#16#12_34", 0x1234),
            (&word, "-1", 0xFFFF),
            (&int, "-32768", 0x8000),
            (&bit, "true", 1),
            (&bit, "0", 0),
            (&dword, "L#-1", 0xFFFF_FFFF),
            (&dword, "2#101", 5),
            (&real, "1.5", 0x3FC0_0000),
            (&real, "16#3FC00000", 0x3FC0_0000),
            (&dword, "1.5", 0x3FC0_0000),
            (&dword, "T#2S", 2000),
            (&word, "S5T#2S", 0x0200),
            (&word, "'AB'", 0x4142),
            (&word, "C#12", 0x12),
        ] {
            assert_eq!(from_text(item, text), Ok(bits), "{text}");
            assert_eq!(from_json(item, &to_json(item, bits)), Ok(bits), "{text}");
        }
        assert_eq!(to_json(&int, 0xFFFF), json!(-1));
        assert_eq!(to_json(&word, 0xFFFF), json!(65535));
        assert_eq!(to_json(&real, 0x4149_0A3D), json!(12.565));
        assert_eq!(to_json(&real, f32::INFINITY.to_bits()), json!("inf"));
    }

    #[test]
    fn a_refusal_names_what_the_cell_takes() {
        let real = item(Width::DWord, Reading::Real);
        let dword = item(Width::DWord, Reading::Unsigned);
        let int = item(Width::Word, Reading::Signed);
        let bit = item(Width::Bit, Reading::Bool);
        for (item, text, forms) in [
            (&int, "1.5", "1, -5, 16#1A or 2#1010"),
            (&dword, "1,5", "1, -5, 16#1A, 2#1010, 1.5 or T#2S"),
            (&int, "T#2S", "1, -5, 16#1A or 2#1010"),
            (&bit, "on", "0, 1, true or false"),
            (&real, "1,5", "1.5, -5 or 1e3"),
        ] {
            let said = format!("\"{text}\" is not a value for X, which is {}; write {forms}", item.ty.name());
            assert_eq!(from_text(item, text), Err(said));
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let byte = item(Width::Byte, Reading::Unsigned);
        let bit = item(Width::Bit, Reading::Bool);
        for (item, text) in
            [(&byte, "256"), (&byte, "-129"), (&bit, "2"), (&bit, "-1"), (&byte, ""), (&byte, "1.5"), (&byte, "16#")]
        {
            assert!(from_text(item, text).is_err(), "{text}");
        }
        assert!(from_json(&byte, &json!([1])).is_err());
        assert!(from_json(&byte, &json!(1.5)).is_err());
        // Beyond the range of a REAL is not infinity.
        let real = item(Width::DWord, Reading::Real);
        for wrong in [json!(1e39), json!(-1e300), json!("1e39")] {
            assert!(from_json(&real, &wrong).is_err(), "{wrong}");
        }
        assert_eq!(from_json(&real, &json!(f32::MAX)), Ok(f32::MAX.to_bits()));
        assert_eq!(from_json(&real, &json!("-inf")), Ok(f32::NEG_INFINITY.to_bits()));
    }
}
