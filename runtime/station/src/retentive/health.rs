//! State of the writing of retentive memory: for `status`, the log and the diagnostic buffer, each change once.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ob1_model::Event;
use parking_lot::Mutex;

use crate::access::protocol::RetentiveStatus;

/// Seen from other threads.
#[derive(Clone, Debug, Default)]
pub struct Health(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    generation: Option<u64>,
    good: Option<Instant>,
    error: Option<(Option<i32>, String)>,
}

/// A change that is to be reported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// What the diagnostic buffer says.
    pub event: Event,
    /// More about it, in words.
    pub text: String,
}

impl Health {
    /// The disk holds what memory holds; `generation` is the number of an image just written. Returns what has changed.
    pub fn good(&self, generation: Option<u64>, now: Instant) -> Option<Change> {
        let mut state = self.0.lock();
        // Nothing new to write says nothing about the disk.
        if generation.is_none() && state.error.is_some() {
            return None;
        }
        state.good = Some(now);
        state.generation = generation.or(state.generation);
        state.error.take()?;
        let text = generation.map_or_else(String::new, |number| format!("generation {number}"));
        Some(Change { event: Event::RETENTIVE_KEPT, text })
    }

    /// A generation could not be written. Returns what has changed: nothing, if this error is known.
    pub fn bad(&self, error: &io::Error, now: Instant) -> Option<Change> {
        let mut state = self.0.lock();
        let (code, text) = (error.raw_os_error(), error.to_string());
        let known = state.error.as_ref().is_some_and(|(known, words)| *known == code && *words == text);
        if known {
            return None;
        }
        state.error = Some((code, text.clone()));
        let age = state.good.map_or_else(
            || "never written".to_owned(),
            |good| format!("last written {:.1} s ago", now.saturating_duration_since(good).as_secs_f64()),
        );
        Some(Change { event: Event::RETENTIVE_LOST, text: format!("{text}; {age}") })
    }

    /// What `status` says of the writing: age of the last image, and the error.
    #[must_use]
    pub fn status(&self, now: Instant) -> RetentiveStatus {
        let state = self.0.lock();
        let age = |good: Instant| now.saturating_duration_since(good);
        RetentiveStatus {
            generation: state.generation,
            age_ns: state.good.map(age).as_ref().map(Duration::as_nanos).map(|nanos| nanos as u64),
            error: state.error.as_ref().map(|(_, text)| text.clone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_state_is_told_once_with_the_age_of_the_last_good_one() {
        let health = Health::default();
        let begin = Instant::now();
        let at = |seconds| begin + Duration::from_secs(seconds);
        let full = || io::Error::from_raw_os_error(28);
        let read_only = || io::Error::from_raw_os_error(30);
        assert_eq!(health.good(Some(1), at(0)), None);
        let told = health.bad(&full(), at(3)).expect("new");
        assert_eq!(told.event, Event::RETENTIVE_LOST);
        assert!(told.text.contains("No space left") && told.text.ends_with("last written 3.0 s ago"), "{told:?}");
        assert_eq!(health.bad(&full(), at(4)), None);
        assert_eq!(health.good(None, at(5)), None, "nothing to write is no sign of room");
        assert!(health.bad(&read_only(), at(6)).expect("another").text.contains("Read-only"));
        let status = health.status(at(7));
        assert_eq!((status.generation, status.age_ns), (Some(1), Some(7_000_000_000)));
        assert!(status.error.is_some());
        assert_eq!(health.good(Some(2), at(8)).map(|told| told.event), Some(Event::RETENTIVE_KEPT));
        assert_eq!(health.good(Some(3), at(9)), None);
        assert_eq!(health.status(at(9)).error, None);
        assert!(Health::default().bad(&full(), at(0)).expect("new").text.ends_with("never written"));
    }
}
