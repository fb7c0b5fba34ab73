//! What every real line can do, whatever is behind it.

use std::os::fd::BorrowedFd;

use rustix::event::{PollFd, PollFlags};

use crate::settings::{LineSettings, SettingsError};

pub use ob1_serial::{LineFault, ModemLines, Nanos};

/// What a line has to tell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LineEvent {
    /// So many bytes were received and stand at the beginning of the buffer.
    Rx(usize),
    /// A fault, in its place between the bytes.
    Fault(LineFault),
    /// The last bit of everything written has left the line.
    TxDone,
    /// The line can be used; the settings could be applied except for these.
    Up(Vec<crate::Warning>),
    /// The line cannot be used, and why. What was still to be sent, or is sent from now on, is swallowed. The line
    /// tries by itself to come back.
    Gone(String),
}

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

/// A serial line: non-blocking, driven by the owner's clock and poll loop.
///
/// The owner waits for [`Self::poll_fds`] until [`Self::deadline`]; when a descriptor was ready it calls
/// [`Self::ready`]; then, in either case, [`Self::next_event`] until it answers `None`.
pub trait Line {
    /// Sets baud rate and character frame, now and whenever the line comes back. What was still to be sent is lost.
    ///
    /// # Errors
    /// Settings no line can do; the line stays as it was. What only this kind of line cannot do comes as a warning with
    /// the next [`LineEvent::Up`], which follows every accepted call.
    fn apply(&mut self, settings: &LineSettings) -> Result<(), SettingsError>;

    /// Adds the descriptors to wait for.
    fn poll_fds<'a>(&'a self, fds: &mut PollFds<'a>);

    /// `poll` found one of the descriptors ready.
    fn ready(&mut self);

    /// The next event, or `None`. `buffer` takes received bytes; at least 16 long.
    fn next_event(&mut self, now: Nanos, buffer: &mut [u8]) -> Option<LineEvent>;

    /// When [`Self::next_event`] must be called although nothing is ready.
    fn deadline(&self) -> Option<Nanos>;

    /// Sends. Answers how many of the bytes were taken: all, unless more than 4096 are waiting already.
    /// [`LineEvent::TxDone`] follows once everything taken has left the line; while the line is gone, when it would
    /// have.
    fn write(&mut self, now: Nanos, bytes: &[u8]) -> usize;

    /// Takes back what has not yet begun to leave; the result is how many bytes will not be sent.
    fn take_back(&mut self, now: Nanos) -> usize;

    /// The operating system's error number behind the last [`LineEvent::Gone`], if it had one.
    fn errno(&self) -> Option<u32>;

    /// The modem lines as they stand; `None` where there are none.
    fn modem_lines(&mut self) -> Option<ModemLines>;

    /// Sets RTS and DTR, where they exist.
    fn set_modem_lines(&mut self, rts: bool, dtr: bool);
}
