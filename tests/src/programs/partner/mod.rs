//! Partners on the line that keep a ledger: what they took, what they sent, and with which manners.

pub mod procedure;
pub mod rk512;
pub mod stream;

use std::collections::VecDeque;

use ob1_time::{Instant, Span};

use crate::compare::random::Random;

/// How often a partner behaves badly, in chances per hundred for each of its reactions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Manners {
    /// It answers late, by up to twice the time that the other side waits.
    pub late: u32,
    /// It does not answer.
    pub silent: u32,
    /// It refuses.
    pub refuses: u32,
    /// It answers with something else.
    pub wrong: u32,
    /// It answers twice.
    pub twice: u32,
}

/// What a partner does this time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manner {
    /// What it should.
    Good,
    /// See [`Manners::late`].
    Late,
    /// See [`Manners::silent`].
    Silent,
    /// See [`Manners::refuses`].
    Refuses,
    /// See [`Manners::wrong`].
    Wrong,
    /// See [`Manners::twice`].
    Twice,
}

impl Manners {
    /// A partner without faults.
    pub const GOOD: Self = Self { late: 0, silent: 0, refuses: 0, wrong: 0, twice: 0 };
    /// A partner that is not there.
    pub const ABSENT: Self = Self { late: 0, silent: 100, refuses: 0, wrong: 0, twice: 0 };

    /// Draws those of a case: half of all partners are good.
    pub fn draw(random: &mut Random) -> Self {
        if random.once_in(2) {
            return Self::GOOD;
        }
        if random.once_in(12) {
            return Self::ABSENT;
        }
        let mut chance = || if random.once_in(2) { random.below(15) as u32 } else { 0 };
        Self { late: chance(), silent: chance(), refuses: chance(), wrong: chance(), twice: chance() }
    }

    /// Draws one reaction.
    pub fn next(&self, random: &mut Random) -> Manner {
        let mut at = random.below(100) as u32;
        for (chance, manner) in [
            (self.late, Manner::Late),
            (self.silent, Manner::Silent),
            (self.refuses, Manner::Refuses),
            (self.wrong, Manner::Wrong),
            (self.twice, Manner::Twice),
        ] {
            if at < chance {
                return manner;
            }
            at -= chance;
        }
        Manner::Good
    }
}

/// A telegram that a partner has taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taken {
    /// When its end came.
    pub at: Instant,
    /// Its bytes.
    pub data: Vec<u8>,
    /// It was acknowledged once and in time.
    pub told: bool,
}

/// A telegram that a partner has sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sent {
    /// Its bytes.
    pub data: Vec<u8>,
    /// When its first attempt began; NEVER: not yet.
    pub begun: Instant,
    /// When the other side has acknowledged it; without a procedure: when its last character was out.
    pub acknowledged: Option<Instant>,
    /// How often it was put on the line as a whole.
    pub attempts: u32,
}

/// Characters that a partner will send at their times.
#[derive(Clone, Debug, Default)]
pub struct Output(VecDeque<(Instant, Vec<u8>)>);

impl Output {
    /// Sends later.
    pub fn push(&mut self, at: Instant, bytes: Vec<u8>) {
        let place = self.0.partition_point(|(due, _)| *due <= at);
        self.0.insert(place, (at, bytes));
    }

    /// What has these bytes is not sent.
    pub fn drop_all(&mut self, bytes: &[u8]) {
        self.0.retain(|(_, waits)| waits != bytes);
    }

    /// Sends what is due.
    pub fn due(&mut self, now: Instant, out: &mut Vec<u8>) {
        while self.0.front().is_some_and(|(at, _)| *at <= now) {
            out.extend(self.0.pop_front().map(|(_, bytes)| bytes).unwrap_or_default());
        }
    }

    /// Next time at which something is due.
    #[must_use]
    pub fn next(&self) -> Option<Instant> {
        self.0.front().map(|(at, _)| *at)
    }
}

/// A number as four letters that no protocol takes for a control character.
#[must_use]
pub fn letters(number: u32) -> [u8; 4] {
    std::array::from_fn(|at| b'A' + (number >> (12 - 4 * at) & 0xF) as u8)
}

/// And back.
#[must_use]
pub fn number(bytes: &[u8]) -> Option<u32> {
    let letters = bytes.get(..4)?;
    letters.iter().try_fold(0, |n, byte| byte.checked_sub(b'A').filter(|d| *d < 16).map(|d| n << 4 | u32::from(d)))
}

/// The byte at `at` of every telegram behind its number: the same for both sides. `plain`: no control characters.
#[must_use]
pub fn pattern(at: usize, plain: bool) -> u8 {
    let byte = (at * 7 + at / 16 + 1) as u8;
    if plain { b'a' + byte % 26 } else { byte & 0x1F }
}

/// A telegram of `len` bytes with this number.
#[must_use]
pub fn telegram(number: u32, len: usize, plain: bool) -> Vec<u8> {
    let mut bytes: Vec<u8> = (0..len).map(|at| pattern(at, plain)).collect();
    for (byte, letter) in bytes.iter_mut().zip(letters(number)) {
        *byte = letter;
    }
    bytes
}

/// A partner's idea of time on the line.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// A character.
    pub char: Span,
    /// How long each side waits for an acknowledgement.
    pub qvz: Span,
    /// Longest pause within a telegram.
    pub zvz: Span,
}
