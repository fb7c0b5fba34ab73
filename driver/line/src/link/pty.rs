//! A pty of our own: its other end is published as a symbolic link, so that any program can open it like a device.

use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::path::{Path, PathBuf};

use rustix::event::PollFlags;
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::{FdFlags, fcntl_setfd};
use serialport::{SerialPort, TTYPort};

use super::{Link, Opened, Passage, not_a_wire};
use crate::line::{Instant, PollFds};
use crate::supported_frames::{LineSettings, Warning};

/// A pty, open or closed.
pub(crate) struct PtyLink {
    path: PathBuf,
    pty: Option<Pty>,
}

struct Pty {
    master: TTYPort,
    /// Kept open so that the master does not read EIO each time the last partner closes.
    _slave: TTYPort,
    /// The other end, `/dev/pts/N`.
    device: PathBuf,
    path: PathBuf,
}

impl Drop for Pty {
    fn drop(&mut self) {
        // Only our own link: another driver may have replaced it meanwhile.
        if std::fs::read_link(&self.path).is_ok_and(|target| target == self.device) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl AsFd for Pty {
    fn as_fd(&self) -> BorrowedFd<'_> {
        fd_of(&self.master)
    }
}

fn fd_of(tty: &TTYPort) -> BorrowedFd<'_> {
    // SAFETY: the descriptor belongs to `tty`, which outlives the borrow and is closed only by its own drop.
    unsafe { BorrowedFd::borrow_raw(tty.as_raw_fd()) }
}

impl PtyLink {
    pub(crate) const fn new(path: PathBuf) -> Self {
        Self { path, pty: None }
    }

    fn pty(&self) -> io::Result<&Pty> {
        self.pty.as_ref().ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

impl Link for PtyLink {
    fn open(&mut self, _now: Instant, settings: &LineSettings) -> io::Result<Opened> {
        // `pair` puts the slave into raw mode: before anyone can know its name.
        let (master, slave) = TTYPort::pair()?;
        for tty in [&master, &slave] {
            fcntl_setfd(fd_of(tty), FdFlags::CLOEXEC)?;
        }
        let flags = fcntl_getfl(fd_of(&master))?;
        fcntl_setfl(fd_of(&master), flags | OFlags::NONBLOCK)?;
        let device = PathBuf::from(slave.name().ok_or_else(|| io::Error::other("the pty has no name"))?);
        publish(&device, &self.path)?;
        self.pty = Some(Pty { master, _slave: slave, device, path: self.path.clone() });
        Ok(Opened::Yes(not_a_wire("a pty", settings)))
    }

    fn apply(&mut self, settings: &LineSettings) -> io::Result<Vec<Warning>> {
        Ok(not_a_wire("a pty", settings))
    }

    fn close(&mut self) {
        self.pty = None;
    }

    fn poll_fds<'a>(&'a self, want_write: bool, fds: &mut PollFds<'a>) {
        if let Some(pty) = &self.pty {
            let out = if want_write { PollFlags::OUT } else { PollFlags::empty() };
            fds.push(pty.as_fd(), PollFlags::IN | out);
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        Ok(rustix::io::read(self.pty()?, buffer)?)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(rustix::io::write(self.pty()?, bytes)?)
    }

    fn passage(&self) -> Passage {
        Passage::Program
    }

    fn drops_when_full(&self) -> bool {
        true
    }

    fn needs_looks(&self) -> bool {
        true
    }

    /// A clean-up of temporary folders may remove the published name. Another file in its place is left alone.
    fn look_after(&mut self) {
        if let Some(pty) = &self.pty
            && pty.path.symlink_metadata().is_err()
        {
            let _ = publish(&pty.device, &pty.path);
        }
    }
}

/// Makes `path` a symbolic link to `device`, in one step, replacing a link that an earlier pty may have left.
fn publish(device: &Path, path: &Path) -> io::Result<()> {
    match std::fs::read_link(path) {
        Ok(old) if !old.starts_with("/dev/pts") => return Err(taken(path, "is a link to something other than a pty")),
        Err(error) if error.kind() == io::ErrorKind::InvalidInput => {
            return Err(taken(path, "exists and is not a link"));
        }
        _ => {}
    }
    let mut fresh = path.as_os_str().to_owned();
    fresh.push(format!(".{}", std::process::id()));
    let fresh = PathBuf::from(fresh);
    let _ = std::fs::remove_file(&fresh);
    std::os::unix::fs::symlink(device, &fresh)
        .and_then(|()| std::fs::rename(&fresh, path))
        .inspect_err(|_| drop(std::fs::remove_file(&fresh)))
        .map_err(|error| io::Error::new(error.kind(), format!("cannot publish {}: {error}", path.display())))
}

fn taken(path: &Path, why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::AlreadyExists, format!("{} {why}: it is not replaced", path.display()))
}
