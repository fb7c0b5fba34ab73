//! The wall clock, as text.

use std::time::{SystemTime, UNIX_EPOCH};

pub(crate) use ob1_access::audit::iso;

/// Milliseconds since 1970, UTC.
#[must_use]
pub(crate) fn unix_now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_millis() as u64)
}
