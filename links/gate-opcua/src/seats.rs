//! The places of a link, of which its key `clients` tells the number. Who has logged in takes one with the first
//! request to the station, and keeps it until the session ends. A session that was only created has none: the library
//! holds [`crate::limits::WAITING`] of those, so that who creates some and never logs in keeps nobody out.

use std::collections::HashMap;
use std::sync::Arc;

use opcua_server::node_manager::RequestContext;
use opcua_types::StatusCode;
use parking_lot::Mutex;

/// Whether a session lives. The library does not give its type a name.
type Lives = Box<dyn Fn() -> bool + Send>;

/// See [the module](self).
pub(crate) struct Seats {
    most: usize,
    taken: Mutex<HashMap<u32, Lives>>,
}

impl Seats {
    pub(crate) fn new(most: usize) -> Self {
        Self { most, taken: Mutex::default() }
    }

    /// A session asks for something.
    ///
    /// # Errors
    /// `BadTooManySessions`: it has no place, and none is free.
    pub(crate) fn sit(&self, context: &RequestContext) -> Result<(), StatusCode> {
        let mut taken = self.taken.lock();
        if taken.contains_key(&context.session_id) {
            return Ok(());
        }
        if taken.len() >= self.most {
            taken.retain(|_, lives| lives());
        }
        if taken.len() >= self.most {
            return Err(StatusCode::BadTooManySessions);
        }
        let session = Arc::downgrade(&context.session);
        let lives = move || session.upgrade().is_some_and(|session| session.read().is_activated());
        taken.insert(context.session_id, Box::new(lives));
        Ok(())
    }
}
