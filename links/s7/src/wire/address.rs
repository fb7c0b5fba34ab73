//! Addresses of variables: the items of reads and writes.

use ob1_words::any::AnyType;

use crate::codes::ItemCode;

/// Memory a client can address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Area {
    /// Peripheral inputs and outputs, past the process image.
    Peripheral,
    /// Process image of the inputs.
    Inputs,
    /// Process image of the outputs.
    Outputs,
    /// Bit memory, from M 0.0 on.
    Memory,
    /// The data block that [`Address::db`] names.
    Db,
    /// Counters, by their numbers.
    Counters,
    /// Timers, by their numbers.
    Timers,
}

impl Area {
    const fn of(byte: u8) -> Option<Self> {
        Some(match byte {
            0x80 => Self::Peripheral,
            0x81 => Self::Inputs,
            0x82 => Self::Outputs,
            0x83 => Self::Memory,
            // An instance data block is a data block.
            0x84 | 0x85 => Self::Db,
            0x1C => Self::Counters,
            0x1D => Self::Timers,
            _ => return None,
        })
    }

    const fn byte(self) -> u8 {
        match self {
            Self::Peripheral => 0x80,
            Self::Inputs => 0x81,
            Self::Outputs => 0x82,
            Self::Memory => 0x83,
            Self::Db => 0x84,
            Self::Counters => 0x1C,
            Self::Timers => 0x1D,
        }
    }
}

/// The requested type of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the names say it")]
pub enum DataType {
    Bit,
    Byte,
    Char,
    Word,
    Int,
    DWord,
    DInt,
    Real,
    Date,
    TimeOfDay,
    Time,
    S5Time,
    DateAndTime,
    Counter,
    Timer,
}

/// The types as in an ANY pointer.
const TYPES: [(AnyType, DataType); 15] = [
    (AnyType::Bool, DataType::Bit),
    (AnyType::Byte, DataType::Byte),
    (AnyType::Char, DataType::Char),
    (AnyType::Word, DataType::Word),
    (AnyType::Int, DataType::Int),
    (AnyType::DWord, DataType::DWord),
    (AnyType::DInt, DataType::DInt),
    (AnyType::Real, DataType::Real),
    (AnyType::Date, DataType::Date),
    (AnyType::TimeOfDay, DataType::TimeOfDay),
    (AnyType::Time, DataType::Time),
    (AnyType::S5Time, DataType::S5Time),
    (AnyType::DateAndTime, DataType::DateAndTime),
    (AnyType::Counter, DataType::Counter),
    (AnyType::Timer, DataType::Timer),
];
/// The code of this type on the wire, which differs from the one in memory.
const DATE_AND_TIME: u8 = 0x0F;

impl DataType {
    fn any(self) -> AnyType {
        TYPES.iter().find(|row| row.1 == self).map_or(AnyType::Byte, |row| row.0)
    }

    fn code(self) -> u8 {
        if self == Self::DateAndTime { DATE_AND_TIME } else { self.any() as u8 }
    }

    /// Bytes of one element; a bit is carried in one.
    #[must_use]
    pub fn bytes(self) -> u32 {
        self.any().bits().div_ceil(8)
    }
}

/// A variable, or several in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Address {
    /// Memory area that it lies in.
    pub area: Area,
    /// The data block; 0 elsewhere.
    pub db: u16,
    /// The first bit; for counters and timers the first number.
    pub start: u32,
    /// The type of each element.
    pub ty: DataType,
    /// How many elements follow each other.
    pub count: u16,
}

/// Bytes of an address on the wire.
const ANY_BYTES: usize = 12;
/// First bytes of an address: variable specification, bytes that follow, syntax "S7 ANY".
pub(super) const ANY: [u8; 3] = [0x12, 0x0A, 0x10];
/// Largest address: 24 bits.
const MAX_START: u32 = 0x00FF_FFFF;

/// The item cannot be served, for this reason.
pub type BadItem = ItemCode;

impl Address {
    /// Bytes of the data.
    #[must_use]
    pub fn bytes(&self) -> usize {
        (self.ty.bytes() * u32::from(self.count)) as usize
    }

    /// Counters and timers are counted, everything else has bits.
    #[must_use]
    pub const fn is_counted(&self) -> bool {
        matches!(self.area, Area::Counters | Area::Timers)
    }

    /// The first byte; for counters and timers the first number.
    #[must_use]
    pub const fn first(&self) -> u32 {
        if self.is_counted() { self.start } else { self.start / 8 }
    }

    /// One item of syntax "S7 ANY", with the two bytes in front of it.
    pub(crate) fn read(item: &[u8]) -> Result<Self, BadItem> {
        let Some(&[a, b, c, ty, count_high, count_low, db_high, db_low, area, x, y, z]) =
            item.first_chunk::<ANY_BYTES>()
        else {
            return Err(ItemCode::TYPE);
        };
        if [a, b, c] != ANY {
            return Err(ItemCode::TYPE);
        }
        let area = Area::of(area).ok_or(ItemCode::NO_OBJECT)?;
        let ty = TYPES.iter().find(|row| row.1.code() == ty).ok_or(ItemCode::TYPE)?.1;
        let start = u32::from_be_bytes([0, x, y, z]);
        let address = Self {
            area,
            db: if area == Area::Db { u16::from_be_bytes([db_high, db_low]) } else { 0 },
            start,
            ty,
            count: u16::from_be_bytes([count_high, count_low]),
        };
        address.check().map(|()| address)
    }

    /// Checks that are possible without the CPU.
    fn check(&self) -> Result<(), BadItem> {
        let counted = matches!(self.ty, DataType::Counter | DataType::Timer);
        let fits = match self.area {
            // A counter or timer is a word, so WORD is accepted.
            Area::Counters => matches!(self.ty, DataType::Counter | DataType::Word | DataType::Int),
            Area::Timers => matches!(self.ty, DataType::Timer | DataType::Word | DataType::Int | DataType::S5Time),
            _ => !counted,
        };
        if !fits {
            return Err(ItemCode::TYPE);
        }
        // A single bit, or whole bytes.
        if self.ty == DataType::Bit && self.count != 1 {
            return Err(ItemCode::TYPE);
        }
        // Counters and timers have numbers of 16 bits.
        if self.is_counted() && self.start > u32::from(u16::MAX) {
            return Err(ItemCode::ADDRESS);
        }
        if self.count == 0 || !self.is_counted() && self.ty != DataType::Bit && !self.start.is_multiple_of(8) {
            return Err(ItemCode::ADDRESS);
        }
        Ok(())
    }

    /// The bytes of the item.
    pub fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&ANY);
        out.push(self.ty.code());
        out.extend_from_slice(&self.count.to_be_bytes());
        out.extend_from_slice(&self.db.to_be_bytes());
        out.push(self.area.byte());
        let [_, a, b, c] = self.start.min(MAX_START).to_be_bytes();
        out.extend_from_slice(&[a, b, c]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Item, Items};
    use super::*;

    fn one(bytes: &[u8]) -> Option<Result<Address, BadItem>> {
        match Items::new(bytes, 1).next().expect("one is asked for") {
            Some(Ok(Item::Variable(address))) => Some(Ok(address)),
            Some(Err(code)) => Some(Err(code)),
            _ => None,
        }
    }

    #[test]
    fn an_address_goes_both_ways() {
        for area in [Area::Peripheral, Area::Inputs, Area::Outputs, Area::Memory, Area::Db] {
            for (_, ty) in TYPES.iter().filter(|row| row.1.code() < 0x1C) {
                let db = if area == Area::Db { 65_535 } else { 0 };
                let count = if *ty == DataType::Bit { 1 } else { 222 };
                let address = Address { area, db, start: 0x00FF_FFF8, ty: *ty, count };
                let mut bytes = Vec::new();
                address.write(&mut bytes);
                assert_eq!(one(&bytes), Some(Ok(address)));
            }
        }
        let timers = Address { area: Area::Timers, db: 0, start: 5, ty: DataType::Timer, count: 3 };
        let mut bytes = Vec::new();
        timers.write(&mut bytes);
        assert_eq!(bytes, [0x12, 0x0A, 0x10, 0x1D, 0, 3, 0, 0, 0x1D, 0, 0, 5]);
        assert_eq!(one(&bytes), Some(Ok(timers)));
    }

    #[test]
    fn what_is_wrong_with_an_item_is_its_own_code() {
        for (bytes, code) in [
            // An unknown area; an unknown type; two bits; a real in the middle of a byte; nothing at all; timers as
            // bytes; timer and counter 65,537.
            ([0x12, 0x0A, 0x10, 2, 0, 1, 0, 1, 0x99, 0, 0, 0], ItemCode::NO_OBJECT),
            ([0x12, 0x0A, 0x10, 0x44, 0, 1, 0, 1, 0x84, 0, 0, 0], ItemCode::TYPE),
            ([0x12, 0x0A, 0x10, 1, 0, 2, 0, 1, 0x84, 0, 0, 0], ItemCode::TYPE),
            ([0x12, 0x0A, 0x10, 8, 0, 1, 0, 1, 0x84, 0, 0, 3], ItemCode::ADDRESS),
            ([0x12, 0x0A, 0x10, 2, 0, 0, 0, 1, 0x84, 0, 0, 0], ItemCode::ADDRESS),
            ([0x12, 0x0A, 0x10, 2, 0, 1, 0, 0, 0x1D, 0, 0, 0], ItemCode::TYPE),
            ([0x12, 0x0A, 0x10, 0x1D, 0, 1, 0, 0, 0x1D, 1, 0, 1], ItemCode::ADDRESS),
            ([0x12, 0x0A, 0x10, 0x1C, 0, 1, 0, 0, 0x1C, 1, 0, 1], ItemCode::ADDRESS),
        ] {
            assert_eq!(one(&bytes), Some(Err(code)), "{bytes:02X?}");
        }
    }
}
