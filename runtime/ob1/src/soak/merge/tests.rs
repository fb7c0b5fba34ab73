//! Merged reports against the report of all samples, and machines that are not like the others.

use ob1_cpu::Histogram;
use ob1_time::Span;
use ob1_timing::Timing;
use proptest::prelude::*;
use serde_json::json;

use super::*;
use crate::soak::report::{Brief, CpLedger, Interval};
use crate::soak::verdict::Ended;

/// The report on these wake-up times, in nanoseconds, as a station accounts for them.
fn report(host: &str, wake: &[u64]) -> Report {
    let spread = |values: &[u64]| {
        let histogram = Histogram::of(values.iter().map(|value| (Span::from_nanos(*value), 1)));
        let at = |share| histogram.quantile(share).nanos();
        let buckets: Vec<(u64, u64)> = histogram.buckets().map(|(time, count)| (time.nanos(), count)).collect();
        json!({"count": histogram.count(), "min_ns": histogram.min().nanos(), "mean_ns": histogram.mean(), "p50_ns": at(0.5),
            "p90_ns": at(0.9), "p99_ns": at(0.99), "p999_ns": at(0.999), "p9999_ns": at(0.9999),
            "max_ns": histogram.max().nanos(), "buckets": buckets})
    };
    let late = wake.iter().filter(|value| **value > 1_000_000).count();
    let classes =
        if late == 0 { json!({}) } else { json!({"kernel": {"scans": late, "time_ns": late, "worst_ns": 1}}) };
    let (of_all, none) = (spread(wake), spread(&[]));
    let timing: Timing = serde_json::from_value(json!({"schema": 2, "time_ns": 0, "since_ns": 0, "min_cycle_ns": 1_000_000,
        "missed_rule": "skip", "late_from_ns": 1_000_000, "long_from_ns": 0, "scans": wake.len(), "statements": 3 * wake.len(),
        "overruns": late, "missed": late / 2 * 2, "watchdogs": 0, "cycle": none, "wake": of_all, "deadlines": none,
        "execution": none, "inputs": none, "outputs": none,
        "obs": [{"ob": 1, "priority": 1, "runs": wake.len(), "overruns": 0, "execution": of_all, "lateness": none}],
        "blocks": [{"block": "FC 0", "name": "SEND", "execution": of_all}],
        "late": {"scans": late, "pending": 0, "lost": 0, "unexplained_share": 0.0, "classes": classes, "worst": [], "newest": []}}))
    .expect("accounts");
    Report {
        schema: 1,
        station: "press".into(),
        host: host.into(),
        ended: Ended::Time,
        percentiles: percentiles(&timing),
        telegrams: vec![CpLedger { cp: "cp".into(), done: wake.len() as u64, ..CpLedger::default() }],
        timing: Some(timing),
        ..Report::default()
    }
}

/// A machine whose intervals have this wake-up, by a little pattern, and whose memory grows by so much each minute.
fn machine(host: &str, wake: u64, growth: u64) -> Report {
    let interval = |minute: u64| Interval {
        end_ns: minute * 60_000_000_000,
        rss_bytes: 10_000_000 + growth * minute,
        wake: Brief { p50_ns: 5_000 + minute % 3, p99_ns: wake + minute * 7 % 11, max_ns: wake * 2 },
        ..Interval::default()
    };
    Report { intervals: (1..=20).map(interval).collect(), ..report(host, &[wake; 2_000]) }
}

fn paths(reports: Vec<Report>) -> Vec<(&'static Path, Report)> {
    reports.into_iter().map(|report| (Path::new("x.json"), report)).collect()
}

fn budget(text: &str) -> Vec<Budget> {
    text.split(',').map(|text| text.parse().expect(text)).collect()
}

/// The finding of a limit.
fn found<'a>(merged: &'a Report, limit: &str) -> &'a Finding {
    merged.findings.iter().find(|found| found.budget == limit).expect(limit)
}

/// From a nanosecond to beyond the longest time with a bucket of its own.
fn times() -> impl Strategy<Value = Vec<u64>> {
    prop::collection::vec((0_u64..64_000_000_000).prop_flat_map(|most| 0..=most >> (most % 36)), 1..400)
}

proptest! {
    /// The merge of reports is the report of the merged samples: buckets, percentiles, counts and what is judged of
    /// them. Only the mean is rounded in another order.
    #[test]
    fn merged_reports_are_the_report_of_the_merged_samples(machines in prop::collection::vec(times(), 1..6)) {
        let limits = budget("wake.p99=1ms,wake.p90=100us,wake.max=2s,wake.mean=1ms,fc0.p50=10us,missed=3,late=4");
        let reports = machines.iter().enumerate().map(|(index, wake)| report(&format!("h{index}"), wake)).collect();
        let all = merged(&paths(reports), &limits, 0.1).expect("they belong together");
        let mut whole = report("", &machines.concat());
        judge(&mut whole, &limits);

        let strip = |report: &Report| {
            let mut timing = report.timing.clone().expect("there are accounts");
            let means = [&mut timing.wake, &mut timing.obs[0].execution, &mut timing.blocks[0].execution]
                .map(|spread| std::mem::take(&mut spread.mean_ns));
            // Of each machine alone an even number was missed.
            timing.missed = 0;
            timing.late.classes.clear();
            (timing, means)
        };
        let ((ours, our_means), (theirs, their_means)) = (strip(&all), strip(&whole));
        prop_assert_eq!(ours, theirs);
        for (a, b) in our_means.iter().zip(their_means) {
            prop_assert!((a - b).abs() <= b * 1e-12, "{} {}", a, b);
        }
        prop_assert_eq!(&all.percentiles, &whole.percentiles);
        prop_assert_eq!(&all.telegrams, &whole.telegrams);
        for limit in limits.iter().filter(|limit| limit.text != "missed=3") {
            let (ours, theirs) = (found(&all, &limit.text), found(&whole, &limit.text));
            prop_assert_eq!((&ours.measured, ours.verdict), (&theirs.measured, theirs.verdict), "{}", limit);
        }
    }
}

#[test]
fn one_slow_machine_among_many_is_named_and_spoils_the_verdict() {
    let of = |slow: u64| -> Vec<Report> {
        (0..8).map(|n| machine(&format!("rack{n}"), if n == 5 { slow } else { 20_000 + n * 100 }, 0)).collect()
    };
    let good = merged(&paths(of(20_500)), &budget("wake.p99=50us,missed=0"), 0.1).expect("alike");
    assert_eq!(good.verdict, Verdict::Pass, "{:#?}", good.findings);
    // An eighth of all scans is beyond the 99th percentile; of one machine alone it is all of them.
    let bad = merged(&paths(of(80_000)), &budget("wake.p50=50us"), 0.1).expect("alike");
    assert_eq!(found(&bad, "wake.p50=50us").verdict, Verdict::Pass);
    assert_eq!(found(&bad, "wake.p50=50us").why, "worst: rack5");
    let alone = found(&bad, "each machine alone");
    assert_eq!((alone.verdict, alone.measured.as_str()), (Verdict::Broken, "7 of 8 break no limit"));
    assert!(alone.why.starts_with("worst: rack5: wake.p50=50us: "), "{}", alone.why);
    // Slower than all others, and still within the limits: the figures of all are not its own.
    let odd = merged(&paths(of(40_000)), &budget("wake.p99=50us"), 0.1).expect("alike");
    assert_eq!(odd.verdict, Verdict::Inconclusive);
    assert!(found(&odd, "machines alike").why.starts_with("rack5 wake.p99 40.0 µs against "), "{:#?}", odd.findings);
    let shift = odd.machines[5].beside.iter().find(|beside| beside.series == "wake.p99").and_then(|b| b.shift);
    assert!(shift.is_some_and(|shift| shift.low > 19_000.0 && shift.p < 0.001), "{shift:?}");
    let text = crate::soak::text::report(&odd);
    let first = text.lines().skip_while(|line| !line.starts_with("machine ")).nth(1).expect("a table");
    assert!(first.starts_with("rack5 "), "the slowest first: {first}");
}

#[test]
fn the_trend_of_the_worst_machine_counts() {
    let reports = (0..3).map(|n| machine(&format!("rack{n}"), 20_000, if n == 1 { 65_536 } else { 0 })).collect();
    let leak = merged(&paths(reports), &budget("rss.slope=1MiB/h"), 0.1).expect("alike");
    let slope = found(&leak, "rss.slope=1MiB/h");
    assert_eq!((slope.verdict, slope.why.as_str()), (Verdict::Broken, "worst: rack1"), "{slope:?}");
    assert_eq!(leak.verdict, Verdict::Broken);
}

#[test]
fn what_cannot_be_one_report_is_refused_and_what_broke_off_is_no_pass() {
    let one = || report("a", &[1_000; 2_000]);
    let refused = |reports: Vec<Report>| merged(&paths(reports), &[], 0.1).expect_err("refused");
    assert!(refused(vec![one(), one()]).contains("is the same soak"));
    let mut other = report("b", &[1_000; 3]);
    other.timing.as_mut().expect("there").min_cycle_ns = 5;
    assert!(refused(vec![one(), other]).contains("another interval"));
    assert!(refused(vec![one(), Report { timing: None, ..report("b", &[1]) }]).contains("nothing has been measured"));
    let two = merged(&paths(vec![one(), report("b", &[1_000; 9])]), &[], 0.1).expect("two machines");
    assert!(refused(vec![two]).contains("merged already"));
    let cut = Report { ended: Ended::UnderWay, ..report("b", &[1_000; 9]) };
    let cut = merged(&paths(vec![one(), cut]), &[], 0.1).expect("two machines");
    assert_eq!(
        (cut.verdict, &*cut.findings[0].why),
        (Verdict::Inconclusive, "worst: b: 0.0 s of 0.0 s have been seen")
    );
    // The limits are those the reports were judged by.
    let mut judged = one();
    judge(&mut judged, &budget("wake.max=1us"));
    let again = merged(&paths(vec![judged, report("b", &[2_000; 9])]), &[], 0.1).expect("two machines");
    assert_eq!(found(&again, "wake.max=1us").verdict, Verdict::Broken);
}
