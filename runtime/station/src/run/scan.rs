//! The scan thread: asks for its posture, then cycles until it is ordered to finish.
//!
//! From its first cycle on it allocates nothing, takes no lock another thread can hold, and makes no system call but
//! the sleep, the doorbells, and one look at its kernel counters after a late scan; the fence proves it. What others
//! want to know of it is kept in atomics.

use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::thread::JoinHandle;

use ob1_backplane::GuardPage;
use ob1_broker::Feed;
use ob1_cpu::{Clock, Command, Cpu, Follower, OperatingState};
use ob1_rt::{Grant, MonotonicClock};
use ob1_time::{Instant, Span};

use crate::compiling::Successors;
use crate::download::Newcomers;
use crate::engine::InUse;
use crate::posture;
use crate::retentive::keeper::ScanEnd;
use ob1_station_file::Realtime;
use ob1_timing::LateSender;

/// As far away as the kernel lets a thread sleep.
const FOREVER: Instant = Instant::from_nanos(u64::MAX / 2);

/// What other threads see of the scan.
#[derive(Debug)]
pub(super) struct ScanState {
    state: AtomicU8,
    /// The number of the newest diagnostic entry.
    entries: AtomicU64,
    /// Which modules answer; checked in STOP.
    present: Box<[AtomicBool]>,
    cycles: AtomicU64,
    scans: AtomicU64,
    in_cycle: AtomicBool,
    started: AtomicBool,
    limit_reached: AtomicBool,
    finish: AtomicBool,
}

impl ScanState {
    /// The state for a CPU with this many modules.
    pub(super) fn new(modules: usize) -> Self {
        Self {
            state: AtomicU8::new(0),
            entries: AtomicU64::new(0),
            present: (0..modules).map(|_| AtomicBool::new(false)).collect(),
            cycles: AtomicU64::new(0),
            scans: AtomicU64::new(0),
            in_cycle: AtomicBool::new(false),
            started: AtomicBool::new(false),
            limit_reached: AtomicBool::new(false),
            finish: AtomicBool::new(false),
        }
    }

    /// The number of the newest diagnostic entry after the last cycle.
    pub(super) fn entries(&self) -> u64 {
        self.entries.load(Ordering::Relaxed)
    }

    /// Which modules answered in the last cycle in STOP.
    pub(super) fn present(&self) -> Vec<bool> {
        self.present.iter().map(|present| present.load(Ordering::Relaxed)).collect()
    }

    /// The operating state after the last cycle.
    pub(super) fn state(&self) -> OperatingState {
        OperatingState::of(self.state.load(Ordering::Acquire).into())
    }

    /// Cycles since the start, those in STOP included: a sign of life.
    pub(super) fn cycles(&self) -> u64 {
        self.cycles.load(Ordering::Relaxed)
    }

    /// Finished cycles in RUN.
    pub(super) fn scans(&self) -> u64 {
        self.scans.load(Ordering::Relaxed)
    }

    /// False while it sleeps.
    pub(super) fn is_in_cycle(&self) -> bool {
        self.in_cycle.load(Ordering::Relaxed)
    }

    /// True after the first cycle, which has gone through start-up.
    pub(super) fn has_started(&self) -> bool {
        self.started.load(Ordering::Acquire)
    }

    /// The wanted number of scans is done; the CPU is in STOP or on its way there.
    pub(super) fn limit_reached(&self) -> bool {
        self.limit_reached.load(Ordering::Acquire)
    }

    /// Hands diagnostic entries over by these feeds. In HOLD, where no cycle ends, it keeps the state and the sign of
    /// life up to date besides.
    pub(super) fn follower(self: &Arc<Self>, mut feeds: [Feed; 2]) -> Follower {
        let shared = Arc::clone(self);
        Box::new(move |state, buffer| {
            let newest = feeds.each_mut().map(|feed| feed.follow(buffer));
            shared.entries.store(newest[0], Ordering::Relaxed);
            if state == OperatingState::Hold {
                shared.cycles.fetch_add(1, Ordering::Relaxed);
                shared.state.store(state.number(), Ordering::Release);
            }
        })
    }

    /// Ends the thread after its cycle; a fenced one stays asleep instead.
    pub(super) fn finish(&self) {
        self.finish.store(true, Ordering::Release);
    }
}

/// The clock of the scan. Each look at it is a sign of life: it is read between statements, so a long cycle, or
/// one whose monitoring is triggered again and again (SFC 43), is alive, and a native block that never returns is
/// not.
struct LivingClock {
    clock: MonotonicClock,
    guard: Option<GuardPage>,
}

impl Clock for LivingClock {
    #[inline]
    fn now(&mut self) -> Instant {
        if let Some(guard) = &self.guard {
            guard.beat();
        }
        self.clock.now()
    }

    fn executed(&mut self, statements: u64) {
        self.clock.executed(statements);
    }

    fn rest(&mut self, deadline: Instant) {
        self.clock.rest(deadline);
    }
}

/// What the scan thread is started with.
pub(super) struct Scan {
    pub(super) cpu: Cpu,
    pub(super) clock: MonotonicClock,
    pub(super) shared: Arc<ScanState>,
    pub(super) realtime: Realtime,
    /// Grants requested so far; the thread adds its own and publishes all.
    pub(super) grants: Vec<Grant>,
    pub(super) posture: Arc<OnceLock<Vec<Grant>>>,
    pub(super) limit: Option<u64>,
    pub(super) fence: bool,
    /// Hands retentive memory over, when it is written.
    pub(super) retentive: Option<ScanEnd>,
    /// Hands late scans over to be explained.
    pub(super) late: LateSender,
    /// Where the guardian looks for signs of life.
    pub(super) guard: Option<GuardPage>,
    /// Engines that take over between two cycles.
    pub(super) successors: Option<Successors>,
    /// Programs that take over between two cycles.
    pub(super) newcomers: Option<Newcomers>,
    /// Which engine runs, for readers outside the scan.
    pub(super) engine: Arc<InUse>,
}

impl Scan {
    /// Starts the thread. With a fence that cannot be raised it ends at once with the reason.
    pub(super) fn start(self) -> std::io::Result<JoinHandle<Result<(), String>>> {
        ob1_rt::spawn_with_stack("ob1-scan", self.cpu.stack_bytes(), move || self.run())
    }

    fn run(mut self) -> Result<(), String> {
        ob1_rt::block_signals();
        ob1_rt::take_handler_stack().map_err(|e| format!("a stack for signals: {e}"))?;
        ob1_rt::prefault_stack();
        ob1_rt::warm_heap();
        self.late.this_is_the_scan();
        self.ask_posture();
        if self.fence {
            ob1_rt::fence_scan().map_err(|e| e.to_string())?;
        }
        self.cpu.request(Command::Warm);
        self.cycle();
        if self.fence {
            // A fenced thread cannot end: it sleeps until the process does.
            loop {
                self.clock.sleep_until(FOREVER);
            }
        }
        Ok(())
    }

    fn ask_posture(&mut self) {
        let mut grants = std::mem::take(&mut self.grants);
        grants.extend(posture::ask_thread(&self.realtime));
        let _ = self.posture.set(grants);
    }

    fn cycle(&mut self) {
        let shared = Arc::clone(&self.shared);
        let mut scans = 0;
        let mut clock = LivingClock { clock: self.clock, guard: self.guard.take() };
        loop {
            shared.in_cycle.store(true, Ordering::Relaxed);
            let end = self.cpu.cycle(&mut clock);
            shared.in_cycle.store(false, Ordering::Relaxed);
            shared.cycles.fetch_add(1, Ordering::Relaxed);
            if end.state == OperatingState::Run && end.whole {
                scans += 1;
                shared.scans.store(scans, Ordering::Relaxed);
                if self.limit == Some(scans) {
                    self.cpu.request(Command::Stop);
                    shared.limit_reached.store(true, Ordering::Release);
                }
            }
            if end.late {
                self.late.send(self.cpu.last_scan(), self.cpu.sums());
            }
            if let Some(name) = self.successors.as_mut().and_then(|engines| engines.take_over(&mut self.cpu)) {
                self.engine.set(name);
            }
            let (cpu, engines) = (&mut self.cpu, &mut self.successors);
            if let Some(name) = self.newcomers.as_mut().and_then(|programs| programs.take_over(cpu, engines)) {
                self.engine.set(name);
                self.retentive.iter_mut().for_each(ScanEnd::hand_over_soon);
            }
            if let Some(retentive) = &mut self.retentive {
                retentive.after_cycle(&mut self.cpu);
            }
            self.cpu.tell();
            if end.state == OperatingState::Stop {
                for (index, present) in shared.present.iter().enumerate() {
                    let answers = self.cpu.module(index).is_some_and(|(_, status)| status.present);
                    present.store(answers, Ordering::Relaxed);
                }
            }
            shared.state.store(end.state.number(), Ordering::Release);
            shared.started.store(true, Ordering::Release);
            if end.late {
                self.late.ready(self.clock.time());
            }
            if shared.finish.load(Ordering::Acquire) {
                return;
            }
            match self.realtime.spin {
                Span::ZERO => self.clock.sleep_until(end.next_deadline),
                spin => self.clock.spin_until(end.next_deadline, spin),
            }
        }
    }
}
