//! One request on a line and its outcome: Modbus TCP by its transactions, Modbus RTU by the master of the serial
//! protocols.

use core::convert::Infallible;

use ob1_protocols::modbus::pdu::{self, Match};
use ob1_protocols::modbus::{Master, Mode, TELEGRAM_BYTES, frame, master, tcp};
use ob1_protocols::{Event, Input, LineFault, LineInput, Machine as _, Order, SendError, Sink, Wire as LineEnd};

use crate::config::{Instant, LineConfig, Serial, Span};

/// What happened: time has passed or the outputs have changed ([`Input::Tick`]), or something on the line. An open
/// connection counts as a line that is back. The outputs come as an image, so there are no orders.
pub type MasterInput<'a> = Input<'a, Infallible>;

/// How late a device may hand over characters: a UART with a FIFO, a USB adapter.
const BURSTS: Span = Span::from_millis(20);

/// The outcome of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Its answer, good or an exception.
    Answer(Vec<u8>),
    /// No usable answer: silence, a damaged answer, or no connection.
    Failed,
}

pub(crate) enum Wire {
    Tcp(Box<Tcp>),
    Serial(Box<Rtu>),
}

impl Wire {
    pub(crate) fn new(config: &LineConfig) -> Self {
        match &config.serial {
            None => Self::Tcp(Box::new(Tcp::new(config.timeout))),
            Some(serial) => Self::Serial(Box::new(Rtu::new(serial, config.timeout))),
        }
    }

    /// Sends a request; one at a time.
    pub(crate) fn ask(&mut self, now: Instant, telegram: &[u8], out: &mut Vec<u8>) -> Option<Outcome> {
        match self {
            Self::Tcp(tcp) => tcp.ask(now, telegram, out),
            Self::Serial(rtu) => rtu.step(now, Input::Order(Order::Send(telegram)), out),
        }
    }

    /// Takes an event of the line; returns the outcome of the request if it has ended.
    pub(crate) fn step(&mut self, now: Instant, input: MasterInput<'_>, out: &mut Vec<u8>) -> Option<Outcome> {
        match self {
            Self::Tcp(tcp) => tcp.step(now, input),
            Self::Serial(rtu) => {
                let input = match input {
                    Input::Tick => Input::Tick,
                    Input::Line(LineInput::Fault(LineFault::Gone)) => Input::Order(Order::Abort),
                    Input::Line(line) => Input::Line(line),
                };
                rtu.step(now, input, out)
            }
        }
    }

    pub(crate) fn deadline(&self) -> Option<Instant> {
        match self {
            Self::Tcp(tcp) => tcp.pending.as_ref().map(|pending| pending.until),
            Self::Serial(rtu) => rtu.deadline,
        }
    }

    /// Whether the stream of bytes has lost its framing: it must be reopened.
    pub(crate) fn is_broken(&self) -> bool {
        matches!(self, Self::Tcp(tcp) if tcp.broken)
    }

    /// Whether the line is a connection that can be closed and opened.
    pub(crate) const fn is_connection(&self) -> bool {
        matches!(self, Self::Tcp(_))
    }
}

struct Pending {
    transaction: u16,
    until: Instant,
    request: Vec<u8>,
}

pub(crate) struct Tcp {
    timeout: Span,
    transaction: u16,
    pending: Option<Pending>,
    receiver: tcp::Receiver,
    broken: bool,
}

impl Tcp {
    fn new(timeout: Span) -> Self {
        Self { timeout, transaction: 0, pending: None, receiver: tcp::Receiver::new(), broken: false }
    }

    fn ask(&mut self, now: Instant, telegram: &[u8], out: &mut Vec<u8>) -> Option<Outcome> {
        let mut frame = [0; tcp::FRAME_BYTES];
        // Never the number of the previous request, whose answer may come late.
        self.transaction = self.transaction.wrapping_add(1);
        let Some(len) = tcp::encode(self.transaction, telegram, &mut frame) else { return Some(Outcome::Failed) };
        out.extend_from_slice(&frame[..len]);
        let until = now.saturating_add(self.timeout);
        self.pending = Some(Pending { transaction: self.transaction, until, request: telegram.to_vec() });
        None
    }

    fn step(&mut self, now: Instant, input: MasterInput<'_>) -> Option<Outcome> {
        match input {
            Input::Line(LineInput::Rx(bytes)) => return self.received(bytes),
            Input::Line(LineInput::Fault(LineFault::Back | LineFault::Gone)) => {
                self.receiver.clear();
                (self.pending, self.broken) = (None, false);
            }
            Input::Tick if self.pending.as_ref().is_some_and(|pending| now >= pending.until) => {
                self.pending = None;
                return Some(Outcome::Failed);
            }
            Input::Tick | Input::Line(_) => {}
        }
        None
    }

    fn received(&mut self, bytes: &[u8]) -> Option<Outcome> {
        let mut outcome = None;
        for byte in bytes.iter().take(if self.broken { 0 } else { bytes.len() }) {
            match self.receiver.byte(*byte) {
                Ok(false) => {}
                Ok(true) => outcome = outcome.or_else(|| self.telegram()),
                Err(_) => {
                    self.broken = true;
                    return outcome.or_else(|| self.pending.take().map(|_| Outcome::Failed));
                }
            }
        }
        outcome
    }

    fn telegram(&mut self) -> Option<Outcome> {
        let (transaction, answer) = self.receiver.telegram()?;
        // An answer that came too late is ignored.
        let pending = self.pending.take_if(|pending| pending.transaction == transaction)?;
        Some(match pdu::matches(&pending.request, answer, pdu::REGISTER_BYTES) {
            Match::Answer => Outcome::Answer(answer.to_vec()),
            Match::Foreign | Match::Short | Match::Long => Outcome::Failed,
        })
    }
}

pub(crate) struct Rtu {
    master: Master,
    deadline: Option<Instant>,
}

impl Rtu {
    fn new(serial: &Serial, timeout: Span) -> Self {
        let frame = frame::Config::new(Mode::Rtu, serial.baud, serial.settings().char_time()).with_bursts(BURSTS);
        Self { master: Master::new(master::Config { frame, wait: timeout }), deadline: None }
    }

    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut Vec<u8>) -> Option<Outcome> {
        let mut output = MasterOutput { out, answer: None, sent: None };
        self.deadline = self.master.step(now, input, &mut output);
        match (output.sent?, output.answer) {
            (Ok(()), Some(answer)) => Some(Outcome::Answer(answer)),
            _ => Some(Outcome::Failed),
        }
    }
}

/// Collects the output of the serial master.
struct MasterOutput<'a> {
    out: &'a mut Vec<u8>,
    answer: Option<Vec<u8>>,
    sent: Option<Result<(), SendError>>,
}

impl LineEnd for MasterOutput<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.out.extend_from_slice(bytes);
    }
}

impl Sink for MasterOutput<'_> {
    fn room(&self) -> usize {
        TELEGRAM_BYTES
    }

    fn deliver(&mut self, telegram: &[u8]) {
        self.answer = Some(telegram.to_vec());
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.sent = Some(outcome);
    }

    fn report(&mut self, _event: Event) {}
}
