//! FC 93 SEG, FC 94 ATH, FC 95 HTA, FC 96 ENCO, FC 97 DECO, FC 98 BCDCPL, FC 99 BITSUM. ["Conversion Functions"]

use ob1_model::BlockKind::Fc;

use super::place::Place;
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::{Origin, Row};

params!(Seg { Input { IN: WORD } Output { OUT: DWORD } });
params!(Hex { Input { IN: POINTER, N: INT } Return { RET_VAL: WORD } Output { OUT: POINTER } });
params!(Enco { Input { IN: DWORD } Return { RET_VAL: INT } });
params!(Deco { Input { IN: WORD } Return { RET_VAL: DWORD } });
params!(BcdCpl { Input { IN: DWORD } Return { RET_VAL: DWORD } });

pub(super) const ROWS: &[Row] = &[
    Row::new::<Seg>(Origin::TiS7, Fc, 93, "SEG", seg),
    Row::new::<Hex>(Origin::TiS7, Fc, 94, "ATH", ath).note("at most 32767 characters"),
    Row::new::<Hex>(Origin::TiS7, Fc, 95, "HTA", hta),
    Row::new::<Enco>(Origin::TiS7, Fc, 96, "ENCO", |call| {
        let bit = call.raw(Enco::IN).trailing_zeros() % 32;
        call.set(Enco::RET_VAL, bit);
        call.br(true)
    }),
    Row::new::<Deco>(Origin::TiS7, Fc, 97, "DECO", |call| {
        let bit = call.word(Deco::IN) & 0x1F;
        call.set(Deco::RET_VAL, 1 << bit);
        call.br(true)
    }),
    Row::new::<BcdCpl>(Origin::TiS7, Fc, 98, "BCDCPL", bcdcpl),
    Row::new::<Enco>(Origin::TiS7, Fc, 99, "BITSUM", |call| {
        let ones = call.raw(Enco::IN).count_ones();
        call.set(Enco::RET_VAL, ones);
        call.br(true)
    }),
];

/// A character that is not a hexadecimal digit.
const BAD_DIGIT: u32 = 0x0007;

/// Segments a to g of a digit, from bit 0 on.
const SEGMENTS: [u8; 16] =
    [0x3F, 0x06, 0x5B, 0x4F, 0x66, 0x6D, 0x7D, 0x07, 0x7F, 0x67, 0x77, 0x7C, 0x39, 0x5E, 0x79, 0x71];

fn seg(call: &mut Call<'_>) -> Done {
    let word = call.word(Seg::IN);
    let out = (0..4).fold(0, |out, digit| {
        let segments = SEGMENTS[usize::from(word >> (4 * digit) & 15)];
        out | u32::from(segments) << (8 * digit)
    });
    call.set(Seg::OUT, out);
    call.br(true)
}

/// N characters become half as many bytes; an odd one fills the left half of the last. A character that is not a digit
/// becomes 0.
fn ath(call: &mut Call<'_>) -> Done {
    let count = u32::try_from(call.int(Hex::N)).unwrap_or(0);
    let mut bad = false;
    let done = match (Place::of(call, Hex::IN), Place::of(call, Hex::OUT)) {
        (Some(from), Some(to)) => (0..count.div_ceil(2)).try_for_each(|i| {
            let mut byte = 0;
            for half in 0..2.min(count - 2 * i) {
                let mut character = [0];
                from.read(call, 2 * i + half, &mut character)?;
                let digit = match char::from(character[0]) {
                    digit @ ('0'..='9' | 'A'..='F') => digit.to_digit(16).unwrap_or(0),
                    _ => {
                        bad = true;
                        0
                    }
                };
                byte |= (digit as u8) << if half == 0 { 4 } else { 0 };
            }
            to.write(call, i, &[byte])
        }),
        _ => Err(crate::Refused::Outside),
    };
    call.set(Hex::RET_VAL, if bad { BAD_DIGIT } else { 0 });
    call.br(done.is_ok() && !bad)
}

/// N bytes become twice as many characters.
fn hta(call: &mut Call<'_>) -> Done {
    let count = u32::try_from(call.int(Hex::N)).unwrap_or(0);
    let done = match (Place::of(call, Hex::IN), Place::of(call, Hex::OUT)) {
        (Some(from), Some(to)) => (0..count).try_for_each(|i| {
            let mut byte = [0];
            from.read(call, i, &mut byte)?;
            let digit = |half: u8| b"0123456789ABCDEF"[usize::from(half & 15)];
            to.write(call, 2 * i, &[digit(byte[0] >> 4), digit(byte[0])])
        }),
        _ => Err(crate::Refused::Outside),
    };
    call.set(Hex::RET_VAL, 0);
    call.br(done.is_ok())
}

/// 10,000,000 less a BCD number of seven digits. The leftmost four bits are ignored.
fn bcdcpl(call: &mut Call<'_>) -> Done {
    let bcd = call.raw(BcdCpl::IN);
    let digits = |value: u32| (0..7).rev().fold(0, |sum, digit| sum * 10 + (value >> (4 * digit) & 15));
    let rest = (10_000_000u32).wrapping_sub(digits(bcd)) % 10_000_000;
    let (mut left, mut out) = (rest, 0);
    for digit in 0..7 {
        out |= (left % 10) << (4 * digit);
        left /= 10;
    }
    call.set(BcdCpl::RET_VAL, out);
    call.br(true)
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, pointer};

    #[test]
    fn digits_and_bits() {
        for (key, width, input, output, result) in [
            ("SEG", 2, 0x1234u32, "OUT", 0x065B_4F66u32),
            ("SEG", 2, 0xFE90, "OUT", 0x7179_673F),
            ("DECO", 2, 0x0023, "RET_VAL", 8),
            ("ENCO", 4, 0x8000_0100, "RET_VAL", 8),
            ("ENCO", 4, 0, "RET_VAL", 0),
            ("BITSUM", 4, 0x1234_5678, "RET_VAL", 13),
            ("BCDCPL", 4, 0x0109_8765, "RET_VAL", 0x0890_1235),
            ("BCDCPL", 4, 0, "RET_VAL", 0),
        ] {
            let room = if output == "OUT" || key == "DECO" || key == "BCDCPL" { 4 } else { 2 };
            let mut fake = Fake::new(&format!("TI-S7:{key}")).with("IN", &input.to_be_bytes()[4 - width..]);
            fake = fake.with(output, vec![9; room]);
            fake.run();
            assert_eq!(fake.value(output), result, "{key} {input:X}");
        }
    }

    #[test]
    fn hexadecimal_text() {
        for (text, bytes, code) in
            [("A23F", vec![0xA2, 0x3F], 0), ("A23", vec![0xA2, 0x30], 0), ("1xG4", vec![0x10, 0x04], 7)]
        {
            let mut fake = Fake::new("TI-S7:ATH").with("IN", pointer(10)).with("OUT", pointer(30));
            fake = fake.with("N", (text.len() as i16).to_be_bytes()).with("RET_VAL", [9; 2]);
            fake.memory(10, text.as_bytes());
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.memory_at(30, bytes.len())), (code, &bytes[..]), "{text}");
            assert_eq!(fake.br, code == 0);
        }
        let mut fake = Fake::new("TI-S7:HTA").with("IN", pointer(10)).with("OUT", pointer(30)).with("N", [0, 2]);
        fake = fake.with("RET_VAL", [9; 2]);
        fake.memory(10, &[0xA2, 0x3F]);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.memory_at(30, 4)), (0, &b"A23F"[..]));
        let mut fake = fake.with("N", (-1i16).to_be_bytes());
        fake.run();
        assert!(fake.br, "nothing to do");
    }
}
