//! A process that the station keeps alive: started, watched by its signs of life, and started again when it is gone or
//! silent. The supervisor's clock is the caller's.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::process::{Child, Command};
use std::time::{self, Duration};

use ob1_host::supervisor::{Exit, Input, Phase, Report, Request, Supervisor, Times};
use ob1_rt::SideThread;
use ob1_time::{Instant, WatchedTime};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use rustix::time::Timespec;

/// The longest wait between two looks while a process is starting.
const LOOK_STARTING: Duration = Duration::from_millis(20);

/// The program of this process, to start it as a child. An update may have replaced its file meanwhile: then it is
/// still the program that runs, and not one of another version.
pub(crate) fn own_program() -> io::Result<PathBuf> {
    let path = std::env::current_exe()?;
    Ok(if path.exists() { path } else { PathBuf::from("/proc/self/exe") })
}

/// What kind of process it is.
pub(crate) trait Charge {
    /// What else belongs to a started process; closing it ends the process.
    type Held;

    /// The command that starts it, and what has to be kept open for it.
    fn command(&mut self) -> io::Result<(Command, Self::Held)>;

    /// It has been started.
    fn begun(&mut self, held: &mut Self::Held);

    /// Its signs of life so far.
    fn beats(&self) -> u64;

    /// Tells the log of a start, a loss or a hang.
    fn tell(&self, report: Report);

    /// For the log: why it cannot be started, once until it could be.
    fn cannot_start(&self, why: &io::Error);
}

/// A running process, and the descriptor that says when it is gone.
struct Process<H> {
    child: Child,
    pidfd: OwnedFd,
    held: H,
}

/// The process with its supervisor; see [the module](self).
pub(crate) struct Kept<C: Charge> {
    charge: C,
    supervisor: Supervisor,
    process: Option<Process<C::Held>>,
    beats: u64,
    /// It has been told that it cannot be started.
    told: bool,
}

impl<C: Charge> Kept<C> {
    /// One that is started by the first [`Kept::attend`].
    pub(crate) fn new(charge: C, times: Times) -> Self {
        Self { charge, supervisor: Supervisor::new(times), process: None, beats: 0, told: false }
    }

    /// One that is started now.
    ///
    /// # Errors
    /// The process cannot be started; what the system says.
    pub(crate) fn started(charge: C, times: Times) -> io::Result<Self> {
        let mut kept = Self::new(charge, times);
        kept.spawn()?;
        kept.supervisor.step(Instant::START, Input::Tick);
        kept.supervisor.step(Instant::START, Input::Spawned);
        Ok(kept)
    }

    /// It has been started and has not given its first sign of life.
    fn is_starting(&self) -> bool {
        self.supervisor.phase() == Phase::Starting
    }

    /// What becomes readable when the process ends.
    fn fd(&self) -> Option<PollFd<'_>> {
        self.process.as_ref().map(|process| PollFd::new(&process.pidfd, PollFlags::IN))
    }

    /// Feeds the supervisor and does what it asks; returns when to call it again.
    fn attend(&mut self, now: Instant) -> Instant {
        let mut input = self.observe();
        loop {
            let step = self.supervisor.step(now, input);
            if let Some(report) = step.report {
                self.charge.tell(report);
            }
            input = match step.request {
                Some(Request::Spawn) => match self.spawn() {
                    Ok(()) => {
                        self.told = false;
                        Input::Spawned
                    }
                    Err(error) => {
                        if !std::mem::replace(&mut self.told, true) {
                            self.charge.cannot_start(&error);
                        }
                        Input::Exited(Exit::NotStarted(error.raw_os_error().unwrap_or(0)))
                    }
                },
                Some(Request::Kill) => {
                    if let Some(process) = &mut self.process {
                        let _ = process.child.kill();
                    }
                    Input::Tick
                }
                None => return step.deadline.unwrap_or(Instant::NEVER),
            };
        }
    }

    fn spawn(&mut self) -> io::Result<()> {
        let (mut command, mut held) = self.charge.command()?;
        let mut child = command.spawn()?;
        let pidfd = pidfd_open(Pid::from_child(&child), PidfdFlags::empty()).inspect_err(|_| {
            let _ = child.kill();
            let _ = child.wait();
        })?;
        self.beats = self.charge.beats();
        self.charge.begun(&mut held);
        self.process = Some(Process { child, pidfd, held });
        Ok(())
    }

    fn observe(&mut self) -> Input {
        let Some(process) = &mut self.process else { return Input::Tick };
        if let Ok(Some(status)) = process.child.try_wait() {
            self.process = None;
            let by_signal = status.signal().map(Exit::Signal);
            return Input::Exited(by_signal.unwrap_or(Exit::Code(status.code().unwrap_or(-1))));
        }
        let beats = self.charge.beats();
        if beats != self.beats {
            self.beats = beats;
            return Input::Heartbeat;
        }
        let state = ob1_rt::process_state(process.child.id()).map(|state| state.state);
        if matches!(state, Some('R' | 'D')) { Input::Starved } else { Input::Tick }
    }

    /// Tells it to end by closing what it holds, and waits at most this long.
    fn end(&mut self, patience: Duration) {
        let Some(Process { mut child, pidfd, held }) = self.process.take() else { return };
        drop(held);
        let _ = poll(&mut [PollFd::new(&pidfd, PollFlags::IN)], Timespec::try_from(patience).ok().as_ref());
        // Without effect on one that has ended.
        let _ = child.kill();
        let _ = child.wait();
    }
}

/// Starts the thread that keeps these processes alive, with at most `look` between two looks; of a longer gap twice as
/// much counts as silence of a process. Its end is theirs: each gets `end` for it.
pub(crate) fn keep<C>(
    thread: &str,
    mut kept: Vec<Kept<C>>,
    look: Duration,
    end: Duration,
) -> io::Result<SideThread<OwnedFd>>
where
    C: Charge + Send + 'static,
    C::Held: Send,
{
    let began = time::Instant::now();
    let mut watched = WatchedTime::new(Instant::START, (2 * look).into());
    SideThread::polling(thread, move |stopped| {
        loop {
            let now = watched.look(Instant::START + began.elapsed().into());
            let until = kept.iter_mut().map(|one| one.attend(now)).min().unwrap_or(Instant::NEVER);
            let look = if kept.iter().any(Kept::is_starting) { look.min(LOOK_STARTING) } else { look };
            let wait = Duration::from(until.since(now)).min(look);
            let mut fds = vec![PollFd::new(&stopped, PollFlags::IN)];
            fds.extend(kept.iter().filter_map(Kept::fd));
            // An interrupted wait is a short one.
            let _ = poll(&mut fds, Timespec::try_from(wait).ok().as_ref());
            if fds.first().is_some_and(|stop| !stop.revents().is_empty()) {
                break;
            }
        }
        kept.iter_mut().for_each(|one| one.end(end));
    })
}
