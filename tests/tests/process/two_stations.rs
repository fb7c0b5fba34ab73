//! Both stations of the demo as real processes: telegrams, requests from outside, STOP and RUN, and an end without
//! remains.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;

use ob1_backplane::{IoField, layout};
use serde_json::{Value, json};

use crate::common::ledger::{self, Ledger};
use crate::common::processes::Memory;
use crate::common::site::{Site, demo_station, replaced};
use crate::common::station::Running;

/// Address of the lamps of [`with_lamps`]: after the CP's 16 bytes.
const LAMPS: usize = 16;

/// Adds a digital output module with outputs to switch off.
fn with_lamps(text: String) -> String {
    text + "\n[[module]]\ntype = \"do\"\nname = \"lamps\"\naddress = 16\nbytes = 1\n"
}

fn start(site: &Site) -> (Running, Running) {
    let (a, b) = (site.run("station-a.toml"), site.run("station-b.toml"));
    (a.until_run(), b.until_run())
}

fn lamps(image: &IoField) -> u8 {
    let mut byte = [0];
    assert_eq!(image.read_outputs(LAMPS, &mut byte), 1);
    byte[0]
}

/// The blocks that came twice from one station to the other: on a machine that holds a driver up for longer than QVZ,
/// the partner repeats a block that had arrived. Nothing else may bring a telegram twice.
fn repeated(from: &Running, to: &Running) -> i64 {
    to.counter("telegrams_received") - from.counter("telegrams_sent")
}

/// The checks of the demo's verdict, with both stations idle.
fn assert_sound((a, of_a): (&Running, &Ledger), (b, of_b): (&Running, &Ledger)) {
    let (there, back) = (repeated(a, b), repeated(b, a));
    let (a, b) = (of_a, of_b);
    let all = format!("{a:?}\n{b:?}\nrepeated {there} and {back}");
    for column in ["ERROR", "ABORTED", "WRONG", "LATE", "LOST", "PAFE_SEND", "PAFE_RECEIVE"] {
        assert_eq!(a[column], 0, "{column}: {all}");
    }
    for column in ["ERROR", "ABORTED", "TOO_LONG", "PAFE_SEND", "PAFE_RECEIVE"] {
        assert_eq!(b[column], 0, "{column}: {all}");
    }
    assert_eq!((a["DONE"], a["GOOD"]), (a["STARTED"], a["STARTED"]), "{all}");
    assert_eq!((b["RECEIVED"], b["DONE"]), (a["DONE"] + there, b["STARTED"]), "{all}");
    // B does not send back what comes while another telegram waits.
    assert_eq!((b["STARTED"], a["DOUBLED"]), (b["RECEIVED"] - b["BUSY"], there + back - b["BUSY"]), "{all}");
    assert!(b["BUSY"] <= there, "{all}");
}

#[test]
fn telegrams_flow_and_nothing_is_left_behind() {
    let site = Site::two_stations();
    site.write("station-a.toml", &demo_station("station-a.toml", with_lamps));
    // The wait for an echo is long enough for a busy machine.
    let program = fs::read_to_string(site.path("a.awl")).expect("a file of the demo");
    site.write("a.awl", &replaced(&program, "S5T#3S", "S5T#30S"));
    let (a, b) = start(&site);
    ledger::flow(&a, 300);
    let (of_a, of_b) = ledger::rest(&a, &b);
    assert_sound((&a, &of_a), (&b, &of_b));
    assert!(of_a["GOOD"] >= 300 && of_a["SYNCS"] == 1 && of_b["SYNCS"] == 1, "{of_a:?}\n{of_b:?}");
    ledger::pause(&a, false);

    // Ctrl-C while telegrams are transferred and a lamp is on.
    a.set("AB16", 0xA5);
    let image = IoField::open(&a.rundir.join("io")).expect("the image of the process I/O");
    a.until("the lamps are lit", |_| (lamps(&image) == 0xA5).then_some(()));
    let drivers = [a.driver_process(), b.driver_process()];
    let memories = [a.rundir.join("cp.segment"), a.rundir.join("io"), b.rundir.join("cp.segment")];
    let memories = memories.map(|link| Memory::behind(&link));
    assert!(memories.iter().all(|memory| !memory.holders().is_empty()));
    let segment = fs::metadata(a.rundir.join("cp.segment")).expect("there").len();
    assert_eq!(segment, layout::SEGMENT_BYTES as u64, "a CP without boxes has no memory for them");
    assert!(fs::symlink_metadata(site.path("null-modem.pty")).is_ok());
    let rundirs = [a.rundir.clone(), b.rundir.clone()];
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
        assert!(ended.out.contains("ended by a signal"), "{ended:?}");
    }
    assert_eq!(lamps(&image), 0, "outputs are off");
    drop(image);
    assert!(drivers.iter().all(|driver| driver.has_ended()), "a runtime ends after its drivers");
    assert_eq!(rundirs.map(|dir| dir.exists()), [false, false]);
    assert!(fs::symlink_metadata(site.path("null-modem.pty")).is_err());
    assert!(site.processes().is_empty());
    for memory in memories {
        memory.wait_until_free();
    }
}

#[test]
fn a_way_from_stop_to_run_sends_the_parameters_again() {
    let site = Site::two_stations();
    let (a, b) = start(&site);
    for (round, command) in ["run", "warm"].into_iter().enumerate() {
        ledger::flow(&a, 20);
        let (_, starts, _) = a.driver();
        let syncs = a.cell("DB20.SYNCS");
        site.ob1(&["ctl", &a.file, "stop"]).fine();
        a.until("STOP", |a| (a.status().state == "STOP").then_some(()));
        let stopped = (a.status().scans, Ledger::of_a(&a));
        // The partner continues to scan, and nothing changes here.
        b.scans(300);
        assert_eq!((a.status().scans, Ledger::of_a(&a)), stopped);
        site.ob1(&["ctl", &a.file, command]).fine();
        a.until("RUN", |a| (a.status().state == "RUN").then_some(()));
        ledger::flow(&a, 20);
        assert_eq!(a.cell("DB20.SYNCS"), syncs + 1, "one start-up more, round {round}");
        assert_eq!(a.driver().1, starts, "the same driver");
    }
    assert_eq!(a.entries("4304h"), 2, "STOP by operator");

    // A cold restart resets the data blocks: an echo still under way would be one of a telegram never sent.
    ledger::rest(&a, &b);
    site.ob1(&["ctl", &a.file, "stop"]).fine();
    a.until("STOP", |a| (a.status().state == "STOP").then_some(()));
    site.ob1(&["ctl", &a.file, "cold"]).fine();
    a.until("RUN", |a| (a.status().state == "RUN").then_some(()));
    ledger::flow(&a, 20);
    assert_eq!(a.cell("DB20.SYNCS"), 1);

    let (of_a, of_b) = ledger::rest(&a, &b);
    assert_eq!((of_a["WRONG"], of_a["PAFE_SEND"], of_a["PAFE_RECEIVE"]), (0, 0, 0), "{of_a:?}\n{of_b:?}");
    assert_eq!((of_b["PAFE_SEND"], of_b["PAFE_RECEIVE"]), (0, 0), "{of_a:?}\n{of_b:?}");
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
}

#[test]
fn cells_are_read_and_written_from_outside() {
    let site = Site::two_stations();
    let a = site.run("station-a.toml").until_run();
    let file = a.file.clone();
    let get = |items: &[&str]| {
        let out = site.ob1(&[&["get", &file], items, &["--json"]].concat()).fine();
        let values: Vec<Value> = serde_json::from_str(&out).expect("a JSON array");
        values.iter().map(|cell| cell["value"].clone()).collect::<Value>()
    };

    site.ob1(&["set", &file, "M200.3=1", "MB201=16#A5", "MW202=-2", "MD204=L#-70000", "DB11.DBW20=W#16#1234"]).fine();
    assert_eq!(get(&["M200.3", "MB200", "MB201"]), json!([true, 8, 0xA5]));
    assert_eq!(get(&["MW202", "DB11.DBW20", "DB11.DBB21"]), json!([0xFFFE, 0x1234, 0x34]));
    assert_eq!(get(&["MD204"]), json!([-70000i32 as u32]));
    // A component accessed by name is signed according to its type; accessed by address it is a plain double word.
    site.ob1(&["set", &file, "DB20.LOST=-5"]).fine();
    assert_eq!(get(&["DB20.LOST", "DB20.DBD40"]), json!([-5, 0xFFFF_FFFBu32]));
    site.ob1(&["set", &file, "DB20.PAUSE=true"]).fine();
    assert_eq!(get(&["DB20.PAUSE", "DB20.DBX60.0"]), json!([true, true]));
    // Text output, with the station selected by its name.
    let text = site.ob1(&["get", &a.name, "MW202", "M200.3"]).fine();
    let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines, [vec!["MW202", "65534", "16#FFFE"], vec!["M200.3", "1"]]);

    // Refused with the reason, and nothing is written.
    for (verb, item, reason) in [
        ("get", "M999.0", "M999.0"),
        ("get", "DB20.NIX", "DB20 has no component NIX"),
        ("get", "DB77.DBW0", "DB77"),
        ("get", "FOO", "FOO"),
        ("set", "MB201=256", "256"),
        ("set", "M200.3=maybe", "maybe"),
        ("set", "DB20.DBW4000=1", "DB20.DBW4000"),
    ] {
        let said = site.ob1(&[verb, &file, item]);
        assert_eq!(said.code, Some(8), "{item}: {said:?}");
        assert!(said.err.starts_with("ob1: ") && said.err.contains(reason), "{item}: {said:?}");
    }
    let said = site.ob1(&["set", &file, "MB201=1", "MW202=70000"]);
    assert_eq!((said.code, get(&["MB201"])), (Some(8), json!([0xA5])), "{said:?}");
    assert_eq!(site.ob1(&["set", &file, "MB201"]).code, Some(1), "no assignment");

    // Other users have no access.
    let mode = |name: &str| fs::metadata(a.rundir.join(name)).expect("there").permissions().mode() & 0o777;
    assert_eq!((mode("."), mode("control.sock")), (0o700, 0o600));

    let status: Value = serde_json::from_str(&site.ob1(&["ctl", &file, "status", "--json"]).fine()).expect("JSON");
    assert_eq!((&status["state"], &status["pid"]), (&json!("RUN"), &json!(a.process.pid)));
    let diag: Value = serde_json::from_str(&site.ob1(&["diag", &file, "--json"]).fine()).expect("JSON");
    let oldest = diag["cpu"].as_array().and_then(|entries| entries.last()).expect("an entry");
    assert_eq!((&oldest["number"], &oldest["event"]), (&json!(1), &json!("4301h")));

    assert_eq!(a.interrupt().code(), Some(0));
    let said = site.ob1(&["get", &file, "MB201"]);
    assert!(said.code == Some(5) && said.err.contains("does not run"), "{said:?}");
}
