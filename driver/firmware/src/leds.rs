//! The four LEDs on the front [S0 "LEDs"].

use ob1_protocols::{Event, Instant, LineFault, Span, What};
pub use ob1_words::Leds;

/// How long ER stays on after the last error. [S0 L1458]
const ERROR_TIME: Span = Span::from_secs(4);

/// Modbus without valid parameters: on for this time, then off for this time (ours).
const FLASH: Span = Span::from_millis(250);

/// How long RxD stays on after the last byte, so that it can be seen.
const RECEIVE_TIME: Span = Span::from_millis(50);

/// What makes them light up and go out.
#[derive(Debug)]
pub(crate) struct LedDriver {
    leds: Leds,
    error_until: Instant,
    receive_until: Instant,
    /// An open circuit keeps ER on.
    line_gone: bool,
    modbus: bool,
    /// EnOcean: ER shows a full buffer and nothing of the line.
    overflow_alone: bool,
    /// Modbus: an internal error keeps ER on until the CPU goes from STOP to RUN.
    internal: bool,
    /// Modbus without valid parameters: ER, TxD and RxD are on or off until then.
    flashing: Option<(bool, Instant)>,
}

impl LedDriver {
    pub(crate) const fn new() -> Self {
        Self {
            leds: Leds::NONE,
            error_until: Instant::START,
            receive_until: Instant::START,
            line_gone: false,
            modbus: false,
            overflow_alone: false,
            internal: false,
            flashing: None,
        }
    }

    /// Switched on, and no parameters yet: ER, TxD and RxD flash. The manual says this of the Modbus module; a module
    /// learns its protocol only with its parameters. [S0 L2086]
    pub(crate) const fn switched_on() -> Self {
        let mut leds = Self::new();
        leds.leds.power = true;
        leds.flashing = Some((false, Instant::START));
        leds
    }

    pub(crate) fn power(&mut self) {
        self.leds.power = true;
    }

    /// New parameters, for one of the Modbus modes or not, valid or not. Modbus: "After switching on the voltage
    /// supply the LEDs ER, TxD and RxD are flashing ... with valid parameters the LEDs ER, TxD and RxD extinguish."
    /// [S0 "Commissioning"]
    pub(crate) fn parameters(&mut self, now: Instant, modbus: bool, valid: bool) {
        if modbus {
            (self.leds.error, self.leds.transmit, self.leds.receive) = (false, false, false);
        }
        (self.modbus, self.internal) = (modbus, false);
        self.flashing = (modbus && !valid).then_some((true, now + FLASH));
    }

    /// A full buffer: for Modbus an internal error, which it shows until a STOP-RUN of the CPU. [S0 L1458], [S0 L2086]
    pub(crate) fn overflow(&mut self, now: Instant) {
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

    /// An occurrence in the protocol. The line itself reports that it is gone.
    pub(crate) fn occurred(&mut self, now: Instant, event: Event) {
        if event.what == What::NoBuffer {
            self.overflow(now);
        }
        if event.lights_er() && event.what != What::Line(LineFault::Gone) {
            self.error(now);
        }
    }

    pub(crate) fn error(&mut self, now: Instant) {
        // "For Modbus this signalizes an internal error", and nothing of the line. [S0 L1458]
        if !self.modbus && !self.overflow_alone {
            self.light(now);
        }
    }

    fn light(&mut self, now: Instant) {
        self.leds.error = true;
        self.error_until = now + ERROR_TIME;
    }

    pub(crate) fn line(&mut self, now: Instant, gone: bool) {
        if gone || self.line_gone {
            self.error(now);
        }
        self.line_gone = gone;
    }

    pub(crate) fn received(&mut self, now: Instant) {
        self.leds.receive = true;
        self.receive_until = now + RECEIVE_TIME;
    }

    pub(crate) fn transmit(&mut self, on: bool) {
        self.leds.transmit = on;
    }

    /// The LEDs at this time.
    pub(crate) fn at(&mut self, now: Instant) -> Leds {
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
    pub(crate) fn deadline(&self) -> Option<Instant> {
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
        leds.parameters(Instant::START, true, false);
        for n in 0..6 {
            let on = n % 2 == 0;
            let expected = Leds { power: true, error: on, transmit: on, receive: on };
            assert_eq!(
                (leds.at(Instant::START + n * FLASH), leds.at(Instant::START + (n + 1) * FLASH - Span::from_nanos(1))),
                (expected, expected)
            );
            assert_eq!(leds.deadline(), Some(Instant::START + (n + 1) * FLASH));
        }
        leds.parameters(Instant::from_secs(2), true, true);
        assert_eq!(leds.at(Instant::from_secs(2)), Leds { power: true, ..Leds::NONE });
        assert_eq!(leds.deadline(), None);
    }

    #[test]
    fn modbus_shows_internal_errors_until_stop_run() {
        let mut leds = LedDriver::new();
        leds.parameters(Instant::START, true, true);
        leds.error(Instant::START);
        assert!(!leds.at(Instant::START).error, "an error of the line does not count");
        leds.overflow(Instant::START);
        assert!(leds.at(Instant::from_secs(100)).error);
        leds.stop_run();
        assert!(!leds.at(Instant::from_secs(100)).error);
    }

    #[test]
    fn enocean_shows_a_full_buffer_and_nothing_of_the_line() {
        let mut leds = LedDriver::new();
        leds.show_overflow_alone(true);
        leds.error(Instant::START);
        leds.line(Instant::START, true);
        assert!(!leds.at(Instant::START).error);
        leds.line(Instant::from_secs(1), false);
        leds.overflow(Instant::from_secs(2));
        assert!(leds.at(Instant::from_secs(6) - Span::from_nanos(1)).error && !leds.at(Instant::from_secs(6)).error);
    }

    #[test]
    fn er_goes_out_4_s_after_the_last_error() {
        let mut leds = LedDriver::new();
        leds.error(Instant::START);
        leds.error(Instant::from_secs(1));
        assert!(leds.at(Instant::from_secs(5) - Span::from_nanos(1)).error);
        assert_eq!(leds.deadline(), Some(Instant::from_secs(5)));
        assert!(!leds.at(Instant::from_secs(5)).error);
        assert_eq!(leds.deadline(), None);
    }

    #[test]
    fn er_stays_while_the_circuit_is_open() {
        let mut leds = LedDriver::new();
        leds.line(Instant::START, true);
        assert!(leds.at(Instant::from_secs(100)).error);
        leds.line(Instant::from_secs(100), false);
        assert!(leds.at(Instant::from_secs(104) - Span::from_nanos(1)).error);
        assert!(!leds.at(Instant::from_secs(104)).error);
    }
}
