//! The slave, "short" and "long": it answers from its [`Areas`], and passes the master's writes to the CPU.
//!
//! "The CP 240 only reports a respond telegram to the master after all data has been received." [S0 L2082]: with
//! [`Config::confirmed`] the answer to a write waits until the CPU has taken every block that has changed. If somebody
//! sends in the meantime, the master has given up, and the answer is dropped: it would collide with another telegram.

use core::ops::Range;

use super::area::{AREA_BYTES, Areas, Change, SHORT_BYTES};
use super::frame::{self, End, Receiver};
use super::pdu::{BROADCAST, Direction, ERROR_BIT, Exception, Function, Request};
use super::{FRAME_CHARACTERS, TELEGRAM_BYTES};
use crate::machine::{Event, Input, Instant, LineFault, LineInput, Machine, Order, Phase, SendError, Sink, What};

/// Configuration of [`Slave`]: framing, address, areas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// How telegrams are framed.
    pub frame: frame::Config,
    /// The slave's address, 1 to 255.
    pub address: u8,
    /// Bytes of each area.
    pub area_bytes: usize,
    /// Writes are answered only when the CPU has taken the data.
    pub confirmed: bool,
}

impl Config {
    /// "Slave short": 16 bytes each way, in the process image itself.
    pub const fn short(frame: frame::Config, address: u8) -> Self {
        Self { frame, address, area_bytes: SHORT_BYTES, confirmed: false }
    }

    /// "Slave long": 1024 bytes each way, exchanged by SEND and RECEIVE.
    pub const fn long(frame: frame::Config, address: u8) -> Self {
        Self { frame, address, area_bytes: AREA_BYTES, confirmed: true }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Listen,
    /// The answer is ready; the CPU does not have all data yet.
    Held,
    /// The answer is being sent.
    Output,
}

/// A Modbus slave as a machine.
#[derive(Clone, Debug)]
pub struct Slave {
    config: Config,
    state: State,
    receiver: Receiver,
    areas: Areas,
    /// The CPU has a change that it has not confirmed.
    with_cpu: Option<Change>,
    /// The bytes of the output area that the request being answered has written.
    written: Range<usize>,
    answer: [u8; TELEGRAM_BYTES],
    len: usize,
}

impl Slave {
    /// A machine before its first step.
    pub fn new(config: Config) -> Self {
        let receiver = Receiver::new(config.frame.clone(), Direction::Request);
        let areas = Areas::new(config.area_bytes);
        let answer = [0; TELEGRAM_BYTES];
        Self { config, state: State::Listen, receiver, areas, with_cpu: None, written: 0..0, answer, len: 0 }
    }

    /// The configuration it was made with.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// The two areas as they are now.
    pub const fn areas(&self) -> &Areas {
        &self.areas
    }

    /// The CPU's data for the input area; false if there are more than fit.
    pub fn set_input(&mut self, bytes: &[u8]) -> bool {
        self.areas.set_input(bytes)
    }

    /// The CPU's data for the output area; false if there are more than fit.
    pub fn set_output(&mut self, bytes: &[u8]) -> bool {
        self.areas.set_output(bytes)
    }

    /// The next change for the CPU, unless it still has to confirm the last one.
    pub fn take_change(&mut self) -> Option<Change> {
        if self.with_cpu.is_some() {
            return None;
        }
        self.with_cpu = self.areas.take_change();
        self.with_cpu
    }

    /// The CPU has stored the change, or refuses it because its own area is too short. Follow with [`Input::Tick`].
    pub fn change_taken(&mut self, stored: bool) {
        let Some(change) = self.with_cpu.take() else { return };
        self.areas.close_change(change, stored);
        // A broadcast, or a write that the master has given up, may have been refused instead of this one.
        let is_of_it = change.first < self.written.end && self.written.start < change.first + change.bytes;
        if !stored && self.state == State::Held && is_of_it {
            // "Writing master accesses must not lie outside of the reception area!" [S0 L2074]
            self.refuse(Exception::Address);
        }
    }

    fn received(&mut self, now: Instant, mut bytes: &[u8], out: &mut dyn Sink) {
        self.receiver.chunk(now, bytes.len());
        while !bytes.is_empty() {
            match self.state {
                State::Listen => {}
                // The master has given up.
                State::Held => self.state = State::Listen,
                // Characters received while we answer are our own echo, or noise.
                State::Output => return,
            }
            let Some(end) = self.receiver.take(now, &mut bytes) else { return };
            self.ended(now, end, out);
        }
    }

    /// A telegram has ended.
    fn ended(&mut self, now: Instant, end: End, out: &mut dyn Sink) {
        if let Err(failure) = end {
            // A slave does not answer a telegram that it could not read.
            return out.report(Event { phase: Phase::Receive, what: What::Modbus(failure) });
        }
        let telegram = self.receiver.telegram();
        let [address, code, ..] = *telegram else { return };
        if address != self.config.address && address != BROADCAST {
            return;
        }
        let request = Request::parse(telegram);
        if address == BROADCAST {
            // Only writes are carried out, and without an answer. [S0 L2051]
            if let Ok(request) = request
                && Function::of(code).is_some_and(Function::writes)
            {
                let _nobody_to_tell = self.areas.serve(&request, &mut []);
            }
            return;
        }
        self.answer[..2].copy_from_slice(&[address, code]);
        self.written = request.map_or(0..0, |request| request.written());
        match request.and_then(|request| self.areas.serve(&request, &mut self.answer[2..])) {
            // Writes: the four bytes after the function code are returned. [S0 "Modbus - Function codes"]
            Ok(0) => {
                self.answer[2..6].copy_from_slice(telegram.get(2..6).unwrap_or(&[0; 4]));
                self.len = 6;
            }
            Ok(bytes) => self.len = 2 + bytes,
            Err(exception) => self.refuse(exception),
        }
        self.state = State::Held;
        self.release(now, out);
    }

    /// "Function code OR 80h" [S0 "Respond of the slave"], and why.
    fn refuse(&mut self, exception: Exception) {
        self.answer[1] |= ERROR_BIT;
        self.answer[2] = exception as u8;
        self.len = 3;
    }

    /// Answers, unless the CPU still has to take data.
    fn release(&mut self, now: Instant, out: &mut dyn Sink) {
        let waits = self.config.confirmed && (self.with_cpu.is_some() || self.areas.has_changes());
        let writes = self.answer.get(1).copied().and_then(Function::of).is_some_and(Function::writes);
        if self.state != State::Held || (waits && writes) {
            return;
        }
        let mut frame = [0; FRAME_CHARACTERS];
        let len = self.config.frame.mode.encode(self.answer.get(..self.len).unwrap_or(&[]), &mut frame);
        self.receiver.clear(now);
        self.state = State::Output;
        out.transmit(frame.get(..len.unwrap_or(0)).unwrap_or(&[]));
    }

    fn order(&mut self, now: Instant, order: Order<'_>, out: &mut dyn Sink) {
        match order {
            // "An area starting at 0 is stored in the CP where the master may gain access." [S0 L2277]
            Order::Send(data) => {
                let stored = self.areas.set_input(data);
                out.sent(if stored { Ok(()) } else { Err(SendError::TooLong) });
            }
            Order::Abort => {
                if self.state == State::Output {
                    out.take_back();
                }
                self.receiver.clear(now);
                self.state = State::Listen;
            }
        }
    }

    fn fault(&mut self, now: Instant, fault: LineFault, out: &mut dyn Sink) {
        let phase = if self.receiver.is_open() { Phase::Receive } else { Phase::Idle };
        out.report(Event { phase, what: What::Line(fault) });
        match fault {
            LineFault::Gone | LineFault::Back => self.receiver.clear(now),
            // Our own echo.
            _ if self.state == State::Output => {}
            _ => {
                self.state = State::Listen;
                self.receiver.unreadable(now);
            }
        }
    }
}

impl Machine for Slave {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match input {
            Input::Tick => {
                if let Some(end) = self.receiver.tick(now) {
                    self.ended(now, end, out);
                }
                self.release(now, out);
            }
            Input::Line(LineInput::Rx(bytes)) => self.received(now, bytes, out),
            Input::Line(LineInput::TxDone) if self.state == State::Output => {
                self.receiver.clear(now);
                self.state = State::Listen;
            }
            Input::Line(LineInput::TxDone) | Input::Line(LineInput::Modem(_)) => {}
            Input::Line(LineInput::Fault(fault)) => self.fault(now, fault, out),
            Input::Order(order) => self.order(now, order, out),
        }
        self.receiver.deadline()
    }

    /// Never busy: the CPU's data are stored at once.
    fn busy(&self) -> bool {
        false
    }
}
