//! Translates the firmware's types to those of the back plane.

use ob1_backplane::ModemInputs;
use ob1_firmware::ModemLines;

/// Number of the diagnostic record with the text of the last line error (UTF-8, at most 240 bytes; empty: the line is
/// up).
pub const LINE_TEXT_RECORD: u32 = 240;

/// Numbers of the events a driver emits; all are messages, none an interrupt: a CPU without OB 82 must not stop because
/// a cable was pulled.
///
/// Events of a protocol have the numbers of the event classes 7 and 8 (`0701h` first repetition, `0808h` block check
/// ...), those of RK 512 of 5, 6, 9 and 10 besides (`060Fh` locked by the coordination flag, `0A05h` no reaction ...).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum EventCode {
    /// A start-up identifier is shown; data: its number, then 0 after parameters or 1 after a reset request.
    Startup = 1,
    /// The CPU has acknowledged the start-up.
    Working = 2,
    /// The parameters are refused; data: the parameter byte.
    NoParameters = 3,
    /// The line is gone; data: the operating system's error number (4 bytes, big-endian; 0: none). The text is in
    /// record [`LINE_TEXT_RECORD`].
    LineGone = 4,
    /// The line can be used.
    LineUp = 5,
    /// An order ended with an error; data: the code of the indicator word (1 byte), or the STATUS (2, big-endian).
    SendFailed = 6,
    /// The driver's configuration (JSON) is refused; the text is in record [`LINE_TEXT_RECORD`].
    Configuration = 7,
    /// Something in the segment has no meaning.
    Segment = 8,
    /// The line gives back what is sent in half duplex; data: 1, or 0 when it has ceased to. The text is in record
    /// [`LINE_TEXT_RECORD`].
    LineEcho = 9,
}

pub(crate) fn modem(lines: ModemLines, rts: bool, dtr: bool) -> ModemInputs {
    ModemInputs { cts: lines.cts, dsr: lines.dsr, ri: lines.ri, cd: lines.cd, dtr, rts }
}
