//! The line as the pump needs it.

use ob1_firmware::{CpEvent, Instant, LineSettings, Span};

use crate::keys::CpType;

/// The driver's configuration was refused, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(pub String);

/// The line as the pump needs it: it puts things out here. What comes in goes to
/// [`CpPump::line_event`](crate::CpPump::line_event).
pub trait LinePort {
    /// A parameter transfer brought this JSON text. It comes before [`Self::apply`].
    ///
    /// # Errors
    /// [`Refused`]: the pump shows it; the CP goes on with the line it has, or none.
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

    /// Sends characters behind those before.
    fn transmit(&mut self, now: Instant, bytes: &[u8]);

    /// Takes back what has not begun to leave; answers how many characters.
    fn take_back(&mut self, now: Instant) -> usize {
        let _ = now;
        0
    }

    /// How late characters that have come in may be handed over, because they come in bursts.
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

    /// The module's type as the configuration says; asked after [`Self::configure`].
    fn cp_type(&self) -> CpType {
        CpType::CP240
    }

    /// Something for the log.
    fn trace(&mut self, now: Instant, event: &CpEvent<'_>) {
        let _ = (now, event);
    }
}
