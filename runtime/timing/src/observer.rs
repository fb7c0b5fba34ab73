//! The observer thread: looks at the kernel's counters a few times a second, explains the late scans the scan thread
//! has handed over, and takes frozen flights away.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender};

use ob1_cpu::{ScanRecord, Sums};
use ob1_rt::{Continued, SideThread, ThreadLook};
use ob1_time::{Instant, Span};
use rtrb::{Consumer, Producer, RingBuffer};

use super::cause::explain;
use super::kernel::Sources;
use super::kernel_counters::{LateScan, Look, Looks, Sample};
use super::timings::Timings;

/// Time between two looks.
const LOOK: Span = Span::from_millis(50);
/// How often a look is tried while scans end.
const TRIES: usize = 3;
/// Late scans that can wait for a look.
const ROOM: usize = 1024;

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
    look: ThreadLook,
    /// The last late scan, and when it had been handed over.
    ready: (u64, Option<Instant>),
}

impl LateSender {
    /// A sender without an observer, for measuring what sending costs.
    pub fn pair() -> (Self, Unobserved) {
        let (ring, late) = RingBuffer::new(ROOM);
        (Self { ring, shared: Arc::default(), look: ThreadLook::open(), ready: (0, None) }, Unobserved(late))
    }

    /// Names the calling thread as the one that scans.
    pub fn this_is_the_scan(&mut self) {
        self.look = ThreadLook::open();
        self.shared.thread.store(ob1_rt::thread_id(), Ordering::Release);
    }

    /// Hands a late scan over, with the sums of the accounts at its end: one look at the thread's times.
    #[cold]
    pub fn send(&mut self, record: &ScanRecord, sums: Sums) {
        let ready = if self.ready.0 + 1 == record.scan { self.ready.1 } else { None };
        let late = LateScan { record: *record, times: self.look.times(), sums, ready };
        self.ready = (record.scan, None);
        if self.ring.push(late).is_err() {
            self.shared.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// All that follows a late scan has been done.
    pub fn ready(&mut self, now: Instant) {
        self.ready.1 = Some(now);
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
    _thread: SideThread<Sender<()>>,
}

impl Observer {
    /// Starts the thread. `cores` are those the scan is bound to, empty for all.
    ///
    /// # Errors
    /// No handler for SIGCONT, or no thread; what the system says.
    pub fn start(timings: Timings, cores: Vec<usize>) -> std::io::Result<(Self, LateSender)> {
        let (ring, late) = RingBuffer::new(ROOM);
        let shared = Arc::new(Shared::default());
        let continued = Continued::watch(timings.clock)?;
        let mut looking = Looking {
            timings,
            sources: Sources::find(cores),
            late,
            shared: Arc::clone(&shared),
            continued,
            looks: Looks::new(LOOK),
            waiting: Vec::with_capacity(ROOM),
        };
        let thread = SideThread::looking("ob1-observer", move |stopped| {
            let mut planned = looking.timings.clock.time();
            loop {
                looking.look(planned);
                planned = looking.timings.clock.time() + LOOK;
                if stopped.recv_timeout(LOOK.into()) != Err(RecvTimeoutError::Timeout) {
                    break;
                }
            }
            // Once to take what is there, once to explain it.
            looking.look(Instant::NEVER);
            looking.look(Instant::NEVER);
        })?;
        Ok((Self { _thread: thread }, LateSender { ring, shared, look: ThreadLook::default(), ready: (0, None) }))
    }
}

struct Looking {
    timings: Timings,
    sources: Sources,
    late: Consumer<LateScan>,
    shared: Arc<Shared>,
    continued: Continued,
    looks: Looks,
    /// Explained at the next look, when the counters of what came with them are there too.
    waiting: Vec<LateScan>,
}

impl Looking {
    fn look(&mut self, planned: Instant) {
        let thread = self.shared.thread.load(Ordering::Acquire);
        if thread == 0 {
            return;
        }
        let from = self.timings.clock.time();
        let look = (0..TRIES).find_map(|_| self.thread_look(thread));
        let counters = self.sources.read(thread);
        let to = self.timings.clock.time();
        let (continued, late) = (self.continued.take(), from.since(planned));
        self.looks.enter(Sample { from, to, look, counters, continued, late });
        self.timings.keep_frozen();
        let waiting = std::mem::take(&mut self.waiting);
        if !waiting.is_empty() {
            let per_statement = self.per_statement();
            for late in &waiting {
                let evidence = self.looks.evidence(late, per_statement);
                let cause = explain(&late.record, &evidence);
                self.timings.state.lock().ledger.enter(&late.record, &evidence, cause);
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

    /// The accounts and the thread's times, when no scan has ended between the two.
    fn thread_look(&self, thread: u32) -> Option<Look> {
        let sums = self.timings.accounts.sums();
        let times = Sources::times(thread)?;
        (self.timings.accounts.sums() == sums).then_some(Look { sums, times })
    }

    /// What the program's statements usually take.
    fn per_statement(&self) -> Span {
        let figures = self.timings.figures();
        let time: f64 = figures.obs.iter().map(|ob| ob.execution.mean() * ob.execution.count() as f64).sum();
        let plugins: f64 = figures.blocks.iter().map(|b| b.execution.mean() * b.execution.count() as f64).sum();
        Span::from_nanos(((time - plugins).max(0.0) / figures.statements.max(1) as f64) as u64)
    }
}
