//! The looks at the kernel's counters, in their order, and what they say about one scan. Pure.
//!
//! What is measured: the scan thread's time on a core and its waiting for one, between the last look before the scan
//! began and the scan's own look at its end. Other scans may lie between the two. The accounts know how much time these
//! have lost in all; what is left of the waiting is this scan's.

use std::collections::VecDeque;

use ob1_cpu::{ScanRecord, Sums};
use ob1_rt::ThreadTimes;
use ob1_time::{Instant, Span};

use super::cause::{Evidence, Measured};
use super::kernel::Counters;

/// Samples kept: what a scan of some seconds is explained from.
const SAMPLES: usize = 256;
/// Pairs of samples needed to say what is usual.
const ENOUGH: usize = 8;
/// The observer is late when it comes this long after its time.
const OBSERVER_LATE: Span = Span::MILLISECOND;

/// A late scan, and its own look at its end.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LateScan {
    pub(super) record: ScanRecord,
    pub(super) times: Option<ThreadTimes>,
    pub(super) sums: Sums,
    /// When the scan before it had been handed over, if that was late too.
    pub(super) ready: Option<Instant>,
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
    pub(super) from: Instant,
    /// Nothing in it is newer.
    pub(super) to: Instant,
    /// Where the kernel has `schedstat`, and no scan ended while it was taken.
    pub(super) look: Option<Look>,
    pub(super) counters: Counters,
    /// SIGCONT came since the sample before, at this time.
    pub(super) continued: Option<Instant>,
    /// So much later than planned.
    pub(super) late: Span,
}

#[derive(Debug)]
pub(super) struct Looks {
    samples: VecDeque<Sample>,
    /// The late scan before.
    last: Option<LateScan>,
    /// Time between two samples.
    every: Span,
}

impl Looks {
    pub(super) fn new(every: Span) -> Self {
        Self { samples: VecDeque::with_capacity(SAMPLES), last: None, every }
    }

    pub(super) fn enter(&mut self, sample: Sample) {
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    /// What is known about a late scan. They come in their order, each when a sample has been taken after it.
    pub(super) fn evidence(&mut self, late: &LateScan, per_statement: Span) -> Evidence {
        let record = &late.record;
        let end = record.end.max(record.planned);
        let before = self.samples.iter().rev().find(|s| s.to <= record.planned).or(self.samples.front());
        let before = before.copied().unwrap_or_default();
        let after = self.samples.iter().find(|s| s.from >= end).or(self.samples.back()).copied().unwrap_or_default();
        let within = self.samples.iter().filter(|s| s.to > before.to && s.from <= after.to.saturating_add(self.every));
        let observer_late = within.map(|s| s.late).filter(|late| *late > OBSERVER_LATE).max().unwrap_or_default();
        let (was, is) = (&before.counters, &after.counters);
        let evidence = Evidence {
            no_sleep: late.ready.is_some_and(|ready| ready >= record.planned),
            window: after.to.since(before.from),
            measured: self.measured(late),
            steal: is.steal.saturating_sub(was.steal),
            interrupts: is.interrupts.saturating_sub(was.interrupts),
            throttled: is.throttled.saturating_sub(was.throttled),
            switches: is.switches.saturating_sub(was.switches),
            minor_faults: is.minor_faults.saturating_sub(was.minor_faults),
            major_faults: is.major_faults.saturating_sub(was.major_faults),
            stopped: self.samples.iter().filter_map(|s| s.continued).any(|at| self.was_stopped(record, at)),
            observer_late,
            per_statement,
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
        let (others, others_lost) = lost(&was, &Look { sums: late.sums, times }, &own);
        Some(Measured {
            window: record.end.since(since),
            waited: times.waited.saturating_sub(was.times.waited),
            ran: times.ran.saturating_sub(was.times.ran),
            others,
            others_waited: Span::from_nanos((others_lost.nanos() as f64 * self.waiting_share()) as u64),
        })
    }

    /// Which share of the time that scans on time lose is waiting for a core, over all samples without a late scan
    /// between them. 1 if there are too few.
    fn waiting_share(&self) -> f64 {
        let looks = || self.samples.iter().filter_map(|s| s.look);
        let on_time = looks().zip(looks().skip(1)).filter(|(a, b)| a.sums.late == b.sums.late);
        let (mut waited, mut all, mut pairs) = (Span::ZERO, Span::ZERO, 0);
        for (a, b) in on_time {
            waited += b.times.waited.saturating_sub(a.times.waited);
            all += lost(&a, &b, &Sums::default()).1;
            pairs += 1;
        }
        if pairs < ENOUGH || all.is_zero() { 1.0 } else { (waited.nanos() as f64 / all.nanos() as f64).min(1.0) }
    }

    /// Whether the process was stopped in this scan, or before it began, when it was continued at this time.
    fn was_stopped(&self, record: &ScanRecord, continued: Instant) -> bool {
        // The scan may have gone on, and ended, before the thread that takes the signals noted it.
        let noted_by = record.end.max(record.planned) + self.every;
        (record.planned..=noted_by).contains(&continued)
    }
}

/// The scans between two looks, without the one with the sums `own`, and the time they have lost by beginning late and
/// off their core.
fn lost(was: &Look, is: &Look, own: &Sums) -> (u64, Span) {
    let count = |now: u64, then: u64, own: u64| now.wrapping_sub(then).saturating_sub(own);
    let since = |now: Span, then: Span, own: Span| Span::from_nanos(count(now.nanos(), then.nanos(), own.nanos()));
    let wake = since(is.sums.wake, was.sums.wake, own.wake);
    let execution = since(is.sums.execution, was.sums.execution, own.execution);
    let ran = since(is.times.ran, was.times.ran, own.execution);
    (count(is.sums.scans, was.sums.scans, own.scans), wake.saturating_add(execution.saturating_sub(ran)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Span = Span::MILLISECOND;
    const STATEMENT: Span = Span::from_nanos(5);
    const NONE: Span = Span::ZERO;
    /// What a scan takes.
    const SCAN: Span = Span::from_micros(10);

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    /// A look at this millisecond after so many scans, when the thread had waited so long and run for 10 µs a scan.
    fn look(scans: u64, late: u64, wake: Span, waited: Span) -> Look {
        let sums = Sums { scans, late, wake, execution: scans * SCAN };
        Look { sums, times: ThreadTimes { ran: scans * SCAN, waited } }
    }

    fn sample(ms: u64, look: Look) -> Sample {
        Sample { from: at(ms), to: at(ms), look: Some(look), ..Sample::default() }
    }

    /// Scan `scan` of a millisecond each was due at `scan` milliseconds and began so much later.
    fn late(scan: u64, by: Span, is: Look) -> LateScan {
        let (planned, start) = (at(scan), at(scan) + by);
        let record = ScanRecord { scan, planned, start, end: start + SCAN, ..ScanRecord::default() };
        LateScan { record, times: Some(is.times), sums: is.sums, ready: None }
    }

    #[test]
    fn the_window_begins_at_the_last_look_before_the_scan_was_due() {
        let mut looks = Looks::new(50 * MS);
        looks.enter(sample(100, look(100, 0, NONE, NONE)));
        looks.enter(sample(150, look(150, 0, NONE, MS)));
        // Taken while the scan was waiting; part of a wait that continues may be counted.
        looks.enter(sample(202, look(199, 0, NONE, 2 * MS)));
        looks.enter(sample(250, look(230, 1, 9 * MS, 9 * MS)));
        let scan = late(200, 8 * MS, look(200, 1, 8 * MS, 8 * MS));
        let measured = looks.evidence(&scan, STATEMENT).measured.expect("schedstat");
        assert_eq!((measured.window, measured.waited), (58 * MS + SCAN, 7 * MS));
        assert_eq!((measured.others, measured.others_waited, measured.ran), (49, NONE, 50 * SCAN));
        // The late scan before is nearer than any sample, even if it ended after this one was due.
        let before = late(201, 9 * MS, look(201, 2, 17 * MS, 10 * MS));
        looks.evidence(&before, STATEMENT);
        let scan = late(205, 6 * MS, look(202, 3, 23 * MS, 14 * MS));
        let measured = looks.evidence(&scan, STATEMENT).measured.expect("schedstat");
        assert_eq!((measured.window, measured.waited, measured.others), (MS, 4 * MS, 0));
    }

    #[test]
    fn of_the_waiting_others_get_what_is_usual() {
        const LOST: Span = Span::from_micros(200);
        const WAITED: Span = Span::from_micros(20);
        let mut looks = Looks::new(50 * MS);
        // Ten scans lose 200 µs together and wait 20 µs of it.
        for pair in 0..=8 {
            looks.enter(sample(pair * 10, look(pair * 10, 0, pair * LOST, pair * WAITED)));
        }
        let scan = late(90, MS, look(90, 1, 9 * LOST + MS - WAITED, 8 * WAITED + 900 * Span::MICROSECOND));
        let evidence = looks.evidence(&scan, STATEMENT);
        let measured = evidence.measured.expect("schedstat");
        assert_eq!((measured.others, measured.waited), (9, 900 * Span::MICROSECOND));
        assert_eq!(measured.others_waited, Span::from_micros(18), "a tenth of 180 µs");
        // Where nothing is usual yet all they have lost may have been waiting.
        let mut fresh = Looks::new(50 * MS);
        fresh.enter(sample(80, look(80, 0, 8 * LOST, 8 * WAITED)));
        assert_eq!(fresh.evidence(&scan, STATEMENT).measured.expect("schedstat").others_waited, Span::from_micros(180));
    }

    #[test]
    fn counters_are_those_of_the_samples_around_the_scan() {
        let mut looks = Looks::new(50 * MS);
        let counters =
            |steal: u64| Counters { steal: Span::from_nanos(steal), major_faults: steal / 10, ..Counters::default() };
        for (ms, steal) in [(100, 0), (150, 10), (200, 50), (250, 90)] {
            looks.enter(Sample { look: None, counters: counters(steal), ..sample(ms, look(ms, 0, NONE, NONE)) });
        }
        let scan = LateScan { times: None, ..late(160, MS, look(160, 1, NONE, NONE)) };
        let evidence = looks.evidence(&scan, STATEMENT);
        assert_eq!((evidence.steal, evidence.major_faults, evidence.measured), (Span::from_nanos(40), 4, None));
        assert_eq!((evidence.window, evidence.no_sleep), (50 * MS, false));
        let at_once = LateScan { ready: Some(at(160)), ..scan };
        assert!(looks.evidence(&at_once, STATEMENT).no_sleep);
        let slept = LateScan { ready: Some(at(160) - Span::from_nanos(1)), ..scan };
        assert!(!looks.evidence(&slept, STATEMENT).no_sleep);
    }

    #[test]
    fn only_a_scan_that_was_continued_was_stopped() {
        let record = ScanRecord { planned: at(100), start: at(400), end: at(401), ..ScanRecord::default() };
        for (continued, stopped) in
            [(99, false), (100, true), (400, true), (401, true), (451, true), (452, false), (700, false)]
        {
            let looks = Looks::new(50 * MS);
            assert_eq!(looks.was_stopped(&record, at(continued)), stopped, "continued at {continued} ms");
        }
    }
}
