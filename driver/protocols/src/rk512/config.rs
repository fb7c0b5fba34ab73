//! Settings of an RK 512 interface, and the differences between the CPs that have it.

use crate::machine::{SECOND, Span};
use crate::s3964;

/// Long enough for a telegram being sent, repetitions included; short compared with the monitoring before it.
const LATE_WAIT: Span = Span::from_secs(2);

/// Configuration of [`Rk512`](super::Rk512). Times in nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// The procedure below: 3964 or 3964R. Its BWZ is the longest time from the acknowledgement of an order's telegram
    /// to STX of the reaction, after which the telegram is sent again, `block_attempts` (DBL) times in all; 0: never
    /// (CP 341). [S0 L1635]
    pub line: s3964::Config,
    /// Reaction monitoring: longest time from the acknowledgement of an order's telegram to its reaction; it restarts
    /// with each repetition and each follow-on telegram. [S0 L1678],
    /// [TIA help "Configuration for point-to-point links"]
    pub reaction: Span,
    /// How long an order waits for the overdue reaction of a previous order, so that it does not take that reaction for
    /// its own. (ours)
    pub late_wait: Span,
    /// How long the CPU has to answer an order of the partner, or to make progress with it
    /// ([`Order::Working`](super::Order::Working)); after that the order is refused with 2Ah. Shorter than the
    /// partner's reaction monitoring.
    pub answer_wait: Span,
    /// How long the next telegram of the partner's order is waited for.
    pub follow_wait: Span,
    /// Longest order in bytes; the machine's own buffer is a further limit.
    pub data_max: usize,
    /// Highest byte of a coordination flag, 0 to 254.
    pub flag_byte_max: u8,
    /// Highest CPU number in the partner's orders; 0 to 4.
    pub cpu_max: u8,
}

impl Config {
    /// The CP 240: 5 s for the reaction [S0 L1678], 1024 bytes [S0 "Error message CP Byte 0"], flags in bytes 0 to 199
    /// (docs/cp240-blocks.md). A CPU number is accepted as in the Siemens texts, 1 to 4, and ignored.
    pub fn cp240(line: s3964::Config) -> Self {
        Self {
            line,
            reaction: 5 * SECOND,
            late_wait: LATE_WAIT,
            answer_wait: 4 * SECOND,
            follow_wait: 5 * SECOND,
            data_max: 1024,
            flag_byte_max: 199,
            cpu_max: 4,
        }
    }

    /// The CP 341: 20 s for the reaction [TIA help "Configuration for point-to-point links"], 4096 bytes
    /// [TIA help "PtP data link CP 341"], 10 s for the CPU to take the data (0409h).
    pub fn cp341(line: s3964::Config) -> Self {
        Self {
            line,
            reaction: 20 * SECOND,
            late_wait: LATE_WAIT,
            answer_wait: 10 * SECOND,
            follow_wait: 20 * SECOND,
            data_max: 4096,
            flag_byte_max: 254,
            cpu_max: 4,
        }
    }

    /// Reaction monitoring of a CP 341 whose option "transmission-rate dependent" is on.
    /// [TIA help "Configuration for point-to-point links"]
    ///
    /// The table gives 300, 600, 1200 and "from 38400" baud; between them 5 s (ours).
    pub const fn reaction_at(baud: u32) -> Span {
        match baud {
            0..=300 => Span::from_secs(10),
            301..=600 => Span::from_secs(7),
            601..=19_200 => Span::from_secs(5),
            _ => Span::from_secs(3),
        }
    }
}
