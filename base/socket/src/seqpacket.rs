//! Messages between processes of one user: a Unix socket that preserves message boundaries (SOCK_SEQPACKET). Never
//! blocks.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use ob1_time::{Instant, Span};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketFlags, SocketType, accept_with, bind, connect, listen,
    recv, send, socket_with,
};

/// Longest message, in bytes.
pub const MESSAGE_MAX: usize = 8192;

/// Callers that may wait to be accepted.
const BACKLOG: i32 = 16;

/// One end of a connection.
#[derive(Debug)]
pub struct Channel(OwnedFd);

/// The outcome of sending a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sent {
    /// It has been sent.
    Yes,
    /// The other end does not fetch its messages: there is no room, the message is dropped.
    Full,
}

impl Channel {
    /// Connects to a listener of this path; never waits.
    ///
    /// # Errors
    /// The system's error; `NotFound` and `ConnectionRefused`: nobody listens (yet).
    pub fn connect(path: &Path) -> io::Result<Self> {
        let fd = socket()?;
        connect(&fd, &SocketAddrUnix::new(path)?)?;
        Ok(Self(fd))
    }

    /// Sends one message whole, or not at all.
    ///
    /// # Errors
    /// The other end is gone.
    pub fn send(&self, message: &[u8]) -> io::Result<Sent> {
        match send(&self.0, message, SendFlags::NOSIGNAL | SendFlags::DONTWAIT) {
            Ok(_) => Ok(Sent::Yes),
            Err(Errno::AGAIN | Errno::NOBUFS) => Ok(Sent::Full),
            Err(error) => Err(error.into()),
        }
    }

    /// The next message, `None` if there is none now. An empty one is the end of the connection.
    ///
    /// # Errors
    /// What recv(2) refuses with: the other end is gone (`ConnectionReset`).
    pub fn receive<'a>(&self, buffer: &'a mut [u8]) -> io::Result<Option<&'a [u8]>> {
        match recv(&self.0, &mut *buffer, RecvFlags::DONTWAIT) {
            Ok((length, _)) => Ok(Some(&buffer[..length])),
            Err(Errno::AGAIN | Errno::INTR) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }
}

impl AsFd for Channel {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// A socket that accepts callers; its file is removed with it.
#[derive(Debug)]
pub struct Listener {
    fd: OwnedFd,
    /// Removed with the listener that has made it.
    path: Option<PathBuf>,
    /// Nobody is accepted before this time.
    deaf_until: Option<Instant>,
}

/// Time without accepting after the system had no descriptor or memory left.
const PAUSE: Span = Span::from_millis(500);

impl From<OwnedFd> for Listener {
    /// A socket that another process has bound.
    fn from(fd: OwnedFd) -> Self {
        Self { fd, path: None, deaf_until: None }
    }
}

impl Listener {
    /// Listens at `path`, replacing what an earlier process has left there: call it only as the owner of that name.
    ///
    /// # Errors
    /// The system's error, or a path too long for a socket (107 bytes).
    pub fn bind(path: &Path) -> io::Result<Self> {
        let address = SocketAddrUnix::new(path)
            .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "the path is too long for a socket"))?;
        let fd = socket()?;
        let _ = std::fs::remove_file(path);
        bind(&fd, &address)?;
        listen(&fd, BACKLOG)?;
        Ok(Self { fd, path: Some(path.to_owned()), deaf_until: None })
    }

    /// The next caller, if there is one. When the system has no descriptor or memory left for it, nobody is accepted
    /// for half a second: the callers keep the socket ready, and its owner would never sleep.
    pub fn accept(&mut self, now: Instant) -> Option<Channel> {
        self.deaf_until.take_if(|until| now >= *until);
        if self.deaf_until.is_some() {
            return None;
        }
        match accept_with(&self.fd, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK) {
            Ok(fd) => Some(Channel(fd)),
            Err(Errno::AGAIN | Errno::INTR | Errno::CONNABORTED) => None,
            Err(_) => {
                self.deaf_until = Some(now + PAUSE);
                None
            }
        }
    }

    /// The descriptor that becomes readable when somebody calls; none while nobody is accepted.
    pub fn fd(&self, now: Instant) -> Option<BorrowedFd<'_>> {
        self.deaf_until.is_none_or(|until| now >= until).then(|| self.fd.as_fd())
    }

    /// When callers are to be accepted again; none: they are accepted.
    pub const fn deaf_until(&self) -> Option<Instant> {
        self.deaf_until
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            let _ = std::fs::remove_file(path);
        }
    }
}

fn socket() -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    Ok(socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_keep_their_borders_and_a_full_channel_drops() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("s");
        assert_eq!(Channel::connect(&path).expect_err("nobody").kind(), io::ErrorKind::NotFound);
        let mut listener = Listener::bind(&path).expect("free");
        assert!(listener.accept(Instant::START).is_none(), "nobody yet");
        let a = Channel::connect(&path).expect("somebody");
        let b = listener.accept(Instant::START).expect("a caller");
        a.send(b"one").expect("alive");
        a.send(b"two").expect("alive");
        let mut buffer = [0; MESSAGE_MAX];
        assert_eq!(b.receive(&mut buffer).expect("alive"), Some(&b"one"[..]));
        assert_eq!(b.receive(&mut buffer).expect("alive"), Some(&b"two"[..]));
        assert_eq!(b.receive(&mut buffer).expect("alive"), None);
        let mut sent = 0;
        while a.send(&[7; 4096]).expect("alive") == Sent::Yes {
            sent += 1;
            assert!(sent < 100_000, "a socket without an end");
        }
        drop(a);
        for _ in 0..sent {
            assert_eq!(b.receive(&mut buffer).expect("what was sent").map(<[u8]>::len), Some(4096));
        }
        assert_eq!(b.receive(&mut buffer).expect("the end"), Some(&[][..]));
        drop(listener);
        assert!(!path.exists());
    }
}
