//! The tap: reports the traffic of the connections to listeners. It never waits: a listener that does not fetch its
//! records loses them, and gets their number. Without listeners it costs a comparison.

use std::cell::RefCell;
use std::os::fd::OwnedFd;
use std::rc::Rc;
use std::time::{self, SystemTime, UNIX_EPOCH};

use ob1_protocols::Instant;
use ob1_protocols::trace::record::{Kind, Record, VERSION};
use ob1_s7::tap::Tapped;
use rustix::io::Errno;
use rustix::net::{SendFlags, SocketFlags, accept_with, send};
use serde_json::json;

/// Maximum of listeners.
const MOST: usize = 4;
/// Bytes in one record.
const CHUNK: usize = 4096;

/// Shared by all connections.
pub(crate) type Shared = Rc<RefCell<Tap>>;

/// The listeners of a link.
#[derive(Debug)]
pub(crate) struct Tap {
    socket: Option<OwnedFd>,
    ears: Vec<Ear>,
    hello: Vec<u8>,
    start: time::Instant,
}

#[derive(Debug)]
struct Ear {
    socket: OwnedFd,
    lost: u64,
}

impl Tap {
    pub(crate) fn new(start: time::Instant) -> Self {
        Self { socket: None, ears: Vec::new(), hello: Vec::new(), start }
    }

    fn now(&self) -> Instant {
        Instant::START + self.start.elapsed().into()
    }

    /// Opens the tap: the socket for listeners, and the identity of the link.
    pub(crate) fn open(&mut self, socket: OwnedFd, station: &str, link: &str) {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let at_zero = u64::try_from(since_1970.as_nanos()).unwrap_or(0).saturating_sub(self.now().nanos());
        let text = json!({
            "version": VERSION, "station": station, "name": link, "module": "s7", "unix_ns": at_zero,
        });
        self.hello = Record::head(Instant::START, Kind::Hello).to_vec();
        self.hello.extend(text.to_string().into_bytes());
        self.socket = Some(socket);
    }

    /// Accepts new listeners.
    pub(crate) fn admit(&mut self) {
        let Some(socket) = &self.socket else { return };
        for _ in 0..MOST {
            let Ok(listener) = accept_with(socket, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK) else { return };
            if self.ears.len() < MOST {
                let mut ear = Ear { socket: listener, lost: 0 };
                if ear.tell(Instant::START, &self.hello) {
                    self.ears.push(ear);
                }
            }
        }
    }

    /// Reports bytes sent over a connection, from its partner or to it.
    pub(crate) fn tell(&mut self, kind: Kind, connection: impl FnOnce() -> Tapped, bytes: &[u8]) {
        if self.ears.is_empty() {
            return;
        }
        let (now, head) = (self.now(), connection().bytes());
        for part in bytes.chunks(CHUNK) {
            let message = [&Record::head(now, kind)[..], &head, part].concat();
            self.ears.retain_mut(|ear| ear.tell(now, &message));
        }
    }
}

impl Ear {
    /// False when it is gone.
    fn tell(&mut self, now: Instant, message: &[u8]) -> bool {
        if self.lost > 0 {
            let gap = [&Record::head(now, Kind::Lost)[..], &self.lost.to_le_bytes()].concat();
            match self.send(&gap) {
                Ok(true) => self.lost = 0,
                Ok(false) => {
                    self.lost += 1;
                    return true;
                }
                Err(_) => return false,
            }
        }
        match self.send(message) {
            Ok(true) => true,
            Ok(false) => {
                self.lost += 1;
                true
            }
            Err(_) => false,
        }
    }

    /// False: there is no room.
    fn send(&self, message: &[u8]) -> Result<bool, Errno> {
        match send(&self.socket, message, SendFlags::DONTWAIT | SendFlags::NOSIGNAL) {
            Ok(_) => Ok(true),
            Err(Errno::AGAIN | Errno::NOBUFS | Errno::INTR) => Ok(false),
            Err(error) => Err(error),
        }
    }
}
