//! The firmware of the segment: a CP of the configured type, and when it is due.

use ob1_firmware::{Cp, CpInput, CpPort, Instant};
use ob1_params::CpKind;

use crate::keys::CpType;

pub(crate) struct Module {
    kind: CpKind,
    firmware: Box<dyn Cp>,
    due: Option<Instant>,
}

impl Module {
    /// A module without parameters, of the attached generation, with `io_bytes` bytes each way.
    pub(crate) fn new(kind: CpKind, generation: u64, io_bytes: usize) -> Self {
        Self { kind, firmware: ob1_firmware::of(kind, generation, io_bytes), due: None }
    }

    pub(crate) const fn kind(&self) -> CpKind {
        self.kind
    }

    /// When a [`CpInput::Tick`] is due.
    pub(crate) const fn due(&self) -> Option<Instant> {
        self.due
    }

    /// Whether its parameters are valid, and the CPU has acknowledged its start-up where it has one.
    pub(crate) fn is_working(&self) -> bool {
        self.firmware.is_working()
    }

    pub(crate) fn cp(&self) -> &dyn Cp {
        &*self.firmware
    }

    pub(crate) fn enable_diagnostics(&mut self, enabled: bool) {
        self.firmware.enable_diagnostics(enabled);
    }

    /// Passes one input to the firmware, and keeps when it is due next.
    pub(crate) fn step(&mut self, now: Instant, input: CpInput<'_>, port: &mut dyn CpPort) {
        self.due = self.firmware.step(now, input, port);
    }

    /// Parameters: the 16 bytes, or the keys of a type that has keys.
    pub(crate) fn parametrise(&mut self, now: Instant, bytes: &[u8; 16], kind: &CpType, port: &mut dyn CpPort) {
        self.firmware.set_interface(kind.interface);
        let input = match &kind.keys {
            Some(keys) => CpInput::Keys(keys.as_ref()),
            None => CpInput::Parameters(bytes),
        };
        self.step(now, input, port);
    }
}
