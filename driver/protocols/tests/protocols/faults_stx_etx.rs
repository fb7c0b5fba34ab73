//! STX/ETX on a bad line, see [`pair`]. An accepted telegram was between start and end characters, with every character
//! readable and none later than TMO, and contains no start or end.

use ob1_fakes::sim_line::{End, SimConfig};
use ob1_line::sim::SplitMix64;
use ob1_protocols::ascii::{Flow, XOFF, XON};
use ob1_protocols::stx_etx::{Config, Flags, StxEtx};
use ob1_protocols::{Instant, MS, SECOND, Span};

use crate::defaults;
use crate::pair;
use crate::pair::{Duet, Judge, Stage};

struct Pair;

struct Brackets {
    start: Vec<u8>,
    end: Vec<u8>,
    flow: bool,
    tmo: Span,
    /// Received characters that belong to no accepted telegram yet, with their times.
    raw: Vec<(Instant, Option<u8>)>,
}

impl Judge for Brackets {
    fn character(&mut self, now: Instant, character: Option<u8>) {
        if !(self.flow && matches!(character, Some(XON | XOFF))) {
            self.raw.push((now, character));
        }
    }

    fn accepts(&mut self, now: Instant, telegram: &[u8]) -> bool {
        let wanted = [self.start.as_slice(), telegram, self.end.as_slice()].concat();
        let raw = std::mem::take(&mut self.raw);
        let Some(begin) = raw.len().checked_sub(wanted.len()) else { return false };
        let (before, own) = raw.split_at(begin);
        let readable = own.iter().map(|(_, c)| *c).eq(wanted.iter().map(|c| Some(*c)));
        let in_time = own.windows(2).all(|pair| pair[1].0 <= pair[0].0 + self.tmo);
        let overlooked = |flags: &[u8]| !flags.is_empty() && telegram.windows(flags.len()).any(|w| w == flags);
        // Without start characters a telegram begins after an end or a silence.
        let first = own.first().map_or(Instant::START, |(at, _)| *at);
        let free = match before.last() {
            Some((at, _)) if self.start.is_empty() && first <= *at + self.tmo => {
                let tail: Vec<_> = before.iter().rev().take(self.end.len()).rev().map(|(_, c)| *c).collect();
                !self.end.is_empty() && tail.iter().copied().eq(self.end.iter().map(|c| Some(*c)))
            }
            _ => true,
        };
        let ended = !self.end.is_empty() || own.last().is_some_and(|(at, _)| now >= *at + self.tmo);
        readable && in_time && free && ended && !overlooked(&self.start) && !overlooked(&self.end)
    }
}

impl Duet for Pair {
    const TEST: &'static str = "faults_stx_etx::between_brackets";
    type Machine = StxEtx;
    type Judge = Brackets;
    const ACKNOWLEDGED: bool = false;
    const GRACE: Span = Span::SECOND;

    fn stage(rng: &mut SplitMix64) -> Stage<StxEtx, Brackets> {
        let sim = SimConfig::new([1200, 9600, 115_200][rng.below(3) as usize], 20);
        let (start, end) = (Flags::new(*b"\x02{", rng.below(3) as u8), Flags::new(*b"\x03}", rng.below(3) as u8));
        let tmo = [20 * MS, 60 * MS][rng.below(2) as usize];
        let config = Config {
            start,
            end,
            flow: [Flow::None, Flow::Hardware, Flow::XonXoff][rng.below(3) as usize],
            tmo,
            // Without end characters the sender keeps the silence after a telegram.
            zna: if end.as_slice().is_empty() { tmo + 20 * MS } else { Span::ZERO },
            flow_wait: 2 * SECOND,
            ..defaults::stx_etx(sim.char_time)
        };
        let judge = || Brackets {
            start: start.as_slice().to_vec(),
            end: end.as_slice().to_vec(),
            flow: config.flow == Flow::XonXoff,
            tmo,
            raw: Vec::new(),
        };
        let partners = [(StxEtx::new(&config), judge()), (StxEtx::new(&config), judge())];
        Stage { sim, partners, pause: 30 * MS, slow_one_in: 10 }
    }

    /// [S0 "STX/ETX"]: suitable for characters 20h..7Fh. Single second start and end characters are among them.
    fn telegram(rng: &mut SplitMix64, _end: End) -> Option<Vec<u8>> {
        let len = 1 + rng.below(100);
        Some((0..len).map(|_| 0x20 + rng.below(0x60) as u8).collect())
    }
}

#[test]
fn between_brackets() {
    pair::check::<Pair>();
}

#[test]
fn a_clean_line_loses_nothing() {
    pair::check_clean::<Pair>();
}
