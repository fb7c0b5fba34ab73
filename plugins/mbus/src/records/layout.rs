//! Header and records as they are in the data block of the program: S7 types, high byte first (docs/mbus.md has the
//! tables and the UDTs).

use super::record::{Header, Record, Value};

/// Bytes of the header (UDT MBUS_HEADER); the first record follows.
pub const HEADER_BYTES: usize = 24;
/// Bytes of a record (UDT MBUS_RECORD).
pub const RECORD_BYTES: usize = 40;

/// KIND: the kind of the value.
mod kind {
    pub(super) const NONE: u8 = 0;
    pub(super) const WHOLE: u8 = 1;
    pub(super) const BIG: u8 = 2;
    pub(super) const REAL: u8 = 3;
    pub(super) const DATE: u8 = 4;
    pub(super) const DATE_TIME: u8 = 5;
    pub(super) const TIME: u8 = 6;
    pub(super) const TEXT: u8 = 7;
    pub(super) const BYTES: u8 = 8;
    pub(super) const INVALID: u8 = 9;
}

impl Header {
    /// The header with the result: STATUS, number of records that follow, whether the meter has more, the code of the
    /// meter's application error.
    pub fn to_bytes(self, status: u16, count: u16, more: bool, code: u8) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[0..2].copy_from_slice(&status.to_be_bytes());
        bytes[2..4].copy_from_slice(&count.to_be_bytes());
        bytes[4..8].copy_from_slice(&self.identification.to_be_bytes());
        bytes[8..10].copy_from_slice(&self.manufacturer.to_be_bytes());
        bytes[10] = self.version;
        bytes[11] = self.medium;
        bytes[12..15].copy_from_slice(&self.manufacturer_letters());
        bytes[15] = b' ';
        bytes[16] = self.access;
        bytes[17] = self.state;
        bytes[18..20].copy_from_slice(&self.signature.to_be_bytes());
        bytes[20] = self.address;
        bytes[21] = self.ci;
        bytes[22] = u8::from(more);
        bytes[23] = code;
        bytes
    }
}

impl Record<'_> {
    /// The scaled value; 0 if it is not a number.
    pub fn scaled(self) -> f64 {
        match self.value {
            Value::Whole(raw) => f64::from(raw) * power_of_ten(self.exponent),
            Value::Big(raw) => raw * power_of_ten(self.exponent),
            Value::Real(raw) => f64::from(raw) * power_of_ten(self.exponent),
            _ => 0.0,
        }
    }

    /// The record; `answer_at` is the position of the fields relative to the byte from which DATA_AT counts.
    pub fn to_bytes(self, answer_at: u16) -> [u8; RECORD_BYTES] {
        let mut bytes = [0; RECORD_BYTES];
        let (kind, raw, time) = match self.value {
            Value::None => (kind::NONE, 0, [0; 8]),
            Value::Whole(raw) => (kind::WHOLE, raw, [0; 8]),
            Value::Big(_) => (kind::BIG, 0, [0; 8]),
            Value::Real(_) => (kind::REAL, 0, [0; 8]),
            Value::Date([day, month, year]) => dated(kind::DATE, [day, month, year, 0, 0, 0]),
            Value::DateTime(time) => dated(kind::DATE_TIME, time),
            // A DATE_AND_TIME needs a date: the first possible one.
            Value::Time([hour, minute, second]) => dated(kind::TIME, [1, 1, 90, hour, minute, second]),
            Value::Text(_) => (kind::TEXT, 0, [0; 8]),
            Value::Bytes(_) => (kind::BYTES, 0, [0; 8]),
            Value::Invalid => (kind::INVALID, 0, [0; 8]),
        };
        let clamped = |number: u64| i32::try_from(number).unwrap_or(i32::MAX).to_be_bytes();
        bytes[0] = self.function;
        bytes[1] = kind;
        bytes[2..6].copy_from_slice(&clamped(self.storage));
        bytes[6..10].copy_from_slice(&clamped(self.tariff.into()));
        bytes[10..12].copy_from_slice(&self.device.to_be_bytes());
        bytes[12..14].copy_from_slice(&(self.quantity as i16).to_be_bytes());
        bytes[14..16].copy_from_slice(&(self.unit as i16).to_be_bytes());
        bytes[16..18].copy_from_slice(&self.exponent.to_be_bytes());
        bytes[18..22].copy_from_slice(&raw.to_be_bytes());
        bytes[22..26].copy_from_slice(&(self.scaled() as f32).to_be_bytes());
        bytes[26..34].copy_from_slice(&time);
        bytes[34..36].copy_from_slice(&self.vif);
        bytes[36..38].copy_from_slice(&(answer_at + self.at as u16).to_be_bytes());
        bytes[38..40].copy_from_slice(&(self.len as u16).to_be_bytes());
        bytes
    }
}

/// 10 to this power. The exponents of VIFs and their corrections are small; the limit keeps a chain of corrections
/// finite.
fn power_of_ten(exponent: i16) -> f64 {
    let power = (0..exponent.unsigned_abs().min(60)).fold(1.0, |power: f64, _| power * 10.0);
    if exponent < 0 { 1.0 / power } else { power }
}

/// A DATE_AND_TIME in BCD with its weekday (1 is Sunday), or an invalid value.
fn dated(kind: u8, [day, month, year, hour, minute, second]: [u8; 6]) -> (u8, i32, [u8; 8]) {
    let can_be = (1..=31).contains(&day)
        && (1..=12).contains(&month)
        && year <= 99
        && hour <= 23
        && minute <= 59
        && second <= 59;
    if !can_be {
        return (kind::INVALID, 0, [0; 8]);
    }
    let bcd = |number: u8| (number / 10) << 4 | (number % 10);
    let weekday = weekday(day, month, year);
    (kind, 0, [bcd(year), bcd(month), bcd(day), bcd(hour), bcd(minute), bcd(second), 0, weekday])
}

/// The weekday of a date from 1990 to 2089, 1 is Sunday. [Sakamoto's congruence]
fn weekday(day: u8, month: u8, year: u8) -> u8 {
    const SHIFT: [u16; 12] = [0, 3, 2, 5, 0, 3, 5, 1, 4, 6, 2, 4];
    let full = if year < 90 { 2000 } else { 1900 } + u16::from(year);
    let year = if month < 3 { full - 1 } else { full };
    let shift = SHIFT.get(usize::from(month) - 1).copied().unwrap_or(0);
    ((year + year / 4 - year / 100 + year / 400 + shift + u16::from(day)) % 7) as u8 + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::{Quantity, Unit};

    const RECORD: Record<'_> = Record {
        function: 1,
        storage: 5,
        tariff: 2,
        device: 3,
        quantity: Quantity::VolumeFlow,
        unit: Unit::CubicMetrePerHour,
        exponent: -3,
        value: Value::Whole(-113),
        vif: [0x3B, 0],
        at: 25,
        len: 2,
    };

    #[test]
    fn a_record() {
        let bytes = RECORD.to_bytes(1);
        let value = (-0.113_f32).to_be_bytes();
        let expected: [&[u8]; 12] = [
            &[1, 1],
            &[0, 0, 0, 5],
            &[0, 0, 0, 2],
            &[0, 3],
            &[0, 7],
            &[0, 13],
            &[0xFF, 0xFD],
            &(-113_i32).to_be_bytes(),
            &value,
            &[0; 8],
            &[0x3B, 0],
            &[0, 26, 0, 2],
        ];
        assert!(bytes.iter().eq(expected.iter().copied().flatten()), "{bytes:02X?}");
    }

    #[test]
    fn points_in_time() {
        let time = |value| Record { value, ..RECORD }.to_bytes(0)[26..34].first_chunk().copied();
        let kind = |value| Record { value, ..RECORD }.to_bytes(0)[1];
        // 2014-03-13 was a Thursday, 2000-01-01 a Saturday, 1996-05-05 a Sunday.
        assert_eq!(time(Value::DateTime([13, 3, 14, 11, 12, 0])), Some([0x14, 0x03, 0x13, 0x11, 0x12, 0, 0, 5]));
        assert_eq!(time(Value::Date([1, 1, 0])), Some([0x00, 0x01, 0x01, 0, 0, 0, 0, 7]));
        assert_eq!(time(Value::Date([5, 5, 96])), Some([0x96, 0x05, 0x05, 0, 0, 0, 0, 1]));
        assert_eq!(time(Value::Time([23, 59, 58])), Some([0x90, 0x01, 0x01, 0x23, 0x59, 0x58, 0, 2]));
        assert_eq!(kind(Value::Date([0, 1, 0])), kind::INVALID);
        assert_eq!(kind(Value::DateTime([1, 1, 0, 31, 0, 0])), kind::INVALID);
    }
}
