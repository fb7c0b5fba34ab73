//! Frames of Modbus in words.

use core::fmt;

use super::meaning::{Modbus, Names};
use crate::modbus::exception::exception_text;
use crate::modbus::pdu::{Direction, ERROR_BIT, Function};
use crate::words::Bytes;

/// Length of function 06 with a 32-bit register: only its four bytes of data show it. [S4 "5.8 Function Code 06 – Write
/// Single 32-Bit Register"]
const LONG_WRITE: usize = 8;

impl fmt::Display for Modbus<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let byte = |at: usize| self.telegram.get(at).copied().unwrap_or(0);
        let word = |at: usize| u16::from_be_bytes([byte(at), byte(at + 1)]);
        let (slave, code) = (byte(0), byte(1));
        if slave == 0 {
            f.write_str("to all slaves")?;
        } else {
            write!(f, "slave {slave}")?;
        }
        let answer = self.direction == Direction::Answer;
        f.write_str(if answer { ", answer: " } else { ", request: " })?;
        if answer && code & ERROR_BIT != 0 {
            let why = exception_text(byte(2));
            return write!(f, "exception {:02X}h, {why}, to function {:02X}h", byte(2), code & !ERROR_BIT);
        }
        let Some(function) = Function::of(code) else { return others(f, self.telegram, answer) };
        write!(f, "{} ({code:02X}h)", name(function, self.names))?;
        match function {
            Function::WriteBit => write!(f, ", {} := {}", word(2), if word(4) == 0 { 0 } else { 1 }),
            Function::WriteWord if self.names == Names::LONG => {
                write!(f, ", {} := {:04X}{:04X}h", word(2), word(4), word(6))
            }
            Function::WriteWord => write!(f, ", {} := {:04X}h", word(2), word(4)),
            _ if answer && !function.writes() => write!(f, ", {}", Bytes(usize::from(byte(2)))),
            _ => write!(f, ", {} from {}", word(4), word(2)),
        }
    }
}

const fn name(function: Function, names: Names) -> &'static str {
    let (vipa, siemens) = match function {
        Function::ReadOutputBits => ("read output bits", "Read Coils"),
        Function::ReadInputBits => ("read input bits", "Read Discrete Input"),
        Function::ReadOutputWords => ("read output words", "Read Holding Registers"),
        Function::ReadInputWords => ("read input words", "Read Input Registers"),
        Function::WriteBit => ("write bit", "Write Single Coil"),
        Function::WriteWord => ("write word", "Write Single Register"),
        Function::WriteBits => ("write bits", "Write Multiple Coils"),
        Function::WriteWords => ("write words", "Write Multiple Registers"),
    };
    match (names, function) {
        (Names::Vipa, _) => vipa,
        (Names::Siemens { long: true }, Function::ReadOutputWords) => "Read 32-Bit Holding Registers",
        (Names::Siemens { long: true }, Function::WriteWord) => "Write Single 32-Bit Register",
        (Names::Siemens { long: true }, Function::WriteWords) => "Write Multiple 32-Bit Registers",
        (Names::Siemens { .. }, _) => siemens,
    }
}

impl Names {
    const LONG: Self = Self::Siemens { long: true };

    /// Siemens' names for a telegram of the loadable driver. `asked`: for an answer, the number of registers that the
    /// request before it has named, and whether they have 32 bits; the return value is that of this telegram.
    pub(super) fn loadable(telegram: &[u8], direction: Direction, asked: (u16, bool)) -> (Self, (u16, bool)) {
        let byte = |at: usize| telegram.get(at).copied().unwrap_or(0);
        let word = |at: usize| u16::from_be_bytes([byte(at), byte(at + 1)]);
        let answer = direction == Direction::Answer;
        let long = match Function::of(byte(1)) {
            Some(Function::ReadOutputWords) => answer && asked.0 > 0 && u16::from(byte(2)) == asked.0.saturating_mul(4),
            Some(Function::WriteWord) => telegram.len() == LONG_WRITE,
            Some(Function::WriteWords) if answer => asked.1,
            Some(Function::WriteWords) => word(4) > 0 && u16::from(byte(6)) == word(4).saturating_mul(4),
            _ => false,
        };
        (Self::Siemens { long }, (word(4), long))
    }
}

/// Functions of the CP 341's loadable driver that the CP 240 does not have; and unknown functions.
fn others(f: &mut fmt::Formatter<'_>, telegram: &[u8], answer: bool) -> fmt::Result {
    let byte = |at: usize| telegram.get(at).copied().unwrap_or(0);
    let word = |at: usize| u16::from_be_bytes([byte(at), byte(at + 1)]);
    match (byte(1), answer) {
        (7, false) => f.write_str("Read Exception Status (07h)"),
        (7, true) => write!(f, "Read Exception Status (07h), {:02X}h", byte(2)),
        (8, _) => write!(f, "Diagnostics (08h), code {}, value {:04X}h", word(2), word(4)),
        (11, false) => f.write_str("Get Comm Event Counter (0Bh)"),
        (11, true) => write!(f, "Get Comm Event Counter (0Bh), status {:04X}h, {} events", word(2), word(4)),
        (12, false) => f.write_str("Get Comm Event Log (0Ch)"),
        (12, true) => {
            write!(f, "Get Comm Event Log (0Ch), status {:04X}h, {} events, {} messages", word(3), word(5), word(7))?;
            write!(f, ", log of {}", Bytes(usize::from(byte(2)).saturating_sub(6)))
        }
        (code, _) => write!(f, "function {code:02X}h"),
    }
}
