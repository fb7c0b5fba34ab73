//! "PID Control Blocks": FB 41 CONT_C, FB 42 CONT_S, FB 43 PULSEGEN; the compact CPUs have the same three as SFB 41 to
//! 43. ["Integrated Control"] FB 58 TCONT_CP, FB 59 TCONT_S: the temperature controllers of the same library.
//!
//! They count in CYCLE, the interval at which the program calls them, and read no clock. The equations are the sampled
//! form of the manual's block diagrams; statics whose names the manual does not give are ours.

mod actuator;
mod cont_c;
mod cont_s;
mod pulsegen;
mod tcont_cp;
mod tcont_s;
mod temperature;
mod tuning;

use crate::row::Row;

pub(crate) const ROWS: &[&[Row]] = &[cont_c::ROWS, cont_s::ROWS, pulsegen::ROWS, tcont_cp::ROWS, tcont_s::ROWS];

/// A TIME of seconds as laid-out bytes.
const fn seconds(s: u32) -> [u8; 4] {
    (s * 1000).to_be_bytes()
}

/// A REAL as laid-out bytes.
const fn real(value: f32) -> [u8; 4] {
    value.to_be_bytes()
}

/// A BOOL that is 1.
const TRUE: [u8; 1] = [1];

/// The process variable: the REAL, or the analog word as a percentage by factor and offset.
fn process_variable(external: bool, word: u16, [input, factor, offset]: [f32; 3]) -> f32 {
    if external { f32::from(word as i16) * 100.0 / 27_648.0 * factor + offset } else { input }
}

/// The error signal after the dead band: 0 inside, closer to 0 by the band's width outside.
fn dead_band(error: f32, width: f32) -> f32 {
    let width = width.max(0.0);
    if error > width {
        error - width
    } else if error < -width {
        error + width
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn input_path() {
        assert_eq!(process_variable(false, 27_648, [3.0, 2.0, 1.0]), 3.0);
        assert_eq!(process_variable(true, 27_648, [3.0, 2.0, 1.0]), 201.0);
        assert_eq!(process_variable(true, (-13_824i16) as u16, [3.0, 1.0, 0.0]), -50.0);
        for (error, result) in [(0.5, 0.0), (1.0, 0.0), (1.5, 0.5), (-1.0, 0.0), (-3.0, -2.0)] {
            assert_eq!(dead_band(error, 1.0), result, "{error}");
        }
        assert_eq!(dead_band(0.25, 0.0), 0.25);
    }
}
