//! The statistics of a soak, as pure functions: percentiles of a distribution, slopes with a confidence interval,
//! comparison of two runs. Values are plain numbers, as reports have them; times are in nanoseconds.

use serde::{Deserialize, Serialize};

/// A percentile is trusted when at least this many values lie beyond it.
pub const BEYOND: u64 = 10;
/// A slope or a comparison is trusted from this many intervals on.
pub const INTERVALS: usize = 8;
/// The normal distribution's bound of a two-sided 95 % interval.
const Z95: f64 = 1.959_964;

/// The percentiles of reports: name and share.
pub const PERCENTILES: [(&str, f64); 6] =
    [("p50", 0.5), ("p90", 0.9), ("p99", 0.99), ("p99.9", 0.999), ("p99.99", 0.9999), ("p99.999", 0.99999)];

/// A percentile, or how much more it takes to know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Percentile {
    /// Value of the percentile, known well enough.
    Known(u64),
    /// So many values are needed until [`BEYOND`] of them can be expected to lie beyond it.
    Needs(u64),
}

/// How many values it takes so that [`BEYOND`] of them lie beyond the share.
pub fn needed(share: f64) -> u64 {
    // Shares like 0.999 are no binary fractions: a count an epsilon above a whole one is that whole one.
    (BEYOND as f64 / (1.0 - share) - 1e-3).ceil() as u64
}

/// The percentile of a distribution given as its buckets: ascending, each its greatest value and its count.
pub fn percentile(buckets: &[(u64, u64)], share: f64) -> Percentile {
    let count: u64 = buckets.iter().map(|(_, n)| n).sum();
    if count < needed(share) { Percentile::Needs(needed(share)) } else { Percentile::Known(quantile(buckets, share)) }
}

/// The value that a share of all values does not exceed; 0 without values.
pub fn quantile(buckets: &[(u64, u64)], share: f64) -> u64 {
    let count: u64 = buckets.iter().map(|(_, n)| n).sum();
    let wanted = ((share * count as f64 - 1e-6).ceil() as u64).max(1);
    let mut seen = 0;
    for (value, n) in buckets {
        seen += n;
        if seen >= wanted {
            return *value;
        }
    }
    0
}

/// How many values are greater than a limit.
pub fn beyond(buckets: &[(u64, u64)], limit: u64) -> u64 {
    buckets.iter().filter(|(value, _)| *value > limit).map(|(_, n)| n).sum()
}

/// What a distribution has gained since an earlier reading. A reading may name its greatest bucket by the greatest
/// value so far, so that this bucket has another name in a later reading: a count whose bucket is no longer there is
/// taken from the next higher one.
pub fn since(now: &[(u64, u64)], before: &[(u64, u64)]) -> Vec<(u64, u64)> {
    let mut before = before.iter().copied().peekable();
    let mut owed = 0;
    let mut new = Vec::new();
    for &(value, count) in now {
        while let Some((_, n)) = before.next_if(|(v, _)| *v <= value) {
            owed += n;
        }
        let taken = owed.min(count);
        owed -= taken;
        if count > taken {
            new.push((value, count - taken));
        }
    }
    new
}

/// A growth an hour is reported from this many hours on: what a process does in its first minute says nothing about an
/// hour.
pub const SLOPE_HOURS: f64 = 1.0 / 6.0;
/// What a slope needs, in words.
pub const SLOPE_NEEDS: &str = "needs 8 intervals in 10 min";

/// The slope through points (hours, value), where they are enough and far enough apart for a growth an hour.
pub fn hourly(points: &[(f64, f64)]) -> Option<Slope> {
    let (first, last) = (points.first()?.0, points.last()?.0);
    // Intervals are named by their ends: the first one has begun before its time.
    let each = (last - first) / (points.len().max(2) - 1) as f64;
    if last - first + each < SLOPE_HOURS { None } else { slope(points) }
}

/// A slope with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// Points it is drawn through.
    pub points: usize,
    /// The median of the slopes of all pairs of points (Theil and Sen), per unit of time.
    pub per_unit: f64,
    /// Lower bound (Sen's interval, from the variance of Kendall's S with its correction for ties).
    pub low: f64,
    /// Upper bound of the same interval.
    pub high: f64,
}

/// The Theil-Sen slope through points (time, value): a few outliers do not move it. `None` for less than [`INTERVALS`]
/// points.
pub fn slope(points: &[(f64, f64)]) -> Option<Slope> {
    if points.len() < INTERVALS {
        return None;
    }
    let mut slopes = Vec::with_capacity(points.len() * (points.len() - 1) / 2);
    for (i, (t1, v1)) in points.iter().enumerate() {
        slopes.extend(points.iter().skip(i + 1).filter(|(t2, _)| t2 != t1).map(|(t2, v2)| (v2 - v1) / (t2 - t1)));
    }
    slopes.sort_by(f64::total_cmp);
    let n = points.len() as f64;
    let term = |n: f64| n * (n - 1.0) * (2.0 * n + 5.0);
    let values: Vec<f64> = points.iter().map(|(_, value)| *value).collect();
    let ties: f64 = ties(values).into_iter().map(|t| term(t as f64)).sum();
    let spread = Z95 * ((term(n) - ties) / 18.0).max(0.0).sqrt();
    let (low, high) = ranks(slopes.len(), spread);
    let at = |index: usize| slopes.get(index).copied().unwrap_or(0.0);
    Some(Slope { points: points.len(), per_unit: median(&slopes), low: at(low), high: at(high) })
}

/// The indexes, in a sorted list, of the bounds so far around its middle.
fn ranks(len: usize, spread: f64) -> (usize, usize) {
    let low = ((len as f64 - spread) / 2.0).floor().max(0.0) as usize;
    let low = low.min(len.saturating_sub(1) / 2);
    (low, len.saturating_sub(1 + low))
}

/// The sizes of the groups of equal values.
fn ties(mut values: Vec<f64>) -> Vec<usize> {
    values.sort_by(f64::total_cmp);
    values.chunk_by(|a, b| a == b).map(<[f64]>::len).collect()
}

/// The median of a sorted list, or 0.
fn median(sorted: &[f64]) -> f64 {
    let (upper, odd) = (sorted.len() / 2, sorted.len() % 2 == 1);
    let at = |index: usize| sorted.get(index).copied().unwrap_or(0.0);
    if odd { at(upper) } else { (at(upper.saturating_sub(1)) + at(upper)) / 2.0 }
}

/// The median of a sample, or 0.
pub fn middle(sample: &[f64]) -> f64 {
    let mut sorted = sample.to_vec();
    sorted.sort_by(f64::total_cmp);
    median(&sorted)
}

/// What two samples say about each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// Median of the first.
    pub a: f64,
    /// Median of the second.
    pub b: f64,
    /// How much the second is greater: the median of all differences (Hodges and Lehmann).
    pub shift: f64,
    /// Lower bound of its 95 % interval.
    pub low: f64,
    /// Upper bound of the same interval.
    pub high: f64,
    /// How often chance alone would make the samples differ so much, either way (Mann-Whitney, normal approximation,
    /// corrected for ties).
    pub p: f64,
}

/// Compares two samples by ranks. `None` when one has less than [`INTERVALS`] values.
pub fn compare(a: &[f64], b: &[f64]) -> Option<Shift> {
    if a.len().min(b.len()) < INTERVALS {
        return None;
    }
    let (n, m) = (a.len() as f64, b.len() as f64);
    let mut differences: Vec<f64> = b.iter().flat_map(|y| a.iter().map(move |x| y - x)).collect();
    differences.sort_by(f64::total_cmp);
    let u: f64 = differences
        .iter()
        .map(|d| {
            if *d > 0.0 {
                1.0
            } else if *d == 0.0 {
                0.5
            } else {
                0.0
            }
        })
        .sum();
    let total = n + m;
    let cubes: f64 = ties([a, b].concat()).into_iter().map(|t| (t * t * t - t) as f64).sum();
    let variance = n * m / 12.0 * ((total + 1.0) - cubes / (total * (total - 1.0)));
    let distance = ((u - n * m / 2.0).abs() - 0.5).max(0.0);
    let p = if variance > 0.0 { (2.0 * upper_tail(distance / variance.sqrt())).min(1.0) } else { 1.0 };
    let (low, high) = ranks(differences.len(), 2.0 * Z95 * variance.max(0.0).sqrt());
    let at = |index: usize| differences.get(index).copied().unwrap_or(0.0);
    Some(Shift { a: middle(a), b: middle(b), shift: median(&differences), low: at(low), high: at(high), p })
}

/// How many samples it takes to tell that one of them is not like the others.
pub const OUTLIERS: usize = 5;
/// A score beyond this makes a sample an outlier (Iglewicz and Hoaglin).
pub const OUTLIER: f64 = 3.5;

/// How far each value lies from the median of all, in units of their spread: the modified z-score of Iglewicz and
/// Hoaglin, by the median of the deviations, or by their mean where more than half of the values are equal. `None` for
/// less than [`OUTLIERS`] values.
pub fn scores(values: &[f64]) -> Option<Vec<f64>> {
    if values.len() < OUTLIERS {
        return None;
    }
    let of_all = middle(values);
    let deviations: Vec<f64> = values.iter().map(|value| (value - of_all).abs()).collect();
    // A standard deviation is 1.4826 median deviations or 1.2533 mean ones.
    let by_median = middle(&deviations) / 0.6745;
    let spread =
        if by_median > 0.0 { by_median } else { deviations.iter().sum::<f64>() / values.len() as f64 * 1.2533 };
    Some(values.iter().map(|value| if spread > 0.0 { (value - of_all) / spread } else { 0.0 }).collect())
}

/// How much more often something happens: (count, of) in two runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ratio {
    /// Share in the second by share in the first; half an event is added to each, so that a run without events has a
    /// ratio, too.
    pub ratio: f64,
    /// Lower bound of its 95 % interval (on the logarithm, after Katz).
    pub low: f64,
    /// Upper bound of the same interval.
    pub high: f64,
}

/// Compares two shares. `None` when less than [`BEYOND`] events have been seen in both together.
pub fn ratio(a: (u64, u64), b: (u64, u64)) -> Option<Ratio> {
    if a.0 + b.0 < BEYOND || a.1 == 0 || b.1 == 0 {
        return None;
    }
    let share = |(count, of): (u64, u64)| (count as f64 + 0.5) / (of as f64 + 0.5);
    let part = |(count, of): (u64, u64)| 1.0 / (count as f64 + 0.5) - 1.0 / (of as f64 + 0.5);
    let spread = Z95 * (part(a) + part(b)).max(0.0).sqrt();
    let ratio = share(b) / share(a);
    Some(Ratio { ratio, low: ratio * (-spread).exp(), high: ratio * spread.exp() })
}

/// How much of the normal distribution lies beyond `z` >= 0 (Abramowitz and Stegun 26.2.17, to 1e-7).
fn upper_tail(z: f64) -> f64 {
    const B: [f64; 5] = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let t = 1.0 / (1.0 + 0.231_641_9 * z);
    let series = B.iter().rev().fold(0.0, |sum, b| (sum + b) * t);
    (-z * z / 2.0).exp() / (2.0 * std::f64::consts::PI).sqrt() * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_percentile_without_ten_values_beyond_it_needs_more() {
        let scans = |n: u64| vec![(100, n - 1), (900, 1)];
        assert_eq!(PERCENTILES.map(|(_, share)| needed(share)), [20, 100, 1_000, 10_000, 100_000, 1_000_000]);
        assert_eq!(percentile(&scans(999), 0.99), Percentile::Needs(1_000));
        assert_eq!(percentile(&scans(1_000), 0.99), Percentile::Known(100));
        assert_eq!(percentile(&[(100, 990), (200, 10)], 0.99), Percentile::Known(100));
        assert_eq!(percentile(&[(100, 989), (200, 11)], 0.99), Percentile::Known(200));
        assert_eq!(percentile(&[], 0.5), Percentile::Needs(20));
        assert_eq!((beyond(&scans(50), 100), beyond(&scans(50), 99), beyond(&scans(50), 900)), (1, 50, 0));
    }

    #[test]
    fn what_has_come_since() {
        assert_eq!(since(&[(1, 5), (3, 2), (9, 1)], &[(1, 5), (3, 1)]), [(3, 1), (9, 1)]);
        // The greatest bucket was named by the greatest value, 7, and is 9 now.
        assert_eq!(since(&[(1, 5), (9, 3)], &[(1, 5), (7, 1)]), [(9, 2)]);
        assert_eq!(since(&[(1, 5)], &[(1, 5)]), []);
    }

    #[test]
    fn a_slope_is_found_through_outliers() {
        let mut points: Vec<(f64, f64)> = (0..20).map(|i| (f64::from(i), 3.0 * f64::from(i) + 5.0)).collect();
        let exact = slope(&points).expect("enough points");
        assert_eq!((exact.per_unit, exact.low, exact.high, exact.points), (3.0, 3.0, 3.0, 20));
        points[7].1 = 1e6;
        let robust = slope(&points).expect("enough points");
        assert!(robust.per_unit == 3.0 && robust.low <= 3.0 && robust.high >= 3.0, "{robust:?}");
        assert_eq!(slope(&points[..7]), None);
    }

    #[test]
    fn noise_has_no_slope_and_a_constant_has_exactly_none() {
        let noise = [5.0, 3.0, 6.0, 2.0, 7.0, 3.0, 5.0, 4.0, 6.0, 3.0, 2.0, 6.0];
        let points: Vec<(f64, f64)> = noise.into_iter().enumerate().map(|(i, v)| (i as f64, v)).collect();
        let slope_of_noise = slope(&points).expect("enough points");
        assert!(slope_of_noise.low < 0.0 && slope_of_noise.high > 0.0, "{slope_of_noise:?}");
        let constant: Vec<(f64, f64)> = (0..9).map(|i| (f64::from(i), 4.0)).collect();
        let none = slope(&constant).expect("enough points");
        assert_eq!((none.per_unit, none.low, none.high), (0.0, 0.0, 0.0));
    }

    #[test]
    fn sens_example_from_the_definition() {
        // 10 points: Z * sqrt(10 * 9 * 25 / 18) = 21.9 ranks around the middle of 45 slopes, from the 12th to the 34th
        // (from 1).
        assert_eq!(ranks(45, Z95 * 125.0_f64.sqrt()), (11, 33));
    }

    #[test]
    fn ratios_of_rare_events() {
        let twice = ratio((100, 1_000_000), (200, 1_000_000)).expect("enough events");
        // Poisson: the logarithm spreads by sqrt(1/100 + 1/200) = 0.1225; 1.96 of that are a factor of 1.271.
        assert!((twice.ratio - 2.0).abs() < 0.01, "{twice:?}");
        assert!((twice.low - 2.0 / 1.271).abs() < 0.01 && (twice.high - 2.0 * 1.271).abs() < 0.02, "{twice:?}");
        let from_none = ratio((0, 1_000_000), (20, 1_000_000)).expect("enough events");
        assert!(from_none.low > 1.0 && from_none.ratio > 20.0, "{from_none:?}");
        assert_eq!(ratio((4, 1000), (5, 1000)), None);
    }

    #[test]
    fn an_outlier_is_seen_among_five_and_not_among_four() {
        let mut values = vec![20.0, 21.0, 19.5, 20.5, 20.2, 19.8];
        assert!(scores(&values).expect("enough").iter().all(|score| score.abs() < OUTLIER));
        values[3] = 40.0;
        let found = scores(&values).expect("enough");
        assert!(found[3] > OUTLIER && found.iter().filter(|score| score.abs() > OUTLIER).count() == 1, "{found:?}");
        // Equal values, and one that is not.
        assert_eq!(scores(&[5.0; 6]), Some(vec![0.0; 6]));
        assert!(scores(&[5.0, 5.0, 5.0, 5.0, 5.0, 9.0]).expect("enough")[5] > OUTLIER);
        assert_eq!(scores(&values[..4]), None);
    }

    #[test]
    fn a_shift_is_seen_and_equal_samples_are_equal() {
        let a: Vec<f64> = (0..12).map(|i| 100.0 + f64::from(i % 5)).collect();
        let b: Vec<f64> = a.iter().map(|x| x + 20.0).collect();
        let worse = compare(&a, &b).expect("enough values");
        assert!(worse.p < 0.001 && worse.low > 15.0 && worse.high < 25.0, "{worse:?}");
        assert_eq!(worse.shift, 20.0);
        let same = compare(&a, &a).expect("enough values");
        assert!(same.p > 0.9 && same.shift == 0.0 && same.low <= 0.0 && same.high >= 0.0, "{same:?}");
        assert_eq!(compare(&a[..7], &b), None);
        // The tail of the normal distribution, from its tables.
        assert!((upper_tail(1.96) - 0.024_998).abs() < 1e-6 && (upper_tail(0.0) - 0.5).abs() < 1e-6);
    }
}
