//! The runtime's end of its guardian: starts the process that outlives it, hands it what it has to hold, and starts it
//! again when it is gone.
//!
//! The guardian ([`process`]) is a child that sets the outputs of the process I/O to their safe
//! state should the runtime die or stand still, and removes what the runtime has published.

pub mod process;

use std::io;
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

use ob1_backplane::GuardPage;
use ob1_host::driver::kept_environment;
use ob1_host::supervisor::{Exit, Report, Times};
use ob1_rt::SideThread;
use ob1_socket::handover;
use ob1_time::Span;
use rustix::process::{PidfdFlags, getpid, pidfd_open};

use crate::io::{Held, ProcessIo};
use crate::kept_process::{Charge, Kept, keep, own_program};

/// The longest wait between two checks of the guardian.
const LOOK: Duration = Duration::from_millis(500);
/// How long it gets to clean up at the end: it waits for drivers and for the lock of the runtime directory itself.
const END: Duration = Duration::from_secs(15);
/// Its times: it beats every 50 ms.
const TIMES: Times = Times { hang: Span::from_secs(3), start: Span::from_secs(10), ..Times::DEFAULT };

/// After how long without a sign of life a station counts as dead. (docs/process-io.md)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// For a process that the kernel says is stopped (SIGSTOP, a debugger).
    pub stopped: Span,
    /// For one that runs, or waits for a core.
    pub silent: Span,
}

impl Patience {
    /// For a CPU with this cycle monitoring (0: none) and minimum cycle time.
    #[must_use]
    pub fn of(watchdog: Span, min_cycle: Span) -> Self {
        let cycle = min_cycle.times(2);
        let stopped = watchdog.times(2).saturating_add(cycle);
        // Later than the monitor inside the runtime, which can name the block that hangs.
        let silent = crate::run::hung_block::time(watchdog).saturating_add(Span::SECOND).saturating_add(cycle);
        Self { stopped: stopped.max(Span::SECOND), silent }
    }
}

/// What the guardian is for.
#[derive(Debug)]
pub struct Guarded {
    /// The runtime directory, to be removed.
    pub rundir: PathBuf,
    /// Links that drivers publish (ptys), to be removed.
    pub published: Vec<PathBuf>,
    /// When the runtime counts as dead.
    pub patience: Patience,
    page: GuardPage,
    page_fd: OwnedFd,
    image: Option<OwnedFd>,
    safe: Vec<u8>,
    runtime: OwnedFd,
}

impl Guarded {
    /// This process, with its process I/O if it has any.
    ///
    /// # Errors
    /// The system gives no descriptor of this process, or no memory for the page.
    pub fn of_this_process(
        rundir: PathBuf,
        published: Vec<PathBuf>,
        patience: Patience,
        io: Option<&ProcessIo>,
    ) -> io::Result<Self> {
        let runtime = pidfd_open(getpid(), PidfdFlags::empty())?;
        let held = io.and_then(|io| Some((io.guard().clone(), io.held()?)));
        let (page, page_fd, image, safe) = match held {
            Some((guard, Held { image, page, safe })) => (guard, page, Some(image), safe),
            // Only for the guardian's own signs of life.
            None => {
                let page = GuardPage::create_shared().map_err(io::Error::other)?;
                let fd = page.descriptor().ok_or(io::ErrorKind::Unsupported)?.try_clone_to_owned()?;
                (page, fd, None, Vec::new())
            }
        };
        Ok(Self { rundir, published, patience, page, page_fd, image, safe, runtime })
    }
}

/// The guardian of this runtime. Dropping it lets it clean up and waits for it.
#[derive(Debug)]
pub struct Guardian {
    _watch: SideThread<OwnedFd>,
}

impl Guardian {
    /// Starts it, and the thread that watches it.
    ///
    /// # Errors
    /// The process or the thread cannot be started; what the system says.
    pub fn start(guarded: Guarded) -> io::Result<Self> {
        Ok(Self { _watch: keep("ob1-guardian", vec![Kept::started(guarded, TIMES)?], LOOK, END)? })
    }
}

impl Charge for Guarded {
    /// Its lifeline: it sees the end of the runtime by the runtime's pidfd, and by the end of this connection.
    type Held = OwnedFd;

    fn command(&mut self) -> io::Result<(Command, Self::Held)> {
        let (lifeline, stdin) = handover::pair()?;
        let mut descriptors = vec![self.runtime.as_fd(), self.page_fd.as_fd()];
        descriptors.extend(self.image.as_ref().map(|image| image.as_fd()));
        handover::send(&lifeline, &self.safe, &descriptors)?;
        let mut command = Command::new(own_program()?);
        command
            .arg("guardian")
            .arg("--stopped-ms")
            .arg(self.patience.stopped.millis().to_string())
            .arg("--silent-ms")
            .arg(self.patience.silent.millis().to_string())
            .arg(&self.rundir)
            .args(&self.published)
            .env_clear()
            .envs(kept_environment())
            .stdin(Stdio::from(stdin))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            // Out of reach of Ctrl-C and of a kill of the runtime's group.
            .process_group(0)
            .current_dir("/");
        Ok((command, lifeline))
    }

    fn begun(&mut self, _held: &mut Self::Held) {}

    fn beats(&self) -> u64 {
        self.page.guardian_beats()
    }

    fn tell(&self, report: Report) {
        match report {
            Report::Lost(Exit::NotStarted(_)) => {}
            Report::Lost(exit) => tracing::warn!("the guardian is gone ({exit}); another is started"),
            Report::Up(starts) if starts > 1 => tracing::info!("the guardian is up, start {starts}"),
            _ => {}
        }
    }

    fn cannot_start(&self, why: &io::Error) {
        tracing::error!("the guardian cannot be started: {why}; without it the outputs stay on when this process dies");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patience_follows_from_cycle_and_watchdog() {
        let (ms, s) = (Span::from_millis, Span::from_secs);
        for (watchdog, min_cycle, stopped, silent) in [
            (150, 10, s(1), ms(3020)),
            (6000, 10, ms(12_020), ms(13_020)),
            (150, 2000, ms(4300), s(7)),
            (0, 10, s(1), ms(61_020)),
        ] {
            let patience = Patience::of(ms(watchdog), ms(min_cycle));
            assert_eq!(patience, Patience { stopped, silent }, "{watchdog} {min_cycle}");
        }
    }
}
