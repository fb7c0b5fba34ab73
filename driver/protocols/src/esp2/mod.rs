//! EnOcean over the serial protocol version 2 of its transceiver TCM 120, as the CP 240 EnOcean speaks it with the
//! module inside it. [S1 "Kommunikationsprinzip"]
//!
//! * [`frame`]: fourteen bytes on the line, eleven for the program.
//! * [`telegram`], [`radio`]: every telegram of the manuals, typed.
//!
//! The machine passes telegrams on in both directions. It uses only one item in them, the ID base: at its start it asks
//! the module for it (RD_IDBASE), and ORs the lower 7 bits of the IDs that the program sends with it.

pub mod frame;
mod queue;
pub mod radio;
pub mod telegram;

use crate::machine::{
    Event, Input, Instant, LineFault, LineInput, MS, Machine, Order, Phase, SendError, Sink, Span, What,
};
use frame::{Bytes, Decoder, Step, TELEGRAM_BYTES, encode};
pub use frame::{FRAME_BYTES, WAKE};
pub use queue::SEND_TELEGRAMS;
use queue::{Outgoing, Queue};
pub use radio::{Button, Radio, Switch};
pub use telegram::{Command, Field, Message, Telegram};

/// Attempts to learn the ID base.
const ATTEMPTS: u8 = 3;

/// The bits of an ID that are the program's. [S1 "Modul ersetzen und IDBase übernehmen"]
const OWN_BITS: u32 = 0x7F;

/// Times of [`Esp2`]; the manual has none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Longest wait for the answer to the question for the ID base, nanoseconds.
    pub answer: Span,
    /// A pause this long within a frame ends it, nanoseconds. A tty or a network delivers characters in pieces.
    pub gap: Span,
}

impl Config {
    /// 250 ms each: a telegram takes 15 ms at 9600 baud.
    pub fn cp240() -> Self {
        Self { answer: 250 * MS, gap: 250 * MS }
    }
}

/// State of the module's ID base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Base {
    /// The module was not asked for it yet.
    Unasked,
    /// Asked, for the n-th time; nothing else is sent until then.
    Asked { attempt: u8, until: Instant },
    /// Known; only the upper 25 bits.
    Known(u32),
    /// The module does not answer: IDs go out as the program has written them.
    Untold,
}

/// The EnOcean side of the CP.
#[derive(Clone, Debug)]
pub struct Esp2 {
    config: Config,
    base: Base,
    /// Our output is leaving.
    leaving: bool,
    queue: Queue,
    /// An order that waits for a place in the send buffer.
    held: Option<Outgoing>,
    decoder: Decoder,
    /// An incomplete frame is given up at this time.
    gap_until: Instant,
    /// Noise has been reported once.
    noise: bool,
}

impl Esp2 {
    /// At a quiet line, the ID base unknown.
    pub const fn new(config: Config) -> Self {
        Self {
            config,
            base: Base::Unasked,
            leaving: false,
            queue: Queue::new(),
            held: None,
            decoder: Decoder::new(),
            gap_until: Instant::START,
            noise: false,
        }
    }

    /// The ID base that goes into sent telegrams, once it is known.
    pub const fn id_base(&self) -> Option<u32> {
        match self.base {
            Base::Known(base) => Some(base),
            _ => None,
        }
    }

    /// Telegrams in the send buffer.
    pub const fn waiting(&self) -> usize {
        self.queue.len()
    }

    fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        match self.base {
            Base::Unasked => self.ask(now, 1, out),
            Base::Asked { attempt, until } if now >= until => {
                if attempt < ATTEMPTS {
                    out.report(Event { phase: Phase::Connect, what: What::Repetition(attempt.into()) });
                    self.ask(now, attempt + 1, out);
                } else {
                    out.report(Event { phase: Phase::Connect, what: What::AckDelay });
                    self.base = Base::Untold;
                }
            }
            _ => {}
        }
        if self.decoder.is_open() && now >= self.gap_until {
            self.decoder.reset();
            out.report(Event { phase: Phase::Receive, what: What::CharacterDelay });
        }
        self.output(out);
    }

    /// Asks for the ID base. The module may be asleep. The reset of the CP 240 resets it by wire; here WAKE wakes it.
    fn ask(&mut self, now: Instant, attempt: u8, out: &mut dyn Sink) {
        if attempt > 1 {
            out.transmit(&[WAKE]);
        }
        out.transmit(&encode(&Telegram::Command(Command::RdIdBase).emit()));
        self.leaving = true;
        self.base = Base::Asked { attempt, until: now + self.config.answer };
    }

    fn order(&mut self, telegram: &[u8], out: &mut dyn Sink) {
        if self.held.is_some() {
            return out.sent(Err(SendError::Busy));
        }
        let Some(outgoing) = Outgoing::of(telegram) else {
            let error = if telegram.len() > TELEGRAM_BYTES { SendError::TooLong } else { SendError::Frame };
            return out.sent(Err(error));
        };
        // "... stored in the send buffer. If this has happened the CP answers with 0": the order is done.
        // [S1 "Beispiel Daten senden ohne Hantierungsbaustein"]
        if self.queue.push(outgoing) {
            out.sent(Ok(()));
        } else {
            self.held = Some(outgoing);
        }
        self.output(out);
    }

    /// "The telegrams stored in the send buffer are immediately transmitted." One at a time, so that waiting telegrams
    /// can still be dropped.
    fn output(&mut self, out: &mut dyn Sink) {
        if self.leaving || matches!(self.base, Base::Unasked | Base::Asked { .. }) {
            return;
        }
        let Some(next) = self.queue.pop() else { return };
        self.leaving = true;
        match next {
            Outgoing::Wake => out.transmit(&[WAKE]),
            Outgoing::Telegram(telegram) => out.transmit(&encode(&self.with_base(telegram))),
        }
        if self.held.take_if(|held| self.queue.push(*held)).is_some() {
            out.sent(Ok(()));
        }
    }

    /// "Only the last 7 bits are relevant and are ORed in the CP 240 with the ID base stored there." [S1 L1640]
    fn with_base(&self, mut telegram: Bytes) -> Bytes {
        if let Base::Known(base) = self.base
            && telegram[0] == telegram::TRANSMIT
            && radio::has_id(telegram[1])
            && let Some(id) = telegram[6..].first_chunk_mut::<4>()
        {
            *id = (base | u32::from_be_bytes(*id) & OWN_BITS).to_be_bytes();
        }
        telegram
    }

    fn receive(&mut self, now: Instant, bytes: &[u8], out: &mut dyn Sink) {
        for byte in bytes {
            match self.decoder.feed(*byte) {
                Step::More => {}
                Step::Noise(byte) => {
                    if !core::mem::replace(&mut self.noise, true) {
                        out.report(Event { phase: Phase::Idle, what: What::Unexpected(byte) });
                    }
                }
                Step::Wrong { computed, received } => {
                    out.report(Event { phase: Phase::Receive, what: What::BadCheck { computed, received } });
                }
                Step::Telegram(telegram) => {
                    self.noise = false;
                    self.telegram(&telegram, out);
                }
            }
        }
        self.gap_until = now + self.config.gap;
    }

    fn telegram(&mut self, telegram: &Bytes, out: &mut dyn Sink) {
        if let (Base::Asked { .. }, Telegram::Message(Message::InfIdBase(base))) =
            (self.base, Telegram::parse(telegram))
        {
            // The answer to our own question; the program has not asked.
            self.base = Base::Known(base & !OWN_BITS);
            return self.output(out);
        }
        if out.room() < TELEGRAM_BYTES {
            // "At full buffer new telegrams are ignored." [S1 "Kommunikation über Rück-wandbus"]
            return out.report(Event { phase: Phase::Receive, what: What::NoBuffer });
        }
        out.deliver(telegram);
    }

    fn fault(&mut self, now: Instant, fault: LineFault, out: &mut dyn Sink) {
        if fault == LineFault::Back {
            // It may be another module, with another ID base.
            return self.ask(now, 1, out);
        }
        let phase = if self.decoder.reset() { Phase::Receive } else { Phase::Idle };
        out.report(Event { phase, what: What::Line(fault) });
        if fault == LineFault::Gone {
            // Waiting telegrams must not switch anything when the line comes back at some later time.
            self.queue.clear();
            if self.held.take().is_some() {
                out.sent(Err(SendError::Frame));
            }
        }
    }

    fn abort(&mut self, out: &mut dyn Sink) {
        out.take_back();
        self.queue.clear();
        self.decoder.reset();
        if self.held.take().is_some() {
            out.sent(Err(SendError::Aborted));
        }
    }

    fn deadline(&self) -> Option<Instant> {
        let base = match self.base {
            Base::Unasked => Some(Instant::START),
            Base::Asked { until, .. } => Some(until),
            Base::Known(_) | Base::Untold => None,
        };
        let gap = self.decoder.is_open().then_some(self.gap_until);
        base.into_iter().chain(gap).min()
    }
}

impl Machine for Esp2 {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match input {
            Input::Tick => self.tick(now, out),
            Input::Line(LineInput::Rx(bytes)) => self.receive(now, bytes, out),
            Input::Line(LineInput::TxDone) => {
                self.leaving = false;
                self.output(out);
            }
            Input::Line(LineInput::Fault(fault)) => self.fault(now, fault, out),
            // Three wires to the module: it has no modem lines.
            Input::Line(LineInput::Modem(_)) => {}
            Input::Order(Order::Send(telegram)) => self.order(telegram, out),
            Input::Order(Order::Abort) => self.abort(out),
        }
        self.deadline()
    }

    fn busy(&self) -> bool {
        self.held.is_some()
    }
}
