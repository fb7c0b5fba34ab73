//! The fixed data structure (CI 73h): two counters, each with one of 64 units, in a structure of sixteen bytes. [EN
//! 1434-3]

use super::quantity::{Quantity, Unit};
use super::record::{Record, Value};

/// Position of the state in the fields: after C, A, CI field, identification, access number.
const STATE: usize = 8;
/// Position of medium and units.
const UNITS: usize = 9;
/// Position of the counters.
const COUNTERS: usize = 11;

/// State: the counters are binary; otherwise BCD.
const BINARY: u8 = 0x80;
/// State: the counters are values of a fixed date; otherwise current values.
const FIXED_DATE: u8 = 0x40;

/// Unit of the second counter: the unit of the first, for a value of an earlier date.
const SAME_HISTORIC: u8 = 0x3E;

/// The medium: its four bits are the upper bits of the two unit bytes.
pub(crate) fn medium(first: u8, second: u8) -> u8 {
    (first >> 6) | (second >> 6) << 2
}

/// A counter, 0 or 1.
pub(crate) fn counter(fields: &[u8], counter: usize) -> Option<Record<'_>> {
    let at = COUNTERS + 4 * counter;
    let bytes: [u8; 4] = fields.get(at..at + 4).filter(|_| counter < 2)?.try_into().ok()?;
    let state = *fields.get(STATE)?;
    let own = *fields.get(UNITS + counter)? & 0x3F;
    let code = if own == SAME_HISTORIC { *fields.get(UNITS)? & 0x3F } else { own };
    let (quantity, unit, exponent) = meaning(code);
    let number = u32::from_le_bytes(bytes);
    let value = if state & BINARY == 0 { bcd(number) } else { Value::Whole(number as i32) };
    let storage = u64::from(state & FIXED_DATE != 0 || own == SAME_HISTORIC);
    Some(Record {
        function: 0,
        storage,
        tariff: 0,
        device: 0,
        quantity,
        unit,
        exponent,
        value,
        vif: [own, 0],
        at,
        len: 4,
    })
}

fn bcd(digits: u32) -> Value<'static> {
    let mut digits = (0..8).rev().map(|place| ((digits >> (4 * place)) & 0xF) as i32);
    let number = digits.try_fold(0, |number, digit| (digit <= 9).then_some(number * 10 + digit));
    number.map_or(Value::Invalid, Value::Whole)
}

/// The units of the fixed data structure: ranges of powers of ten.
fn meaning(code: u8) -> (Quantity, Unit, i16) {
    let from = |first: u8, exponent: i16| exponent + i16::from(code - first);
    match code {
        0x02..=0x0A => (Quantity::Energy, Unit::WattHour, from(0x02, 0)),
        0x0B..=0x13 => (Quantity::Energy, Unit::Joule, from(0x0B, 3)),
        0x14..=0x1C => (Quantity::Power, Unit::Watt, from(0x14, 0)),
        0x1D..=0x25 => (Quantity::Power, Unit::JoulePerHour, from(0x1D, 3)),
        0x26..=0x2E => (Quantity::Volume, Unit::CubicMetre, from(0x26, -6)),
        0x2F..=0x37 => (Quantity::VolumeFlow, Unit::CubicMetrePerHour, from(0x2F, -6)),
        0x38 => (Quantity::ExternalTemperature, Unit::Celsius, -3),
        0x39 => (Quantity::HeatCost, Unit::None, 0),
        _ => (Quantity::Other, Unit::None, 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of EN 1434-3: water, now 1 l, at the last date 135 l.
    #[test]
    fn two_counters() {
        // C, A, CI, identification 12345678, access number 10, state 0, units 29h and 7Eh, 1 and 135 in BCD.
        let fields = [8, 5, 0x73, 0x78, 0x56, 0x34, 0x12, 0x0A, 0x00, 0xE9, 0x7E, 1, 0, 0, 0, 0x35, 1, 0, 0];
        let first = counter(&fields, 0).expect("a counter");
        assert_eq!((first.value, first.unit, first.exponent), (Value::Whole(1), Unit::CubicMetre, -3));
        let second = counter(&fields, 1).expect("a counter");
        assert_eq!((second.value, second.quantity, second.exponent), (Value::Whole(135), Quantity::Volume, -3));
        assert_eq!((first.storage, second.storage), (0, 1));
        assert_eq!(counter(&fields, 2), None);
        assert_eq!(medium(0xE9, 0x7E), 7, "water");
        let mut binary = fields;
        binary[STATE] = BINARY | FIXED_DATE;
        binary[15] = 0xFF;
        let second = counter(&binary, 1).expect("a counter");
        assert_eq!((second.value, second.storage), (Value::Whole(0x1FF), 1));
        binary[STATE] = 0;
        assert_eq!(counter(&binary, 1).expect("a counter").value, Value::Invalid);
    }
}
