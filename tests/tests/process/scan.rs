//! The scan, including plugins, allocates nothing and makes only the permitted system calls, while telegrams are
//! transferred and a driver is killed. For each of the two checks a block that violates the rule proves that the check
//! can fail.

use std::ffi::OsStr;
use std::fs;

use rustix::process::Signal;

use crate::common::ledger;
use crate::common::native::{self, Counts};
use crate::common::site::Site;
use crate::common::station::Running;

/// Station A that calls a block of `tests/native/scan_blocks.c` if M 200.0 is set.
fn with_call(site: &Site, block: &str) {
    let plugin = native::build(site, "tests/native/scan_blocks.c", "scan_blocks.so", &[]);
    let awl = fs::read_to_string(site.path("a.awl")).expect("the program");
    let call = format!("UN    M    200.0\nSPB   on\nCALL {block}\non: U      M      1.0");
    site.write("a.awl", &awl.replacen("U      M      1.0", &call, 1));
    let toml = fs::read_to_string(site.path("station-a.toml")).expect("the station file");
    site.write("station-a.toml", &format!("{toml}\n[[plugin]]\npath = \"{}\"\n", plugin.display()));
}

/// Kills a driver, and waits until telegrams are transferred again.
fn kill_driver(station: &Running, a: &Running) {
    let driver = station.driver_process();
    driver.signal(Signal::KILL);
    driver.wait("a killed driver");
    station.until("the driver is started again", |s| (s.driver().2 > 0 && s.driver().0 != 0).then_some(()));
    ledger::flow(a, 5);
}

/// Requests of tools are also answered by the scan.
fn ask_everything(station: &Running) {
    station.set("MB210", 7);
    assert_eq!(station.cells(&["MB210", "DB20.STATE", "PEW0", "T2", "DB10.DBX20.0"])[0], 7);
    assert_eq!(station.status().state, "RUN");
    assert!(!station.diagnostics().is_empty());
}

fn counted(site: &Site, name: &str, counter: &OsStr) -> (Running, Counts) {
    let counts = Counts::new();
    let file = counts.path();
    let environment = [("LD_PRELOAD", counter), ("OB1_COUNT_FILE", file.as_os_str())];
    (site.run_with(&format!("{name}.toml"), &[], &environment), counts)
}

#[test]
fn the_scan_allocates_nothing() {
    let site = Site::two_stations();
    with_call(&site, "FC 230");
    let counter = native::build(&site, "tests/native/count_alloc.c", "count_alloc.so", &[]);
    let (a, of_a) = counted(&site, "station-a", counter.as_os_str());
    let (b, of_b) = counted(&site, "station-b", counter.as_os_str());
    let (a, b) = (a.until_run(), b.until_run());
    ledger::flow(&a, 5);
    for station in [&a, &b] {
        let threads = station.process.threads();
        assert!(
            threads.iter().any(|name| name.starts_with("ob1-scan")),
            "the counter knows it by its name: {threads:?}"
        );
    }

    let before = [of_a.read(), of_b.read()];
    for station in [&a, &b] {
        station.scans(2500);
        ask_everything(station);
        kill_driver(station, &a);
        station.scans(2500);
    }
    for (after, before) in [of_a.read(), of_b.read()].into_iter().zip(before) {
        assert_eq!(after.0, before.0, "heap calls of the scan thread");
        assert!(after.1 > before.1, "the counter lives");
    }

    // The counter detects an allocation in a plugin: two calls in each scan.
    let (before, _) = of_a.read();
    a.set("M200.0", 1);
    a.scans(100);
    assert!(of_a.read().0 >= before + 200, "{before} {:?}", of_a.read());
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
}

#[test]
fn the_scan_makes_no_system_call_it_may_not() {
    let site = Site::two_stations();
    with_call(&site, "FC 231");
    let a = site.run_with("station-a.toml", &["--fence-scan"], &[]);
    let b = site.run_with("station-b.toml", &["--fence-scan"], &[]);
    let (a, b) = (a.until_run(), b.until_run());
    ledger::flow(&a, 20);
    for station in [&a, &b] {
        station.scans(2500);
        ask_everything(station);
        kill_driver(station, &a);
        station.scans(2500);
    }
    // Also none during STOP.
    site.ob1(&["ctl", "station-a.toml", "stop"]).fine();
    a.until("STOP", |a| (a.status().state == "STOP").then_some(()));
    site.ob1(&["ctl", "station-a.toml", "run"]).fine();
    a.until("RUN", |a| (a.status().state == "RUN").then_some(()));
    ledger::flow(&a, 20);
    assert_eq!(b.interrupt().code(), Some(0));

    // The system call filter also applies to a plugin.
    let driver = a.driver_process();
    a.try_set("M200.0", 1);
    let ended = a.end();
    assert_eq!(ended.signal(), Some(Signal::SYS.as_raw()), "{ended:?}");
    driver.wait("a driver without a runtime");
    site.wait_until_empty();
    assert!(!site.rundir("tested-a").exists());
}

#[test]
fn a_fenced_station_ends_well() {
    let site = Site::two_stations();
    let a = site.run_with("station-a.toml", &["--fence-scan"], &[]);
    let b = site.run("station-b.toml");
    let (a, b) = (a.until_run(), b.until_run());
    ledger::flow(&a, 20);
    let ended = a.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    assert_eq!(b.interrupt().code(), Some(0));
    assert!(site.processes().is_empty() && !site.rundir("tested-a").exists());
}
