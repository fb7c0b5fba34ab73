//! Verdicts on distributions, trends and counts that are known.

use super::*;
use crate::soak::report::{Brief, CellLedger, Interval};
use ob1_timing::Timing;

/// A report with these wake-up times, each so many times, and intervals whose memory grows by so much each minute.
fn report(wake: &[(u64, u64)], growth: u64) -> Report {
    let spread = |buckets: &[(u64, u64)]| {
        let count: u64 = buckets.iter().map(|(_, n)| n).sum();
        let max = buckets.last().map_or(0, |(value, _)| *value);
        serde_json::json!({"count": count, "min_ns": 0, "mean_ns": 5.5, "p50_ns": 0, "p90_ns": 0, "p99_ns": 0, "p999_ns": 0,
            "p9999_ns": 0, "max_ns": max, "buckets": buckets})
    };
    let late = serde_json::json!({"scans": 4, "pending": 0, "lost": 0, "unexplained_share": 0.25,
        "classes": {"kernel": {"scans": 3, "time_ns": 9000, "worst_ns": 5000}, "unexplained": {"scans": 1, "time_ns": 10, "worst_ns": 10}},
        "worst": [], "newest": []});
    let none = spread(&[]);
    let timing: Timing = serde_json::from_value(serde_json::json!({"schema": 1, "time_ns": 0, "since_ns": 0, "min_cycle_ns": 0,
        "missed_rule": "skip", "late_from_ns": 0, "long_from_ns": 0, "scans": 1000, "statements": 0, "overruns": 2, "missed": 5,
        "watchdogs": 0, "cycle": none, "wake": spread(wake), "deadlines": none, "execution": none, "inputs": none, "outputs": none,
        "obs": [], "blocks": [], "late": late}))
    .expect("accounts");
    let interval = |minute: u64| Interval {
        end_ns: minute * 60_000_000_000,
        // One outlier: somebody else's spike is no leak.
        rss_bytes: 10_000_000 + growth * minute + if minute == 7 { 5_000_000 } else { 0 },
        wake: Brief { p99_ns: 20_000 + minute % 3, ..Brief::default() },
        ..Interval::default()
    };
    Report {
        ended: Ended::Time,
        timing: Some(timing),
        intervals: (1..=20).map(interval).collect(),
        telegrams: vec![CpLedger { lost: 1, ..CpLedger::default() }, CpLedger { lost: 2, ..CpLedger::default() }],
        cells: vec![CellLedger { name: "DB20.WRONG".into(), role: Role::Wrong, first: 3.0, last: 4.0 }],
        ..Report::default()
    }
}

fn verdicts(mut report: Report, budget: &str) -> (Verdict, Vec<(Verdict, String)>) {
    let budget: Vec<Budget> = budget.split(',').map(|text| text.parse().expect(text)).collect();
    judge(&mut report, &budget);
    (report.verdict, report.findings.into_iter().skip(1).map(|f| (f.verdict, f.measured)).collect())
}

#[test]
fn percentiles_of_known_distributions() {
    use Verdict::*;
    // 10000 values: 9980 of 10 µs, 20 of 900 µs.
    let wake = [(10_000, 9_980), (900_000, 20)];
    for (limit, verdict, measured) in [
        ("wake.p99=10us", Pass, "10.0 µs"),
        ("wake.p99=9us", Broken, "10.0 µs"),
        // Ten may lie beyond.
        ("wake.p99.9=899us", Broken, "900 µs"),
        ("wake.p99.9=900us", Pass, "900 µs"),
        // One may: with 20 beyond it is broken for sure, though the percentile itself needs ten times as many values.
        ("wake.p99.99=500us", Broken, "900 µs"),
        ("wake.p99.99=900us", Inconclusive, "needs 100000 values"),
        ("wake.max=900us", Pass, "900 µs"),
        ("wake.max=899us", Broken, "900 µs"),
        ("wake.mean=5ns", Broken, "5.50 ns"),
        ("ob35.p50=1s", Inconclusive, "nothing"),
    ] {
        let (all, findings) = verdicts(report(&wake, 0), limit);
        assert_eq!((findings[0].0, findings[0].1.as_str()), (verdict, measured), "{limit}");
        assert_eq!(all, verdict, "the worst finding is the verdict");
    }
    // Nine beyond the limit are not enough to break anything.
    let (all, _) = verdicts(report(&[(10_000, 991), (900_000, 9)], 0), "wake.p99.9=20us");
    assert_eq!(all, Inconclusive);
}

#[test]
fn leaks_are_found_through_outliers_and_constants_are_no_leaks() {
    use Verdict::*;
    // 64 KiB a minute are 3.75 MiB an hour.
    for (growth, limit, verdict) in [
        (65_536, "rss.slope=1MiB/h", Broken),
        (65_536, "rss.slope=4MiB/h", Pass),
        (0, "rss.slope=0/h", Pass),
        (0, "fds.slope=0/h", Pass),
    ] {
        assert_eq!(verdicts(report(&[(1, 1)], growth), limit).0, verdict, "{growth} {limit}");
    }
    let mut short = report(&[(1, 1)], 65_536);
    short.intervals.truncate(7);
    assert_eq!(verdicts(short, "rss.slope=1MiB/h").0, Inconclusive);
    // A minute says nothing about an hour, however many intervals it has.
    let mut minute = report(&[(1, 1)], 65_536);
    minute.intervals.iter_mut().for_each(|interval| interval.end_ns /= 20);
    let (verdict, findings) = verdicts(minute.clone(), "rss.slope=1MiB/h");
    assert_eq!((verdict, findings[0].1.as_str()), (Inconclusive, "needs 8 intervals in 10 min"));
    judge(&mut minute, &[]);
    assert!(minute.slopes.iter().all(|named| named.slope.is_none()));
    // Noise around a constant: a limit within the interval is not judged.
    assert_eq!(verdicts(report(&[(1, 1)], 0), "wake.p99.slope=1us/h").0, Pass);
}

#[test]
fn counts_and_ledgers() {
    let (_, findings) = verdicts(
        report(&[(1, 1)], 0),
        "missed=5,missed=4,overruns=2,watchdog=0,late.kernel=3,late.kernel=2,unexplained=25%,unexplained=24%,telegrams.lost=3,\
         telegrams.lost=2,telegrams.wrong=1,telegrams.wrong=0,telegrams.doubled=0,cell.DB20.WRONG=0,cell.NO=0",
    );
    let kept: Vec<&str> = findings.iter().map(|(verdict, _)| verdict.text()).collect();
    assert_eq!(
        kept,
        [
            "pass",
            "broken",
            "pass",
            "pass",
            "pass",
            "broken",
            "pass",
            "broken",
            "pass",
            "broken",
            "pass",
            "broken",
            "inconclusive",
            "broken",
            "inconclusive"
        ]
    );
}

#[test]
fn the_end_is_judged_too() {
    for (ended, verdict) in [
        (Ended::Time, Verdict::Pass),
        (Ended::Interrupted, Verdict::Inconclusive),
        (Ended::CpuStopped, Verdict::Broken),
        (Ended::ProcessGone, Verdict::Broken),
    ] {
        let ended = Report { ended, ..report(&[(1, 1)], 0) };
        assert_eq!(verdicts(ended, "missed=5").0, verdict);
    }
    let reset = Report { reset_outside: true, ..report(&[(1, 1)], 0) };
    assert_eq!(verdicts(reset, "missed=5").0, Verdict::Inconclusive);
}

#[test]
fn what_the_time_cannot_show_is_known_before() {
    let told = |budget: &str, minutes: u64, cycle: Span| {
        too_short(&budget.parse().expect(budget), Span::from_secs(60 * minutes), cycle)
    };
    let ms = Span::MILLISECOND;
    // 100,000 scans of 1 ms are 100 s, of 10 ms 1,000 s.
    assert_eq!(told("wake.p99.99=1ms", 2, ms), None);
    let said = told("wake.p99.99=1ms", 2, ms.times(10)).expect("too short");
    assert!(said.contains("100000 scans") && said.contains("wake.p99.99=1ms"), "{said}");
    assert!(told("rss.slope=1MiB/h", 9, ms).is_some_and(|said| said.contains("10 min")));
    assert_eq!(told("rss.slope=1MiB/h", 10, ms), None);
    for budget in ["missed=0", "cycle.max=1s", "ob35.p99.99=1ms"] {
        assert_eq!(told(budget, 0, ms), None, "{budget}");
    }
}
