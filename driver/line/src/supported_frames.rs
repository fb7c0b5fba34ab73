//! Checks whether the lines of this crate support the settings.

use std::fmt;

pub use ob1_serial::{Flow, LineSettings, Parity, StopBits};

/// Refuses settings that no line of this crate supports.
///
/// # Errors
/// [`SettingsError`] names the setting and the remedy.
pub(crate) const fn check(settings: &LineSettings) -> Result<(), SettingsError> {
    if matches!(settings.stop_bits, StopBits::OneAndHalf) {
        return Err(SettingsError::StopBits);
    }
    if settings.data_bits < 5 || settings.data_bits > 8 {
        return Err(SettingsError::DataBits(settings.data_bits));
    }
    if settings.baud == 0 {
        return Err(SettingsError::Baud);
    }
    Ok(())
}

/// Settings that no line accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SettingsError {
    /// 1.5 stop bits: Linux cannot set them.
    #[error("1.5 stop bits: Linux cannot set them; use 1 or 2 stop bits (a receiver set to 1.5 accepts 2)")]
    StopBits,
    /// Data bits outside 5 to 8.
    #[error("{0} data bits: only 5 to 8 exist")]
    DataBits(u8),
    /// A baud rate of 0.
    #[error("0 baud")]
    Baud,
}

/// A setting that the line does not support; it runs without it.
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
    fn one_and_a_half_stop_bits_are_refused() {
        let s = LineSettings { stop_bits: StopBits::OneAndHalf, ..LineSettings::default() };
        assert_eq!(check(&s), Err(SettingsError::StopBits));
        assert_eq!(check(&LineSettings { data_bits: 9, ..LineSettings::default() }), Err(SettingsError::DataBits(9)));
        assert_eq!(check(&LineSettings::default()), Ok(()));
    }
}
