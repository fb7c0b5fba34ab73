//! One variable as its display type shows it. [CP 341 manual 09/2008, p. 101]

use ob1_model::calendar;

use super::Fault;

/// A variable as its display type shows it.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Shown {
    pub(crate) text: Vec<u8>,
    /// True: too small a width cuts it. False: too small a width makes it asterisks. [CP 341 manual 09/2008, p. 103]
    pub(crate) is_cut: bool,
}

/// The display types of the table, plus `N` and `P`.
pub(crate) const TYPES: &[u8] = b"ACDFHINPRSTUXYZ";

/// Number of asterisks for a statement without a width of its own. [CP 341 manual 09/2008, p. 103]
pub(crate) const STARS: usize = 6;

/// Width of the default display of F and R.
const REAL_WIDTH: usize = 8;

/// Decimal places of R and, where they fit, of F in the default display.
const R_PLACES: usize = 2;
const F_PLACES: usize = 6;

/// The characters of a STRING: those after its two length bytes, if the first two bytes are length bytes; otherwise
/// all. (ours)
pub(crate) fn characters(bytes: &[u8]) -> &[u8] {
    match bytes {
        [most, length, text @ ..] if usize::from(*most) == text.len() && length <= most => {
            &text[..usize::from(*length)]
        }
        _ => bytes,
    }
}

/// Width of the default display.
pub(crate) fn default_width(display: u8, length: usize) -> usize {
    match (display, length) {
        (b'A' | b'D', _) => 10,
        (b'F' | b'R', _) => REAL_WIDTH,
        (b'I', 2) => 6,
        (b'I', _) => 11,
        (b'T', _) => 22,
        (b'Y', _) => 25,
        (b'Z', _) => 12,
        (b'U', 1) => 3,
        (b'U', 2) => 5,
        (b'U', _) => 10,
        (b'H', length) => 2 * length,
        (b'X', length) => 8 * length,
        _ => STARS,
    }
}

/// Shows a variable; `display` in upper case.
pub(crate) fn show(display: u8, bytes: &[u8], precision: Option<usize>) -> Result<Shown, Fault> {
    let text = match display {
        b'A' | b'D' => date(display, bytes, precision)?,
        b'C' => bytes.to_vec(),
        b'S' => characters(bytes).to_vec(),
        b'F' | b'R' => real(display, f32::from_be_bytes(exact(bytes)?), precision)?,
        b'H' => bytes.iter().flat_map(|byte| format!("{byte:02X}").into_bytes()).collect(),
        b'X' if matches!(bytes.len(), 1 | 2 | 4) => {
            bytes.iter().flat_map(|byte| format!("{byte:08b}").into_bytes()).collect()
        }
        b'I' => match bytes {
            [_, _] => i16::from_be_bytes(exact(bytes)?).to_string().into_bytes(),
            _ => i32::from_be_bytes(exact(bytes)?).to_string().into_bytes(),
        },
        b'U' => match bytes {
            [byte] => byte.to_string().into_bytes(),
            [_, _] => u16::from_be_bytes(exact(bytes)?).to_string().into_bytes(),
            _ => u32::from_be_bytes(exact(bytes)?).to_string().into_bytes(),
        },
        b'T' => duration(i32::from_be_bytes(exact(bytes)?)),
        b'Z' => time_of_day(u32::from_be_bytes(exact(bytes)?))?,
        b'Y' => date_and_time(exact(bytes)?)?,
        _ => return Err(Fault::Variable),
    };
    Ok(Shown { text, is_cut: b"ACDSTYZ".contains(&display) })
}

fn exact<const N: usize>(bytes: &[u8]) -> Result<[u8; N], Fault> {
    bytes.try_into().map_err(|_| Fault::Variable)
}

/// DATE, German (A) or as in IEC 61131-3 (D); the precision is the number of digits of the year.
fn date(display: u8, bytes: &[u8], precision: Option<usize>) -> Result<Vec<u8>, Fault> {
    /// DATE ends with 2168-12-31.
    const LAST: u16 = 65_378;
    let days = u16::from_be_bytes(exact(bytes)?);
    if !matches!(precision, None | Some(2 | 4)) {
        return Err(Fault::Precision);
    }
    if days > LAST {
        return Err(Fault::Value);
    }
    let (year, month, day) = calendar::date_of(u32::from(days) + calendar::DAYS_TO_1990);
    let year = if precision == Some(2) { format!("{:02}", year % 100) } else { year.to_string() };
    Ok(match display {
        b'A' => format!("{day:02}.{month:02}.{year}"),
        _ => format!("{year}-{month:02}-{day:02}"),
    }
    .into_bytes())
}

fn real(display: u8, value: f32, precision: Option<usize>) -> Result<Vec<u8>, Fault> {
    if !value.is_finite() {
        return Err(Fault::Value);
    }
    let text = match (display, precision) {
        (b'F', Some(places)) => format!("{value:.places$}"),
        (b'F', None) => {
            // As many places as fit the default display; a greater value exceeds its width. (ours)
            let mut tries = (0..=F_PLACES).rev().map(|places| format!("{value:.places$}"));
            tries.find(|text| text.len() <= REAL_WIDTH).unwrap_or_else(|| format!("{value:.0}"))
        }
        _ => exponential(value, precision.unwrap_or(R_PLACES)),
    };
    Ok(text.into_bytes())
}

/// `0.12E-04`: a mantissa below 1 with `places` decimal places; with 0 places `1E-05`.
fn exponential(value: f32, places: usize) -> String {
    let digits = places.saturating_sub(1);
    let text = format!("{value:.digits$e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let (sign, mantissa) = mantissa.strip_prefix('-').map_or(("", mantissa), |mantissa| ("-", mantissa));
    let mantissa = mantissa.replace('.', "");
    let (mantissa, exponent) = match places {
        0 => (mantissa, exponent),
        _ => (format!("0.{mantissa}"), if value == 0.0 { 0 } else { exponent + 1 }),
    };
    let direction = if exponent < 0 { '-' } else { '+' };
    format!("{sign}{mantissa}E{direction}{:02}", exponent.abs())
}

/// `2d_3h_10m_5s_250ms`: from the first unit that is not 0. (the last part is ours)
fn duration(ms: i32) -> Vec<u8> {
    let sign = if ms < 0 { "-" } else { "" };
    let mut rest = ms.unsigned_abs();
    let mut text = String::new();
    for (unit, length) in [("d", 86_400_000), ("h", 3_600_000), ("m", 60_000), ("s", 1000)] {
        let count = rest / length;
        rest %= length;
        if count > 0 || !text.is_empty() {
            text += &format!("{count}{unit}_");
        }
    }
    format!("{sign}{text}{rest}ms").into_bytes()
}

fn time_of_day(ms: u32) -> Result<Vec<u8>, Fault> {
    let (hours, minutes, seconds) = (ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60);
    if hours > 23 {
        return Err(Fault::Value);
    }
    Ok(format!("{hours:02}:{minutes:02}:{seconds:02}.{:03}", ms % 1000).into_bytes())
}

/// DATE_AND_TIME; the last digit is the day of the week.
fn date_and_time(bytes: [u8; 8]) -> Result<Vec<u8>, Fault> {
    let mut bcd = [0; 8];
    for (place, byte) in bcd.iter_mut().zip(bytes) {
        let (tens, ones) = (byte >> 4, byte & 0x0F);
        if tens > 9 || ones > 9 {
            return Err(Fault::Value);
        }
        *place = u16::from(10 * tens + ones);
    }
    let [year, month, day, hour, minute, second, hundredths, last] = bcd;
    let year = if year < 90 { 2000 + year } else { 1900 + year };
    let is_day = calendar::days_of(year.into(), month.into(), day.into()).is_some();
    if !is_day || hour > 23 || minute > 59 || second > 59 {
        return Err(Fault::Value);
    }
    let ms = 10 * hundredths + last / 10;
    Ok(format!("{day:02}.{month:02}.{year} - {hour:02}:{minute:02}:{second:02}.{ms:03}").into_bytes())
}
