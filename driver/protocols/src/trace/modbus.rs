//! Frames of Modbus in words.

use core::fmt;

use super::meaning::Modbus;
use crate::modbus::pdu::{Direction, ERROR_BIT, Function, exception_text};
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
        let what = match function {
            Function::ReadOutputBits => "read output bits",
            Function::ReadInputBits => "read input bits",
            Function::ReadOutputWords => "read output words",
            Function::ReadInputWords => "read input words",
            Function::WriteBit => "write bit",
            Function::WriteWord => "write word",
            Function::WriteBits => "write bits",
            Function::WriteWords => "write words",
        };
        write!(f, "{what} ({code:02X}h)")?;
        match function {
            Function::WriteBit => write!(f, ", {} := {}", word(2), if word(4) == 0 { 0 } else { 1 }),
            Function::WriteWord if self.telegram.len() == LONG_WRITE => {
                write!(f, ", {} := {:04X}{:04X}h, 32 bits", word(2), word(4), word(6))
            }
            Function::WriteWord => write!(f, ", {} := {:04X}h", word(2), word(4)),
            Function::WriteWords if !answer && word(4) > 0 && u16::from(byte(6)) == word(4).saturating_mul(4) => {
                write!(f, ", {} from {}, 32 bits", word(4), word(2))
            }
            _ if answer && !function.writes() => write!(f, ", {}", Bytes(usize::from(byte(2)))),
            _ => write!(f, ", {} from {}", word(4), word(2)),
        }
    }
}

/// Functions of the CP 341's loadable driver that the CP 240 does not have; and unknown functions.
fn others(f: &mut fmt::Formatter<'_>, telegram: &[u8], answer: bool) -> fmt::Result {
    let byte = |at: usize| telegram.get(at).copied().unwrap_or(0);
    let word = |at: usize| u16::from_be_bytes([byte(at), byte(at + 1)]);
    match (byte(1), answer) {
        (7, false) => f.write_str("read exception status (07h)"),
        (7, true) => write!(f, "read exception status (07h), {:02X}h", byte(2)),
        (8, _) => write!(f, "diagnostics (08h), code {}, value {:04X}h", word(2), word(4)),
        (11, false) => f.write_str("read event counter (0Bh)"),
        (11, true) => write!(f, "read event counter (0Bh), status {:04X}h, {} events", word(2), word(4)),
        (12, false) => f.write_str("read event log (0Ch)"),
        (12, true) => {
            write!(f, "read event log (0Ch), status {:04X}h, {} events, {} messages", word(3), word(5), word(7))?;
            write!(f, ", log of {}", Bytes(usize::from(byte(2)).saturating_sub(6)))
        }
        (code, _) => write!(f, "function {code:02X}h"),
    }
}
