//! A connection to a terminal server (or to another station's `tcp-listen:`).

use std::io;
use std::net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs};
use std::os::fd::{AsFd, OwnedFd};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, connect, ipproto, socket_with, sockopt};

use super::{Link, Opened, Passage, not_a_wire, tcp_common};
use crate::line::{Instant, PollFds, Span};
use crate::supported_frames::{LineSettings, Warning};

/// How often to check for an answer of the name service.
const LOOK: Span = Span::from_millis(20);
/// A connection attempt is given up after this time.
const CONNECT_TIME: Span = Span::from_secs(5);
/// The longest pause between two attempts.
const SLOWEST: Span = Span::from_secs(2);

enum State {
    Closed,
    /// A name is being resolved. The C library offers that only blocking: a thread does it and ends.
    Resolving(Receiver<io::Result<SocketAddr>>),
    Connecting(OwnedFd, Instant),
    Open(TcpStream),
}

/// The end that connects, again and again until somebody listens.
pub(crate) struct ClientLink {
    host: String,
    port: u16,
    state: State,
}

impl ClientLink {
    pub(crate) const fn new(host: String, port: u16) -> Self {
        Self { host, port, state: State::Closed }
    }

    fn start(&self, now: Instant) -> io::Result<State> {
        if let Ok(address) = self.host.parse::<IpAddr>() {
            return dial(SocketAddr::new(address, self.port), now);
        }
        // The one thread of a driver, and only while a name is looked up: a name service that does not answer must not
        // stop the CP.
        let (sender, receiver) = channel();
        let (host, port) = (self.host.clone(), self.port);
        #[expect(clippy::disallowed_methods, reason = "getaddrinfo exists only blocking")]
        std::thread::Builder::new().name("resolve".into()).spawn(move || {
            let found = (host.as_str(), port).to_socket_addrs().and_then(|mut all| {
                all.next().ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "the name has no address"))
            });
            // If nobody waits any more, the line was closed meanwhile.
            let _ = sender.send(found);
        })?;
        Ok(State::Resolving(receiver))
    }

    fn stream(&self) -> Option<&TcpStream> {
        if let State::Open(stream) = &self.state { Some(stream) } else { None }
    }
}

/// Begins to connect; the socket becomes writable when the attempt has ended.
fn dial(address: SocketAddr, now: Instant) -> io::Result<State> {
    let family = if address.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let fd = socket_with(family, SocketType::STREAM, flags, Some(ipproto::TCP))?;
    match connect(&fd, &address) {
        Ok(()) | Err(Errno::INPROGRESS) => Ok(State::Connecting(fd, now + CONNECT_TIME)),
        Err(error) => Err(error.into()),
    }
}

impl Link for ClientLink {
    fn open(&mut self, now: Instant, settings: &LineSettings) -> io::Result<Opened> {
        loop {
            self.state = match std::mem::replace(&mut self.state, State::Closed) {
                State::Closed => self.start(now)?,
                State::Resolving(receiver) => match receiver.try_recv() {
                    Ok(address) => dial(address?, now)?,
                    Err(TryRecvError::Empty) => {
                        self.state = State::Resolving(receiver);
                        return Ok(Opened::Waiting(Some(now + LOOK)));
                    }
                    Err(TryRecvError::Disconnected) => return Err(io::Error::other("no answer of the name service")),
                },
                State::Connecting(fd, until) => {
                    sockopt::socket_error(&fd)??;
                    let stream = TcpStream::from(fd);
                    if stream.peer_addr().is_err() {
                        if now >= until {
                            return Err(io::ErrorKind::TimedOut.into());
                        }
                        self.state = State::Connecting(stream.into(), until);
                        return Ok(Opened::Waiting(Some(until)));
                    }
                    tcp_common::set_options(&stream)?;
                    State::Open(stream)
                }
                open @ State::Open(_) => {
                    self.state = open;
                    return Ok(Opened::Yes(not_a_wire("TCP", settings)));
                }
            };
        }
    }

    fn apply(&mut self, settings: &LineSettings) -> io::Result<Vec<Warning>> {
        Ok(not_a_wire("TCP", settings))
    }

    fn close(&mut self) {
        self.state = State::Closed;
    }

    fn poll_fds<'a>(&'a self, want_write: bool, fds: &mut PollFds<'a>) {
        match &self.state {
            State::Connecting(fd, _) => fds.push(fd.as_fd(), PollFlags::OUT),
            State::Open(stream) => {
                let out = if want_write { PollFlags::OUT } else { PollFlags::empty() };
                fds.push(stream.as_fd(), PollFlags::IN | out);
            }
            State::Closed | State::Resolving(_) => {}
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        tcp_common::read(self.stream(), buffer)
    }

    fn passage(&self) -> Passage {
        Passage::Network
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        tcp_common::write(self.stream(), bytes)
    }

    fn slowest_retry(&self) -> Span {
        SLOWEST
    }
}
