//! The two directions of a line: what it tells, and what is put on it.

use crate::{LineFault, ModemLines};

/// What a line tells whoever is at its end. From the line to the protocol machine an occurrence keeps this type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineInput<'a> {
    /// Characters came in, in this order; now is the end of the last one. A character that the line could not read is
    /// not among them: a [`LineInput::Fault`] stands in its place.
    Rx(&'a [u8]),
    /// The last bit of everything handed to [`Wire::transmit`] has left. A line reports it before any character that
    /// came in later. A line that is gone, or has no partner, swallows its output and reports this all the same.
    TxDone,
    /// A character could not be read, the line is gone, or it is back. A line that has never been there is gone: tell
    /// it once at the start.
    Fault(LineFault),
    /// The modem lines have changed.
    Modem(ModemLines),
}

/// The end of a line as whoever sends on it sees it.
pub trait Wire {
    /// Puts characters on the line, behind those handed over before.
    fn transmit(&mut self, bytes: &[u8]);

    /// Takes back what has not yet begun to leave; the result is how many characters will not be sent. A line that
    /// cannot do it answers 0 and sends all. In either case [`LineInput::TxDone`] comes when the line has fallen
    /// silent.
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
