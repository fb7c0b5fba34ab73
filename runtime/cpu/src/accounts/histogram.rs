//! Distributions of times: buckets that one thread writes and others read.
//!
//! The layout is that of an HDR histogram: exact below 256 ns, above that 256 buckets to each power of two, so that a
//! value is known to within 0.4 % from a nanosecond to a minute. (hdrhistogram itself cannot be read while another
//! thread writes; see docs/decisions.)

use std::sync::atomic::{AtomicU64, Ordering};

use ob1_time::Span;

use super::count::Count;

/// Longest time with a bucket of its own, 60 s in nanoseconds. Longer times count as 60 s; the greatest is kept
/// exactly.
const LONGEST: u64 = 60 * Span::SECOND.nanos();
/// Buckets to a power of two.
const FINE: u64 = 256;
const FINE_BITS: u32 = FINE.trailing_zeros();
const BUCKETS: usize = bucket(LONGEST) + 1;

/// The bucket of a time up to [`LONGEST`].
const fn bucket(value: u64) -> usize {
    if value < FINE {
        return value as usize;
    }
    let shift = 63 - value.leading_zeros() - FINE_BITS;
    (shift as usize * FINE as usize) + (value >> shift) as usize
}

/// The greatest value of a bucket.
const fn upper(bucket: usize) -> u64 {
    let bucket = bucket as u64;
    if bucket < FINE {
        return bucket;
    }
    let shift = bucket / FINE - 1;
    ((bucket - shift * FINE + 1) << shift) - 1
}

/// A distribution that is being written.
#[derive(Debug)]
pub(crate) struct Recording {
    buckets: Box<[AtomicU64]>,
    sum: Count,
    greatest: Count,
}

impl Recording {
    pub(crate) fn new() -> Self {
        Self {
            buckets: (0..BUCKETS).map(|_| AtomicU64::new(0)).collect(),
            sum: Count::default(),
            greatest: Count::default(),
        }
    }

    /// Enters a time. Only the scan does.
    #[inline]
    pub(crate) fn record(&self, time: Span) {
        self.record_times(time, 1);
    }

    /// Enters a time more than once.
    #[inline]
    pub(crate) fn record_times(&self, time: Span, times: u64) {
        let time = time.nanos();
        let place = &self.buckets[bucket(time.min(LONGEST))];
        place.store(place.load(Ordering::Relaxed).wrapping_add(times), Ordering::Relaxed);
        self.sum.add(time.wrapping_mul(times));
        if time > self.greatest.get() {
            self.greatest.set(time);
        }
    }

    /// Sum of all recorded times.
    pub(crate) fn sum(&self) -> Span {
        Span::from_nanos(self.sum.get())
    }

    pub(crate) fn read(&self) -> Histogram {
        let counts: Box<[u64]> = self.buckets.iter().map(|bucket| bucket.load(Ordering::Relaxed)).collect();
        Histogram { count: counts.iter().sum(), counts, sum: self.sum.get(), greatest: self.greatest.get() }
    }
}

/// A distribution of times, as it was read. Values are known to within 0.4 %, the greatest since load
/// exactly.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Histogram {
    counts: Box<[u64]>,
    count: u64,
    sum: u64,
    greatest: u64,
}

impl Histogram {
    /// The distribution of these times, each so many times.
    #[must_use]
    pub fn of(times: impl IntoIterator<Item = (Span, u64)>) -> Self {
        let recording = Recording::new();
        for (time, count) in times {
            recording.record_times(time, count);
        }
        recording.read()
    }

    /// The same with another sum, where the times are those of buckets and their sum is known better.
    #[must_use]
    pub fn with_sum(self, sum: Span) -> Self {
        Self { sum: sum.nanos(), ..self }
    }

    /// How many values were recorded.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The least value, or 0.
    #[must_use]
    pub fn min(&self) -> Span {
        self.buckets().next().map_or(Span::ZERO, |(value, _)| value)
    }

    /// The greatest value, or 0.
    #[must_use]
    pub fn max(&self) -> Span {
        self.counts.iter().rposition(|count| *count > 0).map_or(Span::ZERO, |bucket| self.value(bucket))
    }

    /// The mean in nanoseconds, or 0.
    #[must_use]
    pub fn mean(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.sum as f64 / self.count as f64 }
    }

    /// The value that a share `quantile` (0 to 1) of all values does not exceed, or 0.
    #[must_use]
    pub fn quantile(&self, quantile: f64) -> Span {
        let wanted = ((quantile.clamp(0.0, 1.0) * self.count as f64).ceil() as u64).max(1);
        let mut seen = 0;
        for (value, count) in self.buckets() {
            seen += count;
            if seen >= wanted {
                return value;
            }
        }
        Span::ZERO
    }

    /// How many values are greater, to the precision of the buckets.
    #[must_use]
    pub fn beyond(&self, value: Span) -> u64 {
        self.counts.iter().skip(bucket(value.nanos().min(LONGEST)) + 1).sum()
    }

    /// The buckets that hold something, ascending: greatest value and count.
    pub fn buckets(&self) -> impl Iterator<Item = (Span, u64)> {
        self.counts
            .iter()
            .enumerate()
            .filter(|(_, count)| **count > 0)
            .map(|(bucket, count)| (self.value(bucket), *count))
    }

    /// What has been recorded since an earlier reading of the same distribution.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        if earlier.counts.is_empty() {
            return self.clone();
        }
        let counts: Box<[u64]> =
            self.counts.iter().zip(&earlier.counts).map(|(now, then)| now.saturating_sub(*then)).collect();
        let count = counts.iter().sum();
        Self { counts, count, sum: self.sum.wrapping_sub(earlier.sum), greatest: self.greatest }
    }

    /// The times of both.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        let counts: Box<[u64]> = self.counts.iter().zip(&other.counts).map(|(one, more)| one + more).collect();
        let (sum, greatest) = (self.sum.wrapping_add(other.sum), self.greatest.max(other.greatest));
        Self { counts, count: self.count + other.count, sum, greatest }
    }

    /// The usual figures: count, least, mean, quantiles, greatest.
    #[must_use]
    pub fn distribution(&self) -> Distribution {
        Distribution {
            count: self.count,
            min: self.min(),
            mean: self.mean(),
            p50: self.quantile(0.5),
            p99: self.quantile(0.99),
            p999: self.quantile(0.999),
            max: self.max(),
        }
    }

    /// The value a bucket stands for: its upper end, but at most the greatest recorded value.
    fn value(&self, bucket: usize) -> Span {
        Span::from_nanos(if bucket == BUCKETS - 1 { self.greatest } else { upper(bucket).min(self.greatest) })
    }
}

/// A distribution of times, in few figures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distribution {
    /// How many values were recorded.
    pub count: u64,
    /// The smallest value; 0 without values.
    pub min: Span,
    /// Mean, in nanoseconds; 0 without values.
    pub mean: f64,
    /// Median: half of the values are at most this.
    pub p50: Span,
    /// 99 % are at most this.
    pub p99: Span,
    /// 99.9 % are at most this.
    pub p999: Span,
    /// The largest value; 0 without values.
    pub max: Span,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_join_without_a_gap_and_are_narrow() {
        let mut next = 0;
        for index in 0..BUCKETS {
            assert_eq!((bucket(next), bucket(upper(index))), (index, index));
            assert!(upper(index) - next <= next / FINE, "{next}");
            next = upper(index) + 1;
        }
        assert!(next > LONGEST);
    }

    #[test]
    fn figures_agree_with_hdrhistogram() {
        let ours = Recording::new();
        let mut theirs = hdrhistogram::Histogram::<u64>::new_with_bounds(1, LONGEST, 5).expect("constant bounds");
        let (mut state, mut greatest) = (1u64, 0);
        for _ in 0..20_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let value = (state >> 33) >> (state % 29);
            greatest = value.max(greatest);
            ours.record(Span::from_nanos(value.max(1)));
            theirs.record(value.max(1)).expect("in bounds");
        }
        let read = ours.read();
        for quantile in [0.0, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0] {
            let (a, b) = (read.quantile(quantile).nanos() as f64, theirs.value_at_quantile(quantile) as f64);
            assert!((a - b).abs() <= b / 250.0, "{quantile}: {a} {b}");
        }
        assert_eq!((read.count(), read.max()), (20_000, Span::from_nanos(greatest)));
        assert!((read.mean() - theirs.mean()).abs() <= theirs.mean() / 1000.0);
    }

    #[test]
    fn differences_and_what_lies_beyond() {
        let recording = Recording::new();
        assert_eq!(recording.read().distribution(), Distribution::default());
        recording.record(Span::from_nanos(100));
        let first = recording.read();
        recording.record_times(Span::from_nanos(5000), 3);
        recording.record(Span::MAX);
        let second = recording.read();
        assert_eq!(
            (second.max(), second.beyond(Span::from_nanos(5100)), second.beyond(Span::from_nanos(100))),
            (Span::MAX, 1, 4)
        );
        let since = second.since(&first);
        assert_eq!((since.count(), since.beyond(Span::from_nanos(100))), (4, 4));
        assert_eq!(second.since(&Histogram::default()), second);
        let both = first.and(&second);
        assert_eq!((both.count(), both.max(), both.beyond(Span::from_nanos(100))), (6, Span::MAX, 4));
    }
}
