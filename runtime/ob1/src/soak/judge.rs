//! From a report to its verdict. Pure.

use super::budget::{Budget, Counted, SERIES, What};
use super::report::{CpLedger, NamedSlope, Report, Role};
use super::verdict::{Ended, Finding, Verdict};
use crate::statistics::Percentile;
use crate::statistics::{BEYOND, SLOPE_HOURS, SLOPE_NEEDS, beyond, hourly, needed, percentile, quantile};
use crate::units::{amount, time};
use ob1_station::access::protocol::Diagnostic;
use ob1_time::Span;
use ob1_timing::Class;

/// Judges a report against its budget, and by how the soak ended.
pub(super) fn judge(report: &mut Report, budget: &[Budget]) {
    report.slopes = slopes(report);
    let mut findings: Vec<Finding> = vec![stays_in_run(report)];
    findings.extend(report.reset_outside.then(|| Finding {
        budget: "accounts of all scans".into(),
        measured: "of a part".into(),
        verdict: Verdict::Inconclusive,
        why: "somebody else has reset the statistics of the station meanwhile".into(),
    }));
    findings.extend(budget.iter().map(|budget| finding(report, budget)));
    report.verdict = findings.iter().map(|f| f.verdict).max().unwrap_or(Verdict::Inconclusive);
    report.findings = findings;
}

fn slopes(report: &Report) -> Vec<NamedSlope> {
    let of = |(name, is_time): &(&str, bool)| NamedSlope {
        series: (*name).to_owned(),
        is_time: *is_time,
        slope: hourly(&report.series(name)),
    };
    SERIES.iter().map(of).collect()
}

/// What every soak has to keep.
pub(super) fn stays_in_run(report: &Report) -> Finding {
    let seconds = report.measured_ns as f64 / 1e9;
    let (verdict, why) = match report.ended {
        Ended::Time => (Verdict::Pass, String::new()),
        Ended::Interrupted | Ended::UnderWay => (
            Verdict::Inconclusive,
            format!("{:.1} s of {:.1} s have been seen", seconds, report.wanted_ns as f64 / 1e9),
        ),
        Ended::CpuStopped | Ended::ProcessGone => {
            let newest = report.diagnostics.first().map_or_else(String::new, Diagnostic::told);
            (Verdict::Broken, if report.end.is_empty() { newest } else { report.end.clone() })
        }
    };
    let measured = format!("{seconds:.1} s, {}", report.ended.text());
    Finding { budget: "stays in RUN".into(), measured, verdict, why }
}

pub(super) fn finding(report: &Report, budget: &Budget) -> Finding {
    let (measured, verdict, why) = match &budget.what {
        What::Percentile(name, share) => of_percentile(report, name, *share, budget.limit),
        What::Max(name) => of_value(report, name, budget.limit, |spread| spread.max_ns as f64),
        What::Mean(name) => of_value(report, name, budget.limit, |spread| spread.mean_ns),
        What::Count(counted) => of_count(report, *counted, budget.limit),
        What::Cell(name) => match report.cells.iter().find(|cell| cell.name == *name) {
            Some(cell) => {
                let grown = cell.grown();
                (format!("{grown}"), kept(grown <= budget.limit), format!("from {} to {}", cell.first, cell.last))
            }
            None => unseen("the cell was not read"),
        },
        What::Unexplained => of_share(report, budget.limit),
        What::Slope(series) => of_slope(report, series, budget.limit),
    };
    Finding { budget: budget.text.clone(), measured, verdict, why }
}

type Judged = (String, Verdict, String);

fn kept(kept: bool) -> Verdict {
    if kept { Verdict::Pass } else { Verdict::Broken }
}

fn unseen(why: &str) -> Judged {
    ("nothing".into(), Verdict::Inconclusive, why.into())
}

/// Broken when at least ten values, and more than the percentile allows, lie beyond the limit; kept when enough values
/// have been seen.
fn of_percentile(report: &Report, name: &str, share: f64, limit: f64) -> Judged {
    let Some(spread) = report.distribution(name) else { return unseen("no value of it has been seen") };
    let buckets = &spread.buckets;
    let over = beyond(buckets, limit as u64);
    let allowed = spread.count as f64 * (1.0 - share);
    let measured = match percentile(buckets, share) {
        Percentile::Known(value) => time(value as f64),
        Percentile::Needs(n) => format!("needs {n} values"),
    };
    if over >= BEYOND && over as f64 > allowed {
        let measured = if spread.count < needed(share) { time(quantile(buckets, share) as f64) } else { measured };
        let why = format!("{over} of {} values are greater, {allowed:.0} may be; {}", spread.count, causes(report));
        return (measured, Verdict::Broken, why);
    }
    if spread.count < needed(share) {
        let why = format!("{} values have been seen, {over} of them greater than the limit", spread.count);
        return (measured, Verdict::Inconclusive, why);
    }
    // Between the sure pass and the sure break: the percentile lies beyond, by fewer than ten values. With enough
    // values this does not happen.
    (measured, kept(over as f64 <= allowed.max(BEYOND as f64)), String::new())
}

fn of_value(report: &Report, name: &str, limit: f64, value: impl Fn(&ob1_timing::snapshot::Spread) -> f64) -> Judged {
    let Some(spread) = report.distribution(name) else { return unseen("no value of it has been seen") };
    let value = value(spread);
    let good = value <= limit;
    (time(value), kept(good), if good { String::new() } else { causes(report) })
}

/// The figure that a budget limits, as a number; none where it was not seen.
pub(super) fn figure(report: &Report, what: &What) -> Option<f64> {
    let spread = |name: &str| report.distribution(name);
    Some(match what {
        What::Percentile(name, share) => quantile(&spread(name)?.buckets, *share) as f64,
        What::Max(name) => spread(name)?.max_ns as f64,
        What::Mean(name) => spread(name)?.mean_ns,
        What::Count(counted) => how_many(report, *counted)? as f64,
        What::Cell(name) => report.cells.iter().find(|cell| cell.name == *name)?.grown(),
        What::Unexplained => report.timing.as_ref()?.late.unexplained_share,
        What::Slope(series) => report.slopes.iter().find(|known| known.series == *series)?.slope?.per_unit,
    })
}

/// How often it was counted; none where nobody has counted it.
fn how_many(report: &Report, counted: Counted) -> Option<u64> {
    let timing = report.timing.as_ref()?;
    let of_all = |field: fn(&CpLedger) -> u64| report.telegrams.iter().map(field).sum::<u64>();
    let of_cell =
        |role: Role| report.cells.iter().find(|cell| cell.role == role).map(|cell| cell.grown().max(0.0) as u64);
    Some(match counted {
        Counted::TelegramsDoubled => of_cell(Role::Doubled)?,
        Counted::TelegramsWrong => of_cell(Role::Wrong)?,
        Counted::Missed => timing.missed,
        Counted::Overruns => timing.overruns,
        Counted::Watchdog => timing.watchdogs,
        Counted::Late(None) => timing.late.scans,
        Counted::Late(Some(class)) => timing.late.classes.get(&class).map_or(0, |total| total.scans),
        Counted::TelegramsLost => of_all(|cp| cp.lost),
        Counted::TelegramErrors => of_all(|cp| cp.error),
        Counted::TelegramsAborted => of_all(|cp| cp.aborted),
        Counted::ReceiveLost => of_all(|cp| cp.receive_lost),
        Counted::ReceiveErrors => of_all(|cp| cp.receive_errors),
        Counted::DriversLost => of_all(|cp| cp.drivers_lost),
    })
}

fn of_count(report: &Report, counted: Counted, limit: f64) -> Judged {
    if report.timing.is_none() {
        return unseen("nothing has been read");
    }
    let Some(n) = how_many(report, counted) else {
        return unseen("only the program knows this: name its counter with --doubled or --wrong");
    };
    let good = n as f64 <= limit;
    let of_timing = matches!(counted, Counted::Missed | Counted::Overruns | Counted::Watchdog | Counted::Late(_));
    (n.to_string(), kept(good), if good || !of_timing { String::new() } else { causes(report) })
}

fn of_share(report: &Report, limit: f64) -> Judged {
    let Some(timing) = &report.timing else { return unseen("nothing has been read") };
    let unexplained = timing.late.classes.get(&Class::Unexplained).map_or(0, |total| total.scans);
    let share = timing.late.unexplained_share;
    let measured = format!("{:.1} % ({unexplained} of {})", share * 100.0, timing.late.scans);
    (measured, kept(share <= limit), String::new())
}

/// Broken when even the lower bound of the slope is beyond the limit, kept when even the upper one is within it.
fn of_slope(report: &Report, series: &str, limit: f64) -> Judged {
    let found = report.slopes.iter().find(|known| known.series == series);
    let Some((known, slope)) = found.and_then(|known| Some((known, known.slope?))) else {
        let seen = report.intervals.last().map_or(0, |interval| interval.end_ns);
        let why = format!("{} intervals in {} have been seen", report.intervals.len(), time(seen as f64));
        return (SLOPE_NEEDS.into(), Verdict::Inconclusive, why);
    };
    let show = |value: f64| amount(&known.series, known.is_time, value);
    let measured = format!("{}/h [{} .. {}]", show(slope.per_unit), show(slope.low), show(slope.high));
    let verdict = if slope.low > limit {
        Verdict::Broken
    } else if slope.high <= limit {
        Verdict::Pass
    } else {
        Verdict::Inconclusive
    };
    let why = if verdict == Verdict::Inconclusive { "the limit lies within the interval: run longer" } else { "" };
    (measured, verdict, why.into())
}

/// What this time at this cycle cannot show of a budget, whatever happens; `None`: it can.
pub(super) fn too_short(budget: &Budget, lasts: Span, cycle: Span) -> Option<String> {
    let (needs, what) = match &budget.what {
        // One value a scan; of others it is not known how many there will be.
        What::Percentile(name, share) if PER_SCAN.contains(&name.as_str()) => {
            let values = needed(*share);
            (cycle.times(values), format!("{values} scans"))
        }
        What::Slope(_) => (Span::from_nanos((SLOPE_HOURS * 3.6e12) as u64), "intervals over 10 min".to_owned()),
        _ => return None,
    };
    (lasts < needs).then(|| {
        let needs = time(needs.nanos() as f64);
        format!(
            "{}: it needs {what}, {needs} at this cycle: this soak cannot show it\n  = let it run longer",
            budget.text
        )
    })
}

/// Distributions with a value in each scan.
const PER_SCAN: [&str; 6] = ["cycle", "wake", "deadlines", "execution", "inputs", "outputs"];

/// The classes of late scans, the most expensive one first.
fn causes(report: &Report) -> String {
    let Some(timing) = &report.timing else { return String::new() };
    let mut classes: Vec<_> = timing.late.classes.iter().collect();
    classes.sort_by_key(|(_, total)| std::cmp::Reverse(total.time_ns));
    if classes.is_empty() {
        return "no scan counts as late (see [timing] late and long)".into();
    }
    let mut told = Vec::new();
    for (class, total) in classes.into_iter().take(3) {
        let worst = timing.late.worst.iter().find(|entry| entry.class == *class);
        let what = worst.map_or_else(String::new, |entry| format!(", longest: {}", entry.what));
        told.push(format!("{} {} times, {} together{what}", class.name(), total.scans, time(total.time_ns as f64)));
    }
    format!("late by {}", told.join("; "))
}

#[cfg(test)]
mod tests;
