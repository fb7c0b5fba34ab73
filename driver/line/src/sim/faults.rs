//! What happens to a character on the line.

use super::rng::SplitMix64;
use crate::line::{LineFault, Span};
use ob1_serial::FaultRates;

impl Fate {
    /// What happens to the next character.
    pub fn of(rates: &FaultRates, rng: &mut SplitMix64) -> Self {
        if *rates == FaultRates::NONE {
            return Fate::Whole;
        }
        let draw = rng.next_u64();
        let mut dice = ((u128::from(draw) * 1_000_000) >> 64) as u32;
        let mut hit = |rate: u32| {
            let hit = dice < rate;
            dice = dice.wrapping_sub(rate);
            hit
        };
        if hit(rates.flip) {
            Fate::Flip(1 << (draw & 7))
        } else if hit(rates.lose) {
            Fate::Lost
        } else if hit(rates.double) {
            Fate::Doubled
        } else if hit(rates.delay) {
            Fate::Late(rng.span_below(rates.delay_max) + Span::from_nanos(1))
        } else if hit(rates.parity) {
            Fate::Unreadable(LineFault::Parity)
        } else if hit(rates.framing) {
            Fate::Unreadable(LineFault::Framing)
        } else if hit(rates.break_) {
            Fate::Unreadable(LineFault::Break)
        } else {
            Fate::Whole
        }
    }
}

/// What happens to a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It arrives as it was sent.
    Whole,
    /// Some of its bits arrive inverted: those of this mask.
    Flip(u8),
    /// It does not arrive.
    Lost,
    /// It arrives twice.
    Doubled,
    /// It arrives so much later.
    Late(Span),
    /// Something arrives that cannot be read.
    Unreadable(LineFault),
}
