//! The places of a link, of which its key `clients` tells the number. Who has logged in takes one with the first
//! request to the station, and keeps it until the session ends. A session that was only created has none: the library
//! holds [`super::limits::WAITING`] of those, so that who creates some and never logs in keeps nobody out.
//!
//! If all places are taken, a user gets that of the anonymous client who has had one for longest.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use opcua_server::node_manager::RequestContext;
use opcua_types::StatusCode;
use parking_lot::Mutex;

use crate::opcua::auth::is_anonymous;

/// The channel of an activated session; `None`: it is gone. The library does not give the session's type a name.
type Channel = Box<dyn Fn() -> Option<u32> + Send>;

/// An activated session.
struct Known {
    channel: Channel,
    anonymous: bool,
    /// When it has taken a place.
    place: Option<u64>,
}

/// See [the module](self).
pub(crate) struct Seats {
    most: usize,
    known: Mutex<HashMap<u32, Known>>,
}

fn channel(context: &RequestContext) -> Channel {
    let session = Arc::downgrade(&context.session);
    Box::new(move || {
        let session = session.upgrade()?;
        let session = session.read();
        session.is_activated().then(|| session.secure_channel_id())
    })
}

impl Seats {
    pub(crate) fn new(most: usize) -> Self {
        Self { most, known: Mutex::default() }
    }

    /// A session has been activated, perhaps again.
    pub(crate) fn activated(&self, context: &RequestContext) {
        self.know(context.session_id, is_anonymous(&context.token), channel(context));
    }

    /// A session asks for something.
    ///
    /// # Errors
    /// `BadTooManySessions`: it has no place, and none is free.
    pub(crate) fn sit(&self, context: &RequestContext) -> Result<(), StatusCode> {
        self.take(context.session_id)
    }

    /// The channels in use: of a user, or of who has a place.
    pub(crate) fn channels(&self) -> HashSet<u32> {
        let known = self.known.lock();
        let used = known.values().filter(|known| !known.anonymous || known.place.is_some());
        used.filter_map(|known| (known.channel)()).collect()
    }

    fn know(&self, session: u32, anonymous: bool, channel: Channel) {
        let mut known = self.known.lock();
        known.retain(|_, known| (known.channel)().is_some());
        let place = known.get(&session).and_then(|known| known.place);
        known.insert(session, Known { channel, anonymous, place });
    }

    fn take(&self, session: u32) -> Result<(), StatusCode> {
        let mut known = self.known.lock();
        let asking = known.get(&session).ok_or(StatusCode::BadSessionNotActivated)?;
        if asking.place.is_some() {
            return Ok(());
        }
        let anonymous = asking.anonymous;
        let taken = |known: &HashMap<u32, Known>| known.values().filter(|known| known.place.is_some()).count();
        if taken(&known) >= self.most {
            known.retain(|id, known| *id == session || (known.channel)().is_some());
        }
        if taken(&known) >= self.most {
            let loses = known.values_mut().filter(|known| known.anonymous && known.place.is_some() && !anonymous);
            loses.min_by_key(|known| known.place).ok_or(StatusCode::BadTooManySessions)?.place = None;
        }
        let next = known.values().filter_map(|known| known.place).max().map_or(0, |last| last + 1);
        if let Some(known) = known.get_mut(&session) {
            known.place = Some(next);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// A session that lives while this is true; its channel has its number.
    fn session(seats: &Seats, id: u32, anonymous: bool) -> Arc<AtomicBool> {
        let alive = Arc::new(AtomicBool::new(true));
        let lives = Arc::clone(&alive);
        seats.know(id, anonymous, Box::new(move || lives.load(Ordering::Relaxed).then_some(id)));
        alive
    }

    #[test]
    fn a_user_gets_the_place_of_the_oldest_anonymous_client() {
        let seats = Seats::new(2);
        let _held: Vec<_> = [(1, true), (2, true), (3, true), (4, false), (5, false), (6, false)]
            .map(|(id, anonymous)| session(&seats, id, anonymous))
            .into();
        assert_eq!((seats.take(2), seats.take(1)), (Ok(()), Ok(())));
        let full = Err(StatusCode::BadTooManySessions);
        assert_eq!(seats.take(3), full, "an anonymous client takes nobody's place");
        assert_eq!(seats.take(4), Ok(()));
        assert_eq!((seats.take(2), seats.take(1)), (full, Ok(())), "2 has sat for longer than 1");
        assert_eq!(seats.take(5), Ok(()));
        assert_eq!((seats.take(1), seats.take(6)), (full, full), "users keep theirs");
        assert_eq!((seats.take(4), seats.take(5)), (Ok(()), Ok(())));
    }

    #[test]
    fn who_is_gone_has_no_place() {
        let seats = Seats::new(1);
        let first = session(&seats, 1, false);
        let _second = session(&seats, 2, true);
        assert_eq!((seats.take(1), seats.take(2)), (Ok(()), Err(StatusCode::BadTooManySessions)));
        assert_eq!(seats.channels(), HashSet::from([1]));
        first.store(false, Ordering::Relaxed);
        assert_eq!(seats.channels(), HashSet::new(), "neither who is gone, nor an anonymous client without a place");
        assert_eq!(seats.take(2), Ok(()));
        assert_eq!(seats.channels(), HashSet::from([2]));
    }

    #[test]
    fn activated_again_it_keeps_its_place_and_has_its_new_user() {
        let seats = Seats::new(1);
        let _first = session(&seats, 1, false);
        assert_eq!(seats.take(1), Ok(()));
        let _again = session(&seats, 1, true);
        let _second = session(&seats, 2, false);
        assert_eq!(seats.take(1), Ok(()));
        assert_eq!((seats.take(2), seats.take(1)), (Ok(()), Err(StatusCode::BadTooManySessions)));
    }
}
