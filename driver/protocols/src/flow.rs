//! Flow control: this side's half of it. [S0 "Flow control"]

use crate::machine::{Instant, Sink, Span};

/// XON: the partner may send again. [S0 L2010]
pub const XON: u8 = 0x11;
/// XOFF: the partner must stop. [S0 L2010]
pub const XOFF: u8 = 0x13;

pub use ob1_serial::Flow;

/// How often the receive buffer is checked for room while the partner is stopped.
const ROOM_POLL: Span = Span::from_millis(20);

/// The partner is stopped when the receive buffer has less room than this: it may still send that much before it obeys,
/// and hardly a telegram would fit anyway. The manual names no figure; 50 characters as at the CP 341.
/// [TIA help "Configuration for point-to-point links"]
const MARGIN: usize = 50;

/// Stops the partner while the receive buffer is full.
#[derive(Clone, Debug)]
pub(crate) struct Gate {
    flow: Flow,
    /// The partner is stopped; look for room at this time.
    stopped: Option<Instant>,
}

impl Gate {
    pub(crate) const fn new(flow: Flow) -> Self {
        Self { flow, stopped: None }
    }

    /// Lets the partner send, once at the start: a predecessor may have stopped it.
    pub(crate) fn open(&self, out: &mut dyn Sink) {
        match self.flow {
            Flow::None => {}
            Flow::Hardware => out.rts(true),
            Flow::XonXoff => out.transmit(&[XON]),
        }
    }

    /// A telegram has come: is there room for another?
    pub(crate) fn check(&mut self, now: Instant, out: &mut dyn Sink) {
        if self.flow == Flow::None || self.stopped.is_some() || out.room() >= MARGIN {
            return;
        }
        self.stopped = Some(now + ROOM_POLL);
        match self.flow {
            Flow::XonXoff => out.transmit(&[XOFF]),
            _ => out.rts(false),
        }
    }

    pub(crate) fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        if self.stopped.is_none() {
            return;
        }
        if out.room() >= MARGIN {
            self.stopped = None;
            self.open(out);
        } else if self.stopped.is_some_and(|poll| now >= poll) {
            self.stopped = Some(now + ROOM_POLL);
        }
    }

    pub(crate) fn deadline(&self) -> Option<Instant> {
        self.stopped
    }
}
