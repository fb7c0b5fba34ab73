//! `ob1 soak --merge REPORT...`: one verdict on the soaks of many machines.
//!
//! Distributions and counts are judged over all scans of all machines, as those of one long soak. That could hide one
//! bad machine among many good ones: each is also judged alone, and held against the others. Trends are those of a
//! machine; the worst one counts.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::SoakArgs;
use super::budget::{Budget, What};
use super::compare::{SERIES, differences};
use super::files::Files;
use super::judge::{figure, finding, judge, stays_in_run};
use super::report::{Beside, Machine, Report, percentiles};
use super::verdict::{Finding, Verdict};
use crate::statistics::{OUTLIER, OUTLIERS, compare as shift, middle, scores};
use crate::units::time;

/// Reads the reports, and judges them as one.
pub(super) fn merge(paths: &[PathBuf], args: &SoakArgs) -> Result<Report, String> {
    let failed = |why: String| format!("ob1: {why}\n");
    let mut reports = Vec::new();
    for path in paths {
        reports.push((path.as_path(), Report::read(path).map_err(failed)?));
    }
    let merged = merged(&reports, &args.budget, f64::from(args.margin) / 100.0).map_err(failed)?;
    if args.report.is_some() {
        let files = Files::new(args.report.as_deref(), &merged.station);
        files.write(&merged).map_err(|e| failed(format!("{}: {e}", files.path("json").display())))?;
    }
    Ok(merged)
}

fn merged(reports: &[(&Path, Report)], budget: &[Budget], margin: f64) -> Result<Report, String> {
    usable(reports)?;
    let budget = if budget.is_empty() { budgets(reports) } else { budget.to_vec() };
    let names = names(reports);
    let mut machines: Vec<Report> = reports.iter().map(|(_, report)| report.clone()).collect();
    machines.iter_mut().for_each(|report| judge(report, &budget));
    let [first, others @ ..] = machines.as_slice() else { return Err("no report".into()) };
    let mut all = first.clone();
    others.iter().for_each(|other| add(&mut all, other));
    all.percentiles = all.timing.as_ref().map(percentiles).unwrap_or_default();
    all.machines = tell(&machines, &names);

    let mut findings = vec![worst_of(&machines, &names, stays_in_run)];
    findings.extend(budget.iter().map(|budget| match &budget.what {
        What::Slope(_) => worst_of(&machines, &names, |report| finding(report, budget)),
        what => {
            let found = finding(&all, budget);
            let figures = machines.iter().zip(&names).filter_map(|(report, name)| Some((figure(report, what)?, name)));
            let worst = figures.max_by(|a, b| a.0.total_cmp(&b.0));
            let worst = worst.map(|(_, name)| format!("worst: {name}")).unwrap_or_default();
            let why = if found.why.is_empty() { worst } else { format!("{worst}; {}", found.why) };
            Finding { why, ..found }
        }
    }));
    findings.push(each_alone(&all.machines));
    findings.push(alike(&all.machines, margin));
    findings.extend(soaked_alike(first, others, &names));
    all.verdict = findings.iter().map(|f| f.verdict).max().unwrap_or(Verdict::Inconclusive);
    all.findings = findings;
    Ok(all)
}

/// That they can be one report: none twice, none merged already, all of the same scan.
fn usable(reports: &[(&Path, Report)]) -> Result<(), String> {
    let mut seen = HashSet::new();
    let mut interval = None;
    for (path, report) in reports {
        let path = path.display();
        if !report.machines.is_empty() {
            return Err(format!("{path} was merged already\n  = give the reports it was made of"));
        }
        let Some(timing) = &report.timing else {
            return Err(format!("{path}: nothing has been measured\n  = leave it out, or soak that machine again"));
        };
        if !seen.insert((&report.host, &report.station, report.began_unix_s, timing.scans, timing.wake.max_ns)) {
            return Err(format!("{path} is the same soak as another report\n  = give each once"));
        }
        let limits = (timing.min_cycle_ns, timing.late_from_ns, timing.long_from_ns);
        if *interval.get_or_insert(limits) != limits {
            let cycle = time(timing.min_cycle_ns as f64);
            return Err(format!(
                "{path} has another interval of the scan ({cycle}), or other limits of a late scan\n  = merge soaks of the same scan only"
            ));
        }
    }
    Ok(())
}

/// The limits that the reports were judged by, each once.
fn budgets(reports: &[(&Path, Report)]) -> Vec<Budget> {
    let mut budgets: Vec<Budget> = Vec::new();
    for found in reports.iter().flat_map(|(_, report)| &report.findings) {
        if let Ok(budget) = found.budget.parse::<Budget>()
            && !budgets.contains(&budget)
        {
            budgets.push(budget);
        }
    }
    budgets
}

/// The names of the machines: by themselves where that tells them apart, else by their reports.
fn names(reports: &[(&Path, Report)]) -> Vec<String> {
    let hosts: HashSet<&str> = reports.iter().map(|(_, report)| report.host.as_str()).collect();
    let stem = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let stems: HashSet<String> = reports.iter().map(|(path, _)| stem(path)).collect();
    let name = |(path, report): &(&Path, Report)| match () {
        () if hosts.len() == reports.len() && !hosts.contains("") => report.host.clone(),
        () if stems.len() == reports.len() => stem(path),
        () => path.display().to_string(),
    };
    reports.iter().map(name).collect()
}

/// Adds the scans and counts of another machine.
fn add(all: &mut Report, other: &Report) {
    if let (Some(timing), Some(more)) = (&mut all.timing, &other.timing) {
        timing.merge(more);
    }
    for cp in &other.telegrams {
        match all.telegrams.iter_mut().find(|known| known.cp == cp.cp) {
            Some(known) => known.merge(cp),
            None => all.telegrams.push(cp.clone()),
        }
    }
    for cell in &other.cells {
        match all.cells.iter_mut().find(|known| known.name == cell.name) {
            // Only the growth has a sum.
            Some(known) => known.last += cell.grown(),
            None => all.cells.push(cell.clone()),
        }
    }
    all.wanted_ns = all.wanted_ns.saturating_add(other.wanted_ns);
    all.measured_ns = all.measured_ns.saturating_add(other.measured_ns);
    all.began_unix_s = all.began_unix_s.min(other.began_unix_s);
    all.reset_outside |= other.reset_outside;
    if all.station != other.station {
        all.station = "several stations".into();
    }
    // What is of one machine alone.
    (all.host, all.load) = (String::new(), None);
    all.intervals.clear();
    all.slopes.clear();
    all.diagnostics.clear();
}

/// The worst finding of all machines, with its name.
fn worst_of(machines: &[Report], names: &[String], of: impl Fn(&Report) -> Finding) -> Finding {
    let findings = machines.iter().map(&of).zip(names);
    let named = findings.map(|(found, name)| match found.why.as_str() {
        "" => Finding { why: format!("worst: {name}"), ..found },
        why => Finding { why: format!("worst: {name}: {why}"), ..found },
    });
    let none = Finding { budget: String::new(), measured: String::new(), verdict: Verdict::Pass, why: String::new() };
    named.max_by_key(|found| found.verdict).unwrap_or(none)
}

/// What was not the same on all machines; no figure breaks by it.
fn soaked_alike(first: &Report, others: &[Report], names: &[String]) -> Option<Finding> {
    let different = others.iter().zip(names.iter().skip(1)).filter_map(|(other, name)| {
        // Each machine has its own seed of the load.
        let told: Vec<String> =
            differences(first, other).into_iter().filter(|told| !told.starts_with("load")).collect();
        (!told.is_empty()).then(|| format!("{name}: {}", told.join(", ").replace('\n', "")))
    });
    let different: Vec<String> = different.collect();
    (!different.is_empty()).then(|| Finding {
        budget: "soaked alike".into(),
        measured: format!("{} differ from the first", different.len()),
        verdict: Verdict::Pass,
        why: different.join("; "),
    })
}

/// Each machine, by itself and beside the others.
fn tell(machines: &[Report], names: &[String]) -> Vec<Machine> {
    let series =
        |report: &Report, name: &str| -> Vec<f64> { report.series(name).into_iter().map(|(_, value)| value).collect() };
    let mut told: Vec<Machine> = machines.iter().zip(names).map(|(report, name)| alone(report, name)).collect();
    for name in SERIES {
        let all: Vec<Vec<f64>> = machines.iter().map(|report| series(report, name)).collect();
        let medians: Vec<f64> = all.iter().map(|values| middle(values)).collect();
        let mut order: Vec<usize> = (0..medians.len()).collect();
        order.sort_by(|a, b| medians[*a].total_cmp(&medians[*b]));
        let of_middle = order.get(order.len() / 2).map_or(&[][..], |index| &all[*index]);
        let scores = scores(&medians);
        for (index, machine) in told.iter_mut().enumerate() {
            machine.beside.push(Beside {
                series: name.to_owned(),
                median_ns: medians[index],
                shift: shift(of_middle, &all[index]),
                score: scores.as_ref().map(|scores| scores[index]),
            });
        }
    }
    told
}

fn alone(report: &Report, name: &str) -> Machine {
    let broken = report.findings.iter().filter(|found| found.verdict == Verdict::Broken);
    let timing = report.timing.as_ref();
    Machine {
        name: name.to_owned(),
        scans: timing.map_or(0, |timing| timing.scans),
        late: timing.map_or(0, |timing| timing.late.scans),
        missed: timing.map_or(0, |timing| timing.missed),
        verdict: report.verdict,
        broken: broken.map(|found| format!("{}: {}", found.budget, found.measured)).collect(),
        slopes: report.slopes.clone(),
        beside: Vec::new(),
    }
}

/// No machine breaks a limit by itself. One that has seen too little alone is what merging is for.
fn each_alone(machines: &[Machine]) -> Finding {
    let bad: Vec<&Machine> = machines.iter().filter(|machine| !machine.broken.is_empty()).collect();
    let worst = bad.iter().max_by_key(|machine| machine.broken.len());
    Finding {
        budget: "each machine alone".into(),
        measured: format!("{} of {} break no limit", machines.len() - bad.len(), machines.len()),
        verdict: if bad.is_empty() { Verdict::Pass } else { Verdict::Broken },
        why: worst.map(|worst| format!("worst: {}: {}", worst.name, worst.broken.join(", "))).unwrap_or_default(),
    }
}

/// No machine is slower than the others beyond chance and the margin: the figures of all would not be its own.
fn alike(machines: &[Machine], margin: f64) -> Finding {
    let mut slower = Vec::new();
    for (index, name) in SERIES.iter().enumerate() {
        let of = |machine: &Machine| machine.beside.get(index).map_or(0.0, |beside| beside.median_ns);
        let usual = middle(&machines.iter().map(of).collect::<Vec<f64>>());
        for machine in machines {
            let score = machine.beside.get(index).and_then(|beside| beside.score).unwrap_or(0.0);
            if score > OUTLIER && of(machine) > usual * (1.0 + margin) {
                slower.push((score, format!("{} {name} {} against {}", machine.name, time(of(machine)), time(usual))));
            }
        }
    }
    slower.sort_by(|a, b| b.0.total_cmp(&a.0));
    let told: Vec<&str> = slower.iter().take(3).map(|(_, told)| told.as_str()).collect();
    let few = format!("it takes {OUTLIERS} machines to tell");
    Finding {
        budget: "machines alike".into(),
        measured: format!("{} machines, {} outliers", machines.len(), slower.len()),
        verdict: if slower.is_empty() { Verdict::Pass } else { Verdict::Inconclusive },
        why: if machines.len() < OUTLIERS { few } else { told.join(", ") },
    }
}

#[cfg(test)]
mod tests;
