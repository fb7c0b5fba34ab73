//! Forced values: cells whose value the operator holds, whatever the program or a module says.

use std::fmt;

use crate::Width;

/// Most forced cells of an S7-300. (S7-300 installation manual, table 10-1)
pub const FORCED_300: usize = 10;
/// Most forced cells of an S7-400; a CPU 412 to 417 has 64 to 512.
pub const FORCED_400: usize = 256;

/// Where a forced cell lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ForcedArea {
    /// Process image of the inputs.
    #[default]
    Input,
    /// Process image of the outputs.
    Output,
    /// Bit memory, from M 0.0 on.
    Memory,
    /// Peripheral inputs, as they are read.
    PeripheralInput,
    /// Peripheral outputs, as they are written.
    PeripheralOutput,
}

/// The words before a number, longest first; the first of an area is the one that is printed.
const AREAS: [(&str, ForcedArea); 9] = [
    ("PI", ForcedArea::PeripheralInput),
    ("PE", ForcedArea::PeripheralInput),
    ("PQ", ForcedArea::PeripheralOutput),
    ("PA", ForcedArea::PeripheralOutput),
    ("I", ForcedArea::Input),
    ("E", ForcedArea::Input),
    ("Q", ForcedArea::Output),
    ("A", ForcedArea::Output),
    ("M", ForcedArea::Memory),
];

/// A cell and the value it is forced to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Forced {
    /// Area of the cell.
    pub area: ForcedArea,
    /// Its bit address there.
    pub bit: u32,
    /// How much of it.
    pub width: Width,
    /// The value, of so many bits.
    pub value: u32,
}

impl Forced {
    /// Stands for no forced cell, to fill lists.
    pub const NONE: Self = Self { area: ForcedArea::Input, bit: 0, width: Width::Bit, value: 0 };

    /// The cell of a name: `I0.0`, `EB 3`, `QW4`, `PAW 256`; its value is 0.
    pub fn named(name: &str) -> Option<Self> {
        let name: String = name.chars().filter(|c| !c.is_whitespace()).collect::<String>().to_ascii_uppercase();
        let (rest, area) = AREAS.iter().find_map(|(word, area)| Some((name.strip_prefix(word)?, *area)))?;
        let (width, number) = match rest.as_bytes().first()? {
            b'B' => (Width::Byte, &rest[1..]),
            b'W' => (Width::Word, &rest[1..]),
            b'D' => (Width::DWord, &rest[1..]),
            _ => (Width::Bit, rest),
        };
        let bit = if width == Width::Bit {
            let (byte, bit) = number.split_once('.')?;
            let bit: u32 = bit.parse().ok().filter(|bit| *bit < 8)?;
            byte.parse::<u16>().ok().map(|byte| u32::from(byte) * 8 + bit)?
        } else {
            u32::from(number.parse::<u16>().ok()?) * 8
        };
        Some(Self { area, bit, width, value: 0 })
    }

    /// `I0.0=1`, `QW4=16#00FF`, as it is printed.
    pub fn parse(text: &str) -> Option<Self> {
        let (name, value) = text.split_once('=')?;
        let value = value.trim();
        let value = match value.strip_prefix("16#") {
            Some(digits) => u32::from_str_radix(digits, 16).ok()?,
            None => value.parse().ok()?,
        };
        Some(Self { value, ..Self::named(name)? })
    }

    /// The name of the cell: `QW4`.
    pub fn name(&self) -> String {
        let area = AREAS.iter().find(|(_, area)| *area == self.area).map_or("", |(word, _)| word);
        let (byte, bit) = (self.bit / 8, self.bit % 8);
        match self.width {
            Width::Bit => format!("{area}{byte}.{bit}"),
            Width::Byte => format!("{area}B{byte}"),
            Width::Word => format!("{area}W{byte}"),
            Width::DWord => format!("{area}D{byte}"),
        }
    }
}

impl fmt::Display for Forced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.width {
            Width::Bit => write!(f, "{}={}", self.name(), self.value & 1),
            width => {
                let digits = usize::from(width.bits() / 4);
                write!(f, "{}=16#{:0digits$X}", self.name(), self.value)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_is_read_again() {
        for text in ["I0.7=1", "QB3=16#0A", "MW20=16#1234", "PID256=16#00000001", "PQW4=16#FFFF"] {
            assert_eq!(Forced::parse(text).map(|forced| forced.to_string()).as_deref(), Some(text));
        }
        assert_eq!(Forced::named("e 1.2"), Forced::named("I1.2"));
        assert_eq!(Forced::named("PAW 256"), Forced::named("PQW256"));
        for wrong in ["", "I", "I1", "I1.8", "QW", "DB1.DBW0", "T1", "QW70000", "L2.0"] {
            assert_eq!(Forced::named(wrong), None, "{wrong}");
        }
    }
}
