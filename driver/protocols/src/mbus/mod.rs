//! M-Bus master of the CP 240 (240-1FA20): a program's telegram out as a frame, the slave's answer back.
//!
//! [S0 "CP 240 - M-Bus"]. The first byte of a telegram from the program is the baud rate; the length of the rest
//! decides which frame it becomes. One order at a time: it ends when the slave has answered, or has been given up after
//! two repetitions. Each order brings exactly one response telegram, whose first byte is the result:
//!
//! | response | |
//! |---|---|
//! | `00 E5` | the single character |
//! | `00 C A` | a short frame |
//! | `00 C A CI data` | a control or long frame |
//! | `01` | bit 0: no answer (three attempts), or nobody was to answer (address 255, single character) |
//! | `03` | bits 0 and 1: the bus is short-circuited |
//!
//! Ours, because the manual is silent: an order waits until the longest response fits into the receive buffer, so that
//! no answer is lost; an order that nobody is to answer ends with `01` at once, so that a program that waits for a
//! response (as the manual's FC 100 does) continues; a short circuit is what the level converter reports as a break of
//! the line. A line that stays at 0 reports its break only once, so the break counts until a character comes in again.
//! A device that never falls silent does not prolong an order: an attempt takes at most the time of the answer and of
//! [`ATTEMPT_FRAMES`] of the longest frames.

mod config;
pub mod frame;

pub use config::{Config, baud_of};

use crate::machine::{
    Event, Input, Instant, LineFault, LineInput, Machine, Order, Phase, SECOND, SendError, Sink, Span, What,
};
use frame::{FRAME_MAX, Frame, FrameError, Progress, SINGLE, USER_MAX};

/// Longest response telegram, bytes: response byte, C, A, CI field, user data.
pub const RESPONSE_MAX: usize = 4 + USER_MAX;

/// Response byte: a valid answer.
pub const ANSWERED: u8 = 0x00;
/// Response byte, bit 0: no answer was received. [S0 "Response byte"]
pub const NO_ANSWER: u8 = 0x01;
/// Response byte, bit 1: short circuit at the bus; then no answer was received either. [S0 "Response byte"]
pub const SHORT_CIRCUIT: u8 = 0x02 | NO_ANSWER;

/// Address of all slaves, none of which answers. [S0 "A field"]
const BROADCAST: u8 = 255;

/// "It repeats the transfer of the same telegram for up to two times." [S0 "FCB bit"]
const ATTEMPTS: u16 = 3;

/// Number of longest frames that fit into one attempt, besides the wait for the answer: an echo, an answer, and the
/// rest after a defective one.
const ATTEMPT_FRAMES: u64 = 3;

/// If a line never reports the end of its output, the output counts as ended this long after its computed duration.
const OUTPUT_GRACE: Span = Span::SECOND;

/// How often the receive buffer is checked while an order waits for room in it.
const ROOM_POLL: Span = Span::from_millis(20);

/// The M-Bus master as a machine.
#[derive(Clone, Debug)]
pub struct MBus {
    config: Config,
    state: State,
    /// Duration of a bit at the baud rate of the running order.
    bit: Span,
    baud: u32,
    /// The frame of the running order.
    tx: [u8; FRAME_MAX],
    tx_len: usize,
    answered: bool,
    /// A break has been received, and no character since.
    shorted: bool,
    /// When the running attempt ends, whatever is received.
    limit: Instant,
    /// The answer so far.
    rx: [u8; FRAME_MAX],
    rx_len: usize,
}

/// Progress of the exchange. `attempt` counts from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The order waits for room in the receive buffer.
    Held {
        poll: Instant,
    },
    /// The frame is being sent.
    Output {
        attempt: u16,
        until: Instant,
    },
    /// The answer is awaited or being received: a time-out at `until`.
    Answer {
        attempt: u16,
        until: Instant,
    },
    /// The answer was defective: the next attempt, or the end, when the bus has been silent until `until`.
    Silence {
        attempt: u16,
        until: Instant,
    },
}

impl MBus {
    /// An idle master without an order.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            state: State::Idle,
            bit: Span::ZERO,
            baud: 0,
            tx: [0; FRAME_MAX],
            tx_len: 0,
            answered: true,
            shorted: false,
            limit: Instant::START,
            rx: [0; FRAME_MAX],
            rx_len: 0,
        }
    }

    fn order(&mut self, now: Instant, telegram: &[u8], out: &mut dyn Sink) {
        if self.state != State::Idle {
            return out.sent(Err(SendError::Busy));
        }
        // [S0 "Overview of M-Bus telegrams"]: the length tells the frame; a baud rate alone is not a telegram.
        let frame = match *telegram {
            [] | [_] => return out.sent(Err(SendError::Frame)),
            [_, SINGLE] => Frame::Single,
            // E5h is the only single character.
            [_, _] => return out.sent(Err(SendError::Frame)),
            [_, c, a] => Frame::Short { c, a },
            [_, c, a, ci, ref data @ ..] if data.len() <= USER_MAX => Frame::Long { c, a, ci, data },
            _ => return out.sent(Err(SendError::TooLong)),
        };
        self.answered = match frame {
            Frame::Single => false,
            Frame::Short { a, .. } | Frame::Long { a, .. } => a != BROADCAST,
        };
        self.tx_len = frame.encode(&mut self.tx);
        self.baud = baud_of(telegram[0]);
        self.bit = SECOND / u64::from(self.baud);
        self.hold(now, out);
    }

    /// Begins the exchange as soon as there is room for its response.
    fn hold(&mut self, now: Instant, out: &mut dyn Sink) {
        if out.room() >= RESPONSE_MAX {
            out.baud(self.baud);
            self.output(now, 1, out);
        } else {
            self.state = State::Held { poll: now + ROOM_POLL };
        }
    }

    fn output(&mut self, now: Instant, attempt: u16, out: &mut dyn Sink) {
        if attempt > 1 {
            out.report(Event { phase: Phase::Output, what: What::Repetition(attempt - 1) });
        }
        out.transmit(&self.tx[..self.tx_len]);
        let leaves = self.bit * u64::from(Config::CHARACTER_BITS) * self.tx_len as u64;
        self.state = State::Output { attempt, until: now + leaves + OUTPUT_GRACE };
    }

    fn tx_done(&mut self, now: Instant, out: &mut dyn Sink) {
        let State::Output { attempt, .. } = self.state else { return };
        if self.answered {
            self.rx_len = 0;
            let answer = self.config.answer(self.bit);
            self.limit = now + answer + ATTEMPT_FRAMES * self.config.longest_frame(self.bit);
            self.state = State::Answer { attempt, until: now + answer };
        } else {
            self.unanswered(out);
        }
    }

    fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        match self.state {
            State::Held { poll } if now >= poll || out.room() >= RESPONSE_MAX => self.hold(now, out),
            State::Output { until, .. } if now >= until => self.tx_done(now, out),
            State::Answer { attempt, until } if now >= until => {
                let what = if self.rx_len == 0 { What::AckDelay } else { What::CharacterDelay };
                self.missed(now, attempt, what, out);
            }
            State::Silence { attempt, until } if now >= until => {
                if attempt < ATTEMPTS {
                    self.output(now, attempt + 1, out);
                } else {
                    out.report(Event { phase: Phase::Acknowledge, what: What::Exhausted });
                    self.unanswered(out);
                }
            }
            _ => {}
        }
    }

    /// No answer, or a defective one. Before anything else is sent the bus is silent for 33 bit times. [S0 "FCB bit"]
    fn missed(&mut self, now: Instant, attempt: u16, what: What, out: &mut dyn Sink) {
        out.report(Event { phase: Phase::Acknowledge, what });
        // A repetition after a missing answer needs no further silence: there was nothing else.
        let pause = if what == What::AckDelay && attempt < ATTEMPTS { Span::ZERO } else { self.config.pause(self.bit) };
        self.state = State::Silence { attempt, until: now + pause };
        self.tick(now, out);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8], out: &mut dyn Sink) {
        self.shorted &= bytes.is_empty();
        match self.state {
            State::Answer { attempt, .. } => self.collect(now, attempt, bytes, out),
            // A defective answer continues.
            State::Silence { attempt, .. } => {
                self.state = State::Silence { attempt, until: self.limited(now + self.config.pause(self.bit), now) };
            }
            // Characters received while our frame is sent are a level converter's echo.
            State::Output { .. } => {}
            State::Idle | State::Held { .. } => {
                if let Some(byte) = bytes.first() {
                    out.report(Event { phase: Phase::Idle, what: What::Unexpected(*byte) });
                }
            }
        }
    }

    fn collect(&mut self, now: Instant, attempt: u16, bytes: &[u8], out: &mut dyn Sink) {
        let room = FRAME_MAX - self.rx_len;
        let taken = bytes.len().min(room);
        self.rx[self.rx_len..self.rx_len + taken].copy_from_slice(&bytes[..taken]);
        self.rx_len += taken;
        loop {
            let (frame, used) = match Frame::decode(&self.rx[..self.rx_len]) {
                Progress::More => break,
                Progress::Wrong(error) => return self.missed(now, attempt, defect(error), out),
                Progress::Whole(frame, used) => (frame, used),
            };
            if frame.is_from_master() {
                // Our own frame, from a converter that echoes late. The answer is still to come.
                self.rx.copy_within(used..self.rx_len, 0);
                self.rx_len -= used;
                continue;
            }
            if used < self.rx_len || taken < bytes.len() {
                // More than a frame: several slaves have answered.
                return self.missed(now, attempt, What::Unexpected(self.rx[used.min(FRAME_MAX - 1)]), out);
            }
            let mut response = [ANSWERED; RESPONSE_MAX];
            let length = fields(frame, &mut response[1..]);
            return self.end(&response[..=length], out);
        }
        if self.rx_len > 0 {
            self.state = State::Answer { attempt, until: self.limited(now + self.config.gap(self.bit), now) };
        }
    }

    fn fault(&mut self, now: Instant, fault: LineFault, out: &mut dyn Sink) {
        if fault != LineFault::Back {
            out.report(Event { phase: self.phase(), what: What::Line(fault) });
        }
        self.shorted |= fault == LineFault::Break;
        match (fault, self.state) {
            (LineFault::Break, State::Output { .. } | State::Answer { .. } | State::Silence { .. }) => {
                out.take_back();
                self.unanswered(out);
            }
            (LineFault::Parity | LineFault::Framing | LineFault::Overrun, State::Answer { attempt, .. }) => {
                self.state = State::Silence { attempt, until: now + self.config.pause(self.bit) };
            }
            (LineFault::Parity | LineFault::Framing | LineFault::Overrun, State::Silence { .. }) => {
                self.receive(now, &[], out);
            }
            _ => {}
        }
    }

    fn phase(&self) -> Phase {
        match self.state {
            State::Idle | State::Held { .. } => Phase::Idle,
            State::Output { .. } => Phase::Output,
            State::Answer { .. } | State::Silence { .. } => Phase::Acknowledge,
        }
    }

    /// `until`, but not beyond the end of the attempt: then at once.
    fn limited(&self, until: Instant, now: Instant) -> Instant {
        until.min(self.limit).max(now)
    }

    /// The exchange has ended without an answer. [S0 "Response byte"]
    fn unanswered(&mut self, out: &mut dyn Sink) {
        self.end(&[if self.shorted { SHORT_CIRCUIT } else { NO_ANSWER }], out);
    }

    /// The exchange has ended: the response, then the end of the order.
    fn end(&mut self, response: &[u8], out: &mut dyn Sink) {
        if out.room() >= response.len() {
            out.deliver(response);
        } else {
            // There was room when the exchange began: an owner that uses it meanwhile loses the response.
            out.report(Event { phase: self.phase(), what: What::NoBuffer });
        }
        self.state = State::Idle;
        out.sent(Ok(()));
    }

    fn deadline(&self) -> Option<Instant> {
        match self.state {
            State::Idle => None,
            State::Held { poll } => Some(poll),
            State::Output { until, .. } | State::Answer { until, .. } | State::Silence { until, .. } => Some(until),
        }
    }
}

impl Machine for MBus {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match input {
            Input::Tick => self.tick(now, out),
            Input::Line(LineInput::Rx(bytes)) => self.receive(now, bytes, out),
            Input::Line(LineInput::TxDone) => self.tx_done(now, out),
            Input::Line(LineInput::Fault(fault)) => self.fault(now, fault, out),
            Input::Line(LineInput::Modem(_)) => {}
            Input::Order(Order::Send(telegram)) => self.order(now, telegram, out),
            Input::Order(Order::Abort) => {
                if self.busy() {
                    out.take_back();
                    self.state = State::Idle;
                    out.sent(Err(SendError::Aborted));
                }
            }
        }
        self.deadline()
    }

    fn busy(&self) -> bool {
        self.state != State::Idle
    }
}

/// The defect as the trace and the counters name it.
fn defect(error: FrameError) -> What {
    match error {
        FrameError::Check { computed, received } => What::BadCheck { computed, received },
        FrameError::Start(byte) | FrameError::SecondStart(byte) | FrameError::Stop(byte) => What::Unexpected(byte),
        FrameError::Length(_, second) => What::Unexpected(second),
    }
}

/// Writes the part of a frame that the program sees; returns its length. `into` has room for the longest.
fn fields(frame: Frame<'_>, into: &mut [u8]) -> usize {
    match frame {
        Frame::Single => {
            into[0] = SINGLE;
            1
        }
        Frame::Short { c, a } => {
            into[..2].copy_from_slice(&[c, a]);
            2
        }
        Frame::Long { c, a, ci, data } => {
            into[..3].copy_from_slice(&[c, a, ci]);
            into[3..3 + data.len()].copy_from_slice(data);
            3 + data.len()
        }
    }
}
