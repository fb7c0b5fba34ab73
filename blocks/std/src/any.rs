//! The ANY pointer: ten bytes that name a piece of memory.

use ob1_model::{Area, BitAddr};

pub use ob1_words::any::AnyType;
use ob1_words::any::Fields;

/// A parsed ANY pointer to memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnyPointer {
    /// Type of what lies there.
    pub ty: AnyType,
    /// How many of it.
    pub count: u16,
    /// The data block, 0 outside data blocks.
    pub db: u16,
    /// Memory area of the first element.
    pub area: Area,
    /// Where it begins in the area.
    pub at: BitAddr,
}

impl AnyPointer {
    /// Parses the ten bytes: 10h, type, count, data block, area-crossing pointer. `None` for another syntax identifier,
    /// type or area.
    pub fn parse(bytes: &[u8; 10]) -> Option<Self> {
        let Fields { ty, count, db, area, start } = Fields::read(bytes)?;
        // Timers and counters are no memory.
        if matches!(ty, AnyType::Timer | AnyType::Counter) {
            return None;
        }
        let area = match (ty, area) {
            (AnyType::Nil, 0) => Area::Memory,
            (_, code) => Area::from_pointer_code(code)?,
        };
        Some(Self { ty, count, db, area, at: BitAddr(start & 0x7_FFFF) })
    }

    /// Bytes it names; `None` when it names bits that are not whole bytes, or does not begin at one.
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
