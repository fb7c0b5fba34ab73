//! Times, dates and times of day as constants write them.

use ob1_model::calendar::{self, DAYS_TO_1990};

/// `1D_2H_3M_4S_5MS`, each unit at most once and in this order, in milliseconds.
pub(crate) fn duration(text: &str) -> Option<u64> {
    const UNITS: [(&str, u64); 5] = [("D", 86_400_000), ("H", 3_600_000), ("M", 60_000), ("S", 1_000), ("MS", 1)];
    let mut rest = text;
    let mut units = &UNITS[..];
    let mut total = 0u64;
    if let Some((number, unit)) = fraction(text) {
        let (_, ms) = UNITS.iter().find(|(name, _)| name.eq_ignore_ascii_case(unit))?;
        return u64::try_from((number? * i128::from(*ms)) / 1_000_000).ok();
    }
    while !rest.is_empty() {
        let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        let (number, tail) = rest.split_at(digits);
        let letters = tail.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(tail.len());
        let (unit, tail) = tail.split_at(letters);
        let at = units.iter().position(|(name, _)| name.eq_ignore_ascii_case(unit))?;
        let ms = number.parse::<u64>().ok()?.checked_mul(units[at].1)?;
        total = total.checked_add(ms)?;
        units = &units[at + 1..];
        rest = tail.strip_prefix('_').filter(|r| !r.is_empty()).unwrap_or_else(|| if tail == "_" { "?" } else { tail });
    }
    (!text.is_empty()).then_some(total)
}

/// `0.5S`: the one unit with a fraction, in millionths, and the unit's letters.
fn fraction(text: &str) -> Option<(Option<i128>, &str)> {
    let letters = text.find(|c: char| c.is_ascii_alphabetic())?;
    let (number, unit) = text.split_at(letters);
    let (whole, part) = number.split_once('.')?;
    let part: String = part.chars().chain("000000".chars()).take(6).collect();
    Some((format!("{whole}{part}").parse().ok(), unit))
}

/// A duration as [`duration`] and [`signed_duration`] read it: `1S500MS`.
pub(crate) fn written_duration(ms: i64) -> String {
    let mut rest = ms.unsigned_abs();
    let mut out = String::from(if ms < 0 { "-" } else { "" });
    for (unit, length) in [("D", 86_400_000), ("H", 3_600_000), ("M", 60_000), ("S", 1_000), ("MS", 1)] {
        if rest >= length {
            out += &format!("{}{unit}", rest / length);
            rest %= length;
        }
    }
    if ms == 0 { "0MS".to_owned() } else { out }
}

/// A TIME, perhaps negative.
pub(crate) fn signed_duration(text: &str) -> Option<i32> {
    let (negative, text) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let ms = i64::try_from(duration(text)?).ok()?;
    i32::try_from(if negative { -ms } else { ms }).ok()
}

/// Days since 1990-01-01 of a date up to 2168-12-31.
fn days(year: u32, month: u32, day: u32) -> Option<u16> {
    let days = calendar::days_of(year, month, day)?.checked_sub(DAYS_TO_1990)?;
    u16::try_from(days).ok().filter(|_| year <= 2168)
}

fn numbers<const N: usize>(text: &str, separator: char) -> Option<[u32; N]> {
    let mut out = [0; N];
    let mut parts = text.split(separator);
    for slot in &mut out {
        *slot = parts.next()?.parse().ok()?;
    }
    parts.next().is_none().then_some(out)
}

/// `1994-3-15`: days since 1990-01-01.
pub(crate) fn date(text: &str) -> Option<u16> {
    let [year, month, day] = numbers(text, '-')?;
    days(year, month, day)
}

/// `12:30:10.500`: milliseconds since midnight.
pub(crate) fn time_of_day(text: &str) -> Option<u32> {
    let (clock, fraction) = text.split_once('.').unwrap_or((text, ""));
    let [hours, minutes, seconds] = numbers(clock, ':')?;
    if hours > 23 || minutes > 59 || seconds > 59 || fraction.len() > 3 || !fraction.bytes().all(|b| b.is_ascii_digit())
    {
        return None;
    }
    let ms: u32 = format!("{fraction:0<3}").parse().ok()?;
    Some(((hours * 60 + minutes) * 60 + seconds) * 1_000 + ms)
}

/// `1994-3-15-12:30:10.5`: year, month, day, weekday (1 = Sunday), hour, minute, second, nanoseconds.
pub(crate) fn dtl(text: &str) -> Option<[u8; 12]> {
    let (day_part, clock) = text.rsplit_once('-')?;
    let [year, month, day]: [u32; 3] = numbers(day_part, '-')?;
    let (clock, fraction) = clock.split_once('.').unwrap_or((clock, ""));
    let [hour, minute, second]: [u32; 3] = numbers(clock, ':')?;
    let digits = fraction.len() <= 9 && fraction.bytes().all(|b| b.is_ascii_digit());
    if !digits || year > 2554 || hour > 23 || minute > 59 || second > 59 {
        return None;
    }
    let weekday = calendar::weekday_of(calendar::days_of(year, month, day)?);
    let nanoseconds: u32 = format!("{fraction:0<9}").parse().ok()?;
    let mut bytes = [0; 12];
    bytes[..2].copy_from_slice(&(year as u16).to_be_bytes());
    for (slot, value) in bytes[2..8].iter_mut().zip([month, day, weekday, hour, minute, second]) {
        *slot = value as u8;
    }
    bytes[8..].copy_from_slice(&nanoseconds.to_be_bytes());
    Some(bytes)
}

/// `94-3-15-12:30:10.500` or with a year of four digits (1990 to 2089): the eight BCD bytes, weekday 1 = Sunday.
pub(crate) fn date_and_time(text: &str) -> Option<[u8; 8]> {
    let (day_part, clock) = text.rsplit_once('-')?;
    let [year, month, day] = numbers(day_part, '-')?;
    let year = match year {
        0..=89 => year + 2000,
        90..=99 => year + 1900,
        1990..=2089 => year,
        _ => return None,
    };
    let days = u32::from(days(year, month, day)?);
    let ms = time_of_day(clock)?;
    Some(calendar::date_and_time(days + DAYS_TO_1990, ms))
}

/// A date as [`date`] reads it: `1994-3-15`.
pub(crate) fn written_date(days: u16) -> Option<String> {
    let (year, month, day) = calendar::date_of(u32::from(days) + DAYS_TO_1990);
    (year <= 2168).then(|| format!("{year}-{month}-{day}"))
}

/// A time of day as [`time_of_day`] reads it: `12:30:10.500`.
pub(crate) fn written_time_of_day(ms: u32) -> Option<String> {
    let (hours, minutes, seconds) = (ms / 3_600_000, ms / 60_000 % 60, ms / 1_000 % 60);
    (hours < 24).then(|| format!("{hours}:{minutes}:{seconds}.{:03}", ms % 1_000))
}

/// A date and time as [`date_and_time`] reads it. The caller sees whether it means the very same bytes.
pub(crate) fn written_date_and_time(bytes: &[u8]) -> Option<String> {
    let [year, month, day, hour, minute, second, hundredths, last] = *<&[u8; 8]>::try_from(bytes).ok()?;
    let digits = |byte: u8| u32::from(byte >> 4) * 10 + u32::from(byte & 15);
    let year = digits(year) + if digits(year) >= 90 { 1900 } else { 2000 };
    let ms = digits(hundredths) * 10 + u32::from(last >> 4);
    let (month, day, hour) = (digits(month), digits(day), digits(hour));
    Some(format!("{year}-{month}-{day}-{hour}:{}:{}.{ms:03}", digits(minute), digits(second)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations() {
        assert_eq!(duration("2S500MS"), Some(2_500));
        assert_eq!(duration("1h_20m"), Some(4_800_000));
        assert_eq!(signed_duration("-1D"), Some(-86_400_000));
        for wrong in ["", "5", "S", "1S1S", "1MS1S", "1S_", "99999999999999999999S", "1X"] {
            assert_eq!(duration(wrong), None, "{wrong}");
        }
        assert_eq!(signed_duration("24D20H31M23S647MS"), Some(i32::MAX));
        assert_eq!(signed_duration("24D20H31M23S648MS"), None);
    }

    #[test]
    fn dates() {
        assert_eq!(date("1990-1-1"), Some(0));
        assert_eq!(date("2168-12-31"), Some(65_378));
        assert_eq!(date("2000-2-29"), Some(3_711));
        assert_eq!(date("2001-2-29"), None);
        assert_eq!(time_of_day("23:59:59.999"), Some(86_399_999));
        assert_eq!(time_of_day("24:0:0"), None);
    }

    #[test]
    fn dates_with_times_are_bcd() {
        // 1994-03-15 was a Tuesday.
        assert_eq!(date_and_time("94-3-15-12:30:10.5"), Some([0x94, 3, 0x15, 0x12, 0x30, 0x10, 0x50, 3]));
        assert_eq!(date_and_time("1990-1-1-0:0:0.001"), Some([0x90, 1, 1, 0, 0, 0, 0, 0x12]));
        assert_eq!(date_and_time("94-3-15"), None);
    }
}
