//! Numbers to STRING and back. What is no number leaves the result alone, what is beyond its range becomes the nearest
//! limit; BR is 0 in both cases. Forms and limits are those of Siemens' compiled blocks.

use ob1_model::BlockKind::Fc;

use crate::Done;
use crate::call::{Call, is_invalid};
use crate::declare::{Params, params};
use crate::row::{Origin, Row};

params!(DintString { Input { I: DINT } Return { RET_VAL: STRING } });
params!(IntString { Input { I: INT } Return { RET_VAL: STRING } });
params!(RealString { Input { IN: REAL } Return { RET_VAL: STRING } });
params!(StringDint { Input { S: STRING } Return { RET_VAL: DINT } });
params!(StringInt { Input { S: STRING } Return { RET_VAL: INT } });
params!(StringReal { Input { S: STRING } Return { RET_VAL: REAL } });

pub(super) const ROWS: &[Row] = &[
    Row::new::<DintString>(Origin::Iec, Fc, 5, "DI_STRNG", |call| {
        let value = call.dint(DintString::I);
        write_integer(call, DintString::RET_VAL, value)
    })
    .note("always with a sign"),
    Row::new::<IntString>(Origin::Iec, Fc, 16, "I_STRNG", |call| {
        let value = i32::from(call.int(IntString::I));
        write_integer(call, IntString::RET_VAL, value)
    })
    .note("always with a sign"),
    Row::new::<RealString>(Origin::Iec, Fc, 30, "R_STRNG", write_real).note("14 characters `±0.nnnnnnnE±xx`"),
    Row::new::<StringDint>(Origin::Iec, Fc, 37, "STRNG_DI", |call| {
        let value = integer(call.text(StringDint::S).as_slice(), 11);
        read_integer(call, StringDint::RET_VAL, value, i64::from(i32::MIN)..=i64::from(i32::MAX))
    })
    .note("at most 11 characters; saturates with BR 0"),
    Row::new::<StringInt>(Origin::Iec, Fc, 38, "STRNG_I", |call| {
        let value = integer(call.text(StringInt::S).as_slice(), 6);
        read_integer(call, StringInt::RET_VAL, value, i64::from(i16::MIN)..=i64::from(i16::MAX))
    })
    .note("at most 6 characters; saturates with BR 0"),
    Row::new::<StringReal>(Origin::Iec, Fc, 39, "STRNG_R", read_real)
        .note("`±v.nnnnnnnE±xx`, also `,` and `e`; saturates with BR 0"),
];

/// A sign and digits without leading zeros.
fn write_integer(call: &mut Call<'_>, ret_val: impl Params, value: i32) -> Done {
    let mut buffer = [0; 11];
    let mut at = buffer.len();
    let mut rest = value.unsigned_abs();
    loop {
        at -= 1;
        buffer[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    at -= 1;
    buffer[at] = if value < 0 { b'-' } else { b'+' };
    write_whole(call, ret_val, &buffer[at..])
}

/// Writes all or nothing.
fn write_whole(call: &mut Call<'_>, ret_val: impl Params, text: &[u8]) -> Done {
    if call.room(ret_val) < text.len() {
        return call.br(false);
    }
    call.set_text(ret_val, text);
    Ok(())
}

/// Decimal digits with an optional sign, at most `longest` characters.
fn integer(text: &[u8], longest: usize) -> Option<i64> {
    let (negative, digits) = match text {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    if text.len() > longest || digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let value = digits.iter().fold(0, |value, digit| value * 10 + i64::from(digit - b'0'));
    Some(if negative { -value } else { value })
}

/// The value, or the limit of its type and BR 0.
fn read_integer(
    call: &mut Call<'_>,
    ret_val: impl Params,
    value: Option<i64>,
    range: std::ops::RangeInclusive<i64>,
) -> Done {
    let Some(value) = value else { return call.br(false) };
    call.set_dint(ret_val, value.clamp(*range.start(), *range.end()) as i32);
    call.br(range.contains(&value))
}

/// `±0.nnnnnnnE±xx`; no conversion for an infinity, a NaN or a result variable of less than 14 characters.
fn write_real(call: &mut Call<'_>) -> Done {
    let value = call.real(RealString::IN);
    if is_invalid(value) {
        return call.br(false);
    }
    write_whole(call, RealString::RET_VAL, &real_text(value))
}

/// The 14 characters of a finite REAL: seven digits behind the point, the first of them not 0.
fn real_text(value: f32) -> [u8; 14] {
    let mut text = *b"+0.0000000E+00";
    if value == 0.0 {
        return text;
    }
    if value.is_sign_negative() {
        text[0] = b'-';
    }
    let mut room = Exponential { bytes: [0; 24], len: 0 };
    // `d.ddddddexx`: a finite number in this form has at most 12 characters, so that writing cannot fail.
    let _ = std::fmt::Write::write_fmt(&mut room, format_args!("{:.6e}", f64::from(value.abs())));
    let written = &room.bytes[..room.len];
    if let [first, b'.', rest @ ..] = written
        && let Some((digits, [b'e', exponent @ ..])) = rest.split_at_checked(6)
    {
        text[3] = *first;
        text[4..10].copy_from_slice(digits);
        let exponent = std::str::from_utf8(exponent).ok().and_then(|text| text.parse::<i8>().ok()).unwrap_or(0) + 1;
        text[11] = if exponent < 0 { b'-' } else { b'+' };
        let [tens, ones] = [exponent.unsigned_abs() / 10 % 10, exponent.unsigned_abs() % 10];
        text[12..].copy_from_slice(&[b'0' + tens, b'0' + ones]);
    }
    text
}

/// A place to format a number into.
struct Exponential {
    bytes: [u8; 24],
    len: usize,
}

impl std::fmt::Write for Exponential {
    fn write_str(&mut self, piece: &str) -> std::fmt::Result {
        let room = self.bytes.get_mut(self.len..self.len + piece.len()).ok_or(std::fmt::Error)?;
        room.copy_from_slice(piece.as_bytes());
        self.len += piece.len();
        Ok(())
    }
}

fn read_real(call: &mut Call<'_>) -> Done {
    let text = call.text(StringReal::S);
    let Some(value) = real(text.as_slice()) else { return call.br(false) };
    let fits = value.is_finite() && (value == 0.0 || value.is_normal());
    let limit = if value.is_finite() { f32::MIN_POSITIVE } else { f32::MAX };
    // What is too small for a REAL with all its digits is the smallest one that has them.
    call.set_real(StringReal::RET_VAL, if fits { value } else { limit.copysign(value) });
    call.br(fits)
}

/// Exactly `±v.nnnnnnnE±xx`, the point also a comma, the letter also small. Too large: infinite. Too small: not normal.
fn real(text: &[u8]) -> Option<f32> {
    let mut text: [u8; 14] = text.try_into().ok()?;
    text[2] = if text[2] == b',' { b'.' } else { text[2] };
    let shape = text.iter().enumerate().all(|(i, c)| match i {
        0 | 11 => matches!(c, b'+' | b'-'),
        2 => *c == b'.',
        10 => c.eq_ignore_ascii_case(&b'e'),
        _ => c.is_ascii_digit(),
    });
    let value: f32 = std::str::from_utf8(&text).ok().filter(|_| shape)?.parse().ok()?;
    let is_zero = text[1..10].iter().all(|c| matches!(c, b'0' | b'.'));
    Some(if value == 0.0 && !is_zero { f32::from_bits(1).copysign(value) } else { value })
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, string};

    #[test]
    fn integers_to_strings() {
        for (key, input, room, text, br) in [
            ("IEC:FC5", i32::MIN, 11, "-2147483648", true),
            ("IEC:FC5", i32::MIN, 10, "?", false),
            ("IEC:FC5", 0, 2, "+0", true),
            ("IEC:FC16", 123, 4, "+123", true),
            ("IEC:FC16", -32_768, 6, "-32768", true),
            ("IEC:FC16", 5, 1, "?", false),
        ] {
            let bytes = input.to_be_bytes();
            let input = if key == "IEC:FC5" { bytes.to_vec() } else { bytes[2..].to_vec() };
            let mut fake = Fake::new(key).with("I", input).with("RET_VAL", string(room, "?"));
            fake.run();
            assert_eq!((fake.text("RET_VAL"), fake.br), (text.to_owned(), br), "{key} {text}");
        }
    }

    #[test]
    fn strings_to_integers() {
        for (key, text, value, br) in [
            ("IEC:FC37", "-2147483648", i32::MIN, true),
            ("IEC:FC37", "2147483648", i32::MAX, false),
            ("IEC:FC37", "+00000000001", 7, false),
            ("IEC:FC37", "12", 12, true),
            ("IEC:FC38", "+32767", 32_767, true),
            ("IEC:FC38", "-32768", -32_768, true),
            ("IEC:FC38", "32768", 32_767, false),
            ("IEC:FC38", "-32769", -32_768, false),
            ("IEC:FC38", "0000001", 7, false),
            ("IEC:FC38", "", 7, false),
            ("IEC:FC38", "-", 7, false),
            ("IEC:FC38", "1 2", 7, false),
        ] {
            let old = if key == "IEC:FC37" { vec![0, 0, 0, 7] } else { vec![0, 7] };
            let mut fake = Fake::new(key).with("S", string(20, text)).with("RET_VAL", old);
            fake.run();
            let result = if key == "IEC:FC37" { fake.dint("RET_VAL") } else { i32::from(fake.value("RET_VAL") as i16) };
            assert_eq!((result, fake.br), (value, br), "{key} {text}");
        }
    }

    #[test]
    fn reals_both_ways() {
        for (value, text) in [
            (0.0, "+0.0000000E+00"),
            (3.5, "+0.3500000E+01"),
            (-1.0, "-0.1000000E+01"),
            (0.5, "+0.5000000E+00"),
            (303.303, "+0.3033030E+03"),
            (f32::MAX, "+0.3402823E+39"),
            (2f32.powi(-20), "+0.9536743E-06"),
        ] {
            let mut fake = Fake::new("IEC:FC30").with("IN", f32::to_be_bytes(value)).with("RET_VAL", string(14, ""));
            fake.run();
            assert_eq!((fake.text("RET_VAL"), fake.br), (text.to_owned(), true));
            let mut fake = Fake::new("IEC:FC39").with("S", string(20, text)).with("RET_VAL", [9; 4]);
            fake.run();
            let error = (fake.real("RET_VAL") - value).abs();
            assert!(fake.br && error <= value.abs() * 2e-7, "{text}");
        }
        for (text, value, br) in [
            ("+3.0330301E+02", 303.303, true),
            ("+1,2345678E+00", 1.234_567_8, true),
            ("-1.0000000e+01", -10.0, true),
            ("+1.0000000E+99", f32::MAX, false),
            ("-1.0000000E+39", -f32::MAX, false),
            ("+1.0000000E-40", f32::MIN_POSITIVE, false),
            ("-1.0000000E-60", -f32::MIN_POSITIVE, false),
        ] {
            let mut fake = Fake::new("IEC:FC39").with("S", string(20, text)).with("RET_VAL", [9; 4]);
            fake.run();
            assert_eq!((fake.real("RET_VAL"), fake.br), (value, br), "{text}");
        }
        for (value, room) in [(f32::NAN, 20), (f32::NEG_INFINITY, 20), (1.0, 13)] {
            let mut fake = Fake::new("IEC:FC30").with("IN", value.to_be_bytes()).with("RET_VAL", string(room, "?"));
            fake.run();
            assert_eq!((fake.text("RET_VAL"), fake.br), ("?".to_owned(), false), "{value}");
        }
        for text in ["", "+1.0000000E+0", "1.00000000E+00", "+1.0000000E+000", "+1;0000000E+00", "+1.000000 E+00"] {
            let mut fake = Fake::new("IEC:FC39").with("S", string(20, text)).with("RET_VAL", [9; 4]);
            fake.run();
            assert_eq!((fake.bytes("RET_VAL"), fake.br), (&[9; 4][..], false), "{text}");
        }
    }
}
