//! ASCII on a bad line, see [`pair`]. Its only checks are parity, frame and silence: an accepted telegram is everything
//! between two silences, with every character readable.

use ob1_fakes::sim_line::{End, SimConfig};
use ob1_line::sim::SplitMix64;
use ob1_protocols::ascii::{Ascii, Config, Criterion, Flow, XOFF, XON};
use ob1_protocols::{Instant, MS, SECOND, Span};

use crate::defaults;
use crate::pair;
use crate::pair::{Duet, Judge, Stage};

struct Pair<const FRAGMENTED: bool>;

struct Silences {
    fragmented: bool,
    /// XON and XOFF do not belong to a telegram.
    flow: bool,
    zvz: Span,
    last: Instant,
    /// Characters since the last silence.
    burst: Vec<Option<u8>>,
    /// Number of them already delivered (ASCII-fragmented).
    taken: usize,
}

impl Judge for Silences {
    fn character(&mut self, now: Instant, character: Option<u8>) {
        if self.flow && matches!(character, Some(XON | XOFF)) {
            return;
        }
        if now > self.last + self.zvz {
            self.burst.clear();
            self.taken = 0;
        }
        self.last = now;
        self.burst.push(character);
    }

    /// [S0 "Communication via back plane bus"]: complete with the expiration of the ZVZ.
    fn accepts(&mut self, now: Instant, telegram: &[u8]) -> bool {
        let silent = now >= self.last + self.zvz;
        let rest = &self.burst[self.taken..];
        let readable: Option<Vec<u8>> = rest.iter().copied().collect();
        let whole = readable.as_deref() == Some(telegram);
        self.taken += telegram.len();
        if !self.fragmented {
            return whole && silent && self.taken == telegram.len();
        }
        // [S0 "Communication with ASCII-fragmented"]: blocks of 12 at once, the last when the line falls silent.
        whole && (telegram.len() == 12 || telegram.len() < 12 && silent)
    }
}

impl<const FRAGMENTED: bool> Duet for Pair<FRAGMENTED> {
    const TEST: &'static str = if FRAGMENTED { "faults_ascii::fragmented" } else { "faults_ascii::whole" };
    type Machine = Ascii;
    type Judge = Silences;
    const ACKNOWLEDGED: bool = false;
    const GRACE: Span = Span::SECOND;

    fn stage(rng: &mut SplitMix64) -> Stage<Ascii, Silences> {
        let sim = SimConfig::new([1200, 9600, 115_200][rng.below(3) as usize], 20);
        let zvz = [Span::ZERO, 20 * MS, 60 * MS][rng.below(3) as usize];
        let config = Config {
            criterion: if FRAGMENTED { Criterion::Fragments } else { Criterion::Silence },
            flow: [Flow::None, Flow::Hardware, Flow::XonXoff][rng.below(3) as usize],
            zvz,
            // [S0 "ASCII"]: the sender keeps the silence between two telegrams.
            zna: zvz.max(2 * sim.char_time) + 20 * MS,
            flow_wait: 2 * SECOND,
            ..defaults::ascii(sim.char_time)
        };
        let judge = || Silences {
            fragmented: FRAGMENTED,
            flow: config.flow == Flow::XonXoff,
            zvz: if zvz == Span::ZERO { 2 * sim.char_time } else { zvz },
            last: Instant::START,
            burst: Vec::new(),
            taken: 0,
        };
        let partners = [(Ascii::new(&config), judge()), (Ascii::new(&config), judge())];
        Stage { sim, partners, pause: 30 * MS, slow_one_in: 10 }
    }

    fn telegram(rng: &mut SplitMix64, _end: End) -> Option<Vec<u8>> {
        // Each telegram is one fragment, so that it can be found again.
        let len = 1 + if FRAGMENTED { rng.below(12) } else { rng.below(100) };
        Some((0..len).map(|_| 0x20 + rng.below(0xE0) as u8).collect())
    }
}

#[test]
fn whole() {
    pair::check::<Pair<false>>();
}

#[test]
fn fragmented() {
    pair::check::<Pair<true>>();
}

#[test]
fn a_clean_line_loses_nothing() {
    pair::check_clean::<Pair<false>>();
    pair::check_clean::<Pair<true>>();
}
