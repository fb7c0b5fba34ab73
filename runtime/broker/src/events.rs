//! The stream of events: numbered, kept for a while; a client that knows a number resumes after it.

use std::collections::VecDeque;

use ob1_access::door::{Event, What};
use ob1_time::Instant;

/// Events that are kept.
const KEPT: usize = 1024;

/// All events so far, the last of them kept.
#[derive(Debug, Default)]
pub(crate) struct Stream {
    kept: VecDeque<Event>,
    newest: u64,
}

impl Stream {
    pub(crate) fn push(&mut self, time: Instant, what: What) {
        if self.kept.len() == KEPT {
            self.kept.pop_front();
        }
        self.newest += 1;
        self.kept.push_back(Event { number: self.newest, time: time.nanos(), what });
    }

    /// The number of the newest event.
    pub(crate) const fn newest(&self) -> u64 {
        self.newest
    }

    /// The event after number `after`. If the next ones are no longer kept: how many were lost, under the number of the
    /// last.
    pub(crate) fn after(&self, after: u64) -> Option<Event> {
        let first = self.kept.front()?;
        // A client with a number from another run of the station starts at the beginning.
        let after = if after > self.newest { 0 } else { after };
        if after + 1 < first.number {
            let lost = first.number - 1 - after;
            return Some(Event { number: first.number - 1, time: first.time, what: What::Lost(lost) });
        }
        self.kept.get((after + 1 - first.number) as usize).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_access::door::State;

    #[test]
    fn the_stream_is_resumed_and_what_is_gone_is_told() {
        let mut stream = Stream::default();
        assert_eq!(stream.after(0), None);
        let total = KEPT as u64 + 100;
        (1..=total).for_each(|number| stream.push(Instant::from_nanos(number * 10), What::State(State::Run)));
        let first = stream.after(0).expect("the gap");
        assert_eq!((first.number, first.what), (100, What::Lost(100)));
        let mut at = 0;
        let mut seen = Vec::new();
        while let Some(event) = stream.after(at) {
            at = event.number;
            seen.push(at);
        }
        assert_eq!(seen, (100..=total).collect::<Vec<_>>());
        assert_eq!(stream.after(50).map(|event| event.what), Some(What::Lost(50)));
        assert_eq!(stream.after(total - 1).map(|event| (event.number, event.time)), Some((total, total * 10)));
        assert_eq!(stream.after(total + 5).map(|event| event.what), Some(What::Lost(100)), "of another run");
    }
}
