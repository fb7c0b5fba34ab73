//! Faults of the line, and their rates.

use super::rng::SplitMix64;
use crate::line::{LineFault, Span};

/// Rates of faults, each in characters per million. A character has at most one of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    pub fn all(rate: u32) -> Self {
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

    /// What happens to the next character.
    pub(super) fn draw(&self, rng: &mut SplitMix64) -> Fate {
        if *self == Self::NONE {
            return Fate::Whole;
        }
        let draw = rng.next_u64();
        let mut dice = ((u128::from(draw) * 1_000_000) >> 64) as u32;
        let mut hit = |rate: u32| {
            let hit = dice < rate;
            dice = dice.wrapping_sub(rate);
            hit
        };
        if hit(self.flip) {
            Fate::Flip(1 << (draw & 7))
        } else if hit(self.lose) {
            Fate::Lost
        } else if hit(self.double) {
            Fate::Doubled
        } else if hit(self.delay) {
            Fate::Late(rng.span_below(self.delay_max) + Span::from_nanos(1))
        } else if hit(self.parity) {
            Fate::Unreadable(LineFault::Parity)
        } else if hit(self.framing) {
            Fate::Unreadable(LineFault::Framing)
        } else if hit(self.break_) {
            Fate::Unreadable(LineFault::Break)
        } else {
            Fate::Whole
        }
    }
}

/// What happens to a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    Whole,
    Flip(u8),
    Lost,
    Doubled,
    Late(Span),
    Unreadable(LineFault),
}
