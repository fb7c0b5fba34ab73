//! The two directions of a line: its events, and output to it.

use crate::{LineFault, ModemLines};

/// An event of a line. It keeps this type all the way from the line to the protocol machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineInput<'a> {
    /// Characters came in, in this order; now is the end of the last one. An unreadable character is not among them: a
    /// [`LineInput::Fault`] takes its place.
    Rx(&'a [u8]),
    /// The last bit of everything handed to [`Wire::transmit`] has been sent. A line reports it before any character
    /// that came in later. A line that is gone, or has no partner, discards its output but still reports this.
    TxDone,
    /// A character could not be read, the line is gone, or it is back. A line that was never up counts as gone: report
    /// that once at the start.
    Fault(LineFault),
    /// The modem lines have changed.
    Modem(ModemLines),
}

/// The sending end of a line.
pub trait Wire {
    /// Sends characters, after those handed over before.
    fn transmit(&mut self, bytes: &[u8]);

    /// Takes back characters that have not begun; returns how many will not be sent. A line that cannot do this returns
    /// 0 and sends all. In either case [`LineInput::TxDone`] comes when the line has fallen silent.
    fn take_back(&mut self) -> usize {
        0
    }

    /// Sets the modem line RTS (hardware flow control: ON while characters can be taken; automatic use: ON while it
    /// sends).
    fn rts(&mut self, on: bool) {
        let _ = on;
    }

    /// Sets the modem line DTR (automatic use of the secondary signals).
    fn dtr(&mut self, on: bool) {
        let _ = on;
    }
}
