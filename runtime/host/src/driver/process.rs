//! One driver process: how it is started, and how it ended.

use std::ffi::OsString;
use std::io;
use std::iter;
use std::os::fd::{AsFd as _, AsRawFd as _, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;

use ob1_rt::{ProcessState, process_state};
use ob1_socket::handover;
use ob1_time::Span;
use rustix::process::{Pid, PidfdFlags, pidfd_open};

use crate::supervisor::Exit;

/// Time on a core that is enough for any number of signs of life. A process that has had this much since the last one
/// runs in circles.
const ENOUGH: Span = Span::from_millis(200);

/// How a driver is started.
#[derive(Clone, Debug)]
pub struct DriverCommand {
    /// The module's name, for logs and lists.
    pub name: String,
    /// Path of the program, `ob1-cp` or a driver of the user's.
    pub program: PathBuf,
    /// Arguments besides `--segment PATH`.
    pub args: Vec<OsString>,
    /// Variables added to its environment.
    pub env: Vec<(OsString, OsString)>,
    /// Handed over after the segment's.
    pub descriptors: Vec<Arc<OwnedFd>>,
}

/// Variables of our environment that a child gets: where programs are, whose it is, how much it logs, and which stream
/// is the journal.
const KEPT: [&str; 4] = ["PATH", "XDG_RUNTIME_DIR", "OB1_LOG", "JOURNAL_STREAM"];

/// What of our environment a child gets.
pub fn kept_environment() -> impl Iterator<Item = (&'static str, OsString)> {
    KEPT.into_iter().filter_map(|name| Some((name, std::env::var_os(name)?)))
}

/// A process that runs, and the descriptor that says when it no longer does.
#[derive(Debug)]
pub struct Process {
    child: Child,
    pidfd: OwnedFd,
    /// Time it had had on a core when its silence was first seen.
    silent_at: Option<Span>,
}

impl Process {
    /// Starts it. No `pre_exec`, so that std uses posix_spawn: a fork of a process with locked memory would cost the
    /// scan milliseconds.
    ///
    /// The segment's descriptor is in a socket that is its standard output: `/proc/PID/fd` is closed to a driver with
    /// fewer rights than the runtime. The path is for drivers by others, and for people.
    ///
    /// # Errors
    /// The system's error: there is no such program, or no process or descriptor left.
    pub fn start(
        command: &DriverCommand,
        segment: BorrowedFd<'_>,
        stdin: &OwnedFd,
        own: Option<&OwnedFd>,
        stderr: Stdio,
    ) -> io::Result<Self> {
        let path = format!("/proc/{}/fd/{}", std::process::id(), segment.as_raw_fd());
        let (ours, stdout) = handover::pair()?;
        let handed: Vec<_> = iter::once(segment)
            .chain(command.descriptors.iter().map(|fd| fd.as_fd()))
            .chain(own.map(|fd| fd.as_fd()))
            .collect();
        handover::send(&ours, &[1], &handed)?;
        let mut child = Command::new(&command.program)
            .arg("--segment")
            .arg(path)
            .args(&command.args)
            .env_clear()
            .envs(kept_environment())
            .envs(command.env.iter().map(|(name, value)| (name, value)))
            .stdin(Stdio::from(stdin.try_clone()?))
            .stdout(Stdio::from(stdout))
            .stderr(stderr)
            .process_group(0)
            .spawn()?;
        match pidfd_open(Pid::from_child(&child), PidfdFlags::empty()) {
            Ok(pidfd) => Ok(Self { child, pidfd, silent_at: None }),
            Err(error) => {
                let _ = child.kill();
                let _ = child.wait();
                Err(error.into())
            }
        }
    }

    /// Its number, which is that of its process group too.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Readable when the process has ended.
    pub(super) fn pidfd(&self) -> &OwnedFd {
        &self.pidfd
    }

    /// It has given a sign of life.
    pub fn has_beaten(&mut self) {
        self.silent_at = None;
    }

    /// Whether it is silent because it cannot run.
    pub fn is_starved(&mut self) -> bool {
        let Some(ProcessState { state, ran }) = process_state(self.id()) else { return false };
        is_starved(state, ran.saturating_sub(*self.silent_at.get_or_insert(ran)))
    }

    /// Kills it (SIGKILL).
    pub fn kill(&mut self) {
        // An error means that it has ended by itself meanwhile; its end is seen either way.
        let _ = self.child.kill();
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Option<Exit> {
        match self.child.try_wait() {
            Ok(status) => status.map(exit_of),
            // Another has waited for it: it is gone nevertheless.
            Err(_) => Some(Exit::Code(-1)),
        }
    }

    /// Waits for its end.
    pub fn wait(&mut self) {
        let _ = self.child.wait();
    }
}

/// Whether a process in this state, with this much time on a core since it fell silent, waits for a core or is held by
/// the kernel (a tty does that to hand over what it has received). False if it sleeps, is stopped, or runs in circles.
fn is_starved(state: char, ran: Span) -> bool {
    state == 'D' || state == 'R' && ran < ENOUGH
}

fn exit_of(status: ExitStatus) -> Exit {
    match (status.code(), status.signal()) {
        (Some(code), _) => Exit::Code(code),
        (None, Some(signal)) => Exit::Signal(signal),
        (None, None) => Exit::Code(-1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_can_do_nothing() {
        for (state, ran, starved) in [
            ('D', Span::ZERO, true),
            ('D', 10 * ENOUGH, true),
            ('R', Span::ZERO, true),
            ('R', ENOUGH - Span::from_nanos(1), true),
            ('R', ENOUGH, false),
            ('S', Span::ZERO, false),
            ('T', Span::ZERO, false),
            ('Z', Span::ZERO, false),
        ] {
            assert_eq!(is_starved(state, ran), starved, "{state} after {ran}");
        }
    }
}
