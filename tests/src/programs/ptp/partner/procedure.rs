//! A partner with 3964R, written from the description of the procedure and apart from the machines under test.
//! [S0 L1590-L1668] [TIA help "Configuration for point-to-point links"]

use std::collections::VecDeque;

use ob1_line::sim::SplitMix64;
use ob1_time::{Instant, Span};

use super::{Event, Moods};
use crate::programs::ptp::post::CHARACTER;

const STX: u8 = 0x02;
const ETX: u8 = 0x03;
const DLE: u8 = 0x10;
const NAK: u8 = 0x15;
/// Pause before a request is repeated.
const AGAIN: Span = Span::from_millis(40);

/// Its settings.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Longest wait for an answer.
    pub qvz: Span,
    /// Longest silence in a block.
    pub zvz: Span,
    /// It keeps its request when both want to send.
    pub is_high: bool,
    /// Connection attempts and block attempts.
    pub attempts: u32,
}

/// What it does wrong with one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mood {
    Good,
    /// Says nothing to STX.
    Deaf,
    /// NAK to STX.
    Busy,
    /// Answers STX after the partner has given up waiting.
    Slow,
    /// NAK to a good block.
    Refuses,
    /// Takes a block and does not answer.
    Mute,
    /// Takes a block and answers late.
    Late,
    /// A character that is no answer, instead of DLE after the block.
    Wrong,
    /// A NAK in the middle of the block.
    Interrupts,
    /// DLE twice after the block.
    Twice,
}

const BAD: [Mood; 9] = [
    Mood::Deaf,
    Mood::Busy,
    Mood::Slow,
    Mood::Refuses,
    Mood::Mute,
    Mood::Late,
    Mood::Wrong,
    Mood::Interrupts,
    Mood::Twice,
];

#[derive(Debug)]
enum State {
    Idle,
    /// A block comes in.
    In {
        data: Vec<u8>,
        dle: bool,
        end: bool,
        check: u8,
        mood: Mood,
        until: Instant,
    },
    /// STX is out.
    Asked {
        tries: u32,
        until: Instant,
    },
    /// The block is out.
    Out {
        until: Instant,
    },
}

/// What the procedure tells the layer above it.
#[derive(Debug, PartialEq, Eq)]
pub enum Told {
    /// A block was taken; whether its answer went out good and in time.
    Block(Vec<u8>, bool),
    /// The own block goes out.
    Offered(Vec<u8>),
    /// The own block was acknowledged.
    Acknowledged(Vec<u8>),
    /// The own block may have arrived, but the answer did not.
    Unanswered(Vec<u8>),
    /// The own block is not repeated any more.
    GivenUp,
}

/// The partner.
#[derive(Debug)]
pub struct Procedure {
    settings: Settings,
    state: State,
    /// Blocks to send.
    queue: VecDeque<Vec<u8>>,
    blocks: u32,
    /// A character to send later.
    delayed: Option<(Instant, u8)>,
    /// It went out in the middle of a block of the CP, which must then repeat the block. (0706h)
    crossed: bool,
    /// Not before this instant a connection is asked for.
    quiet: Instant,
    rng: SplitMix64,
}

impl Procedure {
    /// A partner at rest.
    #[must_use]
    pub fn new(settings: Settings, seed: u64) -> Self {
        let rng = SplitMix64::new(seed);
        let (state, queue, delayed, crossed) = (State::Idle, VecDeque::new(), None, false);
        Self { settings, state, queue, blocks: 0, delayed, crossed, quiet: Instant::START, rng }
    }

    /// A block to be sent.
    pub fn send(&mut self, block: Vec<u8>) {
        self.queue.push_back(block);
    }

    /// Does not repeat these blocks.
    pub fn forget(&mut self, is_one: impl Fn(&[u8]) -> bool) {
        if self.queue.front().is_some_and(|block| is_one(block)) {
            self.blocks = 0;
        }
        self.queue.retain(|block| !is_one(block));
    }

    /// How many wait to be sent.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.queue.len()
    }

    /// Takes characters, or none at a deadline. Returns the next deadline.
    pub fn hear(
        &mut self,
        now: Instant,
        bytes: &[u8],
        moods: &Moods,
        out: &mut Vec<u8>,
        told: &mut Vec<Told>,
    ) -> Instant {
        for byte in bytes {
            self.character(now, *byte, moods, out, told);
        }
        self.time(now, out, told);
        let own = match &self.state {
            State::Idle if self.queue.is_empty() => Instant::NEVER,
            State::Idle => self.quiet,
            State::In { until, .. } | State::Asked { until, .. } | State::Out { until } => *until,
        };
        own.min(self.delayed.map_or(Instant::NEVER, |(at, _)| at))
    }

    fn character(&mut self, now: Instant, byte: u8, moods: &Moods, out: &mut Vec<u8>, told: &mut Vec<Told>) {
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Idle if byte == STX => self.called(now, moods, out),
            // Nothing is open: a NAK is not answered, anything else is. [S0 L1637-L1660]
            State::Idle if byte == NAK || byte == DLE => {}
            State::Idle => out.push(NAK),
            State::In { data, dle, end, check, mood, .. } => {
                let state = State::In { data, dle, end, check, mood, until: now + self.settings.zvz };
                self.state = state;
                self.data(now, byte, out, told);
            }
            State::Asked { tries, until } => match byte {
                DLE => self.write(now, out, told),
                STX if !self.settings.is_high => {
                    self.quiet = now;
                    self.called(now, moods, out);
                }
                STX => self.state = State::Asked { tries, until },
                // It asks again when the line is quiet: else its next request could lie in the block.
                _ => self.state = State::Asked { tries, until: now + AGAIN },
            },
            State::Out { .. } => match byte {
                DLE => {
                    let block = self.queue.pop_front().unwrap_or_default();
                    self.blocks = 0;
                    told.push(Told::Acknowledged(block));
                }
                _ => self.fails(now, byte == NAK, told),
            },
        }
    }

    /// The CP wants to send. [S0 L1650]
    fn called(&mut self, now: Instant, moods: &Moods, out: &mut Vec<u8>) {
        let mood =
            if moods.is_bad(now, &mut self.rng) { BAD[self.rng.below(BAD.len() as u64) as usize] } else { Mood::Good };
        let opens =
            State::In { data: Vec::new(), dle: false, end: false, check: 0, mood, until: now + self.settings.zvz };
        self.crossed = false;
        match mood {
            Mood::Deaf => {}
            Mood::Busy => out.push(NAK),
            Mood::Slow => {
                let late = self.settings.qvz + self.rng.span_below(self.settings.qvz);
                self.delayed = Some((now + late, DLE));
            }
            _ => {
                out.push(DLE);
                self.state = opens;
            }
        }
    }

    fn data(&mut self, now: Instant, byte: u8, out: &mut Vec<u8>, told: &mut Vec<Told>) {
        let State::In { data, dle, end, check, mood, until } = &mut self.state else { return };
        if *end {
            let (good, mood, block) = (*check == byte, *mood, std::mem::take(data));
            self.state = State::Idle;
            self.finished(now, good, mood, block, out, told);
            return;
        }
        *check ^= byte;
        match (*dle, byte) {
            (false, DLE) => *dle = true,
            (false, _) => data.push(byte),
            (true, DLE) => {
                data.push(DLE);
                *dle = false;
            }
            (true, ETX) => *end = true,
            // Neither DLE nor ETX: the block is spoilt; its end does not come.
            (true, _) => {
                *dle = false;
                *check ^= 0xFF;
            }
        }
        if *mood == Mood::Interrupts && data.len() >= 3 {
            *until = now;
            out.push(NAK);
            self.state = State::Idle;
        }
    }

    fn finished(
        &mut self,
        now: Instant,
        good: bool,
        mood: Mood,
        block: Vec<u8>,
        out: &mut Vec<u8>,
        told: &mut Vec<Told>,
    ) {
        let qvz = self.settings.qvz;
        match (good, mood) {
            (false, _) | (_, Mood::Refuses) => out.push(NAK),
            (_, Mood::Mute) => told.push(Told::Block(block, false)),
            (_, Mood::Late) => {
                self.delayed = Some((now + qvz + self.rng.span_below(qvz), DLE));
                told.push(Told::Block(block, false));
            }
            (_, Mood::Wrong) => {
                out.push(0x55);
                told.push(Told::Block(block, false));
            }
            (_, mood) => {
                out.push(DLE);
                if mood == Mood::Twice {
                    out.push(DLE);
                }
                told.push(Told::Block(block, !self.crossed));
            }
        }
        // Both may want to send next: the CP first, now and then.
        self.quiet = now + self.rng.span_below(Span::from_millis(30));
    }

    fn time(&mut self, now: Instant, out: &mut Vec<u8>, told: &mut Vec<Told>) {
        // Only the check character is still to come: a late DLE would end behind it, and the CP takes a DLE that comes
        // then for the answer to this block [S0 L1633-L1634]. Nobody could know whether the partner has the block. A
        // silence in the block may be its end, too, which the line has spoilt.
        let ends = match self.state {
            State::In { end, until, .. } => end || now + self.settings.zvz > until + 2 * CHARACTER,
            _ => false,
        };
        self.delayed.take_if(|(at, _)| *at <= now && ends);
        if let Some((_, byte)) = self.delayed.take_if(|(at, _)| *at <= now) {
            out.push(byte);
            self.crossed |= matches!(self.state, State::In { .. });
            if byte == DLE && matches!(self.state, State::Idle) {
                let until = now + self.settings.zvz;
                self.state = State::In { data: Vec::new(), dle: false, end: false, check: 0, mood: Mood::Good, until };
            }
        }
        match self.state {
            State::Idle if !self.queue.is_empty() && now >= self.quiet => {
                out.push(STX);
                self.state = State::Asked { tries: 1, until: now + self.settings.qvz };
            }
            State::In { until, .. } if now >= until => {
                out.push(NAK);
                self.state = State::Idle;
            }
            State::Asked { tries, until } if now >= until => self.again(now, tries, out, told),
            State::Out { until } if now >= until => self.fails(now, false, told),
            _ => {}
        }
    }

    fn again(&mut self, now: Instant, tries: u32, out: &mut Vec<u8>, told: &mut Vec<Told>) {
        if tries < self.settings.attempts {
            out.push(STX);
            self.state = State::Asked { tries: tries + 1, until: now + self.settings.qvz };
            return;
        }
        out.push(NAK);
        self.fails(now, true, told);
    }

    /// The block did not arrive (`is_sure`), or nobody knows: it is sent again, at last dropped.
    fn fails(&mut self, now: Instant, is_sure: bool, told: &mut Vec<Told>) {
        self.state = State::Idle;
        self.quiet = now + self.rng.span_below(Span::from_millis(200));
        if !is_sure && let Some(block) = self.queue.front() {
            told.push(Told::Unanswered(block.clone()));
        }
        self.blocks += 1;
        if self.blocks >= self.settings.attempts {
            self.blocks = 0;
            self.queue.pop_front();
            told.push(Told::GivenUp);
        }
    }

    fn write(&mut self, now: Instant, out: &mut Vec<u8>, told: &mut Vec<Told>) {
        let Some(block) = self.queue.front() else { return };
        told.push(Told::Offered(block.clone()));
        let from = out.len();
        for byte in block {
            out.push(*byte);
            if *byte == DLE {
                out.push(DLE);
            }
        }
        out.extend([DLE, ETX]);
        let check = out[from..].iter().fold(0, |check, byte| check ^ byte);
        out.push(check);
        // The characters still have to leave.
        let leaves = Span::from_millis(5) * (out.len() - from) as u64;
        self.state = State::Out { until: now + leaves + self.settings.qvz };
    }
}

/// A partner that only has telegrams: each block is one.
#[derive(Debug)]
pub struct Plain(pub Procedure);

impl Plain {
    /// As [`Procedure::hear`]; what happened goes to `events`.
    pub fn hear(
        &mut self,
        now: Instant,
        bytes: &[u8],
        moods: &Moods,
        out: &mut Vec<u8>,
        events: &mut Vec<Event>,
    ) -> Instant {
        let mut told = Vec::new();
        let next = self.0.hear(now, bytes, moods, out, &mut told);
        events.extend(told.into_iter().filter_map(|told| match told {
            Told::Block(telegram, answered) => Some(Event::Got { at: now, telegram, answered }),
            Told::Offered(telegram) => Some(Event::Said { at: now, telegram, owed: false }),
            Told::Acknowledged(telegram) => Some(Event::Owed { telegram }),
            Told::GivenUp => Some(Event::GivesUp(now)),
            Told::Unanswered(_) => None,
        }));
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: Settings =
        Settings { qvz: Span::from_millis(100), zvz: Span::from_millis(100), is_high: false, attempts: 2 };

    fn at(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    #[test]
    fn a_block_with_the_check_value_of_the_reference_is_taken() {
        // Reference 5.1.
        let mut partner = Procedure::new(SETTINGS, 1);
        let (mut out, mut told) = (Vec::new(), Vec::new());
        partner.hear(at(1), b"\x02", &Moods::GOOD, &mut out, &mut told);
        partner.hear(at(2), b"\x02\x10\x10\x03\x15\x10\x03\x07", &Moods::GOOD, &mut out, &mut told);
        assert_eq!(told, [Told::Block(b"\x02\x10\x03\x15".to_vec(), true)]);
        assert_eq!(out, [DLE, DLE]);
        partner.hear(at(3), b"\x02", &Moods::GOOD, &mut out, &mut told);
        partner.hear(at(4), b"\x31\x10\x03\x23", &Moods::GOOD, &mut out, &mut told);
        assert_eq!((told.len(), out.last()), (1, Some(&NAK)));
    }

    /// Between the last two characters of a block its DLE would be the answer to a block that it has not checked; in a
    /// silence, perhaps that to one whose end it has not seen.
    #[test]
    fn a_late_answer_is_dropped_at_the_end_of_the_next_block() {
        for (place, after, said) in [(2, 5, true), (3, 5, false), (2, 10, true), (2, 11, false)] {
            let mut partner = Procedure::new(SETTINGS, 1);
            let (mut out, mut told) = (Vec::new(), Vec::new());
            partner.hear(at(1), b"\x02", &Moods::GOOD, &mut out, &mut told);
            partner.delayed = Some((at(after), DLE));
            out.clear();
            let block = b"\x31\x10\x03\x22";
            partner.hear(at(4), &block[..place], &Moods::GOOD, &mut out, &mut told);
            partner.hear(at(after), b"", &Moods::GOOD, &mut out, &mut told);
            assert_eq!(out == [DLE], said, "after {place} characters, at {after} ms");
            partner.hear(at(12), &block[place..], &Moods::GOOD, &mut out, &mut told);
            assert_eq!((out.last(), told.len()), (Some(&DLE), 1));
        }
    }

    /// The CP takes it for a disturbance, and repeats a block that has arrived.
    #[test]
    fn a_late_answer_in_the_middle_of_a_block_spoils_that_to_the_block() {
        for (crosses, whole) in [(false, true), (true, false)] {
            let mut partner = Procedure::new(SETTINGS, 1);
            let (mut out, mut told) = (Vec::new(), Vec::new());
            partner.delayed = crosses.then_some((at(3), DLE));
            partner.hear(at(1), b"\x02", &Moods::GOOD, &mut out, &mut told);
            partner.hear(at(4), b"\x31\x10", &Moods::GOOD, &mut out, &mut told);
            partner.hear(at(5), b"\x03\x22", &Moods::GOOD, &mut out, &mut told);
            assert_eq!(told, [Told::Block(b"\x31".to_vec(), whole)]);
        }
    }

    #[test]
    fn its_own_block_is_sent_and_repeated() {
        let mut partner = Procedure::new(SETTINGS, 1);
        let (mut out, mut told) = (Vec::new(), Vec::new());
        partner.send(b"\x10".to_vec());
        partner.hear(at(1), b"", &Moods::GOOD, &mut out, &mut told);
        assert_eq!(out, [STX]);
        partner.hear(at(2), &[DLE], &Moods::GOOD, &mut out, &mut told);
        assert_eq!(out, b"\x02\x10\x10\x10\x03\x13");
        partner.hear(at(3), &[NAK], &Moods::GOOD, &mut out, &mut told);
        partner.hear(at(300), b"", &Moods::GOOD, &mut out, &mut told);
        partner.hear(at(301), &[DLE], &Moods::GOOD, &mut out, &mut told);
        partner.hear(at(302), &[DLE], &Moods::GOOD, &mut out, &mut told);
        assert_eq!(told.last(), Some(&Told::Acknowledged(b"\x10".to_vec())));
        assert_eq!(partner.waiting(), 0);
    }

    #[test]
    fn its_own_block_is_given_up() {
        let mut partner = Procedure::new(SETTINGS, 1);
        let (mut out, mut told) = (Vec::new(), Vec::new());
        partner.send(b"a".to_vec());
        for attempt in 0..SETTINGS.attempts as u64 {
            assert!(!told.contains(&Told::GivenUp), "{attempt}");
            partner.hear(at(300 * attempt + 300), b"", &Moods::GOOD, &mut out, &mut told);
            partner.hear(at(300 * attempt + 301), &[DLE], &Moods::GOOD, &mut out, &mut told);
            partner.hear(at(300 * attempt + 310), &[NAK], &Moods::GOOD, &mut out, &mut told);
        }
        assert_eq!(told.last(), Some(&Told::GivenUp));
    }
}
