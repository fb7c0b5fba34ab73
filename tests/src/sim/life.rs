//! The life cycle of a driver process without a process: the real supervisor machine, and its state for the scan.
//! Start, end and detection take virtual time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use ob1_backplane::Monitor;
use ob1_host::module::{DriverLink, Life as Starts};
use ob1_host::supervisor::{Exit, Input, Report, Request, Supervisor, Times};
use ob1_line::sim::SplitMix64;
use ob1_time::{Instant, Span};

use super::MS;

/// Interval at which the supervisor checks heartbeats.
const LOOK: Span = Span::from_millis(20);
/// Start time of a process: minimum, and maximum addition.
const START: (Span, Span) = (Span::from_millis(2), Span::from_millis(30));
/// Delay until a doorbell is noticed: minimum, and maximum addition.
const WAKE: (Span, Span) = (Span::from_micros(5), Span::from_micros(60));

/// The scan's view of a virtual driver.
#[derive(Debug)]
pub struct Link {
    shared: Arc<Shared>,
    reports: rtrb::Consumer<Report>,
}

#[derive(Debug, Default)]
struct Shared {
    running: AtomicBool,
    rung: AtomicBool,
    attempts: AtomicU32,
    incidents: AtomicU32,
}

impl DriverLink for Link {
    fn ring(&mut self) {
        self.shared.rung.store(true, Ordering::Relaxed);
    }

    fn is_running(&self) -> bool {
        self.shared.running.load(Ordering::Relaxed)
    }

    fn next_report(&mut self) -> Option<Report> {
        self.reports.pop().ok()
    }

    fn life(&self) -> Starts {
        Starts {
            attempts: self.shared.attempts.load(Ordering::Relaxed),
            incidents: self.shared.incidents.load(Ordering::Relaxed),
        }
    }
}

/// The life cycle of one driver.
pub struct Life {
    monitor: Monitor,
    supervisor: Supervisor,
    shared: Arc<Shared>,
    reports: rtrb::Producer<Report>,
    rng: SplitMix64,
    /// Time at which a requested process starts, or `NEVER`.
    starts_at: Instant,
    /// Time at which the supervisor notices that the process has ended, or `NEVER`.
    ended_at: Instant,
    look_at: Instant,
    last_beat: u64,
}

/// A change of the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// A process starts.
    Begins,
    /// The supervisor kills it: call [`Life::died`].
    Killed,
}

impl Life {
    /// Creates it without a process; with the link for the module.
    #[must_use]
    pub fn new(monitor: Monitor, seed: u64) -> (Self, Link) {
        let shared = Arc::new(Shared::default());
        let (reports, consumer) = rtrb::RingBuffer::new(32);
        let life = Self {
            monitor,
            supervisor: Supervisor::new(Times::default()),
            shared: Arc::clone(&shared),
            reports,
            rng: SplitMix64::new(seed),
            starts_at: Instant::NEVER,
            ended_at: Instant::NEVER,
            look_at: Instant::START,
            last_beat: 0,
        };
        (life, Link { shared, reports: consumer })
    }

    /// Next time at which [`Life::advance`] must be called.
    #[must_use]
    pub fn next_event(&self) -> Instant {
        self.starts_at.min(self.ended_at).min(self.look_at)
    }

    /// The next change up to `now`; perform it, then call again until there is none.
    pub fn advance(&mut self, now: Instant) -> Option<Turn> {
        if now >= self.ended_at {
            self.ended_at = Instant::NEVER;
            self.shared.running.store(false, Ordering::Relaxed);
            self.monitor.driver_gone();
            if self.supervise(now, Input::Exited(Exit::Signal(9))) {
                return Some(Turn::Killed);
            }
        }
        if now >= self.starts_at {
            self.starts_at = Instant::NEVER;
            return Some(Turn::Begins);
        }
        if now >= self.look_at {
            self.look_at = now + LOOK;
            let beat = self.monitor.cp_heartbeat();
            let input = if beat == self.last_beat { Input::Tick } else { Input::Heartbeat };
            self.last_beat = beat;
            if self.supervise(now, input) {
                return Some(Turn::Killed);
            }
        }
        None
    }

    /// The process has died; the supervisor will notice it.
    pub fn died(&mut self, now: Instant) {
        self.ended_at = now + self.rng.span_below(2 * MS);
    }

    /// To be called after a cycle of its CPU: returns when a rung doorbell is noticed.
    pub fn heard(&mut self, now: Instant, is_alive: bool) -> Option<Instant> {
        let rung = self.shared.rung.swap(false, Ordering::Relaxed) && is_alive;
        rung.then(|| now + WAKE.0 + self.rng.span_below(WAKE.1))
    }

    /// One death in three happens during a write.
    pub fn dies_writing(&mut self) -> bool {
        self.rng.below(3) == 0
    }

    /// True: the process must be killed.
    fn supervise(&mut self, now: Instant, input: Input) -> bool {
        let mut kill = false;
        let mut input = Some(input);
        while let Some(next) = input.take() {
            let step = self.supervisor.step(now, next);
            if let Some(report) = step.report {
                // An overflow needs 32 reports without a scan in between; other tests check a stopped scan.
                let _ = self.reports.push(report);
            }
            match step.request {
                Some(Request::Spawn) => {
                    self.monitor.restore_header();
                    self.shared.incidents.store(self.supervisor.incidents(), Ordering::Relaxed);
                    self.shared.attempts.fetch_add(1, Ordering::Relaxed);
                    self.last_beat = self.monitor.cp_heartbeat();
                    self.shared.running.store(true, Ordering::Relaxed);
                    self.starts_at = now + START.0 + self.rng.span_below(START.1);
                    input = Some(Input::Spawned);
                }
                Some(Request::Kill) => kill = true,
                None => {}
            }
            self.look_at = self.look_at.min(step.deadline.unwrap_or(Instant::NEVER).max(now + Span::from_nanos(1)));
        }
        kill
    }
}

impl std::fmt::Debug for Life {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Life").field("supervisor", &self.supervisor).finish_non_exhaustive()
    }
}
