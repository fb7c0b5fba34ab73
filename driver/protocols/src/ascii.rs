//! ASCII of the CP 240: bare characters. A telegram ends when the line falls silent; nothing is acknowledged, nothing
//! checked.
//!
//! [S0 "ASCII"], [S0 "ASCII-fragmented"], [S0 "Parameter description"]. Sending and receiving are independent of each
//! other (full duplex). An order is done when ZNA has run out after the last bit.
//!
//! Flow control: XON/XOFF or RTS/CTS. The partner's XOFF (CTS OFF) stops the output; an order that is kept waiting for
//! longer than [`Config::flow_wait`] fails. This side stops the partner while no receive buffer is free. In XON/XOFF mode
//! the two characters never belong to a telegram.

use crate::flow::Gate;
pub use crate::flow::{Flow, XOFF, XON};
use crate::machine::{
    Event, Input, LineFault, MS, Machine, ModemLines, Nanos, Order, Phase, SECOND, Sink, TELEGRAM_MAX, What,
};
use crate::output::{Flags, Output, Rules};

/// Bytes in a block of ASCII-fragmented: what one exchange over the back plane carries.
pub const FRAGMENT: usize = 12;

/// Configuration of [`Ascii`]. Times in nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Deliver blocks of 12 bytes as they come, and a shorter one when the line falls silent.
    pub fragmented: bool,
    /// Flow control.
    pub flow: Flow,
    /// ZNA: from the last bit of a telegram to the end of its order.
    pub zna: Nanos,
    /// ZVZ: silence that ends a telegram; 0: two character times.
    pub zvz: Nanos,
    /// Time of one character on the line.
    pub char_time: Nanos,
    /// Longest time that an order waits for XON or CTS; 0: for ever. The manual names none; 20 s as the reference does for
    /// the CP 341.
    pub flow_wait: Nanos,
}

impl Config {
    /// The defaults of the parameter table: ZNA 0, ZVZ 200 ms, no flow control. [S0 "Structure of the parameter bytes of ASCII"]
    pub fn cp240(char_time: Nanos) -> Self {
        Self { fragmented: false, flow: Flow::None, zna: 0, zvz: 200 * MS, char_time, flow_wait: 20 * SECOND }
    }

    /// [S0 "Character delay time (ZVZ)"]: 0: about double character time.
    fn zvz(&self) -> Nanos {
        if self.zvz == 0 { 2 * self.char_time } else { self.zvz }
    }
}

/// The ASCII procedure with a send and a receive buffer of `N` bytes each.
#[derive(Clone, Debug)]
pub struct Ascii<const N: usize = TELEGRAM_MAX> {
    config: Config,
    started: bool,
    output: Output<N>,
    receive: Receive,
    gate: Gate,
    rx: [u8; N],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Receive {
    Idle,
    /// `len` bytes are in the buffer; the telegram ends at `until` unless a character comes.
    Collect {
        len: usize,
        until: Nanos,
    },
    /// The telegram is lost; so is everything until the line falls silent.
    Discard {
        until: Nanos,
    },
}

impl<const N: usize> Ascii<N> {
    /// A machine before its first step.
    pub fn new(config: Config) -> Self {
        let rules = Rules {
            start: Flags::NONE,
            end: Flags::NONE,
            flow: config.flow,
            zna: config.zna,
            char_time: config.char_time,
            flow_wait: config.flow_wait,
        };
        let gate = Gate::new(config.flow);
        Self { config, started: false, output: Output::new(rules), receive: Receive::Idle, gate, rx: [0; N] }
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    fn tick(&mut self, now: Nanos, out: &mut dyn Sink) {
        if !self.started {
            self.started = true;
            self.gate.open(out);
        }
        match self.receive {
            Receive::Collect { len, until } if now >= until => {
                // [S0 "Communication via back plane bus"]: complete with the expiration of the ZVZ.
                self.receive = Receive::Idle;
                self.deliver(now, len, out);
            }
            Receive::Discard { until } if now >= until => self.receive = Receive::Idle,
            _ => {}
        }
        self.gate.tick(now, out);
        self.output.tick(now, out);
    }

    // ---- receiving ----

    fn character(&mut self, now: Nanos, byte: u8, out: &mut dyn Sink) {
        if self.config.flow == Flow::XonXoff && (byte == XON || byte == XOFF) {
            return self.output.set_stopped(now, byte == XOFF, out);
        }
        let until = now + self.config.zvz();
        match self.receive {
            Receive::Discard { .. } => self.receive = Receive::Discard { until },
            // [S0 "Number of receive buffers"]: no more data can be received while the receive buffer is occupied.
            Receive::Idle if out.room() == 0 => self.reject(now, What::NoBuffer, out),
            Receive::Idle => self.store(now, 0, byte, out),
            Receive::Collect { len, .. } => self.store(now, len, byte, out),
        }
    }

    fn store(&mut self, now: Nanos, len: usize, byte: u8, out: &mut dyn Sink) {
        // [S0 "Communication via back plane bus"]: the length of the ring buffer determines the max. length of a telegram.
        let Some(place) = self.rx.get_mut(len) else {
            return self.reject(now, What::TooLong, out);
        };
        *place = byte;
        self.receive = Receive::Collect { len: len + 1, until: now + self.config.zvz() };
        if self.config.fragmented && len + 1 == FRAGMENT {
            // [S0 "Communication with ASCII-fragmented"]: blocks are transferred immediately.
            self.receive = Receive::Idle;
            self.deliver(now, FRAGMENT, out);
        }
    }

    fn deliver(&mut self, now: Nanos, len: usize, out: &mut dyn Sink) {
        // [S0 "Communication via back plane bus"]: when the buffer is filled up, new telegrams are rejected.
        match out.room() {
            0 => self.reject_whole(now, What::NoBuffer, out),
            room if len > room => self.reject_whole(now, What::TooLong, out),
            _ => out.deliver(&self.rx[..len]),
        }
        self.gate.check(now, out);
    }

    /// A telegram that cannot be had: what follows of it goes the same way.
    fn reject(&mut self, now: Nanos, what: What, out: &mut dyn Sink) {
        out.report(Event { phase: Phase::Receive, what });
        self.receive = Receive::Discard { until: now + self.config.zvz() };
    }

    /// As [`Self::reject`]; a telegram that has just ended has nothing to follow, a fragment has.
    fn reject_whole(&mut self, now: Nanos, what: What, out: &mut dyn Sink) {
        if self.config.fragmented {
            self.reject(now, what, out);
        } else {
            out.report(Event { phase: Phase::Receive, what });
        }
    }

    fn fault(&mut self, now: Nanos, fault: LineFault, out: &mut dyn Sink) {
        let what = What::Line(fault);
        if matches!(fault, LineFault::Gone | LineFault::Back) {
            let phase = if self.receive == Receive::Idle { Phase::Idle } else { Phase::Receive };
            out.report(Event { phase, what });
        } else {
            // The manual only lights ER. A telegram with an unreadable character is not passed on as if it were whole.
            self.reject(now, what, out);
        }
    }

    fn deadline(&self) -> Option<Nanos> {
        let receive = match self.receive {
            Receive::Idle => None,
            Receive::Collect { until, .. } | Receive::Discard { until } => Some(until),
        };
        let start = (!self.started).then_some(0);
        [receive, self.output.deadline(), self.gate.deadline(), start].into_iter().flatten().min()
    }
}

impl<const N: usize> Machine for Ascii<N> {
    fn step(&mut self, now: Nanos, input: Input<'_>, out: &mut dyn Sink) -> Option<Nanos> {
        match input {
            Input::Tick => self.tick(now, out),
            Input::Rx(bytes) => bytes.iter().for_each(|byte| self.character(now, *byte, out)),
            Input::TxDone => self.output.tx_done(now, out),
            Input::LineFault(fault) => self.fault(now, fault, out),
            Input::Modem(ModemLines { cts, .. }) if self.config.flow == Flow::Hardware => {
                self.output.set_stopped(now, !cts, out);
            }
            Input::Modem(_) => {}
            Input::Order(order) => {
                if order == Order::Abort {
                    self.receive = Receive::Idle;
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
