//! A soak in words: the table at its end, the lines while it runs.

use std::fmt::Write as _;

use super::report::{Beside, CpLedger, Machine, Report, Role};
use crate::statistics::{OUTLIER, Percentile, SLOPE_NEEDS};
use ob1_station::posture;
use ob1_timing::{self, Timing};

use crate::units::{amount, time};

/// The report as a table.
pub fn report(r: &Report) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "soak of {}: {} of {} measured, {}",
        r.station,
        time(r.measured_ns as f64),
        time(r.wanted_ns as f64),
        r.ended.text()
    );
    if let Some(load) = &r.load {
        let _ = writeln!(out, "under load {} (seed {}): {}", load.spec, load.seed, load.done());
    }
    distributions(&mut out, r);
    if r.machines.is_empty() {
        slopes(&mut out, r);
    } else {
        machines(&mut out, r);
    }
    scans(&mut out, r);
    telegrams(&mut out, r);
    out += &posture::text(&r.posture);
    let _ = writeln!(out, "\nverdict");
    let width = r.findings.iter().map(|f| f.budget.chars().count()).max().unwrap_or(0);
    for f in &r.findings {
        let _ = writeln!(out, "  {:<12} {:<width$}   {}", f.verdict.text(), f.budget, f.measured);
        if !f.why.is_empty() {
            let _ = writeln!(out, "               {}", f.why);
        }
    }
    let _ = writeln!(out, "{}", r.verdict.line());
    out
}

fn distributions(out: &mut String, r: &Report) {
    let _ = write!(out, "\n{:<14}{:>10}", "", "count");
    for name in r.percentiles.first().map_or(&[][..], |p| &p.values[..]) {
        let _ = write!(out, "{:>11}", name.0);
    }
    let _ = writeln!(out, "{:>11}", "max");
    for row in &r.percentiles {
        let _ = write!(out, "{:<14}{:>10}", row.name, row.count);
        for (_, value) in &row.values {
            let shown = match value {
                Percentile::Known(value) => time(*value as f64),
                Percentile::Needs(_) => "-".into(),
            };
            let _ = write!(out, "{shown:>11}");
        }
        let _ = writeln!(out, "{:>11}", time(row.max_ns as f64));
    }
    let cycle = r.percentiles.iter().find(|row| row.name == "cycle");
    let open = cycle.into_iter().flat_map(|row| &row.values).filter_map(|(name, value)| match value {
        Percentile::Needs(n) => Some(format!("{name} needs {n} scans")),
        Percentile::Known(_) => None,
    });
    let open: Vec<String> = open.collect();
    if !open.is_empty() {
        let _ = writeln!(out, "  - : less than 10 values would lie beyond it; {}", open.join(", "));
    }
}

/// The machines of a merged report, the slowest to wake first.
fn machines(out: &mut String, r: &Report) {
    let wake = |machine: &Machine| machine.beside.iter().find(|beside| beside.series == "wake.p99").cloned();
    let mut rows: Vec<(&Machine, Option<Beside>)> = r.machines.iter().map(|machine| (machine, wake(machine))).collect();
    let median = |beside: &Option<Beside>| beside.as_ref().map_or(0.0, |beside| beside.median_ns);
    rows.sort_by(|a, b| median(&b.1).total_cmp(&median(&a.1)));
    let width = r.machines.iter().map(|machine| machine.name.chars().count()).max().unwrap_or(0).max(7);
    let _ = writeln!(
        out,
        "\n{:<width$}  {:>9}{:>7}{:>7}{:>12}{:>14}{:>28}{:>8}{:>16}  alone",
        "machine", "scans", "late", "missed", "wake.p99", "beside middle", "95 % interval", "score", "rss an hour"
    );
    for (machine, wake) in rows {
        let shift = wake.as_ref().and_then(|beside| beside.shift);
        let of_shift = shift.map(|s| (time(s.shift), format!("[{} .. {}]", time(s.low), time(s.high))));
        let (by, within) = of_shift.unwrap_or_default();
        let score = wake.as_ref().and_then(|beside| beside.score).map_or(String::new(), |score| format!("{score:.1}"));
        let rss = machine.slopes.iter().find(|slope| slope.series == "rss").and_then(|rss| rss.slope);
        let rss = rss.map_or_else(|| "-".into(), |slope| amount("rss", false, slope.per_unit));
        let _ = writeln!(
            out,
            "{:<width$}  {:>9}{:>7}{:>7}{:>12}{by:>14}{within:>28}{score:>8}{rss:>16}  {}",
            machine.name,
            machine.scans,
            machine.late,
            machine.missed,
            time(median(&wake)),
            machine.verdict.text()
        );
    }
    let _ = writeln!(
        out,
        "  wake.p99: median of the intervals; beside middle: Hodges and Lehmann; score: modified z, an outlier beyond {OUTLIER}"
    );
}

fn slopes(out: &mut String, r: &Report) {
    let (count, length) = (r.intervals.len(), time(r.interval_ns as f64));
    let _ =
        writeln!(out, "\ngrowth an hour, from {count} intervals of {length} (Theil-Sen slope, 95 % interval of Sen)");
    for s in &r.slopes {
        let Some(slope) = s.slope else {
            let _ = writeln!(out, "  {:<14} {SLOPE_NEEDS}", s.series);
            continue;
        };
        let show = |value| amount(&s.series, s.is_time, value);
        let (low, high) = (show(slope.low), show(slope.high));
        let _ = writeln!(out, "  {:<14}{:>12}   [{low} .. {high}]", s.series, show(slope.per_unit));
    }
}

fn scans(out: &mut String, r: &Report) {
    let Some(t) = &r.timing else { return };
    let _ = writeln!(
        out,
        "\nscans {}   overruns {}   missed deadlines {} (rule: {})   watchdog {}",
        t.scans, t.overruns, t.missed, t.missed_rule, t.watchdogs
    );
    *out += &ob1_timing::text::late(&t.late);
}

fn telegrams(out: &mut String, r: &Report) {
    for cp in &r.telegrams {
        let _ = writeln!(
            out,
            "\n{}: orders {} = done {}, error {}, aborted {}, lost in CP {}, open {}\n  received {} = delivered {}, lost in CP or dropped {}, \
             open {}; failed attempts of the partner {}; drivers lost {}",
            cp.cp,
            cp.accepted,
            cp.done,
            cp.error,
            cp.aborted,
            cp.lost,
            cp.open(),
            cp.received,
            cp.delivered,
            cp.receive_lost,
            cp.received.saturating_sub(cp.delivered + cp.receive_lost),
            cp.receive_errors,
            cp.drivers_lost
        );
    }
    if !r.telegrams.is_empty() && r.cells.iter().all(|cell| cell.role == Role::Own) {
        let _ = writeln!(
            out,
            "  only the program can count doubled and wrong telegrams: name its counters with --doubled and --wrong"
        );
    }
    for cell in &r.cells {
        let role = match cell.role {
            Role::Own => "",
            Role::Doubled => "telegrams doubled: ",
            Role::Wrong => "telegrams wrong: ",
        };
        let _ = writeln!(out, "  {role}{}: {} (from {} to {})", cell.name, cell.grown(), cell.first, cell.last);
    }
}

/// The line while it runs.
pub(super) fn live(wanted_ns: u64, elapsed_ns: u64, t: &Timing, cps: &[CpLedger]) -> String {
    let left = time(wanted_ns.saturating_sub(elapsed_ns) as f64);
    let done = (elapsed_ns as f64 / wanted_ns.max(1) as f64).min(1.0);
    let bar = "#".repeat((done * 20.0) as usize);
    let mut text = format!(
        "[{bar:<20}] {:>3.0} %, {left} left   {} scans, late {}, missed {}   wake p99 {}   execution p99 {}",
        done * 100.0,
        t.scans,
        t.late.scans,
        t.missed,
        time(t.wake.p99_ns as f64),
        time(t.execution.p99_ns as f64)
    );
    if !cps.is_empty() {
        let (sent, lost) = cps.iter().fold((0, 0), |(sent, lost), cp| (sent + cp.done, lost + cp.lost));
        let _ = write!(text, "   telegrams {sent}, lost {lost}");
    }
    text
}
