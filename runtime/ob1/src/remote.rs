//! `ob1 get`, `set`, and what `ctl` prints: questions to a running station.

use std::collections::BTreeMap;

use clap::Args;
use ob1_access::Form;
use ob1_model::OperatingState;
use ob1_params::CpKind;
use serde::Serialize;
use serde_json::Value;

use crate::ctl;
use crate::exit::{Exit, told};
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::{ModuleStatus, Op, Response, RetentiveStatus, Status, Times};
use ob1_station::view::EVENTS_LOST;
use ob1_timing::text;

/// Read cells of a running station
#[derive(Debug, Args)]
#[command(after_help = "Names: M1.0 MB1 MW10 MD4, E/I and A/Q likewise, PEW256, DB10.DBX0.0 DB10.DBW20, T2, Z3,\n\
    components of data blocks (DB20.DONE) and symbols. A time is shown as S5T#1S500MS, a text as 'ABC', and so on.\n\n\
    Examples:\n  ob1 get press\n  ob1 get station-a.toml M1.0 DB20.DONE MW12:hex --json")]
pub struct GetArgs {
    /// A running station: its name or its file
    pub station: String,
    /// Names of cells, each perhaps with :hex :bin :anzw or :status; without any: all symbols
    pub items: Vec<String>,
    /// As a JSON array of {item, type, value, hex, text}
    #[arg(long)]
    pub json: bool,
}

/// Write cells of a running station
#[derive(Debug, Args)]
#[command(
    after_help = "Values: 1, 0, true, -5, 16#1A, W#16#1A, L#-5, 2#1010, 1.5, S5T#1S500MS, T#2S, D#2026-1-31, TOD#6:30:0,\n\
    DT#2026-1-31-6:30:0, C#5, 'ABC'.\nAn input of a di or ai module keeps its value; \
    an input of a CP lasts until the next process image.\n\nExample:\n  ob1 set station-a.toml M1.0=1 DB10.DBW20=16#1234"
)]
pub struct SetArgs {
    /// A running station: its name or its file
    pub station: String,
    /// NAME=VALUE
    #[arg(required = true, value_name = "NAME=VALUE", value_parser = assignment)]
    pub items: Vec<(String, String)>,
}

pub(crate) fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim().to_owned(), value.trim().to_owned())),
        _ => Err("not an assignment; write NAME=VALUE, such as M1.0=1".to_owned()),
    }
}

pub(crate) fn ask(station: &str, op: Op) -> Result<Response, AccessError> {
    Client::to_station(station)?.ask(op)
}

/// Prints values of cells.
pub fn get(args: &GetArgs) -> Result<Exit, AccessError> {
    let (names, forms): (Vec<&str>, Vec<Form>) = args.items.iter().map(|item| Form::split(item)).unzip();
    let items = names.into_iter().map(str::to_owned).collect();
    let values = ask(&args.station, Op::Get { items })?.values.unwrap_or_default();
    if args.json {
        return Ok(print_json(&values));
    }
    let width = values.iter().map(|v| v.item.chars().count()).max().unwrap_or(0);
    for (value, form) in values.iter().zip(forms.into_iter().chain(std::iter::repeat(Form::Plain))) {
        // A number says more in hexadecimal, too; a text or a time does not.
        let is_number = value.type_name != "BOOL" && form == Form::Plain && value.text.parse::<i64>().is_ok();
        let hex = if is_number { format!("  16#{}", value.hex) } else { String::new() };
        let shown = form.show(&value.text, &value.hex);
        say!("{:<width$}  {shown:>12}{hex}", value.item);
    }
    Ok(Exit::Ok)
}

/// Writes cells, given as `NAME=VALUE`.
pub fn set(args: &SetArgs) -> Result<Exit, AccessError> {
    ask(&args.station, Op::Set { items: assigned(&args.items) }).map(|_| Exit::Ok)
}

/// The values of cells by their names.
pub(crate) fn assigned(items: &[(String, String)]) -> BTreeMap<String, Value> {
    items.iter().map(|(name, value)| (name.clone(), Value::from(value.as_str()))).collect()
}

/// Prints what the station tells, as JSON or for people.
fn show<T: Serialize>(told: Option<T>, json: bool, print: impl FnOnce(&T)) -> Exit {
    match told {
        None => return Exit::Refused,
        Some(told) if json => return print_json(&told),
        Some(told) => print(&told),
    }
    Exit::Ok
}

/// Prints state and figures.
pub(crate) fn status(station: &str, json: bool) -> Result<Exit, AccessError> {
    let status = ask(station, Op::Status)?.status;
    Ok(show(status, json, |status| {
        print_status(status);
        if status.state == OperatingState::Stop.name()
            && let Some(why) = ctl::why_stopped(station, 0)
        {
            say!("{why}");
        }
    }))
}

/// Prints the accounts of every scan.
pub(crate) fn timing(station: &str, json: bool) -> Result<Exit, AccessError> {
    let timing = ask(station, Op::Timing { histograms: json })?.timing;
    Ok(show(timing, json, |timing| says!("{}", text::timing(timing))))
}

/// Prints the flight recorder.
pub(crate) fn recorder(station: &str, json: bool) -> Result<Exit, AccessError> {
    let recorder = ask(station, Op::Recorder)?.recorder;
    Ok(show(recorder, json, |recorder| says!("{}", text::recorder(recorder))))
}

fn print_status(status: &Status) {
    say!("{} is in {}, process {}, {:.1} s", status.station, status.state, status.pid, status.runtime_ns as f64 / 1e9);
    say!("ob1 {}, program {}", status.version, status.program);
    say!(
        "engine {}   scans {}   overruns {}   missed deadlines {}   late {}   watchdog {}",
        status.engine,
        status.scans,
        status.overruns,
        status.missed,
        status.late,
        status.watchdogs
    );
    let line = |name: &str, t: &Times| {
        let us = |ns: f64| ns / 1000.0;
        say!(
            "{name:<10} min {:.1}   mean {:.1}   p50 {:.1}   p99 {:.1}   max {:.1} µs",
            us(t.min_ns as f64),
            us(t.mean_ns),
            us(t.p50_ns as f64),
            us(t.p99_ns as f64),
            us(t.max_ns as f64)
        );
    };
    line("cycle", &status.cycle);
    line("wake-up", &status.wake);
    line("execution", &status.execution);
    if let Some(seconds) = status.stands_s {
        say!("no cycle ends: the one that runs began {seconds} s ago");
    }
    if let Some(why) = &status.engine_lacks {
        say!("machine code: {why}");
    }
    if let Some(retentive) = &status.retentive {
        say!("{}", retentive_text(retentive));
    }
    if !status.forced.is_empty() {
        say!("FRCE, forced: {}", status.forced.join(", "));
    }
    if !status.downloads.is_empty() {
        let list: Vec<String> = status.downloads.iter().map(|one| format!("{} {}", one.block, one.what)).collect();
        say!("different from the sources: {}", list.join(", "));
    }
    if let Some(why) = &status.downloads_not_kept {
        say!("the downloaded blocks are lost when the station ends: {why}");
    }
    if status.log_lost > 0 {
        say!("log lines lost {}: standard error of the runtime is full, slow or gone", status.log_lost);
    }
    for grant in &status.posture {
        say!("{grant}");
    }
    for module in &status.modules {
        says!("{}", module_text(module));
    }
}

/// A module: whether it is there, its driver, what has become of its telegrams, why nothing happens.
fn module_text(module: &ModuleStatus) -> String {
    let present = if module.present { "present" } else { "absent" };
    let mut out = format!("{} ({} at {}): {present}", module.name, module.type_name, module.address);
    let Some(driver) = &module.driver else { return out + "\n" };
    let leds = module.leds.join(" ");
    out += &format!(", driver {} {}, restarts {}, LEDs {leds}\n", driver.pid, driver.state, driver.losses);
    if CpKind::of_name(&module.type_name).is_some_and(|cp| !cp.row().has_boxes) {
        let n = |name: &str| module.counters.get(name).copied().unwrap_or(0);
        out += &format!(
            "    telegrams sent {}, received {}, rejected {}, lost {}; orders failed {}{}, lost {}; receive errors {}",
            n("telegrams_sent"),
            n("telegrams_received"),
            n("rejected_full"),
            n("receive_lost"),
            n("send_errors"),
            ends(module),
            n("orders_lost"),
            n("receive_errors")
        );
        if n(EVENTS_LOST) > 0 {
            out += &format!("; events lost {}", n(EVENTS_LOST));
        }
        out.push('\n');
    }
    for kind in ["order", "telegram"] {
        let of_kind = module.stages.iter().filter(|stage| stage.kind == kind);
        let stages: Vec<String> =
            of_kind.map(|stage| format!("{} {:.3}", stage.stage, stage.mean_ns as f64 / 1e6)).collect();
        if !stages.is_empty() {
            out += &format!("    {kind}s, ms to: {}\n", stages.join(", "));
        }
    }
    if let Some(reason) = &module.reason {
        out += &format!("    {}\n", reason.text);
        if !reason.remedy.is_empty() {
            out += &format!("    = {}\n", reason.remedy);
        }
    }
    out
}

/// The numbers with which orders have ended: ` (5 07h, 1 0Ah)`.
fn ends(module: &ModuleStatus) -> String {
    let ends = module.counters.iter().filter_map(|(name, count)| Some((name.strip_prefix("ended_")?, count)));
    let ends: Vec<String> = ends.map(|(number, count)| format!("{count} {number}")).collect();
    if ends.is_empty() { String::new() } else { format!(" ({})", ends.join(", ")) }
}

fn retentive_text(retentive: &RetentiveStatus) -> String {
    let age = retentive.age_ns.map_or_else(
        || "never written by this runtime".to_owned(),
        |age| format!("saved as of {:.1} s ago", age as f64 / 1e9),
    );
    let generation = retentive.generation.map_or_else(String::new, |number| format!(", generation {number}"));
    match &retentive.error {
        Some(error) => format!("retentive memory cannot be written: {error}; {age}{generation}"),
        None => format!("retentive memory {age}{generation}"),
    }
}

pub(crate) fn print_json(value: &impl Serialize) -> Exit {
    let text = serde_json::to_string_pretty(value).map(|text| {
        say!("{text}");
        Exit::Ok
    });
    told(text, |_| Exit::System)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_module_says_what_became_of_its_telegrams_and_why_nothing_happens() {
        let mut module = json!({"name": "scale", "type": "cp240", "address": 256, "present": true, "leds": ["PW"],
            "driver": {"pid": 43, "starts": 1, "losses": 0, "state": "ready"},
            "counters": {"telegrams_sent": 9, "telegrams_received": 4, "rejected_full": 2, "receive_lost": 0, "send_errors": 6,
                "ended_07h": 5, "ended_0Ah": 1, "orders_lost": 1, "receive_errors": 3}});
        let text = |module: &Value| module_text(&serde_json::from_value(module.clone()).expect("a module"));
        let head = "scale (cp240 at 256): present, driver 43 ready, restarts 0, LEDs PW\n    telegrams sent 9, received 4, \
                    rejected 2, lost 0; orders failed 6 (5 07h, 1 0Ah), lost 1; receive errors 3";
        assert_eq!(text(&module), format!("{head}\n"));
        module["counters"][EVENTS_LOST] = json!(7);
        module["reason"] = json!({"why": "start_up", "number": 32769, "count": 0, "age_s": 12,
            "text": "waits for FC 9 (8001h), for 12 s", "remedy": "Call FC 9."});
        let reason = "    waits for FC 9 (8001h), for 12 s\n    = Call FC 9.\n";
        assert_eq!(text(&module), format!("{head}; events lost 7\n{reason}"));
        module["stages"] = json!([{"kind": "order", "stage": "taken", "count": 2, "mean_ns": 1_500_000, "buckets": []},
            {"kind": "order", "stage": "seen", "count": 2, "mean_ns": 20_000, "buckets": []}]);
        let times = "    orders, ms to: taken 1.500, seen 0.020\n";
        assert_eq!(text(&module), format!("{head}; events lost 7\n{times}{reason}"));
        let inputs = json!({"name": "di", "type": "inputs", "address": 0, "present": true, "leds": [], "counters": {}});
        assert_eq!(text(&inputs), "di (inputs at 0): present\n");
    }
}
