//! The diagnosis of a CP 341 with real processes: a TCP line that fails and recovers, OB 82, LEDs, `ob1 diag`, a killed
//! driver.

use std::net::{TcpListener, TcpStream};

use rustix::process::Signal;
use serde_json::Value;

use crate::common::diagnosis::{OB_1, OB_82, station};
use crate::common::site::Site;
use crate::common::station::Running;

/// The CP's buffer from `ob1 diag`, newest first: number, and whether it is incoming.
fn buffer(site: &Site) -> Vec<(String, bool)> {
    let told: Value = serde_json::from_str(&site.ob1(&["diag", "diag.toml", "cp", "--json"]).fine()).expect("JSON");
    assert_eq!(told.get("cpu"), None, "only the CP's buffer was asked for");
    let entries = told["cps"][0]["entries"].as_array().expect("a list");
    let entry = |entry: &Value| Some((entry["number"].as_str()?.to_owned(), entry["incoming"].as_bool()?));
    entries.iter().map(|e| entry(e).expect("number and incoming")).collect()
}

fn accept(listener: &TcpListener) -> TcpStream {
    listener.accept().expect("the driver connects, again and again").0
}

/// OB 82: number of incoming and outgoing interrupts.
fn interrupts(station: &Running) -> (i64, i64) {
    let cells = station.cells(&["DB90.DBD0", "DB90.DBD4"]);
    (cells[0], cells[1])
}

#[test]
fn a_line_that_breaks_is_told_and_can_be_read_afterwards() {
    let site = Site::new();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its number");
    site.write("ob1.awl", OB_1);
    site.write("ob82.awl", OB_82);
    let module = format!(
        "type = \"cp341\"\nline = \"tcp:{address}\"\ndiagnostics = true\nparams = {{ protocol = \"3964r\", baud = 9600 }}"
    );
    site.write("diag.toml", &station("diag", "\"ob1.awl\", \"ob82.awl\"", &module));
    let station = site.run("diag.toml").until_run();
    let line = accept(&listener);
    station.until("the line is up", |s| (s.status().modules[0].driver.as_ref()?.state == "ready").then_some(()));
    // The line was not ready at first; every incoming fault has become outgoing.
    let before = station.until("no fault", |s| {
        let (comes, goes) = interrupts(s);
        (comes == goes).then_some(comes)
    });
    station.until("SF is out", |s| s.status().modules[0].leds.is_empty().then_some(()));

    drop((line, listener));
    station.until("OB 82, incoming", |s| (interrupts(s) == (before + 1, before)).then_some(()));
    assert_eq!(station.cells(&["DB90.DBD8", "DB90.DBW12", "DB91.DBW0"]), [0x250C_0200, 256, 0]);
    station.until("SF", |s| (s.status().modules[0].leds == ["SF"]).then_some(()));
    assert_eq!(buffer(&site).first(), Some(&("080Dh".into(), true)));
    let text = site.ob1(&["diag", "diag.toml"]).fine();
    assert!(text.contains("cp (cp341 at 256), driver: line error"), "{text}");
    assert!(text.contains("080Dh BREAK: the receiving line is interrupted\n"), "{text}");
    assert!(text.contains("= Connect the devices"), "{text}");
    assert!(text.starts_with("CPU\n") && text.contains("4302h"), "{text}");

    let listener = TcpListener::bind(address).expect("the port is free again");
    let _line = accept(&listener);
    station.until("OB 82, outgoing", |s| (interrupts(s) == (before + 1, before + 1)).then_some(()));
    assert_eq!(station.cell("DB90.DBD8"), 0x000C_0000);
    assert_eq!(buffer(&site).first(), Some(&("080Dh".into(), false)));

    // The buffer belongs to the module: the next driver appends to it.
    let entries = buffer(&site);
    let driver = station.driver_process();
    driver.signal(Signal::KILL);
    station.until("another driver", |s| (s.driver().1 > 1).then_some(()));
    let _line = accept(&listener);
    let after = station.until("its parameters", |_| {
        let now = buffer(&site);
        (now.len() > entries.len()).then_some(now)
    });
    assert_eq!(after[after.len() - entries.len()..], entries);

    let said = site.ob1(&["diag", "diag.toml", "256", "-n", "1"]).fine();
    assert!(said.starts_with("cp (cp341 at 256)") && said.matches(" s  ").count() == 1, "{said}");
    let said = site.ob1(&["diag", "diag.toml", "press"]);
    assert!(said.code == Some(1) && said.err.contains("this station has: cp at 256"), "{said:?}");
    assert_eq!(station.interrupt().code(), Some(0));
    let said = site.ob1(&["diag", "diag.toml"]);
    assert!(said.code == Some(5) && said.err.contains("does not run"), "{said:?}");
}
