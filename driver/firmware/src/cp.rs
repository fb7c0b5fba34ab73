//! A CP of any type, as its owner sees it.

use std::fmt;

use ob1_params::CpKind;
use ob1_protocols::Instant;

use crate::{Cp040, Cp240, Cp341, CpInput, CpPort};

/// A whole CP.
pub trait Cp: fmt::Debug {
    /// Takes one input at time `now` and returns when [`CpInput::Tick`] is due. An input that this type does not have
    /// changes nothing.
    fn step(&mut self, now: Instant, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Instant>;

    /// Whether its parameters are valid, and the CPU has acknowledged its start-up where it has one.
    fn is_working(&self) -> bool;

    /// Enables or disables diagnostic interrupts; off unless enabled. CP 240: errors that light ER are also reported as
    /// [`CpEvent::Diagnosis`](crate::CpEvent::Diagnosis); its parameter bytes have no place for this switch (ours: a
    /// key of the station file). CP 040, CP 340 and CP 341: a wire break and wrong parameters are reported.
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
        CpKind::Cp343 => Box::new(Elsewhere),
    }
}

/// A CP whose firmware is another process: the link of a CP 343. No serial driver ever creates one.
#[derive(Debug)]
struct Elsewhere;

impl Cp for Elsewhere {
    fn step(&mut self, _: Instant, _: CpInput<'_>, _: &mut dyn CpPort) -> Option<Instant> {
        None
    }

    fn is_working(&self) -> bool {
        false
    }

    fn enable_diagnostics(&mut self, _: bool) {}
}
