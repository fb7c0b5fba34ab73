//! An M-Bus master and a meter on a bad line, see [`pair`].

use ob1_fakes::sim_line::{End, SimConfig};
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_protocols::mbus::{Config, MBus};
use ob1_protocols::{Input, Instant, LineInput, MS, Machine, Sink, Span};

use crate::pair;
use crate::pair::{Duet, Judge, Stage};

const ADDRESS: u8 = 5;
/// Code of 9600 baud, which all telegrams name.
const BAUD: u8 = 0xBD;

/// The fields of the frame in these characters, written from the manual's table, not with the codec under test. [S0
/// "Overview of M-Bus telegrams"]
fn frame(raw: &[Option<u8>]) -> Option<Vec<u8>> {
    let bytes: Vec<u8> = raw.iter().copied().collect::<Option<_>>()?;
    match *bytes {
        [0xE5] => Some(vec![0xE5]),
        [0x10, c, a, sum, 0x16] if sum == c.wrapping_add(a) => Some(vec![c, a]),
        [0x68, l, again, 0x68, ref fields @ .., sum, 0x16]
            if l == again && fields.len() == usize::from(l) && l >= 3 && sum == total(fields) =>
        {
            Some(fields.to_vec())
        }
        _ => None,
    }
}

fn total(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// A meter, or the master. The meter reports received telegrams to the harness as delivered.
enum Partner {
    Master(Box<MBus>),
    Meter { raw: Vec<Option<u8>>, last: Instant, answer: Option<(Instant, Vec<u8>)>, count: u8 },
}

/// A frame has no pauses; after a pause another frame begins.
const PAUSE: Span = Span::from_millis(8);
/// Maximum of characters that come together.
const BURST: usize = 64;
/// Time a meter takes to answer.
const THINKS: Span = Span::from_millis(3);

impl Machine for Partner {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        let (raw, last, answer, count) = match self {
            Self::Master(master) => return master.step(now, input, out),
            Self::Meter { raw, last, answer, count } => (raw, last, answer, count),
        };
        if let Some((_, bytes)) = answer.take_if(|(at, _)| *at <= now) {
            // Two wires: a sender has received nothing.
            raw.clear();
            out.transmit(&bytes);
        }
        let characters: Vec<Option<u8>> = match input {
            Input::Line(LineInput::Rx(bytes)) => bytes.iter().map(|byte| Some(*byte)).collect(),
            Input::Line(LineInput::Fault(_)) => vec![None],
            _ => Vec::new(),
        };
        if !characters.is_empty() && now > *last + PAUSE {
            raw.clear();
        }
        for character in characters {
            *last = now;
            raw.push(character);
            let for_me = |fields: &[u8]| fields == [0xE5] || matches!(fields, [c, ADDRESS | 255, ..] if c & 0x40 != 0);
            let Some(fields) = frame(raw).filter(|fields| for_me(fields)) else { continue };
            raw.clear();
            let telegram = [&[BAUD][..], &fields].concat();
            if out.room() >= telegram.len() {
                out.deliver(&telegram);
            }
            if fields.get(1) != Some(&ADDRESS) {
                continue;
            }
            let bytes = if fields[0] & 0x0F == 0x0B {
                *count = count.wrapping_add(1);
                let body: Vec<u8> = [0x08, ADDRESS, 0x72].into_iter().chain((0..*count).map(|n| n ^ *count)).collect();
                let l = body.len() as u8;
                [&[0x68, l, l, 0x68][..], &body, &[total(&body), 0x16]].concat()
            } else {
                vec![0xE5]
            };
            *answer = Some((now + THINKS, bytes));
        }
        answer.as_ref().map(|(at, _)| *at)
    }

    fn busy(&self) -> bool {
        matches!(self, Self::Master(master) if master.busy())
    }
}

/// Characters received since the partner last sent.
struct Heard {
    raw: Vec<Option<u8>>,
    broken: bool,
}

impl Judge for Heard {
    fn character(&mut self, _now: Instant, character: Option<u8>) {
        self.raw.push(character);
        self.broken |= character.is_none();
    }

    fn transmitted(&mut self, _now: Instant, _bytes: &[u8]) {
        self.raw.clear();
    }

    fn accepts(&mut self, _now: Instant, telegram: &[u8]) -> bool {
        match *telegram {
            // No answer; a reported short circuit must have been a fault.
            [0x01] => true,
            [0x03] => self.broken,
            // The meter takes a frame as soon as it is whole: a burst may contain more after it. For the master that is
            // a collision.
            [head @ (0x00 | BAUD), ref fields @ ..] => (0..if head == BAUD { BURST } else { 1 }).any(|behind| {
                let raw = &self.raw[..self.raw.len().saturating_sub(behind)];
                (0..raw.len()).any(|from| frame(&raw[from..]).is_some_and(|heard| heard == fields))
            }),
            _ => false,
        }
    }
}

struct Pair;

impl Duet for Pair {
    const TEST: &'static str = "faults_mbus::reading";
    type Machine = Partner;
    type Judge = Heard;
    // An unanswered order is also done: its response says so.
    const ACKNOWLEDGED: bool = false;
    const GRACE: Span = Span::from_millis(50);

    fn stage(rng: &mut SplitMix64) -> Stage<Partner, Heard> {
        let mut sim = SimConfig::new(9600, 22);
        let mut config = Config::cp240();
        if rng.below(3) == 0 {
            sim.coalesce = 4 * MS;
            config = config.with_bursts(sim.coalesce);
        }
        let meter = Partner::Meter { raw: Vec::new(), last: Instant::START, answer: None, count: 0 };
        let partners = [Partner::Master(Box::new(MBus::new(config))), meter];
        let partners = partners.map(|machine| (machine, Heard { raw: Vec::new(), broken: false }));
        Stage { sim, partners, pause: 30 * MS, slow_one_in: 20 }
    }

    fn telegram(rng: &mut SplitMix64, end: End) -> Option<Vec<u8>> {
        if end == End::B {
            return None;
        }
        let mut telegram = vec![BAUD];
        match rng.below(8) {
            0 => telegram.extend([0x40, ADDRESS]),
            1 => telegram.extend([0x40, 255]),
            2 => telegram.push(0xE5),
            3 => telegram.extend([0x53, ADDRESS, 0xBD]),
            4 => {
                telegram.extend([0x73, ADDRESS, 0x51]);
                telegram.extend((0..=rng.below(251)).map(|_| rng.next_u64() as u8));
            }
            n => telegram.extend([if n & 1 == 0 { 0x5B } else { 0x7B }, ADDRESS]),
        }
        Some(telegram)
    }

    fn worst() -> FaultRates {
        FaultRates {
            flip: 2000,
            lose: 1500,
            double: 1500,
            delay: 1000,
            parity: 1000,
            framing: 1000,
            break_: 500,
            delay_max: 60 * MS,
        }
    }
}

#[test]
fn reading() {
    pair::check::<Pair>();
}

#[test]
fn a_clean_line_loses_nothing() {
    pair::check_clean::<Pair>();
}

/// The judge works: it accepts the manual's answer, and rejects that answer with one bit wrong.
#[test]
fn the_judge_knows_a_frame() {
    let mut raw: Vec<Option<u8>> =
        [0x41, 0x68, 6, 6, 0x68, 8, 2, 0x72, 1, 2, 3, 0x82, 0x16].into_iter().map(Some).collect();
    assert_eq!(frame(&raw[1..]), Some(vec![8, 2, 0x72, 1, 2, 3]));
    raw[8] = Some(0);
    assert_eq!(frame(&raw[1..]), None);
    raw[8] = None;
    assert_eq!(frame(&raw[1..]), None);
}
