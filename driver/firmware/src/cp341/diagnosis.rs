//! Faults of a CP 341 as a module: its diagnostic data, and when a diagnostic interrupt is raised.
//! [CP 341 manual 09/2008, p. 204]

use super::model::Model;
use crate::diagnosis::{CLASS, DiagnosticBytes, OPEN_CIRCUIT};

/// Diagnostic data record 1; the first four bytes are record 0. The module has neither channel information nor user
/// information, so the twelve bytes after them have no meaning.
pub(crate) type Record = [u8; 16];

/// BREAK: the receiving line is interrupted.
const BREAK: u16 = 0x080D;
/// The parameters are not valid.
const PARAMETERS: u16 = 0x020F;

/// The faults of the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Faults {
    /// Wire break: the line is gone, or BREAK.
    pub(crate) wire_break: bool,
    /// The parameters are wrong.
    pub(crate) parameters: bool,
}

impl Faults {
    /// Data record 0 of this model.
    const fn bytes(self, model: &Model) -> [u8; 4] {
        let mut bytes = [0, CLASS, 0, 0];
        if self.wire_break {
            (bytes[0], bytes[2]) = OPEN_CIRCUIT;
        }
        if self.parameters {
            bytes[0] |= model.parameters_wrong;
        }
        bytes
    }

    const fn has_new(self, before: Self) -> bool {
        self.wire_break && !before.wire_break || self.parameters && !before.parameters
    }
}

/// The faults found, shown and reported.
#[derive(Debug)]
pub(crate) struct Diagnosis {
    model: &'static Model,
    /// Faults raise diagnostic interrupts.
    pub(crate) enabled: bool,
    cpu_running: bool,
    found: Faults,
    told: Faults,
    shown: Option<Record>,
}

impl Diagnosis {
    pub(crate) fn new(model: &'static Model) -> Self {
        let (found, told) = (Faults::default(), Faults::default());
        Self { model, enabled: false, cpu_running: false, found, told, shown: None }
    }

    /// "Events (either incoming or outgoing) that occurred when the CPU was in STOP mode are not stored. Events that
    /// are still present when the CPU switches back to RUN mode are signaled via a diagnostic interrupt."
    /// [CP 341 manual 09/2008, p. 204]
    pub(crate) fn cpu(&mut self, running: bool) {
        self.cpu_running = running;
        self.told = Faults::default();
    }

    /// Takes the present faults; returns the ones that have gone, for the diagnostic buffer.
    pub(crate) fn find(&mut self, found: Faults) -> impl Iterator<Item = u16> + use<> {
        let before = std::mem::replace(&mut self.found, found);
        let gone =
            [(before.wire_break && !found.wire_break, BREAK), (before.parameters && !found.parameters, PARAMETERS)];
        gone.into_iter().filter_map(|(gone, number)| gone.then_some(number))
    }

    /// The data record, if it has changed.
    pub(crate) fn record(&mut self) -> Option<Record> {
        let mut record = [0; 16];
        record[..4].copy_from_slice(&self.found.bytes(self.model));
        (self.shown.replace(record) != Some(record)).then_some(record)
    }

    /// The diagnostic interrupt that is due: whether something has come, the four bytes, and the event's number.
    pub(crate) fn interrupt(&mut self) -> Option<(bool, DiagnosticBytes)> {
        if !self.enabled || !self.cpu_running || self.found == self.told {
            return None;
        }
        let before = std::mem::replace(&mut self.told, self.found);
        let [a, b, c, d] = self.found.bytes(self.model);
        let [high, low] = if self.found.parameters { PARAMETERS.to_be_bytes() } else { [0, 0] };
        Some((self.found.has_new(before), [a, b, c, d, high, low]))
    }
}
