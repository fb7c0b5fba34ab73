//! Times as a station file and the command line write them: `1ms`, `250us`, `1.5s`, `8h`.

use ob1_time::Span;

const UNITS: [(&str, Span); 7] = [
    ("ns", Span::from_nanos(1)),
    ("us", Span::MICROSECOND),
    ("µs", Span::MICROSECOND),
    ("ms", Span::MILLISECOND),
    ("s", Span::SECOND),
    ("min", Span::from_secs(60)),
    ("h", Span::from_secs(3_600)),
];
const LONGEST: Span = Span::from_secs(24 * 3_600);

/// Most days of a run that somebody ends.
const MOST_DAYS: u64 = 366;

/// Reads the length of a run: days (`7d`), at most a year, or as [`parse_duration`].
///
/// # Errors
/// What is wrong, in one sentence that shows how to write it.
pub fn parse_run(text: &str) -> Result<Span, String> {
    let days = text.trim().strip_suffix('d').and_then(|days| days.trim().parse::<u64>().ok());
    match days {
        Some(days) if days > MOST_DAYS => Err(format!("\"{text}\" is too long; at most {MOST_DAYS}d")),
        Some(days) => Ok(Span::from_secs(days * 24 * 3_600)),
        None => parse_duration(text),
    }
}

/// Reads a time: a number, with decimals if need be, and a unit (`ns us µs ms s min h`).
///
/// # Errors
/// What is wrong, in one sentence that shows how to write it.
pub fn parse_duration(text: &str) -> Result<Span, String> {
    let text = text.trim();
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let unit = unit.trim();
    let Some((_, scale)) = UNITS.iter().find(|(name, _)| *name == unit) else {
        return Err(if unit.is_empty() {
            format!("\"{text}\" has no unit; write it like \"10ms\" (ns, us, ms, s, min, h)")
        } else if unit.starts_with('-') {
            format!("\"{text}\" is no time; write it like \"10ms\": a number that is not negative, and a unit")
        } else if text.contains(',') {
            format!("\"{text}\" has a decimal comma; write \"{}\"", text.replacen(',', ".", 1))
        } else {
            format!("\"{unit}\" is not a unit of time; use ns, us, ms, s, min or h")
        });
    };
    let (whole, decimals) = number.split_once('.').unwrap_or((number, ""));
    if number.is_empty() || (whole.is_empty() && decimals.is_empty()) || decimals.contains('.') {
        return Err(format!("\"{text}\" has no number; write it like \"10ms\""));
    }
    let too_long = || format!("\"{text}\" is too long; at most 24h");
    let whole: u64 = if whole.is_empty() { 0 } else { whole.parse().map_err(|_| too_long())? };
    // Saturates, and the longest span is too long.
    let mut time = scale.times(whole);
    let mut place = *scale;
    for digit in decimals.bytes() {
        // Decimals finer than a nanosecond are ignored.
        place = place / 10;
        time = time.saturating_add(u64::from(digit - b'0') * place);
    }
    if time > LONGEST {
        return Err(too_long());
    }
    Ok(time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_of_a_run() {
        assert_eq!(parse_run("7d"), Ok(Span::from_secs(7 * 86_400)));
        assert_eq!(parse_run("90 min"), parse_duration("90min"));
        assert!(parse_run("367d").is_err() && parse_run("d").is_err() && parse_run("1.5d").is_err());
    }

    #[test]
    fn times() {
        let nanos = |text| parse_duration(text).map(Span::nanos);
        assert_eq!(nanos("1ms"), Ok(1_000_000));
        assert_eq!(nanos("250 us"), Ok(250_000));
        assert_eq!(nanos("250µs"), Ok(250_000));
        assert_eq!(nanos("1.5s"), Ok(1_500_000_000));
        assert_eq!(nanos(".5s"), Ok(500_000_000));
        assert_eq!(nanos("0ms"), Ok(0));
        assert_eq!(nanos("1.0000000001ns"), Ok(1));
        assert_eq!(nanos("8h"), Ok(8 * 3_600_000_000_000));
        assert_eq!(nanos("1,5ms"), Err("\"1,5ms\" has a decimal comma; write \"1.5ms\"".to_owned()));
        let negative = "\"-1s\" is no time; write it like \"10ms\": a number that is not negative, and a unit";
        assert_eq!(nanos("-1s"), Err(negative.to_owned()));
        for wrong in ["", "10", "ms", "1 fortnight", "1.2.3s", "-1s", "25h", "99999999999999999999s", "."] {
            let error = parse_duration(wrong).expect_err(wrong);
            assert!(error.contains('"'), "{error}");
        }
    }
}
