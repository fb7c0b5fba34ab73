//! The line for the pump.

use ob1_backplane::OrderTimes;
use ob1_firmware::{CpEvent, Instant, LineSettings, Span};

use crate::keys::CpType;

/// The driver's configuration was refused, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(pub String);

/// The line for the pump: it takes the pump's output. Input goes to [`CpPump::line_event`](crate::CpPump::line_event).
pub trait LinePort {
    /// A parameter transfer contained this JSON text. Called before [`Self::apply`].
    ///
    /// # Errors
    /// [`Refused`]: the pump reports it; the CP continues with its present line, or none.
    fn configure(&mut self, now: Instant, json: &[u8]) -> Result<(), Refused> {
        let _ = (now, json);
        Ok(())
    }

    /// The parameter bytes that came with it, if it was not refused.
    fn introduce(&mut self, now: Instant, parameters: &[u8; 16]) {
        let _ = (now, parameters);
    }

    /// Sets baud rate and character frame.
    fn apply(&mut self, now: Instant, settings: &LineSettings);

    /// Sends characters after the previous ones.
    fn transmit(&mut self, now: Instant, bytes: &[u8]);

    /// Takes back characters that have not begun; returns their number.
    fn take_back(&mut self, now: Instant) -> usize {
        let _ = now;
        0
    }

    /// How late received characters may be handed over, because they come in bursts.
    fn lateness(&self) -> Span {
        Span::ZERO
    }

    /// Sets RTS and DTR.
    fn set_modem_lines(&mut self, now: Instant, rts: bool, dtr: bool) {
        let _ = (now, rts, dtr);
    }

    /// Whether the configuration enables diagnostics; asked after [`Self::configure`].
    fn diagnostics(&self) -> bool {
        false
    }

    /// The module's type in the configuration; asked after [`Self::configure`].
    fn cp_type(&self) -> CpType {
        CpType::CP240
    }

    /// Something for the log.
    fn trace(&mut self, now: Instant, event: &CpEvent<'_>) {
        let _ = (now, event);
    }

    /// Where the time of an order or telegram went that has ended.
    fn times(&mut self, now: Instant, times: &OrderTimes) {
        let _ = (now, times);
    }
}
