//! STX/ETX: telegrams between start and end characters; nothing is acknowledged, nothing checked. [S0 "STX/ETX"]
//!
//! None, one or two characters each. Characters before the start are discarded; those between start and end go to the
//! CPU when the end has come. Without end characters a telegram ends with the silence of TMO [S0 "Technical Data
//! Protocols"]; without start characters it begins with any character. Sending and receiving are independent of each
//! other (full duplex), an order is done when ZNA has run out after the last bit, and flow control is that of
//! [`ascii`](crate::ascii).
//!
//! | the manual leaves open | here |
//! |---|---|
//! | TMO expires within a telegram that has end characters | the telegram is lost, reported as 0806h |
//! | a start within a telegram | the end was lost: that telegram is dropped and a new one begins |
//! | one of two start (end) characters alone | before a telegram discarded, within it user data |
//! | start and end are the same character | within a telegram it is the end |
//! | a telegram without user data | not delivered |
//! | a character that cannot be read, or no room | the telegram is lost, until the next start, end or silence |

mod decoder;

use crate::flow::{Flow, Gate, XOFF, XON};
use crate::machine::{
    Event, Input, Instant, LineFault, LineInput, Machine, Order, Phase, Sink, Span, TELEGRAM_MAX, What, earliest,
};
pub use crate::output::Flags;
use crate::output::{Extent, Output, Rules};
pub use decoder::{Decoder, Step};

/// Configuration of [`StxEtx`]. Times in nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Start characters.
    pub start: Flags,
    /// End characters.
    pub end: Flags,
    /// Flow control.
    pub flow: Flow,
    /// ZNA: from the last bit of a telegram to the end of its order.
    pub zna: Span,
    /// TMO: longest silence within a telegram.
    pub tmo: Span,
    /// Time of one character on the line.
    pub char_time: Span,
    /// Longest time that an order waits for XON or CTS; 0: for ever. See [`ascii::Config`](crate::ascii::Config).
    pub flow_wait: Span,
}

impl Config {
    /// Nothing set: no characters, no times, no flow control. The defaults of the parameters are in `ob1-params`.
    pub const fn unset(char_time: Span) -> Self {
        Self {
            start: Flags::NONE,
            end: Flags::NONE,
            flow: Flow::None,
            zna: Span::ZERO,
            tmo: Span::ZERO,
            char_time,
            flow_wait: Span::from_secs(20),
        }
    }
}

/// The STX/ETX procedure with a send and a receive buffer of `N` bytes each.
#[derive(Clone, Debug)]
pub struct StxEtx<const N: usize = TELEGRAM_MAX> {
    config: Config,
    started: bool,
    output: Output<N>,
    gate: Gate,
    decoder: Decoder,
    receive: Receive<N>,
    /// Silence until then ends the telegram being received.
    silence: Option<Instant>,
}

/// The telegram being received.
#[derive(Clone, Debug)]
struct Receive<const N: usize> {
    /// A start has come, or without start characters the first character.
    open: bool,
    len: usize,
    data: [u8; N],
    /// Noise has been reported since the last telegram.
    noise: bool,
    /// A telegram was completed in this step: the receive buffer may be full now.
    completed: bool,
}

impl<const N: usize> StxEtx<N> {
    /// A machine before its first step.
    pub fn new(config: Config) -> Self {
        let rules = Rules {
            start: config.start,
            end: config.end,
            flow: config.flow,
            zna: config.zna,
            char_time: config.char_time,
            flow_wait: config.flow_wait,
            extent: Extent::Whole,
            pause: Span::ZERO,
            signals: None,
        };
        let receive = Receive { open: false, len: 0, data: [0; N], noise: false, completed: false };
        Self {
            started: false,
            output: Output::new(rules),
            gate: Gate::new(config.flow),
            decoder: Decoder::new(config.start, config.end),
            receive,
            silence: None,
            config,
        }
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        if !self.started {
            self.started = true;
            self.gate.open(out);
        }
        if self.silence.is_some_and(|until| now >= until) {
            self.silent(out);
        }
        self.close_gate(now, out);
        self.gate.tick(now, out);
        self.output.tick(now, out);
    }

    fn character(&mut self, now: Instant, byte: u8, out: &mut dyn Sink) {
        if self.config.flow == Flow::XonXoff && (byte == XON || byte == XOFF) {
            return self.output.set_stopped(now, byte == XOFF, out);
        }
        let receive = &mut self.receive;
        self.decoder.feed(byte, &mut |decoder, step| receive.take(decoder, step, out));
        self.watch(now);
        self.close_gate(now, out);
    }

    /// TMO has expired. [S0 "Timeout (TMO)"]
    fn silent(&mut self, out: &mut dyn Sink) {
        let receive = &mut self.receive;
        self.decoder.flush(&mut |decoder, step| receive.take(decoder, step, out));
        if self.receive.open {
            if self.config.end.as_slice().is_empty() {
                // [S0 "Technical Data Protocols"]: end recognition after TMO.
                self.receive.complete(out);
            } else {
                self.receive.lose(What::CharacterDelay, out);
            }
        }
        self.decoder.reset();
        self.silence = None;
    }

    fn fault(&mut self, now: Instant, fault: LineFault, out: &mut dyn Sink) {
        let what = What::Line(fault);
        let phase = if self.receive.open { Phase::Receive } else { Phase::Idle };
        out.report(Event { phase, what });
        // The manual only lights ER. A telegram with an unreadable character is not passed on as if it were whole.
        if !matches!(fault, LineFault::Gone | LineFault::Back) {
            self.receive.close();
            self.decoder.skip();
            self.watch(now);
        }
    }

    /// Silence is monitored while anything is being received.
    fn watch(&mut self, now: Instant) {
        let runs = self.receive.open || self.decoder.skips() || self.decoder.holds();
        self.silence = runs.then(|| now + self.config.tmo);
    }

    fn close_gate(&mut self, now: Instant, out: &mut dyn Sink) {
        if core::mem::take(&mut self.receive.completed) {
            self.gate.check(now, out);
        }
    }

    fn deadline(&self) -> Option<Instant> {
        let start = (!self.started).then_some(Instant::START);
        earliest([self.silence, self.output.deadline(), self.gate.deadline(), start])
    }
}

impl<const N: usize> Receive<N> {
    fn take(&mut self, decoder: &mut Decoder, step: Step, out: &mut dyn Sink) {
        match step {
            Step::Noise(byte) => {
                // [S0 "STX/ETX"]: data must be preceded by STX. One report is enough.
                if !core::mem::replace(&mut self.noise, true) {
                    out.report(Event { phase: Phase::Idle, what: What::Unexpected(byte) });
                }
            }
            Step::Begin => {
                if self.open {
                    out.report(Event { phase: Phase::Receive, what: What::Restarted });
                }
                self.begin(decoder, out);
            }
            Step::Data(byte) => {
                if !self.open && !self.begin(decoder, out) {
                    return;
                }
                match self.data.get_mut(self.len) {
                    Some(place) => {
                        *place = byte;
                        self.len += 1;
                    }
                    None => {
                        // [S0 "Communication via back plane bus"]: the ring buffer's length is that of the longest
                        // telegram.
                        self.lose(What::TooLong, out);
                        decoder.skip();
                    }
                }
            }
            Step::End => self.complete(out),
        }
    }

    /// False: no receive buffer is free. [S0 "Communication via back plane bus"]: new telegrams are rejected.
    fn begin(&mut self, decoder: &mut Decoder, out: &mut dyn Sink) -> bool {
        self.close();
        self.noise = false;
        self.open = out.room() > 0;
        if !self.open {
            out.report(Event { phase: Phase::Receive, what: What::NoBuffer });
            decoder.skip();
        }
        self.open
    }

    /// [S0 "STX/ETX"]: the characters between STX and ETX are transferred when ETX has been received.
    fn complete(&mut self, out: &mut dyn Sink) {
        match (self.len, out.room()) {
            (0, _) => out.report(Event { phase: Phase::Receive, what: What::Empty }),
            // [S0 "Communication via back plane bus"]: when the buffer is filled up, new telegrams are rejected.
            (len, room) if len > room => out.report(Event { phase: Phase::Receive, what: What::NoBuffer }),
            (len, _) => out.deliver(&self.data[..len]),
        }
        self.completed = true;
        self.close();
    }

    fn lose(&mut self, what: What, out: &mut dyn Sink) {
        out.report(Event { phase: Phase::Receive, what });
        self.close();
    }

    fn close(&mut self) {
        (self.open, self.len) = (false, 0);
    }
}

impl<const N: usize> Machine for StxEtx<N> {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match input {
            Input::Tick => self.tick(now, out),
            Input::Line(LineInput::Rx(bytes)) => bytes.iter().for_each(|byte| self.character(now, *byte, out)),
            Input::Line(LineInput::TxDone) => self.output.tx_done(now, out),
            Input::Line(LineInput::Fault(fault)) => self.fault(now, fault, out),
            Input::Line(LineInput::Modem(lines)) => {
                self.output.modem(now, lines, out);
            }
            Input::Order(order) => {
                if order == Order::Abort {
                    self.receive.close();
                    self.decoder.reset();
                    self.silence = None;
                }
                self.output.order(now, order, out);
            }
        }
        self.deadline()
    }

    fn busy(&self) -> bool {
        self.output.is_busy()
    }
}
