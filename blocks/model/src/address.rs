//! Memory areas and bit addresses.

use std::fmt;

named! {
    /// A memory area, named by the German identifier of STL without its width.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
    #[repr(u8)]
    pub enum Area {
        /// Process image of the inputs, `I` in the international set.
        Input = "E",
        /// Process image of the outputs, `Q` in the international set.
        Output = "A",
        /// Bit memory, from M 0.0 on.
        Memory = "M",
        /// Local data of the running block.
        Local = "L",
        /// Local data of the calling block (area code 87h, in pointers only).
        PreviousLocal = "V",
        /// The data block opened with `AUF DB`, `DBX DBB DBW DBD`.
        Db = "DB",
        /// The data block opened with `AUF DI`, `DIX DIB DIW DID`.
        Di = "DI",
        /// Peripheral bytes, `PE` when read and `PA` when written; no process image in between.
        Peripheral = "P",
    }
}

impl Area {
    /// The area code in a `P#` pointer (bits 24 to 31), as the STL reference lists them.
    pub const fn pointer_code(self) -> u8 {
        match self {
            Area::Peripheral => 0x80,
            Area::Input => 0x81,
            Area::Output => 0x82,
            Area::Memory => 0x83,
            Area::Db => 0x84,
            Area::Di => 0x85,
            Area::Local => 0x86,
            Area::PreviousLocal => 0x87,
        }
    }

    /// The area a pointer code names, or `None` for a code that names none.
    pub const fn from_pointer_code(code: u8) -> Option<Self> {
        Some(match code {
            0x80 => Area::Peripheral,
            0x81 => Area::Input,
            0x82 => Area::Output,
            0x83 => Area::Memory,
            0x84 => Area::Db,
            0x85 => Area::Di,
            0x86 => Area::Local,
            0x87 => Area::PreviousLocal,
            _ => return None,
        })
    }
}

/// A bit address within an area: byte * 8 + bit, the form a `P#byte.bit` pointer has in its low 19 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BitAddr(pub u32);

impl BitAddr {
    /// The highest byte a pointer can name.
    pub const MAX_BYTE: u32 = 65_535;

    /// The address `byte.bit`; `bit` counts from 0 to 7.
    pub const fn new(byte: u32, bit: u8) -> Self {
        Self(byte * 8 + (bit & 7) as u32)
    }

    /// The address of a whole byte.
    pub const fn byte_addr(byte: u32) -> Self {
        Self(byte * 8)
    }

    /// The address in a pointer of 32 bits, whose highest byte is its area.
    pub const fn of_pointer(pointer: u32) -> Self {
        Self(pointer & 0x7_FFFF)
    }

    /// The byte part of the address.
    pub const fn byte(self) -> u32 {
        self.0 / 8
    }

    /// The bit part, 0 to 7.
    pub const fn bit(self) -> u8 {
        (self.0 % 8) as u8
    }
}

impl fmt::Display for BitAddr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.byte(), self.bit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pointer_codes_go_both_ways() {
        for code in 0..=255u8 {
            if let Some(area) = Area::from_pointer_code(code) {
                assert_eq!(area.pointer_code(), code);
            } else {
                assert!(!(0x80..=0x87).contains(&code), "{code:#x} is a pointer code");
            }
        }
    }

    #[test]
    fn bit_addresses_split() {
        let at = BitAddr::new(260, 4);
        assert_eq!((at.byte(), at.bit(), at.to_string().as_str()), (260, 4, "260.4"));
    }
}
