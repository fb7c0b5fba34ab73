//! The observer thread: looks at the kernel's counters a few times a second, explains the late scans the scan thread
//! has handed over, and takes frozen flights away.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::Duration;

use ob1_cpu::{Nanos, ScanRecord};
use ob1_rt::{Continued, ThreadUsage};
use rtrb::{Consumer, Producer, RingBuffer};

use super::Timings;
use super::cause::{Evidence, explain};
use super::kernel::Sample;

/// Between two looks.
const LOOK: Duration = Duration::from_millis(50);
/// Samples kept: what a scan of some seconds is explained from.
const SAMPLES: usize = 256;
/// Late scans that can wait for a look.
const ROOM: usize = 1024;

/// A late scan and what the kernel had counted for its thread when it had ended.
#[derive(Clone, Copy, Debug)]
struct LateScan {
    record: ScanRecord,
    usage: ThreadUsage,
}

#[derive(Debug, Default)]
struct Shared {
    /// Of the scan thread; 0: not started.
    thread: AtomicU32,
    lost: AtomicU64,
}

/// The scan thread's end.
#[derive(Debug)]
pub struct LateSender {
    ring: Producer<LateScan>,
    shared: Arc<Shared>,
}

impl LateSender {
    /// A sender without an observer, for measuring what sending costs.
    #[must_use]
    pub fn pair() -> (Self, Unobserved) {
        let (ring, late) = RingBuffer::new(ROOM);
        (Self { ring, shared: Arc::default() }, Unobserved(late))
    }

    /// Names the calling thread as the one that scans.
    pub fn this_is_the_scan(&self) {
        self.shared.thread.store(ob1_rt::thread_id(), Ordering::Release);
    }

    /// Hands a late scan over: one `getrusage`.
    #[cold]
    pub fn send(&mut self, record: &ScanRecord) {
        let late = LateScan { record: *record, usage: ob1_rt::thread_usage() };
        if self.ring.push(late).is_err() {
            self.shared.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The other end of a sender without an observer.
#[derive(Debug)]
pub struct Unobserved(Consumer<LateScan>);

impl Unobserved {
    /// Forgets the oldest late scan.
    pub fn forget(&mut self) {
        let _ = self.0.pop();
    }
}

/// The observer. Dropping it ends its thread, after a last look.
#[derive(Debug)]
pub struct Observer {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Observer {
    /// Starts the thread. `cores` are those the scan is bound to, empty for all.
    ///
    /// # Errors
    /// What the system says.
    pub fn start(timings: Timings, cores: Vec<usize>) -> std::io::Result<(Self, LateSender)> {
        let (ring, late) = RingBuffer::new(ROOM);
        let shared = Arc::new(Shared::default());
        let continued = Continued::watch(timings.clock)?;
        let (stop, stopped) = mpsc::channel();
        let mut looking = Looking {
            timings,
            cores,
            late,
            shared: Arc::clone(&shared),
            continued,
            samples: VecDeque::with_capacity(SAMPLES),
            waiting: Vec::with_capacity(ROOM),
            last: None,
        };
        let thread = ob1_rt::spawn("ob1-observer", move || {
            let mut planned = looking.timings.clock.time();
            loop {
                looking.look(planned);
                planned = looking.timings.clock.time() + LOOK.as_nanos() as Nanos;
                if stopped.recv_timeout(LOOK) != Err(RecvTimeoutError::Timeout) {
                    break;
                }
            }
            // Once to take what is there, once to explain it.
            looking.look(Nanos::MAX);
            looking.look(Nanos::MAX);
        })?;
        Ok((Self { stop: Some(stop), thread: Some(thread) }, LateSender { ring, shared }))
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Looking {
    timings: Timings,
    cores: Vec<usize>,
    late: Consumer<LateScan>,
    shared: Arc<Shared>,
    continued: Continued,
    samples: VecDeque<Sample>,
    /// Explained at the next look, when the counters of what came with them are there too.
    waiting: Vec<LateScan>,
    /// The late scan before.
    last: Option<(Nanos, ThreadUsage)>,
}

impl Looking {
    fn look(&mut self, planned: Nanos) {
        let thread = self.shared.thread.load(Ordering::Acquire);
        if thread == 0 {
            return;
        }
        let time = self.timings.clock.time();
        let mut sample = Sample::read(thread, &self.cores, time);
        sample.continued = self.continued.take();
        sample.late = time.saturating_sub(planned);
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
        self.timings.keep_frozen();
        let waiting = std::mem::take(&mut self.waiting);
        if !waiting.is_empty() {
            let per_statement = self.ns_per_statement();
            for late in &waiting {
                let evidence = self.evidence(late, per_statement);
                let cause = explain(&late.record, &evidence);
                self.timings.state.lock().ledger.enter(&late.record, &evidence, cause);
                self.last = Some((late.record.end, late.usage));
            }
        }
        while let Ok(late) = self.late.pop() {
            self.waiting.push(late);
        }
        let lost = self.shared.lost.swap(0, Ordering::Relaxed);
        if lost > 0 {
            self.timings.state.lock().ledger.lose(lost);
        }
    }

    /// What the program's statements usually take.
    fn ns_per_statement(&self) -> Nanos {
        let figures = self.timings.figures();
        let time: f64 = figures.obs.iter().map(|ob| ob.execution.mean() * ob.execution.count() as f64).sum();
        let plugins: f64 = figures.blocks.iter().map(|b| b.execution.mean() * b.execution.count() as f64).sum();
        ((time - plugins).max(0.0) / figures.statements.max(1) as f64) as Nanos
    }

    fn evidence(&self, late: &LateScan, ns_per_statement: Nanos) -> Evidence {
        let record = &late.record;
        let end = record.end.max(record.planned);
        let after = self.samples.iter().find(|s| s.time >= end).or(self.samples.back()).copied().unwrap_or_default();
        let before = self.samples.iter().rev().find(|s| s.time <= record.planned).or(self.samples.front());
        let before = before.copied().unwrap_or_default();
        // The scan's own look at the counters is closer than the observer's, and so is that of a late scan just before.
        let last =
            self.last.filter(|(time, _)| *time >= before.time && *time <= record.planned).map(|(_, usage)| usage);
        let counted = |now: u64, last: Option<u64>, before: u64| now.saturating_sub(last.unwrap_or(before));
        let usage = &late.usage;
        let window = after.time.saturating_sub(before.time);
        let within = |s: &&Sample| s.time > before.time && s.time <= after.time + LOOK.as_nanos() as Nanos;
        let within: Vec<&Sample> = self.samples.iter().filter(within).collect();
        Evidence {
            window_ns: window,
            wait_ns: after.wait.saturating_sub(before.wait).saturating_sub(self.usual_wait(window)),
            steal_ns: after.steal.saturating_sub(before.steal),
            switches: counted(usage.involuntary_switches, last.map(|l| l.involuntary_switches), before.switches),
            minor_faults: counted(usage.minor_faults, last.map(|l| l.minor_faults), before.minor_faults),
            major_faults: counted(usage.major_faults, last.map(|l| l.major_faults), before.major_faults),
            stopped: self.samples.iter().filter_map(|s| s.continued).any(|at| was_stopped(record, at)),
            observer_late_ns: within.iter().map(|s| s.late).filter(|late| *late > 1_000_000).max().unwrap_or(0),
            ns_per_statement,
        }
    }

    /// What the thread usually waits for a core in a window of this width: the median of the samples' differences.
    fn usual_wait(&self, window: Nanos) -> Nanos {
        let mut waits: Vec<Nanos> = self
            .samples
            .iter()
            .zip(self.samples.iter().skip(1))
            .map(|(a, b)| {
                b.wait.saturating_sub(a.wait).saturating_mul(1000) / (b.time.saturating_sub(a.time) / 1000).max(1)
            })
            .collect();
        waits.sort_unstable();
        let per_ms = waits.get(waits.len() / 2).copied().unwrap_or(0);
        per_ms.saturating_mul(window / 1000) / 1000
    }
}

/// Whether the process was stopped in this scan, or before it began, when it was continued at this time.
fn was_stopped(record: &ScanRecord, continued: Nanos) -> bool {
    // The scan may have gone on, and ended, before the thread that takes the signals came to note it.
    let noted_by = record.end.max(record.planned) + LOOK.as_nanos() as Nanos;
    (record.planned..=noted_by).contains(&continued)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_scan_that_was_continued_was_stopped() {
        const MS: Nanos = 1_000_000;
        let record = ScanRecord { planned: 100 * MS, start: 400 * MS, end: 401 * MS, ..ScanRecord::default() };
        for (continued, stopped) in
            [(99, false), (100, true), (400, true), (401, true), (451, true), (452, false), (700, false)]
        {
            assert_eq!(was_stopped(&record, continued * MS), stopped, "continued at {continued} ms");
        }
    }
}
