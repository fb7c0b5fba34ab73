//! Sending without acknowledgement, as ASCII and STX/ETX do it: the telegram between its start and end characters, the
//! partner's flow control, ZNA.

use crate::flow::Flow;
use crate::machine::{Event, Nanos, Order, Phase, SendError, Sink, What};

/// Characters handed to the line at a time while the partner may stop us: what it must be able to take after its XOFF.
const CHUNK: usize = 16;

/// None, one or two characters before or behind a telegram. [S0 "Number of start flags"]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    characters: [u8; 2],
    count: u8,
}

impl Flags {
    /// No characters.
    pub const NONE: Self = Self { characters: [0; 2], count: 0 };

    /// The first `count` (0..2) of the characters; the others are ignored. [S0 L2018]
    pub const fn new(characters: [u8; 2], count: u8) -> Self {
        Self { characters, count: if count > 2 { 2 } else { count } }
    }

    /// The characters in use.
    pub fn as_slice(&self) -> &[u8] {
        &self.characters[..usize::from(self.count)]
    }
}

/// What a send follows. Times in nanoseconds.
#[derive(Clone, Debug)]
pub(crate) struct Rules {
    pub(crate) start: Flags,
    pub(crate) end: Flags,
    pub(crate) flow: Flow,
    pub(crate) zna: Nanos,
    pub(crate) char_time: Nanos,
    /// Longest time that an order waits for XON or CTS; 0: for ever.
    pub(crate) flow_wait: Nanos,
}

/// The sending half, with a buffer of `N` bytes.
#[derive(Clone, Debug)]
pub(crate) struct Output<const N: usize> {
    rules: Rules,
    state: State,
    /// The partner has stopped us.
    stopped: bool,
    /// Bytes of user data in `data`.
    len: usize,
    data: [u8; N],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// All up to `next` has been handed over and is leaving; give up at `until`: something below us holds it back (a driver
    /// that looks at CTS by itself).
    Leaving {
        next: usize,
        until: Option<Nanos>,
    },
    /// The partner has stopped us before `next`; give up at `until`.
    Stopped {
        next: usize,
        until: Option<Nanos>,
    },
    /// The last bit is out; ZNA runs.
    Pause {
        until: Nanos,
    },
}

impl<const N: usize> Output<N> {
    pub(crate) const fn new(rules: Rules) -> Self {
        Self { rules, state: State::Idle, stopped: false, len: 0, data: [0; N] }
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.state != State::Idle
    }

    pub(crate) fn order(&mut self, now: Nanos, order: Order<'_>, out: &mut dyn Sink) {
        match order {
            Order::Abort => {
                out.take_back();
                if self.is_busy() {
                    self.finish(Err(SendError::Aborted), out);
                }
            }
            Order::Send(_) if self.is_busy() => out.sent(Err(SendError::Busy)),
            Order::Send(telegram) => match self.data.get_mut(..telegram.len()) {
                Some(buffer) => {
                    buffer.copy_from_slice(telegram);
                    self.len = telegram.len();
                    self.go_on(now, 0, out);
                }
                None => out.sent(Err(SendError::TooLong)),
            },
        }
    }

    pub(crate) fn tick(&mut self, now: Nanos, out: &mut dyn Sink) {
        match self.state {
            State::Pause { until } if now >= until => self.finish(Ok(()), out),
            State::Stopped { until: Some(until), .. } | State::Leaving { until: Some(until), .. } if now >= until => {
                if matches!(self.state, State::Leaving { .. }) {
                    out.take_back();
                }
                out.report(Event { phase: Phase::Output, what: What::AckDelay });
                // An XON may have been lost on the line. The next order tries; a partner that is really full stops it again.
                if self.rules.flow == Flow::XonXoff {
                    self.stopped = false;
                }
                self.finish(Err(SendError::AckDelay), out);
            }
            _ => {}
        }
    }

    pub(crate) fn tx_done(&mut self, now: Nanos, out: &mut dyn Sink) {
        if let State::Leaving { next, .. } = self.state {
            self.go_on(now, next, out);
        }
    }

    /// The partner stops us or lets us go on. [S0 "Flow control"] What is leaving leaves: it is no more than a few characters,
    /// and among them may be an XON of our own, which must not be taken back.
    pub(crate) fn set_stopped(&mut self, now: Nanos, stopped: bool, out: &mut dyn Sink) {
        self.stopped = stopped;
        if let (State::Stopped { next, .. }, false) = (self.state, stopped) {
            self.go_on(now, next, out);
        }
    }

    pub(crate) fn deadline(&self) -> Option<Nanos> {
        match self.state {
            State::Idle => None,
            State::Leaving { until, .. } | State::Stopped { until, .. } => until,
            State::Pause { until } => Some(until),
        }
    }

    /// Start characters, user data and end characters as one.
    fn total(&self) -> usize {
        self.rules.start.as_slice().len() + self.len + self.rules.end.as_slice().len()
    }

    /// Hands over what comes next, or begins the pause after the telegram.
    fn go_on(&mut self, now: Nanos, next: usize, out: &mut dyn Sink) {
        let total = self.total();
        if next == total {
            // [S0 "ASCII"]: "only reset when the data has been transferred and the ZNA has expired".
            self.state = State::Pause { until: now + self.rules.zna };
            if self.rules.zna == 0 {
                self.finish(Ok(()), out);
            }
        } else if self.stopped {
            self.stop(now, next);
        } else {
            let chunk = if self.rules.flow == Flow::None { total } else { CHUNK };
            let end = total.min(next + chunk);
            self.transmit(next, end, out);
            let leaves = now + self.rules.char_time * (end - next) as u64;
            self.state = State::Leaving { next: end, until: self.give_up_after(leaves) };
        }
    }

    fn transmit(&self, from: usize, to: usize, out: &mut dyn Sink) {
        let mut begin = 0;
        for part in [self.rules.start.as_slice(), &self.data[..self.len], self.rules.end.as_slice()] {
            let end = begin + part.len();
            let (first, last) = (from.max(begin), to.min(end));
            if first < last {
                out.transmit(&part[first - begin..last - begin]);
            }
            begin = end;
        }
    }

    fn stop(&mut self, now: Nanos, next: usize) {
        self.state = State::Stopped { next, until: self.give_up_after(now) };
    }

    fn give_up_after(&self, at: Nanos) -> Option<Nanos> {
        (self.rules.flow_wait > 0).then(|| at + self.rules.flow_wait)
    }

    fn finish(&mut self, outcome: Result<(), SendError>, out: &mut dyn Sink) {
        self.state = State::Idle;
        out.sent(outcome);
    }
}
