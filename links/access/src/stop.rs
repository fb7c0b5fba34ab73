//! The newest STOP of a diagnostic buffer, and what led to it.

use ob1_model::{Event, StateChange};

/// The newest STOP of a diagnostic buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastStop<'e, T> {
    /// The entry of the STOP itself.
    pub stop: &'e T,
    /// The fault right before it, if one led to it.
    pub cause: Option<&'e T>,
    /// Whether the state has changed since.
    pub over: bool,
}

/// Finds it among `entries`, newest first. `of` gives the number of an entry, which counts up, and its event.
pub fn last_stop<T>(entries: &[T], of: impl Fn(&T) -> (u64, Event)) -> Option<LastStop<'_, T>> {
    let change = |entry: &T| of(entry).1.state_change();
    let at = entries.iter().position(|e| matches!(change(e), Some(StateChange::Stop | StateChange::Fault)))?;
    let (newer, [stop, older @ ..]) = entries.split_at(at) else { return None };
    let before = older.first().filter(|entry| of(entry).0 + 1 == of(stop).0);
    let cause = before.filter(|entry| change(stop) == Some(StateChange::Fault) && change(entry).is_none());
    Some(LastStop { stop, cause, over: newer.iter().any(|entry| change(entry).is_some()) })
}
