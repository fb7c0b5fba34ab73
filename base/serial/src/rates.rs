//! How often a simulated line spoils a character.

use ob1_time::Span;

/// Rates of faults, each in characters per million. A character has at most one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultRates {
    /// One bit of the character is inverted, unnoticed.
    pub flip: u32,
    /// The character is lost.
    pub lose: u32,
    /// The character comes twice.
    pub double: u32,
    /// The character, and those after it, come late by up to [`Self::delay_max`].
    pub delay: u32,
    /// The character comes as a parity error.
    pub parity: u32,
    /// The character comes as a framing error.
    pub framing: u32,
    /// The character comes as a break.
    pub break_: u32,
    /// Longest delay of a character that comes late.
    pub delay_max: Span,
}

impl FaultRates {
    /// No faults: every rate is 0.
    pub const NONE: Self =
        Self { flip: 0, lose: 0, double: 0, delay: 0, parity: 0, framing: 0, break_: 0, delay_max: Span::ZERO };

    /// All faults at the same rate, in characters per million; delays up to 300 ms.
    pub const fn all(rate: u32) -> Self {
        Self {
            flip: rate,
            lose: rate,
            double: rate,
            delay: rate,
            parity: rate,
            framing: rate,
            break_: rate,
            delay_max: Span::from_nanos(300_000_000),
        }
    }
}
