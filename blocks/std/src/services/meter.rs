//! A run-time meter (SFC 2 to 4): counts hours.

const HOUR_NS: u64 = 3_600_000_000_000;

/// A run-time meter. The CPU keeps it over a warm restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunTimeMeter {
    /// Nanoseconds counted up to `since`.
    counted: u64,
    /// Running since then.
    since: Option<u64>,
}

impl RunTimeMeter {
    /// The highest count, in hours.
    pub const MAX_HOURS: u16 = 32_767;

    /// Sets the count and stops the meter.
    pub const fn set(&mut self, hours: u16) {
        *self = Self { counted: hours as u64 * HOUR_NS, since: None };
    }

    /// Starts or stops it.
    pub const fn control(&mut self, run: bool, now: u64) {
        self.counted = self.total(now);
        self.since = if run { Some(now) } else { None };
    }

    /// True while it counts.
    #[must_use]
    pub const fn is_running(&self) -> bool {
        self.since.is_some()
    }

    /// Whole hours; `None` when there are more than [`Self::MAX_HOURS`].
    #[must_use]
    pub const fn hours(&self, now: u64) -> Option<u16> {
        let hours = self.total(now) / HOUR_NS;
        if hours > Self::MAX_HOURS as u64 { None } else { Some(hours as u16) }
    }

    const fn total(&self, now: u64) -> u64 {
        match self.since {
            Some(since) => self.counted.saturating_add(now.saturating_sub(since)),
            None => self.counted,
        }
    }
}
