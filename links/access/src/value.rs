//! Values as text and JSON, both ways.

use ob1_model::Width;
use serde_json::{Value, json};

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
        Reading::Real => {
            let real = f32::from_bits(bits);
            // JSON has no infinities; they become a word.
            if real.is_finite() { json!(real) } else { json!(real.to_string()) }
        }
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
            let unfit = || format!("{number} does not fit {}, a {}", item.name, item.type_name);
            match (number.as_i64(), number.as_f64()) {
                (_, Some(number)) if item.reading == Reading::Real => {
                    narrowed(number).map(f32::to_bits).ok_or_else(unfit)
                }
                (Some(number), _) => fit(item, number),
                _ => Err(unfit()),
            }
        }
        Value::String(text) => from_text(item, text),
        other => Err(format!("{other} is not a value for {}", item.name)),
    }
}

/// The bits of a value as text: `1`, `true`, `-5`, `16#1A`, `W#16#1A`, `L#5`, `2#1010`, `1.5`.
///
/// # Errors
/// The error in it, in one sentence.
pub fn from_text(item: &Item, text: &str) -> Result<u32, String> {
    let wrong = || {
        let forms = forms(item, text);
        format!("\"{text}\" is not a value for {}, which is {}; write {forms}", item.name, item.type_name)
    };
    let upper: String = text.trim().to_ascii_uppercase().chars().filter(|c| *c != '_').collect();
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
        "TRUE" => fit(item, 1),
        "FALSE" => fit(item, 0),
        number => fit(item, number.parse().map_err(|_| wrong())?),
    }
}

/// What may be written for a cell. If a REAL was written for a double word without a type, its bits are named, too.
fn forms(item: &Item, text: &str) -> String {
    let forms = match item.reading {
        Reading::Bool => "0, 1, true or false",
        Reading::Real => "1.5, -5 or 1e3",
        Reading::Unsigned | Reading::Signed => "1, -5, 16#1A or 2#1010",
    };
    let real = text.contains('.').then(|| real_of(text.trim())).flatten();
    match real.filter(|_| item.width == Width::DWord && item.reading == Reading::Unsigned) {
        Some(real) => format!("{forms}; as a REAL it is 16#{:08X}", real.to_bits()),
        None => forms.to_owned(),
    }
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
        Item { name: "X".into(), cell: Cell::Timer(0), width, reading, type_name: "TYPE" }
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
        ] {
            assert_eq!(from_text(item, text), Ok(bits), "{text}");
            assert_eq!(from_json(item, &to_json(item, bits)), Ok(bits), "{text}");
        }
        assert_eq!(to_json(&int, 0xFFFF), json!(-1));
        assert_eq!(to_json(&word, 0xFFFF), json!(65535));
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
            (&dword, "1.5", "1, -5, 16#1A or 2#1010; as a REAL it is 16#3FC00000"),
            (&bit, "on", "0, 1, true or false"),
            (&real, "1,5", "1.5, -5 or 1e3"),
        ] {
            let said = format!("\"{text}\" is not a value for X, which is TYPE; write {forms}");
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
