//! The four LEDs on the front [S0 "LEDs"].

use ob1_protocols::{MS, Nanos, SECOND};
pub use ob1_words::Leds;

/// How long ER stays on after the last error. [S0 L1458]
const ERROR_TIME: Nanos = 4 * SECOND;

/// Modbus without valid parameters: on for so long, then off for so long (ours).
const FLASH: Nanos = 250 * MS;

/// How long RxD stays on after the last byte, so that it can be seen.
const RECEIVE_TIME: Nanos = 50 * MS;

/// What makes them light up and go out.
#[derive(Debug)]
pub(crate) struct LedDriver {
    leds: Leds,
    error_until: Nanos,
    receive_until: Nanos,
    /// An open circuit keeps ER on.
    line_gone: bool,
    modbus: bool,
    /// EnOcean: ER shows a full buffer and nothing of the line.
    overflow_alone: bool,
    /// Modbus: an internal error keeps ER on until the CPU goes from STOP to RUN.
    internal: bool,
    /// Modbus without valid parameters: ER, TxD and RxD are on or off until then.
    flashing: Option<(bool, Nanos)>,
}

impl LedDriver {
    pub(crate) const fn new() -> Self {
        Self {
            leds: Leds::NONE,
            error_until: 0,
            receive_until: 0,
            line_gone: false,
            modbus: false,
            overflow_alone: false,
            internal: false,
            flashing: None,
        }
    }

    /// Switched on, and no parameters yet: ER, TxD and RxD flash. The manual says it of the Modbus module; which
    /// protocol a module has it learns with its parameters. [S0 L2086]
    pub(crate) const fn switched_on() -> Self {
        let mut leds = Self::new();
        leds.leds.power = true;
        leds.flashing = Some((false, 0));
        leds
    }

    pub(crate) fn power(&mut self) {
        self.leds.power = true;
    }

    /// New parameters, for one of the Modbus modes or not, valid or not. Modbus: "After switching on the voltage
    /// supply the LEDs ER, TxD and RxD are flashing ... with valid parameters the LEDs ER, TxD and RxD extinguish."
    /// [S0 "Commissioning"]
    pub(crate) fn parameters(&mut self, now: Nanos, modbus: bool, valid: bool) {
        if modbus {
            (self.leds.error, self.leds.transmit, self.leds.receive) = (false, false, false);
        }
        (self.modbus, self.internal) = (modbus, false);
        self.flashing = (modbus && !valid).then_some((true, now + FLASH));
    }

    /// A full buffer: for Modbus an internal error, which it shows until a STOP-RUN of the CPU. [S0 L1458], [S0 L2086]
    pub(crate) fn overflow(&mut self, now: Nanos) {
        self.internal |= self.modbus;
        if !self.modbus {
            self.light(now);
        }
    }

    /// EnOcean: ER "signalizes an error by buffer overflow", no other. [S1 "LEDs"]
    pub(crate) fn show_overflow_alone(&mut self, alone: bool) {
        self.overflow_alone = alone;
    }

    /// The CPU has gone from STOP to RUN.
    pub(crate) fn stop_run(&mut self) {
        self.internal = false;
    }

    pub(crate) fn error(&mut self, now: Nanos) {
        // "For Modbus this signalizes an internal error", and nothing of the line. [S0 L1458]
        if !self.modbus && !self.overflow_alone {
            self.light(now);
        }
    }

    fn light(&mut self, now: Nanos) {
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
        match &mut self.flashing {
            Some((on, until)) => {
                if now >= *until {
                    (*on, *until) = (!*on, now + FLASH);
                }
                Leds { error: *on, transmit: *on, receive: *on, ..self.leds }
            }
            None => Leds { error: self.leds.error || self.internal, ..self.leds },
        }
    }

    /// When one of them goes out.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        let error = (self.leds.error && !self.line_gone).then_some(self.error_until);
        let receive = self.leds.receive.then_some(self.receive_until);
        let flash = self.flashing.map(|(_, until)| until);
        error.into_iter().chain(receive).chain(flash).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modbus_flashes_until_its_parameters_are_valid() {
        let mut leds = LedDriver::new();
        leds.power();
        leds.parameters(0, true, false);
        for n in 0..6 {
            let on = n % 2 == 0;
            let expected = Leds { power: true, error: on, transmit: on, receive: on };
            assert_eq!((leds.at(n * FLASH), leds.at((n + 1) * FLASH - 1)), (expected, expected));
            assert_eq!(leds.deadline(), Some((n + 1) * FLASH));
        }
        leds.parameters(2 * SECOND, true, true);
        assert_eq!(leds.at(2 * SECOND), Leds { power: true, ..Leds::NONE });
        assert_eq!(leds.deadline(), None);
    }

    #[test]
    fn modbus_shows_internal_errors_until_stop_run() {
        let mut leds = LedDriver::new();
        leds.parameters(0, true, true);
        leds.error(0);
        assert!(!leds.at(0).error, "an error of the line does not count");
        leds.overflow(0);
        assert!(leds.at(100 * SECOND).error);
        leds.stop_run();
        assert!(!leds.at(100 * SECOND).error);
    }

    #[test]
    fn enocean_shows_a_full_buffer_and_nothing_of_the_line() {
        let mut leds = LedDriver::new();
        leds.show_overflow_alone(true);
        leds.error(0);
        leds.line(0, true);
        assert!(!leds.at(0).error);
        leds.line(SECOND, false);
        leds.overflow(2 * SECOND);
        assert!(leds.at(6 * SECOND - 1).error && !leds.at(6 * SECOND).error);
    }

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
