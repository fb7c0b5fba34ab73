//! The information for a broker about a station that consists only of a CPU.

use ob1_access::Put;
use ob1_access::door::{BlockFact, Diagnosis, Document, State};
use ob1_broker::{DriverState, Facts, LinkState};
use ob1_cpu::DiagEntry;
use ob1_model::BlockId;
use ob1_time::Span;

/// A station with only a CPU.
#[derive(Clone, Copy, Debug)]
pub struct Bare;

impl Facts for Bare {
    fn name(&self) -> &str {
        "bare"
    }
    fn family(&self) -> u16 {
        300
    }
    fn areas(&self) -> [u32; 3] {
        [0; 3]
    }
    fn timers_and_counters(&self) -> [u16; 2] {
        [0; 2]
    }
    fn min_cycle(&self) -> Span {
        Span::ZERO
    }
    fn modules(&self) -> u32 {
        0
    }
    fn drivers(&self) -> Vec<DriverState> {
        Vec::new()
    }
    fn diagnosis(&self, _: &DiagEntry) -> Diagnosis {
        Diagnosis::default()
    }
    fn blocks(&self) -> Vec<BlockFact> {
        Vec::new()
    }
    fn block(&self, _: BlockId) -> Option<Box<[u8]>> {
        None
    }
    fn document(&self, _: Document, _: State, _: &[bool], _: &[LinkState]) -> Box<[u8]> {
        Box::default()
    }
    fn take_input(&self, _: &Put) -> bool {
        false
    }
}
