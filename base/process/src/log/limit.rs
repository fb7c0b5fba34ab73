//! How many lines others may cause: a bound with a count of what was left out.
//!
//! Whoever reaches a process over a line or a network can make it write: by a wrong address, a telegram nobody knows, a
//! state that changes with each answer. [`Limit`] is the bound; [`Sparing`] gives one to each place in the code that
//! writes, so that no such place has to think of it. A library, which writes at several places about each connection,
//! is one place.

use std::fmt;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use tracing::callsite::Identifier;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Span, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

use crate::log::ALL;

/// Lines of one place that are written at once,
const AT_ONCE: u32 = 20;
/// and the time after which one more is.
const ONE_MORE: Duration = Duration::from_millis(500);
/// How the names of our own crates begin.
const OURS: &str = "ob1";
/// Longest example of what was left out, in bytes.
const EXAMPLE: usize = 200;

/// So many at once, then one more after each gap; what goes beyond is counted. Handed the time.
#[derive(Clone, Debug)]
pub struct Limit {
    at_once: u32,
    gap: Duration,
    free: u32,
    /// Since then the next one is waited for.
    since: Option<Instant>,
    left_out: u64,
}

impl Limit {
    /// `at_once` without a gap, then one more after each `gap`.
    pub const fn new(at_once: u32, gap: Duration) -> Self {
        Self { at_once, gap, free: at_once, since: None, left_out: 0 }
    }

    /// Whether one more is within the limit; one that is not is counted.
    pub fn take(&mut self, now: Instant) -> bool {
        let since = self.since.unwrap_or(now);
        let gaps = now.saturating_duration_since(since).as_nanos() / self.gap.as_nanos().max(1);
        let gaps = u32::try_from(gaps).unwrap_or(u32::MAX);
        self.free = self.free.saturating_add(gaps).min(self.at_once);
        // A full limit waits for nothing.
        let is_full = self.free == self.at_once;
        self.since = Some(if is_full { now } else { since + self.gap * gaps });
        let is_within = self.free > 0;
        if is_within {
            self.free -= 1;
        } else {
            self.left_out += 1;
        }
        is_within
    }

    /// How many have been left out since the last call.
    pub fn left_out(&mut self) -> u64 {
        std::mem::take(&mut self.left_out)
    }
}

/// A place in the code that has written.
struct Place {
    /// Of a library there is none, but its name.
    id: (Option<Identifier>, &'static str),
    limit: Limit,
    /// One of the lines that were left out, and where it belongs.
    example: String,
    span: Span,
}

static PLACES: Mutex<Vec<Place>> = Mutex::new(Vec::new());

/// Leaves out lines of a place in the code that writes too many. Those below INFO are for whoever has asked for them
/// (`OB1_LOG`), those of the target [`ALL`] have a bound of their own.
pub(crate) struct Sparing {
    /// Is told of the first line that is left out after [`tell_left_out`].
    pub(crate) begun: fn(),
}

impl<S: Subscriber> Layer<S> for Sparing {
    fn event_enabled(&self, event: &Event<'_>, _context: Context<'_, S>) -> bool {
        let line = event.metadata();
        if *line.level() > Level::INFO || line.target() == ALL {
            return true;
        }
        let mut places = PLACES.lock().unwrap_or_else(PoisonError::into_inner);
        let part = line.target().split("::").next().unwrap_or_default();
        let id = if part.starts_with(OURS) { (Some(line.callsite()), part) } else { (None, part) };
        let index = places.iter().position(|place| place.id == id).unwrap_or(places.len());
        if index == places.len() {
            let limit = Limit::new(AT_ONCE, ONE_MORE);
            places.push(Place { id, limit, example: String::new(), span: Span::none() });
        }
        let Some(place) = places.get_mut(index) else { return true };
        let is_within = place.limit.take(Instant::now());
        if place.limit.left_out == 1 && !is_within {
            let mut message = Message(String::new());
            event.record(&mut message);
            message.0.truncate(message.0.floor_char_boundary(EXAMPLE));
            (place.example, place.span) = (message.0, Span::current());
            (self.begun)();
        }
        is_within
    }
}

/// Writes how many lines have been left out, with an example of each kind.
pub(crate) fn tell_left_out() {
    let mut told = Vec::new();
    for place in PLACES.lock().unwrap_or_else(PoisonError::into_inner).iter_mut() {
        let count = place.limit.left_out();
        if count > 0 {
            let span = std::mem::replace(&mut place.span, Span::none());
            told.push((count, std::mem::take(&mut place.example), span));
        }
    }
    for (count, example, span) in told {
        span.in_scope(|| tracing::warn!(target: ALL, "{count} lines like this one are left out: {example}"));
    }
}

/// The text of a line.
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    use tracing_subscriber::layer::SubscriberExt as _;

    use super::*;

    #[test]
    fn so_many_at_once_then_one_for_each_gap_and_the_rest_is_counted() {
        let gap = Duration::from_millis(500);
        let begin = Instant::now();
        let mut limit = Limit::new(3, gap);
        let within =
            |limit: &mut Limit, at: Duration, tries: u32| (0..tries).filter(|_| limit.take(begin + at)).count();
        assert_eq!((within(&mut limit, Duration::ZERO, 10), limit.left_out()), (3, 7));
        assert_eq!((within(&mut limit, gap - Duration::from_nanos(1), 1), limit.left_out()), (0, 1));
        // The half of a gap that has passed is not lost.
        assert_eq!(within(&mut limit, gap + gap / 2, 2), 1);
        assert_eq!(within(&mut limit, gap * 2, 2), 1);
        assert_eq!((within(&mut limit, gap * 1_000_000, 10), limit.left_out()), (3, 9), "no more than at first");
        // Slower than the gap: never any left out.
        assert!((0..100).all(|n| limit.take(begin + gap * (2_000_000 + n))));
    }

    static BEGUN: AtomicU32 = AtomicU32::new(0);

    fn begun() {
        BEGUN.fetch_add(1, Ordering::Relaxed);
    }

    /// Somebody makes a place write without end; another place, which also belongs to a stranger, still has its lines.
    #[test]
    fn a_place_that_floods_is_bounded_and_counted_and_silences_no_other() {
        let text = Arc::new(Mutex::new(Vec::new()));
        let out = Arc::clone(&text);
        let lines = tracing_subscriber::fmt()
            .with_ansi(false)
            .with_target(false)
            .with_writer(move || Out(Arc::clone(&out)))
            .finish()
            .with(Sparing { begun });
        tracing::subscriber::with_default(lines, || {
            let _span = tracing::error_span!("s7", name = "panel").entered();
            for number in 0..5000 {
                tracing::info!("10.0.0.1:{number} refused");
                tracing::debug!("not asked for");
            }
            tracing::info!("another place");
            // A library tells of a connection at several places.
            for number in 0..200 {
                tracing::info!(target: "library::server", "connection {number} accepted");
                tracing::error!(target: "library::channel", "connection {number} ended");
            }
            (0..30).for_each(|n| tracing::info!(target: ALL, "with a bound of its own {n}"));
            tell_left_out();
            tell_left_out();
        });
        assert_eq!(BEGUN.load(Ordering::Relaxed), 2);
        let text = String::from_utf8(text.lock().expect("free").clone()).expect("text");
        let count = |part: &str| text.lines().filter(|line| line.contains(part)).count();
        assert!((20..24).contains(&count(" refused")), "{text}");
        assert_eq!((count("another place"), count("of its own"), count("left out: 10.0.0.1:")), (1, 30, 1), "{text}");
        assert!((21..25).contains(&count(": connection ")), "with the count: {text}");
        let told = text.lines().find(|line| line.contains("left out: 10.")).expect("told");
        assert!(told.contains("s7{name=\"panel\"}"), "{told}");
        let counted = told.split_once("}: ").and_then(|(_, rest)| rest.split(' ').next()?.parse::<usize>().ok());
        assert_eq!(counted.map(|left_out| left_out + count(" refused") - 1), Some(5000), "{told}");
    }

    struct Out(Arc<Mutex<Vec<u8>>>);

    impl std::io::Write for Out {
        fn write(&mut self, text: &[u8]) -> std::io::Result<usize> {
            self.0.lock().expect("free").extend_from_slice(text);
            Ok(text.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
}
