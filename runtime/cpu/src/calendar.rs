//! DATE_AND_TIME as it stands in start information: eight BCD bytes.

use crate::Nanos;

/// The eight bytes for `nanos` since 1990-01-01: year, month, day, hour, minute, second, milliseconds and day of the
/// week (1 = Sunday).
#[must_use]
pub fn date_and_time(nanos: Nanos) -> [u8; 8] {
    let ms = nanos / 1_000_000;
    let (days, ms_of_day) = (ms / 86_400_000, ms % 86_400_000);
    let (year, month, day) = civil(days);
    // 1990-01-01 was a Monday, day 2.
    let weekday = (days + 1) % 7 + 1;
    let bcd = |v: u64| (((v / 10 % 10) << 4) | (v % 10)) as u8;
    let milli = ms_of_day % 1000;
    [
        bcd(year % 100),
        bcd(month),
        bcd(day),
        bcd(ms_of_day / 3_600_000),
        bcd(ms_of_day / 60_000 % 60),
        bcd(ms_of_day / 1000 % 60),
        bcd(milli / 10),
        ((milli % 10) << 4) as u8 | weekday as u8,
    ]
}

/// Year, month and day of a day counted from 1990-01-01. Eras of 400 years from March 1600, so that leap days end a
/// year.
fn civil(days: u64) -> (u64, u64, u64) {
    const MARCH_1600_TO_1990: u64 = 142_385;
    let day = days + MARCH_1600_TO_1990;
    let (era, day) = (day / 146_097, day % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let shifted = (5 * day + 2) / 153;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let date = day - (153 * shifted + 2) / 5 + 1;
    (1600 + era * 400 + year + u64::from(month <= 2), month, date)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates() {
        let day = 86_400_000_000_000;
        for (nanos, bytes) in [
            (0, [0x90, 0x01, 0x01, 0, 0, 0, 0, 0x02]),
            (59 * day, [0x90, 0x03, 0x01, 0, 0, 0, 0, 0x05]),
            (
                (3652 + 59) * day + 13 * 3_600_000_000_000 + 5 * 60_000_000_000 + 59_123_000_000,
                [0x00, 0x02, 0x29, 0x13, 0x05, 0x59, 0x12, 0x33],
            ),
        ] {
            assert_eq!(date_and_time(nanos), bytes, "{nanos}");
        }
    }
}
