//! kill -9 at any time: of drivers while telegrams are transferred, of a hanging driver, of the runtime itself.
//!
//! The times are derived from seeds; a failure names the seed and the kill.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::process::Stdio;

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::Signal;

use crate::common::kills::{Blow, DRIVER_LOST, assert_accounted, assert_survived, kill_drivers, start};
use crate::common::ledger::{self, Ledger};
use crate::common::processes::Memory;
use crate::common::site::Site;
use crate::common::{Guard, program};

#[test]
fn drivers_are_killed_while_telegrams_flow() {
    kill_drivers(1, 6, &[Blow::Kill]);
}

#[test]
fn drivers_are_killed_at_other_moments() {
    kill_drivers(20_061_214, 6, &[Blow::Kill]);
}

/// Nothing here rests on a time that a machine could use up by standing still, not even on the watchdog: that OB 1 does
/// not wait for the driver is seen by the scans that go on meanwhile.
#[test]
fn a_driver_that_hangs_is_killed_and_started_again() {
    let site = Site::two_stations_on_a_cable();
    for file in ["station-a.toml", "station-b.toml"] {
        site.without_watchdog(file);
    }
    let (a, b) = start(&site);
    for (station, what) in [(&a, "A"), (&b, "B")] {
        let driver = station.driver_process();
        let (_, _, losses) = station.driver();
        let scans = station.status().scans;
        driver.signal(Signal::STOP);
        // The supervisor ends it.
        driver.wait(what);
        assert!(station.status().scans > scans + 100, "{what}: the scan has gone on all the while");
        assert_survived(station, losses, what);
        let entries = station.diagnostics();
        assert!(entries.iter().any(|e| e.event == DRIVER_LOST && e.text.contains("hung")), "{entries:#?}");
        ledger::flow(&a, 5);
    }
    let (of_a, of_b) = ledger::rest(&a, &b);
    assert_accounted(&of_a, &of_b, 1, 1, "a driver that hangs");
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
}

/// The program of a driver is gone for a while, as in an update: that is reported once, and tried again.
#[test]
fn a_driver_that_cannot_be_started_is_reported_once() {
    let site = Site::two_stations_on_a_cable();
    site.without_watchdog("station-a.toml");
    let driver = site.path("the-driver");
    let publish = || std::os::unix::fs::symlink(program("ob1-cp"), &driver).expect("the name is free");
    publish();
    let a = site.run_with("station-a.toml", &[], &[("OB1_CP", driver.as_os_str())]).until_run();
    let process = a.driver_process();
    let (_, starts, _) = a.driver();
    fs::remove_file(&driver).expect("it is there");
    process.signal(Signal::KILL);
    process.wait("the driver");
    a.until("it is reported", |a| a.said().contains("cannot be started").then_some(()));
    a.scans(500);
    publish();
    a.until("it is back", |a| (a.driver().1 > starts).then_some(()));
    assert_eq!(a.said().matches("cannot be started").count(), 1, "{}", a.said());
    assert_eq!(a.interrupt().code(), Some(0));
}

/// Supervision does not depend on the reader of its log: a full disk, a closed pipe, a reader that reads nothing.
#[test]
fn drivers_come_back_when_nobody_gets_the_log() {
    let full_disk = File::options().write(true).open("/dev/full").expect("there");
    let (reader, nobody) = io::pipe().expect("descriptors");
    drop(reader);
    let (unread, mut full) = io::pipe().expect("descriptors");
    let flags = fcntl_getfl(&full).expect("a descriptor");
    fcntl_setfl(&full, flags | OFlags::NONBLOCK).expect("a pipe");
    while full.write(&[b'.'; 4096]).is_ok() || full.write(b".").is_ok() {}
    fcntl_setfl(&full, flags).expect("a pipe");
    for (what, log) in [
        ("a full disk", Stdio::from(full_disk)),
        ("a reader that is gone", nobody.into()),
        ("one that reads nothing", full.into()),
    ] {
        let site = Site::two_stations_on_a_cable();
        let a = site.run_logging_to("station-a.toml", log).until_run();
        // A driver without a sign of life would count as another attempt and not as another loss.
        let up_after = |starts: u32| {
            a.until("the driver is up", |s| {
                let (pid, now, _) = s.driver();
                (pid != 0 && now > starts).then_some(now)
            })
        };
        let mut starts = up_after(0);
        for _ in 0..2 {
            let driver = a.driver_process();
            driver.signal(Signal::KILL);
            driver.wait(what);
            starts = up_after(starts);
        }
        assert!(a.entries(DRIVER_LOST) >= 2, "{what}: {:#?}", a.diagnostics());
        assert_eq!(a.interrupt().code(), Some(0), "{what}");
        site.wait_until_empty();
    }
    drop(unread);
}

#[test]
fn nothing_is_left_of_a_runtime_that_was_killed() {
    let site = Site::two_stations();
    let (a, b) = start(&site);
    let processes = site.processes();
    let drivers = [a.driver_process(), b.driver_process()];
    let memories = [a.rundir.join("cp.segment"), b.rundir.join("cp.segment")].map(|link| Memory::behind(&link));
    let rundirs = [a.rundir.clone(), b.rundir.clone()];
    for ended in [a.kill(), b.kill()] {
        assert_eq!(ended.signal(), Some(9), "{ended:?}");
    }
    for driver in drivers {
        driver.wait("a driver without a runtime");
    }
    site.wait_until_empty();
    // A process first loses its environment, then its files, then ends.
    for process in processes {
        process.wait("a process of a runtime that was killed");
    }
    assert_eq!(rundirs.map(|dir| dir.exists()), [false, false]);
    assert!(fs::symlink_metadata(site.path("null-modem.pty")).is_err());
    for memory in memories {
        memory.wait_until_free();
    }
}

#[test]
fn a_runtime_that_was_killed_is_killed_with_a_driver_that_hangs() {
    // A stopped driver does not detect the end of its runtime until it continues.
    let site = Site::two_stations();
    let (a, b) = start(&site);
    let driver = a.driver_process();
    let rundir = a.rundir.clone();
    driver.signal(Signal::STOP);
    a.kill();
    let guard = Guard::begin();
    while rundir.exists() {
        assert!(!guard.is_over(), "the guardian waits for ever");
        driver.ends_within(std::time::Duration::from_millis(20));
    }
    driver.signal(Signal::CONT);
    driver.wait("a driver without a runtime");
    assert_eq!(b.interrupt().code(), Some(0));
    site.wait_until_empty();
    assert!(fs::symlink_metadata(site.path("null-modem.pty")).is_err());
}

#[test]
fn a_station_starts_at_once_after_its_runtime_was_killed() {
    let site = Site::two_stations();
    let (mut a, b) = start(&site);
    for round in 0..5 {
        let (driver, of_b) = (a.driver_process(), Ledger::of_b(&b));
        assert_eq!(a.kill().signal(), Some(9));
        // Without waiting for the old drivers and the cleanup.
        a = site.run("station-a.toml").until_run();
        ledger::flow(&a, 5);
        driver.wait("the driver of the runtime before");
        assert!(Ledger::of_b(&b)["RECEIVED"] > of_b["RECEIVED"], "round {round}");
        // At most the echo of a telegram of the previous runtime, which this one has not sent.
        assert!(a.cell("DB20.WRONG") <= 1, "round {round}");
        assert_eq!(b.status().watchdogs, 0, "round {round}");
    }
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
    assert!(site.processes().is_empty());
}
