//! Common parts of the sieges: their length, and mutation of bytes from a seed.
//!
//! `cargo xtask siege` runs tests of `tests/tests/parts/siege.rs`, `tests/tests/process/siege.rs`,
//! `tests/tests/process/load_siege.rs`, `tests/tests/process/s7_siege.rs`, `tests/tests/process/s7_alarms.rs`,
//! `tests/tests/process/gate_siege.rs`,
//! `tests/tests/process/gate_load.rs`, `tests/tests/process/strangers.rs`, `tests/tests/process/browser.rs`,
//! `tests/tests/process/remote_io.rs`, `tests/tests/process/profibus.rs`, `tests/tests/simulation/cp343.rs` and
//! `runtime/station/tests/process_retentive.rs` with many rounds, or for minutes; the test suite runs them for a short
//! time.

use std::time::{Duration, Instant};

use ob1_line::sim::SplitMix64;

use crate::part::Part;

/// Rounds of a siege: those given to the verb, or these.
///
/// # Panics
/// If the environment variable is not a number.
#[must_use]
pub fn rounds(in_the_suite: u64) -> u64 {
    match std::env::var("OB1_SIEGE_ROUNDS") {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("OB1_SIEGE_ROUNDS={text} is not a number")),
        Err(_) => in_the_suite,
    }
}

/// The draws of a siege: those of this number, and others in each part of a campaign (`--part`).
#[must_use]
pub fn random(number: u64) -> SplitMix64 {
    SplitMix64::new(number ^ first() << 8)
}

/// Before the first seed of a siege that counts them: 0, and another far away in each part of a campaign.
///
/// # Panics
/// If the environment variable is no part.
#[must_use]
pub fn first() -> u64 {
    let part = std::env::var("OB1_PART").map_or(Part::WHOLE, |text| text.parse().unwrap_or_else(|why| panic!("{why}")));
    (part.number - 1) << 32
}

/// Whether this is a campaign: alone on its machine, so that times can be checked. The test suite runs in parallel with
/// other tests.
#[must_use]
pub fn is_campaign() -> bool {
    std::env::var_os("OB1_SIEGE_ROUNDS").is_some()
}

/// The length of a siege that is measured in minutes, or in rounds in the test suite.
#[derive(Debug)]
pub struct Span {
    rounds: u64,
    minutes: Option<(Instant, Duration)>,
}

impl Span {
    /// The minutes given to the verb (`--minutes`), or these rounds.
    ///
    /// # Panics
    /// If the environment variable is not a number.
    #[must_use]
    pub fn of(in_the_suite: u64) -> Self {
        let minutes = std::env::var("OB1_SIEGE_MINUTES").ok().map(|text| {
            let minutes: f64 = text.parse().unwrap_or_else(|_| panic!("OB1_SIEGE_MINUTES={text} is not a number"));
            (Instant::now(), Duration::from_secs_f64(60.0 * minutes))
        });
        Self { rounds: in_the_suite, minutes }
    }

    /// Whether this is a campaign, whose figures are checked, and not part of the test suite.
    #[must_use]
    pub const fn is_campaign(&self) -> bool {
        self.minutes.is_some()
    }

    /// Whether another round starts after `done` rounds.
    #[must_use]
    pub fn goes_on(&self, done: u64) -> bool {
        match self.minutes {
            Some((begin, time)) => begin.elapsed() < time,
            None => done < self.rounds,
        }
    }

    /// The finished share, 0 to 1.
    #[must_use]
    pub fn share(&self, done: u64) -> f64 {
        match self.minutes {
            Some((begin, time)) => (begin.elapsed().as_secs_f64() / time.as_secs_f64()).min(1.0),
            None => done as f64 / self.rounds as f64,
        }
    }
}

/// Maximum length of a mutated input.
const LONGEST: usize = 64 * 1024;

/// One to four changes: a bit, a byte, a number in the text, a line removed, doubled or moved, a piece of another
/// input, a truncated end.
#[must_use]
pub fn mutate(random: &mut SplitMix64, input: &[u8], other: &[u8]) -> Vec<u8> {
    let mut bytes = input.to_vec();
    for _ in 0..=random.below(3) {
        change(random, &mut bytes, other);
    }
    bytes.truncate(LONGEST);
    bytes
}

fn change(random: &mut SplitMix64, bytes: &mut Vec<u8>, other: &[u8]) {
    let at = random.below(bytes.len() as u64 + 1) as usize;
    match random.below(9) {
        0 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << random.below(8);
            }
        }
        1 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte = random.next_u64() as u8;
            }
        }
        2 => bytes.truncate(at),
        3 => {
            let line = line_at(bytes, at);
            bytes.drain(line);
        }
        4 => {
            let line = bytes[line_at(bytes, at)].to_vec();
            bytes.splice(at..at, line);
        }
        5 => {
            let from = line_at(bytes, at);
            let line: Vec<u8> = bytes.drain(from).collect();
            let to = random.below(bytes.len() as u64 + 1) as usize;
            let to = line_at(bytes, to).start;
            bytes.splice(to..to, line);
        }
        6 => {
            let from = random.below(other.len() as u64 + 1) as usize;
            let len = random.below(200) as usize;
            let piece = &other[from..other.len().min(from + len)];
            bytes.splice(at..at, piece.iter().copied());
        }
        7 => {
            // Replaces the number here by one at a limit.
            let digits = bytes[at..].iter().take_while(|byte| byte.is_ascii_digit()).count();
            let numbers: [&[u8]; 7] = [b"0", b"-1", b"65535", b"65536", b"2147483648", b"99999999999999999999", b""];
            let number = numbers[random.below(numbers.len() as u64) as usize];
            bytes.splice(at..at + digits, number.iter().copied());
        }
        _ => {
            let byte = b"\"'{}[]();:,.#%\0\xFF\n"[random.below(17) as usize];
            bytes.insert(at, byte);
        }
    }
}

/// The line at a position, including its end.
fn line_at(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let start = bytes[..at].iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let end = bytes[at..].iter().position(|byte| *byte == b'\n').map_or(bytes.len(), |end| at + end + 1);
    start..end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_follow_from_the_seed_and_stay_in_bounds() {
        let (input, other) = (b"U M 1.0\nL 17\nT MW 20\n", b"name = \"x\"\n");
        let all = |seed| {
            let mut random = SplitMix64::new(seed);
            (0..2000).map(|_| mutate(&mut random, input, other)).collect::<Vec<_>>()
        };
        assert_eq!(all(1), all(1));
        let changed = all(1).iter().filter(|bytes| bytes.as_slice() != input).count();
        assert!(changed > 1800, "{changed}");
        assert!(all(2).iter().any(|bytes| bytes.is_empty() || bytes.len() < input.len()));
        let mut random = SplitMix64::new(3);
        let long = vec![b'x'; LONGEST];
        assert!((0..200).all(|_| mutate(&mut random, &long, &long).len() <= LONGEST));
        assert!((0..200).all(|_| mutate(&mut random, b"", b"").len() <= LONGEST));
    }

    #[test]
    fn lines() {
        let text = b"one\ntwo\n";
        assert_eq!((line_at(text, 1), line_at(text, 4), line_at(text, 8)), (0..4, 4..8, 8..8));
    }
}
