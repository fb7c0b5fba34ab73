//! The socket of a link: packets in, packets out, and no waiting.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};

use ob1_access::door::{MESSAGE_BYTES, ToBroker, ToLink};
use ob1_socket::handover;
use ob1_time::{Instant, Span};

/// Packets that may wait for a link to take them; with more it is dropped.
const OUTBOX: usize = 4096;
/// A link that has taken nothing for this long is dropped.
const PATIENCE: Span = Span::from_secs(5);

/// A link's process at the other end.
#[derive(Debug)]
pub(crate) struct Connection {
    socket: OwnedFd,
    outbox: VecDeque<Vec<u8>>,
    /// When it took something last, or when there was nothing to take.
    took: Instant,
    gone: Option<&'static str>,
}

/// What a look at the socket has brought.
pub(crate) enum Received {
    /// With the descriptor that came along.
    Message(ToBroker, Option<OwnedFd>),
    Nothing,
    Gone,
}

impl Connection {
    pub(crate) fn new(socket: OwnedFd, now: Instant) -> Self {
        Self { socket, outbox: VecDeque::new(), took: now, gone: None }
    }

    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    pub(crate) fn wants_write(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// How many packets wait.
    pub(crate) fn waiting(&self) -> usize {
        self.outbox.len()
    }

    /// Why it is to be closed.
    pub(crate) const fn gone(&self) -> Option<&'static str> {
        self.gone
    }

    /// The first message, with descriptors.
    pub(crate) fn welcome(&mut self, message: &ToLink, descriptors: &[BorrowedFd<'_>]) -> io::Result<()> {
        handover::send(&self.socket, &message.encode(), descriptors)
    }

    /// Queues a message; [`Connection::flush`] sends it.
    pub(crate) fn say(&mut self, message: &ToLink) {
        let packet = message.encode();
        // The broker keeps to the bound: documents go in parts, and a block that is too long is answered as not there.
        debug_assert!(packet.len() <= MESSAGE_BYTES);
        self.outbox.push_back(packet);
        if self.outbox.len() > OUTBOX {
            self.gone = Some("it does not fetch the answers to its questions");
        }
    }

    pub(crate) fn receive(&mut self, buffer: &mut [u8]) -> Received {
        match handover::receive(&self.socket, buffer) {
            Ok(None) => Received::Nothing,
            Ok(Some((0, _))) => self.is_gone("its socket is closed"),
            Ok(Some((len, descriptors))) => match buffer.get(..len).and_then(ToBroker::decode) {
                Some(message) => Received::Message(message, descriptors.into_iter().next()),
                None => self.is_gone("it speaks another version"),
            },
            Err(_) => self.is_gone("its socket is broken"),
        }
    }

    fn is_gone(&mut self, why: &'static str) -> Received {
        self.gone = Some(why);
        Received::Gone
    }

    /// Sends the packets that wait, until the socket takes no more.
    pub(crate) fn flush(&mut self, now: Instant) {
        while let Some(packet) = self.outbox.front() {
            match handover::send(&self.socket, packet, &[]) {
                Ok(()) => {
                    self.outbox.pop_front();
                    self.took = now;
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(_) => {
                    self.gone = Some("its socket is broken");
                    return;
                }
            }
        }
        if self.outbox.is_empty() {
            self.took = now;
        } else if now.since(self.took) >= PATIENCE {
            self.gone = Some("it does not fetch the answers to its questions");
        }
    }
}
