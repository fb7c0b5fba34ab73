//! A place on a simulated line: a connection to the process of the line.

use std::collections::VecDeque;
use std::io;
use std::os::fd::AsFd;
use std::path::PathBuf;

use rustix::event::PollFlags;

use super::{Link, Opened, Passage};
use crate::line::{Instant, ModemLines, PollFds, Span};
use crate::supported_frames::{LineSettings, Warning};
use crate::wire::{FromHub, ToHub};
use ob1_socket::seqpacket::{Channel, MESSAGE_MAX, Sent};

/// Time between two attempts to find a hub that is being started, in nanoseconds.
const LOOK: Span = Span::from_millis(20);
/// How long the hub may take to start before the line counts as gone.
const START: Span = Span::from_secs(3);

/// Messages of the hub taken at a time, and the maximum of unread characters: beyond that they wait in the socket.
const MESSAGES: usize = 64;
const RECEIVED: usize = 64 * 1024;

/// A simulated line, open or closed.
pub(crate) struct SimLink {
    path: PathBuf,
    open: Option<Open>,
    /// Since when the hub has been searched for.
    since: Option<Instant>,
    modem: (bool, bool),
}

struct Open {
    channel: Channel,
    /// Received and not yet read, with marks.
    received: VecDeque<u8>,
    /// `W` messages sent, and how many of them the line has finished.
    written: u32,
    left: u32,
    lines: Option<ModemLines>,
    /// The connection has ended; what was received is still read.
    ended: bool,
}

impl SimLink {
    pub(crate) const fn new(path: PathBuf) -> Self {
        Self { path, open: None, since: None, modem: (true, true) }
    }
}

fn tell(channel: &Channel, message: ToHub<'_>) -> io::Result<Sent> {
    let mut bytes = Vec::with_capacity(MESSAGE_MAX);
    message.write(&mut bytes);
    channel.send(&bytes)
}

impl Open {
    /// Takes what the hub has sent.
    fn listen(&mut self) {
        let mut buffer = [0; MESSAGE_MAX];
        for _ in 0..MESSAGES {
            if self.ended || self.received.len() >= RECEIVED {
                return;
            }
            match self.channel.receive(&mut buffer) {
                Ok(None) => return,
                Ok(Some([])) | Err(_) => self.ended = true,
                Ok(Some(message)) => match FromHub::read(message) {
                    Some(FromHub::Received(bytes)) => self.received.extend(bytes),
                    Some(FromHub::Done(left)) => self.left = left,
                    Some(FromHub::Modem(lines)) => self.lines = Some(lines),
                    None => {}
                },
            }
        }
    }
}

impl Link for SimLink {
    fn open(&mut self, now: Instant, settings: &LineSettings) -> io::Result<Opened> {
        let since = *self.since.get_or_insert(now);
        let channel = match Channel::connect(&self.path) {
            Ok(channel) => channel,
            Err(_) if now.since(since) < START => return Ok(Opened::Waiting(Some(now + LOOK))),
            Err(error) => {
                let text = format!("the simulated line {} is not there: {error}", self.path.display());
                return Err(io::Error::new(error.kind(), text));
            }
        };
        self.since = None;
        tell(&channel, ToHub::Settings(*settings))?;
        tell(&channel, ToHub::Modem { rts: self.modem.0, dtr: self.modem.1 })?;
        self.open = Some(Open { channel, received: VecDeque::new(), written: 0, left: 0, lines: None, ended: false });
        Ok(Opened::Yes(Vec::new()))
    }

    fn apply(&mut self, settings: &LineSettings) -> io::Result<Vec<Warning>> {
        let open = self.open.as_ref().ok_or(io::ErrorKind::NotConnected)?;
        tell(&open.channel, ToHub::TakeBack)?;
        tell(&open.channel, ToHub::Settings(*settings))?;
        Ok(Vec::new())
    }

    fn close(&mut self) {
        self.open = None;
    }

    fn poll_fds<'a>(&'a self, _want_write: bool, fds: &mut PollFds<'a>) {
        if let Some(open) = &self.open {
            fds.push(open.channel.as_fd(), PollFlags::IN);
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let open = self.open.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        open.listen();
        let count = open.received.len().min(buffer.len());
        if count == 0 {
            return if open.ended { Ok(0) } else { Err(io::ErrorKind::WouldBlock.into()) };
        }
        for (place, byte) in buffer.iter_mut().zip(open.received.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let open = self.open.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        let part = &bytes[..bytes.len().min(MESSAGE_MAX - 1)];
        match tell(&open.channel, ToHub::Write(part))? {
            Sent::Yes => {
                open.written = open.written.wrapping_add(1);
                Ok(part.len())
            }
            Sent::Full => Err(io::ErrorKind::WouldBlock.into()),
        }
    }

    fn marks_faults(&self) -> bool {
        true
    }

    fn drained(&mut self) -> Option<bool> {
        let open = self.open.as_mut()?;
        open.listen();
        Some(open.left == open.written)
    }

    fn passage(&self) -> Passage {
        Passage::Simulated
    }

    fn take_back(&mut self) -> usize {
        // The line decides how many bytes are taken back; the owner computes the number from the time.
        if let Some(open) = &self.open {
            let _ = tell(&open.channel, ToHub::TakeBack);
        }
        0
    }

    fn does_odd_stop_bits(&self) -> bool {
        true
    }

    fn modem_lines(&mut self) -> Option<ModemLines> {
        self.open.as_ref()?.lines
    }

    fn set_modem_lines(&mut self, rts: bool, dtr: bool) {
        self.modem = (rts, dtr);
        if let Some(open) = &self.open {
            let _ = tell(&open.channel, ToHub::Modem { rts, dtr });
        }
    }
}
