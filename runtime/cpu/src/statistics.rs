//! Scan statistics: cycle and execution times in histograms of fixed range, so that recording allocates nothing.

use hdrhistogram::Histogram;

use crate::Nanos;

/// Longest time a histogram tells apart, 60 s; longer ones count as that.
pub(crate) const LONGEST: u64 = 60_000_000_000;

/// A distribution of times in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distribution {
    /// Recorded values.
    pub count: u64,
    /// Smallest.
    pub min: u64,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub p50: u64,
    /// 99 % are at most this.
    pub p99: u64,
    /// 99.9 % are at most this.
    pub p999: u64,
    /// Largest, exact.
    pub max: u64,
}

/// Figures of the scans since the start or the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanStatistics {
    /// Finished cycles in RUN.
    pub scans: u64,
    /// Statements executed, of all organization blocks.
    pub statements: u64,
    /// Cycles that began after their deadline because the one before took longer than the minimum cycle time.
    pub overruns: u64,
    /// Cycles in which the watchdog expired.
    pub watchdogs: u64,
    /// From the start of a cycle to the start of the next.
    pub cycle: Distribution,
    /// From the start of a cycle to its end, without the wait.
    pub execution: Distribution,
}

#[derive(Debug)]
pub(crate) struct Statistics {
    cycle: Histogram<u64>,
    execution: Histogram<u64>,
    longest_cycle: u64,
    longest_execution: u64,
    pub(crate) scans: u64,
    pub(crate) overruns: u64,
    pub(crate) watchdogs: u64,
}

impl Statistics {
    pub(crate) fn new() -> Self {
        let histogram =
            || Histogram::new_with_bounds(1, LONGEST, 3).expect("constant bounds that hdrhistogram accepts");
        Self {
            cycle: histogram(),
            execution: histogram(),
            longest_cycle: 0,
            longest_execution: 0,
            scans: 0,
            overruns: 0,
            watchdogs: 0,
        }
    }

    pub(crate) fn record_cycle(&mut self, time: Nanos) {
        self.longest_cycle = self.longest_cycle.max(time);
        self.cycle.saturating_record(time.clamp(1, LONGEST));
    }

    pub(crate) fn record_execution(&mut self, time: Nanos) {
        self.longest_execution = self.longest_execution.max(time);
        self.execution.saturating_record(time.clamp(1, LONGEST));
    }

    pub(crate) fn reset(&mut self) {
        self.cycle.reset();
        self.execution.reset();
        (self.longest_cycle, self.longest_execution) = (0, 0);
        (self.scans, self.overruns, self.watchdogs) = (0, 0, 0);
    }

    pub(crate) fn snapshot(&self, statements: u64) -> ScanStatistics {
        ScanStatistics {
            scans: self.scans,
            statements,
            overruns: self.overruns,
            watchdogs: self.watchdogs,
            cycle: distribution(&self.cycle, self.longest_cycle),
            execution: distribution(&self.execution, self.longest_execution),
        }
    }
}

pub(crate) fn distribution(histogram: &Histogram<u64>, max: u64) -> Distribution {
    if histogram.is_empty() {
        return Distribution::default();
    }
    Distribution {
        count: histogram.len(),
        min: histogram.min().min(max),
        mean: histogram.mean(),
        p50: histogram.value_at_quantile(0.5).min(max),
        p99: histogram.value_at_quantile(0.99).min(max),
        p999: histogram.value_at_quantile(0.999).min(max),
        max,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures() {
        let mut statistics = Statistics::new();
        assert_eq!(statistics.snapshot(0).cycle, Distribution::default());
        for time in 1..=1000 {
            statistics.record_cycle(time * 1000);
        }
        let cycle = statistics.snapshot(7).cycle;
        assert_eq!((cycle.count, cycle.max), (1000, 1_000_000));
        assert!((499_000..=501_000).contains(&cycle.p50), "{}", cycle.p50);
        assert!((989_000..=991_500).contains(&cycle.p99), "{}", cycle.p99);
        statistics.record_cycle(u64::MAX);
        assert_eq!(statistics.snapshot(7).cycle.max, u64::MAX);
        statistics.reset();
        assert_eq!(statistics.snapshot(0), ScanStatistics::default());
    }
}
