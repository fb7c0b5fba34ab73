//! ASCII of the CP 240: bare characters. A telegram ends when the line falls silent; nothing is acknowledged, nothing
//! checked.
//!
//! [S0 "ASCII"], [S0 "ASCII-fragmented"], [S0 "Parameter description"]. Sending and receiving are independent of each
//! other (full duplex). An order is done when ZNA has run out after the last bit.
//!
//! Flow control: XON/XOFF or RTS/CTS. The partner's XOFF (CTS OFF) stops the output; an order that is kept waiting for
//! longer than [`Config::flow_wait`] fails. This side stops the partner while no receive buffer is free. In XON/XOFF mode
//! the two characters never belong to a telegram.

use crate::machine::{
    Event, Input, LineFault, MS, Machine, ModemLines, Nanos, Order, Phase, SECOND, SendError, Sink, TELEGRAM_MAX, What,
};

/// Goes on.
pub const XON: u8 = 0x11;
/// Stops.
pub const XOFF: u8 = 0x13;

/// Bytes in a block of ASCII-fragmented: what one exchange over the back plane carries.
pub const FRAGMENT: usize = 12;

/// Characters handed to the line at a time while the partner may stop us: what it must be able to take after its XOFF.
const CHUNK: usize = 16;

/// How often a free receive buffer is looked for while the partner is stopped.
const ROOM_POLL: Nanos = 20 * MS;

/// Who may stop the other, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Nobody.
    None,
    /// RTS and CTS.
    Hardware,
    /// The characters XON and XOFF.
    XonXoff,
}

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
    send: Send,
    receive: Receive,
    /// The partner has stopped us.
    stopped: bool,
    /// We have stopped the partner; look for a buffer at this time.
    stopping: Option<Nanos>,
    tx: [u8; N],
    rx: [u8; N],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Send {
    Idle,
    /// `next` of `len` bytes have been handed over and are leaving; give up at `until`: something below us holds them back
    /// (a driver that looks at CTS by itself).
    Output {
        next: usize,
        len: usize,
        until: Option<Nanos>,
    },
    /// The partner has stopped us; give up at `until`.
    Stopped {
        next: usize,
        len: usize,
        until: Option<Nanos>,
    },
    /// The last bit is out; ZNA runs.
    Pause {
        until: Nanos,
    },
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
        Self {
            config,
            started: false,
            send: Send::Idle,
            receive: Receive::Idle,
            stopped: false,
            stopping: None,
            tx: [0; N],
            rx: [0; N],
        }
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    fn tick(&mut self, now: Nanos, out: &mut dyn Sink) {
        if !self.started {
            self.started = true;
            self.release_partner(out);
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
        if self.stopping.is_some_and(|poll| now >= poll) || (self.stopping.is_some() && out.room() > 0) {
            self.stopping = Some(now + ROOM_POLL);
            if out.room() > 0 {
                self.stopping = None;
                self.release_partner(out);
            }
        }
        match self.send {
            Send::Pause { until } if now >= until => self.end(Ok(()), out),
            Send::Stopped { until: Some(until), .. } | Send::Output { until: Some(until), .. } if now >= until => {
                out.take_back();
                out.report(Event { phase: Phase::Output, what: What::AckDelay });
                self.end(Err(SendError::AckDelay), out);
            }
            _ => {}
        }
    }

    // ---- sending ----

    fn order(&mut self, now: Nanos, order: Order<'_>, out: &mut dyn Sink) {
        match order {
            Order::Abort => {
                out.take_back();
                self.receive = Receive::Idle;
                if self.busy() {
                    self.end(Err(SendError::Aborted), out);
                }
            }
            Order::Send(_) if self.busy() => out.sent(Err(SendError::Busy)),
            Order::Send(telegram) => match self.tx.get_mut(..telegram.len()) {
                Some(buffer) => {
                    buffer.copy_from_slice(telegram);
                    self.output(now, 0, telegram.len(), out);
                }
                None => out.sent(Err(SendError::TooLong)),
            },
        }
    }

    /// Hands over what comes next, or begins the pause after the telegram.
    fn output(&mut self, now: Nanos, next: usize, len: usize, out: &mut dyn Sink) {
        if next == len {
            // [S0 "ASCII"]: "only reset when the data has been transferred and the ZNA has expired".
            self.send = Send::Pause { until: now + self.config.zna };
            if self.config.zna == 0 {
                self.end(Ok(()), out);
            }
        } else if self.stopped {
            self.stop(now, next, len);
        } else {
            let chunk = if self.config.flow == Flow::None { len } else { CHUNK };
            let end = len.min(next + chunk);
            out.transmit(&self.tx[next..end]);
            let leaves = now + self.config.char_time * (end - next) as u64;
            let until = (self.config.flow_wait > 0).then(|| leaves + self.config.flow_wait);
            self.send = Send::Output { next: end, len, until };
        }
    }

    fn stop(&mut self, now: Nanos, next: usize, len: usize) {
        let until = (self.config.flow_wait > 0).then(|| now + self.config.flow_wait);
        self.send = Send::Stopped { next, len, until };
    }

    fn tx_done(&mut self, now: Nanos, out: &mut dyn Sink) {
        if let Send::Output { next, len, .. } = self.send {
            self.output(now, next, len, out);
        }
    }

    /// The partner stops us or lets us go on. [S0 "Flow control"]
    fn flow(&mut self, now: Nanos, stopped: bool, out: &mut dyn Sink) {
        let before = core::mem::replace(&mut self.stopped, stopped);
        match self.send {
            Send::Output { next, len, .. } if stopped && !before => {
                let back = out.take_back().min(next);
                if back > 0 {
                    self.stop(now, next - back, len);
                }
            }
            Send::Stopped { next, len, .. } if !stopped => self.output(now, next, len, out),
            _ => {}
        }
    }

    fn end(&mut self, outcome: Result<(), SendError>, out: &mut dyn Sink) {
        self.send = Send::Idle;
        out.sent(outcome);
    }

    // ---- receiving ----

    fn character(&mut self, now: Nanos, byte: u8, out: &mut dyn Sink) {
        if self.config.flow == Flow::XonXoff && (byte == XON || byte == XOFF) {
            return self.flow(now, byte == XOFF, out);
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
        if out.room() == 0 && self.config.flow != Flow::None && self.stopping.is_none() {
            self.stopping = Some(now + ROOM_POLL);
            match self.config.flow {
                Flow::XonXoff => out.transmit(&[XOFF]),
                _ => out.rts(false),
            }
        }
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

    fn release_partner(&mut self, out: &mut dyn Sink) {
        match self.config.flow {
            Flow::None => {}
            Flow::Hardware => out.rts(true),
            Flow::XonXoff => out.transmit(&[XON]),
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
        let send = match self.send {
            Send::Idle => None,
            Send::Output { until, .. } | Send::Stopped { until, .. } => until,
            Send::Pause { until } => Some(until),
        };
        let start = (!self.started).then_some(0);
        [receive, send, self.stopping, start].into_iter().flatten().min()
    }
}

impl<const N: usize> Machine for Ascii<N> {
    fn step(&mut self, now: Nanos, input: Input<'_>, out: &mut dyn Sink) -> Option<Nanos> {
        match input {
            Input::Tick => self.tick(now, out),
            Input::Rx(bytes) => bytes.iter().for_each(|byte| self.character(now, *byte, out)),
            Input::TxDone => self.tx_done(now, out),
            Input::LineFault(fault) => self.fault(now, fault, out),
            Input::Modem(ModemLines { cts, .. }) if self.config.flow == Flow::Hardware => self.flow(now, !cts, out),
            Input::Modem(_) => {}
            Input::Order(order) => self.order(now, order, out),
        }
        self.deadline()
    }

    fn busy(&self) -> bool {
        self.send != Send::Idle
    }
}
