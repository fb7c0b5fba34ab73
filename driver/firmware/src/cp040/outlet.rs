//! Where the protocol puts its results during one step.

use ob1_protocols::{Event, Instant, LineFault, Phase, SendError, Sink, What, Wire};

use super::receive::{ReceiveSide, ReturnValue};
use crate::leds::LedDriver;
use crate::port::CpPort;

pub(super) struct Outlet<'a> {
    pub(super) now: Instant,
    pub(super) receive: &'a mut ReceiveSide,
    pub(super) leds: &'a mut LedDriver,
    pub(super) port: &'a mut dyn CpPort,
    /// The partner does not repeat what could not be received: the return value tells the CPU.
    pub(super) tells_errors: bool,
    /// Characters are being transmitted.
    pub(super) transmitting: &'a mut bool,
    pub(super) outcome: Option<Result<(), SendError>>,
}

impl Outlet<'_> {
    fn tell(&mut self, value: ReturnValue) {
        if self.tells_errors {
            self.receive.push_error(value);
        }
    }
}

impl Wire for Outlet<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        *self.transmitting |= !bytes.is_empty();
        self.leds.transmit(true);
        self.port.put_out(bytes);
    }

    fn take_back(&mut self) -> usize {
        self.port.take_back()
    }

    fn rts(&mut self, on: bool) {
        self.port.rts(on);
    }
}

impl Sink for Outlet<'_> {
    fn room(&self) -> usize {
        self.receive.room()
    }

    fn deliver(&mut self, telegram: &[u8]) {
        let is_stored = self.receive.push(None, telegram);
        self.port.received(self.now, telegram, is_stored);
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.outcome = Some(outcome);
    }

    fn report(&mut self, event: Event) {
        // The LED IF: open circuit, overflow, parity and framing errors. [S3 L293]
        self.leds.occurred(self.now, event);
        match event.what {
            What::NoBuffer => self.tell(ReturnValue::NoBuffer),
            What::TooLong => self.tell(ReturnValue::Length),
            // The first such character of a telegram; it is lost with all that follow. [S3 L319]
            What::Line(LineFault::Parity | LineFault::Framing | LineFault::Overrun | LineFault::Break)
                if event.phase == Phase::Receive =>
            {
                self.tell(ReturnValue::Character);
            }
            _ => {}
        }
        self.port.occurred(self.now, event);
    }
}
