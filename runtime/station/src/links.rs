//! The processes of links: starts them, hands each its end of the broker's socket, and starts one again that is gone or
//! silent. The scan knows nothing of it.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ob1_access::door::Door;
use ob1_backplane::handover;
use ob1_broker::{Beats, Handle};
use ob1_host::driver::kept_environment;
use ob1_host::supervisor::{Exit, Input, Phase, Report, Request, Supervisor, Times};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use rustix::time::Timespec;

/// The longest wait between two looks: a link beats every 200 ms.
const LOOK: Duration = Duration::from_millis(250);
/// The same while one is starting.
const LOOK_STARTING: Duration = Duration::from_millis(20);
/// How long a process gets to end once its door is closed.
const END: Duration = Duration::from_secs(2);

/// A process that serves a link, or several.
#[derive(Clone, Debug)]
pub struct LinkSpec {
    /// The name of the link, for the log; of several links that of the process.
    pub name: String,
    /// The program, `ob1-s7`.
    pub program: PathBuf,
    /// Its links: the number of each at the broker, and its signs of life.
    pub doors: Vec<(usize, Beats)>,
    /// It may have several links: its standard input is a socket over which the doors come. Otherwise it is the door.
    pub several: bool,
}

impl LinkSpec {
    /// Signs of life of all its links.
    fn count(&self) -> u64 {
        self.doors.iter().map(|(_, beats)| beats.count()).fold(0, u64::wrapping_add)
    }
}

/// The processes of all links. Dropping it ends them: drop the broker first, so that they find their doors closed.
#[derive(Debug)]
pub struct Links {
    /// Closed to end the thread.
    stop: Option<OwnedFd>,
    thread: Option<JoinHandle<()>>,
}

impl Links {
    /// Starts the thread that starts them. `broker` is told of each new process.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn start(specs: Vec<LinkSpec>, broker: &Handle) -> io::Result<Self> {
        let (stopped, stop) = io::pipe()?;
        let children = specs.into_iter().map(|spec| Watched::new(spec, broker.clone())).collect();
        let watch = Watch { children, stopped: stopped.into(), began: Instant::now() };
        let thread = ob1_rt::spawn("ob1-links", move || watch.run())?;
        Ok(Self { stop: Some(stop.into()), thread: Some(thread) })
    }
}

impl Drop for Links {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A process, and the descriptor that says when it is gone.
struct Process {
    child: Child,
    pidfd: OwnedFd,
}

/// A link and its process.
struct Watched {
    spec: LinkSpec,
    broker: Handle,
    supervisor: Supervisor,
    process: Option<Process>,
    beats: u64,
}

impl Watched {
    fn new(spec: LinkSpec, broker: Handle) -> Self {
        Self { spec, broker, supervisor: Supervisor::new(Times::DEFAULT), process: None, beats: 0 }
    }

    fn spawn(&mut self) -> io::Result<Process> {
        let pairs = self.spec.doors.iter().map(|_| handover::pair()).collect::<io::Result<Vec<_>>>()?;
        let (ours, mut theirs): (Vec<OwnedFd>, Vec<OwnedFd>) = pairs.into_iter().unzip();
        let input = if self.spec.several {
            let (over, input) = handover::pair()?;
            Door::hand_over(&over, &theirs)?;
            Some(input)
        } else {
            theirs.pop()
        };
        let input = input.ok_or_else(|| io::Error::other("a process without a link"))?;
        let mut child = Command::new(&self.spec.program)
            .args(["--name", &self.spec.name])
            .env_clear()
            .envs(kept_environment())
            .stdin(Stdio::from(input))
            .stdout(Stdio::null())
            // Out of reach of Ctrl-C: it ends when its door is closed.
            .process_group(0)
            .current_dir("/")
            .spawn()?;
        match pidfd_open(Pid::from_child(&child), PidfdFlags::empty()) {
            Ok(pidfd) => {
                self.beats = self.spec.count();
                for ((link, _), door) in self.spec.doors.iter().zip(ours) {
                    self.broker.connect(*link, door);
                }
                Ok(Process { child, pidfd })
            }
            Err(error) => {
                let _ = child.kill();
                let _ = child.wait();
                Err(error.into())
            }
        }
    }

    /// Feeds the supervisor and does what it asks; when it wants to be called again.
    fn attend(&mut self, now: u64) -> u64 {
        let mut input = self.observe();
        loop {
            let step = self.supervisor.step(now, input);
            let (name, program) = (&self.spec.name, self.spec.program.display());
            match step.report {
                Some(Report::Up(1)) => tracing::info!("link \"{name}\" is up"),
                Some(Report::Up(starts)) => tracing::info!("link \"{name}\" is up again, start {starts}"),
                Some(Report::Lost(Exit::NotStarted(_))) => {
                    tracing::error!("link \"{name}\": {program} cannot be started; it lies beside ob1 as a rule");
                }
                Some(Report::Lost(exit)) => tracing::warn!("link \"{name}\" is gone ({exit}); it is started again"),
                Some(Report::HeldUp(_)) | None => {}
            }
            input = match step.request {
                Some(Request::Spawn) => match self.spawn() {
                    Ok(process) => {
                        self.process = Some(process);
                        Input::Spawned
                    }
                    Err(error) => Input::Exited(Exit::NotStarted(error.raw_os_error().unwrap_or(0))),
                },
                Some(Request::Kill) => {
                    if let Some(process) = &mut self.process {
                        let _ = process.child.kill();
                    }
                    Input::Tick
                }
                None => return step.deadline.unwrap_or(u64::MAX),
            };
        }
    }

    fn observe(&mut self) -> Input {
        let Some(process) = &mut self.process else { return Input::Tick };
        if let Ok(Some(status)) = process.child.try_wait() {
            self.process = None;
            let by_signal = status.signal().map(Exit::Signal);
            return Input::Exited(by_signal.unwrap_or(Exit::Code(status.code().unwrap_or(-1))));
        }
        let beats = self.spec.count();
        if beats != self.beats {
            self.beats = beats;
            return Input::Heartbeat;
        }
        let state = ob1_rt::process_state(process.child.id()).map(|state| state.state);
        if matches!(state, Some('R' | 'D')) { Input::Starved } else { Input::Tick }
    }

    fn end(&mut self) {
        let Some(Process { mut child, pidfd }) = self.process.take() else { return };
        let _ = poll(&mut [PollFd::new(&pidfd, PollFlags::IN)], Timespec::try_from(END).ok().as_ref());
        // Without effect on one that has ended.
        let _ = child.kill();
        let _ = child.wait();
    }
}

/// The thread's work.
struct Watch {
    children: Vec<Watched>,
    stopped: OwnedFd,
    began: Instant,
}

impl Watch {
    fn run(mut self) {
        loop {
            let now = self.began.elapsed().as_nanos() as u64;
            let until = self.children.iter_mut().map(|child| child.attend(now)).min().unwrap_or(u64::MAX);
            let starts = self.children.iter().any(|child| child.supervisor.phase() == Phase::Starting);
            let wait = Duration::from_nanos(until.saturating_sub(now)).min(if starts { LOOK_STARTING } else { LOOK });
            let mut fds = vec![PollFd::new(&self.stopped, PollFlags::IN)];
            let processes = self.children.iter().filter_map(|child| child.process.as_ref());
            fds.extend(processes.map(|process| PollFd::new(&process.pidfd, PollFlags::IN)));
            // An interrupted wait is a short one.
            let _ = poll(&mut fds, Timespec::try_from(wait).ok().as_ref());
            if fds.first().is_some_and(|stop| !stop.revents().is_empty()) {
                break;
            }
        }
        self.children.iter_mut().for_each(Watched::end);
    }
}
