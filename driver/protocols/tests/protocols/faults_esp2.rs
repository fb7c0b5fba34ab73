//! EnOcean's serial protocol on a bad line, see [`pair`]. An accepted telegram came from the line as A5 5A, its bytes
//! and their sum in sequence, with every character readable and none later than the gap.
//!
//! Two CPs are connected to each other: each asks the other for its ID base and gets no answer, so telegrams are sent
//! unchanged.

use ob1_fakes::sim_line::{End, SimConfig};
use ob1_line::sim::SplitMix64;
use ob1_protocols::esp2::{Config, Esp2, FRAME_BYTES};
use ob1_protocols::{Instant, MS, Span};

use crate::pair;
use crate::pair::{Duet, Judge, Stage};

struct Pair;

/// The last characters that came in, with their times.
struct Frames {
    gap: Span,
    raw: Vec<(Instant, Option<u8>)>,
}

impl Judge for Frames {
    fn character(&mut self, now: Instant, character: Option<u8>) {
        self.raw.push((now, character));
    }

    fn accepts(&mut self, _now: Instant, telegram: &[u8]) -> bool {
        let Some(begin) = self.raw.len().checked_sub(FRAME_BYTES) else { return false };
        let own = self.raw.split_off(begin);
        self.raw.clear();
        let sum = telegram.iter().map(|byte| u32::from(*byte)).sum::<u32>() as u8;
        let wanted = [&[0xA5, 0x5A], telegram, &[sum]].concat();
        let readable = own.iter().map(|(_, c)| *c).eq(wanted.iter().map(|c| Some(*c)));
        let in_time = own.windows(2).all(|pair| pair[1].0 <= pair[0].0 + self.gap);
        readable && in_time && telegram.len() == 11 && telegram[0] & 0x1F == 11
    }
}

impl Duet for Pair {
    const TEST: &'static str = "faults_esp2::frames_with_a_check_sum";
    type Machine = Esp2;
    type Judge = Frames;
    const ACKNOWLEDGED: bool = false;
    const GRACE: Span = Span::from_millis(1_500);

    fn stage(rng: &mut SplitMix64) -> Stage<Esp2, Frames> {
        let sim = SimConfig::new(9600, 10);
        let gap = [50 * MS, 250 * MS][rng.below(2) as usize];
        let config = Config { gap, ..Config::cp240() };
        let partner = || (Esp2::new(config.clone()), Frames { gap, raw: Vec::new() });
        Stage { sim, partners: [partner(), partner()], pause: 60 * MS, slow_one_in: 10 }
    }

    fn telegram(rng: &mut SplitMix64, _end: End) -> Option<Vec<u8>> {
        let mut telegram = vec![0x0B, 5 + rng.below(4) as u8];
        telegram.extend((0..9).map(|_| [0xA5, 0x5A, 0x0B, rng.below(256) as u8][rng.below(4) as usize]));
        Some(telegram)
    }
}

#[test]
fn frames_with_a_check_sum() {
    pair::check::<Pair>();
}

#[test]
fn a_clean_line_loses_nothing() {
    pair::check_clean::<Pair>();
}
