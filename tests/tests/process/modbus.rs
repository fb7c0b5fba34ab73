//! The Modbus examples as real processes: that of the manual with the values of its variable table, and a master with
//! two slaves.

use std::fs;

use rustix::process::Signal;

use crate::common::checkout;
use crate::common::site::{Site, replaced};
use crate::common::station::Running;

/// The files of an example in their own folder, with times long enough for a busy machine.
fn example(name: &str) -> Site {
    let site = Site::new();
    for entry in fs::read_dir(checkout("examples").join(name)).expect("the example") {
        let path = entry.expect("a file of the example").path();
        let file = path.file_name().and_then(|name| name.to_str()).expect("a name");
        if file.ends_with(".awl") {
            fs::copy(&path, site.path(file)).expect("room for a file");
        } else if file.ends_with(".toml") {
            let text = fs::read_to_string(&path).expect("a station file");
            // Times long enough for a busy machine.
            let text = replaced(&text, "watchdog = \"150ms\"", "watchdog = \"500ms\"");
            site.write(file, &text.replace("wait_ms = 300", "wait_ms = 2000"));
        }
    }
    site
}

/// The numbers in the rows of `ob1 get`.
fn get(site: &Site, station: &str, cells: &[&str]) -> Vec<i64> {
    let said = site.ob1(&[&["get", station], cells].concat()).fine();
    said.lines().map(|row| row.split_whitespace().nth(1).and_then(|n| n.parse().ok()).expect("a number")).collect()
}

fn end(stations: impl IntoIterator<Item = Running>) {
    for station in stations {
        let ended = station.interrupt();
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
}

/// Waits until the CP of the station has its line.
fn ready(station: &Running) {
    let is_ready = |s: &Running| s.status().modules[0].driver.as_ref().is_some_and(|driver| driver.state == "ready");
    station.until("the line", |s| is_ready(s).then_some(()));
}

/// Sends DB 10 and waits for the end of the order and its result.
fn send(site: &Site, master: &Running) {
    master.set("DB11.DBD0", 0);
    site.ob1(&["set", "station-master.toml", "M1.0=1"]).fine();
    // FRG is reset when the answer is in the CP; FC 1 needs some more calls.
    master.until("the answer", |m| (m.cells(&["M1.0", "M3.0"]) == [0, 0] && m.cell("DB11.DBD0") != 0).then_some(()));
    let pause = master.status().scans + 20;
    master.until("FC 1 is through", |m| (m.status().scans >= pause).then_some(()));
}

/// [S0 "Send and receive telegram"], [S0 "Receive block with error response"]
#[test]
fn the_manuals_variable_table() {
    let site = example("modbus-manual");
    let master = site.run("station-master.toml").until_run();
    master.until("the pty", |_| site.path("modbus.pty").exists().then_some(()));
    let slave = site.run("station-slave.toml").until_run();
    ready(&slave);

    let table = [
        "MW12=23",
        "DB10.DBD0=DW#16#05100000",
        "DB10.DBD4=DW#16#000810A0",
        "DB10.DBD8=DW#16#A1A2A3A4",
        "DB10.DBD12=DW#16#A5A6A7A8",
        "DB10.DBD16=DW#16#A9AAABAC",
        "DB10.DBD20=DW#16#ADAEAF00",
    ];
    site.ob1(&[&["set", "station-master.toml"], &table[..]].concat()).fine();
    send(&site, &master);
    let cells = ["PEW256", "PEW258", "MW12", "M1.0", "MB2", "MW22", "DB10.DBD0", "DB11.DBD0", "DB11.DBW4"];
    let status = [0, 0, 23, 0, 0, 6, 0x0510_0000, 0x0510_0000, 0x0008];
    assert_eq!(get(&site, "station-master.toml", &cells), status);
    let data = slave.until("the process image", |s| {
        let data = s.cells(&["ED0", "ED4", "ED8", "ED12"]);
        (data[3] != 0).then_some(data)
    });
    assert_eq!(data, [0xA0A1_A2A3, 0xA4A5_A6A7, 0xA8A9_AAAB, 0xACAD_AEAF]);

    // The slave's outputs, read by the master.
    site.ob1(&["set", "station-slave.toml", "AW0=16#1234", "AW14=16#5678"]).fine();
    let pause = slave.status().scans + 20;
    slave.until("the outputs are out", |s| (s.status().scans >= pause).then_some(()));
    site.ob1(&["set", "station-master.toml", "MW12=6", "DB10.DBD0=DW#16#05040000", "DB10.DBW4=8"]).fine();
    send(&site, &master);
    let cells = ["MW22", "DB11.DBW0", "DB11.DBB2", "DB11.DBW3", "DB11.DBW17", "MB2"];
    assert_eq!(get(&site, "station-master.toml", &cells), [19, 0x0504, 16, 0x1234, 0x5678, 0]);

    // "Slave responds with error message": nine words do not exist.
    site.ob1(&["set", "station-master.toml", "DB10.DBW4=9"]).fine();
    send(&site, &master);
    assert_eq!(master.cells(&["MW22", "DB11.DBW0", "DB11.DBB2"]), [3, 0x0584, 2]);

    // "Slave does not answer to the master command": ERROR01 NO DATA.
    end([slave]);
    send(&site, &master);
    let cells = ["MW22", "DB11.DBD0", "DB11.DBD4", "DB11.DBD8", "DB11.DBD12"];
    let text = [16, 0x4552_524F, 0x5200_0120, 0x4E4F_2044, 0x4154_4100];
    assert_eq!(get(&site, "station-master.toml", &cells), text);
    assert_eq!(master.cell("M2.3"), 1, "FEHLER_KOM");
    end([master]);
    site.wait_until_empty();
}

/// Waits until the master's ledger has this many more telegrams of a kind.
fn more(master: &Running, name: &str, count: i64) {
    let cell = format!("DB20.{name}");
    let begin = master.cell(&cell);
    master.until(name, |m| (m.cell(&cell) >= begin + count).then_some(()));
}

#[test]
fn a_master_with_two_slaves() {
    let site = example("modbus-master");
    let [master, short, long] = ["station-master.toml", "station-short.toml", "station-long.toml"].map(|f| site.run(f));
    let [master, short, long] = [master, short, long].map(Running::until_run);
    more(&master, "SHORT_ANSWERS", 6);
    more(&master, "LONG_ANSWERS", 6);
    master.set("DB10.SETPOINT[0]", 0x1234);
    master.set("DB12.SETPOINT[0]", 0x5678);
    master.set("DB12.SETPOINT[19]", 0x9ABC);
    let actual = ["DB20.SHORT_ACTUAL[0]", "DB20.LONG_ACTUAL[0]", "DB20.LONG_ACTUAL[19]", "DB20.LONG_ACTUAL[1]"];
    let inverted = [0xEDCB, 0xA987, 0x6543, 0xFFFF];
    master.until("setpoints there and back", |m| (m.cells(&actual) == inverted).then_some(()));

    // Writing outside of the receive area: "the RECEIVE block announces a range error", each time.
    master.set("DB12.W_FIRST_L", 20);
    more(&master, "LONG_REFUSALS", 3);
    assert_eq!(master.cell("DB20.LONG_LAST"), 0x8002);
    assert!(long.cell("DB20.RANGE_ERRORS") >= 2);
    assert_eq!(long.cell("M3.2"), 1, "FEHL_EMPF stays");
    master.set("DB12.W_FIRST_L", 0);
    more(&master, "LONG_ANSWERS", 6);
    assert_eq!(long.cells(&["DB11.WORDS[0]", "DB11.WORDS[19]", "DB11.WORDS[31]"]), [0x5678, 0x9ABC, 0]);

    // A slave that is switched off causes errors, the other one does not; and it recovers.
    let losses = master.driver().2;
    let before = master.cells(&["DB20.SHORT_ERRORS", "DB20.LONG_ERRORS"]);
    end([long]);
    more(&master, "LONG_ERRORS", 2);
    assert_eq!(master.cell("DB20.LONG_LAST"), 1);
    more(&master, "SHORT_ANSWERS", 4);
    // One late answer of slave 5 may be caused by the machine, but as many errors as the other one would be our fault.
    let after = master.cells(&["DB20.SHORT_ERRORS", "DB20.LONG_ERRORS"]);
    assert!(after[0] - before[0] < after[1] - before[1], "slave 5 is not concerned: {before:?} {after:?}");
    let long = site.run("station-long.toml").until_run();
    more(&master, "LONG_ANSWERS", 6);
    master.until("setpoints there and back", |m| (m.cells(&actual) == inverted).then_some(()));

    // Without FC 9: after the driver's death the next telegram is sent without further action.
    master.driver_process().signal(Signal::KILL);
    master.until("the loss", |m| (m.driver().2 > losses).then_some(()));
    more(&master, "SHORT_ANSWERS", 4);
    more(&master, "LONG_ANSWERS", 4);
    // The same for the slaves.
    for slave in [&short, &long] {
        slave.driver_process().signal(Signal::KILL);
    }
    more(&master, "SHORT_ANSWERS", 4);
    more(&master, "LONG_ANSWERS", 4);
    master.set("DB10.SETPOINT[7]", 0x0F0F);
    master.until("there and back", |m| (m.cell("DB20.SHORT_ACTUAL[7]") == 0xF0F0).then_some(()));
    end([master, short, long]);
    site.wait_until_empty();
}
