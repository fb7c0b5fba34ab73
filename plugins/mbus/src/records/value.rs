//! The data of a record as a value: whole numbers, BCD, floating point, points in time, text.

use super::record::Value;

/// VIF: a date (type G, 2 bytes).
const DATE: u8 = 0x6C;
/// VIF: a point in time (type F, 4 bytes), a time of day (type J, 3 bytes), or a point in time with seconds (type I, 6
/// bytes).
const DATE_TIME: u8 = 0x6D;

/// The byte with the minute, in types F and I: the meter's clock is not valid.
const CLOCK_INVALID: u8 = 0x80;

/// Decodes the data of a record according to DIF, VIF, and LVAR if there is one.
pub(crate) fn decode(dif: u8, vif: u8, lvar: u8, data: &[u8]) -> Value<'_> {
    match (dif & 0xF, vif & 0x7F, data) {
        (0x0 | 0x8, ..) => Value::None,
        (0x2, DATE, &[day, month]) => date(day, month).map_or(Value::Invalid, Value::Date),
        (0x4, DATE_TIME, &[minute, hour, day, month]) if minute & CLOCK_INVALID == 0 => {
            date_time(day, month, [hour & 0x1F, minute & 0x3F, 0])
        }
        (0x6, DATE_TIME, &[second, minute, hour, day, month, _]) if minute & CLOCK_INVALID == 0 => {
            date_time(day, month, [hour & 0x1F, minute & 0x3F, second & 0x3F])
        }
        (0x3, DATE_TIME, &[second, minute, hour]) => Value::Time([hour & 0x1F, minute & 0x3F, second & 0x3F]),
        (0x4 | 0x6, DATE_TIME, _) => Value::Invalid,
        (0x1..=0x4 | 0x6 | 0x7, ..) => whole(binary(data)),
        (0x5, _, &[a, b, c, d]) => Value::Real(f32::from_le_bytes([a, b, c, d])),
        (0x9..=0xC | 0xE, ..) => bcd(data, 1),
        (0xD, ..) => match lvar {
            0x00..=0xBF => Value::Text(data),
            0xC0..=0xC9 => bcd(data, 1),
            0xD0..=0xD9 => bcd(data, -1),
            0xE0..=0xE8 => whole(binary(data)),
            _ => Value::Bytes(data),
        },
        _ => Value::Invalid,
    }
}

fn whole(number: i64) -> Value<'static> {
    i32::try_from(number).map_or(Value::Big(number as f64), Value::Whole)
}

/// Decodes two's complement, least significant byte first; at most eight bytes.
fn binary(data: &[u8]) -> i64 {
    let sign = data.last().is_some_and(|last| last & 0x80 != 0);
    let mut bytes = [if sign { 0xFF } else { 0 }; 8];
    let len = data.len().min(bytes.len());
    bytes[..len].copy_from_slice(&data[..len]);
    i64::from_le_bytes(bytes)
}

/// Decodes two digits for each byte, least significant first; Fh as the first digit is a minus. At most eighteen
/// digits, which fit.
fn bcd(data: &[u8], sign: i64) -> Value<'static> {
    let mut digits = data.iter().rev().flat_map(|byte| [byte >> 4, byte & 0xF]).take(18);
    let (first, sign) = match digits.next() {
        Some(0xF) => (0, -sign),
        Some(digit @ 0..=9) => (i64::from(digit), sign),
        Some(_) => return Value::Invalid,
        None => return Value::Whole(0),
    };
    let number = digits.try_fold(first, |number, digit| (digit <= 9).then_some(number * 10 + i64::from(digit)));
    number.map_or(Value::Invalid, |number| whole(sign * number))
}

/// Day, month, year from the two bytes that contain them in every type. A date with "every" day, month or year is not
/// valid.
fn date(day: u8, month: u8) -> Option<[u8; 3]> {
    let year = (day >> 5) | (month >> 4) << 3;
    let (day, month) = (day & 0x1F, month & 0xF);
    (day >= 1 && (1..=12).contains(&month) && year <= 99).then_some([day, month, year])
}

fn date_time(day: u8, month: u8, [hour, minute, second]: [u8; 3]) -> Value<'static> {
    match date(day, month) {
        Some([day, month, year]) if hour <= 23 && minute <= 59 && second <= 59 => {
            Value::DateTime([day, month, year, hour, minute, second])
        }
        _ => Value::Invalid,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values() {
        let cases: &[(u8, u8, u8, &[u8], Value<'_>)] = &[
            (0x00, 0x13, 0, &[], Value::None),
            (0x01, 0x13, 0, &[0xFF], Value::Whole(-1)),
            (0x03, 0x13, 0, &[0x15, 0x31, 0x00], Value::Whole(12_565)),
            (0x04, 0x13, 0, &[0, 0, 0, 0x80], Value::Whole(i32::MIN)),
            (0x06, 0x13, 0, &[0, 0, 0, 0x80, 0, 0], Value::Big(2_147_483_648.0)),
            (0x07, 0x13, 0, &[0xFE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], Value::Whole(-2)),
            (0x05, 0x13, 0, &[0, 0, 0x80, 0x3F], Value::Real(1.0)),
            (0x0B, 0x13, 0, &[0x04, 0x37, 0x18], Value::Whole(183_704)),
            (0x0B, 0x13, 0, &[0x18, 0x00, 0xF0], Value::Whole(-18)),
            (0x0B, 0x13, 0, &[0x18, 0xF0, 0x00], Value::Invalid),
            (0x0E, 0x13, 0, &[0x99; 6], Value::Big(999_999_999_999.0)),
            (0x0D, 0x13, 0xC2, &[0x34, 0x12], Value::Whole(1234)),
            (0x0D, 0x13, 0xD2, &[0x34, 0x12], Value::Whole(-1234)),
            (0x0D, 0x13, 0xC0, &[], Value::Whole(0)),
            (0x0D, 0x13, 0xC9, &[0x99; 9], Value::Big(999_999_999_999_999_999.0)),
            (0x0D, 0x13, 0xE2, &[0xFE, 0xFF], Value::Whole(-2)),
            (0x0D, 0x13, 0xE9, &[0; 9], Value::Bytes(&[0; 9])),
            (0x0D, 0x11, 0x02, b"ba", Value::Text(b"ba")),
            (0x42, 0x6C, 0, &[0xBF, 0x1C], Value::Date([31, 12, 13])),
            (0x42, 0xEC, 0, &[0x00, 0x00], Value::Invalid),
            (0x42, 0x6C, 0, &[0xFF, 0xFC], Value::Invalid),
            (0x04, 0x6D, 0, &[0x32, 0x37, 0x1F, 0x15], Value::DateTime([31, 5, 8, 23, 50, 0])),
            (0x04, 0x6D, 0, &[0xB2, 0x37, 0x1F, 0x15], Value::Invalid),
            (0x06, 0x6D, 0, &[0x36, 0x35, 0xC0, 0x53, 0x39, 0x00], Value::DateTime([19, 9, 26, 0, 53, 54])),
            (0x03, 0x6D, 0, &[58, 59, 23], Value::Time([23, 59, 58])),
        ];
        for (dif, vif, lvar, data, expected) in cases {
            assert_eq!(decode(*dif, *vif, *lvar, data), *expected, "{dif:02X} {vif:02X} {lvar:02X} {data:02X?}");
        }
    }
}
