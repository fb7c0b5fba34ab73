//! CP 040: the common parts of both directions of the host protocol: byte 0 with its two nibbles, and how a telegram is
//! divided into fragments.
//!
//! A telegram is a stream of bytes: telegram info, length (high, low), then the rest. It is divided into pieces of IO
//! size - 1 bytes, and each piece is transferred after byte 0: "ceil((length + 3) / (IO size - 1))" telegrams for
//! sending. [S3 L313]

/// Minimum and maximum number of bytes the CP occupies in each direction.
pub const IO_BYTES: core::ops::RangeInclusive<usize> = 8..=60;

/// Longest telegram, in user bytes. [S3 L303]
pub const TELEGRAM_MAX: u16 = 1024;

/// Output byte 0: the high nibble is the acknowledgement of received fragments, the low nibble the command. In input
/// byte 0 the high nibble is the answer to the command, the low nibble the fragment info. [S3 L315]
pub const ACKNOWLEDGE_SHIFT: u8 = 4;

/// Bytes of telegram info and length before every telegram.
pub const HEAD_BYTES: usize = 3;

/// Telegram info: no offset.
pub const INFO_PLAIN: u8 = 0x00;
/// Telegram info: an offset word follows the length. [S3 L321]
pub const INFO_OFFSET: u8 = 0x04;

/// Bytes of the offset, between length and return value, if there is one.
pub const OFFSET_BYTES: usize = 2;

/// Bytes of the return value of the CP, before the data.
pub const RETURN_BYTES: usize = 2;

/// Idle, in every nibble.
pub const IDLE: u8 = 0x8;
/// First piece of several.
pub const FIRST: u8 = 0x9;
/// The only piece, or the last one.
pub const LAST: u8 = 0xA;
/// Command of the host in either nibble: reset.
pub const RESET: u8 = 0xB;
/// Answer of the CP: the reset was executed.
pub const RESET_DONE: u8 = 0xC;
/// Answer of the CP: the length is not valid.
pub const BAD_LENGTH: u8 = 0xD;
/// Answer of the CP: error in the communication.
pub const FAILED: u8 = 0xE;

/// The registers of one direction; only the first IO-size bytes are used.
pub type Area = [u8; *IO_BYTES.end()];

/// High and low nibble of byte 0.
pub fn nibbles(area: &[u8]) -> (u8, u8) {
    let byte = area.first().copied().unwrap_or(0);
    (byte >> 4, byte & 0x0F)
}

/// Nibble of piece `n` (from 0) of a stream of `total` bytes, divided into pieces of `piece` bytes. Fragments between
/// the first and the last are numbered 0 to 7 repeatedly. [S3 L315]
pub const fn nibble(n: usize, total: usize, piece: usize) -> u8 {
    if (n + 1) * piece >= total {
        LAST
    } else if n == 0 {
        FIRST
    } else {
        ((n - 1) % 8) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_numbered_as_printed() {
        // IO size 16, 50 bytes: 9, 0, 1, A. IO size 60, 40 bytes: A. [S3 "Examples"]
        assert_eq!([0, 1, 2, 3].map(|n| nibble(n, 53, 15)), [FIRST, 0, 1, LAST]);
        assert_eq!(nibble(0, 43, 59), LAST);
        assert_eq!([7, 8, 9, 10].map(|n| nibble(n, 1027, 15)), [6, 7, 0, 1], "wraps");
    }

    #[test]
    fn a_piece_that_fits_exactly_is_the_last() {
        assert_eq!(nibble(0, 15, 15), LAST);
        assert_eq!(nibble(0, 16, 15), FIRST);
        assert_eq!(nibble(1, 30, 15), LAST);
    }
}
