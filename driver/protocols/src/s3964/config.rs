//! Settings of a 3964(R) interface, and the differences between the CPs that have it.

use crate::machine::{Span, TELEGRAM_MAX};

/// Which side gives way in an initialisation conflict. The two partners must be set differently. [S0 "Priority"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Priority {
    /// Gives way: receives first, then starts its own order again.
    Low,
    /// Ignores the partner's STX and waits for DLE.
    High,
}

/// Configuration of [`S3964`](super::S3964). Times in nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// 3964R: blocks carry a block check character.
    pub bcc: bool,
    /// Which side gives way.
    pub priority: Priority,
    /// ZVZ, character delay: longest time between two characters of a block, and from our DLE to the first of them.
    /// 0: two character times. [S0 "Character delay time (ZVZ)"]
    pub zvz: Span,
    /// QVZ, acknowledgement delay: longest time from the last bit of STX, or of a block, to the partner's answer.
    pub qvz: Span,
    /// ZNA: pause between the end of an order and the STX of the next. [S0 "Time delay after command (ZNA)"]
    pub zna: Span,
    /// BWZ of the CP 240: from the acknowledged request telegram to STX of the answer telegram. Plain 3964(R) has
    /// neither requests nor answers, so this field is only for RK 512. [S0 L1635]
    pub bwz: Span,
    /// Time of one character on the line.
    pub char_time: Span,
    /// Attempts to get a connection, the first included; at least 1.
    pub connect_attempts: u16,
    /// Attempts to get a block through, the first included; at least 1. Each has its own connection attempts.
    pub block_attempts: u16,
    /// Longest telegram, bytes of user data; the machine's own buffer is a further limit.
    pub telegram_max: usize,
    /// How long a partner that wants to send must wait for a receive buffer before NAK; 0: not at all.
    pub buffer_wait: Span,
    /// One NAK at the start sets the partner to idle.
    pub nak_at_start: bool,
    /// A character without meaning is answered by NAK when the line has fallen silent for ZVZ; otherwise at once.
    pub nak_after_silence: bool,
    /// BREAK ends the running order; otherwise it counts as an unreadable character.
    pub break_ends_order: bool,
    /// How long the line must be silent after a refusal before the next STX; 0: at once. A partner that answers each
    /// character without meaning with NAK also answers those that were still being sent when it refused the first. If
    /// STX followed each of these answers, two STX could arrive where data begin, and two equal characters cancel out
    /// in the check character. (ours)
    pub quiet: Span,
    /// How long to wait for the repetition of a refused block before own orders continue; 0: back to idle at once.
    pub repetition_wait: Span,
}

impl Config {
    /// The CP 240, with nothing set that is a parameter: no times, one attempt, low priority. The defaults of the
    /// parameters are in `ob1-params`.
    pub const fn cp240(char_time: Span) -> Self {
        Self {
            bcc: false,
            priority: Priority::Low,
            zvz: Span::ZERO,
            qvz: Span::ZERO,
            zna: Span::ZERO,
            bwz: Span::ZERO,
            char_time,
            connect_attempts: 1,
            block_attempts: 1,
            // The text says 250 bytes, the technical data 1024. [S0 L1616, L2804]
            telegram_max: TELEGRAM_MAX,
            buffer_wait: Span::ZERO,  // [S0 "Passive operation"]: not ready: NAK
            nak_at_start: false,      // not mentioned
            nak_after_silence: false, // [S0 "Passive operation"]: "it will transmit a NAK"
            break_ends_order: false,  // not mentioned
            quiet: Span::from_millis(10).plus(char_time.times(2)),
            repetition_wait: Span::ZERO, // [S0 "Data Link Escape"]: "wait for another connection request"
        }
    }

    /// The CP 341, likewise: 4 s for the repetition of a refused block, 400 ms for a receive buffer.
    /// [TIA help "Configuration for point-to-point links"]
    pub const fn cp341(char_time: Span) -> Self {
        Self {
            telegram_max: 4096,
            buffer_wait: Span::from_millis(400),
            nak_at_start: true,
            nak_after_silence: true,
            break_ends_order: true,
            repetition_wait: Span::from_secs(4),
            ..Self::cp240(char_time)
        }
    }

    /// ZVZ in force: 0 stands for two character times.
    pub(super) fn zvz(&self) -> Span {
        if self.zvz.is_zero() { 2 * self.char_time } else { self.zvz }
    }
}
