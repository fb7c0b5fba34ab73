//! Timing in words, for the terminal.

use std::fmt::Write as _;

use super::snapshot::{FlightDump, LateEntry, LateReport, Recorder, Spread, Timing};

fn us(nanos: u64) -> f64 {
    nanos as f64 / 1000.0
}

/// The whole table, as `ob1 ctl STATION timing` prints it.
pub fn timing(t: &Timing) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{} scans, {} overruns, {} missed deadlines (rule: {}), {} watchdog; late from {} µs, long from {} µs",
        t.scans,
        t.overruns,
        t.missed,
        t.missed_rule,
        t.watchdogs,
        us(t.late_from_ns),
        us(t.long_from_ns)
    );
    let _ = writeln!(out, "{HEAD}");
    row(&mut out, "cycle", &t.cycle);
    row(&mut out, "wake-up", &t.wake);
    row(&mut out, "deadlines", &t.deadlines);
    row(&mut out, "execution", &t.execution);
    row(&mut out, "inputs", &t.inputs);
    row(&mut out, "outputs", &t.outputs);
    if t.links.count > 0 {
        row(&mut out, "links", &t.links);
    }
    for ob in &t.obs {
        row(&mut out, &format!("OB {}", ob.ob), &ob.execution);
        if ob.ob != 1 && ob.lateness.count > 0 {
            row(&mut out, &format!("OB {} late", ob.ob), &ob.lateness);
        }
        if ob.overruns > 0 {
            let _ = writeln!(out, "  OB {}: {} overruns", ob.ob, ob.overruns);
        }
    }
    for block in t.blocks.iter().filter(|block| block.execution.count > 0) {
        row(&mut out, &format!("{} {}", block.block, block.name), &block.execution);
    }
    out += &late(&t.late);
    out
}

const HEAD: &str =
    "time in µs              count       min      mean       p50       p99     p99.9    p99.99       max";

fn row(out: &mut String, name: &str, s: &Spread) {
    let figures = [s.min_ns as f64, s.mean_ns, s.p50_ns as f64, s.p99_ns as f64, s.p999_ns as f64, s.p9999_ns as f64];
    let _ = write!(out, "{name:<18} {:>10}", s.count);
    for figure in figures {
        let _ = write!(out, "{:>10.1}", figure / 1000.0);
    }
    let _ = writeln!(out, "{:>10.1}", us(s.max_ns));
}

/// The late scans: how many of which class, the share without an explanation, and the longest.
pub fn late(late: &LateReport) -> String {
    if late.scans == 0 {
        return "no late scan\n".into();
    }
    let mut out = format!("{} late scans", late.scans);
    if late.pending + late.lost > 0 {
        let _ = write!(out, " ({} not explained yet, {} too fast to be explained)", late.pending, late.lost);
    }
    let _ = writeln!(out, "; unexplained (host suspected): {:.1} %", late.unexplained_share * 100.0);
    for (class, total) in &late.classes {
        let _ = writeln!(out, "  {:<28} {:>8}   longest {:>10.1} µs", class.name(), total.scans, us(total.worst_ns));
    }
    for entry in late.worst.iter().take(5) {
        let _ = writeln!(out, "  {}", one(entry));
    }
    out
}

fn one(entry: &LateEntry) -> String {
    format!(
        "scan {} at {:.6} s: {:.1} µs, {}: {}",
        entry.scan,
        entry.planned_ns as f64 / 1e9,
        us(entry.size_ns),
        entry.class.name(),
        entry.what
    )
}

/// The class of a late scan, and the exact cause.
pub(super) fn cause(entry: &LateEntry) -> String {
    let took = entry.lateness_ns.max(entry.execution_ns) as f64 / 1e6;
    format!("of {took:.1} ms {:.1} ms {}: {}", entry.size_ns as f64 / 1e6, entry.class.name(), entry.what)
}

/// The flight recorder: the worst frozen flight, or the scans up to now.
pub fn recorder(recorder: &Recorder) -> String {
    let (what, flight) = match &recorder.worst {
        Some(flight) => ("the overrun with the longest delay", flight),
        None => ("no overrun so far; the last scans", &recorder.now),
    };
    let mut out = format!("{what} ({} flights frozen, {} not)\n", recorder.frozen, recorder.not_frozen);
    out += &self::flight(flight);
    out
}

fn flight(flight: &FlightDump) -> String {
    let mut out = String::from(
        "      scan    planned s    late µs    runs µs  inputs  program plugins outputs statements  longest\n",
    );
    for s in &flight.scans {
        let _ = write!(
            out,
            "{:>10} {:>12.6} {:>10.1} {:>10.1} {:>7.1} {:>8.1} {:>7.1} {:>7.1} {:>10}  OB {}",
            s.scan,
            s.planned_ns as f64 / 1e9,
            us(s.lateness_ns),
            us(s.execution_ns),
            us(s.inputs_ns),
            us(s.program_ns),
            us(s.plugins_ns),
            us(s.outputs_ns),
            s.statements,
            s.longest_ob
        );
        if let Some(plugin) = &s.longest_plugin {
            let _ = write!(out, ", {plugin}");
        }
        if let Some(block) = &s.long_in {
            let _ = write!(out, ", long in {block} line {}", s.long_at_line);
        }
        let _ = writeln!(out, "  {}", s.flags.join(" "));
    }
    out
}
