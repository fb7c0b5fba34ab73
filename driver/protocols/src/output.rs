//! Sending without acknowledgement, for ASCII and STX/ETX: the telegram between its start and end characters, the
//! partner's flow control, ZNA or a pause between telegrams, the secondary signals.

use crate::flow::Flow;
use crate::machine::{Event, Instant, ModemLines, Order, Phase, SendError, Sink, Span, What, earliest};
use crate::signals::{Clear, Signals, Times};

/// Characters handed to the line at a time while the partner may stop us: it must be able to take as many after its
/// XOFF.
const CHUNK: usize = 16;

/// None, one or two characters before or after a telegram. [S0 "Number of start flags"]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    characters: [u8; 2],
    count: u8,
}

impl Flags {
    /// No start or end characters.
    pub const NONE: Self = Self { characters: [0; 2], count: 0 };

    /// The first `count` (0..2) of the characters; the others are ignored. [S0 L2018]
    pub const fn new(characters: [u8; 2], count: u8) -> Self {
        Self { characters, count: if count > 2 { 2 } else { count } }
    }

    /// The characters in use.
    pub fn as_slice(&self) -> &[u8] {
        &self.characters[..usize::from(self.count)]
    }

    /// Bytes of a telegram up to and including these characters; `None` if they are not in it.
    pub(crate) fn end_of(&self, telegram: &[u8]) -> Option<usize> {
        let count = self.as_slice().len();
        telegram.windows(count.max(1)).position(|part| part == self.as_slice()).map(|at| at + count)
    }
}

/// Which of an order's bytes are sent. [TIA help "Configuration for point-to-point links"]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Extent {
    /// All of them, between separate start and end characters.
    #[default]
    Whole,
    /// Up to and including these characters.
    Through(Flags),
    /// All of them with the end characters, which count as data.
    Appended,
}

/// Rules for sending. Times in nanoseconds.
#[derive(Clone, Debug)]
pub(crate) struct Rules {
    pub(crate) start: Flags,
    pub(crate) end: Flags,
    pub(crate) flow: Flow,
    pub(crate) zna: Span,
    pub(crate) char_time: Span,
    /// Longest time that an order waits for XON or CTS; 0: for ever.
    pub(crate) flow_wait: Span,
    pub(crate) extent: Extent,
    /// From the last bit of a telegram to the first of the next; unlike ZNA it does not delay the end of the order.
    pub(crate) pause: Span,
    /// Automatic use of the secondary signals.
    pub(crate) signals: Option<Times>,
}

/// The sending half, with a buffer of `N` bytes.
#[derive(Clone, Debug)]
pub(crate) struct Output<const N: usize> {
    rules: Rules,
    state: State,
    /// The partner has stopped us.
    stopped: bool,
    signals: Signals,
    /// No telegram begins before this time.
    pause_until: Instant,
    /// Bytes of user data in `data`.
    len: usize,
    data: [u8; N],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The pause after the previous telegram is not over.
    Held {
        until: Instant,
    },
    /// RTS is ON; the data output waiting time runs.
    Asking,
    /// All up to `next` has been handed over and is being sent; give up at `until`: something below us holds it back (a
    /// driver that checks CTS by itself).
    Leaving {
        next: usize,
        until: Option<Instant>,
    },
    /// The partner has stopped us before `next`; give up at `until`.
    Stopped {
        next: usize,
        until: Option<Instant>,
    },
    /// The last bit has been sent; ZNA runs.
    Pause {
        until: Instant,
    },
}

impl<const N: usize> Output<N> {
    pub(crate) const fn new(rules: Rules) -> Self {
        let signals = Signals::new(rules.signals);
        Self { rules, state: State::Idle, stopped: false, signals, pause_until: Instant::START, len: 0, data: [0; N] }
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.state != State::Idle
    }

    /// Whether a telegram waits until the partner lets it go.
    pub(crate) fn is_stopped(&self) -> bool {
        self.is_busy() && self.stopped
    }

    /// The very first step.
    pub(crate) fn start(&self, out: &mut dyn Sink) {
        self.signals.start(out);
    }

    /// Whether the secondary signals let characters in.
    pub(crate) fn can_receive(&self) -> bool {
        self.signals.can_receive()
    }

    pub(crate) fn order(&mut self, now: Instant, order: Order<'_>, out: &mut dyn Sink) {
        match order {
            Order::Abort => {
                out.take_back();
                if self.is_busy() {
                    self.end(now, Err(SendError::Aborted), out);
                }
            }
            Order::Send(_) if self.is_busy() => out.sent(Err(SendError::Busy)),
            Order::Send(telegram) => match self.take(telegram) {
                Ok(()) if now < self.pause_until => self.state = State::Held { until: self.pause_until },
                Ok(()) => self.begin(now, out),
                Err(error) => out.sent(Err(error)),
            },
        }
    }

    /// Copies the bytes to send. [TIA help "Configuration for point-to-point links"]
    fn take(&mut self, telegram: &[u8]) -> Result<(), SendError> {
        let telegram = match self.rules.extent {
            Extent::Whole => telegram,
            Extent::Through(end) => &telegram[..end.end_of(telegram).ok_or(SendError::NoEnd)?],
            Extent::Appended if telegram.len() + self.rules.end.as_slice().len() > N => return Err(SendError::NoEnd),
            Extent::Appended => telegram,
        };
        self.data.get_mut(..telegram.len()).ok_or(SendError::TooLong)?.copy_from_slice(telegram);
        self.len = telegram.len();
        Ok(())
    }

    fn begin(&mut self, now: Instant, out: &mut dyn Sink) {
        let clear = self.signals.request(now, out);
        self.cleared(now, clear, out);
    }

    fn cleared(&mut self, now: Instant, clear: Clear, out: &mut dyn Sink) {
        match clear {
            Clear::Go => self.go_on(now, 0, out),
            Clear::Wait => self.state = State::Asking,
            Clear::Off => self.signals_off(now, out),
        }
    }

    /// "The send request is aborted and an error message generated." [S4 L814]
    fn signals_off(&mut self, now: Instant, out: &mut dyn Sink) {
        if matches!(self.state, State::Leaving { .. }) {
            out.take_back();
        }
        out.report(Event { phase: Phase::Output, what: What::Signals });
        self.end(now, Err(SendError::Signals), out);
    }

    pub(crate) fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        self.signals.tick(now, out);
        match self.state {
            State::Pause { until } if now >= until => self.end(now, Ok(()), out),
            State::Held { until } if now >= until => self.begin(now, out),
            State::Asking => {
                let clear = self.signals.clear(now);
                self.cleared(now, clear, out);
            }
            State::Stopped { until: Some(until), .. } | State::Leaving { until: Some(until), .. } if now >= until => {
                if matches!(self.state, State::Leaving { .. }) {
                    out.take_back();
                }
                out.report(Event { phase: Phase::Output, what: What::AckDelay });
                // An XON may have been lost on the line. The next order tries again; a partner that is really full
                // stops it again.
                if self.rules.flow == Flow::XonXoff {
                    self.stopped = false;
                }
                self.end(now, Err(SendError::AckDelay), out);
            }
            _ => {}
        }
    }

    pub(crate) fn tx_done(&mut self, now: Instant, out: &mut dyn Sink) {
        if let State::Leaving { next, .. } = self.state {
            self.go_on(now, next, out);
        }
    }

    /// The modem lines have changed. True if DSR has gone OFF, which also ends the telegram being received.
    pub(crate) fn modem(&mut self, now: Instant, lines: ModemLines, out: &mut dyn Sink) -> bool {
        if self.rules.flow == Flow::Hardware {
            self.set_stopped(now, !lines.cts, out);
        }
        let change = self.signals.inputs(lines);
        match self.state {
            // "... or if CTS changes to OFF during transmission" [S4 L814]
            State::Leaving { .. } | State::Stopped { .. } if change.cts_off => self.signals_off(now, out),
            // "A send request or data receipt is aborted with an error message if DSR changes from ON to OFF."
            // [S4 L817]
            State::Asking | State::Leaving { .. } | State::Stopped { .. } if change.dsr_fell => {
                self.signals_off(now, out);
            }
            _ => {}
        }
        change.dsr_fell
    }

    /// The partner stops us or lets us continue. [S0 "Flow control"] Characters already handed over are still sent:
    /// they are few, and they may include an XON of our own, which must not be taken back.
    pub(crate) fn set_stopped(&mut self, now: Instant, stopped: bool, out: &mut dyn Sink) {
        self.stopped = stopped;
        if let (State::Stopped { next, .. }, false) = (self.state, stopped) {
            self.go_on(now, next, out);
        }
    }

    pub(crate) fn deadline(&self) -> Option<Instant> {
        let own = match self.state {
            State::Idle | State::Asking => None,
            State::Leaving { until, .. } | State::Stopped { until, .. } => until,
            State::Held { until } | State::Pause { until } => Some(until),
        };
        earliest([own, self.signals.deadline()])
    }

    /// Start characters, user data and end characters as one.
    fn total(&self) -> usize {
        self.rules.start.as_slice().len() + self.len + self.rules.end.as_slice().len()
    }

    /// Hands over the next characters, or begins the pause after the telegram.
    fn go_on(&mut self, now: Instant, next: usize, out: &mut dyn Sink) {
        let total = self.total();
        if next == total {
            self.signals.sent(now);
            // [S0 "ASCII"]: "only reset when the data has been transferred and the ZNA has expired".
            self.state = State::Pause { until: now + self.rules.zna };
            if self.rules.zna.is_zero() {
                self.end(now, Ok(()), out);
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

    fn stop(&mut self, now: Instant, next: usize) {
        self.state = State::Stopped { next, until: self.give_up_after(now) };
    }

    fn give_up_after(&self, at: Instant) -> Option<Instant> {
        (!self.rules.flow_wait.is_zero()).then(|| at + self.rules.flow_wait)
    }

    fn end(&mut self, now: Instant, outcome: Result<(), SendError>, out: &mut dyn Sink) {
        self.state = State::Idle;
        self.pause_until = now + self.rules.pause;
        self.signals.drop_request(out);
        out.sent(outcome);
    }
}
