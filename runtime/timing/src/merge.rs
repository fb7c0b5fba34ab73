//! The accounts of many stations as those of one: distributions merge exactly, bucket by bucket.

use ob1_cpu::Histogram;
use ob1_time::Span;

use super::snapshot::{ObTiming, Spread, Timing};

impl Timing {
    /// Takes over the scans of another station, which were read with their buckets. Times by the clock, the interval
    /// and the limits stay those of the first: whoever merges has seen to it that they are the same.
    pub fn merge(&mut self, other: &Self) {
        self.scans = self.scans.saturating_add(other.scans);
        self.statements = self.statements.saturating_add(other.statements);
        self.overruns = self.overruns.saturating_add(other.overruns);
        self.missed = self.missed.saturating_add(other.missed);
        self.watchdogs = self.watchdogs.saturating_add(other.watchdogs);
        self.cycle.merge(&other.cycle);
        self.wake.merge(&other.wake);
        self.deadlines.merge(&other.deadlines);
        self.execution.merge(&other.execution);
        self.inputs.merge(&other.inputs);
        self.outputs.merge(&other.outputs);
        self.links.merge(&other.links);
        for ob in &other.obs {
            match self.obs.iter_mut().find(|known| known.ob == ob.ob) {
                Some(known) => known.merge(ob),
                None => self.obs.push(ob.clone()),
            }
        }
        for block in &other.blocks {
            match self.blocks.iter_mut().find(|known| (&known.block, &known.name) == (&block.block, &block.name)) {
                Some(known) => known.execution.merge(&block.execution),
                None => self.blocks.push(block.clone()),
            }
        }
        self.late.merge(&other.late);
    }
}

impl ObTiming {
    fn merge(&mut self, other: &Self) {
        self.runs = self.runs.saturating_add(other.runs);
        self.overruns = self.overruns.saturating_add(other.overruns);
        self.execution.merge(&other.execution);
        self.lateness.merge(&other.lateness);
    }
}

impl Spread {
    /// The distribution of the values of both. A bucket may be named by the greatest value of its reading: the values
    /// find their buckets again by it.
    fn merge(&mut self, other: &Self) {
        let buckets = self.buckets.iter().chain(&other.buckets);
        let histogram = Histogram::of(buckets.map(|(value, count)| (Span::from_nanos(*value), *count)));
        *self = Self::new(&histogram.with_sum(Span::from_nanos(self.sum().saturating_add(other.sum()))), true);
    }

    /// The mean is not rounded: it has the sum in it.
    fn sum(&self) -> u64 {
        (self.mean_ns * self.count as f64).round() as u64
    }
}
