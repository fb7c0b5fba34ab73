//! The character frame, and the time a character takes on the wire.

use core::fmt;

use crate::Span;

/// Parity bit of a character.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Parity {
    /// Characters have no parity bit.
    #[default]
    None,
    /// Odd number of ones.
    Odd,
    /// Even number of ones.
    Even,
}

/// Stop bits of a character.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum StopBits {
    /// One stop bit after each character.
    #[default]
    One,
    /// 1.5: the CPs have it as a parameter, Linux does not support it.
    OneAndHalf,
    /// Two stop bits after each character.
    Two,
}

/// Who may stop the sender, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Flow {
    /// The sender never waits.
    #[default]
    None,
    /// By the modem lines RTS and CTS.
    Hardware,
    /// XON = 11h, XOFF = 13h.
    XonXoff,
}

/// The settings of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LineSettings {
    /// Bits per second, as on the wire.
    pub baud: u32,
    /// Data bits of a character, 5 to 8.
    pub data_bits: u8,
    /// Parity bit of a character.
    pub parity: Parity,
    /// Stop bits of a character.
    pub stop_bits: StopBits,
    /// Flow control in both directions.
    pub flow: Flow,
    /// One side at a time sends: two wires, or a protocol of requests and answers. What comes while the line sends is
    /// not heard, and an adapter that gives back what is sent is found.
    pub half_duplex: bool,
}

impl LineSettings {
    /// Length of a character in half bits: start bit, data bits, parity bit, stop bits.
    pub const fn half_bits(&self) -> u32 {
        let parity = if matches!(self.parity, Parity::None) { 0 } else { 2 };
        let stop = match self.stop_bits {
            StopBits::One => 2,
            StopBits::OneAndHalf => 3,
            StopBits::Two => 4,
        };
        2 + 2 * self.data_bits as u32 + parity + stop
    }

    /// Time of this many characters on the line, rounded up.
    pub const fn time_of(&self, characters: usize) -> Span {
        let half_bits = (self.half_bits() as u64).saturating_mul(characters as u64);
        let baud = if self.baud == 0 { 1 } else { self.baud as u64 };
        Span::from_nanos(half_bits.saturating_mul(500_000_000).div_ceil(baud))
    }

    /// Time of one character.
    pub const fn char_time(&self) -> Span {
        self.time_of(1)
    }
}

impl Default for LineSettings {
    /// 9600 8N1, full duplex, the default of the parameter tables. [S0 "Structure of the parameter bytes of ASCII"]
    fn default() -> Self {
        Self {
            baud: 9600,
            data_bits: 8,
            parity: Parity::None,
            stop_bits: StopBits::One,
            flow: Flow::None,
            half_duplex: false,
        }
    }
}

impl fmt::Display for Parity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Parity::None => "none",
            Parity::Odd => "odd",
            Parity::Even => "even",
        })
    }
}

impl fmt::Display for StopBits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            StopBits::One => "1",
            StopBits::OneAndHalf => "1.5",
            StopBits::Two => "2",
        })
    }
}

impl fmt::Display for LineSettings {
    /// `9600 8E1`, followed by the flow control if there is one.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Odd => 'O',
            Parity::Even => 'E',
        };
        write!(f, "{} {}{parity}{}", self.baud, self.data_bits, self.stop_bits)?;
        match self.flow {
            Flow::None => Ok(()),
            Flow::Hardware => write!(f, " RTS/CTS"),
            Flow::XonXoff => write!(f, " XON/XOFF"),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString as _;

    use super::*;

    #[test]
    fn a_character_lasts_as_long_as_its_frame() {
        let s = LineSettings::default();
        assert_eq!(s.time_of(1), Span::from_nanos(1_041_667), "10 bits at 9600 baud");
        assert_eq!(s.time_of(0), Span::ZERO);
        let e = LineSettings { parity: Parity::Even, ..s };
        assert_eq!(e.time_of(96), Span::from_nanos(110_000_000), "96 x 11 bits at 9600 baud");
        let h = LineSettings { stop_bits: StopBits::OneAndHalf, ..s };
        assert_eq!(h.time_of(2), Span::from_nanos(2_187_500), "2 x 10.5 bits");
        assert_eq!(e.to_string(), "9600 8E1");
    }
}
