//! Conversions of ACCU1. ["Conversion Instructions" of the STL reference]

use ob1_ir::Convert;
use ob1_model::FaultKind;

use super::arith::{low_word, sign_cc};
use super::regs::{OS, OV};

/// The new ACCU1 and the flags, which start from `flags`; or a BCD error.
pub fn convert(kind: Convert, a1: u32, flags: u32) -> Result<(u32, u32), FaultKind> {
    let word = a1 as u16;
    Ok(match kind {
        Convert::Bti => (low_word(a1, from_bcd(u32::from(word), 3, 12)? as u16), flags),
        Convert::Btd => (from_bcd(a1, 7, 28)? as u32, flags),
        Convert::Itb => match to_bcd(i32::from(word as i16), 999, 12) {
            Some(bcd) => (low_word(a1, bcd as u16), flags & !OV),
            None => (a1, flags | OV | OS),
        },
        Convert::Dtb => match to_bcd(a1 as i32, 9_999_999, 28) {
            Some(bcd) => (bcd, flags & !OV),
            None => (a1, flags | OV | OS),
        },
        Convert::Itd => (i32::from(word as i16) as u32, flags),
        Convert::Dtr => ((a1 as i32 as f32).to_bits(), flags),
        Convert::Rnd => round(a1, flags, f64::round_ties_even),
        Convert::RndPlus => round(a1, flags, f64::ceil),
        Convert::RndMinus => round(a1, flags, f64::floor),
        Convert::Trunc => round(a1, flags, f64::trunc),
        Convert::Invi => (low_word(a1, !word), flags),
        Convert::Invd => (!a1, flags),
        Convert::Negi => {
            let negated = (word as i16).wrapping_neg();
            let cc = sign_cc(i64::from(negated)) | (u32::from(word == 0x8000) * OV);
            (low_word(a1, negated as u16), super::regs::with_cc(flags, cc))
        }
        Convert::Negd => {
            let negated = (a1 as i32).wrapping_neg();
            let cc = sign_cc(i64::from(negated)) | (u32::from(a1 == 0x8000_0000) * OV);
            (negated as u32, super::regs::with_cc(flags, cc))
        }
        Convert::Negr => (a1 ^ 0x8000_0000, flags),
        Convert::Abs => (a1 & 0x7FFF_FFFF, flags),
        Convert::Taw => (low_word(a1, word.swap_bytes()), flags),
        Convert::Tad => (a1.swap_bytes(), flags),
    })
}

/// A BCD number of `digits` digits whose sign is in the digit at bit `sign`: 8 to 15 is minus.
fn from_bcd(bcd: u32, digits: u32, sign: u32) -> Result<i32, FaultKind> {
    let mut value = 0;
    for i in (0..digits).rev() {
        let digit = bcd >> (4 * i) & 15;
        if digit > 9 {
            return Err(FaultKind::BcdConversion);
        }
        value = value * 10 + digit as i32;
    }
    Ok(if bcd >> sign & 8 != 0 { -value } else { value })
}

/// The BCD form of a number of at most `max`, sign digit 0 or F at bit `sign`.
fn to_bcd(value: i32, max: u32, sign: u32) -> Option<u32> {
    let mut rest = value.unsigned_abs();
    if rest > max {
        return None;
    }
    let mut bcd = if value < 0 { 15 << sign } else { 0 };
    let mut at = 0;
    while rest > 0 {
        bcd |= (rest % 10) << at;
        rest /= 10;
        at += 4;
    }
    Some(bcd)
}

/// Out of range or NaN: ACCU1 stays, OV and OS are set.
fn round(a1: u32, flags: u32, how: fn(f64) -> f64) -> (u32, u32) {
    let value = how(f64::from(f32::from_bits(a1)));
    if (-2_147_483_648.0..=2_147_483_647.0).contains(&value) {
        (value as i32 as u32, flags & !OV)
    } else {
        (a1, flags | OV | OS)
    }
}
