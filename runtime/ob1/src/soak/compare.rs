//! `ob1 soak --compare A.json B.json`: whether the second of two soaks is worse, and by how much.
//!
//! Medians and high percentiles are compared by the intervals of the time series, which are nearly independent of one
//! another; scans are not. What is too rare for that (the tail, late scans, missed deadlines) is compared by counts.

use std::fmt::Write as _;
use std::path::Path;

use super::report::Report;
use crate::exit::SoakExit;
use crate::statistics::{INTERVALS, Ratio, Shift, beyond, compare as shift, needed, quantile, ratio};
use crate::units::time;

/// The series that are compared by their intervals.
pub(super) const SERIES: [&str; 6] =
    ["wake.p50", "wake.p99", "execution.p50", "execution.p99", "cycle.p50", "cycle.p99"];
/// A tail is worse when the values beyond the first run's percentile are more than this many times as many.
const MORE: f64 = 2.0;

/// What a row says. The order is that of severity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Judged {
    NotWorse,
    Inconclusive,
    Worse,
}

impl Judged {
    /// By an interval: all of it beyond the limit, or none of it.
    fn by(low: f64, high: f64, limit: f64) -> Self {
        match () {
            () if low > limit => Self::Worse,
            () if high <= limit => Self::NotWorse,
            () => Self::Inconclusive,
        }
    }

    const fn text(self) -> &'static str {
        match self {
            Self::NotWorse => "not worse",
            Self::Inconclusive => "inconclusive",
            Self::Worse => "WORSE",
        }
    }
}

/// Compares two reports and prints what there is to say.
pub(super) fn compare(a: &Path, b: &Path, margin: f64) -> Result<SoakExit, String> {
    let (a, b) = (Report::read(a)?, Report::read(b)?);
    let (text, judged) = told(&a, &b, margin);
    says!("{text}");
    Ok(match judged {
        Judged::NotWorse => SoakExit::Pass,
        Judged::Inconclusive => SoakExit::Inconclusive,
        Judged::Worse => SoakExit::Broken,
    })
}

fn told(a: &Report, b: &Report, margin: f64) -> (String, Judged) {
    let mut out = format!("A: {}\nB: {}\n", heading(a), heading(b));
    for difference in differences(a, b) {
        let _ = writeln!(out, "differs: {difference}");
    }
    let mut rows: Vec<(&str, Judged)> = Vec::new();
    let _ = writeln!(
        out,
        "\n{:<24}{:>11}{:>11}{:>11}   {:<26}{:>8}",
        "by intervals", "A", "B", "B - A", "95 % interval", "p"
    );
    for name in SERIES {
        let values = |report: &Report| report.series(name).into_iter().map(|(_, value)| value).collect::<Vec<f64>>();
        let Some(s) = shift(&values(a), &values(b)) else {
            let _ = writeln!(out, "{name:<24} needs {INTERVALS} intervals in both");
            rows.push((name, Judged::Inconclusive));
            continue;
        };
        let judged = Judged::by(s.low, s.high, s.a * margin);
        let _ = writeln!(out, "{name:<24}{}   {}", figures(&s), judged.text());
        rows.push((name, judged));
    }
    let _ = writeln!(out, "\n{:<24}{:>11}{:>11}{:>11}   {:<26}", "by counts", "A", "B", "B / A", "95 % interval");
    for (name, in_a, in_b) in counts(a, b) {
        let Some(r) = ratio(in_a, in_b) else {
            let _ = writeln!(out, "{name:<24}{:>11}{:>11}   too few to compare", in_a.0, in_b.0);
            continue;
        };
        let judged = Judged::by(r.low, r.high, MORE);
        let Ratio { ratio, low, high } = r;
        let interval = format!("{low:.2} .. {high:.2}");
        let _ =
            writeln!(out, "{name:<24}{:>11}{:>11}{ratio:>11.2}   {interval:<34}   {}", in_a.0, in_b.0, judged.text());
        rows.push(("tail", judged));
    }
    let _ = writeln!(
        out,
        "\nB - A: median of all differences between intervals (Hodges and Lehmann) with its 95 % interval; p: Mann-Whitney, two-sided; worse: \
         the whole interval lies above {:.0} % of A's median, not worse: none of it does.\nB / A: ratio of shares with its 95 % interval (Katz); \
         worse: all of it above {MORE}. Neighbouring scans are alike, so that these intervals are a little too narrow.",
        margin * 100.0
    );
    let judged = rows.iter().map(|(_, judged)| *judged).max().unwrap_or(Judged::Inconclusive);
    let _ = writeln!(out, "B is {}", judged.text());
    (out, judged)
}

fn heading(r: &Report) -> String {
    let load = r.load.as_ref().map_or_else(|| "no load".to_owned(), |load| format!("load {}", load.spec));
    let scans = r.timing.as_ref().map_or(0, |timing| timing.scans);
    format!(
        "{}, ob1 {}, {} measured, {scans} scans, {} intervals, {load}",
        r.station,
        r.version,
        time(r.measured_ns as f64),
        r.intervals.len()
    )
}

/// What makes the two hard to compare.
pub(super) fn differences(a: &Report, b: &Report) -> Vec<String> {
    let cycle = |r: &Report| r.timing.as_ref().map_or_else(String::new, |t| time(t.min_cycle_ns as f64));
    let load =
        |r: &Report| r.load.as_ref().map_or_else(|| "none".to_owned(), |l| format!("{} seed {}", l.spec, l.seed));
    let posture = |r: &Report| {
        let all = r.posture.iter().map(|grant| format!("{} {} {}", grant.outcome, grant.what, grant.detail));
        all.collect::<Vec<_>>().join("; ")
    };
    let pairs = [
        ("station", a.station.clone(), b.station.clone()),
        ("interval of the scan", cycle(a), cycle(b)),
        ("load", load(a), load(b)),
        ("intervals", time(a.interval_ns as f64), time(b.interval_ns as f64)),
        ("posture", posture(a), posture(b)),
    ];
    let different = pairs.into_iter().filter(|(_, a, b)| a != b);
    different.map(|(what, a, b)| format!("{what}\n  A {a}\n  B {b}")).collect()
}

fn figures(s: &Shift) -> String {
    let interval = format!("{} .. {}", time(s.low), time(s.high));
    format!("{:>11}{:>11}{:>11}   {interval:<26}{:>8.4}", time(s.a), time(s.b), time(s.shift), s.p)
}

/// How often, of how many.
type Share = (u64, u64);

/// What is compared by counts: its name, and how often in either.
fn counts(a: &Report, b: &Report) -> Vec<(String, Share, Share)> {
    let mut rows = Vec::new();
    for name in ["wake", "execution"] {
        let (Some(in_a), Some(in_b)) = (a.distribution(name), b.distribution(name)) else { continue };
        if in_a.count < needed(0.999) {
            continue;
        }
        let limit = quantile(&in_a.buckets, 0.999);
        let of = |spread: &ob1_timing::snapshot::Spread| (beyond(&spread.buckets, limit), spread.count);
        rows.push((format!("{name} > {}", time(limit as f64)), of(in_a), of(in_b)));
    }
    if let (Some(in_a), Some(in_b)) = (&a.timing, &b.timing) {
        rows.push(("late scans".into(), (in_a.late.scans, in_a.scans), (in_b.late.scans, in_b.scans)));
        rows.push(("overruns".into(), (in_a.overruns, in_a.scans), (in_b.overruns, in_b.scans)));
        rows.push(("missed deadlines".into(), (in_a.missed, in_a.scans), (in_b.missed, in_b.scans)));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soak::report::{Brief, Interval};

    /// A run whose wake-up and execution lie around these values, by a little pattern.
    fn run(wake_p99: u64, execution_p50: u64, intervals: u64) -> Report {
        let brief =
            |p50: u64, p99: u64, i: u64| Brief { p50_ns: p50 + i * 7 % 5, p99_ns: p99 + i * 13 % 11, max_ns: p99 * 3 };
        let interval = |i: u64| Interval {
            end_ns: (i + 1) * 1_000_000_000,
            wake: brief(5_000, wake_p99, i),
            execution: brief(execution_p50, execution_p50 * 2, i),
            cycle: brief(1_000_000, 1_010_000, i),
            ..Interval::default()
        };
        Report { station: "x".into(), intervals: (0..intervals).map(interval).collect(), ..Report::default() }
    }

    #[test]
    fn worse_not_worse_and_too_short() {
        let a = run(20_000, 9_000, 30);
        let (text, judged) = told(&a, &run(20_005, 9_000, 30), 0.1);
        assert_eq!(judged, Judged::NotWorse, "{text}");
        let (text, judged) = told(&a, &run(26_000, 9_000, 30), 0.1);
        assert_eq!(judged, Judged::Worse, "{text}");
        let row = text.lines().find(|line| line.starts_with("wake.p99")).expect("its row");
        assert!(row.contains("6.00 µs") && row.contains("WORSE"), "{row}");
        assert!(text.lines().any(|line| line.starts_with("execution.p50") && line.ends_with("not worse")), "{text}");
        // Faster is not worse, and seven intervals say nothing.
        assert_eq!(told(&run(26_000, 9_000, 30), &a, 0.1).1, Judged::NotWorse);
        assert_eq!(told(&a, &run(20_000, 9_000, 7), 0.1).1, Judged::Inconclusive);
    }

    #[test]
    fn what_cannot_be_compared_is_said() {
        let (text, _) = told(&run(20_000, 9_000, 9), &Report { station: "y".into(), ..run(20_000, 9_000, 9) }, 0.1);
        assert!(text.contains("differs: station\n  A x\n  B y\n"), "{text}");
    }
}
