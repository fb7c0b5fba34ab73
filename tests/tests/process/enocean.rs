//! EnOcean as real processes: the manual's program with a TCM 120 on its line, the CP on a gateway's serial port, and
//! the foreign library eltako14bus instead of the module and of the CPU. [S1 "Beispiel zum Einsatz unter EnOcean"]

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

use ob1_tests::awlsim::{Awlsim, STOP, Scratch};
use rustix::fs::{Mode, OFlags, open};
use rustix::termios::{ControlModes, tcgetattr};
use serde_json::{Value, json};

use crate::common;
use crate::common::processes::Watched;
use crate::common::site::{Site, replaced};
use crate::common::station::Running;
use crate::common::{checkout, python};

const LINE: &str = "radio.pty";

/// The telegram that FC 101 sends.
const FC_101: &str = "send RPS FF8000E7 buttons 0 released, repeated 6";

/// Starts a station of the example with its own line.
fn station(site: &Site, file: &str, line: &str) -> Running {
    for entry in fs::read_dir(checkout("examples/enocean-switch")).expect("the example") {
        let path = entry.expect("a file of the example").path();
        fs::copy(&path, site.path(path.file_name().expect("a name"))).expect("room for a file");
    }
    let text = fs::read_to_string(site.path(file)).expect("a station file");
    let text = replaced(&replaced(&text, "\"150ms\"", "\"500ms\""), &format!("pty:{LINE}"), line);
    site.write(file, &text);
    // A busy machine may delay a telegram by more than 100 ms; the window itself is tested in virtual time.
    let filter = fs::read_to_string(site.path("eo_filter.awl")).expect("the filter");
    site.write("eo_filter.awl", &replaced(&filter, "T#100MS", "T#1H"));
    site.run(file).until_run()
}

fn end(station: Running, site: &Site) {
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    site.wait_until_empty();
}

/// A program that reads and prints lines.
struct Talker {
    process: Watched,
    child: Child,
    input: Option<ChildStdin>,
    out: PathBuf,
}

impl Talker {
    fn start(site: &Site, mut command: Command, name: &str) -> Self {
        let out = site.path(format!("{name}.out"));
        command.stdin(Stdio::piped()).stdout(File::create(&out).expect("room for a file"));
        let mut child = command.spawn().expect("the program starts");
        let process = Watched::find(child.id()).expect("a child, living or dead, is there until it is waited for");
        let input = child.stdin.take();
        Self { process, child, input, out }
    }

    fn tcm120(site: &Site, line: &str) -> Self {
        let mut command = site.command(env!("CARGO_BIN_EXE_tcm120"));
        command.arg(line);
        Self::start(site, command, "tcm120")
    }

    fn eltako(site: &Site, role: &str, tty: &Path) -> Self {
        let mut command = site.command(python());
        command.arg(checkout("tests/peers/eltako.py")).arg(role).arg(tty);
        Self::start(site, command, &format!("eltako-{role}"))
    }

    fn give(&mut self, line: &str) {
        let input = self.input.as_mut().expect("open until the end");
        writeln!(input, "{line}").expect("a program that reads");
    }

    /// The complete lines of its output so far.
    fn said(&self) -> Vec<String> {
        assert!(!self.process.has_ended(), "{} has ended", self.out.display());
        let text = fs::read_to_string(&self.out).unwrap_or_default();
        text.split_inclusive('\n').filter_map(|line| Some(line.strip_suffix('\n')?.to_owned())).collect()
    }

    /// The telegrams decoded by eltako14bus.
    fn heard(&self) -> Vec<Value> {
        let events = self.said().into_iter().map(|line| serde_json::from_str::<Value>(&line).expect("an event"));
        events.filter(|event| event["event"] == "heard").collect()
    }

    fn end(mut self) {
        drop(self.input.take());
        self.process.wait("its end");
        assert!(self.child.wait().expect("a child that has ended").success());
    }
}

/// Calls FC 101 once.
fn send(station: &Running) {
    station.set("DB10.DBX15.7", 1);
    station.until("FRG is taken back", |s| (s.cell("DB10.DBX15.7") == 0).then_some(()));
}

/// RESET of FC 9: the CP requests the ID base again.
fn reset(station: &Running) {
    station.set("M3.2", 1);
    station.until("FC 9", |s| (s.cells(&["M3.0", "M3.2"]) == [0, 0]).then_some(()));
}

/// Calls FC 102 with this telegram.
fn command(station: &Running, telegram: &str) {
    for (n, byte) in telegram.split(' ').enumerate() {
        station.set(&format!("DB12.TELEGRAM[{n}]"), i64::from_str_radix(byte, 16).expect("a byte"));
    }
    station.set("DB12.START", 1);
    station.until("FRG is taken back", |s| (s.cell("DB12.START") == 0).then_some(()));
    assert_eq!(station.cell("DB12.FEHLER_KOM"), 0, "{telegram}");
}

/// Waits for a telegram in DB 11.
fn received(station: &Running, telegram: &str) {
    let names: Vec<String> = (0..11).map(|n| format!("DB11.DBB{n}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let shown = |s: &Running| s.cells(&names).iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(" ");
    station.until(telegram, |s| (shown(s) == telegram).then_some(()));
}

fn light(station: &Running, on: bool) {
    station.until("the light", |s| (s.cell("A0.0") == i64::from(on)).then_some(()));
}

#[test]
fn the_manual_s_light_switch() {
    let site = Site::new();
    let station = station(&site, "station.toml", &format!("pty:{LINE}"));
    station.until("the pty", |_| site.path(LINE).exists().then_some(()));
    let mut module = Talker::tcm120(&site, &format!("serial:{}", site.path(LINE).display()));
    station.until("the module", |_| module.said().contains(&"line up".to_owned()).then_some(()));
    // The reset line; FC 9 has ended when the last of its fifteen lines has arrived.
    station.until("FC 9", |s| (s.cell("M3.0") == 0).then_some(()));
    module.give("reset");
    received(&station, "8B 89 4F 4B 00 00 00 00 00 00 00");
    module.give("press 00121c7a BI");
    light(&station, true);
    module.give("press 00121c7a BO");
    light(&station, false);
    send(&station);
    // The module may have started too late for the request of its ID base.
    reset(&station);
    send(&station);
    station.until("it is sent", |_| module.said().iter().any(|line| line == FC_101).then_some(()));
    module.end();
    end(station, &site);
}

/// The button that switches on and off, with a repeater.
#[test]
fn a_button_and_a_repeater() {
    let site = Site::new();
    let pty = site.path(LINE);
    let mut module = Talker::tcm120(&site, &format!("pty:{}", pty.display()));
    let station = station(&site, "toggle.toml", &format!("serial:{}", pty.display()));
    station.until("FC 9", |s| (s.cell("M3.0") == 0).then_some(()));
    for presses in 1..=5 {
        for copy in ["", " repeat 1", " repeat 2"] {
            module.give(&format!("press 00121c7a AI{copy}"));
        }
        let seen = |s: &Running| s.cell("DB20.TELEGRAMS") == 3 * presses;
        station.until("all copies are heard", |s| seen(s).then_some(()));
        assert_eq!(station.cells(&["DB20.PRESSED", "A0.0"]), [presses, presses % 2], "{presses} presses");
    }
    assert_eq!(station.cell("DB110.DISCARDED"), 10);
    module.end();
    end(station, &site);
}

/// A gateway with ESP2 on a serial port: opened with 9600 8N1, and the ID base is requested.
#[test]
fn a_gateway_on_a_serial_port() {
    let site = Site::new();
    let pty = site.path("gateway.pty");
    let mut gateway = Talker::tcm120(&site, &format!("pty:{}", pty.display()));
    let station = station(&site, "station.toml", &format!("serial:{}", pty.display()));
    station.until("FC 9", |s| (s.cell("M3.0") == 0).then_some(()));
    let tty = open(&pty, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).expect("the gateway's tty");
    let settings = tcgetattr(&tty).expect("its settings");
    assert_eq!((settings.input_speed(), settings.output_speed()), (9600, 9600));
    assert_eq!(settings.control_modes & ControlModes::CSIZE, ControlModes::CS8);
    assert!(!settings.control_modes.intersects(ControlModes::PARENB | ControlModes::CSTOPB));
    drop(tty);
    command(&station, "AB 58");
    received(&station, "8B 98 FF 80 00 80 00 00 00 00 00");
    gateway.give("4bs 01020304 0a 0b 0c 08 repeat 1");
    received(&station, "0B 07 0A 0B 0C 08 01 02 03 04 01");
    send(&station);
    station.until("it is sent", |_| gateway.said().iter().any(|line| line == FC_101).then_some(()));
    gateway.end();
    end(station, &site);
}

/// eltako14bus instead of the module: its ID base is requested, its telegrams are received, and it decodes ours.
#[test]
fn eltako14bus_is_the_module() {
    let site = Site::new();
    let station = station(&site, "station.toml", &format!("pty:{LINE}"));
    station.until("the pty", |_| site.path(LINE).exists().then_some(()));
    let mut module = Talker::eltako(&site, "module", &site.path(LINE));
    station.until("FC 9", |s| (s.cell("M3.0") == 0).then_some(()));
    station.until("the library", |_| (!module.said().is_empty()).then_some(()));
    // It may have started too late for the first request.
    let asked = |m: &Talker| m.heard().iter().filter(|e| e["bytes"] == format!("ab58{}", "00".repeat(9))).count();
    let before = asked(&module);
    reset(&station);
    station.until("RD_IDBASE", |_| (asked(&module) > before).then_some(()));

    let rps = |data: &str| json!({"org": "rps", "id": "00121c7a", "data": data, "status": 0x30}).to_string();
    module.give(&rps("50"));
    light(&station, true);
    module.give(&rps("70"));
    light(&station, false);
    module.give(&json!({"org": "4bs", "id": "01020304", "data": "0a0b0c08", "status": 1}).to_string());
    received(&station, "0B 07 0A 0B 0C 08 01 02 03 04 01");
    module.give(&json!({"org": "1bs", "id": "01020305", "data": "09", "status": 0}).to_string());
    received(&station, "0B 06 09 00 00 00 01 02 03 05 00");

    // The last seven bits are from us, the rest is its ID base.
    let next = |what: &str| {
        let known = module.heard().len();
        command(&station, what);
        station.until(what, |_| module.heard().get(known).cloned())
    };
    let radio = next("6B 07 01 02 03 08 00 00 32 67 00");
    assert_eq!((&radio["telegram"], &radio["outgoing"]), (&json!("Regular4BSMessage"), &json!(true)), "{radio}");
    assert_eq!((&radio["address"], &radio["data"]), (&json!("ff8000e7"), &json!("01020308")), "{radio}");
    let radio = next("6B 06 09 00 00 00 00 00 00 01 00");
    assert_eq!((&radio["telegram"], &radio["address"]), (&json!("Regular1BSMessage"), &json!("ff800081")), "{radio}");
    let radio = next("6B 05 70 00 00 00 00 00 00 02 31");
    let seen = ["telegram", "data", "nu", "t21", "rp_count"].map(|name| radio[name].clone());
    assert_eq!(seen, [json!("RPSMessage"), json!("70"), json!("N"), json!(2), json!(1)], "{radio}");
    let known = module.heard().len();
    send(&station);
    let radio = station.until("FC 101", |_| module.heard().get(known).cloned());
    assert_eq!(radio["bytes"], "6b0502000000ff8000e706", "the manual's telegram");
    module.end();
    end(station, &site);
}

/// eltako14bus instead of the CPU, with our TCM 120 as the module.
#[test]
fn eltako14bus_asks_our_tcm_120() {
    let site = Site::new();
    let pty = site.path("module.pty");
    let mut module = Talker::tcm120(&site, &format!("pty:{}", pty.display()));
    let guard = common::Guard::begin();
    while !module.said().contains(&"line up".to_owned()) || !pty.exists() {
        assert!(!guard.is_over(), "no pty");
        module.process.ends_within(std::time::Duration::from_millis(5));
    }
    let mut control = Talker::eltako(&site, "control", &pty);
    let wait = |control: &Talker, module: &Talker, bytes: &str| loop {
        if control.heard().iter().any(|event| event["bytes"] == bytes) {
            return;
        }
        assert!(!guard.is_over(), "not {bytes}: {:?}, {:?}", control.said(), module.said());
        control.process.ends_within(std::time::Duration::from_millis(5));
    };
    control.give(&json!({"ask": "id_base"}).to_string());
    wait(&control, &module, "8b98ff8000800000000000");
    control.give(&json!({"ask": "version"}).to_string());
    wait(&control, &module, "8b8c010001100000000000");
    control.give(&json!({"org": "rps", "id": "00000001", "data": "50", "status": 48, "outgoing": true}).to_string());
    wait(&control, &module, "8b22000000000000000000");
    module.give("press 00121c7a AI repeat 1");
    wait(&control, &module, "0b051000000000121c7a31");
    control.end();
    module.end();
}

/// FB 110 on awlsim: (STATUS, ID, whether to discard).
#[test]
fn awlsim_runs_the_filter() {
    let table = [
        ("30", "121C7A", false),
        ("31", "121C7A", true),
        ("32", "121C7A", true),
        ("31", "121C7B", false),
        ("31", "121C7B", true),
        ("F1", "121C7A", true),
        ("30", "121C7A", false),
        ("11", "121C7A", false),
    ];
    let calls = table.iter().enumerate().map(|(n, (status, id, _))| {
        // awlsim ignores initial values of FB parameters, so WINDOW is supplied, long enough for a busy machine.
        format!(
            "CALL FB 110, DB 110 (NEW := TRUE, HEAD := W#16#0B05, DATA := DW#16#10000000, ID := DW#16#{id}, STATUS := B#16#{status}, \
             WINDOW := T#1H, REPEATED := M 0.{n});\n"
        )
    });
    let filter = fs::read_to_string(checkout("examples/enocean-switch/eo_filter.awl")).expect("the filter");
    let program = format!(
        "{filter}\nDATA_BLOCK DB 110\nFB 110\nBEGIN\nEND_DATA_BLOCK\nORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n{}{STOP}END_ORGANIZATION_BLOCK\n",
        calls.collect::<String>()
    );
    let scratch = Scratch::new("process-enocean").expect("room for a folder");
    let source = scratch.write("filter.awl", &program).expect("room for a file");
    let awlsim = Awlsim::find().expect("cargo xtask test installs it");
    let shown = awlsim.run(&source, 2).unwrap_or_else(|why| panic!("{why}"));
    let discarded: Vec<bool> = (0..8).map(|n| shown.memory[0] >> n & 1 == 1).collect();
    assert_eq!(discarded, table.map(|(_, _, discard)| discard));
}
