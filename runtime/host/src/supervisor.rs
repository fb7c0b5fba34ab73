//! When a driver process is started, given up, killed, and started again: a pure machine in virtual time.
//!
//! It knows no process. [`crate::driver`] feeds it with what pidfds and heartbeats say and does what it asks for; the
//! whole-station simulation does the same with virtual drivers.
//!
//! ```
//! use ob1_host::supervisor::{Exit, Input, Request, Supervisor, Times};
//! use ob1_time::Instant;
//!
//! let mut driver = Supervisor::new(Times::default());
//! assert_eq!(driver.step(Instant::START, Input::Tick).request, Some(Request::Spawn));
//! driver.step(Instant::from_millis(1), Input::Spawned);
//! driver.step(Instant::from_millis(2), Input::Heartbeat);
//! let died = driver.step(Instant::from_millis(3), Input::Exited(Exit::Signal(9)));
//! assert_eq!(died.request, Some(Request::Spawn), "the first restart does not wait");
//! ```

use std::fmt;

use ob1_time::{Instant, Span};

/// The times by which a supervisor judges a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    /// A driver that is up and gives no sign of life for this long hangs and is killed. Default 1 s.
    pub hang: Span,
    /// A driver that has been started must give its first sign of life within this time. Default 5 s.
    pub start: Span,
    /// A driver that is kept from giving a sign of life ([`Input::Starved`]) is killed after this long without one: its
    /// device may never release it. Default 30 s.
    pub starved: Span,
    /// The first wait that is not zero; each further one is twice as long. Default 50 ms.
    pub first_wait: Span,
    /// The longest wait between two starts. Default 800 ms: what is up within 200 ms exchanges again within a second.
    pub longest_wait: Span,
    /// A driver that has been up this long starts again without a wait when it dies. Default 5 s.
    pub healthy: Span,
}

impl Times {
    /// The defaults named at the fields.
    pub const DEFAULT: Self = Self {
        hang: Span::from_secs(1),
        start: Span::from_secs(5),
        starved: Span::from_secs(30),
        first_wait: Span::from_millis(50),
        longest_wait: Span::from_millis(800),
        healthy: Span::from_secs(5),
    };
}

impl Default for Times {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// How a driver process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// By itself, with this status.
    Code(i32),
    /// By a signal from outside.
    Signal(i32),
    /// Killed by the supervisor because it hung.
    Hung,
    /// It could not be started at all; the operating system's error number.
    NotStarted(i32),
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Exit::Code(code) => write!(f, "exit status {code}"),
            Exit::Signal(signal) => write!(f, "signal {signal}"),
            Exit::Hung => write!(f, "hung, killed"),
            Exit::NotStarted(errno) => write!(f, "no start, os {errno}"),
        }
    }
}

/// Inputs of the supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Time has passed, and nothing was heard.
    Tick,
    /// The requested process runs.
    Spawned,
    /// The process has ended, or could not be started ([`Exit::NotStarted`]).
    Exited(Exit),
    /// The driver's heartbeat has changed.
    Heartbeat,
    /// Time has passed, and the driver could not have done anything with it: it waits for a core, or the kernel holds
    /// it. To kill it would lose its telegrams and not bring back the line.
    Starved,
}

/// What the supervisor wants done, at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Start a process; answer with [`Input::Spawned`] or [`Input::Exited`].
    Spawn,
    /// Kill it (SIGKILL); its end is reported as [`Input::Exited`] with whatever the system says.
    Kill,
}

/// What is reported to the CPU's diagnostic buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Report {
    /// The driver is up for the n-th time.
    Up(u32),
    /// The driver is gone.
    Lost(Exit),
    /// The driver works again. For this long, longer than a hang is tolerated, the system has kept it from working
    /// ([`Input::Starved`]).
    HeldUp(Span),
}

/// The outcome of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Step {
    /// What the owner must do now.
    pub request: Option<Request>,
    /// What the CPU and the log must be told.
    pub report: Option<Report>,
    /// When to call with [`Input::Tick`] at the latest; `None`: only when something happens.
    pub deadline: Option<Instant>,
}

/// Where a driver is, with the data that is legal there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// No process; the next start is due at this time.
    Down { start_at: Instant },
    /// [`Request::Spawn`] is out, its outcome not known yet.
    Spawning,
    /// A process without a sign of life so far.
    Starting { silent: Silent },
    /// It gives signs of life.
    Up { since: Instant, silent: Silent },
    /// [`Request::Kill`] is out; the process has not ended yet.
    Killed,
    /// No start is wanted any more; the process may still be there.
    Stopped,
}

/// Since when there has been no sign of life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Silent {
    /// Since the last sign, whatever the reason.
    since: Instant,
    /// And nothing kept the driver from giving one.
    freely_since: Instant,
}

impl Silent {
    fn from(now: Instant) -> Self {
        Self { since: now, freely_since: now }
    }

    /// When it has been silent for too long: freely, or in all.
    fn until(self, freely: Span, in_all: Span) -> Instant {
        self.freely_since.saturating_add(freely).min(self.since.saturating_add(in_all))
    }
}

/// What a caller may want to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// There is no process.
    Down,
    /// A process that has not answered yet.
    Starting,
    /// The process gives signs of life.
    Up,
}

/// The supervisor of one driver.
#[derive(Clone, Debug)]
pub struct Supervisor {
    times: Times,
    state: State,
    /// Starts without health in between, counted after the first: decides the wait.
    failures: u32,
    starts: u32,
    incidents: u32,
}

impl Supervisor {
    /// A supervisor whose first [`Input::Tick`] starts the driver.
    pub fn new(times: Times) -> Self {
        Self { times, state: State::Down { start_at: Instant::START }, failures: 0, starts: 0, incidents: 0 }
    }

    /// Processes that have shown life so far.
    pub fn starts(&self) -> u32 {
        self.starts
    }

    /// Incidents so far: the first end of a driver begins one, and it is over when one has been healthy
    /// ([`Times::healthy`]). What goes wrong again and again in one incident is worth one report.
    pub fn incidents(&self) -> u32 {
        self.incidents
    }

    /// Where the driver is.
    pub fn phase(&self) -> Phase {
        match self.state {
            State::Down { .. } | State::Spawning | State::Stopped => Phase::Down,
            State::Starting { .. } => Phase::Starting,
            State::Up { .. } | State::Killed => Phase::Up,
        }
    }

    /// No start is wanted any more: the station stops. Whatever comes is ignored from here on.
    pub fn stop(&mut self) {
        self.state = State::Stopped;
    }

    /// One input at the time `now`.
    pub fn step(&mut self, now: Instant, input: Input) -> Step {
        let (request, report) = match self.state {
            State::Down { start_at } => self.down(now, start_at),
            State::Spawning => self.spawning(now, input),
            State::Starting { .. } => self.starting(now, input),
            State::Up { since, silent } => self.up(now, input, since, silent),
            State::Killed => self.killed(now, input),
            State::Stopped => (None, None),
        };
        Step { request, report, deadline: self.deadline() }
    }

    fn deadline(&self) -> Option<Instant> {
        match self.state {
            State::Down { start_at } => Some(start_at),
            State::Starting { silent } => Some(silent.until(self.times.start, self.times.starved)),
            State::Up { silent, .. } => Some(silent.until(self.times.hang, self.times.starved)),
            State::Spawning | State::Killed | State::Stopped => None,
        }
    }

    fn down(&mut self, now: Instant, start_at: Instant) -> (Option<Request>, Option<Report>) {
        if now < start_at {
            return (None, None);
        }
        self.state = State::Spawning;
        (Some(Request::Spawn), None)
    }

    fn spawning(&mut self, now: Instant, input: Input) -> (Option<Request>, Option<Report>) {
        match input {
            Input::Spawned => {
                self.state = State::Starting { silent: Silent::from(now) };
                (None, None)
            }
            // Reported once, not at every attempt: a missing program would fill the diagnostic buffer.
            Input::Exited(exit) => {
                let first = self.failures == 0;
                let (request, _) = self.lost(now, exit);
                (request, first.then_some(Report::Lost(exit)))
            }
            Input::Tick | Input::Heartbeat | Input::Starved => (None, None),
        }
    }

    fn starting(&mut self, now: Instant, input: Input) -> (Option<Request>, Option<Report>) {
        match input {
            Input::Heartbeat => {
                self.state = State::Up { since: now, silent: Silent::from(now) };
                self.starts = self.starts.saturating_add(1);
                (None, Some(Report::Up(self.starts)))
            }
            Input::Exited(exit) => {
                let first = self.failures == 0;
                let (request, _) = self.lost(now, exit);
                (request, first.then_some(Report::Lost(exit)))
            }
            Input::Tick | Input::Starved => self.silent(now, input),
            Input::Spawned => (None, None),
        }
    }

    fn up(&mut self, now: Instant, input: Input, since: Instant, silent: Silent) -> (Option<Request>, Option<Report>) {
        if now.since(since) >= self.times.healthy {
            self.failures = 0;
        }
        match input {
            Input::Heartbeat => {
                self.state = State::Up { since, silent: Silent::from(now) };
                let time = now.since(silent.since);
                (None, (silent.freely_since > silent.since && time >= self.times.hang).then_some(Report::HeldUp(time)))
            }
            Input::Exited(exit) => self.lost(now, exit),
            Input::Tick | Input::Starved => self.silent(now, input),
            Input::Spawned => (None, None),
        }
    }

    /// No sign of life, while starting or up.
    fn silent(&mut self, now: Instant, input: Input) -> (Option<Request>, Option<Report>) {
        if input == Input::Starved
            && let State::Starting { silent } | State::Up { silent, .. } = &mut self.state
        {
            silent.freely_since = now;
        }
        if self.deadline().is_some_and(|deadline| now >= deadline) { self.kill() } else { (None, None) }
    }

    fn killed(&mut self, now: Instant, input: Input) -> (Option<Request>, Option<Report>) {
        match input {
            Input::Exited(_) => self.lost(now, Exit::Hung),
            Input::Tick | Input::Spawned | Input::Heartbeat | Input::Starved => (None, None),
        }
    }

    fn kill(&mut self) -> (Option<Request>, Option<Report>) {
        self.state = State::Killed;
        (Some(Request::Kill), None)
    }

    /// The process is gone: the next start is due at once, or after the wait that the failures so far demand.
    fn lost(&mut self, now: Instant, exit: Exit) -> (Option<Request>, Option<Report>) {
        let start_at = now.saturating_add(self.wait());
        if self.failures == 0 {
            self.incidents = self.incidents.saturating_add(1);
        }
        self.failures = self.failures.saturating_add(1);
        self.state = State::Down { start_at };
        let (request, _) = self.down(now, start_at);
        (request, Some(Report::Lost(exit)))
    }

    /// 0, then the first wait, twice as long each time, up to the longest.
    fn wait(&self) -> Span {
        let Some(doublings) = self.failures.checked_sub(1) else { return Span::ZERO };
        let factor = 1u64.checked_shl(doublings).unwrap_or(u64::MAX);
        self.times.first_wait.times(factor).min(self.times.longest_wait)
    }
}

#[cfg(test)]
mod tests;
