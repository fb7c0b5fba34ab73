//! The four LEDs on the front [S0 "LEDs"].

use ob1_protocols::{MS, Nanos, SECOND};

/// How long ER stays on after the last error. [S0 L1458]
const ERROR_TIME: Nanos = 4 * SECOND;

/// How long RxD stays on after the last byte, so that it can be seen.
const RECEIVE_TIME: Nanos = 50 * MS;

/// The LEDs as they are now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Leds {
    /// PW, yellow: the module has power.
    pub power: bool,
    /// ER, red: open circuit, overflow, parity or framing error in the last 4 s.
    pub error: bool,
    /// TxD, green: transmits.
    pub transmit: bool,
    /// RxD, green: receives.
    pub receive: bool,
}

impl Leds {
    pub(crate) const NONE: Self = Self { power: false, error: false, transmit: false, receive: false };
}

/// What makes them light up and go out.
#[derive(Debug)]
pub(crate) struct LedDriver {
    leds: Leds,
    error_until: Nanos,
    receive_until: Nanos,
    /// An open circuit keeps ER on.
    line_gone: bool,
}

impl LedDriver {
    pub(crate) const fn new() -> Self {
        Self { leds: Leds::NONE, error_until: 0, receive_until: 0, line_gone: false }
    }

    pub(crate) fn power(&mut self) {
        self.leds.power = true;
    }

    pub(crate) fn error(&mut self, now: Nanos) {
        self.leds.error = true;
        self.error_until = now + ERROR_TIME;
    }

    pub(crate) fn line(&mut self, now: Nanos, gone: bool) {
        if gone || self.line_gone {
            self.error(now);
        }
        self.line_gone = gone;
    }

    pub(crate) fn received(&mut self, now: Nanos) {
        self.leds.receive = true;
        self.receive_until = now + RECEIVE_TIME;
    }

    pub(crate) fn transmit(&mut self, on: bool) {
        self.leds.transmit = on;
    }

    /// The LEDs at this time.
    pub(crate) fn at(&mut self, now: Nanos) -> Leds {
        self.leds.error &= self.line_gone || now < self.error_until;
        self.leds.receive &= now < self.receive_until;
        self.leds
    }

    /// When one of them goes out.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        let error = (self.leds.error && !self.line_gone).then_some(self.error_until);
        let receive = self.leds.receive.then_some(self.receive_until);
        error.into_iter().chain(receive).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn er_goes_out_4_s_after_the_last_error() {
        let mut leds = LedDriver::new();
        leds.error(0);
        leds.error(SECOND);
        assert!(leds.at(5 * SECOND - 1).error);
        assert_eq!(leds.deadline(), Some(5 * SECOND));
        assert!(!leds.at(5 * SECOND).error);
        assert_eq!(leds.deadline(), None);
    }

    #[test]
    fn er_stays_while_the_circuit_is_open() {
        let mut leds = LedDriver::new();
        leds.line(0, true);
        assert!(leds.at(100 * SECOND).error);
        leds.line(100 * SECOND, false);
        assert!(leds.at(104 * SECOND - 1).error);
        assert!(!leds.at(104 * SECOND).error);
    }
}
