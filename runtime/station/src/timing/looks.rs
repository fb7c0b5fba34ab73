//! The looks at the kernel's counters, in their order, and what they say about one scan. Pure.
//!
//! What is measured: the scan thread's time on a core and its waiting for one, between the last look before the scan
//! began and the scan's own look at its end. Other scans may lie between the two. The accounts know how much time these
//! have lost at all, so that what is left of the waiting is this scan's.

use std::collections::VecDeque;

use ob1_cpu::{Nanos, ScanRecord, Sums};
use ob1_rt::ThreadTimes;

use super::cause::{Evidence, Measured};
use super::kernel::Counters;

/// Samples kept: what a scan of some seconds is explained from.
const SAMPLES: usize = 256;
/// Pairs of samples that say what is usual.
const ENOUGH: usize = 8;
/// The observer is late when it comes so much after its time.
const OBSERVER_LATE: Nanos = 1_000_000;

/// A late scan, and its own look at its end.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LateScan {
    pub(super) record: ScanRecord,
    pub(super) times: Option<ThreadTimes>,
    pub(super) sums: Sums,
    /// When the scan before it had been handed over, if that was late too; otherwise 0.
    pub(super) ready: Nanos,
}

/// The accounts and the thread's times at one moment.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Look {
    pub(super) sums: Sums,
    pub(super) times: ThreadTimes,
}

/// One look of the observer.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sample {
    /// Nothing in it is older.
    pub(super) from: Nanos,
    /// Nothing in it is newer.
    pub(super) to: Nanos,
    /// Where the kernel has `schedstat`, and no scan ended while it was taken.
    pub(super) look: Option<Look>,
    pub(super) counters: Counters,
    /// SIGCONT came since the sample before, at this time.
    pub(super) continued: Option<Nanos>,
    /// So much later than planned.
    pub(super) late: Nanos,
}

#[derive(Debug)]
pub(super) struct Looks {
    samples: VecDeque<Sample>,
    /// The late scan before.
    last: Option<LateScan>,
    /// Between two samples.
    every: Nanos,
}

impl Looks {
    pub(super) fn new(every: Nanos) -> Self {
        Self { samples: VecDeque::with_capacity(SAMPLES), last: None, every }
    }

    pub(super) fn enter(&mut self, sample: Sample) {
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    /// What is known about a late scan. They come in their order, each when a sample has been taken after it.
    pub(super) fn evidence(&mut self, late: &LateScan, ns_per_statement: Nanos) -> Evidence {
        let record = &late.record;
        let end = record.end.max(record.planned);
        let before = self.samples.iter().rev().find(|s| s.to <= record.planned).or(self.samples.front());
        let before = before.copied().unwrap_or_default();
        let after = self.samples.iter().find(|s| s.from >= end).or(self.samples.back()).copied().unwrap_or_default();
        let within = self.samples.iter().filter(|s| s.to > before.to && s.from <= after.to.saturating_add(self.every));
        let observer_late_ns = within.map(|s| s.late).filter(|late| *late > OBSERVER_LATE).max().unwrap_or(0);
        let (was, is) = (&before.counters, &after.counters);
        let evidence = Evidence {
            no_sleep: late.ready >= record.planned && late.ready > 0,
            window_ns: after.to.saturating_sub(before.from),
            measured: self.measured(late),
            steal_ns: is.steal.saturating_sub(was.steal),
            interrupts_ns: is.interrupts.saturating_sub(was.interrupts),
            throttled_ns: is.throttled.saturating_sub(was.throttled),
            switches: is.switches.saturating_sub(was.switches),
            minor_faults: is.minor_faults.saturating_sub(was.minor_faults),
            major_faults: is.major_faults.saturating_sub(was.major_faults),
            stopped: self.samples.iter().filter_map(|s| s.continued).any(|at| self.was_stopped(record, at)),
            observer_late_ns,
            ns_per_statement,
        };
        self.last = Some(*late);
        evidence
    }

    /// From the last look before the scan was due, or the end of the late scan before, to its own.
    fn measured(&self, late: &LateScan) -> Option<Measured> {
        let (record, times) = (&late.record, late.times?);
        let sample = self.samples.iter().rev().filter(|s| s.to <= record.planned).find_map(|s| Some((s.to, s.look?)));
        let scan = self.last.filter(|last| last.record.end <= record.start);
        let scan = scan.and_then(|last| Some((last.record.end, Look { sums: last.sums, times: last.times? })));
        let (since, was) = sample.into_iter().chain(scan).max_by_key(|(time, _)| *time)?;
        let own = Sums { scans: 1, late: 1, wake: record.lateness(), execution: record.execution() };
        let (others, others_ns) = lost(&was, &Look { sums: late.sums, times }, &own);
        Some(Measured {
            window_ns: record.end.saturating_sub(since),
            waited_ns: times.waited.saturating_sub(was.times.waited),
            ran_ns: times.ran.saturating_sub(was.times.ran),
            others,
            others_ns: (others_ns as f64 * self.waiting_share()) as Nanos,
        })
    }

    /// How much of what scans on time lose is waiting for a core: nine tenths of the samples without a late scan between
    /// them have less. 1 where that is not known.
    fn waiting_share(&self) -> f64 {
        let looks = || self.samples.iter().filter_map(|s| s.look);
        let pairs = looks().zip(looks().skip(1)).filter(|(a, b)| a.sums.late == b.sums.late);
        let shares = pairs.filter_map(|(a, b)| {
            let (_, time) = lost(&a, &b, &Sums::default());
            (time > 0).then(|| b.times.waited.saturating_sub(a.times.waited) as f64 / time as f64)
        });
        let mut shares: Vec<f64> = shares.collect();
        if shares.len() < ENOUGH {
            return 1.0;
        }
        shares.sort_by(f64::total_cmp);
        shares[shares.len() * 9 / 10].min(1.0)
    }

    /// Whether the process was stopped in this scan, or before it began, when it was continued at this time.
    fn was_stopped(&self, record: &ScanRecord, continued: Nanos) -> bool {
        // The scan may have gone on, and ended, before the thread that takes the signals came to note it.
        let noted_by = record.end.max(record.planned) + self.every;
        (record.planned..=noted_by).contains(&continued)
    }
}

/// Scans between two looks, without one with these sums of its own, and the time they have lost: beginning late, and
/// off their core.
fn lost(was: &Look, is: &Look, own: &Sums) -> (u64, Nanos) {
    let since = |now: u64, then: u64, own: u64| now.wrapping_sub(then).saturating_sub(own);
    let wake = since(is.sums.wake, was.sums.wake, own.wake);
    let execution = since(is.sums.execution, was.sums.execution, own.execution);
    let ran = since(is.times.ran, was.times.ran, own.execution);
    (since(is.sums.scans, was.sums.scans, own.scans), wake.saturating_add(execution.saturating_sub(ran)))
}
