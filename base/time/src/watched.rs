use crate::{Instant, Span};

/// Time as somebody has watched it: of a longer gap between two looks only so much counts. A patience that is measured
/// with it is not used up while the whole process, or the machine, stands still: nobody was silent meanwhile.
///
/// ```
/// use ob1_time::{Instant, Span, WatchedTime};
///
/// let mut watched = WatchedTime::new(Instant::START, Span::from_millis(100));
/// assert_eq!(watched.look(Instant::from_millis(30)), Instant::from_millis(30));
/// assert_eq!(watched.look(Instant::from_secs(60)), Instant::from_millis(130));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct WatchedTime {
    time: Instant,
    looked: Instant,
    most: Span,
}

impl WatchedTime {
    /// From `now` on; of a gap at most `most` counts.
    pub const fn new(now: Instant, most: Span) -> Self {
        Self { time: now, looked: now, most }
    }

    /// A look, at the time `now` of the clock: returns the watched time.
    pub fn look(&mut self, now: Instant) -> Instant {
        self.time = self.time.saturating_add(now.since(self.looked).min(self.most));
        self.looked = self.looked.max(now);
        self.time
    }

    /// The watched time at the last look.
    pub const fn time(&self) -> Instant {
        self.time
    }
}
