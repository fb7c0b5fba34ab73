//! All drivers of a station, and the thread that watches them.

use std::io;
use std::os::fd::OwnedFd;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ob1_backplane::{Monitor, Segment};
use ob1_cpu::Clock;
use ob1_rt::SideThread;
use ob1_time::{Instant, Span, WatchedTime};
use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::Timespec;

use super::Doorbell;
use super::process::{DriverCommand, Process};
use crate::supervisor::{Exit, Input, Phase, Report, Request, Supervisor, Times};

/// How often the heartbeats are checked while all drivers are up.
const LOOK: Span = Span::from_millis(100);
/// The same while one is starting: its first sign of life may go unseen for this long.
const LOOK_STARTING: Span = Span::from_millis(5);
/// A look this long after the last one is late: the whole process, or the machine, has stood still.
const LOOK_LATE: Span = LOOK.times(3);
/// How much of a longer gap between two looks counts as silence of a driver: it cannot use up its patience alone.
const GAP: Span = LOOK_LATE.times(2);
/// Reports the scan has not fetched yet; more are dropped.
const REPORTS: usize = 32;

/// How long drivers get between end of file on stdin and SIGKILL.
pub const STOP_WAIT: Span = Span::from_secs(2);
/// When drivers that serve others are asked to end, if those that they serve are still there.
const FIRST_WAIT: Span = Span::from_secs(1);

/// What the module on the scan thread gets of its driver.
#[derive(Debug)]
pub struct DriverPort {
    /// Rung to wake the driver when something is for it.
    pub doorbell: Doorbell,
    /// What the supervisor reports, for [`ob1_cpu::Module::poll_event`]. Wait-free; bounded.
    pub reports: Consumer<Report>,
    /// What any thread may read.
    pub status: Arc<DriverStatus>,
}

/// A driver as tools see it. Updated by the supervisor thread.
#[derive(Debug, Default)]
pub struct DriverStatus {
    pid: AtomicU32,
    starts: AtomicU32,
    losses: AtomicU32,
    attempts: AtomicU32,
    incidents: AtomicU32,
}

impl DriverStatus {
    /// Its process, 0 when there is none.
    pub fn pid(&self) -> u32 {
        // Acquire: whoever sees a process also sees its attempt counted.
        self.pid.load(Ordering::Acquire)
    }

    /// Processes that have shown life so far.
    pub fn starts(&self) -> u32 {
        self.starts.load(Ordering::Relaxed)
    }

    /// Processes that have ended without being asked to.
    pub fn losses(&self) -> u32 {
        self.losses.load(Ordering::Relaxed)
    }

    /// Processes that were to be started so far.
    pub fn attempts(&self) -> u32 {
        self.attempts.load(Ordering::Acquire)
    }

    /// Incidents of the driver so far: see [`Supervisor::incidents`].
    pub fn incidents(&self) -> u32 {
        self.incidents.load(Ordering::Relaxed)
    }
}

/// Makes a descriptor for a process that is about to be started.
pub type HandOver = Box<dyn Fn() -> io::Result<OwnedFd> + Send>;

/// Drivers to be started.
#[derive(Default)]
pub struct Fleet {
    drivers: Vec<Driver>,
}

impl std::fmt::Debug for Fleet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.drivers.iter().map(|driver| &driver.command.name)).finish()
    }
}

struct Driver {
    command: DriverCommand,
    segment: Segment,
    monitor: Monitor,
    doorbell: Doorbell,
    stdin: OwnedFd,
    supervisor: Supervisor,
    process: Option<Process>,
    /// The log has that it cannot be started.
    told: bool,
    last_beat: u64,
    /// When it was checked last.
    looked: Instant,
    reports: Producer<Report>,
    status: Arc<DriverStatus>,
    hand_over: Option<HandOver>,
    /// It serves others, so it is ended after them.
    ends_last: bool,
}

impl Fleet {
    /// A fleet without drivers; its thread starts with [`Fleet::start`].
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a driver for a shared segment; `monitor` reads the same segment.
    ///
    /// # Errors
    /// What the system says when no descriptor is left.
    pub fn add(
        &mut self,
        command: DriverCommand,
        segment: Segment,
        monitor: Monitor,
        times: Times,
    ) -> io::Result<DriverPort> {
        let (doorbell, stdin) = Doorbell::new()?;
        let (producer, consumer) = RingBuffer::new(REPORTS);
        let status = Arc::new(DriverStatus::default());
        let port = DriverPort { doorbell: doorbell.clone(), reports: consumer, status: Arc::clone(&status) };
        self.drivers.push(Driver {
            command,
            segment,
            monitor,
            doorbell,
            stdin,
            supervisor: Supervisor::new(times),
            process: None,
            told: false,
            last_beat: 0,
            looked: Instant::START,
            reports: producer,
            status,
            hand_over: None,
            ends_last: false,
        });
        Ok(port)
    }

    /// Each process of this driver gets a descriptor of its own after the others.
    pub fn hand_over(&mut self, name: &str, make: HandOver) {
        if let Some(driver) = self.drivers.iter_mut().find(|driver| driver.command.name == name) {
            driver.hand_over = Some(make);
        }
    }

    /// This driver serves others: at the stop it is asked to end after them, so that none of them misses it.
    pub fn ends_last(&mut self, name: &str) {
        for driver in self.drivers.iter_mut().filter(|driver| driver.command.name == name) {
            driver.ends_last = true;
        }
    }

    /// Starts the supervisor thread, which starts the drivers. Call it from an ordinary thread: the new one inherits
    /// its scheduling.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn start(self, clock: impl Clock + Send + 'static) -> io::Result<RunningFleet> {
        let drivers = self.drivers;
        let watch = SideThread::polling("ob1-supervisor", move |stopped| {
            Watch { drivers, clock, watched: WatchedTime::new(Instant::START, GAP), stopped }.run();
        })?;
        Ok(RunningFleet { _watch: watch })
    }
}

/// Drivers under supervision. Dropping it stops them.
#[derive(Debug)]
pub struct RunningFleet {
    _watch: SideThread<OwnedFd>,
}

impl RunningFleet {
    /// Stops the drivers: end of file on their stdin, those that serve others last, up to [`STOP_WAIT`] for all to end,
    /// then SIGKILL. Returns when all are gone.
    pub fn stop(self) {
        drop(self);
    }
}

/// The state of the supervisor thread.
struct Watch<C> {
    drivers: Vec<Driver>,
    clock: C,
    /// The drivers' times are measured with it.
    watched: WatchedTime,
    stopped: OwnedFd,
}

impl<C: Clock> Watch<C> {
    fn run(mut self) {
        loop {
            let now = self.watched.look(self.clock.now());
            let mut wake_at = now + LOOK;
            for driver in &mut self.drivers {
                wake_at = wake_at.min(driver.attend(now));
            }
            let timeout = wake_at.since(self.watched.look(self.clock.now()));
            if self.sleep(timeout) {
                break;
            }
        }
        self.stop();
    }

    /// Sleeps until a driver ends or the time is over; true when the station stops.
    fn sleep(&self, timeout: Span) -> bool {
        let timeout = timespec(timeout);
        let mut fds = vec![PollFd::new(&self.stopped, PollFlags::IN)];
        fds.extend(self.drivers.iter().filter_map(|d| Some(PollFd::new(d.process.as_ref()?.pidfd(), PollFlags::IN))));
        // An interrupted poll is a short sleep.
        let _ = poll(&mut fds, Some(&timeout));
        fds.first().is_some_and(|stop| !stop.revents().is_empty())
    }

    fn stop(&mut self) {
        let begin = self.clock.now();
        for (all, patience) in [(false, FIRST_WAIT), (true, STOP_WAIT)] {
            for driver in self.drivers.iter_mut().filter(|driver| driver.ends_last == all) {
                driver.supervisor.stop();
                // Its number now stands for the read end: rings of a scan thread that still runs go nowhere.
                let _ = driver.doorbell.hang_up(&driver.stdin);
            }
            self.wait(begin + patience, all);
        }
        for driver in &mut self.drivers {
            driver.end();
        }
    }

    /// Waits until all drivers have ended, or only those that do not end last.
    fn wait(&mut self, give_up: Instant, all: bool) {
        while self.drivers.iter_mut().any(|d| (all || !d.ends_last) && !d.has_ended()) {
            let left = give_up.since(self.clock.now());
            if left.is_zero() {
                break;
            }
            let timeout = timespec(left);
            let mut fds: Vec<_> = self
                .drivers
                .iter()
                .filter(|d| all || !d.ends_last)
                .filter_map(|d| Some(PollFd::new(d.process.as_ref()?.pidfd(), PollFlags::IN)))
                .collect();
            let _ = poll(&mut fds, Some(&timeout));
        }
    }
}

fn timespec(span: Span) -> Timespec {
    Timespec { tv_sec: span.secs() as i64, tv_nsec: span.subsec_nanos() as i64 }
}

impl Driver {
    /// Feeds the machine with what has happened and does what it asks; returns when it must be called again.
    fn attend(&mut self, now: Instant) -> Instant {
        let mut input = self.observe(now);
        loop {
            let step = self.supervisor.step(now, input);
            if let Some(report) = step.report {
                self.report(report);
            }
            input = match step.request {
                Some(Request::Spawn) => self.spawn(),
                Some(Request::Kill) => {
                    tracing::warn!(driver = %self.command.name, "gives no sign of life, killed");
                    if let Some(process) = &mut self.process {
                        process.kill();
                    }
                    Input::Tick
                }
                None => {
                    let look = match self.supervisor.phase() {
                        Phase::Starting => LOOK_STARTING,
                        Phase::Down | Phase::Up => LOOK,
                    };
                    return step.deadline.unwrap_or(Instant::NEVER).min(now + look);
                }
            };
        }
    }

    fn observe(&mut self, now: Instant) -> Input {
        let since_last_look = now.since(self.looked);
        self.looked = now;
        if let Some(exit) = self.process.as_mut().and_then(Process::ended) {
            self.process = None;
            self.status.pid.store(0, Ordering::Relaxed);
            // Before the next start: the segment no longer shows what the dead one left.
            self.monitor.driver_gone();
            return Input::Exited(exit);
        }
        let Some(process) = &mut self.process else { return Input::Tick };
        let beat = self.monitor.cp_heartbeat();
        if beat != self.last_beat {
            self.last_beat = beat;
            process.has_beaten();
            return Input::Heartbeat;
        }
        // After a late look the supervisor cannot tell what the driver did meanwhile.
        if process.is_starved() || since_last_look > LOOK_LATE { Input::Starved } else { Input::Tick }
    }

    fn spawn(&mut self) -> Input {
        // While no driver was there, anybody with the segment may have written into its header, and no driver would
        // attach to that. The scan restores the rest of what the CPU's side owns when it sees the attempt.
        self.monitor.restore_header();
        self.status.incidents.store(self.supervisor.incidents(), Ordering::Relaxed);
        self.status.attempts.fetch_add(1, Ordering::Release);
        self.last_beat = self.monitor.cp_heartbeat();
        let own = self.hand_over.as_ref().map(|make| make()).transpose();
        let segment = self.segment.descriptor().ok_or(io::ErrorKind::Unsupported);
        let start =
            |own: Option<OwnedFd>| Process::start(&self.command, segment?, &self.stdin, own.as_ref(), Stdio::inherit());
        match own.and_then(start) {
            Ok(process) => {
                self.status.pid.store(process.id(), Ordering::Release);
                self.process = Some(process);
                self.told = false;
                Input::Spawned
            }
            Err(error) => {
                if !std::mem::replace(&mut self.told, true) {
                    let program = self.command.program.display();
                    tracing::error!(
                        driver = %self.command.name,
                        "{program} cannot be started, it is tried again: {error}{}",
                        ob1_rt::remedy(&error)
                    );
                }
                Input::Exited(Exit::NotStarted(error.raw_os_error().unwrap_or(0)))
            }
        }
    }

    fn report(&mut self, report: Report) {
        match report {
            Report::Up(starts) => {
                self.status.starts.store(starts, Ordering::Relaxed);
                tracing::info!(driver = %self.command.name, pid = self.status.pid(), "up, start {starts}");
            }
            Report::Lost(exit) => {
                self.status.losses.fetch_add(1, Ordering::Relaxed);
                tracing::warn!(driver = %self.command.name, "lost: {exit}");
            }
            Report::HeldUp(time) => {
                let ms = time.millis();
                tracing::warn!(driver = %self.command.name, "held up by the system for {ms} ms: no core, or in the kernel");
            }
        }
        // A scan that fetches nothing for 32 reports has other troubles; the counters above are still right.
        let _ = self.reports.push(report);
    }

    fn has_ended(&mut self) -> bool {
        if self.process.as_mut().is_some_and(|p| p.ended().is_some()) {
            self.process = None;
        }
        self.process.is_none()
    }

    fn end(&mut self) {
        if let Some(mut process) = self.process.take() {
            tracing::warn!(driver = %self.command.name, "does not end, killed");
            process.kill();
            process.wait();
        }
        self.status.pid.store(0, Ordering::Relaxed);
        self.monitor.driver_gone();
    }
}
