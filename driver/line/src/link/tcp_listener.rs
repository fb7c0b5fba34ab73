//! The called end of a TCP line: one client at a time.

use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsFd;

use rustix::event::PollFlags;

use super::{Link, Opened, Passage, not_a_wire, tcp_common};
use crate::line::{Instant, PollFds};
use crate::supported_frames::{LineSettings, Warning};

/// Callers refused at a time; the others wait.
const CALLERS: usize = 16;

/// Listener and the client that has the line.
pub(crate) struct ListenerLink {
    address: SocketAddr,
    listener: Option<TcpListener>,
    client: Option<TcpStream>,
}

impl ListenerLink {
    pub(crate) const fn new(address: SocketAddr) -> Self {
        Self { address, listener: None, client: None }
    }
}

impl Link for ListenerLink {
    fn open(&mut self, _now: Instant, settings: &LineSettings) -> io::Result<Opened> {
        if self.listener.is_none() {
            // std sets SO_REUSEADDR: a restarted driver gets its port back at once.
            let listener = TcpListener::bind(self.address)?;
            listener.set_nonblocking(true)?;
            self.listener = Some(listener);
        }
        let Some(listener) = &self.listener else { return Ok(Opened::Waiting(None)) };
        match listener.accept() {
            Ok((stream, _)) => {
                tcp_common::set_options(&stream)?;
                self.client = Some(stream);
                Ok(Opened::Yes(not_a_wire("TCP", settings)))
            }
            // No caller, or it was gone again before we accepted.
            Err(error) if is_passing(&error) => Ok(Opened::Waiting(None)),
            Err(error) => {
                self.listener = None;
                Err(error)
            }
        }
    }

    fn apply(&mut self, settings: &LineSettings) -> io::Result<Vec<Warning>> {
        Ok(not_a_wire("TCP", settings))
    }

    /// Closes the client, but keeps the listener: the next client may already wait.
    fn close(&mut self) {
        self.client = None;
    }

    fn poll_fds<'a>(&'a self, want_write: bool, fds: &mut PollFds<'a>) {
        if let Some(listener) = &self.listener {
            fds.push(listener.as_fd(), PollFlags::IN);
        }
        if let Some(client) = &self.client {
            let out = if want_write { PollFlags::OUT } else { PollFlags::empty() };
            fds.push(client.as_fd(), PollFlags::IN | out);
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        tcp_common::read(self.client.as_ref(), buffer)
    }

    fn passage(&self) -> Passage {
        Passage::Network
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        tcp_common::write(self.client.as_ref(), bytes)
    }

    /// A serial line has one other end: callers are refused while it is taken.
    fn housekeeping(&mut self) {
        let Some(listener) = &self.listener else { return };
        for _ in 0..CALLERS {
            match listener.accept() {
                Ok((stream, _)) => drop(stream),
                Err(error) if is_passing(&error) => return,
                // No descriptor is left: the system refuses the callers, until the line is free again. They would keep
                // the socket ready, and the driver would never sleep.
                Err(_) => {
                    self.listener = None;
                    return;
                }
            }
        }
    }
}

fn is_passing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::WouldBlock
            | io::ErrorKind::ConnectionAborted
            | io::ErrorKind::Interrupted
            | io::ErrorKind::ConnectionReset
    )
}
