//! What the CP reports when diagnostics are enabled: "the error causes transmission of diagnostic bytes" [S0 L1458].
//!
//! The error comes with ER and goes with it, 4 s after its last occurrence: a disturbed line raises one interrupt, not
//! one for each character. Another kind of error while ER is on raises an interrupt of its own.
//!
//! The manual prints no bytes. The first four are those of an S7 module's data record 0 as the CP 341 has them
//! [CP 341 manual 09/2008, p. 204]; two more name the occurrence as in the event classes 7 and 8.

use ob1_protocols::{Event, LineFault, What};

/// Diagnostic bytes of an error, or of its end.
pub type DiagnosticBytes = [u8; 6];

/// The diagnostic record of a CP 040 (record set 01h): ERR_A to CH7ERR, and the µs ticker: 20 bytes, 2 of them the
/// reserved ones the index list leaves out. [S3 "Diagnostic data"]
pub type DiagnosticRecord = [u8; 20];

/// Module class: communication module.
pub(crate) const CLASS: u8 = 0x0C;

/// Bytes 0 and 2 for an open circuit: the line or its device is gone. 25 0C 02 00 [CP 341 manual 09/2008, p. 204]
pub(crate) const OPEN_CIRCUIT: (u8, u8) = (0x25, 0x02);

/// Kinds of error, distinguished by what they set in bytes 0 and 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Open circuit: the line or its device is gone.
    OpenCircuit,
    /// Parity, framing, break or lost characters: external fault, communication.
    Line,
    /// The receive buffer is full, or a telegram too long for it: internal fault.
    Overflow,
}

impl Kind {
    /// The kind of an occurrence that lights ER.
    pub(crate) fn of(event: Event) -> Option<Self> {
        Some(match event.what {
            What::NoBuffer | What::TooLong => Self::Overflow,
            What::Line(LineFault::Gone) => Self::OpenCircuit,
            What::Line(LineFault::Back) => return None,
            What::Line(_) => Self::Line,
            _ => return None,
        })
    }

    const fn bytes(self) -> (u8, u8) {
        match self {
            Self::OpenCircuit => OPEN_CIRCUIT,
            Self::Line => (0x05, 0x02),
            Self::Overflow => (0x03, 0x00),
        }
    }
}

/// The faults found, and those reported.
#[derive(Debug)]
pub(crate) struct Diagnosis {
    pub(crate) enabled: bool,
    found: (u8, u8),
    told: (u8, u8),
    number: u16,
}

impl Diagnosis {
    pub(crate) const NONE: Self = Self { enabled: false, found: (0, 0), told: (0, 0), number: 0 };

    /// An error that lights ER.
    pub(crate) fn error(&mut self, kind: Kind, number: u16) {
        let (fault, where_) = kind.bytes();
        self.found = (self.found.0 | fault, self.found.1 | where_);
        self.number = number;
    }

    /// The report that is due now, with `true` for an error that comes; `er` is the LED.
    pub(crate) fn tell(&mut self, er: bool) -> Option<(bool, DiagnosticBytes)> {
        if !er {
            let gone = self.told != (0, 0);
            (self.found, self.told) = ((0, 0), (0, 0));
            return (gone && self.enabled).then_some((false, [0, CLASS, 0, 0, 0, 0]));
        }
        if self.found == self.told {
            return None;
        }
        self.told = self.found;
        let [high, low] = self.number.to_be_bytes();
        self.enabled.then_some((true, [self.found.0, CLASS, self.found.1, 0, high, low]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_comes_once_and_goes_with_er() {
        let mut diagnosis = Diagnosis { enabled: true, ..Diagnosis::NONE };
        assert_eq!(diagnosis.tell(false), None);
        diagnosis.error(Kind::Line, 0x080C);
        assert_eq!(diagnosis.tell(true), Some((true, [0x05, 0x0C, 0x02, 0, 0x08, 0x0C])));
        diagnosis.error(Kind::Line, 0x080C);
        assert_eq!(diagnosis.tell(true), None, "ER is on: it was told");
        diagnosis.error(Kind::Overflow, 0x080A);
        assert_eq!(diagnosis.tell(true), Some((true, [0x07, 0x0C, 0x02, 0, 0x08, 0x0A])), "another kind");
        assert_eq!(diagnosis.tell(false), Some((false, [0, 0x0C, 0, 0, 0, 0])));
        assert_eq!(diagnosis.tell(false), None);
        diagnosis.error(Kind::OpenCircuit, 0);
        assert_eq!(diagnosis.tell(true), Some((true, [0x25, 0x0C, 0x02, 0, 0, 0])));
    }

    #[test]
    fn nothing_is_told_while_diagnostics_are_disabled() {
        let mut diagnosis = Diagnosis::NONE;
        diagnosis.error(Kind::Line, 0x080C);
        assert_eq!((diagnosis.tell(true), diagnosis.tell(false)), (None, None));
    }
}
