//! The other process of a measurement: this binary, started in another role.

use std::error::Error;
use std::io::Read as _;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};

use ob1_backplane::Segment;
use rustix::event::{PollFd, PollFlags, poll};

/// Any failure of a measurement.
pub type Failure = Box<dyn Error>;

/// A process that answers at the other end of a segment. Killed when dropped.
#[derive(Debug)]
pub struct Peer(Child);

impl Peer {
    /// Starts this binary as `--peer role` on the segment.
    ///
    /// # Errors
    /// If the process cannot be started, or the segment is on the heap.
    pub fn start(role: &str, segment: &Segment) -> Result<Self, Failure> {
        let path = segment.path().ok_or("a peer needs a shared segment")?;
        let mut command = Command::new(std::env::current_exe()?);
        Ok(Self(command.arg("--peer").arg(role).arg(path).stdin(Stdio::piped()).spawn()?))
    }

    /// The same, with a descriptor as its standard input.
    ///
    /// # Errors
    /// If the process cannot be started, or the segment is on the heap.
    pub fn start_with(role: &str, segment: &Segment, stdin: OwnedFd) -> Result<Self, Failure> {
        let path = segment.path().ok_or("a peer needs a shared segment")?;
        let mut command = Command::new(std::env::current_exe()?);
        Ok(Self(command.arg("--peer").arg(role).arg(path).stdin(stdin).spawn()?))
    }

    /// The same, for a peer that needs a name in place of a segment; it says when it is there.
    ///
    /// # Errors
    /// If the process cannot be started, or ends before.
    pub fn start_by_name(role: &str, name: &str) -> Result<Self, Failure> {
        let mut command = Command::new(std::env::current_exe()?);
        let mut peer = Self(command.args(["--peer", role, name]).stdout(Stdio::piped()).spawn()?);
        peer.0.stdout.as_mut().ok_or("no pipe")?.read_exact(&mut [0])?;
        Ok(peer)
    }

    /// The write end of its standard input.
    pub fn stdin(&mut self) -> Option<&mut ChildStdin> {
        self.0.stdin.as_mut()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may already have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Two words of a segment, each on its own cache line: the lower limit for every exchange between two processes.
#[derive(Clone, Copy, Debug)]
pub struct Words<'a> {
    there: &'a AtomicU64,
    back: &'a AtomicU64,
}

impl<'a> Words<'a> {
    /// The words of a segment.
    ///
    /// # Errors
    /// If it is too small.
    pub fn of(segment: &'a Segment) -> Result<Self, Failure> {
        let (there, back) = segment.word(0).zip(segment.word(256)).ok_or("segment too small")?;
        Ok(Self { there, back })
    }

    /// The peer's part: writes back each value.
    pub fn answer(self) {
        self.back.store(self.there.load(Ordering::Acquire), Ordering::Release);
    }

    /// Writes the next number.
    pub fn call(self) {
        self.there.store(self.there.load(Ordering::Relaxed) + 1, Ordering::Release);
    }

    /// Spins until the number has come back.
    pub fn wait(self) {
        let serial = self.there.load(Ordering::Relaxed);
        while self.back.load(Ordering::Acquire) != serial {
            std::hint::spin_loop();
        }
    }

    /// One round trip.
    pub fn round_trip(self) {
        self.call();
        self.wait();
    }
}

/// The peer's side of a plain pipe: sleeps in `poll` like a driver, answers in the word for each byte, ends at end of
/// file.
///
/// # Errors
/// If the segment cannot be opened or the pipe fails.
pub fn answer_pipe(path: &Path) -> Result<(), Failure> {
    let segment = Segment::open(path)?;
    let words = Words::of(&segment)?;
    let mut stdin = std::io::stdin().lock();
    let mut bytes = [0u8; 64];
    loop {
        poll(&mut [PollFd::new(&stdin, PollFlags::IN)], None)?;
        if stdin.read(&mut bytes)? == 0 {
            return Ok(());
        }
        words.answer();
    }
}
