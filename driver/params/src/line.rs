//! The character frame and what follows from it.

use std::fmt;

/// Parity bit of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parity {
    /// No parity bit.
    None,
    /// Odd number of ones.
    Odd,
    /// Even number of ones.
    Even,
}

/// Stop bits of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StopBits {
    /// 1.
    One,
    /// 1.5.
    OneAndHalf,
    /// 2.
    Two,
}

/// Flow control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Flow {
    /// None.
    None,
    /// RTS and CTS.
    Hardware,
    /// XON = 11h, XOFF = 13h.
    XonXoff,
}

/// How characters travel on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LineSettings {
    /// Bits per second.
    pub baud: u32,
    /// Data bits, 5..8.
    pub data_bits: u8,
    /// Parity bit.
    pub parity: Parity,
    /// Stop bits.
    pub stop_bits: StopBits,
    /// Flow control.
    pub flow: Flow,
}

impl LineSettings {
    /// Length of a character in half bits: start bit, data bits, parity bit, stop bits.
    pub fn half_bits(&self) -> u32 {
        let parity = if self.parity == Parity::None { 0 } else { 2 };
        let stop = match self.stop_bits {
            StopBits::One => 2,
            StopBits::OneAndHalf => 3,
            StopBits::Two => 4,
        };
        2 + 2 * u32::from(self.data_bits) + parity + stop
    }

    /// Time of one character on the line in nanoseconds, rounded up.
    pub fn char_time_ns(&self) -> u64 {
        (u64::from(self.half_bits()) * 500_000_000).div_ceil(u64::from(self.baud.max(1)))
    }
}

impl fmt::Display for LineSettings {
    /// `9600 8E1`, with the flow control behind it where there is one.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Odd => 'O',
            Parity::Even => 'E',
        };
        let stop = match self.stop_bits {
            StopBits::One => "1",
            StopBits::OneAndHalf => "1.5",
            StopBits::Two => "2",
        };
        write!(f, "{} {}{parity}{stop}", self.baud, self.data_bits)?;
        match self.flow {
            Flow::None => Ok(()),
            Flow::Hardware => write!(f, " RTS/CTS"),
            Flow::XonXoff => write!(f, " XON/XOFF"),
        }
    }
}
