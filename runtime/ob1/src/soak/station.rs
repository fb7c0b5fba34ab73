//! The station under test: `ob1 run` as a process of its own, asked through its socket.
//!
//! Nothing of the soak lies in the station's process: neither its memory nor its threads disturb the scan or are
//! counted as the station's.

use std::fs::File;
use std::io;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::{Op, Response};

/// A station that was started, and ends with the soak.
#[derive(Debug)]
pub(super) struct Station {
    child: Child,
    file: String,
    client: Option<Client>,
}

impl Station {
    /// Starts `ob1 run`, with these further arguments. What it says goes to `log`. It is in a process group of its own:
    /// Ctrl-C is for the soak, which ends the station in order; and should the soak be killed, its end of the pipe goes
    /// with it.
    pub(super) fn start(file: &Path, more: &[String], log: File) -> io::Result<Self> {
        let child = Command::new(std::env::current_exe()?)
            .args(["run", "--quiet", "--lifeline"])
            .args(more)
            .arg(file)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(log)
            .process_group(0)
            .spawn()?;
        // A path that is not a name: `station.toml` and not `station`.
        let file = if file.components().count() > 1 { file.to_path_buf() } else { Path::new(".").join(file) };
        Ok(Self { child, file: file.display().to_string(), client: None })
    }

    pub(super) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Its exit, when it has ended.
    pub(super) fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Asks. `None`: no answer, or a refusal.
    pub(super) fn ask(&mut self, op: Op) -> Option<Response> {
        self.try_ask(op).ok()
    }

    pub(super) fn try_ask(&mut self, op: Op) -> Result<Response, AccessError> {
        if self.client.is_none() {
            self.client = Some(Client::to_station(&self.file)?);
        }
        let answer = match &mut self.client {
            Some(client) => client.ask(op),
            None => return Err(io::Error::from(io::ErrorKind::NotConnected).into()),
        };
        if matches!(answer, Err(AccessError::Silent | AccessError::Io(_))) {
            self.client = None;
        }
        answer
    }

    /// Resident memory in bytes and open descriptors of its process.
    pub(super) fn resources(&self) -> (u64, u64) {
        let fds = std::fs::read_dir(format!("/proc/{}/fd", self.pid())).map_or(0, |entries| entries.count() as u64);
        (resident(self.pid()), fds)
    }

    /// Kills one of its drivers. The process is held by a descriptor while it is examined: the number alone may belong
    /// to another.
    pub(super) fn kill_driver(&self, pid: u32) -> bool {
        let Some(number) = i32::try_from(pid).ok().and_then(Pid::from_raw) else { return false };
        let Ok(driver) = pidfd_open(number, PidfdFlags::empty()) else { return false };
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let parent = stat.rsplit_once(") ").and_then(|(_, rest)| rest.split(' ').nth(1)?.parse::<u32>().ok());
        parent == Some(self.pid()) && pidfd_send_signal(driver, Signal::KILL).is_ok()
    }

    /// Ends it in order, and says how it ended.
    pub(super) fn stop(&mut self) -> Option<ExitStatus> {
        drop(self.child.stdin.take());
        self.child.wait().ok()
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Resident memory of a process, in bytes.
pub(super) fn resident(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or_default();
    line.trim().trim_end_matches("kB").trim().parse::<u64>().unwrap_or(0) * 1024
}

/// How a process ended, in words.
pub(super) fn exit_text(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        _ => "an unknown end".into(),
    }
}
