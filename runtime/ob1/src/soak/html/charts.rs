//! Which charts a page has.

use std::collections::BTreeMap;

use super::super::budget::{Budget, What};
use super::super::report::{Interval, Report};
use super::chart::{Axis, Chart};
use crate::statistics::quantile;
use crate::units::{amount, time};
use ob1_timing::snapshot::Spread;

/// Bars to a decade.
const FINE: f64 = 20.0;
/// Distributions that are drawn.
const DRAWN: [(&str, &str); 3] = [
    ("wake", "Wake-up: from the deadline of a cycle to its start"),
    ("execution", "Execution: from the start of a cycle to its end"),
    ("cycle", "Cycle: from the start of a cycle to the start of the next"),
];

/// The histograms, with the limits of the budget, and all of them by percentile.
pub(super) fn distributions(out: &mut String, r: &Report) {
    let budget: Vec<Budget> = r.findings.iter().filter_map(|finding| finding.budget.parse().ok()).collect();
    for (name, title) in DRAWN {
        let Some(spread) = r.distribution(name) else { continue };
        *out += &format!("<h3>{title}</h3>\n");
        *out += &histogram(title, name, spread, &budget);
    }
    let curves: Vec<(&str, Vec<(f64, f64)>)> =
        DRAWN.iter().filter_map(|(name, _)| Some((*name, curve(r.distribution(name)?)))).collect();
    let points = || curves.iter().flat_map(|(_, points)| points);
    if points().next().is_none() {
        return;
    }
    let title = "By percentile";
    let mut chart = Chart::new(
        title,
        Axis::linear(points().map(|(x, _)| *x)),
        Axis::decades(points().map(|(_, y)| *y)),
        nines,
        time,
    );
    for (name, points) in &curves {
        chart.line(name, points);
    }
    *out += &format!("<h3>{title}</h3>\n{}", chart.finish());
}

fn histogram(title: &str, name: &str, spread: &Spread, budget: &[Budget]) -> String {
    let mut bars: BTreeMap<i64, u64> = BTreeMap::new();
    for (value, count) in &spread.buckets {
        *bars.entry((((*value).max(1) as f64).log10() * FINE).floor() as i64).or_default() += count;
    }
    let edge = |bar: i64| 10f64.powf(bar as f64 / FINE);
    let x = Axis::decades(spread.buckets.iter().map(|(value, _)| *value as f64));
    let y = Axis::counts(bars.values().copied());
    let mut chart = Chart::new(title, x, y, time, |count| format!("{count:.0}"));
    for (bar, count) in &bars {
        let (from, to) = (edge(*bar), edge(bar + 1));
        chart.bar(from, to, *count as f64, &format!("{} to {}: {count}", time(from), time(to)));
    }
    for limit in budget {
        let (What::Percentile(of, _) | What::Max(of) | What::Mean(of)) = &limit.what else { continue };
        if of == name {
            chart.limit(limit.limit, &limit.text);
        }
    }
    chart.finish()
}

/// A distribution by percentile: how many nines, and the value; as far as ten values lie beyond.
fn curve(spread: &Spread) -> Vec<(f64, f64)> {
    let furthest = (spread.count as f64 / 10.0).log10();
    let steps = (furthest * 20.0).floor().max(0.0) as u32;
    (0..=steps)
        .map(|step| {
            let x = f64::from(step) / 20.0;
            (x, quantile(&spread.buckets, 1.0 - 10f64.powf(-x)).max(1) as f64)
        })
        .collect()
}

/// `90 %`, `99 %`, `99.9 %`.
fn nines(count: f64) -> String {
    let whole = count.round();
    if (whole - count).abs() > 1e-6 {
        return String::new();
    }
    match whole as u32 {
        0 => "0 %".into(),
        1 => "90 %".into(),
        2 => "99 %".into(),
        more => format!("99.{} %", "9".repeat(more as usize - 2)),
    }
}

/// What a line shows of an interval.
type Value = fn(&Interval) -> u64;

/// The charts of the time series; a word instead if there is none.
pub(super) fn over_time(out: &mut String, r: &Report) {
    if r.intervals.is_empty() {
        *out += "<p>No interval has ended.</p>\n";
        return;
    }
    let times: [(&str, [(&str, Value); 3]); 3] = [
        ("Wake-up", [("max", |i| i.wake.max_ns), ("p99", |i| i.wake.p99_ns), ("p50", |i| i.wake.p50_ns)]),
        (
            "Execution",
            [("max", |i| i.execution.max_ns), ("p99", |i| i.execution.p99_ns), ("p50", |i| i.execution.p50_ns)],
        ),
        ("Cycle", [("max", |i| i.cycle.max_ns), ("p99", |i| i.cycle.p99_ns), ("p50", |i| i.cycle.p50_ns)]),
    ];
    for (title, lines) in times {
        let all = || lines.iter().flat_map(|(_, value)| r.intervals.iter().map(|i| value(i).max(1) as f64));
        chart(out, title, r, Axis::decades(all()), time, &lines);
    }
    let counted: [(&str, Value); 2] = [("late scans", |i| i.late), ("missed deadlines", |i| i.missed)];
    let all = || counted.iter().flat_map(|(_, value)| r.intervals.iter().map(|i| value(i) as f64));
    chart(out, "Late scans and missed deadlines", r, Axis::linear(all()), |n| format!("{n:.0}"), &counted);
    let memory: [(&str, Value); 1] = [("station", |i| i.rss_bytes)];
    let all = || r.intervals.iter().map(|i| i.rss_bytes as f64);
    chart(out, "Resident memory", r, Axis::around(all()), |bytes| amount("rss", false, bytes), &memory);
    if !r.telegrams.is_empty() {
        let done: [(&str, Value); 1] = [("telegrams done", |i| i.done)];
        let all = || r.intervals.iter().map(|i| i.done as f64);
        chart(out, "Telegrams done", r, Axis::linear(all()), |n| format!("{n:.0}"), &done);
    }
}

fn chart(out: &mut String, title: &str, r: &Report, y: Axis, of_y: impl Fn(f64) -> String, lines: &[(&str, Value)]) {
    let (unit, name) = match r.measured_ns as f64 {
        all if all < 180e9 => (1e9, "s"),
        all if all < 3.0 * 3600e9 => (60e9, "min"),
        _ => (3600e9, "h"),
    };
    let at = |i: &Interval| i.end_ns as f64 / unit;
    let x = Axis::linear(r.intervals.iter().map(at));
    let mut chart = Chart::new(title, x, y, |value| format!("{} {name}", (value * 100.0).round() / 100.0), of_y);
    for (name, value) in lines {
        let points: Vec<(f64, f64)> = r.intervals.iter().map(|i| (at(i), value(i) as f64)).collect();
        chart.line(name, &points);
    }
    *out += &format!("<h3>{title}, each interval of {}</h3>\n{}", time(r.interval_ns as f64), chart.finish());
}
