//! The ANY pointer: ten bytes that name a piece of memory.

use ob1_model::{Area, BitAddr};

/// Type code of an ANY pointer (byte 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the data types of the STL reference")]
pub enum AnyType {
    Nil,
    Bool,
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
    String,
}

impl AnyType {
    const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            0x00 => AnyType::Nil,
            0x01 => AnyType::Bool,
            0x02 => AnyType::Byte,
            0x03 => AnyType::Char,
            0x04 => AnyType::Word,
            0x05 => AnyType::Int,
            0x06 => AnyType::DWord,
            0x07 => AnyType::DInt,
            0x08 => AnyType::Real,
            0x09 => AnyType::Date,
            0x0A => AnyType::TimeOfDay,
            0x0B => AnyType::Time,
            0x0C => AnyType::S5Time,
            0x0E => AnyType::DateAndTime,
            0x13 => AnyType::String,
            _ => return None,
        })
    }

    /// Bits of one element. A STRING's count is its bytes.
    const fn bits(self) -> u32 {
        match self {
            AnyType::Nil => 0,
            AnyType::Bool => 1,
            AnyType::Byte | AnyType::Char | AnyType::String => 8,
            AnyType::Word | AnyType::Int | AnyType::Date | AnyType::S5Time => 16,
            AnyType::DWord | AnyType::DInt | AnyType::Real | AnyType::TimeOfDay | AnyType::Time => 32,
            AnyType::DateAndTime => 64,
        }
    }
}

/// A parsed ANY pointer to memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnyPointer {
    /// What lies there.
    pub ty: AnyType,
    /// How many of it.
    pub count: u16,
    /// The data block, 0 outside data blocks.
    pub db: u16,
    /// The area.
    pub area: Area,
    /// Where in it.
    pub at: BitAddr,
}

impl AnyPointer {
    /// Parses the ten bytes: 10h, type, count, data block, area-crossing pointer. `None` for another syntax identifier,
    /// type or area.
    #[must_use]
    pub fn parse(bytes: &[u8; 10]) -> Option<Self> {
        if bytes[0] != 0x10 {
            return None;
        }
        let ty = AnyType::from_code(bytes[1])?;
        let area = match (ty, bytes[6]) {
            (AnyType::Nil, 0) => Area::Memory,
            (_, code) => Area::from_pointer_code(code)?,
        };
        Some(Self {
            ty,
            count: u16::from_be_bytes([bytes[2], bytes[3]]),
            db: u16::from_be_bytes([bytes[4], bytes[5]]),
            area,
            at: BitAddr(u32::from_be_bytes([0, bytes[7], bytes[8], bytes[9]]) & 0x7_FFFF),
        })
    }

    /// Bytes it names; `None` when it names bits that are not whole bytes, or does not begin at one.
    #[must_use]
    pub const fn bytes(&self) -> Option<u32> {
        let bits = self.count as u32 * self.ty.bits();
        if !bits.is_multiple_of(8) || self.at.bit() != 0 { None } else { Some(bits / 8) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_what_step_7_lays_out() {
        // P#DB10.DBX 20.0 WORD 4
        let any = AnyPointer::parse(&[0x10, 0x04, 0, 4, 0, 10, 0x84, 0, 0, 160]).unwrap();
        assert_eq!((any.db, any.area, any.at, any.bytes()), (10, Area::Db, BitAddr(160), Some(8)));
        // P#M 1.3 BOOL 1: no whole byte.
        let any = AnyPointer::parse(&[0x10, 0x01, 0, 1, 0, 0, 0x83, 0, 0, 11]).unwrap();
        assert_eq!(any.bytes(), None);
        assert_eq!(AnyPointer::parse(&[0x11, 2, 0, 1, 0, 0, 0x83, 0, 0, 0]), None);
        assert_eq!(AnyPointer::parse(&[0x10, 0x55, 0, 1, 0, 0, 0x83, 0, 0, 0]), None);
        assert_eq!(AnyPointer::parse(&[0x10, 2, 0, 1, 0, 0, 0x90, 0, 0, 0]), None);
    }
}
