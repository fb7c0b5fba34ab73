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
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// The type for a type code.
            #[must_use]
            pub const fn of(code: u8) -> Option<Self> {
                match code { $($code => Some(Self::$name),)* _ => None }
            }

            /// Bits of one element. A STRING's count is its bytes.
            #[must_use]
            pub const fn bits(self) -> u32 {
                match self { $(Self::$name => $bits,)* }
            }
        }
    };
}

types! {
    /// Nothing.
    Nil = 0x00: 0,
    /// BOOL.
    Bool = 0x01: 1,
    /// BYTE.
    Byte = 0x02: 8,
    /// CHAR.
    Char = 0x03: 8,
    /// WORD.
    Word = 0x04: 16,
    /// INT.
    Int = 0x05: 16,
    /// DWORD.
    DWord = 0x06: 32,
    /// DINT.
    DInt = 0x07: 32,
    /// REAL.
    Real = 0x08: 32,
    /// DATE.
    Date = 0x09: 16,
    /// TIME_OF_DAY.
    TimeOfDay = 0x0A: 32,
    /// TIME.
    Time = 0x0B: 32,
    /// S5TIME.
    S5Time = 0x0C: 16,
    /// DATE_AND_TIME.
    DateAndTime = 0x0E: 64,
    /// STRING.
    String = 0x13: 8,
    /// COUNTER.
    Counter = 0x1C: 16,
    /// TIMER.
    Timer = 0x1D: 16,
}

/// The fields of a pointer, not checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fields {
    /// Type of the elements.
    pub ty: AnyType,
    /// Number of elements.
    pub count: u16,
    /// The data block, 0 outside data blocks.
    pub db: u16,
    /// Area code.
    pub area: u8,
    /// Address in bits; for timers and counters their number.
    pub start: u32,
}

impl Fields {
    /// `None` for another syntax or type.
    #[must_use]
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

    /// The ten bytes.
    #[must_use]
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
