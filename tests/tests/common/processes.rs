//! System information about processes: their end, their threads, their memory.

use std::collections::BTreeSet;
use std::fs;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use ob1_time::Span;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Resource, Rlimit, Signal, getrlimit, pidfd_open, pidfd_send_signal, prlimit};

use super::Guard;

/// A process that is watched through a descriptor, which stays valid even if the process ID is reused.
#[derive(Debug)]
pub(crate) struct Watched {
    pub(crate) pid: u32,
    pidfd: OwnedFd,
}

impl Watched {
    /// Watches a running process; `None` if there is none with this ID.
    pub(crate) fn find(pid: u32) -> Option<Self> {
        let number = Pid::from_raw(i32::try_from(pid).ok()?)?;
        Some(Self { pid, pidfd: pidfd_open(number, PidfdFlags::empty()).ok()? })
    }

    /// Waits for its end, at most for `time`; true if it has ended.
    pub(crate) fn ends_within(&self, time: Duration) -> bool {
        let mut fds = [PollFd::new(&self.pidfd, PollFlags::IN)];
        let timeout = Timespec::try_from(time).expect("a short time");
        matches!(poll(&mut fds, Some(&timeout)), Ok(ready) if ready > 0)
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.ends_within(Duration::ZERO)
    }

    /// Waits for its end.
    pub(crate) fn wait(&self, what: &str) {
        let guard = Guard::begin();
        while !self.ends_within(Duration::from_millis(100)) {
            assert!(!guard.is_over(), "{what}: process {} does not end", self.pid);
        }
    }

    /// Sends a signal; no effect after the end of the process.
    pub(crate) fn signal(&self, signal: Signal) {
        let _ = pidfd_send_signal(&self.pidfd, signal);
    }

    /// Leaves it not one descriptor more than it has, or lifts that limit.
    pub(crate) fn limit_descriptors(&self, limited: bool) {
        let open = fs::read_dir(format!("/proc/{}/fd", self.pid)).expect("a living process");
        let open: BTreeSet<u64> = open.flatten().filter_map(|fd| fd.file_name().to_str()?.parse().ok()).collect();
        let free = (0..).find(|number| !open.contains(number));
        let ours = getrlimit(Resource::Nofile);
        let limit = if limited { Rlimit { current: free, ..ours } } else { ours };
        let pid = i32::try_from(self.pid).ok().and_then(Pid::from_raw);
        prlimit(pid, Resource::Nofile, limit).expect("a process of ours");
    }

    /// Whether it sleeps nearly all the time. One that runs in circles gets more than a twentieth of a core, however
    /// many others want it.
    pub(crate) fn sleeps(&self) -> bool {
        let ran = || ob1_rt::process_state(self.pid).expect("a living process").ran;
        let (begun, before) = (Instant::now(), ran());
        while begun.elapsed() < Duration::from_secs(1) {
            self.ends_within(Duration::from_millis(50));
        }
        ran().saturating_sub(before).times(20) < Span::from(begun.elapsed())
    }

    /// Names of its threads.
    pub(crate) fn threads(&self) -> BTreeSet<String> {
        let tasks = fs::read_dir(format!("/proc/{}/task", self.pid)).expect("a living process");
        let name = |entry: fs::DirEntry| fs::read_to_string(entry.path().join("comm")).ok();
        tasks.flatten().filter_map(name).map(|name| name.trim().to_owned()).collect()
    }
}

/// All processes with this entry in their environment, without zombies.
pub(crate) fn with_environment(entry: &str) -> Vec<Watched> {
    let entries = fs::read_dir("/proc").expect("/proc");
    let pids = entries.flatten().filter_map(|e| e.file_name().to_str()?.parse::<u32>().ok());
    let has_it = |pid: &u32| {
        // Unreadable: a process of another user. Empty: a zombie, which holds nothing any more.
        let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        environment.split(|byte| *byte == 0).any(|variable| variable == entry.as_bytes())
    };
    pids.filter(has_it).filter_map(Watched::find).filter(|process| !process.has_ended()).collect()
}

/// The system's identification of an anonymous file (a segment, an image).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Memory {
    device: u64,
    inode: u64,
}

impl Memory {
    /// The target of a link in a station's runtime directory.
    pub(crate) fn behind(link: &Path) -> Self {
        let found = fs::metadata(link).unwrap_or_else(|why| panic!("{}: {why}", link.display()));
        Self { device: found.dev(), inode: found.ino() }
    }

    /// Processes that still have a descriptor or a mapping of it.
    pub(crate) fn holders(self) -> Vec<u32> {
        let entries = fs::read_dir("/proc").expect("/proc");
        let pids = entries.flatten().filter_map(|e| e.file_name().to_str()?.parse::<u32>().ok());
        pids.filter(|pid| self.is_open_in(*pid) || self.is_mapped_in(*pid)).collect()
    }

    /// Waits until no process holds it. An ending process loses its environment before it releases its files.
    pub(crate) fn wait_until_free(self) {
        let guard = Guard::begin();
        while let Some(process) = self.holders().into_iter().find_map(Watched::find) {
            assert!(!guard.is_over(), "still held by {:?}", process.threads());
            process.ends_within(Duration::from_millis(50));
        }
    }

    fn is_open_in(self, pid: u32) -> bool {
        let Ok(descriptors) = fs::read_dir(format!("/proc/{pid}/fd")) else { return false };
        let same = |found: fs::Metadata| (found.dev(), found.ino()) == (self.device, self.inode);
        descriptors.flatten().any(|fd| fs::metadata(fd.path()).is_ok_and(same))
    }

    fn is_mapped_in(self, pid: u32) -> bool {
        // address perms offset major:minor inode path
        let Ok(maps) = fs::read_to_string(format!("/proc/{pid}/maps")) else { return false };
        let inode = self.inode.to_string();
        maps.lines().any(|line| line.contains("/memfd:") && line.split_whitespace().nth(4) == Some(&inode))
    }
}
