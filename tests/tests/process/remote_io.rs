//! A station with inputs and outputs in an independent coupler: pymodbus over TCP (`tests/peers/coupler.py`).

use std::time::{Duration, Instant};

use ob1_station::access::protocol::Op;
use ob1_tests::siege::{is_campaign, rounds};
use ob1_timing::Class;
use rustix::process::Signal;
use serde_json::json;

use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::steps::Steps;
use crate::common::terminal::Terminal;
use crate::common::{Guard, checkout, program, python};

/// The running coupler.
struct Coupler {
    steps: Steps,
    port: u16,
}

impl Coupler {
    fn start(site: &Site, port: u16) -> Self {
        let mut command = site.command(python());
        command.arg(checkout("tests/peers/coupler.py")).args(["--port", &port.to_string()]);
        let (steps, first) = Steps::start(&mut command);
        Self { steps, port: first["port"].as_u64().expect("a port") as u16 }
    }

    /// Sets an input register.
    fn sense(&mut self, at: u16, value: u16) {
        self.steps.ask(&json!({ "set": [4, at, [value]] }));
    }

    /// A holding register, which the station writes.
    fn driven(&mut self, at: u16) -> i64 {
        self.steps.ask(&json!({ "get": [3, at, 1] }))["values"][0].as_i64().expect("a number")
    }

    fn until_driven(&mut self, at: u16, value: i64) {
        let guard = Guard::begin();
        while self.driven(at) != value {
            assert!(!guard.is_over(), "holding register {at} is not {value} but {}", self.driven(at));
        }
    }
}

/// A station and its coupler, whose outputs follow its inputs.
struct Plant {
    station: Running,
    coupler: Coupler,
    site: Site,
}

impl Plant {
    /// Starts both, with the initial input of the coupler.
    fn at_work(program: &str, sensed: u16) -> Self {
        let site = Site::new();
        let coupler = Coupler::start(&site, 0);
        let station = station(&site, coupler.port, program);
        let mut plant = Self { station, coupler, site };
        plant.follows(sensed);
        plant
    }

    /// Sets the input, and waits until the output is one more.
    fn follows(&mut self, sensed: u16) {
        self.coupler.sense(0, sensed);
        self.coupler.until_driven(100, i64::from(sensed) + 1);
    }
}

const OB1: &str = "ORGANIZATION_BLOCK OB 1\nBEGIN\n  L EW 0;\n  L 1;\n  +I;\n  T AW 0;\nEND_ORGANIZATION_BLOCK\n";
/// Counts its calls, and stores the last event.
const OB86: &str = "ORGANIZATION_BLOCK OB 86\nVAR_TEMP\n  CLASS : BYTE;\n  ID : BYTE;\n  REST : ARRAY [1..18] OF BYTE;\n\
    END_VAR\nBEGIN\n  L MW 10;\n  L 1;\n  +I;\n  T MW 10;\n  L #CLASS;\n  T MB 12;\n  L #ID;\n  T MB 13;\n\
    END_ORGANIZATION_BLOCK\n";

/// A station that writes input register 0 plus one to holding register 100.
fn station(site: &Site, port: u16, program: &str) -> Running {
    site.write("line.awl", program);
    let toml = format!(
        r#"[station]
name = "line"
[cpu]
min_cycle = "5ms"
watchdog = "500ms"
[program]
sources = ["line.awl"]
[[bus]]
name = "field"
type = "modbus-tcp"
line = "tcp:127.0.0.1:{port}"
[[module]]
type = "coupler"
bus = "field"
name = "rio"
inputs = [{{ at = "EB 0", from = "input:0", registers = 1, substitute = [3, 232] }}]
outputs = [{{ at = "AB 0", to = "holding:100", registers = 1 }}]
on_loss = "substitute"
lost_after = "2s"
"#
    );
    site.write("line.toml", &toml);
    site.run("line.toml").until_run()
}

#[test]
fn what_the_coupler_senses_goes_through_ob_1_and_back_and_stop_switches_it_off() {
    let mut plant = Plant::at_work(&[OB1, OB86].concat(), 41);
    plant.follows(7);
    plant.follows(30_000);
    plant.site.ob1(&["ctl", "line.toml", "stop"]).fine();
    plant.coupler.until_driven(100, 0);
    plant.site.ob1(&["ctl", "line.toml", "run"]).fine();
    plant.coupler.until_driven(100, 30_001);
    let Plant { station, mut coupler, site: _site } = plant;
    assert_eq!(station.cell("MW10"), 0, "nobody was lost: {:#?}", station.diagnostics());
    assert_eq!(station.interrupt().code(), Some(0));
    assert_eq!(coupler.driven(100), 0, "the process of the bus has switched off before it ended");
}

#[test]
fn a_coupler_that_is_gone_is_lost_once_and_comes_back_by_itself() {
    let mut plant = Plant::at_work(&[OB1, OB86].concat(), 41);
    plant.coupler.steps.kill();
    plant.station.until("OB 86 for the loss", |s| (s.cell("MW12") == 0x39C4).then_some(()));
    assert_eq!(plant.station.cells(&["MW10", "EW0"]), [1, 1000], "once, and the substitute");
    plant.coupler = Coupler::start(&plant.site, plant.coupler.port);
    plant.coupler.sense(0, 5);
    plant.station.until("OB 86 for the return", |s| (s.cell("MW12") == 0x38C4).then_some(()));
    plant.coupler.until_driven(100, 6);
    assert_eq!(plant.station.cell("MW10"), 2, "{:#?}", plant.station.diagnostics());
    assert_eq!(plant.station.interrupt().code(), Some(0));
}

#[test]
fn without_ob_86_a_lost_coupler_is_stop() {
    let mut plant = Plant::at_work(OB1, 41);
    plant.coupler.steps.kill();
    let station = &plant.station;
    station.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    assert_eq!((station.entries("39C4h"), station.entries("456Fh")), (1, 1), "{:#?}", station.diagnostics());
}

/// A killed process of the bus causes one failure, and is restarted at once. `cargo xtask siege bus`: 200 times.
#[test]
fn bus() {
    let rounds = i64::try_from(rounds(5)).expect("as many as MW 10 counts");
    let mut plant = Plant::at_work(&[OB1, OB86].concat(), 41);
    let mut times = Vec::new();
    for kill in 1..=rounds {
        let station = &plant.station;
        let begin = Instant::now();
        station.driver_process_of("rio").signal(Signal::KILL);
        station.until("a failure and a return", |s| (s.cell("MW10") == 2 * kill).then_some(()));
        times.push(begin.elapsed());
        assert_eq!(station.cell("MW12"), 0x38C4);
        plant.follows(100 * (kill % 100 + 1) as u16);
    }
    times.sort_unstable();
    let (median, longest) = (times[times.len() / 2], times[times.len() - 1]);
    let status = plant.station.status();
    let timing = plant.station.ask(Op::Timing { histograms: false }).expect("never refused").timing;
    // The causes of late scans according to the kernel: never the exchange with the modules.
    let late = timing.expect("an answer to timing").late;
    let driver = late.classes.get(&Class::Driver).map_or(0, |class| class.scans);
    println!(
        "{rounds} times killed, exchange back after {median:?} (median), {longest:?} at most; of {} scans {} were late, \
         {driver} of them because of the bus",
        status.scans, late.scans
    );
    assert_eq!((status.state.as_str(), status.watchdogs), ("RUN", 0));
    assert!(!is_campaign() || longest < Duration::from_secs(1) && driver == 0, "too long, or scans were late");
    assert_eq!(plant.station.cell("MW10"), 2 * rounds, "{:#?}", plant.station.diagnostics());
    assert_eq!(plant.station.interrupt().code(), Some(0));
}

#[test]
fn who_commissions_sees_the_coupler_and_its_telegrams() {
    let plant = Plant::at_work(&[OB1, OB86].concat(), 41);
    let shown = plant.site.ob1(&["bus", "watch", "line.toml", "--count", "2", "--every", "50ms"]).fine();
    for part in ["field  modbus-tcp  process ", "1 of 1 exchange", "outputs driven", "E 0: 0029  A 0: 002A"] {
        assert!(shown.contains(part), "{part}\n{shown}");
    }
    let said = plant.site.ob1(&["trace", "line.toml", "field.bus", "--for", "2s"]).fine();
    for part in ["field.bus: modbus-tcp, tcp:127.0.0.1:", "request: read input words (04h), 1 from 0"] {
        assert!(said.contains(part), "{part}\n{said}");
    }
    let wrong = plant.site.ob1(&["trace", "line.toml", "feld"]);
    assert!(wrong.code == Some(1) && wrong.err.contains("there are: field.bus"), "{wrong:?}");
    assert_eq!(plant.station.interrupt().code(), Some(0));
}

/// `ob1 bus watch` and page 5 of `ob1 top` show the coupler on a terminal, live; they restore the terminal.
#[test]
fn on_a_terminal_the_coupler_is_shown_live_until_q() {
    let mut plant = Plant::at_work(&[OB1, OB86].concat(), 41);
    for (args, keys, quit) in [
        (&["bus", "watch", "line.toml", "--every", "100ms"][..], &b""[..], &b"q"[..]),
        (&["bus", "watch", "line.toml", "--bus", "field", "--every", "100ms"], b"", b"\x1b"),
        (&["bus", "watch", "line.toml", "--every", "100ms"], b"", b"\x03"),
        (&["top", "line.toml", "--every", "100ms"], b"5", b"q"),
    ] {
        plant.follows(41);
        let mut terminal = Terminal::start(plant.site.command(program("ob1")).args(args), (24, 100));
        // Keys before it reads single keys would be read as a line.
        terminal.until("the screen", |screen| !screen.trim().is_empty());
        assert!(terminal.is_raw(), "{args:?}");
        terminal.press(keys);
        terminal.until("the coupler", |screen| {
            ["field  modbus-tcp", "1 of 1 exchange", "rio", "E 0: 0029  A 0: 002A"]
                .iter()
                .all(|part| screen.contains(part))
        });
        plant.follows(0x1233);
        terminal.until("what has changed", |screen| screen.contains("E 0: 1233  A 0: 1234"));
        // Smaller, then larger: nothing remains of the old content.
        terminal.resize(10, 60);
        terminal.until("a small terminal", |screen| screen.contains("field  modbus-tcp"));
        terminal.resize(30, 120);
        terminal.until("a large one", |screen| screen.matches("E 0: 1233  A 0: 1234").count() == 1);
        terminal.press(quit);
        assert_eq!(terminal.end().code(), Some(0), "{args:?}");
    }
    // The view ends with the station.
    let mut command = plant.site.command(program("ob1"));
    let mut terminal = Terminal::start(command.args(["bus", "watch", "line.toml", "--every", "50ms"]), (24, 100));
    terminal.until("the screen", |screen| screen.contains("field  modbus-tcp"));
    assert_eq!(plant.station.interrupt().code(), Some(0));
    assert_eq!(terminal.end().code(), Some(0));
}

#[test]
fn a_killed_runtime_leaves_no_output_on() {
    let Plant { station, mut coupler, site: _site } = Plant::at_work(&[OB1, OB86].concat(), 41);
    station.kill();
    coupler.until_driven(100, 0);
}

/// `tests/peers/modbus.py` on the pty that the process of the bus creates: input word n is 1000h + n.
#[test]
fn pymodbus_is_a_coupler_on_a_serial_line() {
    let site = Site::new();
    site.write("line.awl", &[OB1, OB86].concat());
    let toml = r#"[station]
name = "line"
[cpu]
min_cycle = "5ms"
watchdog = "500ms"
[program]
sources = ["line.awl"]
[[bus]]
name = "wires"
type = "modbus-rtu"
line = "pty:rtu.pty"
parity = "none"
[[module]]
type = "coupler"
bus = "wires"
unit = 5
name = "rio"
inputs = [{ at = "EB 0", from = "input:7", registers = 1 }]
outputs = [{ at = "AB 0", to = "holding:3", registers = 1 }]
lost_after = "20s"
"#;
    site.write("line.toml", toml);
    let station = site.run("line.toml").until_run();
    station.until("the pty", |_| site.path("rtu.pty").exists().then_some(()));
    let mut command = site.command(python());
    command.arg(checkout("tests/peers/modbus.py")).args(["slave", "pymodbus"]).arg(site.path("rtu.pty"));
    command.args(["--mode", "rtu", "--baud", "19200", "--address", "5"]);
    let (mut slave, first) = Steps::start(&mut command);
    assert_eq!(first["ready"], true);
    station.until("the input", |s| (s.cells(&["EW0", "AW0"]) == [0x1007, 0x1008]).then_some(()));
    // The last write is answered long before the end of these scans.
    station.scans(400);
    assert_eq!(slave.finish()["words"][3], 0x1008);
    assert_eq!(station.interrupt().code(), Some(0));
}
