//! What every controller begins with: start values of its declaration, the process variable, the dead band.

/// A TIME of seconds as laid-out bytes.
pub(super) const fn seconds(s: u32) -> [u8; 4] {
    (s * 1000).to_be_bytes()
}

/// A REAL as laid-out bytes.
pub(super) const fn real(value: f32) -> [u8; 4] {
    value.to_be_bytes()
}

/// A BOOL that is 1.
pub(super) const TRUE: [u8; 1] = [1];

/// The process variable: the REAL, or the analog word as a percentage by factor and offset.
pub(super) fn process_variable(external: bool, word: u16, [input, factor, offset]: [f32; 3]) -> f32 {
    if external { f32::from(word as i16) * 100.0 / 27_648.0 * factor + offset } else { input }
}

/// The error signal after the dead band: 0 inside, closer to 0 by the band's width outside.
pub(super) fn dead_band(error: f32, width: f32) -> f32 {
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
