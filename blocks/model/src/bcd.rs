//! Decimal numbers with four bits for each digit.

/// The digits of a number; those beyond eight are dropped.
pub const fn to_bcd(value: u32) -> u32 {
    let (mut left, mut bits, mut shift) = (value, 0, 0);
    while left > 0 && shift < 32 {
        bits |= (left % 10) << shift;
        left /= 10;
        shift += 4;
    }
    bits
}

/// The number with these digits; `None` when one of them is above 9.
pub const fn from_bcd(bits: u32) -> Option<u32> {
    let (mut value, mut shift) = (0, 32);
    while shift > 0 {
        shift -= 4;
        let digit = bits >> shift & 15;
        if digit > 9 {
            return None;
        }
        value = value * 10 + digit;
    }
    Some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_go_both_ways() {
        for (value, bits) in [(0, 0), (7, 7), (10, 0x10), (999, 0x999), (12_345_678, 0x1234_5678)] {
            assert_eq!((to_bcd(value), from_bcd(bits)), (bits, Some(value)));
        }
        assert_eq!(to_bcd(3_112_345_678), 0x1234_5678);
        for wrong in [0xA, 0xF0, 0xB000_0000] {
            assert_eq!(from_bcd(wrong), None, "{wrong:X}");
        }
    }
}
