use core::fmt;
use core::ops::{Add, AddAssign, Sub, SubAssign};

use crate::Span;

/// A point of time: nanoseconds since the clock's own start.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct Instant(u64);

impl Instant {
    /// The instant at which the clock began to count.
    pub const START: Self = Self(0);
    /// Later than everything: as a deadline, never.
    pub const NEVER: Self = Self(u64::MAX);

    /// So many nanoseconds after the start.
    #[inline]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// So many microseconds after the start; [`Instant::NEVER`] if that is beyond it.
    #[inline]
    pub const fn from_micros(micros: u64) -> Self {
        Self(Span::from_micros(micros).nanos())
    }

    /// So many milliseconds after the start; [`Instant::NEVER`] if that is beyond it.
    #[inline]
    pub const fn from_millis(millis: u64) -> Self {
        Self(Span::from_millis(millis).nanos())
    }

    /// So many seconds after the start; [`Instant::NEVER`] if that is beyond it.
    #[inline]
    pub const fn from_secs(secs: u64) -> Self {
        Self(Span::from_secs(secs).nanos())
    }

    /// Nanoseconds since the start.
    #[inline]
    pub const fn nanos(self) -> u64 {
        self.0
    }

    /// Whole microseconds since the start.
    #[inline]
    pub const fn micros(self) -> u64 {
        self.since_start().micros()
    }

    /// Whole milliseconds since the start.
    #[inline]
    pub const fn millis(self) -> u64 {
        self.since_start().millis()
    }

    /// The time since the start.
    #[inline]
    pub const fn since_start(self) -> Span {
        Span::from_nanos(self.0)
    }

    /// The time since an earlier instant; 0 if that is not earlier.
    #[inline]
    pub const fn since(self, earlier: Self) -> Span {
        Span::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// The first instant after it that is a whole number of such spans after the start.
    ///
    /// # Panics
    /// The span is 0.
    #[must_use]
    #[inline]
    pub const fn next_tick(self, every: Span) -> Self {
        Self((self.0 / every.nanos() + 1) * every.nanos())
    }

    /// So much later; [`Instant::NEVER`] if that is beyond it.
    #[must_use]
    #[inline]
    pub const fn saturating_add(self, span: Span) -> Self {
        Self(self.0.saturating_add(span.nanos()))
    }

    /// So much later; `None` if that is beyond [`Instant::NEVER`].
    #[must_use]
    #[inline]
    pub const fn checked_add(self, span: Span) -> Option<Self> {
        match self.0.checked_add(span.nanos()) {
            Some(nanos) => Some(Self(nanos)),
            None => None,
        }
    }

    /// So much earlier; [`Instant::START`] if that is before it.
    #[must_use]
    #[inline]
    pub const fn saturating_sub(self, span: Span) -> Self {
        Self(self.0.saturating_sub(span.nanos()))
    }
}

impl Add<Span> for Instant {
    type Output = Self;

    #[inline]
    fn add(self, span: Span) -> Self {
        Self(self.0 + span.nanos())
    }
}

impl AddAssign<Span> for Instant {
    #[inline]
    fn add_assign(&mut self, span: Span) {
        *self = *self + span;
    }
}

impl Sub<Span> for Instant {
    type Output = Self;

    #[inline]
    fn sub(self, span: Span) -> Self {
        Self(self.0 - span.nanos())
    }
}

impl SubAssign<Span> for Instant {
    #[inline]
    fn sub_assign(&mut self, span: Span) {
        *self = *self - span;
    }
}

impl Sub for Instant {
    type Output = Span;

    #[inline]
    fn sub(self, earlier: Self) -> Span {
        Span::from_nanos(self.0 - earlier.0)
    }
}

/// As the span since the start.
impl fmt::Display for Instant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.since_start().fmt(f)
    }
}

impl fmt::Debug for Instant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "@{}", self.since_start())
    }
}
