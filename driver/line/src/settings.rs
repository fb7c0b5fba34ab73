//! The character frame and the baud rate, and the time a character takes on the wire.

use std::fmt;

use crate::Nanos;

/// Parity bit of a character frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Parity {
    /// No parity bit.
    #[default]
    None,
    /// Odd parity.
    Odd,
    /// Even parity.
    Even,
}

/// Stop bits of a character frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StopBits {
    /// One stop bit.
    #[default]
    One,
    /// One and a half: known to the CP 240's parameter record, not to Linux.
    OneAndHalf,
    /// Two stop bits.
    Two,
}

/// Flow control of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Flow {
    /// None.
    #[default]
    None,
    /// RTS/CTS.
    Hardware,
    /// XON/XOFF (11h/13h).
    XonXoff,
}

/// What a CP asks of its line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second, at least 1.
    pub baud: u32,
    /// Data bits, 5 to 8.
    pub data_bits: u8,
    /// Parity.
    pub parity: Parity,
    /// Stop bits.
    pub stop_bits: StopBits,
    /// Flow control.
    pub flow: Flow,
}

impl Default for LineSettings {
    /// 9600 8N1, the default of the parameter tables [S0 "Structure of the parameter bytes of ASCII"].
    fn default() -> Self {
        Self { baud: 9600, data_bits: 8, parity: Parity::None, stop_bits: StopBits::One, flow: Flow::None }
    }
}

impl LineSettings {
    /// Length of a character frame in half bits: start bit, data bits, parity bit, stop bits.
    const fn half_bits(&self) -> u64 {
        let stop = match self.stop_bits {
            StopBits::One => 2,
            StopBits::OneAndHalf => 3,
            StopBits::Two => 4,
        };
        let parity = if matches!(self.parity, Parity::None) { 0 } else { 2 };
        2 + 2 * self.data_bits as u64 + parity + stop
    }

    /// The time `characters` take on the wire, in nanoseconds, rounded up.
    pub const fn time_of(&self, characters: usize) -> Nanos {
        let half_bits = self.half_bits().saturating_mul(characters as u64);
        let baud = if self.baud == 0 { 1 } else { self.baud as u64 };
        half_bits.saturating_mul(1_000_000_000).div_ceil(2 * baud)
    }

    /// Refuses what no line of this crate can do.
    ///
    /// # Errors
    /// [`SettingsError`] names the setting and the remedy.
    pub const fn check(&self) -> Result<(), SettingsError> {
        if matches!(self.stop_bits, StopBits::OneAndHalf) {
            return Err(SettingsError::StopBits);
        }
        if self.data_bits < 5 || self.data_bits > 8 {
            return Err(SettingsError::DataBits(self.data_bits));
        }
        if self.baud == 0 {
            return Err(SettingsError::Baud);
        }
        Ok(())
    }
}

impl fmt::Display for LineSettings {
    /// `9600 8N1`, with ` rts/cts` or ` xon/xoff` behind it.
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
            Flow::Hardware => write!(f, " rts/cts"),
            Flow::XonXoff => write!(f, " xon/xoff"),
        }
    }
}

/// Settings that no line accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SettingsError {
    /// 1.5 stop bits.
    #[error("1.5 stop bits: Linux cannot set them; use 1 or 2 stop bits (a receiver set to 1.5 accepts 2)")]
    StopBits,
    /// Data bits outside 5 to 8.
    #[error("{0} data bits: only 5 to 8 exist")]
    DataBits(u8),
    /// Baud rate 0.
    #[error("0 baud")]
    Baud,
}

/// Something the line was asked for and cannot do; it runs without it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning(pub String);

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_character_lasts_as_long_as_its_frame() {
        let s = LineSettings::default();
        assert_eq!(s.time_of(1), 1_041_667, "10 bits at 9600 baud");
        assert_eq!(s.time_of(0), 0);
        let e = LineSettings { parity: Parity::Even, ..s };
        assert_eq!(e.time_of(96), 110_000_000, "96 x 11 bits at 9600 baud");
        let h = LineSettings { stop_bits: StopBits::OneAndHalf, ..s };
        assert_eq!(h.time_of(2), 2_187_500, "2 x 10.5 bits");
        assert_eq!(e.to_string(), "9600 8E1");
    }

    #[test]
    fn one_and_a_half_stop_bits_are_refused() {
        let s = LineSettings { stop_bits: StopBits::OneAndHalf, ..LineSettings::default() };
        assert_eq!(s.check(), Err(SettingsError::StopBits));
        assert_eq!(LineSettings { data_bits: 9, ..LineSettings::default() }.check(), Err(SettingsError::DataBits(9)));
        assert_eq!(LineSettings::default().check(), Ok(()));
    }
}
