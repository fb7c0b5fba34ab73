//! Date and time: ten bytes, BCD.

/// Bytes of a date and time on the wire.
pub const CLOCK_BYTES: usize = 10;

/// The byte that should be the century.
const CENTURY: u8 = 0x19;

/// A date and time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct DateTime {
    /// The year, 1990 to 2089.
    pub year: u16,
    /// The month, 1 to 12.
    pub month: u8,
    /// The day, 1 to 31.
    pub day: u8,
    /// The hour, 0 to 23.
    pub hour: u8,
    /// The minute, 0 to 59.
    pub minute: u8,
    /// The second, 0 to 59.
    pub second: u8,
    /// The millisecond, 0 to 999.
    pub ms: u16,
}

const fn bcd(value: u8) -> u8 {
    value + value / 10 * 6
}

fn from_bcd(byte: u8) -> Option<u8> {
    let (high, low) = (byte >> 4, byte & 0x0F);
    (high < 10 && low < 10).then(|| high * 10 + low)
}

impl DateTime {
    /// The eight bytes of a `DATE_AND_TIME`, as in the CPU.
    #[must_use]
    pub fn date_and_time(&self) -> [u8; 8] {
        let tens = (self.ms / 10) as u8;
        let ones = (self.ms % 10) as u8;
        let year = (self.year % 100) as u8;
        let clock = [year, self.month, self.day, self.hour, self.minute, self.second, tens].map(bcd);
        let [a, b, c, d, e, f, g] = clock;
        [a, b, c, d, e, f, g, ones << 4 | self.weekday()]
    }

    /// From a `DATE_AND_TIME`; the day of the week is recalculated.
    #[must_use]
    pub fn of_date_and_time(bytes: [u8; 8]) -> Option<Self> {
        let [year, month, day, hour, minute, second, tens, ones] = bytes;
        let year = u16::from(from_bcd(year)?);
        let time = Self {
            year: if year < 90 { 2000 + year } else { 1900 + year },
            month: from_bcd(month)?,
            day: from_bcd(day)?,
            hour: from_bcd(hour)?,
            minute: from_bcd(minute)?,
            second: from_bcd(second)?,
            ms: u16::from(from_bcd(tens)?) * 10 + u16::from(ones >> 4),
        };
        time.exists().then_some(time)
    }

    /// The ten bytes on the wire: a reserved one, 19h in any year (as a CPU has it), a `DATE_AND_TIME`.
    #[must_use]
    pub fn bytes(&self) -> [u8; CLOCK_BYTES] {
        let [a, b, c, d, e, f, g, h] = self.date_and_time();
        [0, CENTURY, a, b, c, d, e, f, g, h]
    }

    /// From the bytes on the wire. The century is ignored: clients send 19h in any year.
    #[must_use]
    pub fn read(data: &[u8]) -> Option<Self> {
        let bytes = data.first_chunk::<CLOCK_BYTES>()?;
        Self::of_date_and_time(*bytes.last_chunk::<8>()?)
    }

    fn exists(&self) -> bool {
        let leap = self.year.is_multiple_of(4) && (!self.year.is_multiple_of(100) || self.year.is_multiple_of(400));
        let days = match self.month {
            4 | 6 | 9 | 11 => 30,
            2 if leap => 29,
            2 => 28,
            1..=12 => 31,
            _ => 0,
        };
        (1..=days).contains(&self.day) && self.hour < 24 && self.minute < 60 && self.second < 60 && self.ms < 1000
    }

    /// Day of the week; 1 is Sunday.
    fn weekday(&self) -> u8 {
        // Days of the months before, with the year beginning in March.
        let (year, month) = if self.month < 3 { (self.year - 1, self.month + 9) } else { (self.year, self.month - 3) };
        let year = u32::from(year);
        let days =
            year * 365 + year / 4 - year / 100 + year / 400 + (u32::from(month) * 153 + 2) / 5 + u32::from(self.day);
        // The first of March of the year 0 was a Wednesday.
        ((days + 2) % 7) as u8 + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_go_both_ways() {
        let time = DateTime { year: 2026, month: 11, day: 22, hour: 16, minute: 5, second: 9, ms: 987 };
        // A Sunday.
        assert_eq!(time.bytes(), [0, 0x19, 0x26, 0x11, 0x22, 0x16, 0x05, 0x09, 0x98, 0x71]);
        assert_eq!(DateTime::read(&time.bytes()), Some(time));
        // A Saturday, and the last day of the range, a Saturday as well.
        assert_eq!(DateTime { year: 2000, month: 1, day: 1, ..time }.bytes()[9] & 15, 7);
        assert_eq!(DateTime { year: 1990, month: 1, day: 1, ..time }.bytes()[9] & 15, 2);
        assert_eq!(DateTime { year: 2024, month: 2, day: 29, ..time }.bytes()[9] & 15, 5);
    }

    #[test]
    fn what_is_no_time_is_refused() {
        for bytes in [
            [0, 0x19, 0x26, 0x13, 0x22, 0x16, 0x05, 0x09, 0x98, 0x71],
            [0, 0x19, 0x26, 0x02, 0x30, 0x16, 0x05, 0x09, 0x98, 0x71],
            [0, 0x19, 0x26, 0x11, 0x22, 0x24, 0x05, 0x09, 0x98, 0x71],
            [0, 0x19, 0x2A, 0x11, 0x22, 0x16, 0x05, 0x09, 0x98, 0x71],
            [0, 0x19, 0x26, 0x00, 0x22, 0x16, 0x05, 0x09, 0x98, 0x71],
        ] {
            assert_eq!(DateTime::read(&bytes), None);
        }
        assert_eq!(DateTime::read(&[0; 9]), None);
        // The century is not evaluated: 00 to 89 means this one.
        assert_eq!(DateTime::read(&[0, 0x19, 0x89, 1, 1, 0, 0, 0, 0, 0]).map(|time| time.year), Some(2089));
    }
}
