//! What ASCII and STX/ETX have in common: nothing is acknowledged, so that sending and receiving are independent of
//! each other (full duplex), and each side may stop the other by flow control.

use crate::flow::{Flow, Gate, XOFF, XON};
use crate::machine::{Event, Input, Instant, LineFault, LineInput, Machine, Order, Phase, Sink, What, earliest};
use crate::output::{Output, Rules};

/// The receiving half: where telegrams begin and end.
pub trait Receiver {
    /// Silence may have ended a telegram; true if it has.
    fn tick(&mut self, now: Instant, out: &mut dyn Sink) -> bool;

    /// A character; true if a telegram has ended with it.
    fn character(&mut self, now: Instant, byte: u8, out: &mut dyn Sink) -> bool;

    /// A character that could not be read: it is reported, and its telegram is lost.
    fn unreadable(&mut self, now: Instant, what: What, out: &mut dyn Sink);

    /// Drops the telegram being received, and the rest of it too. Only where secondary signals are used.
    fn abandon(&mut self, what: What, out: &mut dyn Sink) {
        let _ = (what, out);
    }

    /// Drops the telegram being received; the next character begins something new.
    fn clear(&mut self, out: &mut dyn Sink);

    /// Whether a telegram is being received.
    fn is_receiving(&self) -> bool;

    /// When silence ends a telegram.
    fn deadline(&self) -> Option<Instant>;
}

/// Both halves, with a send buffer of `N` bytes.
#[derive(Clone, Debug)]
pub struct Duplex<R, const N: usize> {
    flow: Flow,
    started: bool,
    output: Output<N>,
    receive: R,
    gate: Gate,
}

impl<R: Receiver, const N: usize> Duplex<R, N> {
    pub(crate) fn of(rules: Rules, receive: R) -> Self {
        let flow = rules.flow;
        Self { flow, started: false, output: Output::new(rules), receive, gate: Gate::new(flow) }
    }

    /// Who may stop the sender, and how.
    pub fn flow(&self) -> Flow {
        self.flow
    }

    fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        if !self.started {
            self.started = true;
            self.output.start(out);
            self.gate.open(out);
        }
        if self.receive.tick(now, out) {
            self.gate.check(now, out);
        }
        self.gate.tick(now, out);
        self.output.tick(now, out);
    }

    fn character(&mut self, now: Instant, byte: u8, out: &mut dyn Sink) {
        if !self.output.can_receive() {
            return;
        }
        if self.flow == Flow::XonXoff && (byte == XON || byte == XOFF) {
            return self.output.set_stopped(now, byte == XOFF, out);
        }
        if self.receive.character(now, byte, out) {
            self.gate.check(now, out);
        }
    }

    fn fault(&mut self, now: Instant, fault: LineFault, out: &mut dyn Sink) {
        let what = What::Line(fault);
        if matches!(fault, LineFault::Gone | LineFault::Back) {
            let phase = if self.receive.is_receiving() { Phase::Receive } else { Phase::Idle };
            out.report(Event { phase, what });
        } else if self.output.can_receive() {
            // The manual only lights ER. A telegram with an unreadable character is not passed on as if it were whole.
            self.receive.unreadable(now, what, out);
        }
    }

    fn deadline(&self) -> Option<Instant> {
        let start = (!self.started).then_some(Instant::START);
        earliest([self.receive.deadline(), self.output.deadline(), self.gate.deadline(), start])
    }
}

impl<R: Receiver, const N: usize> Machine for Duplex<R, N> {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match input {
            Input::Tick => self.tick(now, out),
            Input::Line(LineInput::Rx(bytes)) => bytes.iter().for_each(|byte| self.character(now, *byte, out)),
            Input::Line(LineInput::TxDone) => self.output.tx_done(now, out),
            Input::Line(LineInput::Fault(fault)) => self.fault(now, fault, out),
            Input::Line(LineInput::Modem(lines)) => {
                // "A send request or data receipt is aborted with an error message if DSR changes from ON to OFF."
                // [S4 L817]
                if self.output.modem(now, lines, out) {
                    self.receive.abandon(What::Signals, out);
                }
            }
            Input::Order(order) => {
                if order == Order::Abort {
                    self.receive.clear(out);
                }
                self.output.order(now, order, out);
            }
        }
        self.deadline()
    }

    fn busy(&self) -> bool {
        self.output.is_busy()
    }

    fn is_stopped(&self) -> bool {
        self.output.is_stopped()
    }
}
