//! The data a protocol works on during one step (receive buffer, job of the partner, errors, LEDs), and where it puts
//! its results.

use std::mem;

use ob1_params::CpKind;
use ob1_protocols::rk512::{self, AnswerError, OrderError, Request};
use ob1_protocols::{Event, Instant, LineFault, Phase, SendError, Sink, Span, What, Wire};

use super::leds::LedDriver;
use super::model::JOB_MAX;
use crate::port::{Counter, CpEvent, CpPort, counted};
use crate::ring::{BYTES_341, Ring};

/// Maximum number of errors that P_RCV_RK has not been told yet.
const UNTOLD_MAX: usize = 8;

/// The parts of the CP that a protocol reaches.
#[derive(Debug)]
pub(crate) struct Parts {
    kind: CpKind,
    pub(crate) ring: Ring<BYTES_341>,
    /// RK 512: the job of the partner that waits for the CPU.
    pub(crate) asked: Asked,
    /// Errors to report to P_RCV_RK.
    pub(crate) untold: Untold,
    pub(crate) leds: LedDriver,
    /// First error of the job that is with the protocol. [TIA help "PtP data link CP 341"]
    pub(crate) first_error: Option<u16>,
    /// The line is gone, or was never there.
    pub(crate) line_gone: bool,
    /// BREAK (080Dh), and no character since.
    pub(crate) interrupted: bool,
    /// The oldest telegram of the buffer is on offer to P_RCV_RK.
    pub(crate) on_offer: bool,
    /// The partner does not repeat a telegram that could not be read: ASCII.
    pub(crate) heard_once: bool,
    /// First error of the telegram that is being received.
    receive_error: Option<u16>,
    /// The unreadable character or BREAK that came last: entry and time.
    burst: Option<(u16, Instant)>,
    /// Such characters belong together if no more than this time lies between two of them.
    pub(crate) burst_gap: Span,
    fetched: Box<[u8; JOB_MAX]>,
}

impl Parts {
    pub(crate) fn new(kind: CpKind) -> Self {
        Self {
            kind,
            ring: Ring::new(),
            asked: Asked::new(),
            untold: Untold::default(),
            leds: LedDriver::new(),
            first_error: None,
            line_gone: false,
            interrupted: false,
            on_offer: false,
            heard_once: false,
            receive_error: None,
            burst: None,
            burst_gap: Span::ZERO,
            fetched: Box::new([0; JOB_MAX]),
        }
    }

    /// `taking`: P_RCV_RK is called, and wants to hear of errors.
    pub(crate) fn outlet<'a>(&'a mut self, now: Instant, taking: bool, port: &'a mut dyn CpPort) -> Outlet<'a> {
        Outlet { now, taking, parts: self, port, collected: Collected::default() }
    }

    /// Data of the FETCH that has ended.
    pub(crate) fn fetched(&self, len: usize) -> &[u8] {
        &self.fetched[..len]
    }
}

/// A job of the partner that waits for P_RCV_RK.
#[derive(Debug)]
pub(crate) struct Asked {
    request: Option<Request>,
    data: Box<[u8; JOB_MAX]>,
    len: usize,
}

impl Asked {
    fn new() -> Self {
        Self { request: None, data: Box::new([0; JOB_MAX]), len: 0 }
    }

    fn put(&mut self, request: &Request, data: &[u8]) {
        self.len = data.len().min(JOB_MAX);
        self.data[..self.len].copy_from_slice(&data[..self.len]);
        self.request = Some(*request);
    }

    /// The job to offer, with the data of a SEND.
    pub(crate) fn open(&self) -> Option<(&Request, &[u8])> {
        Some((self.request.as_ref()?, &self.data[..self.len]))
    }

    /// The job has ended; true if it still waited.
    pub(crate) fn close(&mut self) -> bool {
        self.request.take().is_some()
    }
}

/// A few numbers, oldest first; what does not fit is dropped (it is in the diagnostic buffer).
#[derive(Debug, Default)]
pub(crate) struct Untold {
    numbers: [u16; UNTOLD_MAX],
    count: usize,
}

impl Untold {
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    fn push(&mut self, number: u16) {
        if let Some(place) = self.numbers.get_mut(self.count) {
            *place = number;
            self.count += 1;
        }
    }

    /// The last number is reported in another way.
    pub(crate) fn forget(&mut self, number: u16) {
        if self.count > 0 && self.numbers[self.count - 1] == number {
            self.count -= 1;
        }
    }

    pub(crate) fn take(&mut self) -> Option<u16> {
        let first = (self.count > 0).then_some(self.numbers[0])?;
        self.numbers.rotate_left(1);
        self.count -= 1;
        Some(first)
    }
}

/// What a step has ended.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Collected {
    /// The own job: bytes fetched, or STATUS.
    pub(crate) ended: Option<Result<usize, u16>>,
    /// The protocol has switched RTS.
    pub(crate) rts: Option<bool>,
    /// It has switched DTR.
    pub(crate) dtr: Option<bool>,
    /// The job of the partner; true if it still waited for the block.
    pub(crate) answered: Option<(Result<(), AnswerError>, bool)>,
}

/// Where the protocol puts its results during one step.
pub(crate) struct Outlet<'a> {
    pub(super) now: Instant,
    taking: bool,
    pub(super) parts: &'a mut Parts,
    pub(super) port: &'a mut dyn CpPort,
    pub(crate) collected: Collected,
}

impl Outlet<'_> {
    pub(super) fn enter(&mut self, number: u16) {
        match number {
            0x080D => self.parts.interrupted = true,
            0x0818 => self.parts.leds.signals_missing(true),
            _ => {}
        }
        if !self.is_of_burst(number) {
            self.port.event(self.now, CpEvent::Entry(number));
        }
    }

    /// The same fault, character after character, is one entry: otherwise a burst would fill the buffer. (ours)
    fn is_of_burst(&mut self, number: u16) -> bool {
        if !matches!(number, 0x080C | 0x080D | 0x0810 | 0x0811) {
            return false;
        }
        let before = self.parts.burst.replace((number, self.now));
        before.is_some_and(|(same, at)| same == number && self.now <= at + self.parts.burst_gap)
    }

    fn tell(&mut self, number: u16) {
        if self.taking {
            self.parts.untold.push(number);
        }
    }

    /// A receive error: reported to P_RCV_RK if it costs a telegram.
    fn receive_error(&mut self, event: Event, number: u16) {
        let first = self.parts.receive_error.unwrap_or(number);
        let lost = match event.what {
            What::CharacterDelay | What::Restarted | What::NoBuffer | What::TooLong | What::Signals => true,
            What::Line(_) => self.parts.heard_once && event.phase == Phase::Receive,
            _ => false,
        };
        if lost {
            self.parts.receive_error = None;
            self.tell(first);
        } else if event.phase == Phase::Receive {
            // Characters between two telegrams belong to neither.
            self.parts.receive_error = Some(first);
        }
    }
}

/// Event number of the CP 341: NAK during output is one of the "characters received while sending"; 0705h is the CP
/// 441's. (docs/cp341-events.md)
fn number(event: Event) -> Option<u16> {
    match event.number() {
        Some(0x0705) => Some(0x0704),
        number => number,
    }
}

/// Event number of the CP 340, which has some of its own. [TIA help "PtP data link CP 340", "STATUS parameter"]
fn number_340(event: Event, is_ascii: bool) -> Option<u16> {
    match event.what {
        What::TooLong => Some(0x050E),
        What::Line(LineFault::Parity) if is_ascii => Some(0x0810),
        What::Line(LineFault::Framing) if is_ascii => Some(0x0811),
        _ => event.number(),
    }
}

impl Wire for Outlet<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        // What happens to a job is entered for this job.
        self.parts.burst = None;
        self.parts.leds.transmit(true);
        self.port.put_out(bytes);
    }

    fn take_back(&mut self) -> usize {
        self.port.take_back()
    }

    fn rts(&mut self, on: bool) {
        self.collected.rts = Some(on);
        self.port.rts(on);
    }

    fn dtr(&mut self, on: bool) {
        self.collected.dtr = Some(on);
        self.port.dtr(on);
    }
}

impl Sink for Outlet<'_> {
    fn room(&self) -> usize {
        self.parts.ring.room()
    }

    fn deliver(&mut self, telegram: &[u8]) {
        self.parts.receive_error = None;
        if self.parts.ring.overwrites() && self.parts.ring.telegrams() > 0 && !mem::take(&mut self.parts.on_offer) {
            // A telegram on offer is counted when P_RCV_RK takes or refuses it.
            self.port.count(Counter::ReceiveAborted, 1);
        }
        let is_stored = self.parts.ring.push(telegram);
        self.port.received(self.now, telegram, is_stored);
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        if outcome == Err(SendError::NoEnd) {
            self.enter(0x050E);
        }
        let first = self.parts.first_error;
        self.collected.ended = Some(outcome.map(|()| 0).map_err(|error| match error {
            SendError::TooLong => 0x0518,
            SendError::NoEnd => 0x050E,
            SendError::Signals => first.unwrap_or(0x0818),
            SendError::Aborted => first.unwrap_or(0x0501),
            SendError::Busy => 0x0501,
            // The job ends with its first error. [TIA help "PtP data link CP 341"]
            SendError::AckDelay => first.unwrap_or(0x0708),
            SendError::Repetitions | SendError::Frame | SendError::NoRequest => first.unwrap_or(0x070A),
        }));
    }

    fn report(&mut self, event: Event) {
        if let Some(counter) = counted(event.what) {
            self.port.count(counter, 1);
        }
        // The block is given up.
        if matches!((event.what, event.phase), (What::NoRepetition, _) | (What::Exhausted, Phase::Receive))
            && let Some(first) = self.parts.receive_error.take()
        {
            self.tell(first);
        }
        let number = match self.parts.kind {
            CpKind::Cp340 => number_340(event, self.parts.heard_once),
            _ => number(event),
        };
        if let Some(number) = number {
            self.enter(number);
            match event.phase {
                // Information, and the two numbers that mean "used up", do not count as first error.
                _ if matches!(number, 0x0701 | 0x0709 | 0x070A | 0x0801 | 0x0815) => {}
                Phase::Connect | Phase::Output | Phase::Acknowledge => {
                    self.parts.first_error.get_or_insert(number);
                }
                Phase::Idle | Phase::Receive => self.receive_error(event, number),
            }
        }
    }
}

impl rk512::Owner for Outlet<'_> {
    fn ended(&mut self, outcome: Result<&[u8], OrderError>) {
        self.collected.ended = Some(match outcome {
            Ok(data) => {
                let len = data.len().min(JOB_MAX);
                self.parts.fetched[..len].copy_from_slice(&data[..len]);
                Ok(len)
            }
            Err(OrderError::TooLong | OrderError::Invalid) => Err(0x0518),
            Err(error) => Err(error.number().unwrap_or(0x0501)),
        });
    }

    fn asked(&mut self, request: &Request, data: &[u8]) {
        self.parts.asked.put(request, data);
        self.port.count(Counter::TelegramsReceived, 1);
        self.port.event(self.now, CpEvent::Asked(request, data));
    }

    fn answered(&mut self, outcome: Result<(), AnswerError>) {
        // Closed now: the partner's next job may show that it has our reaction, and begins in the same step.
        self.collected.answered = Some((outcome, self.parts.asked.close()));
    }

    fn report(&mut self, event: rk512::Event) {
        match event {
            rk512::Event::Line(event) => Sink::report(self, event),
            // Entered where the block's refusal is evaluated.
            rk512::Event::RefusedByCpu(_) => {}
            other => {
                if let Some(number) = other.number() {
                    self.enter(number);
                }
                // A part of an order that was acknowledged but whose rest never came is a lost telegram.
                if let (rk512::Event::Refused(_) | rk512::Event::Abandoned, Some(number)) = (other, other.number()) {
                    self.port.count(Counter::ReceiveErrors, 1);
                    self.tell(number);
                }
            }
        }
    }
}
