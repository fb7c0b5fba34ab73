//! 3964 and 3964R on a bad line, see [`pair`].

use ob1_fakes::sim_line::{End, SimConfig};
use ob1_line::sim::SplitMix64;
use ob1_protocols::s3964::{Config, Priority, S3964};
use ob1_protocols::{Instant, MS, Span};

use crate::defaults;
use crate::pair;
use crate::pair::{Duet, Judge, Stage, Sum};
use crate::s3964_frame::{Incoming, checked};

struct Pair<const BCC: bool>;

/// The last block that was acknowledged, from the characters between two of our DLE.
struct Blocks<const BCC: bool> {
    incoming: Incoming,
    /// The block acknowledged by our last DLE.
    block: Vec<Option<u8>>,
}

impl<const BCC: bool> Judge for Blocks<BCC> {
    fn character(&mut self, _now: Instant, character: Option<u8>) {
        self.incoming.push(character);
    }

    fn transmitted(&mut self, _now: Instant, bytes: &[u8]) {
        if let Some(block) = self.incoming.transmitted(bytes) {
            self.block = block;
        }
    }

    fn out(&mut self) {
        self.incoming.out();
    }

    fn accepts(&mut self, _now: Instant, telegram: &[u8]) -> bool {
        checked(&self.block, BCC).as_deref() == Some(telegram)
    }
}

impl<const BCC: bool> Duet for Pair<BCC> {
    const TEST: &'static str = if BCC { "faults_s3964::with_bcc" } else { "faults_s3964::without_bcc" };
    type Machine = S3964;
    type Judge = Blocks<BCC>;
    const ACKNOWLEDGED: bool = true;
    const GRACE: Span = Span::ZERO;

    fn stage(rng: &mut SplitMix64) -> Stage<S3964, Blocks<BCC>> {
        let sim = SimConfig::new([9600, 19_200, 115_200][rng.below(3) as usize], 22);
        let low = defaults::cp240(BCC, sim.char_time);
        let high = match rng.below(3) {
            0 => defaults::cp341(BCC, sim.char_time),
            _ => Config { priority: Priority::High, ..low.clone() },
        };
        let partners =
            [high, low].map(|c| (S3964::new(c), Blocks { incoming: Incoming::default(), block: Vec::new() }));
        Stage { sim, partners, pause: 30 * MS, slow_one_in: 10 }
    }

    fn telegram(rng: &mut SplitMix64, _end: End) -> Option<Vec<u8>> {
        let len = 1 + rng.below(250);
        let special = rng.below(3) == 0;
        let byte = |rng: &mut SplitMix64| match rng.below(4) {
            0 if special => [0x02, 0x03, 0x10, 0x15][rng.below(4) as usize],
            _ => rng.next_u64() as u8,
        };
        Some((0..len).map(|_| byte(rng)).collect())
    }

    fn verdict(sum: &Sum) {
        assert!(sum.failed > 0, "the faults do not hurt");
        if BCC {
            assert!(sum.damaged * 100 < sum.done, "{sum:?}: more than the check character lets through");
        }
    }
}

#[test]
fn with_bcc() {
    pair::check::<Pair<true>>();
}

#[test]
fn without_bcc() {
    pair::check::<Pair<false>>();
}

#[test]
fn a_clean_line_loses_nothing() {
    pair::check_clean::<Pair<true>>();
    pair::check_clean::<Pair<false>>();
}
