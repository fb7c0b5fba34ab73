//! The calendar, for dates of any epoch of STEP 7: 1970 (DTL), 1984 (blocks), 1990 (DATE).

use crate::bcd::to_bcd;

/// Days from 1970-01-01 to 1984-01-01, where the moments of blocks begin.
pub const DAYS_TO_1984: u32 = 5_113;

/// Days from 1970-01-01 to 1990-01-01, where DATE begins.
pub const DAYS_TO_1990: u32 = 7_305;

/// Milliseconds of a day.
pub const DAY_MS: u64 = 86_400_000;

/// Days from 1600-03-01, so that a leap day ends its year, to 1970-01-01.
const FROM_1600: u32 = 135_080;

/// Days of a month, 1 to 12.
pub const fn days_of_month(year: u32, month: u32) -> u32 {
    match month {
        2 if year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400)) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Days from 1970-01-01 to a date; `None` for one that does not exist, or lies before 1970 or after 9999.
pub const fn days_of(year: u32, month: u32, day: u32) -> Option<u32> {
    if year < 1970 || year > 9999 || month == 0 || month > 12 || day == 0 || day > days_of_month(year, month) {
        return None;
    }
    let year = year - 1600 - (month <= 2) as u32;
    let days_of_years = year * 365 + year / 4 - year / 100 + year / 400;
    let days_of_months = (153 * ((month + 9) % 12) + 2) / 5;
    Some(days_of_years + days_of_months + day - 1 - FROM_1600)
}

/// Year, month and day so many days after 1970-01-01.
pub const fn date_of(days: u32) -> (u32, u32, u32) {
    let day = days as u64 + FROM_1600 as u64;
    let (era, day) = ((day / 146_097) as u32, (day % 146_097) as u32);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let shifted = (5 * day + 2) / 153;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    (1600 + era * 400 + year + (month <= 2) as u32, month, day - (153 * shifted + 2) / 5 + 1)
}

/// The day of the week so many days after 1970-01-01, a Thursday: 1 = Sunday.
pub const fn weekday_of(days: u32) -> u32 {
    (days % 7 + 4) % 7 + 1
}

/// The eight bytes of a DATE_AND_TIME: a day of 1990 to 2089 by the days after 1970-01-01, and the milliseconds since
/// midnight.
pub fn date_and_time(days: u32, ms: u32) -> [u8; 8] {
    let (year, month, day) = date_of(days);
    let byte = |value: u32| to_bcd(value % 100) as u8;
    let (seconds, thousandths) = (ms / 1000, ms % 1000);
    [
        byte(year),
        byte(month),
        byte(day),
        byte(seconds / 3600),
        byte(seconds / 60 % 60),
        byte(seconds % 60),
        byte(thousandths / 10),
        ((thousandths % 10) << 4 | weekday_of(days)) as u8,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_day_follows_the_one_before() {
        let mut date = (1970, 1, 1);
        for days in 0..400_000 {
            assert_eq!((date_of(days), days_of(date.0, date.1, date.2)), (date, Some(days)));
            date.2 += 1;
            if date.2 > days_of_month(date.0, date.1) {
                date = (date.0 + date.1 / 12, date.1 % 12 + 1, 1);
            }
        }
    }

    #[test]
    fn the_epochs_are_where_they_say() {
        assert_eq!(date_of(DAYS_TO_1984), (1984, 1, 1));
        assert_eq!(date_of(DAYS_TO_1990), (1990, 1, 1));
        assert_eq!((weekday_of(0), weekday_of(DAYS_TO_1990)), (5, 2), "a Thursday, a Monday");
        assert_eq!(date_of(u32::MAX).0, 11_761_191);
    }

    #[test]
    fn what_does_not_exist_is_none() {
        for (year, month, day) in
            [(1969, 12, 31), (2001, 2, 29), (2100, 2, 29), (2000, 13, 1), (2000, 0, 1), (2000, 1, 0)]
        {
            assert_eq!(days_of(year, month, day), None, "{year}-{month}-{day}");
        }
        assert!(days_of(2000, 2, 29).is_some());
    }
}
