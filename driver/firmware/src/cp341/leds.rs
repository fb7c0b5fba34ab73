//! SF, TXD and RXD of a CP 341. [S4 "Diagnostics via Display Elements (LEDs)"]
//!
//! SF shows the module's state, not single errors of the line: a failed telegram does not light it.

use ob1_protocols::{Instant, Span};

use crate::leds::Leds;

/// "lights up again briefly when new parameters are loaded" [S4 L1696]: long enough to be seen (ours).
const NEW_PARAMETERS: Span = Span::from_millis(500);

/// How long RXD stays on after the last character, so that it can be seen (ours).
const RECEIVE: Span = Span::from_millis(50);

/// What makes them light up and go out.
#[derive(Debug)]
pub(crate) struct LedDriver {
    /// Switched on, and no parameters yet.
    starting: bool,
    /// The parameters are wrong.
    parameters_wrong: bool,
    /// New parameters have been loaded: SF is on until then.
    loaded_until: Instant,
    /// "CTS or DSR signals not asserted at the connector" [S4 L1703]: they have aborted a transmission.
    signals_missing: bool,
    transmit: bool,
    receive_until: Instant,
}

impl LedDriver {
    pub(crate) const fn new() -> Self {
        Self {
            starting: true,
            parameters_wrong: false,
            loaded_until: Instant::START,
            signals_missing: false,
            transmit: false,
            receive_until: Instant::START,
        }
    }

    /// Parameters have come that the CP did not have yet.
    pub(crate) fn parameters(&mut self, now: Instant, valid: bool) {
        (self.starting, self.parameters_wrong, self.signals_missing) = (false, !valid, false);
        self.loaded_until = now + NEW_PARAMETERS;
    }

    pub(crate) fn signals_missing(&mut self, missing: bool) {
        self.signals_missing = missing;
    }

    pub(crate) const fn are_signals_missing(&self) -> bool {
        self.signals_missing
    }

    pub(crate) fn transmit(&mut self, on: bool) {
        self.transmit = on;
    }

    pub(crate) fn received(&mut self, now: Instant) {
        self.receive_until = now + RECEIVE;
        self.signals_missing = false;
    }

    /// The LEDs at this time. `interrupted`: BREAK, the receiving line is interrupted.
    pub(crate) fn at(&self, now: Instant, interrupted: bool) -> Leds {
        let fault = self.parameters_wrong || self.signals_missing || interrupted;
        Leds {
            power: true,
            error: self.starting || fault || now < self.loaded_until,
            transmit: self.transmit,
            receive: now < self.receive_until,
        }
    }

    /// When one of them goes out.
    pub(crate) fn deadline(&self, now: Instant) -> Option<Instant> {
        [self.loaded_until, self.receive_until].into_iter().filter(|until| now < *until).min()
    }
}
