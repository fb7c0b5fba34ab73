//! The master: one order, one request, one answer. [S0 "Master-Slave-Communication"]
//!
//! An order is a request telegram. It ends when its answer, good or with an error announced by the slave, has been
//! delivered. If no valid answer came, the plain text of the [`Failure`] is delivered instead and the order ends with
//! an error (ours: with the manual only the text tells the program). A broadcast ends when its last bit has been sent.
//! "After a broadcast the master is not waiting for a respond telegram." [S0 L2309]
//!
//! The delay time runs from the last bit of the request to the first character of the answer; from then on the times of
//! [`frame`](super::frame) apply (ours). Telegrams that are not the answer do not end the wait.

use super::frame::{self, End, Receiver};
use super::pdu::{self, BROADCAST, Direction, Function, Match};
use super::{FRAME_CHARACTERS, Failure, Mode, TELEGRAM_BYTES};
use crate::machine::{
    Event, Input, Instant, LineFault, LineInput, Machine, Order, Phase, SendError, Sink, Span, What, earliest,
};

/// Configuration of [`Master`]: framing and patience.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// How telegrams are framed.
    pub frame: frame::Config,
    /// Delay time: longest wait for the first character of the answer.
    pub wait: Span,
}

impl Config {
    /// A CP 240: the delay time in milliseconds as parametrised, 0 for the automatic one.
    pub const fn cp240(frame: frame::Config, baud: u32, wait_ms: u16) -> Self {
        let wait = if wait_ms == 0 { automatic_wait(frame.mode, baud) } else { Span::from_millis(wait_ms as u64) };
        Self { frame, wait }
    }
}

/// The delay time "evaluated automatically": 50 ms + 2926000 ms / baud rate (ASCII), 5190000 ms / baud rate (RTU).
/// [S0 "Delay time"]
pub const fn automatic_wait(mode: Mode, baud: u32) -> Span {
    let per_baud = match mode {
        Mode::Ascii => Span::from_millis(2_926_000),
        Mode::Rtu => Span::from_millis(5_190_000),
    };
    let baud = if baud == 0 { 1 } else { baud as u64 };
    Span::from_millis(50).plus(per_baud.over(baud))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The line must be silent first. The wait ends at `until` at the latest.
    Silence {
        until: Instant,
    },
    /// The request is being sent.
    Output,
    /// The answer must begin before `until` and end before `end`, whatever the line does.
    Answer {
        until: Instant,
        end: Instant,
    },
}

/// A Modbus master as a machine: one order at a time.
#[derive(Clone, Debug)]
pub struct Master {
    config: Config,
    state: State,
    receiver: Receiver,
    request: [u8; TELEGRAM_BYTES],
    len: usize,
}

impl Master {
    /// A machine before its first step.
    pub fn new(config: Config) -> Self {
        let receiver = Receiver::new(config.frame.clone(), Direction::Answer);
        Self { config, state: State::Idle, receiver, request: [0; TELEGRAM_BYTES], len: 0 }
    }

    /// The configuration it was made with.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    fn request(&self) -> &[u8] {
        self.request.get(..self.len).unwrap_or(&[])
    }

    fn order(&mut self, now: Instant, order: Order<'_>, out: &mut dyn Sink) {
        match order {
            Order::Abort => {
                if self.state == State::Output {
                    out.take_back();
                }
                self.receiver.clear(now);
                if self.busy() {
                    self.state = State::Idle;
                    out.sent(Err(SendError::Aborted));
                }
            }
            Order::Send(_) if self.busy() => out.sent(Err(SendError::Busy)),
            Order::Send(telegram) => match (self.request.get_mut(..telegram.len()), telegram) {
                (None, _) => out.sent(Err(SendError::TooLong)),
                (Some(request), [address, code, ..])
                    // "Only write commands may be sent as broadcast." [S0 L2051]
                    if *address != BROADCAST || Function::of(*code).is_some_and(Function::writes) =>
                {
                    request.copy_from_slice(telegram);
                    self.len = telegram.len();
                    self.state = State::Silence { until: now + self.config.wait };
                    self.silence(now, out);
                }
                _ => out.sent(Err(SendError::NoRequest)),
            },
        }
    }

    /// Sends as soon as the line has been silent long enough.
    fn silence(&mut self, now: Instant, out: &mut dyn Sink) {
        let State::Silence { until } = self.state else { return };
        if now < self.receiver.quiet_at().min(until) {
            return;
        }
        let mut frame = [0; FRAME_CHARACTERS];
        match self.config.frame.mode.encode(self.request(), &mut frame) {
            Some(len) => {
                self.receiver.clear(now);
                self.state = State::Output;
                out.transmit(frame.get(..len).unwrap_or(&[]));
            }
            // Impossible: the length was checked with the order.
            None => self.end(Err(SendError::TooLong), out),
        }
    }

    fn tx_done(&mut self, now: Instant, out: &mut dyn Sink) {
        if self.state != State::Output {
            return;
        }
        self.receiver.clear(now);
        if self.request().first() == Some(&BROADCAST) {
            return self.end(Ok(()), out);
        }
        let until = now + self.config.wait;
        // Twice the longest telegram, and its last pause: a partner that never falls silent does not prolong the order
        // for ever.
        let frame = &self.config.frame;
        let end = until + 2 * FRAME_CHARACTERS as u64 * (frame.char_time + frame.gap) + frame.patience;
        self.state = State::Answer { until, end };
    }

    fn received(&mut self, now: Instant, mut bytes: &[u8], out: &mut dyn Sink) {
        self.receiver.chunk(now, bytes.len());
        while let Some(end) = self.receiver.take(now, &mut bytes) {
            self.ended(end, out);
        }
    }

    /// A telegram has ended.
    fn ended(&mut self, end: End, out: &mut dyn Sink) {
        if !matches!(self.state, State::Answer { .. }) {
            // No request is pending, or the answer came too late.
            return;
        }
        let failure = match end {
            Err(failure) => failure,
            Ok(()) => match pdu::matches(self.request(), self.receiver.telegram(), self.config.frame.register_bytes) {
                Match::Answer => return self.answered(out),
                Match::Foreign => return,
                Match::Short => Failure::Incomplete,
                Match::Long => Failure::Overflow,
            },
        };
        self.fail(failure, out);
    }

    fn answered(&mut self, out: &mut dyn Sink) {
        let answer = self.receiver.telegram();
        if out.room() < answer.len() {
            // "... because either the receive buffer is full ..." [S0 "Master doesn't receive valid data"]
            return self.fail(Failure::DataLost, out);
        }
        out.deliver(answer);
        self.end(Ok(()), out);
    }

    /// "The master enters an error message into the receive block in plain text."
    /// [S0 "Master doesn't receive valid data"]
    fn fail(&mut self, failure: Failure, out: &mut dyn Sink) {
        out.report(Event { phase: Phase::Acknowledge, what: What::Modbus(failure) });
        if out.room() < failure.telegram().len() {
            out.report(Event { phase: Phase::Acknowledge, what: What::NoBuffer });
        } else {
            out.deliver(failure.telegram());
        }
        self.end(Err(failure.into()), out);
    }

    fn end(&mut self, outcome: Result<(), SendError>, out: &mut dyn Sink) {
        self.state = State::Idle;
        out.sent(outcome);
    }

    fn fault(&mut self, now: Instant, fault: LineFault, out: &mut dyn Sink) {
        out.report(Event { phase: self.phase(), what: What::Line(fault) });
        match fault {
            // The telegram being received is dropped; the delay time continues.
            LineFault::Gone | LineFault::Back => self.receiver.clear(now),
            _ => self.receiver.unreadable(now),
        }
    }

    fn phase(&self) -> Phase {
        match self.state {
            State::Answer { .. } if self.receiver.is_open() => Phase::Receive,
            State::Idle | State::Silence { .. } => Phase::Idle,
            State::Output => Phase::Output,
            State::Answer { .. } => Phase::Acknowledge,
        }
    }

    fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        if let Some(end) = self.receiver.tick(now) {
            self.ended(end, out);
        }
        match self.state {
            State::Silence { .. } => self.silence(now, out),
            // "No telegram arrived within the specified delay time." [S0 "Master doesn't receive valid data"]
            State::Answer { until, .. } if now >= until && !self.receiver.is_open() => self.fail(Failure::NoData, out),
            // "The telegram end wasn't recognized."
            State::Answer { end, .. } if now >= end => {
                self.receiver.clear(now);
                self.fail(Failure::Overflow, out);
            }
            _ => {}
        }
    }

    fn deadline(&self) -> Option<Instant> {
        let own = match self.state {
            State::Idle | State::Output => None,
            State::Silence { until } => Some(self.receiver.quiet_at().min(until)),
            State::Answer { end, .. } if self.receiver.is_open() => Some(end),
            State::Answer { until, .. } => Some(until),
        };
        earliest([own, self.receiver.deadline()])
    }
}

impl Machine for Master {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match input {
            Input::Tick => self.tick(now, out),
            // Characters received while we send are our own echo, or noise.
            Input::Line(LineInput::Rx(_)) if matches!(self.state, State::Output) => {}
            Input::Line(LineInput::Rx(bytes)) => self.received(now, bytes, out),
            Input::Line(LineInput::TxDone) => self.tx_done(now, out),
            Input::Line(LineInput::Fault(fault)) => self.fault(now, fault, out),
            Input::Line(LineInput::Modem(_)) => {}
            Input::Order(order) => self.order(now, order, out),
        }
        self.deadline()
    }

    fn busy(&self) -> bool {
        self.state != State::Idle
    }
}
