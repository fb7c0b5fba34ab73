//! DATE_AND_TIME: eight BCD bytes, and milliseconds since 1990-01-01 to calculate with.

use std::fmt;

use crate::bcd::from_bcd;
use crate::calendar::{self, DAY_MS, DAYS_TO_1990};

/// A point in time that DATE_AND_TIME can show: 1990-01-01 to 2089-12-31, to the millisecond.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Moment(u64);

/// A calendar date between 1990 and 2089.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Date {
    /// The year, 1990 to 2089.
    pub year: u32,
    /// The month, 1 to 12.
    pub month: u32,
    /// The day, 1 to 31.
    pub day: u32,
}

impl Date {
    /// Days of a month.
    pub const fn days_of_month(year: u32, month: u32) -> u32 {
        calendar::days_of_month(year, month)
    }

    /// Days since 1990-01-01; `None` for a date that does not exist or lies outside the years of DATE_AND_TIME.
    pub fn days(self) -> Option<u32> {
        let days = calendar::days_of(self.year, self.month, self.day)?.checked_sub(DAYS_TO_1990)?;
        (days <= Moment::MAX.days()).then_some(days)
    }

    /// The date so many days after 1990-01-01; `None` after 2089.
    pub const fn from_days(days: u32) -> Option<Self> {
        if days > Moment::MAX.days() {
            return None;
        }
        let (year, month, day) = calendar::date_of(days + DAYS_TO_1990);
        Some(Self { year, month, day })
    }
}

impl Moment {
    /// The first moment, 1990-01-01-00:00:00.000.
    pub const MIN: Moment = Moment(0);
    /// The last moment, 2089-12-31-23:59:59.999.
    pub const MAX: Moment = Moment(36_525 * DAY_MS - 1);

    /// The moment `ms` after [`Moment::MIN`], or `None` after [`Moment::MAX`].
    pub const fn from_ms(ms: u64) -> Option<Self> {
        if ms > Self::MAX.0 { None } else { Some(Self(ms)) }
    }

    /// Milliseconds since the first moment, [`Moment::MIN`].
    pub const fn ms(self) -> u64 {
        self.0
    }

    /// Whole days since 1990-01-01.
    pub const fn days(self) -> u32 {
        (self.0 / DAY_MS) as u32
    }

    /// Milliseconds since midnight of its day.
    pub const fn time_of_day(self) -> u32 {
        (self.0 % DAY_MS) as u32
    }

    /// The day of the week, 1 = Sunday.
    pub const fn weekday(self) -> u32 {
        calendar::weekday_of(self.days() + DAYS_TO_1990)
    }

    /// The moment plus a TIME; limited to what DATE_AND_TIME can show, then the second value is false.
    #[must_use]
    pub fn plus(self, ms: i64) -> (Self, bool) {
        let sum = self.0.checked_add_signed(ms);
        match sum {
            Some(sum) if sum <= Self::MAX.0 => (Self(sum), true),
            Some(_) => (Self::MAX, false),
            None => (Self::MIN, false),
        }
    }

    /// From the eight bytes of a DATE_AND_TIME. The day of the week is ignored.
    ///
    /// # Errors
    /// Not a date or not a time.
    pub fn from_bytes(bytes: [u8; 8]) -> Result<Self, MomentError> {
        let digits = |i: usize| from_bcd(u32::from(bytes[i]));
        let date = || {
            let year = digits(0)?;
            let year = if year >= 90 { 1900 + year } else { 2000 + year };
            Date { year, month: digits(1)?, day: digits(2)? }.days()
        };
        let time = || {
            let (hour, minute, second) = (digits(3)?, digits(4)?, digits(5)?);
            let milli = digits(6)? * 10 + from_bcd(u32::from(bytes[7] >> 4))?;
            (hour < 24 && minute < 60 && second < 60).then(|| ((hour * 60 + minute) * 60 + second) * 1000 + milli)
        };
        let days = date().ok_or(MomentError::Date)?;
        let time = time().ok_or(MomentError::Time)?;
        Ok(Self(u64::from(days) * DAY_MS + u64::from(time)))
    }

    /// As eight bytes, the day of the week included.
    pub fn to_bytes(self) -> [u8; 8] {
        calendar::date_and_time(self.days() + DAYS_TO_1990, self.time_of_day())
    }
}

impl fmt::Display for Moment {
    /// Date and time with milliseconds: `2026-01-31 06:00:00.000`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (year, month, day) = calendar::date_of(self.days() + DAYS_TO_1990);
        let ms = self.time_of_day();
        let (hours, minutes, seconds) = (ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60);
        write!(f, "{year}-{month:02}-{day:02} {hours:02}:{minutes:02}:{seconds:02}.{:03}", ms % 1000)
    }
}

/// What is wrong with a DATE_AND_TIME.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MomentError {
    /// Year, month or day.
    Date,
    /// Hour, minute, second or millisecond.
    Time,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_day_goes_both_ways() {
        for days in 0..36_525 {
            let date = Date::from_days(days).unwrap();
            assert_eq!(date.days(), Some(days), "{date:?}");
            let moment = Moment::from_ms(u64::from(days) * DAY_MS + 45_296_789).unwrap();
            assert_eq!(Moment::from_bytes(moment.to_bytes()), Ok(moment));
        }
        assert_eq!(Date::from_days(36_525), None);
        assert_eq!(Moment::MIN.to_string(), "1990-01-01 00:00:00.000");
        assert_eq!(Moment::MAX.to_string(), "2089-12-31 23:59:59.999");
    }

    #[test]
    fn the_bytes_of_the_limits() {
        assert_eq!(Moment::MIN.to_bytes(), [0x90, 1, 1, 0, 0, 0, 0, 2]);
        assert_eq!(Moment::MAX.to_bytes(), [0x89, 0x12, 0x31, 0x23, 0x59, 0x59, 0x99, 0x97]);
        assert_eq!(Moment::from_ms(Moment::MAX.ms() + 1), None);
    }

    #[test]
    fn what_is_no_moment() {
        for (bytes, error) in [
            ([0x9A, 1, 1, 0, 0, 0, 0, 2], MomentError::Date),
            ([0x99, 2, 0x29, 0, 0, 0, 0, 2], MomentError::Date),
            ([0x99, 0, 1, 0, 0, 0, 0, 2], MomentError::Date),
            ([0x99, 1, 1, 0x24, 0, 0, 0, 2], MomentError::Time),
            ([0x99, 1, 1, 0, 0x60, 0, 0, 2], MomentError::Time),
            ([0x99, 1, 1, 0, 0, 0, 0, 0xA2], MomentError::Time),
        ] {
            assert_eq!(Moment::from_bytes(bytes), Err(error), "{bytes:02X?}");
        }
        assert_eq!(Moment::from_bytes([0, 2, 0x29, 0, 0, 0, 0, 0]).map(|m| m.weekday()), Ok(3));
    }
}
