//! Modbus, RTU and ASCII, master and slave. [S0 "Modbus - Basics"] to [S0 "Modbus - Error messages"]
//!
//! Four parts, each usable alone:
//!
//! * [`rtu`] and [`ascii`]: a telegram to a frame and back; total functions without time. [`tcp`]: the same for
//!   couplers on a network, which no CP uses.
//! * [`pdu`]: what the bytes of a telegram mean; lengths, requests, answers; [`exception`]:
//!   what an exception means.
//! * [`frame`]: characters with their times to telegrams; the silences of RTU, the start and end characters of ASCII.
//! * [`Master`] and [`Slave`]: the two machines.
//!
//! A *telegram* is the content of the program's data blocks: slave address, function code, data, without the check.
//! "The check sums are automatically added to every telegram. They are not shown in the data block." [S0 "Check sum
//! CRC, RTU, LRC"]

pub mod area;
pub mod ascii;
pub mod exception;
pub mod failure;
pub mod frame;
pub mod master;
pub mod pdu;
pub mod rtu;
pub mod slave;
pub mod tcp;

pub use failure::Failure;
pub use master::Master;
pub use slave::Slave;

/// Longest telegram without its check, bytes: `10h` with 125 words, that is address, function code, first word, number
/// of words, number of bytes and 250 bytes of data. [S0 "Write n Words 10h"]
pub const TELEGRAM_BYTES: usize = 257;

/// Characters of the longest frame: that of ASCII, two for each byte of telegram and LRC, `:`, CR and LF.
pub const FRAME_CHARACTERS: usize = 2 * (TELEGRAM_BYTES + 1) + 3;

/// How bytes are encoded. [S0 "ASCII-, RTU-Modus"]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Every byte is a character; silence separates telegrams.
    Rtu,
    /// Every byte is two characters of hexadecimal text; `:` begins, CR LF ends a telegram.
    Ascii,
}

impl Mode {
    /// Writes the frame of a telegram; returns its length in characters. `None`: the telegram is empty or longer than
    /// [`TELEGRAM_BYTES`].
    pub fn encode(self, telegram: &[u8], frame: &mut [u8; FRAME_CHARACTERS]) -> Option<usize> {
        if telegram.is_empty() || telegram.len() > TELEGRAM_BYTES {
            return None;
        }
        match self {
            Self::Rtu => rtu::encode(telegram, frame),
            Self::Ascii => ascii::encode(telegram, frame),
        }
    }
}
