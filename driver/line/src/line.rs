//! The events of a real line, and the descriptors its owner waits for.

use std::os::fd::BorrowedFd;

use rustix::event::{PollFd, PollFlags};

pub use ob1_serial::{Instant, LineFault, LineInput, ModemLines, Span};

use crate::supported_frames::Warning;

/// An event of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LineEvent<'a> {
    /// Characters, in the owner's buffer; a fault in its place between them; or everything written has been sent.
    Input(LineInput<'a>),
    /// The line can be used; the settings could be applied except for these. They are told again only if they change.
    Up(Vec<Warning>),
    /// The line cannot be used, and why. Unsent bytes, and bytes written from now on, are discarded. The line tries by
    /// itself to recover.
    Gone(String),
    /// In half duplex: the line has begun (true) or ceased to give back what is sent. Its echo is not received.
    Echo(bool),
}

/// [`LineEvent::Echo`] in words: the line has begun to echo.
pub const ECHOES: &str = "this adapter echoes: switch local echo off";
/// [`LineEvent::Echo`] in words: it has ceased to.
pub const SILENT: &str = "this adapter does not echo any more";

/// The descriptors to wait for: at most two.
#[derive(Debug, Default)]
pub struct PollFds<'a> {
    fds: [Option<PollFd<'a>>; 2],
}

impl<'a> PollFds<'a> {
    pub(crate) fn push(&mut self, fd: BorrowedFd<'a>, flags: PollFlags) {
        if let Some(slot) = self.fds.iter_mut().find(|slot| slot.is_none()) {
            *slot = Some(PollFd::from_borrowed_fd(fd, flags));
        }
    }

    /// The entries for `poll`.
    pub fn into_entries(self) -> impl Iterator<Item = PollFd<'a>> {
        self.fds.into_iter().flatten()
    }
}
