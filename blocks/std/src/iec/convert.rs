//! Numbers to STRING and back. What cannot be converted leaves the result alone, and BR is 0.

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
    Row::new::<RealString>(Origin::Iec, Fc, 30, "R_STRNG", write_real).note("14 characters `±v.nnnnnnnE±xx`"),
    Row::new::<StringDint>(Origin::Iec, Fc, 37, "STRNG_DI", |call| {
        let value = integer(call.text(StringDint::S).as_slice(), 11).and_then(|v| i32::try_from(v).ok());
        read_integer(call, StringDint::RET_VAL, value)
    })
    .note("at most 11 characters"),
    Row::new::<StringInt>(Origin::Iec, Fc, 38, "STRNG_I", |call| {
        let value = integer(call.text(StringInt::S).as_slice(), 6).and_then(|v| i16::try_from(v).ok());
        read_integer(call, StringInt::RET_VAL, value.map(i32::from))
    })
    .note("at most 6 characters"),
    Row::new::<StringReal>(Origin::Iec, Fc, 39, "STRNG_R", read_real).note("14 characters `±v.nnnnnnnE±xx`"),
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

fn read_integer(call: &mut Call<'_>, ret_val: impl Params, value: Option<i32>) -> Done {
    let Some(value) = value else { return call.br(false) };
    call.set_dint(ret_val, value);
    Ok(())
}

/// `±v.nnnnnnnE±xx`; no conversion for an infinity, a NaN or a result variable of less than 14 characters.
fn write_real(call: &mut Call<'_>) -> Done {
    let value = call.real(RealString::IN);
    if is_invalid(value) {
        return call.br(false);
    }
    write_whole(call, RealString::RET_VAL, &real_text(value))
}

/// The 14 characters of a finite REAL.
fn real_text(value: f32) -> [u8; 14] {
    let mut text = *b"+0.0000000E+00";
    if value.is_sign_negative() && value != 0.0 {
        text[0] = b'-';
    }
    let mut room = Exponential { bytes: [0; 24], len: 0 };
    // A finite number in this form has at most 13 characters, so that writing cannot fail.
    let _ = std::fmt::Write::write_fmt(&mut room, format_args!("{:.7e}", f64::from(value.abs())));
    let written = &room.bytes[..room.len];
    let at = written.iter().position(|c| *c == b'e').unwrap_or(0);
    if at == 9 {
        text[1..10].copy_from_slice(&written[..9]);
        let (sign, digits) = match &written[10..] {
            [b'-', digits @ ..] => (b'-', digits),
            digits => (b'+', digits),
        };
        text[11] = sign;
        let digits = &digits[..digits.len().min(2)];
        text[14 - digits.len()..].copy_from_slice(digits);
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

/// Exactly `±v.nnnnnnnE±xx`, within the range of REAL.
fn read_real(call: &mut Call<'_>) -> Done {
    let text = call.text(StringReal::S);
    let Some(value) = real(text.as_slice()) else { return call.br(false) };
    call.set_real(StringReal::RET_VAL, value);
    Ok(())
}

fn real(text: &[u8]) -> Option<f32> {
    let shape = text.len() == 14
        && text.iter().enumerate().all(|(i, c)| match i {
            0 | 11 => matches!(c, b'+' | b'-'),
            2 => *c == b'.',
            10 => *c == b'E',
            _ => c.is_ascii_digit(),
        });
    let value: f32 = std::str::from_utf8(text).ok().filter(|_| shape)?.parse().ok()?;
    // A value that is not 0 as written, but too small for a REAL, is out of range as well.
    let underflow = value == 0.0 && text[1..10].iter().any(|c| (b'1'..=b'9').contains(c));
    (value.is_finite() && !underflow).then_some(value)
}

#[cfg(test)]
mod tests {
    use crate::testing::{Fake, string};

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
            ("IEC:FC37", "2147483648", 7, false),
            ("IEC:FC37", "+00000000001", 7, false),
            ("IEC:FC37", "12", 12, true),
            ("IEC:FC38", "+32767", 32_767, true),
            ("IEC:FC38", "-32768", -32_768, true),
            ("IEC:FC38", "32768", 7, false),
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
            (303.303, "+3.0330301E+02"),
            (-1.0, "-1.0000000E+00"),
            (f32::MAX, "+3.4028235E+38"),
            (2f32.powi(-20), "+9.5367432E-07"),
        ] {
            let mut fake = Fake::new("IEC:FC30").with("IN", f32::to_be_bytes(value)).with("RET_VAL", string(14, ""));
            fake.run();
            assert_eq!((fake.text("RET_VAL"), fake.br), (text.to_owned(), true));
            let mut fake = Fake::new("IEC:FC39").with("S", string(20, text)).with("RET_VAL", [9; 4]);
            fake.run();
            assert_eq!((fake.real("RET_VAL"), fake.br), (value, true), "{text}");
        }
        for (value, room) in [(f32::NAN, 20), (f32::NEG_INFINITY, 20), (1.0, 13)] {
            let mut fake = Fake::new("IEC:FC30").with("IN", value.to_be_bytes()).with("RET_VAL", string(room, "?"));
            fake.run();
            assert_eq!((fake.text("RET_VAL"), fake.br), ("?".to_owned(), false), "{value}");
        }
        for text in ["", "+1.0000000E+0", "1.00000000E+00", "+1,0000000E+00", "+1.0000000E+39", "+1.0000000E-60"] {
            let mut fake = Fake::new("IEC:FC39").with("S", string(20, text)).with("RET_VAL", [0; 4]);
            fake.run();
            assert!(!fake.br, "{text}");
        }
    }
}
