//! The firmware behind the segment: a CP of the type the configuration names. The only place that tells the types
//! apart.

use ob1_firmware::cp341::{Channel, ChannelBlock, Cp341, Input341};
use ob1_firmware::{Cp040, Cp240, CpInput, CpPort, Nanos};
use ob1_params::CpKind;

use crate::keys::CpType;

/// A module, and when it wants to be called.
pub(crate) struct Module {
    firmware: Firmware,
    due: Option<Nanos>,
}

/// Boxed: one of them lives as long as the process.
enum Firmware {
    Cp240(Box<Cp240>),
    Cp040(Box<Cp040>),
    Cp341(Box<Cp341>),
}

impl Module {
    /// A module without parameters, of the generation that has attached, with so many bytes each way.
    pub(crate) fn new(kind: CpKind, generation: u64, io_bytes: usize) -> Self {
        let firmware = match kind {
            CpKind::Cp240 => Firmware::Cp240(Box::new(Cp240::new(generation))),
            CpKind::Cp040 => Firmware::Cp040(Box::new(Cp040::new(io_bytes))),
            CpKind::Cp341 | CpKind::Cp340 => Firmware::Cp341(Box::new(Cp341::of(kind))),
        };
        Self { firmware, due: None }
    }

    /// Which type it is.
    pub(crate) const fn kind(&self) -> CpKind {
        match &self.firmware {
            Firmware::Cp240(_) => CpKind::Cp240,
            Firmware::Cp040(_) => CpKind::Cp040,
            Firmware::Cp341(cp) => cp.kind(),
        }
    }

    /// When a [`CpInput::Tick`] is due.
    pub(crate) const fn due(&self) -> Option<Nanos> {
        self.due
    }

    /// Whether its parameters are valid, and the CPU has acknowledged its start-up where it has one.
    pub(crate) fn is_working(&self) -> bool {
        match &self.firmware {
            Firmware::Cp240(cp) => cp.is_working(),
            Firmware::Cp040(cp) => cp.is_working(),
            Firmware::Cp341(cp) => cp.is_working(),
        }
    }

    /// Whether its handling blocks talk to it in channels.
    pub(crate) fn has_channels(&self) -> bool {
        self.kind().row().has_channels
    }

    /// Whether the place of the diagnostic record is its own: then there is none for the text of a line error.
    pub(crate) const fn has_record(&self) -> bool {
        matches!(self.firmware, Firmware::Cp040(_) | Firmware::Cp341(_))
    }

    /// Whether it wants the outputs as they stand before its first parameters. A CP 341 wants them behind: its driver
    /// says whose RTS and DTR are. [reference 2.2]
    pub(crate) const fn wants_outputs_first(&self) -> bool {
        !matches!(self.firmware, Firmware::Cp341(_))
    }

    pub(crate) fn enable_diagnostics(&mut self, enabled: bool) {
        match &mut self.firmware {
            Firmware::Cp240(cp) => cp.enable_diagnostics(enabled),
            Firmware::Cp040(cp) => cp.enable_diagnostics(enabled),
            Firmware::Cp341(cp) => cp.enable_diagnostics(enabled),
        }
    }

    /// Takes one input.
    pub(crate) fn step(&mut self, now: Nanos, input: CpInput<'_>, port: &mut dyn CpPort) {
        self.due = match &mut self.firmware {
            Firmware::Cp240(cp) => cp.step(now, input, port),
            Firmware::Cp040(cp) => cp.step(now, input, port),
            Firmware::Cp341(cp) => match input_341(input) {
                Some(input) => cp.step(now, input, port),
                None => return,
            },
        };
    }

    /// Parameters: the 16 bytes, or the keys of a type that has keys.
    pub(crate) fn parametrise(&mut self, now: Nanos, bytes: &[u8; 16], kind: &CpType, port: &mut dyn CpPort) {
        match (&mut self.firmware, &kind.keys) {
            (Firmware::Cp341(cp), Some(parameters)) => {
                self.due = cp.step(now, Input341::Parameters(parameters.as_ref()), port);
            }
            _ => self.step(now, CpInput::Parameters(bytes), port),
        }
    }

    /// What a handling block shows in a channel; nothing to the others.
    pub(crate) fn channel(&mut self, now: Nanos, channel: Channel, block: &ChannelBlock, port: &mut dyn CpPort) {
        if let Firmware::Cp341(cp) = &mut self.firmware {
            self.due = cp.step(now, Input341::Channel(channel, block), port);
        }
    }
}

/// What all CPs are told, in the words of a CP 341; `None`: nothing to it.
fn input_341(input: CpInput<'_>) -> Option<Input341<'_>> {
    Some(match input {
        CpInput::Tick => Input341::Tick,
        CpInput::Line(input) => Input341::Line(input),
        CpInput::CpuRun(run) => Input341::CpuRun(run),
        // Fewer bytes than a CP 341 has: the segment is another module's.
        CpInput::Outputs(outputs) => Input341::Outputs(outputs.first_chunk()?),
        // Its parameters are keys.
        CpInput::Parameters(_) => return None,
    })
}
