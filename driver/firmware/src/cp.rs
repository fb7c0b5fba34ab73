//! The firmware of each type.

use ob1_params::CpKind;
use ob1_protocols::Instant;

use crate::cp040::Cp040;
use crate::cp240::Cp240;
use crate::cp341::Cp341;
use crate::port::{Cp, CpInput, CpPort};

/// The firmware of a type, without parameters. `generation`: how often a driver has attached to the segment;
/// `io_bytes`: bytes each way, where the station file chooses them.
#[must_use]
pub fn of(kind: CpKind, generation: u64, io_bytes: usize) -> Box<dyn Cp> {
    match kind {
        CpKind::Cp240 => Box::new(Cp240::new(generation)),
        CpKind::Cp040 => Box::new(Cp040::new(io_bytes)),
        CpKind::Cp341 | CpKind::Cp340 => Box::new(Cp341::of(kind, generation)),
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
