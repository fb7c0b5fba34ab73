//! What an answer says: its meter, its records and their values, or why it says nothing.

use super::quantity::{Quantity, Unit};

/// The reason why an answer or a record cannot be evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// No data: the single character, or a short frame.
    NoData,
    /// A CI field that this library does not support, for example CI 76h (most significant byte first) and those of
    /// wireless M-Bus.
    UnknownCi(u8),
    /// The meter reports an error of its application, with its code (255: without one).
    Application(u8),
    /// The header or a record is truncated or not valid: the records before it are valid, the start of the next one is
    /// not known.
    Malformed,
    /// The records are encrypted (AES, modes 5 and 7); this library has no keys.
    Encrypted,
}

/// The meter that has answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// A field: primary address.
    pub address: u8,
    /// CI field: the form of what follows.
    pub ci: u8,
    /// Identification number, eight BCD digits: 12345678h is 12345678.
    pub identification: u32,
    /// Manufacturer, five bits for each letter; 0 in a fixed data structure.
    pub manufacturer: u16,
    /// Version; 0 in a fixed data structure.
    pub version: u8,
    /// Medium, coded as in the data structure of the answer: in the variable one 07h is water, 04h heat.
    pub medium: u8,
    /// Access number: counts the meter's answers.
    pub access: u8,
    /// State: bit 2 power low, bit 3 permanent error, bit 4 temporary error.
    pub state: u8,
    /// Signature, or configuration; 0 in a fixed data structure.
    pub signature: u16,
}

impl Header {
    /// The manufacturer's three letters. [EN 62056-21: A is 1]
    pub fn manufacturer_letters(&self) -> [u8; 3] {
        [10, 5, 0].map(|shift| ((self.manufacturer >> shift) & 0x1F) as u8 + b'@')
    }
}

/// Value of a record, not scaled: `exponent` of the record does that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value<'a> {
    /// The record has no data.
    None,
    /// A whole number that fits into a DINT.
    Whole(i32),
    /// A whole number beyond a DINT, rounded to a double.
    Big(f64),
    /// A floating point number.
    Real(f32),
    /// Day, month, year of the century.
    Date([u8; 3]),
    /// Day, month, year of the century, hour, minute, second.
    DateTime([u8; 6]),
    /// Time of day: hour, minute, second.
    Time([u8; 3]),
    /// Text, last character first, as it is transmitted.
    Text(&'a [u8]),
    /// Data in a form of the manufacturer's own.
    Bytes(&'a [u8]),
    /// Characters that are not digits, or a date that the meter calls invalid.
    Invalid,
}

/// One data record of an answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record<'a> {
    /// 0 instantaneous, 1 maximum, 2 minimum, 3 during an error.
    pub function: u8,
    /// Storage number: 0 is now.
    pub storage: u64,
    /// Tariff: 0 is the total.
    pub tariff: u32,
    /// Subunit of the device.
    pub device: u16,
    /// What was measured, from the VIF.
    pub quantity: Quantity,
    /// Unit of the value times 10 to the power of `exponent`.
    pub unit: Unit,
    /// Power of ten by which the value is multiplied.
    pub exponent: i16,
    /// The value before it is multiplied.
    pub value: Value<'a>,
    /// VIF, and the first VIFE or 0: for quantities that [`Quantity`] does not list.
    pub vif: [u8; 2],
    /// Position of its data in the fields of the answer, in bytes; after the LVAR byte.
    pub at: usize,
    /// Length of its data in bytes.
    pub len: usize,
}
