//! The report as one page that needs nothing else: verdict, histograms, time series, the outliers and their causes.

mod chart;
mod charts;

use std::fmt::Write as _;

use super::report::{CpLedger, Report, Role};
use super::verdict::Verdict;
use crate::statistics::{Percentile, SLOPE_NEEDS};
use crate::units::{amount, time};

/// The report as the text of an HTML page.
pub fn page(r: &Report) -> String {
    let name = escape(&r.station);
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width,initial-scale=1\">\n<title>soak of {name}: {}</title>\n<style>{STYLE}</style></head><body><main>\n",
        r.verdict.text()
    );
    head(&mut out, r);
    findings(&mut out, r);
    out += "<h2>How long scans took</h2>\n";
    percentiles(&mut out, r);
    charts::distributions(&mut out, r);
    out += "<h2>Over time</h2>\n";
    charts::over_time(&mut out, r);
    slopes(&mut out, r);
    late(&mut out, r);
    telegrams(&mut out, r);
    posture(&mut out, r);
    diagnostics(&mut out, r);
    out += "</main></body></html>\n";
    out
}

const STYLE: &str = include_str!("style.css");

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A table: its head, and rows of cells. A cell that begins with a digit or a sign is a number.
fn table(out: &mut String, head: &[&str], rows: impl Iterator<Item = Vec<String>>) {
    let head: String = head.iter().map(|cell| format!("<th>{}</th>", escape(cell))).collect();
    let _ = writeln!(out, "<div class=\"wide\"><table><thead><tr>{head}</tr></thead><tbody>");
    for row in rows {
        let cells: String = row
            .iter()
            .map(|cell| {
                let number = cell.starts_with(|c: char| c.is_ascii_digit() || c == '-');
                format!("<td{}>{}</td>", if number { " class=\"n\"" } else { "" }, escape(cell))
            })
            .collect();
        let _ = writeln!(out, "<tr>{cells}</tr>");
    }
    *out += "</tbody></table></div>\n";
}

const fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::Inconclusive => "open",
        Verdict::Broken => "broken",
    }
}

fn head(out: &mut String, r: &Report) {
    let _ = writeln!(
        out,
        "<header><h1>Soak of {}</h1><p class=\"verdict {}\">{}</p></header>\n<p>{} of {} measured after {} of warm-up, {}. ob1 {}.</p>",
        escape(&r.station),
        class(r.verdict),
        r.verdict.line(),
        time(r.measured_ns as f64),
        time(r.wanted_ns as f64),
        time(r.warm_up_ns as f64),
        escape(r.ended.text()),
        escape(&r.version)
    );
    if let Some(load) = &r.load {
        let _ = writeln!(
            out,
            "<p>Under load <code>{}</code>, seed {}: {}.</p>",
            escape(&load.spec),
            load.seed,
            escape(&load.done())
        );
    }
}

fn findings(out: &mut String, r: &Report) {
    *out += "<table><thead><tr><th>verdict</th><th>limit</th><th>measured</th></tr></thead><tbody>\n";
    for f in &r.findings {
        let why = if f.why.is_empty() { String::new() } else { format!("<br><small>{}</small>", escape(&f.why)) };
        let _ = writeln!(
            out,
            "<tr><td class=\"{}\">{}</td><td><code>{}</code></td><td>{}{why}</td></tr>",
            class(f.verdict),
            f.verdict.text(),
            escape(&f.budget),
            escape(&f.measured)
        );
    }
    *out += "</tbody></table>\n";
}

fn percentiles(out: &mut String, r: &Report) {
    let names = r.percentiles.first().map_or(&[][..], |row| &row.values[..]);
    let head: Vec<&str> =
        ["", "count"].into_iter().chain(names.iter().map(|(name, _)| name.as_str())).chain(["max"]).collect();
    let value = |value: &Percentile| match value {
        Percentile::Known(nanos) => time(*nanos as f64),
        Percentile::Needs(n) => format!("needs {n}"),
    };
    let rows = r.percentiles.iter().map(|row| {
        let mut cells = vec![row.name.clone(), row.count.to_string()];
        cells.extend(row.values.iter().map(|(_, v)| value(v)));
        cells.push(time(row.max_ns as f64));
        cells
    });
    table(out, &head, rows);
    *out += "<p><small>A percentile is told when at least ten values lie beyond it. <em>deadlines</em> has a value for each missed \
             deadline too.</small></p>\n";
}

fn slopes(out: &mut String, r: &Report) {
    let rows = r.slopes.iter().map(|s| {
        let show = |value| amount(&s.series, s.is_time, value);
        let (slope, interval) = s.slope.map_or_else(
            || (SLOPE_NEEDS.to_owned(), String::new()),
            |slope| (show(slope.per_unit), format!("{} to {}", show(slope.low), show(slope.high))),
        );
        vec![s.series.clone(), slope, interval]
    });
    table(out, &["growth an hour", "slope", "95 % interval"], rows);
    *out += "<p><small>Theil and Sen's slope through the intervals, with Sen's interval.</small></p>\n";
}

fn late(out: &mut String, r: &Report) {
    let Some(t) = &r.timing else { return };
    let _ = writeln!(
        out,
        "<h2>Late scans</h2>\n<p>{} of {} scans: begun {} after their deadline or later, or taking {} or longer. Overruns {}, missed \
         deadlines {} (rule: {}), watchdog {}. Unexplained: {:.1} %.</p>",
        t.late.scans,
        t.scans,
        time(t.late_from_ns as f64),
        time(t.long_from_ns as f64),
        t.overruns,
        t.missed,
        escape(&t.missed_rule),
        t.watchdogs,
        t.late.unexplained_share * 100.0
    );
    let classes = t.late.classes.iter().map(|(class, total)| {
        let (all, worst) = (time(total.time_ns as f64), time(total.worst_ns as f64));
        vec![class.name().to_owned(), total.scans.to_string(), all, worst]
    });
    table(out, &["class", "scans", "together", "longest"], classes);
    let entries = t.late.worst.iter().map(|entry| {
        let at = entry.planned_ns.saturating_sub(t.since_ns);
        vec![
            entry.scan.to_string(),
            time(at as f64),
            time(entry.lateness_ns as f64),
            time(entry.execution_ns as f64),
            entry.class.name().to_owned(),
            entry.what.clone(),
            time(entry.size_ns as f64),
            evidence(&entry.evidence),
        ]
    });
    *out += "<h3>The longest delays</h3>\n";
    table(out, &["scan", "at", "began late", "took", "class", "what", "of it", "evidence"], entries);
}

fn evidence(e: &ob1_timing::Evidence) -> String {
    format!(
        "window {}: waited {}, steal {}, switches {}, faults {}+{}",
        time(e.window.nanos() as f64),
        time(e.measured.map_or(0, |measured| measured.waited.nanos()) as f64),
        time(e.steal.nanos() as f64),
        e.switches,
        e.minor_faults,
        e.major_faults
    )
}

fn telegrams(out: &mut String, r: &Report) {
    if r.telegrams.is_empty() && r.cells.is_empty() {
        return;
    }
    *out += "<h2>Telegrams</h2>\n";
    let of_role = |role: Role| {
        let cell = r.cells.iter().find(|cell| cell.role == role);
        cell.map_or_else(|| "not told".to_owned(), |cell| cell.grown().to_string())
    };
    let figures = |cp: &CpLedger| {
        [
            ("orders", cp.accepted),
            ("done", cp.done),
            ("error", cp.error),
            ("aborted", cp.aborted),
            ("lost in CP", cp.lost),
            ("open", cp.open()),
            ("received", cp.received),
            ("delivered", cp.delivered),
            ("lost", cp.receive_lost),
            ("failed attempts", cp.receive_errors),
            ("drivers lost", cp.drivers_lost),
        ]
    };
    let head = figures(&CpLedger::default()).map(|(name, _)| name);
    let head: Vec<&str> = std::iter::once("CP").chain(head).collect();
    let rows = r
        .telegrams
        .iter()
        .map(|cp| std::iter::once(cp.cp.clone()).chain(figures(cp).map(|(_, figure)| figure.to_string())).collect());
    table(out, &head, rows);
    let _ = writeln!(
        out,
        "<p>Doubled, as the program counts: {}. Wrong: {}.</p>",
        of_role(Role::Doubled),
        of_role(Role::Wrong)
    );
    let own = r.cells.iter().filter(|cell| cell.role == Role::Own);
    if own.clone().next().is_some() {
        let rows = own.map(|c| vec![c.name.clone(), c.grown().to_string(), c.first.to_string(), c.last.to_string()]);
        table(out, &["cell", "growth", "from", "to"], rows);
    }
}

fn posture(out: &mut String, r: &Report) {
    *out += "<h2>Posture</h2>\n";
    let rows = r.posture.iter().map(|grant| {
        vec![grant.outcome.clone(), grant.what.clone(), grant.detail.clone(), grant.remedy.clone().unwrap_or_default()]
    });
    table(out, &["", "what", "found", "what would help"], rows);
}

fn diagnostics(out: &mut String, r: &Report) {
    if r.diagnostics.is_empty() {
        return;
    }
    *out += "<h2>Diagnostic buffer, newest first</h2>\n";
    let rows = r
        .diagnostics
        .iter()
        .map(|entry| vec![entry.number.to_string(), format!("{:.6} s", entry.time_ns as f64 / 1e9), entry.told()]);
    table(out, &["number", "at", "entry"], rows);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soak::report::{CpLedger, Interval};
    use crate::soak::verdict::Finding;

    #[test]
    fn a_page_of_little_needs_nothing_else() {
        let finding = Finding {
            budget: "wake.p99<1".into(),
            measured: "2 ms".into(),
            verdict: Verdict::Broken,
            why: "kernel & host".into(),
        };
        let report = Report {
            station: "press <1>".into(),
            findings: vec![finding],
            verdict: Verdict::Broken,
            telegrams: vec![CpLedger { cp: "cp".into(), accepted: 5, done: 4, ..CpLedger::default() }],
            intervals: vec![Interval { end_ns: 1_000_000_000, ..Interval::default() }],
            ..Report::default()
        };
        for report in [report.clone(), Report { intervals: Vec::new(), ..report }] {
            let page = page(&report);
            for part in ["press &lt;1&gt;", "BUDGET BROKEN", "wake.p99&lt;1", "kernel &amp; host"] {
                assert!(page.contains(part), "{part}");
            }
            assert!(!page.contains("http") && !page.contains("<script") && !page.contains("NaN"), "{page}");
        }
    }
}
