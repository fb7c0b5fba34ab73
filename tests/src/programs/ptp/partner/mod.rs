//! The partners on the line of the point-to-point CPs: written from the manuals, apart from the machines under test.
//! What happened at them is their ledger ([`Event`]).

pub mod characters;
pub mod procedure;
pub mod rk512;
pub mod slave;

use ob1_line::sim::SplitMix64;
use ob1_time::{Instant, Span};

use crate::programs::run::Partner;
use crate::sim::device::Device;

/// What happened at the partner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// It got a whole telegram.
    Got {
        /// Its last character.
        at: Instant,
        /// The telegram.
        telegram: Vec<u8>,
        /// It has said so, right and in time; `false`: the CP cannot know.
        answered: bool,
    },
    /// It has sent a telegram.
    Said {
        /// When it was over.
        at: Instant,
        /// The telegram.
        telegram: Vec<u8>,
        /// The CP has it: it said so, or there is nothing to say and the telegram was good.
        owed: bool,
    },
    /// The CP has acknowledged a telegram that it had sent.
    Owed {
        /// The telegram.
        telegram: Vec<u8>,
    },
    /// It does something wrong until this instant: jobs may fail.
    Disturbs(Instant),
    /// It has given up a telegram of its own, which the CP did not acknowledge.
    GivesUp(Instant),
    /// Characters came although it had said XOFF.
    Flooded {
        /// When.
        at: Instant,
        /// How many more than the one that was under way.
        characters: usize,
    },
}

/// When the partner is in a bad mood, and how often.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moods {
    /// Telegrams in a hundred that it treats badly.
    pub bad: u64,
    /// Until then.
    pub until: Instant,
}

impl Moods {
    /// Never.
    pub const GOOD: Self = Self { bad: 0, until: Instant::START };

    /// Whether it is bad now.
    pub fn is_bad(&self, now: Instant, rng: &mut SplitMix64) -> bool {
        now < self.until && rng.below(100) < self.bad
    }
}

/// What the partner speaks.
#[derive(Debug)]
pub enum Speaks {
    /// 3964R.
    Procedure(procedure::Plain),
    /// RK 512.
    Rk512(rk512::Rk512),
    /// ASCII or STX/ETX.
    Characters(characters::Characters),
    /// A Modbus slave.
    Modbus(slave::Slave),
}

/// The partner on the line.
#[derive(Debug)]
pub struct Ptp {
    /// Its protocol.
    pub speaks: Speaks,
    /// Its moods.
    pub moods: Moods,
    /// What happened since the judge has looked.
    pub events: Vec<Event>,
    /// The two wires give the CP its own characters back; how long a character takes on them.
    pub echoes: Option<Span>,
    /// Until then its own characters are on the two wires: what the CP sends meanwhile collides.
    busy: Instant,
    /// Nobody else is on the line.
    pub is_absent: bool,
    /// It may say XOFF.
    pub can_stop: bool,
}

impl Ptp {
    /// A good partner.
    #[must_use]
    pub fn new(speaks: Speaks, moods: Moods) -> Self {
        Self {
            speaks,
            moods,
            events: Vec::new(),
            echoes: None,
            busy: Instant::START,
            is_absent: false,
            can_stop: false,
        }
    }
}

impl Device for Ptp {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        if self.echoes.is_some() && now >= self.busy {
            out.extend(bytes);
        }
        if self.is_absent {
            return None;
        }
        let echo = out.len();
        let Self { moods, events, .. } = self;
        let next = match &mut self.speaks {
            Speaks::Procedure(partner) => partner.hear(now, bytes, moods, out, events),
            Speaks::Rk512(partner) => partner.hear(now, bytes, moods, out, events),
            Speaks::Characters(partner) => partner.hear(now, bytes, out, events),
            Speaks::Modbus(partner) => partner.hear(now, bytes, moods, out, events),
        };
        if let Some(each) = self.echoes.filter(|_| out.len() > echo) {
            self.busy = self.busy.max(now) + leaving(out.len() - echo, each);
        }
        (next < Instant::NEVER).then_some(next)
    }
}

/// A telegram of the partner: `number` and `len` make it.
#[must_use]
pub fn telegram(number: u32, len: usize) -> Vec<u8> {
    let tag = [0x40 + (number >> 5 & 0x1F) as u8, 0x40 + (number & 0x1F) as u8];
    (0..len).map(|at| if at < 2 { tag[at] } else { 0x20 + ((at * 7 + number as usize * 3) & 0x1F) as u8 }).collect()
}

impl Partner for Ptp {
    /// `what`: number and length of a telegram to send, `number << 16 | len`; 0 and 1 are for the protocol.
    fn told(&mut self, now: Instant, what: u32, out: &mut Vec<u8>) -> Option<Instant> {
        let (number, len) = (what >> 16, (what & 0xFFFF) as usize);
        let telegram = telegram(number, len);
        match &mut self.speaks {
            Speaks::Procedure(partner) => partner.0.send(telegram),
            Speaks::Rk512(partner) => partner.order(number, telegram),
            Speaks::Characters(partner) => partner.send(what, telegram),
            Speaks::Modbus(_) => {}
        }
        self.hear(now, &[], out)
    }
}

/// Time of so many characters that leave at `each`.
fn leaving(count: usize, each: Span) -> Span {
    each * count as u64
}
