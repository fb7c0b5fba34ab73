//! Times of block records: milliseconds of the day and days since 1984, big-endian.

use std::fmt;

/// A time of a block record. Unset times are older than all others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    days: u16,
    millis: u32,
}

impl Stamp {
    /// From the 6 bytes of a record; anything else is unset.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        match bytes {
            [a, b, c, d, e, f, ..] => {
                Self { days: u16::from_be_bytes([*e, *f]), millis: u32::from_be_bytes([*a, *b, *c, *d]) }
            }
            _ => Self::default(),
        }
    }

    /// The 6 bytes of a record.
    #[must_use]
    pub fn bytes(self) -> [u8; 6] {
        let ([a, b, c, d], [e, f]) = (self.millis.to_be_bytes(), self.days.to_be_bytes());
        [a, b, c, d, e, f]
    }

    /// True for a record without a time.
    #[must_use]
    pub fn is_unset(self) -> bool {
        self == Self::default()
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Days since 1984-01-01 by the civil calendar.
        let mut day = u32::from(self.days);
        let mut year = 1984;
        let leap = |y: u32| y.is_multiple_of(4) && (!y.is_multiple_of(100) || y.is_multiple_of(400));
        while day >= 365 + u32::from(leap(year)) {
            day -= 365 + u32::from(leap(year));
            year += 1;
        }
        let mut month = 0;
        let lengths = [31, 28 + u32::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
        while let Some(length) = lengths.get(month).filter(|length| day >= **length) {
            day -= length;
            month += 1;
        }
        let seconds = self.millis / 1000;
        let (h, m, s) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
        write!(f, "{year}-{:02}-{:02} {h:02}:{m:02}:{s:02}", month + 1, day + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stamp_of_the_layout() {
        let stamp = Stamp::of_bytes(&[0x02, 0x74, 0xA1, 0xF1, 0x30, 0x91]);
        assert_eq!(stamp.to_string(), "2018-01-15 11:26:38");
        assert!(Stamp::of_bytes(&[0; 6]).is_unset() && Stamp::of_bytes(&[]).is_unset());
        assert!(Stamp::of_bytes(&[0; 6]) < stamp);
        assert_eq!(Stamp::of_bytes(&[0, 0, 0, 0, 0, 59]).to_string(), "1984-02-29 00:00:00");
    }
}
