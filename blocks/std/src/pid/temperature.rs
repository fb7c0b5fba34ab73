//! What the two temperature controllers share. ["PID Temperature Control"]

use crate::call::Call;
use crate::declare::Params;

/// PV: the value, or the word of the analog input as its range says, by factor and offset. From PVPER_ON, PV_PER,
/// PER_MODE, PV_IN, PV_FAC and PV_OFFS.
pub(super) fn process_value<P: Params>(
    call: &mut Call<'_>,
    [from_periphery, word, mode, value, factor, offset]: [P; 6],
) -> f32 {
    if !call.bool(from_periphery) {
        return call.real(value);
    }
    let unit = match call.int(mode) {
        // Thermocouples and resistance thermometers in tenths, the climatic range in hundredths.
        0 => 0.1,
        1 => 0.01,
        _ => 100.0 / 27_648.0,
    };
    f32::from(call.int(word)) * unit * call.real(factor) + call.real(offset)
}

/// The integral action after a change of the set point that is worth `step` of the proportional action: PFAC_SP of it
/// takes effect.
pub(super) fn proportional_step(integral: f32, step: f32, factor: f32) -> f32 {
    integral - (1.0 - factor.clamp(0.0, 1.0)) * step
}

/// A manipulated value inside its limits. (`clamp` panics where a limit of the program's is not a number.)
pub(super) fn limited(value: f32, [low, high]: [f32; 2]) -> f32 {
    if value >= high {
        high
    } else if value <= low {
        low
    } else {
        value
    }
}

/// How often the shorter time fits into the longer one.
pub(super) fn sampled(long: f32, short: f32) -> i16 {
    let times = (long / short.max(0.001)).round_ties_even();
    if times.is_finite() { times.clamp(1.0, f32::from(i16::MAX)) as i16 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::super::input::real;
    use super::*;
    use crate::tests::Fake;

    #[test]
    fn ranges_of_analog_inputs() {
        for (from_periphery, word, mode, value) in
            [(false, 100, 0, 7.0), (true, 215, 0, 44.0), (true, 2150, 1, 44.0), (true, 27_648, 2, 201.0)]
        {
            let mut fake = Fake::new("PID:FB59").with("PVPER_ON", [u8::from(from_periphery)]).with("PV_IN", real(7.0));
            fake = fake.with("PV_PER", i16::to_be_bytes(word)).with("PER_MODE", i16::to_be_bytes(mode));
            fake = fake.with("PV_FAC", real(2.0)).with("PV_OFFS", real(1.0));
            fake.run();
            assert!((f32::from_bits(fake.value("PV")) - value).abs() < 1e-4, "{mode}");
        }
    }

    #[test]
    fn limits() {
        for (value, limits, result) in [(5.0, [0.0, 9.0], 5.0), (-1.0, [0.0, 9.0], 0.0), (10.0, [0.0, 9.0], 9.0)] {
            assert_eq!(limited(value, limits), result);
        }
        assert_eq!(limited(5.0, [f32::NAN, f32::NAN]), 5.0);
    }

    #[test]
    fn steps_and_calls() {
        assert_eq!(proportional_step(5.0, 10.0, 1.0), 5.0);
        assert_eq!(proportional_step(5.0, 10.0, 0.0), -5.0);
        assert_eq!(proportional_step(5.0, 10.0, 7.0), 5.0);
        for (long, short, calls) in [(0.1, 0.02, 5), (0.1, 1.0, 1), (1e9, 0.0, i16::MAX), (f32::NAN, 1.0, 1)] {
            assert_eq!(sampled(long, short), calls);
        }
    }
}
