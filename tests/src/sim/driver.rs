//! A driver without a process: the real segment (on the heap), the real supervisor machine, the real pump and firmware;
//! only their life and death are virtual.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use ob1_backplane::{CpSide, CpuSide, Segment};
use ob1_cp::CpPump;
use ob1_host::module::{DriverLink, Life};
use ob1_host::supervisor::{Exit, Input, Report, Request, Supervisor, Times};
use ob1_line::sim::{End, SplitMix64};
use ob1_time::{Instant, Span};

use super::MS;
use super::cable::Cable;

/// How often the supervisor looks at heartbeats.
const LOOK: Span = Span::from_millis(20);
/// A process takes this long to begin, at least and in addition at most.
const START: (Span, Span) = (Span::from_millis(2), Span::from_millis(30));
/// A doorbell is heard after this long, at least and in addition at most.
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

    fn life(&self) -> Life {
        Life {
            attempts: self.shared.attempts.load(Ordering::Relaxed),
            incidents: self.shared.incidents.load(Ordering::Relaxed),
        }
    }
}

/// A virtual driver.
pub struct Driver {
    /// Which cable it is plugged into, and which end.
    pub cable: usize,
    /// See `cable`.
    pub end: End,
    segment: Segment,
    monitor: ob1_backplane::Monitor,
    supervisor: Supervisor,
    pump: Option<CpPump>,
    shared: Arc<Shared>,
    reports: rtrb::Producer<Report>,
    rng: SplitMix64,
    /// When the pump wants to be polled.
    pump_due: Instant,
    /// When a process that was asked for begins to run.
    starts_at: Option<Instant>,
    /// When the supervisor notices that the process has ended.
    ended_at: Option<Instant>,
    look_at: Instant,
    last_beat: u64,
    kills: u64,
}

impl Driver {
    /// A driver for a new segment of so many register bytes, with the CPU's end of it and the link for the module.
    ///
    /// # Errors
    /// When the segment cannot be made.
    pub fn new(
        cable: usize,
        end: End,
        seed: u64,
        io_bytes: usize,
    ) -> Result<(Self, CpuSide, Link), ob1_backplane::SegmentError> {
        let segment = Segment::heap();
        let side = CpuSide::create(&segment, io_bytes)?;
        let shared = Arc::new(Shared::default());
        let (reports, consumer) = rtrb::RingBuffer::new(32);
        let driver = Self {
            cable,
            end,
            monitor: side.monitor().clone(),
            segment,
            supervisor: Supervisor::new(Times::default()),
            pump: None,
            shared: Arc::clone(&shared),
            reports,
            rng: SplitMix64::new(seed),
            pump_due: Instant::NEVER,
            starts_at: None,
            ended_at: None,
            look_at: Instant::START,
            last_beat: 0,
            kills: 0,
        };
        Ok((driver, side, Link { shared, reports: consumer }))
    }

    /// When it wants to be called.
    #[must_use]
    pub fn next_event(&self) -> Instant {
        let events = [self.starts_at, self.ended_at, Some(self.look_at), Some(self.pump_due)];
        events.into_iter().flatten().min().unwrap_or(Instant::NEVER)
    }

    /// Driver processes that were killed so far.
    #[must_use]
    pub fn kills(&self) -> u64 {
        self.kills
    }

    /// The counters it keeps in the segment; they outlive it.
    #[must_use]
    pub fn counters(&self) -> ob1_backplane::Counters {
        self.monitor.counters()
    }

    /// Does everything that is due by `now`.
    pub fn advance(&mut self, now: Instant, cable: &mut Cable) {
        if self.ended_at.is_some_and(|at| now >= at) {
            self.ended_at = None;
            self.shared.running.store(false, Ordering::Relaxed);
            self.monitor.driver_gone();
            self.supervise(now, Input::Exited(Exit::Signal(9)), cable);
        }
        if self.starts_at.is_some_and(|at| now >= at) {
            self.starts_at = None;
            if let Ok(side) = CpSide::attach(&self.segment) {
                self.pump = Some(CpPump::new(side));
                self.pump_due = now;
            }
        }
        if now >= self.look_at {
            self.look_at = now + LOOK;
            let beat = self.monitor.cp_heartbeat();
            let input = if beat == self.last_beat { Input::Tick } else { Input::Heartbeat };
            self.last_beat = beat;
            self.supervise(now, input, cable);
        }
        if now >= self.pump_due {
            self.poll(now, cable);
        }
    }

    /// After a cycle of its CPU: a rung doorbell is heard a little later.
    pub fn listen(&mut self, now: Instant) {
        if self.shared.rung.swap(false, Ordering::Relaxed) && self.pump.is_some() {
            let heard = now + WAKE.0 + self.rng.span_below(WAKE.1);
            self.pump_due = self.pump_due.min(heard);
        }
    }

    /// Something happened on its line.
    pub fn line_event(&mut self, now: Instant, input: ob1_firmware::LineInput<'_>, cable: &mut Cable) {
        if let Some(pump) = &mut self.pump {
            pump.awake();
            pump.line_event(now, input, &mut cable.end(self.end));
            self.poll(now, cable);
        }
    }

    /// `kill -9`, one time in three in the middle of writing its registers. False if there is nothing to kill.
    pub fn kill(&mut self, now: Instant, cable: &mut Cable) -> bool {
        if self.pump.take().is_none() {
            return false;
        }
        self.kills += 1;
        cable.orphan(self.end, now);
        self.pump_due = Instant::NEVER;
        if self.rng.below(3) == 0 {
            let field = ob1_backplane::layout::FIELDS.iter().find(|f| f.name == "inputs.sequence");
            if let Some(offset) = field.map(|f| f.offset)
                && let Some(sequence) = self.segment.peek(offset)
            {
                self.segment.poke(offset, sequence | 1);
            }
        }
        self.ended_at = Some(now + self.rng.span_below(2 * MS));
        true
    }

    /// Polls until the pump may sleep, as the process does.
    fn poll(&mut self, now: Instant, cable: &mut Cable) {
        let Some(pump) = &mut self.pump else { return };
        pump.awake();
        loop {
            self.pump_due = pump.poll(now, &mut cable.end(self.end)).max(now + Span::from_nanos(1));
            if pump.prepare_sleep() {
                return;
            }
        }
    }

    fn supervise(&mut self, now: Instant, input: Input, cable: &mut Cable) {
        let mut input = Some(input);
        while let Some(next) = input.take() {
            let step = self.supervisor.step(now.nanos(), next);
            if let Some(report) = step.report {
                // 32 reports without a scan in between: the scan stands still, and that is another test's affair.
                let _ = self.reports.push(report);
            }
            match step.request {
                Some(Request::Spawn) => {
                    self.monitor.restore_header();
                    self.shared.incidents.store(self.supervisor.incidents(), Ordering::Relaxed);
                    self.shared.attempts.fetch_add(1, Ordering::Relaxed);
                    self.last_beat = self.monitor.cp_heartbeat();
                    self.shared.running.store(true, Ordering::Relaxed);
                    self.starts_at = Some(now + START.0 + self.rng.span_below(START.1));
                    input = Some(Input::Spawned);
                }
                Some(Request::Kill) => {
                    self.kill(now, cable);
                }
                None => {}
            }
            self.look_at = self
                .look_at
                .min(step.deadline.map_or(Instant::NEVER, Instant::from_nanos).max(now + Span::from_nanos(1)));
        }
    }
}

impl std::fmt::Debug for Driver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Driver").field("end", &self.end).field("kills", &self.kills).finish_non_exhaustive()
    }
}
