//! A look as text, for pipes and files.

use std::fmt::Write as _;

use ob1_params::CpKind;

use super::data::{Data, counter, rows};
use crate::ctl::last_stop;
use crate::diag;
use crate::units::time;
use ob1_station::access::protocol::ModuleStatus;
use ob1_station::view::EVENTS_LOST;

/// Entries of each diagnostic buffer.
const NEWEST: usize = 3;

/// The state of the station in two lines of 80 columns, as at the head of the screen.
pub(super) fn head(data: &Data) -> String {
    let (s, t) = (&data.now.status, &data.now.timing);
    let rate = data.scan_rate().map_or_else(String::new, |rate| format!(" ({rate:.0}/s)"));
    let up = time(s.runtime_ns as f64);
    format!(
        "{}  {}  process {}  {up}  memory {} KiB  engine {}\nscans {}{rate}  late {}  overruns {}  missed {}  watchdog {}",
        s.station,
        s.state,
        s.pid,
        s.memory.resident_kib,
        s.engine,
        t.scans,
        t.late.scans,
        t.overruns,
        t.missed,
        t.watchdogs
    )
}

/// What somebody who is called to the machine asks first: the last STOP, what does not answer, which CP has an error,
/// the cycle, what is forced.
pub(super) fn first(data: &Data) -> String {
    let (s, entries) = (&data.now.status, &data.now.diagnostics);
    let mut out = String::new();
    match last_stop(entries) {
        None => out.push_str("no STOP in the diagnostic buffer\n"),
        Some(last) => {
            let (when, told) = (if last.over { "last STOP" } else { "STOP" }, last.cause.unwrap_or(last.stop));
            let _ = writeln!(out, "{when}: {}  {}", diag::date(told.unix_ns), told.told());
            if !told.remedy.is_empty() {
                let _ = writeln!(out, "  = {}", told.remedy);
            }
        }
    }
    let names = |of: &dyn Fn(&&ModuleStatus) -> bool| -> Vec<&str> {
        s.modules.iter().filter(of).map(|m| m.name.as_str()).collect()
    };
    let (absent, wrong) = (names(&|m| !m.present), names(&|m| m.reason.is_some()));
    let all = s.modules.len();
    let _ = write!(out, "modules: {} of {all} answer", all - absent.len());
    for (what, names) in [("absent", absent), ("CPs with an error", wrong)] {
        if !names.is_empty() {
            let _ = write!(out, "; {what}: {}", names.join(", "));
        }
    }
    let (typical, longest) = (time(s.cycle.p50_ns as f64), time(s.cycle.max_ns as f64));
    let _ = writeln!(out, "\ncycle: {typical}, longest {longest}");
    if !s.forced.is_empty() {
        let _ = writeln!(out, "forced: {}", s.forced.join(", "));
    }
    out
}

/// The table of times: since the last reset, and since the reading before.
pub(super) fn times(data: &Data) -> String {
    let mut out = format!(
        "{:<20}{:>10}{:>11}{:>11}{:>11}   {:>10}{:>11}{:>11}{:>11}\n",
        "", "count", "p50", "p99", "max", "newest", "p50", "p99", "max"
    );
    for (name, all, newest) in rows(data) {
        let _ = write!(out, "{:<20}", name.chars().take(20).collect::<String>());
        for (place, f) in [all, newest].into_iter().enumerate() {
            let gap = if place == 0 { "" } else { "   " };
            let (p50, p99, max) = (time(f.p50 as f64), time(f.p99 as f64), time(f.max as f64));
            let _ = write!(out, "{gap}{:>10}{p50:>11}{p99:>11}{max:>11}", f.count);
        }
        out.push('\n');
    }
    out
}

/// A CP or another module in a line: LEDs, driver, orders, telegrams.
pub(super) fn module(data: &Data, number: usize, m: &ModuleStatus) -> String {
    let mut out = format!("{:<10} {:<8} {:>5}  ", m.name, m.type_name, m.address);
    // A coupler has a process too, but no orders: it is shown with its bus.
    let (Some(driver), Some(cp)) = (&m.driver, CpKind::of_name(&m.type_name)) else {
        out += if m.present { "present" } else { "absent" };
        return out;
    };
    // The names on the front of the module.
    for led in cp.row().leds.into_iter().filter(|led| !led.is_empty()) {
        let lit = m.leds.iter().any(|name| name == led);
        let _ = write!(out, "{}{led} ", if lit { '*' } else { '.' });
    }
    let _ = write!(out, " {} ({}), restarts {}", driver.state, driver.pid, driver.losses);
    if let Some(reason) = &m.reason {
        // Before the figures: a narrow screen cuts them off.
        let _ = write!(out, "  {}", reason.text);
    }
    let n = |name: &str| counter(m, name);
    let open = n("orders_accepted")
        .saturating_sub(n("telegrams_sent") + n("send_errors") + n("orders_aborted") + n("orders_lost"));
    let _ = write!(
        out,
        "  orders {} open {open} done {} error {} aborted {} lost {}  received {} rejected {} errors {}",
        n("orders_accepted"),
        n("telegrams_sent"),
        n("send_errors"),
        n("orders_aborted"),
        n("orders_lost"),
        n("telegrams_received"),
        n("rejected_full"),
        n("receive_errors")
    );
    if n(EVENTS_LOST) > 0 {
        let _ = write!(out, "  events lost {}", n(EVENTS_LOST));
    }
    if let Some((sent, received)) = data.telegram_rates(number) {
        let _ = write!(out, "  {sent:.1}/s out {received:.1}/s in");
    }
    out
}

/// The buses with their couplers and slaves.
pub(super) fn buses(data: &Data) -> String {
    crate::bus::text::text(&data.now.buses, data.buses_before())
}

/// The links, and below each its connections.
pub(super) fn links(data: &Data) -> String {
    let mut out = String::new();
    for link in &data.now.links {
        let _ = writeln!(out, "{:<16} {}", link.name, if link.up { "up" } else { "down" });
        for one in &link.connections {
            let _ = writeln!(
                out,
                "  {:<24} {:<22} {:<8} PDU {:>4}  jobs {:>10}  errors {:>6}",
                one.partner, one.name, one.state, one.pdu, one.jobs, one.errors
            );
        }
    }
    out
}

/// The variable table, a line a cell.
pub(super) fn values(data: &Data) -> Vec<String> {
    let line =
        |(watched, value): &(super::watch::Watched, Result<ob1_station::access::protocol::CellValue, String>)| {
            match value {
                Ok(cell) => format!("{:<24} {:<8} {}", watched.name, cell.type_name, watched.show(cell)),
                Err(why) => format!("{:<24} {why}", watched.name),
            }
        };
    data.now.values.iter().map(line).collect()
}

/// The whole look as lines of text.
pub(super) fn text(data: &Data) -> String {
    let mut out = format!("{}\n{}{}", head(data), first(data), times(data));
    out += &ob1_timing::text::late(&data.now.timing.late);
    for (number, m) in data.now.status.modules.iter().enumerate() {
        let _ = writeln!(out, "{}", module(data, number, m));
    }
    out += &buses(data);
    out += &links(data);
    for line in values(data) {
        let _ = writeln!(out, "{line}");
    }
    let mut buffers = data.now.cp_buffers.clone();
    buffers.iter_mut().for_each(|buffer| buffer.entries.truncate(NEWEST));
    let newest = data.now.diagnostics.iter().take(NEWEST).cloned().collect::<Vec<_>>();
    out + &diag::text(Some(&newest), &buffers)
}

#[cfg(test)]
mod tests {
    use super::super::data::tests::look;
    use super::*;
    use ob1_station::access::protocol::ReasonStatus;

    #[test]
    fn a_look_tells_everything() {
        let mut data = Data::new(look(10, 10_000));
        data.update(look(12, 12_000));
        let text = text(&data);
        for part in [
            "press  RUN  process 42",
            "modules: ",
            "cycle: ",
            "scans 12000 (1000/s)",
            "engine native",
            "wake-up                  12000    20.0 µs",
            "*PW .ER *TxD .RxD  ready (43), restarts 0  orders 121 open 1 done 120",
            "10.0/s out 5.0/s in",
            "rio              exchange       1000.0",
            "panel            up\n  10.0.0.7:50000           03.02                  up       PDU  480  jobs         17  errors      2",
            "page             down",
            "MW10                     WORD     16#0102",
            "DB99.DBW0                there is no DB 99",
            "4302h: RUN",
            "0.010 s  0003h The parameters were accepted",
            "unexplained (host suspected): 50.0 %",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
        assert!(!text.contains("0007h"), "the newest three\n{text}");
        assert!(!text.contains("events lost"), "{text}");
        data.now.status.modules[0].counters.insert(EVENTS_LOST.into(), 3);
        let text = self::text(&data);
        assert!(text.contains("rejected 0 errors 0  events lost 3  10.0/s out"), "{text}");
        let reason = ReasonStatus { text: "waits for FC 9 (8001h), for 3 s".into(), ..ReasonStatus::default() };
        data.now.status.modules[0].reason = Some(reason);
        let text = self::text(&data);
        assert!(text.contains("restarts 0  waits for FC 9 (8001h), for 3 s  orders 121"), "{text}");
    }
}
