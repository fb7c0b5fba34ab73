//! A frame of the M-Bus in words. [S0 "Overview of M-Bus telegrams"]

use core::fmt;

use crate::mbus::frame::{FROM_MASTER, Frame};
use crate::words::Bytes;

/// FCB and FCV of a master's C field, ACD and DFC of a slave's: they are not part of the function. [S0 "C field"]
const BITS: u8 = 0x30;

/// A frame in words.
pub(super) struct Words<'a>(pub(super) Frame<'a>);

impl fmt::Display for Words<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Frame::Single => f.write_str("acknowledged (E5h)"),
            Frame::Short { c, a } => head(f, c, a),
            Frame::Long { c, a, ci, data } => {
                head(f, c, a)?;
                write!(f, ", CI {ci:02X}h")?;
                match application(ci, c & FROM_MASTER != 0) {
                    "" => {}
                    what => write!(f, ", {what}")?,
                }
                if data.is_empty() { Ok(()) } else { write!(f, ", {}", Bytes(data.len())) }
            }
        }
    }
}

/// Direction, address and function.
fn head(f: &mut fmt::Formatter<'_>, c: u8, a: u8) -> fmt::Result {
    f.write_str(if c & FROM_MASTER != 0 { "to " } else { "from " })?;
    // [S0 "A field"]
    match a {
        253 => f.write_str("the selected slave")?,
        254 => f.write_str("any slave")?,
        255 => f.write_str("all slaves")?,
        address => write!(f, "{address}")?,
    }
    let function = match c & !BITS {
        0x40 => "SND_NKE, initialise",
        0x43 => "SND_UD, send data",
        0x4B => "REQ_UD2, request data class 2",
        0x4A => "REQ_UD1, request data class 1",
        0x08 => "RSP_UD, data",
        _ => "function",
    };
    write!(f, ": {function} ({c:02X}h)")
}

/// [S0 "CI field"]; empty: not in its tables.
const fn application(ci: u8, from_master: bool) -> &'static str {
    match (from_master, ci) {
        (false, 0x70) => "error state",
        (false, 0x71) => "alarm state",
        (false, 0x72) => "variable data",
        (false, 0x73) => "fixed data",
        (true, 0x50) => "reset application",
        (true, 0x51) => "data",
        (true, 0x52) => "select slave",
        (true, 0x54) => "synchronise",
        (true, 0xB8) => "set baud rate 300",
        (true, 0xB9) => "set baud rate 600",
        (true, 0xBA) => "set baud rate 1200",
        (true, 0xBB) => "set baud rate 2400",
        (true, 0xBC) => "set baud rate 4800",
        (true, 0xBD) => "set baud rate 9600",
        (true, 0xBE) => "set baud rate 19200",
        (true, 0xBF) => "set baud rate 38400",
        _ => "",
    }
}
