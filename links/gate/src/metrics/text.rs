//! Figures as OpenMetrics: each family with its type and help text, classic buckets, `# EOF`. Older collectors get them
//! in the text format that was before it, which has fewer types.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_model::{Event, OperatingState};
use serde_json::Value;

/// Upper bounds of the buckets of all times, in nanoseconds: 1, 2, 5 per decade from 10 µs to 10 s.
const BOUNDS: [u64; 19] = [
    10_000,
    20_000,
    50_000,
    100_000,
    200_000,
    500_000,
    1_000_000,
    2_000_000,
    5_000_000,
    10_000_000,
    20_000_000,
    50_000_000,
    100_000_000,
    200_000_000,
    500_000_000,
    1_000_000_000,
    2_000_000_000,
    5_000_000_000,
    10_000_000_000,
];
/// The documents of the station.
pub(super) struct Told {
    pub(super) status: Value,
    pub(super) timing: Value,
    pub(super) links: Value,
    pub(super) buffers: Value,
    /// Alarms that are active, and those not acknowledged.
    pub(super) alarms: [usize; 2],
}

/// Events since the gate began to listen.
#[derive(Debug, Default)]
pub(super) struct Counts {
    events: BTreeMap<u16, u64>,
    lost: u64,
}

impl Counts {
    pub(super) fn event(&mut self, event: u16) {
        *self.events.entry(event).or_default() += 1;
    }

    pub(super) fn lost(&mut self, count: u64) {
        self.lost += count;
    }
}

/// The format of the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    OpenMetrics,
    /// The text format 0.0.4 of Prometheus.
    Text,
}

/// The page.
struct Page {
    text: String,
    format: Format,
}

impl Page {
    /// Begins a family; the name of a counter is given without `_total`.
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        if self.format == Format::Text {
            // There the family has the name of its samples.
            let (suffix, kind) = match kind {
                "counter" => ("_total", kind),
                "info" => ("_info", "gauge"),
                "stateset" => ("", "gauge"),
                _ => ("", kind),
            };
            let _ = write!(self.text, "# HELP {name}{suffix} {help}\n# TYPE {name}{suffix} {kind}\n");
            return;
        }
        let unit = if name.ends_with("_seconds") {
            format!("# UNIT {name} seconds\n")
        } else if name.ends_with("_bytes") {
            format!("# UNIT {name} bytes\n")
        } else {
            String::new()
        };
        let _ = write!(self.text, "# TYPE {name} {kind}\n{unit}# HELP {name} {help}\n");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        let labels: Vec<String> = labels.iter().map(|(name, value)| format!("{name}=\"{}\"", escaped(value))).collect();
        let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
        let _ = writeln!(self.text, "{name}{labels} {value}");
    }

    fn counter(&mut self, name: &str, help: &str, value: f64) {
        self.family(name, "counter", help);
        self.sample(&format!("{name}_total"), &[], value);
    }

    fn gauge(&mut self, name: &str, help: &str, value: f64) {
        self.family(name, "gauge", help);
        self.sample(name, &[], value);
    }

    /// The buckets of a distribution, its sum and its count.
    fn histogram(&mut self, name: &str, labels: &[(&str, &str)], spread: &Value) {
        let buckets: Vec<(u64, u64)> = list(&spread["buckets"])
            .iter()
            .filter_map(|bucket| Some((bucket.get(0)?.as_u64()?, bucket.get(1)?.as_u64()?)))
            .collect();
        let up_to =
            |bound: u64| buckets.iter().filter(|(value, _)| *value <= bound).map(|(_, count)| count).sum::<u64>();
        let count: u64 = buckets.iter().map(|(_, count)| count).sum();
        let bucket = format!("{name}_bucket");
        for bound in BOUNDS {
            let le = seconds(bound as f64).to_string();
            self.sample(&bucket, &[labels, &[("le", le.as_str())]].concat(), up_to(bound) as f64);
        }
        self.sample(&bucket, &[labels, &[("le", "+Inf")]].concat(), count as f64);
        self.sample(&format!("{name}_sum"), labels, seconds(number(&spread["mean_ns"]) * count as f64));
        self.sample(&format!("{name}_count"), labels, count as f64);
    }
}

fn seconds(ns: f64) -> f64 {
    // 0.00001 must not be printed as 0.000010000000000000001.
    ns / 1e9
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(0.0)
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map(Vec::as_slice).unwrap_or_default()
}

fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

/// All figures.
pub(super) fn figures(told: &Told, counts: &Counts, format: Format) -> String {
    let mut page = Page { text: String::with_capacity(32 << 10), format };
    cpu(&mut page, told);
    scan(&mut page, &told.timing);
    modules(&mut page, &told.status);
    rest(&mut page, told, counts);
    if format == Format::OpenMetrics {
        page.text += "# EOF\n";
    }
    page.text
}

fn cpu(page: &mut Page, told: &Told) {
    let (status, timing) = (&told.status, &told.timing);
    page.family("ob1_station", "info", "the station, its version, and the fingerprint of the program that runs");
    let labels = ["station", "version", "program"].map(|key| (key, text(&status[key])));
    page.sample("ob1_station_info", &labels, 1.0);
    page.family("ob1_cpu_state", "stateset", "the operating state of the CPU");
    for state in OperatingState::ALL.map(OperatingState::name) {
        let is = if text(&status["state"]) == state { 1.0 } else { 0.0 };
        page.sample("ob1_cpu_state", &[("ob1_cpu_state", state)], is);
    }
    page.gauge("ob1_forced_cells", "cells that an operator has forced", list(&status["forced"]).len() as f64);
    let [active, open] = told.alarms;
    page.gauge("ob1_alarms_active", "alarms whose signal is 1", active as f64);
    page.gauge("ob1_alarms_unacknowledged", "alarms that wait for their acknowledgement", open as f64);
    page.gauge("ob1_runtime_seconds", "since the runtime started", seconds(number(&status["runtime_ns"])));
    for (name, key, help) in [
        ("ob1_scans", "scans", "finished cycles in RUN"),
        ("ob1_statements", "statements", "executed statements"),
        ("ob1_scan_overruns", "overruns", "cycles that had not ended when the next was due"),
        ("ob1_scan_missed_deadlines", "missed", "deadlines no cycle began for"),
        ("ob1_watchdog_expiries", "watchdogs", "expiries of the cycle monitoring time"),
    ] {
        page.counter(name, help, number(&timing[key]));
    }
    page.gauge("ob1_min_cycle_seconds", "the minimum cycle time", seconds(number(&timing["min_cycle_ns"])));
}

fn scan(page: &mut Page, timing: &Value) {
    for (name, key, help) in [
        ("ob1_scan_cycle_seconds", "cycle", "from the start of a cycle to the start of the next"),
        ("ob1_scan_execution_seconds", "execution", "from the start of a cycle to its end"),
        ("ob1_scan_wake_seconds", "wake", "from the deadline of a cycle to its start"),
        ("ob1_scan_deadlines_seconds", "deadlines", "the same, with a value for each missed deadline too"),
        ("ob1_scan_inputs_seconds", "inputs", "back plane and process image before OB 1"),
        ("ob1_scan_outputs_seconds", "outputs", "process image and back plane after OB 1"),
        ("ob1_scan_links_seconds", "links", "the exchange with links, a part of the inputs"),
    ] {
        page.family(name, "histogram", help);
        page.histogram(name, &[], &timing[key]);
    }
    page.family("ob1_ob_execution_seconds", "histogram", "runs of an organization block, without higher classes");
    for ob in list(&timing["obs"]) {
        let number = ob["ob"].to_string();
        page.histogram("ob1_ob_execution_seconds", &[("ob", &number)], &ob["execution"]);
    }
    page.family("ob1_ob_overruns", "counter", "lost or skipped requests of an organization block");
    for ob in list(&timing["obs"]) {
        page.sample("ob1_ob_overruns_total", &[("ob", &ob["ob"].to_string())], number(&ob["overruns"]));
    }
    let late = &timing["late"];
    page.counter("ob1_scan_late", "scans that began late or took long", number(&late["scans"]));
    page.family("ob1_scan_late_cause", "counter", "late scans by cause");
    let classes = late["classes"].as_object();
    for (class, total) in classes.into_iter().flatten() {
        page.sample("ob1_scan_late_cause_total", &[("cause", class)], number(&total["scans"]));
    }
    page.family("ob1_scan_late_cause_seconds", "counter", "delays of late scans by cause");
    for (class, total) in classes.into_iter().flatten() {
        page.sample("ob1_scan_late_cause_seconds_total", &[("cause", class)], seconds(number(&total["time_ns"])));
    }
}

fn modules(page: &mut Page, status: &Value) {
    let modules = list(&status["modules"]);
    let labels =
        |module: &Value| [("module", text(&module["name"]).to_owned()), ("type", text(&module["type"]).to_owned())];
    let mut each = |name: &str, kind: &str, help: &str, value: &dyn Fn(&Value) -> Option<f64>| {
        page.family(name, kind, help);
        let sample = if kind == "counter" { format!("{name}_total") } else { name.to_owned() };
        for module in modules {
            let labels = labels(module);
            let labels = [(labels[0].0, labels[0].1.as_str()), (labels[1].0, labels[1].1.as_str())];
            if let Some(value) = value(module) {
                page.sample(&sample, &labels, value);
            }
        }
    };
    let driver = |module: &Value, key: &str| module["driver"].get(key).map(number);
    each("ob1_module_present", "gauge", "the module answers", &|module| {
        Some(f64::from(u8::from(module["present"] == Value::Bool(true))))
    });
    each("ob1_driver_starts", "counter", "driver processes that have come up", &|module| driver(module, "starts"));
    each("ob1_driver_losses", "counter", "driver processes that ended unexpectedly", &|module| {
        driver(module, "losses")
    });
    each("ob1_line_ready", "gauge", "the driver of the CP is ready: parameters and line are right", &|module| {
        module["driver"].get("state").map(|state| f64::from(u8::from(text(state) == "ready")))
    });
    page.family("ob1_cp", "counter", "orders, telegrams, errors of a CP (docs/backplane.md)");
    for module in modules {
        for (counter, value) in module["counters"].as_object().into_iter().flatten() {
            let labels = [("module", text(&module["name"])), ("counter", counter.as_str())];
            page.sample("ob1_cp_total", &labels, number(value));
        }
    }
    page.family(
        "ob1_order_stage_seconds",
        "histogram",
        "where the time of orders and telegrams goes (docs/backplane.md)",
    );
    for module in modules {
        for stage in list(&module["stages"]) {
            let (kind, name) = (text(&stage["kind"]), text(&stage["stage"]));
            let labels = [("module", text(&module["name"])), ("kind", kind), ("stage", name)];
            page.histogram("ob1_order_stage_seconds", &labels, stage);
        }
    }
    page.family("ob1_cp_reason", "gauge", "what a CP waits for or what has failed (docs/access.md)");
    for module in modules.iter().filter(|module| module["reason"].is_object()) {
        let labels = [("module", text(&module["name"])), ("reason", text(&module["reason"]["why"]))];
        page.sample("ob1_cp_reason", &labels, 1.0);
    }
    page.family("ob1_led", "gauge", "LEDs that are lit");
    for module in modules {
        for led in list(&module["leds"]) {
            page.sample("ob1_led", &[("module", text(&module["name"])), ("led", text(led))], 1.0);
        }
    }
}

fn rest(page: &mut Page, told: &Told, counts: &Counts) {
    page.family("ob1_link_up", "gauge", "the process of the link is there");
    for link in list(&told.links) {
        let up = f64::from(u8::from(link["up"] == Value::Bool(true)));
        page.sample("ob1_link_up", &[("link", text(&link["name"]))], up);
    }
    let memory = &told.status["memory"];
    page.family("ob1_memory_bytes", "gauge", "memory of the runtime");
    for (kind, key) in [("resident", "resident_kib"), ("peak", "peak_kib"), ("locked", "locked_kib")] {
        page.sample("ob1_memory_bytes", &[("kind", kind)], number(&memory[key]) * 1024.0);
    }
    page.gauge("ob1_threads", "threads of the runtime", number(&memory["threads"]));
    page.counter("ob1_log_lines_lost", "log lines that nobody took", number(&told.status["log_lost"]));
    let seconds_of_one = told.status.get("stands_s").map_or(0.0, number);
    page.gauge("ob1_cycle_stands_seconds", "since a cycle began that does not end", seconds_of_one);
    let lacks = f64::from(u8::from(told.status.get("engine_lacks").is_some()));
    page.gauge("ob1_engine_lacking", "the engine is not what was asked for", lacks);
    if let Some(retentive) = told.status.get("retentive") {
        let age = retentive.get("age_ns").map_or(f64::NAN, number);
        page.gauge("ob1_retentive_age_seconds", "since the disk had the values of memory", seconds(age));
        let failed = f64::from(u8::from(retentive.get("error").is_some_and(|error| !error.is_null())));
        page.gauge("ob1_retentive_failed", "retentive memory cannot be written", failed);
    }
    page.family("ob1_diagnostic_events", "counter", "entries of the CPU's diagnostic buffer");
    for (event, count) in &counts.events {
        let number = format!("{event:04X}h");
        let change = Event(*event).state_change().map_or("", |change| match change {
            ob1_model::StateChange::Startup => "startup",
            ob1_model::StateChange::Run => "run",
            ob1_model::StateChange::Hold => "hold",
            ob1_model::StateChange::Stop => "stop",
            ob1_model::StateChange::Fault => "fault",
        });
        page.sample("ob1_diagnostic_events_total", &[("event", &number), ("change", change)], *count as f64);
    }
    page.counter("ob1_diagnostic_events_lost", "events that came too fast to be counted", counts.lost as f64);
    page.family("ob1_cp_buffer_entries", "gauge", "entries in the diagnostic buffer of a CP");
    for buffer in list(&told.buffers) {
        let count = list(&buffer["entries"]).len() as f64;
        page.sample("ob1_cp_buffer_entries", &[("module", text(&buffer["name"]))], count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn told() -> Told {
        let spread = json!({ "mean_ns": 30_000.0, "buckets": [[10_000, 2], [50_000, 1], [20_000_000_000u64, 1]] });
        Told {
            status: json!({
                "station": "pr\"ess", "version": "0.1.0", "program": "00c0ffee", "state": "RUN", "runtime_ns": 2_000_000_000u64, "log_lost": 3,
                "stands_s": 4, "forced": ["E0.0=1", "AW4=16#00FF"], "engine_lacks": "killed",
                "memory": { "resident_kib": 2, "threads": 9 }, "retentive": { "age_ns": 5e9, "error": null },
                "modules": [{
                    "name": "cp", "type": "cp340", "present": true, "leds": ["TXD"],
                    "driver": { "starts": 2, "losses": 1, "state": "line error 5" },
                    "counters": { "telegrams_sent": 7, "ended_07h": 2 },
                    "stages": [{ "kind": "order", "stage": "taken", "mean_ns": 20_000, "buckets": [[10_000, 1], [100_000, 2]] }],
                    "reason": { "why": "order_failed", "number": 7, "count": 2, "age_s": 3, "text": "no answer", "remedy": "" },
                }],
            }),
            timing: json!({
                "scans": 4, "cycle": spread, "min_cycle_ns": 10_000_000, "obs": [{ "ob": 1, "execution": spread, "overruns": 0 }],
                "late": { "scans": 1, "classes": { "kernel": { "scans": 1, "time_ns": 1_500_000 } } },
            }),
            links: json!([{ "name": "page", "up": true }, { "name": "figures", "up": false }]),
            buffers: json!([{ "name": "cp", "entries": [1, 2] }]),
            alarms: [3, 1],
        }
    }

    #[test]
    fn the_figures_are_those_of_the_station() {
        let mut counts = Counts::default();
        counts.event(0x4302);
        counts.event(0x4302);
        let text = figures(&told(), &counts, Format::OpenMetrics);
        for line in [
            r#"ob1_station_info{station="pr\"ess",version="0.1.0",program="00c0ffee"} 1"#,
            r#"ob1_cpu_state{ob1_cpu_state="RUN"} 1"#,
            r#"ob1_cpu_state{ob1_cpu_state="STOP"} 0"#,
            "ob1_forced_cells 2",
            "ob1_runtime_seconds 2",
            "ob1_scans_total 4",
            r#"ob1_scan_cycle_seconds_bucket{le="0.00001"} 2"#,
            r#"ob1_scan_cycle_seconds_bucket{le="0.00002"} 2"#,
            r#"ob1_scan_cycle_seconds_bucket{le="0.00005"} 3"#,
            r#"ob1_scan_cycle_seconds_bucket{le="10"} 3"#,
            r#"ob1_scan_cycle_seconds_bucket{le="+Inf"} 4"#,
            "ob1_scan_cycle_seconds_count 4",
            "ob1_scan_cycle_seconds_sum 0.00012",
            r#"ob1_ob_execution_seconds_bucket{ob="1",le="0.00001"} 2"#,
            r#"ob1_scan_late_cause_total{cause="kernel"} 1"#,
            r#"ob1_scan_late_cause_seconds_total{cause="kernel"} 0.0015"#,
            r#"ob1_module_present{module="cp",type="cp340"} 1"#,
            r#"ob1_driver_losses_total{module="cp",type="cp340"} 1"#,
            r#"ob1_line_ready{module="cp",type="cp340"} 0"#,
            r#"ob1_cp_total{module="cp",counter="telegrams_sent"} 7"#,
            r#"ob1_cp_total{module="cp",counter="ended_07h"} 2"#,
            r#"ob1_order_stage_seconds_bucket{module="cp",kind="order",stage="taken",le="0.00001"} 1"#,
            r#"ob1_order_stage_seconds_count{module="cp",kind="order",stage="taken"} 3"#,
            r#"ob1_order_stage_seconds_sum{module="cp",kind="order",stage="taken"} 0.00006"#,
            r#"ob1_cp_reason{module="cp",reason="order_failed"} 1"#,
            r#"ob1_led{module="cp",led="TXD"} 1"#,
            r#"ob1_link_up{link="figures"} 0"#,
            r#"ob1_memory_bytes{kind="resident"} 2048"#,
            r#"ob1_diagnostic_events_total{event="4302h",change="run"} 2"#,
            "ob1_retentive_age_seconds 5",
            "ob1_cycle_stands_seconds 4",
            "ob1_engine_lacking 1",
            r#"ob1_cp_buffer_entries{module="cp"} 2"#,
        ] {
            assert!(text.lines().any(|told| told == line), "{line}\n{text}");
        }
        assert!(text.ends_with("# EOF\n"));
    }

    /// Each sample belongs to the family above it, and no family comes twice, as strict parsers require.
    #[test]
    fn every_sample_stands_under_its_family() {
        let text = figures(&told(), &Counts::default(), Format::OpenMetrics);
        let (mut families, mut current) = (Vec::new(), String::new());
        for line in text.lines().filter(|line| *line != "# EOF") {
            if let Some(rest) = line.strip_prefix("# TYPE ") {
                current = rest.split(' ').next().expect("a name").to_owned();
                assert!(!families.contains(&current), "{current} twice");
                families.push(current.clone());
            } else if !line.starts_with('#') {
                let name = line.split(['{', ' ']).next().expect("a name");
                let suffix = name.strip_prefix(current.as_str()).unwrap_or("?");
                assert!(["", "_total", "_info", "_bucket", "_sum", "_count"].contains(&suffix), "{line}");
                assert!(line.rsplit(' ').next().is_some_and(|value| value.parse::<f64>().is_ok()), "{line}");
            }
        }
        assert!(families.len() > 30);
    }

    /// The same samples, with the types that the older format has.
    #[test]
    fn the_older_format_has_the_same_samples() {
        let [new, old] = [Format::OpenMetrics, Format::Text].map(|format| figures(&told(), &Counts::default(), format));
        let samples = |text: &str| -> Vec<String> {
            text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
        };
        assert_eq!(samples(&new), samples(&old));
        assert!(!old.contains("# EOF") && !old.contains("# UNIT"), "{old}");
        for line in [
            "# TYPE ob1_station_info gauge",
            "# TYPE ob1_cpu_state gauge",
            "# TYPE ob1_scans_total counter",
            "# TYPE ob1_scan_cycle_seconds histogram",
            "# HELP ob1_scans_total finished cycles in RUN",
        ] {
            assert!(old.lines().any(|told| told == line), "{line}\n{old}");
        }
        let kinds: Vec<&str> = old.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').nth(1)).collect();
        assert!(kinds.len() > 30 && kinds.iter().all(|kind| ["counter", "gauge", "histogram"].contains(kind)));
    }
}
