//! The ANY pointer, ten bytes that name a piece of memory; the format in memory and in S7 communication.

/// The first byte of an ANY pointer.
pub const SYNTAX: u8 = 0x10;
/// The length of an ANY pointer.
pub const BYTES: usize = 10;

macro_rules! types {
    ($($(#[$doc:meta])* $name:ident = $code:literal: $bits:literal,)*) => {
        /// Type code of an ANY pointer (byte 1).
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum AnyType { $($(#[$doc])* $name = $code,)* }

        impl AnyType {
            /// All types, by rising code.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// The type for a type code.
            pub const fn of(code: u8) -> Option<Self> {
                match code { $($code => Some(Self::$name),)* _ => None }
            }

            /// Bits of one element. A STRING's count is its bytes.
            pub const fn bits(self) -> u32 {
                match self { $(Self::$name => $bits,)* }
            }
        }
    };
}

types! {
    /// No memory: the NIL pointer.
    Nil = 0x00: 0,
    /// BOOL, a single bit.
    Bool = 0x01: 1,
    /// BYTE, 8 bits without a meaning.
    Byte = 0x02: 8,
    /// CHAR, a character of one byte.
    Char = 0x03: 8,
    /// WORD, 16 bits without a meaning.
    Word = 0x04: 16,
    /// INT, 16 bits with sign.
    Int = 0x05: 16,
    /// DWORD, 32 bits without a meaning.
    DWord = 0x06: 32,
    /// DINT, 32 bits with sign.
    DInt = 0x07: 32,
    /// REAL, IEEE 754 of 32 bits.
    Real = 0x08: 32,
    /// DATE, days since 1990-01-01.
    Date = 0x09: 16,
    /// TIME_OF_DAY, milliseconds since midnight.
    TimeOfDay = 0x0A: 32,
    /// TIME, milliseconds with sign.
    Time = 0x0B: 32,
    /// S5TIME, three BCD digits and a time base.
    S5Time = 0x0C: 16,
    /// DATE_AND_TIME, eight bytes in BCD.
    DateAndTime = 0x0E: 64,
    /// STRING: maximum length, length and characters, one byte each.
    String = 0x13: 8,
    /// A counter; addressed by its number.
    Counter = 0x1C: 16,
    /// A timer; addressed by its number.
    Timer = 0x1D: 16,
}

/// The fields of a pointer, not checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fields {
    /// Type of the elements.
    pub ty: AnyType,
    /// Number of elements (of `ty`), not of bytes.
    pub count: u16,
    /// The data block, 0 outside data blocks.
    pub db: u16,
    /// Code of the memory area, as in an area pointer: 81h inputs, 83h memory bits, 84h a data block.
    pub area: u8,
    /// Address in bits; for timers and counters their number.
    pub start: u32,
}

impl Fields {
    /// `None` for another syntax or type.
    pub const fn read(bytes: &[u8; BYTES]) -> Option<Self> {
        let [SYNTAX, ty, count_high, count_low, db_high, db_low, area, a, b, c] = *bytes else { return None };
        let Some(ty) = AnyType::of(ty) else { return None };
        Some(Self {
            ty,
            count: u16::from_be_bytes([count_high, count_low]),
            db: u16::from_be_bytes([db_high, db_low]),
            area,
            start: u32::from_be_bytes([0, a, b, c]),
        })
    }

    /// The pointer as it lies in memory, most significant byte first.
    pub const fn bytes(&self) -> [u8; BYTES] {
        let [count_high, count_low] = self.count.to_be_bytes();
        let [db_high, db_low] = self.db.to_be_bytes();
        let [_, a, b, c] = self.start.to_be_bytes();
        [SYNTAX, self.ty as u8, count_high, count_low, db_high, db_low, self.area, a, b, c]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_is_read_as_it_is_written() {
        for ty in AnyType::ALL {
            let fields = Fields { ty: *ty, count: 0x102, db: 0x304, area: 0x84, start: 0x0506_0708 & 0xFF_FFFF };
            assert_eq!(Fields::read(&fields.bytes()), Some(fields));
        }
        assert_eq!(Fields::read(&[0x11, 2, 0, 1, 0, 1, 0x84, 0, 0, 0]), None);
        assert_eq!(Fields::read(&[0x10, 0x0D, 0, 1, 0, 1, 0x84, 0, 0, 0]), None);
    }
}
