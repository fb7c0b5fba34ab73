//! The signals of a line, and its faults.

use core::fmt;

/// A fault of a line. The first four take the place of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// The parity bit of a character is wrong.
    Parity,
    /// The stop bit of a character is missing.
    Framing,
    /// Characters were lost because nobody fetched them.
    Overrun,
    /// The line was at 0 for longer than a character.
    Break,
    /// The device was pulled or the connection ended (open circuit). Output from now on is discarded.
    Gone,
    /// The device or the connection is back.
    Back,
}

/// The modem inputs of the CP; `true` is ON.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModemLines {
    /// Clear to send: the partner (or modem) accepts characters.
    pub cts: bool,
    /// Data set ready: the partner (or modem) is switched on.
    pub dsr: bool,
    /// Ring indicator: the modem signals a call.
    pub ri: bool,
    /// Carrier detect: the modem hears the other one.
    pub cd: bool,
}

impl ModemLines {
    /// What counts as long as a line has not reported, and always on one without modem lines: nothing holds back.
    pub const UNREPORTED: Self = Self { cts: true, dsr: true, ri: false, cd: true };

    /// CTS, DSR, RI, CD as bits 0 to 3.
    pub fn bits(self) -> u8 {
        [self.cts, self.dsr, self.ri, self.cd].into_iter().rev().fold(0, |bits, on| bits << 1 | u8::from(on))
    }
}

impl fmt::Display for LineFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LineFault::Parity => "parity error",
            LineFault::Framing => "framing error",
            LineFault::Overrun => "overrun",
            LineFault::Break => "BREAK",
            LineFault::Gone => "the line is gone",
            LineFault::Back => "the line is back",
        })
    }
}
