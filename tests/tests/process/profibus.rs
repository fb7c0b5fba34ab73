//! A station on PROFIBUS DP with an independent rack: `examples/et200m/slave.py` on the pty that the process of the bus
//! creates. Everything in `examples/et200m` is real here except the wires.

use ob1_station::access::protocol::Op;
use ob1_tests::siege::rounds;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::steps::Steps;
use crate::common::{Guard, checkout, python};

/// Inputs of all slots with this in the first word of the first module.
fn inputs(first: u16) -> String {
    format!("{first:04x}{}", "00".repeat(12))
}

/// The station of the example and its rack, exchanging data.
struct Plant {
    station: Running,
    rack: Steps,
    site: Site,
}

impl Plant {
    fn at_work() -> Self {
        let site = Site::new();
        for file in ["station.toml", "ET200M.GSD", "rack.awl"] {
            site.write(file, &std::fs::read_to_string(checkout("examples/et200m").join(file)).expect("an example"));
        }
        // A busy machine wakes Python late.
        let file = std::fs::read_to_string(site.path("station.toml")).expect("just written");
        let patient = [
            ("watchdog = \"200ms\"", "watchdog = \"5s\""),
            ("watchdog = \"500ms\"", "watchdog = \"5s\""),
            ("hsa = 3", "retries = 15\nhsa = 3"),
            ("station = 8", "lost_after = \"20s\"\nstation = 8"),
        ];
        let file = patient.iter().fold(file, |file, (from, to)| file.replace(from, to));
        site.write("station.toml", &file);
        let station = site.run("station.toml").until_run();
        station.until("the pty", |_| site.path("rack.pty").exists().then_some(()));
        let rack = rack(&site);
        let plant = Self { station, rack, site };
        plant.station.until("the counter goes through the rack", |s| (s.cell("MW12") > 0).then_some(()));
        plant
    }

    fn ask(&mut self, step: &Value) -> Value {
        self.rack.ask(step)
    }

    fn until_rack(&mut self, what: &str, fits: impl Fn(&Value) -> bool) {
        let guard = Guard::begin();
        loop {
            let said = self.ask(&json!({}));
            if fits(&said) {
                return;
            }
            assert!(!guard.is_over(), "{what}: {said}, {:#?}", self.station.diagnostics());
        }
    }
}

fn rack(site: &Site) -> Steps {
    let mut command = site.command(python());
    command.arg(checkout("examples/et200m/slave.py")).arg(site.path("rack.pty")).arg("--steps");
    let (rack, first) = Steps::start(&mut command);
    assert_eq!(first["ready"], true);
    rack
}

#[test]
fn the_rack_is_parametrised_and_exchanged_with_and_stop_switches_it_off() {
    let mut plant = Plant::at_work();
    plant.ask(&json!({ "inputs": inputs(0x1234) }));
    plant.station.until("the input", |s| (s.cell("MW12") == 0x1234).then_some(()));
    plant.site.ob1(&["ctl", "station.toml", "stop"]).fine();
    plant.until_rack("outputs off", |said| said["outputs"] == "0000000000000000");
    // In STOP data exchange continues, and the watchdog does not expire.
    let before = plant.ask(&json!({}))["exchanges"].as_u64().expect("a number");
    plant.until_rack("exchange in STOP", |said| said["exchanges"].as_u64() > Some(before + 50));
    assert_eq!(plant.ask(&json!({}))["state"], "exchange");
    plant.site.ob1(&["ctl", "station.toml", "run"]).fine();
    plant.until_rack("outputs on", |said| said["outputs"] != "0000000000000000");
    assert_eq!(plant.station.cell("MW20"), 0, "nobody was lost: {:#?}", plant.station.diagnostics());
    assert_eq!(plant.station.interrupt().code(), Some(0));
    assert_eq!(plant.rack.ask(&json!({}))["outputs"], "0000000000000000", "switched off before the process ended");
}

#[test]
fn a_wire_break_is_ob_82_and_its_diagnosis_is_read_by_sfc_13() {
    let mut plant = Plant::at_work();
    // Slot 5, channel 1: wire break.
    plant.ask(&json!({ "report": "4210844126" }));
    plant.station.until("OB 82", |s| (s.cell("MW30") == 1).then_some(()));
    assert_eq!(plant.station.cells(&["MW32", "MB50", "MW54", "MB58"]), [11, 8, 0x7F01, 0x84]);
    assert_eq!(plant.station.entries("F209h"), 1, "{:#?}", plant.station.diagnostics());
    let told = plant.station.diagnostics();
    let entry = told.iter().find(|entry| entry.event == "F209h").expect("just counted");
    assert!(format!("{entry:?}").contains("s5 c1 e6"), "{entry:?}");
    plant.ask(&json!({ "report": "" }));
    plant.station.until("OB 82 again", |s| (s.cell("MW30") == 2).then_some(()));
    assert_eq!(plant.station.entries("F20Ah"), 1);
    assert_eq!(plant.station.interrupt().code(), Some(0));
}

#[test]
fn a_rack_without_power_is_lost_once_and_returns_by_itself() {
    let mut plant = Plant::at_work();
    plant.ask(&json!({ "power": false }));
    plant.station.until("OB 86 for the loss", |s| (s.entries("39C4h") == 1).then_some(()));
    assert_eq!(plant.station.cells(&["MW20", "EW0"]), [1, 0]);
    plant.ask(&json!({ "power": true }));
    plant.station.until("OB 86 for the return", |s| (s.entries("38C4h") == 1).then_some(()));
    plant.until_rack("outputs on", |said| said["state"] == "exchange" && said["outputs"] != "0000000000000000");
    assert_eq!(plant.station.cell("MW20"), 2, "{:#?}", plant.station.diagnostics());
    // A module is removed: the configuration has changed.
    plant.ask(&json!({ "power": false }));
    plant.station.until("OB 86 for the loss", |s| (s.entries("39C4h") == 2).then_some(()));
    plant.ask(&json!({ "config": "51", "power": true }));
    plant.station.until("it refuses", |s| (s.entries("F207h") == 1).then_some(()));
    let told = format!("{:?}", plant.station.diagnostics());
    assert!(told.contains("config. fault"), "{told}");
    assert_eq!(plant.station.interrupt().code(), Some(0));
}

#[test]
fn what_goes_over_the_line_is_told_in_words() {
    let plant = Plant::at_work();
    let line =
        plant.station.ask(Op::Buses).expect("never refused").buses.expect("an answer to buses")[0].lines[0].clone();
    let said = plant.site.ob1(&["trace", "station.toml", &line, "--for", "2s"]).fine();
    for part in ["2 to 8, SRD high, Data_Exchange, ", "8 to 2, data"] {
        assert!(said.contains(part), "{part}\n{said}");
    }
    assert_eq!(plant.station.interrupt().code(), Some(0));
}

/// `ob1 bus scan` on a pty: the devices found, and the configured ones.
#[test]
fn a_scan_finds_the_rack_and_says_who_is_missing() {
    let site = Site::new();
    for name in ["station.toml", "ET200M.GSD", "rack.awl"] {
        site.write(name, &std::fs::read_to_string(checkout("examples/et200m").join(name)).expect("an example"));
    }
    let scan = std::thread::scope(|scope| {
        let scan = scope.spawn(|| site.ob1(&["bus", "scan", "station.toml", "--json"]));
        let guard = Guard::begin();
        while !site.path("rack.pty").exists() && !scan.is_finished() {
            assert!(!guard.is_over(), "no pty");
            std::thread::yield_now();
        }
        let _rack = (!scan.is_finished()).then(|| rack(&site));
        scan.join().expect("no panic")
    });
    let said: Value = serde_json::from_str(&scan.fine()).expect("JSON");
    assert_eq!(said[0]["station"], 8, "{said}");
    assert!(said[0]["name"].is_string(), "{said}");
}

/// A killed process of the bus causes one failure, and is restarted. `cargo xtask siege bus_dp`: 200 times.
/// (`simulation::buses` tests the time: here the test must connect the rack again each time.)
#[test]
fn bus_dp() {
    let rounds = usize::try_from(rounds(3)).expect("so many");
    let plant = Plant::at_work();
    let driven = |rack: &mut Steps| rack.ask(&json!({}))["outputs"] != "0000000000000000";
    // The buffer keeps only the newest 100 entries, so the calls of OB 86 are counted.
    for kill in 1..=rounds {
        plant.station.driver_process_of("et200m").signal(Signal::KILL);
        let calls = 2 * kill as i64;
        plant.station.until("the bus has failed", |s| (s.cell("MW20") == calls - 1).then_some(()));
        // The pty is a new one: connect the rack again.
        plant.station.until("the pty", |_| plant.site.path("rack.pty").exists().then_some(()));
        let mut rack = rack(&plant.site);
        plant.station.until("it is back", |s| (s.cell("MW20") == calls).then_some(()));
        plant.station.until("outputs on", |_| driven(&mut rack).then_some(()));
    }
    println!("{rounds} times killed, one failure and one return each");
    let status = plant.station.status();
    assert_eq!((status.state.as_str(), status.watchdogs), ("RUN", 0));
    assert_eq!(plant.station.interrupt().code(), Some(0));
}
