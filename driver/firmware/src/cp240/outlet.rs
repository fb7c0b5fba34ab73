//! Where the protocol of a CP 240 puts its results during one step.

use ob1_params::LineSettings;
use ob1_protocols::{Event, Instant, Part, SendError, Sink, Wire};

use super::modem::Modem;
use super::rk512_side::Rk512Side;
use crate::diagnosis::{Diagnosis, Kind};
use crate::leds::LedDriver;
use crate::port::{Counter, CpEvent, CpPort};
use crate::ring::Ring;

/// Where the protocol puts its results during one step.
pub(super) struct Outlet<'a> {
    pub(super) now: Instant,
    pub(super) ring: &'a mut Ring,
    /// Telegrams come in parts.
    pub(super) is_fragmented: bool,
    pub(super) rk512: &'a mut Rk512Side,
    pub(super) leds: &'a mut LedDriver,
    pub(super) modem: &'a mut Modem,
    pub(super) diagnosis: &'a mut Diagnosis,
    pub(super) settings: &'a mut Option<LineSettings>,
    pub(super) port: &'a mut dyn CpPort,
    pub(super) outcome: Option<Result<(), SendError>>,
}

impl Wire for Outlet<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.leds.transmit(true);
        self.port.put_out(bytes);
    }

    fn take_back(&mut self) -> usize {
        self.port.take_back()
    }

    fn rts(&mut self, on: bool) {
        self.modem.set_rts(on);
        self.port.rts(on);
    }
}

impl Sink for Outlet<'_> {
    fn room(&self) -> usize {
        if self.is_fragmented { self.ring.room_for_part() } else { self.ring.room() }
    }

    fn deliver(&mut self, telegram: &[u8]) {
        let is_stored = self.ring.push(telegram);
        self.port.received(self.now, telegram, is_stored);
    }

    fn part(&mut self, bytes: &[u8], part: Part) {
        // There is room for it: it was checked before, or reserved for the end.
        self.ring.push_part(bytes, part);
        if part == Part::Last {
            self.port.count(Counter::TelegramsReceived, 1);
        }
        if !bytes.is_empty() {
            self.port.event(self.now, CpEvent::Received(bytes));
        }
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.outcome = Some(outcome);
    }

    fn report(&mut self, event: Event) {
        self.leds.occurred(self.now, event);
        if let Some(kind) = Kind::of(event).filter(|kind| *kind != Kind::OpenCircuit) {
            self.diagnosis.error(kind, event.number().unwrap_or(0));
        }
        self.port.occurred(self.now, event);
    }

    fn baud(&mut self, baud: u32) {
        // Most telegrams have the rate of the previous one: the line is set only when needed.
        if let Some(settings) = self.settings.as_mut().filter(|settings| settings.baud != baud) {
            settings.baud = baud;
            self.port.line_settings(settings);
        }
    }
}
