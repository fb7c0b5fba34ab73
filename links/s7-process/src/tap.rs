//! The tap of a link: its connections share one, with one clock.

use std::cell::RefCell;
use std::os::fd::OwnedFd;
use std::rc::Rc;
use std::time::{self, SystemTime};

use ob1_process::tap;
use ob1_s7::tap::Tapped;
use ob1_serial::Instant;
use ob1_serial::tap_record::Kind;
use serde_json::json;

/// Shared by all connections.
pub(crate) type Shared = Rc<RefCell<Tap>>;

/// The listeners of a link.
#[derive(Debug)]
pub(crate) struct Tap {
    tap: tap::Tap,
    start: time::Instant,
}

impl Tap {
    pub(crate) fn new(start: time::Instant) -> Self {
        Self { tap: tap::Tap::default(), start }
    }

    fn now(&self) -> Instant {
        Instant::START + self.start.elapsed().into()
    }

    /// Opens the tap: the socket for listeners, and the identity of the link.
    pub(crate) fn open(&mut self, socket: OwnedFd, station: &str, link: &str) {
        let about = json!({ "station": station, "name": link, "module": "s7" });
        self.tap.introduce(self.now(), SystemTime::now(), about);
        self.tap.listen(socket);
    }

    /// Accepts new listeners of `ob1 trace`.
    pub(crate) fn admit(&mut self) {
        self.tap.admit(self.now());
    }

    /// Reports bytes sent over a connection, from its partner or to it.
    pub(crate) fn tell(&mut self, kind: Kind, connection: impl FnOnce() -> Tapped, bytes: &[u8]) {
        if !self.tap.is_alone() {
            self.tap.tell_of(self.now(), kind, &connection().bytes(), bytes);
        }
    }
}
