//! The diagnostic record (record set 01h) and when it is reported. [S3 "Diagnostic data"]

use ob1_protocols::Instant;

use crate::diagnosis::DiagnosticRecord;

/// ERR_A: module fault; set together with every other fault.
const FAULT: u8 = 1 << 0;
/// ERR_A: error outside of the module.
const EXTERNAL: u8 = 1 << 2;
/// ERR_A: error in the parameters.
const PARAMETERS: u8 = 1 << 7;
/// CH0ERR: the receive line is open.
const WIRE_BREAK: u8 = 1 << 4;

/// The faults of the module, and which of them have been reported.
#[derive(Debug)]
pub(super) struct Diagnosis {
    /// Diagnostic interrupts are enabled: DIAG_EN = 40h.
    pub(super) enabled: bool,
    /// An open receive line, if the line preset makes it visible.
    pub(super) wire_break: bool,
    /// The module has no valid parameters.
    pub(super) parameters: bool,
    told: (bool, bool),
    record: DiagnosticRecord,
}

impl Diagnosis {
    pub(super) const fn new() -> Self {
        let mut diagnosis =
            Self { enabled: false, wire_break: false, parameters: false, told: (false, false), record: [0; 20] };
        diagnosis.compose(Instant::START);
        diagnosis
    }

    const fn compose(&mut self, now: Instant) {
        let mut error = 0;
        if self.wire_break {
            error |= FAULT | EXTERNAL;
        }
        if self.parameters {
            error |= FAULT | PARAMETERS;
        }
        // Communication module with channel information, channel type, 8 bits for a channel, 1 channel. [S3 L333]
        self.record = [error, 0x1C, 0, 0, 0x60, 8, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        if self.wire_break {
            (self.record[7], self.record[8]) = (1, WIRE_BREAK);
        }
        // The ticker begins with 0 when the module is switched on, and wraps after 2^32 µs. [S3 L337]
        let ticker = (now.since_start().micros() as u32).to_be_bytes();
        (self.record[16], self.record[17], self.record[18], self.record[19]) =
            (ticker[0], ticker[1], ticker[2], ticker[3]);
    }

    /// The record as of the last change.
    pub(super) const fn record(&self) -> &DiagnosticRecord {
        &self.record
    }

    /// What has changed: `Some(true)` if an error has come, `Some(false)` if one has gone. The record is then updated.
    pub(super) fn change(&mut self, now: Instant) -> Option<bool> {
        let found = (self.wire_break, self.parameters);
        if found == self.told {
            return None;
        }
        let incoming = found.0 && !self.told.0 || found.1 && !self.told.1;
        self.told = found;
        self.compose(now);
        Some(incoming)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wire_break_is_told_with_its_time() {
        let mut diagnosis = Diagnosis::new();
        assert_eq!(diagnosis.record()[..9], [0, 0x1C, 0, 0, 0x60, 8, 1, 0, 0]);
        assert_eq!(diagnosis.change(Instant::from_nanos(5)), None);
        diagnosis.wire_break = true;
        // 2^32 µs and 7 more.
        assert_eq!(diagnosis.change(Instant::from_micros((1 << 32) + 7)), Some(true));
        assert_eq!(diagnosis.record()[..9], [0x05, 0x1C, 0, 0, 0x60, 8, 1, 1, 0x10]);
        assert_eq!(diagnosis.record()[16..], [0, 0, 0, 7]);
        diagnosis.wire_break = false;
        assert_eq!(diagnosis.change(Instant::from_nanos(9_000)), Some(false));
        assert_eq!((diagnosis.record()[0], diagnosis.record()[19]), (0, 9));
        diagnosis.parameters = true;
        assert_eq!(diagnosis.change(Instant::from_nanos(10_000)), Some(true));
        assert_eq!(diagnosis.record()[0], 0x81);
    }
}
