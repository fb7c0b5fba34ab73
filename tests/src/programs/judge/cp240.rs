//! The judge of the CP 240's handling blocks.

use ob1_cpu::Cpu;
use ob1_time::Instant;

use super::{Judge, Scan, Verdict};
use crate::programs::cp240::{Facts, Partner240};
use crate::programs::run::Deed;

/// The judge.
#[derive(Debug)]
pub struct Bench240 {
    facts: Facts,
}

impl Bench240 {
    /// The judge of a case.
    #[must_use]
    pub fn new(facts: Facts) -> Self {
        Self { facts }
    }
}

impl Judge<Partner240> for Bench240 {
    fn scan(&mut self, _: &Scan<'_>, _: &mut Cpu, _: &mut Partner240, _: &mut Verdict) {
        let _ = &self.facts;
    }
    fn deed(&mut self, _: Instant, _: &Deed) {}
    fn end(&mut self, _: Instant, _: &mut Partner240, _: &mut Verdict) {}
}
