//! Byte 0 and its nibbles, and how a telegram is cut.

/// Smallest and largest number of bytes a CP 040 occupies each way.
pub const IO_BYTES: core::ops::RangeInclusive<usize> = 8..=60;

/// Longest telegram, in user bytes. [S3 L303]
pub const TELEGRAM_MAX: u16 = 1024;

/// Output byte 0: the acknowledgement of what is received lies in the high nibble, the command in the low one. In input
/// byte 0 it is the other way about: the answer to the command is high, the fragment info low. [S3 L315]
pub const ACKNOWLEDGE_SHIFT: u8 = 4;

/// Idle.
pub const IDLE: u8 = 0x8;
/// First part of several.
pub(crate) const FIRST: u8 = 0x9;
/// The only part, or the last one.
pub(crate) const LAST: u8 = 0xA;
/// Command, in either nibble: execute a reset.
pub const RESET: u8 = 0xB;
/// Answer: the reset was executed.
pub(crate) const RESET_DONE: u8 = 0xC;
/// Answer: the entered length is not valid.
pub(crate) const BAD_LENGTH: u8 = 0xD;
/// Answer: error in the communication.
pub(crate) const FAILED: u8 = 0xE;

/// Telegram info, and two bytes of length.
pub(crate) const HEAD_BYTES: usize = 3;

/// Telegram info: an offset word follows the length. [S3 L321]
pub(crate) const INFO_OFFSET: u8 = 0x04;

/// Fragments of a stream of so many bytes, byte 0 of each left out.
///
/// To send, the stream is the user data and 3 bytes in front: "ceil((length + 3) / (IO size - 1))".
pub const fn fragments(stream_bytes: usize, io_bytes: usize) -> usize {
    stream_bytes.div_ceil(io_bytes - 1)
}

/// Nibble of fragment `n`, counted from 0. Those between the first and the last count 0 to 7, and begin again.
/// [S3 L315]
pub(crate) const fn nibble(n: usize, stream_bytes: usize, io_bytes: usize) -> u8 {
    if n + 1 >= fragments(stream_bytes, io_bytes) {
        LAST
    } else if n == 0 {
        FIRST
    } else {
        ((n - 1) % 8) as u8
    }
}

/// Whether the inputs are those of a CP that is not there: it reads as zeros, and `0` answers no other command than
/// `0`.
pub(crate) fn is_absent(inputs: &[u8], output0: u8) -> bool {
    inputs.first().is_none_or(|byte| *byte == 0) && output0 & 0x0F != 0
}
