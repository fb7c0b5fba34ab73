//! A CP of any type, as whoever owns one sees it.

use std::fmt;

use ob1_params::CpKind;
use ob1_protocols::Nanos;

use crate::cp341::Input341;
use crate::{Cp040, Cp240, Cp341, CpInput, CpPort};

/// A whole CP.
pub trait Cp: fmt::Debug {
    /// Takes one input at time `now`; the result is when [`CpInput::Tick`] is due. An input that this type does not
    /// have changes nothing.
    fn step(&mut self, now: Nanos, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Nanos>;

    /// Whether its parameters are valid, and the CPU has acknowledged its start-up where it has one.
    fn is_working(&self) -> bool;

    /// Enables or disables diagnostic interrupts.
    fn enable_diagnostics(&mut self, enabled: bool);
}

/// The firmware of a type, without parameters. `generation`: how often a driver has attached to the segment;
/// `io_bytes`: bytes each way, where the station file chooses them.
#[must_use]
pub fn of(kind: CpKind, generation: u64, io_bytes: usize) -> Box<dyn Cp> {
    match kind {
        CpKind::Cp240 => Box::new(Cp240::new(generation)),
        CpKind::Cp040 => Box::new(Cp040::new(io_bytes)),
        CpKind::Cp341 | CpKind::Cp340 => Box::new(Cp341::of(kind)),
    }
}

impl Cp for Cp240 {
    fn step(&mut self, now: Nanos, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Nanos> {
        Self::step(self, now, input, port)
    }

    fn is_working(&self) -> bool {
        Self::is_working(self)
    }

    fn enable_diagnostics(&mut self, enabled: bool) {
        Self::enable_diagnostics(self, enabled);
    }
}

impl Cp for Cp040 {
    fn step(&mut self, now: Nanos, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Nanos> {
        Self::step(self, now, input, port)
    }

    fn is_working(&self) -> bool {
        Self::is_working(self)
    }

    fn enable_diagnostics(&mut self, enabled: bool) {
        Self::enable_diagnostics(self, enabled);
    }
}

impl Cp for Cp341 {
    fn step(&mut self, now: Nanos, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Nanos> {
        let input = match input {
            CpInput::Tick => Input341::Tick,
            CpInput::Line(input) => Input341::Line(input),
            CpInput::CpuRun(run) => Input341::CpuRun(run),
            CpInput::Channel(channel, block) => Input341::Channel(channel, block),
            CpInput::Keys(keys) => Input341::Parameters(keys),
            CpInput::Outputs(outputs) => match outputs.first_chunk() {
                Some(outputs) => Input341::Outputs(outputs),
                // Fewer bytes than it has: the segment is another module's.
                None => Input341::Tick,
            },
            // Its parameters are keys.
            CpInput::Parameters(_) => Input341::Tick,
        };
        Self::step(self, now, input, port)
    }

    fn is_working(&self) -> bool {
        Self::is_working(self)
    }

    fn enable_diagnostics(&mut self, enabled: bool) {
        Self::enable_diagnostics(self, enabled);
    }
}
