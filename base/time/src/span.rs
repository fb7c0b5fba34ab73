use core::fmt;
use core::ops::{Add, AddAssign, Div, Mul, Sub};
use core::time::Duration;

/// A length of time in nanoseconds.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct Span(u64);

impl Span {
    /// No time at all.
    pub const ZERO: Self = Self(0);
    /// The longest span, about 584 years.
    pub const MAX: Self = Self(u64::MAX);
    /// The span of one microsecond.
    pub const MICROSECOND: Self = Self(1_000);
    /// The span of one millisecond.
    pub const MILLISECOND: Self = Self(1_000_000);
    /// The span of one second.
    pub const SECOND: Self = Self(1_000_000_000);

    /// A span of so many nanoseconds.
    #[inline]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// So many microseconds; the longest span if that is too many.
    #[inline]
    pub const fn from_micros(micros: u64) -> Self {
        Self::MICROSECOND.times(micros)
    }

    /// So many milliseconds; the longest span if that is too many.
    #[inline]
    pub const fn from_millis(millis: u64) -> Self {
        Self::MILLISECOND.times(millis)
    }

    /// So many seconds; the longest span if that is too many.
    #[inline]
    pub const fn from_secs(secs: u64) -> Self {
        Self::SECOND.times(secs)
    }

    /// The span in nanoseconds, exactly.
    #[inline]
    pub const fn nanos(self) -> u64 {
        self.0
    }

    /// Microseconds, rounded down to whole ones.
    #[inline]
    pub const fn micros(self) -> u64 {
        self.0 / Self::MICROSECOND.0
    }

    /// Milliseconds, rounded down to whole ones.
    #[inline]
    pub const fn millis(self) -> u64 {
        self.0 / Self::MILLISECOND.0
    }

    /// Seconds, rounded down to whole ones.
    #[inline]
    pub const fn secs(self) -> u64 {
        self.0 / Self::SECOND.0
    }

    /// Milliseconds with their fraction, for tables and logs.
    #[inline]
    pub const fn as_millis_f64(self) -> f64 {
        self.0 as f64 / Self::MILLISECOND.0 as f64
    }

    /// Microseconds with their fraction, for tables and logs.
    #[inline]
    pub const fn as_micros_f64(self) -> f64 {
        self.0 as f64 / Self::MICROSECOND.0 as f64
    }

    /// Seconds with their fraction, for tables and logs.
    #[inline]
    pub const fn as_secs_f64(self) -> f64 {
        self.0 as f64 / Self::SECOND.0 as f64
    }

    /// Nanoseconds beyond the whole seconds.
    #[inline]
    pub const fn subsec_nanos(self) -> u64 {
        self.0 % Self::SECOND.0
    }

    /// Whether it is zero.
    #[inline]
    pub const fn is_zero(self) -> bool {
        self.0 == 0
    }

    /// So many times as long; the longest span if that is too long. For constants, which have no `*`.
    #[must_use]
    #[inline]
    pub const fn times(self, factor: u64) -> Self {
        Self(self.0.saturating_mul(factor))
    }

    /// A part of it, rounded down. For constants, which have no `/`.
    ///
    /// # Panics
    /// `parts` is 0.
    #[must_use]
    #[inline]
    pub const fn over(self, parts: u64) -> Self {
        Self(self.0 / parts)
    }

    /// A part of it, rounded up.
    ///
    /// # Panics
    /// `parts` is 0.
    #[must_use]
    #[inline]
    pub const fn over_ceil(self, parts: u64) -> Self {
        Self(self.0.div_ceil(parts))
    }

    /// Both together. For constants, which have no `+`.
    #[must_use]
    #[inline]
    pub const fn plus(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }

    /// How often the other fits into it, rounded up.
    ///
    /// # Panics
    /// `other` is 0.
    #[inline]
    pub const fn div_ceil(self, other: Self) -> u64 {
        self.0.div_ceil(other.0)
    }

    /// By how much the two differ.
    #[must_use]
    #[inline]
    pub const fn abs_diff(self, other: Self) -> Self {
        Self(self.0.abs_diff(other.0))
    }

    /// Both together; the longest span if that is too long.
    #[must_use]
    #[inline]
    pub const fn saturating_add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }

    /// What is left of it without the other; no time if that is longer.
    #[must_use]
    #[inline]
    pub const fn saturating_sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }
}

impl Add for Span {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl AddAssign for Span {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Span {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl Mul<u64> for Span {
    type Output = Self;

    #[inline]
    fn mul(self, factor: u64) -> Self {
        Self(self.0 * factor)
    }
}

impl Mul<Span> for u64 {
    type Output = Span;

    #[inline]
    fn mul(self, span: Span) -> Span {
        span * self
    }
}

impl Div<u64> for Span {
    type Output = Self;

    #[inline]
    fn div(self, parts: u64) -> Self {
        Self(self.0 / parts)
    }
}

/// How often the other fits into it.
impl Div for Span {
    type Output = u64;

    #[inline]
    fn div(self, other: Self) -> u64 {
        self.0 / other.0
    }
}

impl From<Span> for Duration {
    #[inline]
    fn from(span: Span) -> Self {
        Self::from_nanos(span.0)
    }
}

/// The longest span for a duration that is longer.
impl From<Duration> for Span {
    #[inline]
    fn from(duration: Duration) -> Self {
        Self(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX))
    }
}

/// With the unit in which it is a number of at most four digits before the point: `20ms`, `1.5s`.
impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&Duration::from(*self), f)
    }
}

impl fmt::Debug for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;

    use super::*;
    use crate::Instant;

    #[test]
    fn what_has_a_sum() {
        let at = Instant::START + Span::from_secs(2);
        assert_eq!(at - Instant::START, 2 * Span::SECOND);
        assert_eq!(at.saturating_add(Span::MAX), Instant::NEVER);
        assert_eq!(at.saturating_sub(Span::MAX), Instant::START);
        assert_eq!((Instant::START.since(at), at.since(Instant::START)), (Span::ZERO, Span::from_secs(2)));
    }

    #[test]
    fn units() {
        assert_eq!(Span::from_millis(1_500).secs(), 1);
        assert_eq!(Span::from_millis(u64::MAX), Span::MAX);
        assert_eq!(Span::SECOND / Span::from_millis(30), 33);
        assert_eq!(Span::SECOND.div_ceil(Span::from_millis(30)), 34);
        assert_eq!(Span::from(Duration::MAX), Span::MAX);
    }

    #[test]
    fn as_text() {
        assert_eq!(format!("{} {:?}", Span::from_millis(1_500), Instant::from_nanos(20_000)), "1.5s @20µs");
    }

    #[test]
    fn they_cost_what_a_number_costs() {
        assert_eq!([size_of::<Span>(), size_of::<Instant>(), size_of::<Option<Instant>>()], [8, 8, 16]);
    }
}
