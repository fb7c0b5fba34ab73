//! FC 105 SCALE, FC 106 UNSCALE.

use ob1_model::BlockKind::Fc;

use crate::call::{Call, Code, is_invalid};
use crate::declare::params;
use crate::row::Row;

params!(Scale {
    Input { IN: INT, HI_LIM: REAL, LO_LIM: REAL, BIPOLAR: BOOL }
    Return { RET_VAL: WORD }
    Output { OUT: REAL }
});
params!(Unscale {
    Input { IN: REAL, HI_LIM: REAL, LO_LIM: REAL, BIPOLAR: BOOL }
    Return { RET_VAL: WORD }
    Output { OUT: INT }
});

pub(super) const ROWS: &[Row] = &[
    Row::ti::<Scale>(Fc, 105, "SCALE", scale).note("outside its range: the limit, RET_VAL 0008h, BR 0"),
    Row::ti::<Unscale>(Fc, 106, "UNSCALE", unscale)
        .note("outside its range: the limit, RET_VAL 0008h, BR 0; rounded to the nearest"),
];

/// RET_VAL when the input is out of range.
const OUT_OF_RANGE: u16 = 0x0008;
/// Nominal range of an analog value.
const K2: f32 = 27_648.0;

/// Lower end of the analog range.
const fn k1(bipolar: bool) -> f32 {
    if bipolar { -K2 } else { 0.0 }
}

/// `OUT = (IN - K1) / (K2 - K1) * (HI_LIM - LO_LIM) + LO_LIM`. LO_LIM above HI_LIM is permitted: it falls then.
fn scale(call: &mut Call<'_>) -> Code {
    let (input, high, low) = (f32::from(call.int(Scale::IN)), call.real(Scale::HI_LIM), call.real(Scale::LO_LIM));
    let k1 = k1(call.bool(Scale::BIPOLAR));
    let (out, good) = if input > K2 {
        (high, false)
    } else if input < k1 {
        (low, false)
    } else {
        ((input - k1) / (K2 - k1) * (high - low) + low, true)
    };
    call.set_real(Scale::OUT, out);
    if good { Ok(0) } else { Err(OUT_OF_RANGE) }
}

/// `OUT = (IN - LO_LIM) / (HI_LIM - LO_LIM) * (K2 - K1) + K1`.
fn unscale(call: &mut Call<'_>) -> Code {
    let (input, high, low) = (call.real(Unscale::IN), call.real(Unscale::HI_LIM), call.real(Unscale::LO_LIM));
    let k1 = k1(call.bool(Unscale::BIPOLAR));
    let part = (input - low) / (high - low);
    // Equal limits or an input that is no number have no place in the range: the lower end, with an error.
    let inside = !is_invalid(part) && (0.0..=1.0).contains(&part);
    let part = if is_invalid(part) { 0.0 } else { part.clamp(0.0, 1.0) };
    let out = (part * (K2 - k1) + k1).round_ties_even();
    call.set_int(Unscale::OUT, out as i16);
    if inside { Ok(0) } else { Err(OUT_OF_RANGE) }
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    #[test]
    fn scales_and_limits() {
        for (input, high, low, bipolar, out, ret_val) in [
            (0i16, 100.0f32, 0.0f32, 0, 0.0f32, 0),
            (13_824, 100.0, 0.0, 0, 50.0, 0),
            (27_648, 100.0, 20.0, 0, 100.0, 0),
            (27_649, 100.0, 20.0, 0, 100.0, 8),
            (-1, 100.0, 20.0, 0, 20.0, 8),
            (0, 100.0, 0.0, 1, 50.0, 0),
            (-27_648, 100.0, 0.0, 1, 0.0, 0),
            (-27_649, 100.0, 0.0, 1, 0.0, 8),
            (6_912, 0.0, 100.0, 0, 75.0, 0),
        ] {
            let mut fake = Fake::new("TI-S7:SCALE").with("IN", input.to_be_bytes()).with("HI_LIM", high.to_be_bytes());
            fake = fake.with("LO_LIM", low.to_be_bytes()).with("BIPOLAR", [bipolar]);
            fake = fake.with("RET_VAL", [9; 2]).with("OUT", [9; 4]);
            fake.run();
            let result = (fake.real("OUT"), fake.value("RET_VAL"), fake.br);
            assert_eq!(result, (out, ret_val, ret_val == 0), "{input} {high} {low} {bipolar}");
        }
    }

    #[test]
    fn unscales_and_limits() {
        for (input, high, low, bipolar, out, ret_val) in [
            (50.0f32, 100.0f32, 0.0f32, 0, 13_824i16, 0),
            (100.0, 100.0, 0.0, 0, 27_648, 0),
            (101.0, 100.0, 0.0, 0, 27_648, 8),
            (-1.0, 100.0, 0.0, 0, 0, 8),
            (0.0, 100.0, 0.0, 1, -27_648, 0),
            (-1.0, 100.0, 0.0, 1, -27_648, 8),
            (75.0, 0.0, 100.0, 0, 6_912, 0),
            (f32::NAN, 100.0, 0.0, 0, 0, 8),
            (5.0, 5.0, 5.0, 0, 0, 8),
        ] {
            let mut fake = Fake::new("TI-S7:UNSCALE").with("IN", input.to_be_bytes());
            fake = fake.with("HI_LIM", high.to_be_bytes()).with("LO_LIM", low.to_be_bytes()).with("BIPOLAR", [bipolar]);
            fake = fake.with("RET_VAL", [9; 2]).with("OUT", [9; 2]);
            fake.run();
            let result = (fake.value("OUT") as i16, fake.value("RET_VAL"), fake.br);
            assert_eq!(result, (out, ret_val, ret_val == 0), "{input} {high} {low} {bipolar}");
        }
    }
}
