//! A simulated line between two ends, in virtual time: for protocol machines and stations in one thread. The line
//! between processes, which a station file may name, is [`ob1_line::sim::SimBus`].
//!
//! Characters take their real time: start bit, data bits, parity bit and stop bits at the baud rate. A character
//! written at one end arrives at the other with its last bit, and [`SimEvent::TxDone`] tells the writer when everything
//! has been sent. The same configuration, seed and calls give the same events to the nanosecond; events of the same
//! instant come in a fixed order (TxDone before received characters, end A before end B).
//!
//! The line enforces the law of time. It is broken by writing into a half-duplex line while the other end is sending,
//! and by going back in time. A strict line then panics; any other counts it ([`SimLine::violations`]) and lets the
//! characters collide.
//!
//! The owner asks [`SimLine::next_event`] for the time of the next event, sets its clock to it, and takes the events
//! with [`SimLine::pop`] until there are none left.
//!
//! ```
//! use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
//! use ob1_line::Instant;
//!
//! // 9600 baud, 8 data bits, no parity, 1 stop bit: 20 half bits.
//! let mut line = SimLine::new(SimConfig::new(9600, 20), 1);
//! line.write(End::A, Instant::START, b"Hi");
//! let first = Instant::from_nanos(1_041_667);
//! assert_eq!(line.next_event(), Some(first));
//! let mut buffer = [0; 16];
//! assert_eq!(line.pop(first, &mut buffer), Some((End::B, SimEvent::Rx(1))));
//! assert_eq!(buffer[0], b'H');
//! ```

mod direction;

use direction::Direction;
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_line::{Instant, LineFault, Span};

/// One end of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum End {
    /// One end; both are alike.
    A,
    /// The other end of the line.
    B,
}

impl End {
    /// Both ends of the line.
    pub const BOTH: [Self; 2] = [Self::A, Self::B];

    /// The end that hears this one.
    pub fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// An event at an end of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimEvent {
    /// This many characters were received; they are at the beginning of the buffer.
    Rx(usize),
    /// A character that could not be read, in its place between the others.
    Fault(LineFault),
    /// The last bit of everything written at this end has been sent.
    TxDone,
    /// The other end has switched its RTS, which is this end's CTS (null modem).
    Cts(bool),
}

/// Properties of the line.
#[derive(Debug, Clone)]
pub struct SimConfig {
    /// Time of one character.
    pub char_time: Span,
    /// Two-wire line: only one end may send at a time.
    pub half_duplex: bool,
    /// Panic when the law of time is broken.
    pub strict: bool,
    /// Characters that follow the first within this time come together with it, at most this much late. 0: each comes
    /// at its own time, and only a late owner gets several at once.
    pub coalesce: Span,
    /// Faults of both directions, and how often they come.
    pub faults: FaultRates,
    /// Characters that begin at or after this time have no faults.
    pub faults_until: Instant,
}

impl SimConfig {
    /// A full-duplex strict line without faults. `half_bits` is the length of a character in half bits, start and stop
    /// bits included: 20 for 8N1, 22 for 8E1, 23 for 8E1.5.
    pub fn new(baud: u32, half_bits: u32) -> Self {
        Self {
            char_time: Span::from_nanos((u64::from(half_bits) * 500_000_000).div_ceil(u64::from(baud.max(1)))),
            half_duplex: false,
            strict: true,
            coalesce: Span::ZERO,
            faults: FaultRates::NONE,
            faults_until: Instant::NEVER,
        }
    }
}

/// A line between two ends.
#[derive(Debug, Clone)]
pub struct SimLine {
    config: SimConfig,
    rng: SplitMix64,
    /// Indexed by the sending end.
    directions: [Direction; 2],
    now: Instant,
    violations: u64,
    cut: bool,
}

impl SimLine {
    /// An idle line. The seed determines all faults.
    pub fn new(config: SimConfig, seed: u64) -> Self {
        Self {
            config,
            rng: SplitMix64::new(seed),
            directions: [Direction::default(), Direction::default()],
            now: Instant::START,
            violations: 0,
            cut: false,
        }
    }

    /// The configuration, with the faults as they are now.
    pub fn config(&self) -> &SimConfig {
        &self.config
    }

    /// Changes the faults from now on.
    pub fn set_faults(&mut self, faults: FaultRates, until: Instant) {
        self.config.faults = faults;
        self.config.faults_until = until;
    }

    /// Changes the baud rate or character frame for characters written from now on. Both ends must agree: a line has
    /// only one.
    pub fn set_char_time(&mut self, char_time: Span) {
        self.config.char_time = char_time;
    }

    /// Disconnects the cable (true) or connects it again. Characters written while it is disconnected are lost, but
    /// still take their time.
    pub fn set_cut(&mut self, cut: bool) {
        self.cut = cut;
    }

    /// How often the law of time was broken (0 on a strict line, which panics).
    pub fn violations(&self) -> u64 {
        self.violations
    }

    /// Sends characters from `end`, after those still being sent.
    pub fn write(&mut self, end: End, now: Instant, bytes: &[u8]) {
        self.advance(now);
        if bytes.is_empty() {
            return;
        }
        let collides = self.config.half_duplex && self.directions[end.other() as usize].is_sending(now);
        if collides {
            self.violation("both ends of a half-duplex line send at the same time");
        }
        let Self { config, rng, directions, cut, .. } = self;
        directions[end as usize].write(config, rng, now, bytes, *cut, collides);
    }

    /// Takes back the characters of `end` that have not begun; returns how many.
    pub fn take_back(&mut self, end: End, now: Instant) -> usize {
        self.advance(now);
        self.directions[end as usize].take_back(now, self.config.char_time)
    }

    /// Switches RTS of `end`; the other end sees it as CTS at the same instant.
    pub fn set_rts(&mut self, end: End, now: Instant, on: bool) {
        self.advance(now);
        self.directions[end as usize].set_rts(now, on);
    }

    /// Whether characters of `end` are on the line or waiting to be.
    pub fn is_sending(&self, end: End, now: Instant) -> bool {
        self.directions[end as usize].is_sending(now)
    }

    /// When the next event happens.
    pub fn next_event(&self) -> Option<Instant> {
        let [(done_a, arrival_a), (done_b, arrival_b)] = self.due();
        let first = done_a.min(done_b).min(arrival_a).min(arrival_b);
        (first != Instant::NEVER).then_some(first)
    }

    /// What each end sees next, and when: the end of its own output, characters. [`Instant::NEVER`]: nothing.
    fn due(&self) -> [(Instant, Instant); 2] {
        let [a, b] = &self.directions;
        let coalesce = self.config.coalesce;
        [(a.next_done(), b.next_arrival(coalesce)), (b.next_done(), a.next_arrival(coalesce))]
    }

    /// Takes the next event that has happened by `now`, with the end that sees it. Consecutive received characters
    /// without another event in between come together. `buffer` must not be empty.
    pub fn pop(&mut self, now: Instant, buffer: &mut [u8]) -> Option<(End, SimEvent)> {
        self.advance(now);
        let due = self.due();
        let dones = End::BOTH.map(|end| (due[end as usize].0, false, end));
        let arrivals = End::BOTH.map(|end| (due[end as usize].1, true, end));
        let mut first = dones[0];
        for next in [dones[1], arrivals[0], arrivals[1]] {
            if next.0 < first.0 {
                first = next;
            }
        }
        let (at, arrival, end) = first;
        if at > now || at == Instant::NEVER {
            return None;
        }
        if !arrival {
            self.directions[end as usize].take_done();
            return Some((end, SimEvent::TxDone));
        }
        // Not beyond an event in between.
        let other = end.other();
        let limit = now.min(dones[0].0).min(dones[1].0).min(due[other as usize].1).max(at);
        Some((end, self.directions[other as usize].take_arrivals(limit, buffer)))
    }

    fn advance(&mut self, now: Instant) {
        if now < self.now {
            self.violation("time goes back");
        }
        self.now = self.now.max(now);
    }

    fn violation(&mut self, what: &str) {
        assert!(!self.config.strict, "simulated line at {} ns: {what}", self.now);
        self.violations += 1;
    }
}

#[cfg(test)]
mod tests;
