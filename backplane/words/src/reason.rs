//! Why a CP does nothing, or fails: the content of `cp.reason` in its segment (docs/backplane.md).

use crate::codes;

codes! {
    /// What a CP waits for, or what has failed.
    Why {
        /// A start-up identifier is shown and not acknowledged: FC 9 is awaited. Number: the word `RX` shows.
        StartUp = 1,
        /// The receiving line is interrupted (BREAK).
        Interrupted = 2,
        /// The partner has stopped the running order with XOFF.
        Stopped = 3,
        /// CTS or DSR is OFF, and nothing is sent until it is ON. Number: bit 0 CTS, bit 1 DSR.
        Signals = 4,
        /// Orders end with an error. Number: the end of the last one; count: how many ended so, one after the other.
        OrderFailed = 5,
        /// The receive buffer is full. Count: telegrams rejected since it was empty.
        Full = 6,
        /// What was received waits for its handling block. Number: that of the block at a CP 240, otherwise 0; count:
        /// telegrams waiting.
        NotFetched = 7,
        /// What the partner sends cannot be read. Number: the event of the last attempt (classes 5, 6, 8), 0: none;
        /// count: attempts since the last good telegram.
        ReceiveError = 8,
        /// The line gives back what is sent in half duplex, so that answers are hard to tell from it.
        Echoes = 9,
    }
}

/// The reason, as it is now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reason {
    /// What kind of reason; it gives the two numbers their meaning.
    pub why: Why,
    /// What it is about; see [`Why`].
    pub number: u16,
    /// How often; see [`Why`]. The segment holds 0 to [`Reason::COUNT_MAX`].
    pub count: u32,
}

impl Reason {
    /// The largest count a segment holds: so often, or more often.
    pub const COUNT_MAX: u32 = 0xFFF;

    /// A state: something that does not count.
    pub const fn state(why: Why, number: u16) -> Self {
        Self { why, number, count: 0 }
    }
}
