//! The partner of the driver under test, and the line to it: a pty that the kit has made.

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;

use rustix::fs::{Mode, OFlags, fcntl_setfl};
use rustix::io::ioctl_fionread;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

/// Both ends of a line.
pub(super) struct Line {
    partner: File,
    /// The driver's end stays open, so that nothing hangs up when a driver dies.
    end: OwnedFd,
    /// The path that the driver opens.
    pub(super) path: String,
    /// What has come from the driver and was not expected yet.
    pub(super) heard: Vec<u8>,
}

impl Line {
    pub(super) fn new() -> io::Result<Self> {
        let partner = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&partner)?;
        unlockpt(&partner)?;
        let path = ptsname(&partner, Vec::new())?;
        let end = rustix::fs::open(path.as_c_str(), OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        let mut settings = tcgetattr(&end)?;
        settings.make_raw();
        tcsetattr(&end, OptionalActions::Now, &settings)?;
        fcntl_setfl(&partner, OFlags::NONBLOCK | OFlags::RDWR)?;
        let path = path.to_string_lossy().into_owned();
        Ok(Self { partner: partner.into(), end, path, heard: Vec::new() })
    }

    /// Takes what has come.
    pub(super) fn take(&mut self) {
        let mut bytes = [0; 4096];
        while let Ok(n @ 1..) = self.partner.read(&mut bytes) {
            self.heard.extend_from_slice(&bytes[..n]);
        }
    }

    /// Sends; a telegram always finds room.
    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.partner.write_all(bytes)
    }

    /// Whether the driver has read everything.
    pub(super) fn is_read(&self) -> bool {
        ioctl_fionread(&self.end).is_ok_and(|n| n == 0)
    }

    /// Forgets what a driver that was killed has left on the line.
    pub(super) fn clear(&mut self) {
        let _ = tcflush(&self.end, QueueSelector::IOFlush);
        self.take();
        self.heard.clear();
    }
}
