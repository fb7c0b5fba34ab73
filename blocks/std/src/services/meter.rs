//! A run-time meter (SFC 2 to 4, SFC 101): counts hours.

use ob1_time::{Instant, Span};

const HOUR: Span = Span::from_secs(3600);

/// A run-time meter. The CPU keeps it over a warm restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunTimeMeter {
    /// Hours it was set to.
    preset: u32,
    /// Counted on top of them, up to `since`.
    counted: Span,
    /// Since when it runs; `None`: it does not.
    since: Option<Instant>,
}

impl RunTimeMeter {
    /// The highest count SFC 2 to 4 show, in hours: they see a meter as an INT.
    pub const MAX_HOURS: u16 = 32_767;
    /// The highest count there is, in hours: SFC 101 sees a meter as a DINT.
    pub const MAX_LONG_HOURS: u32 = i32::MAX as u32;

    /// Sets the count and stops the meter.
    pub const fn set(&mut self, hours: u32) {
        *self = Self { preset: hours, counted: Span::ZERO, since: None };
    }

    /// Starts or stops it.
    pub const fn control(&mut self, run: bool, now: Instant) {
        self.counted = self.counted_at(now);
        self.since = if run { Some(now) } else { None };
    }

    /// For the CPU: it was in STOP between two times, and nothing was counted. Only where the program continues does a
    /// running meter go on; else the program has to start it again.
    pub const fn stood(&mut self, from: Instant, to: Instant, continues: bool) {
        let goes_on = continues && self.is_running();
        self.control(false, from);
        if goes_on {
            self.control(true, to);
        }
    }

    /// True while it counts.
    pub const fn is_running(&self) -> bool {
        self.since.is_some()
    }

    /// Whole hours; `None` when there are more than [`Self::MAX_HOURS`].
    pub fn hours(&self, now: Instant) -> Option<u16> {
        let hours = self.total(now);
        if hours > Self::MAX_HOURS as u64 { None } else { Some(hours as u16) }
    }

    /// Whole hours; `None` when there are more than [`Self::MAX_LONG_HOURS`].
    pub fn long_hours(&self, now: Instant) -> Option<u32> {
        let hours = self.total(now);
        if hours > Self::MAX_LONG_HOURS as u64 { None } else { Some(hours as u32) }
    }

    fn total(&self, now: Instant) -> u64 {
        self.preset as u64 + self.counted_at(now) / HOUR
    }

    const fn counted_at(&self, now: Instant) -> Span {
        match self.since {
            Some(since) => self.counted.saturating_add(now.since(since)),
            None => self.counted,
        }
    }
}
