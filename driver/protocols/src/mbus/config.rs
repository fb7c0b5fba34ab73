//! Times of the M-Bus, and the baud rate in front of each telegram.

use super::frame::FRAME_MAX;
use crate::machine::{MS, Span};

/// Times of [`MBus`](super::MBus): most in bit times, because each telegram names its baud rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// The answer's first character must come within this many bit times ...
    pub answer_bits: u32,
    /// ... and this much more, nanoseconds.
    pub answer_more: Span,
    /// Silence of the bus after a failed exchange, bit times.
    pub pause_bits: u32,
    /// Shortest gap that ends an answer, nanoseconds: a frame has no pauses, but a tty or a network delivers characters
    /// in pieces. 0: only bit times count.
    pub gap_min: Span,
}

impl Config {
    /// Bits of a character: start bit, 8 data bits, even parity, stop bit. [EN 1434-3]
    pub const CHARACTER_BITS: u32 = 11;

    /// 330 bit times plus 50 ms, 33 bit times of pause. [S0 "FCB bit"] The gap is ours.
    pub fn cp240() -> Self {
        Self { answer_bits: 330, answer_more: 50 * MS, pause_bits: 33, gap_min: 30 * MS }
    }

    /// For a line that may hand over characters up to `late` late, because they come in bursts.
    #[must_use]
    pub fn with_bursts(mut self, late: Span) -> Self {
        self.gap_min = self.gap_min.max(late);
        self.answer_more += late;
        self
    }

    pub(super) fn answer(&self, bit: Span) -> Span {
        bit * u64::from(self.answer_bits) + self.answer_more
    }

    pub(super) fn pause(&self, bit: Span) -> Span {
        bit * u64::from(self.pause_bits)
    }

    /// Time of the longest frame.
    pub(super) fn longest_frame(&self, bit: Span) -> Span {
        bit * u64::from(Self::CHARACTER_BITS) * FRAME_MAX as u64
    }

    pub(super) fn gap(&self, bit: Span) -> Span {
        self.pause(bit).max(self.gap_min)
    }
}

/// The baud rate of a telegram's first byte; any other byte means 2400. [S0 "Overview of M-Bus telegrams"]
pub fn baud_of(code: u8) -> u32 {
    match code {
        0xB8 => 300,
        0xBD => 9600,
        _ => 2400,
    }
}
