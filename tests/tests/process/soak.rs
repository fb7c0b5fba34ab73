//! `ob1 soak` with real processes: its verdicts and exit codes, its files, the state after an interruption and a kill,
//! and the ledger of the telegrams while drivers are killed.
//!
//! The limits here are either never reached or always exceeded, so the results do not depend on the load of the
//! machine.

use std::process::{Child, Stdio};

use ob1_command::soak::Report;
use ob1_command::soak::verdict::{Ended, Verdict};
use rustix::process::Signal;

use crate::common;
use crate::common::Guard;
use crate::common::ledger::Ledger;
use crate::common::processes::Watched;
use crate::common::site::{Said, Site};

/// A station without CPs that counts in MW 0, and stops if M 2.0 is set.
fn counting() -> Site {
    let site = Site::new();
    site.write(
        "counting.toml",
        "[station]\nname = \"counting\"\n\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"20s\"\n\n[program]\nsources = [\"counting.awl\"]\n",
    );
    site.write(
        "counting.awl",
        "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL MW 0;\n+ 1;\nT MW 0;\nU M 2.0;\nSPBN on;\nCALL SFC 46;\non: NOP 0;\n\
         END_ORGANIZATION_BLOCK\n",
    );
    site
}

fn report(site: &Site, name: &str) -> Report {
    Report::read(&site.path(format!("{name}.json"))).expect("a whole report")
}

fn soak(site: &Site, time: &str, budget: &str, name: &str) -> Said {
    site.ob1(&["soak", "counting.toml", "--for", time, "--warm-up", "0ms", "--budget", budget, "--report", name])
}

/// Starts a soak; also returns its process.
fn start(site: &Site, name: &str) -> (Child, Watched) {
    let mut command = site.command(common::program("ob1"));
    command.args([
        "soak",
        "counting.toml",
        "--for",
        "8h",
        "--warm-up",
        "0ms",
        "--report",
        name,
        "--budget",
        "watchdog=0",
    ]);
    let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("ob1 starts");
    let process = Watched::find(child.id()).expect("a child, living or dead, is there until it is waited for");
    let guard = Guard::begin();
    // The first checkpoint is written when the measurement begins.
    while !site.path(format!("{name}.html")).exists() {
        assert!(!process.ends_within(std::time::Duration::from_millis(20)), "it has ended");
        assert!(!guard.is_over(), "no checkpoint");
    }
    (child, process)
}

#[test]
fn kept_broken_and_too_short() {
    let site = counting();
    let said = soak(&site, "3s", "wake.p50=30s,watchdog=0,execution.p99=30s", "kept");
    assert_eq!(said.code, Some(0), "{said:?}");
    assert!(said.out.ends_with("PASS\n") && said.out.contains("p99.999 needs 1000000 scans"), "{said:?}");
    let kept = report(&site, "kept");
    assert_eq!((kept.ended, kept.verdict, kept.station.as_str()), (Ended::Time, Verdict::Pass, "counting"));
    assert!(kept.measured_ns >= 3_000_000_000 && !kept.intervals.is_empty() && !kept.posture.is_empty(), "{kept:?}");
    let timing = kept.timing.as_ref().expect("accounts");
    assert_eq!(timing.wake.buckets.iter().map(|(_, n)| n).sum::<u64>(), timing.wake.count);
    assert!(timing.wake.count.abs_diff(timing.scans) <= 1, "{} {}", timing.wake.count, timing.scans);
    let page = std::fs::read_to_string(site.path("kept.html")).expect("a page");
    assert!(page.contains("<svg") && page.contains("PASS") && page.ends_with("</html>\n"));
    assert_eq!(std::fs::read_to_string(site.path("kept.txt")).expect("the text"), said.out);

    let said = soak(&site, "2s", "execution.max=1ns,wake.p50=30s", "broken");
    assert_eq!(said.code, Some(1), "{said:?}");
    assert!(said.out.ends_with("BUDGET BROKEN\n"), "{said:?}");

    let said = soak(&site, "2s", "wake.p99.999=30s,wake.p50=30s", "short");
    assert_eq!(said.code, Some(2), "{said:?}");
    assert!(said.out.contains("needs 1000000 values") && said.out.ends_with("INCONCLUSIVE\n"), "{said:?}");
    assert!(site.processes().is_empty());
}

#[test]
fn a_wrong_budget_or_station_is_refused() {
    let site = counting();
    let said = soak(&site, "1s", "wake.p98=1ms", "x");
    assert!(said.code == Some(1) && said.err.contains("p99.9"), "{said:?}");
    site.write("counting.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nNONSENSE 1;\nEND_ORGANIZATION_BLOCK\n");
    let said = soak(&site, "1s", "missed=0", "x");
    assert!(said.code == Some(2) && said.err.contains("NONSENSE"), "{said:?}");
    assert!(site.processes().is_empty());
}

#[test]
fn an_interrupted_soak_ends_in_order_with_a_verdict() {
    let site = counting();
    let (mut child, process) = start(&site, "cut");
    process.signal(Signal::INT);
    process.wait("the soak");
    assert_eq!(child.wait().expect("a child that has ended").code(), Some(2));
    let cut = report(&site, "cut");
    assert_eq!((cut.ended, cut.verdict), (Ended::Interrupted, Verdict::Inconclusive));
    assert!(cut.findings.iter().any(|f| f.budget == "watchdog=0" && f.verdict == Verdict::Pass), "{:?}", cut.findings);
    assert!(site.processes().is_empty());
}

#[test]
fn a_killed_soak_leaves_its_last_checkpoint_and_no_station() {
    let site = counting();
    let (mut child, process) = start(&site, "killed");
    process.signal(Signal::KILL);
    child.wait().expect("a child that has ended");
    site.wait_until_empty();
    assert!(!site.rundir("counting").exists());
    assert_eq!(report(&site, "killed").ended, Ended::UnderWay);
}

#[test]
fn a_cell_that_is_not_there_is_told() {
    let site = counting();
    let more = ["--for", "1s", "--warm-up", "0ms", "--cells", "NOSUCH", "--report", "nosuch"];
    let said = site.ob1(&[&["soak", "counting.toml"][..], &more].concat());
    assert_eq!(said.code, Some(2), "{said:?}");
    assert!(said.err.contains("ob1: \"NOSUCH\" is not the name of a cell"), "{said:?}");
    assert!(site.processes().is_empty());
}

#[test]
fn a_cpu_in_stop_breaks_every_soak() {
    let site = counting();
    let (mut child, process) = start(&site, "stopped");
    assert_eq!(site.ob1(&["set", "counting", "M2.0=1"]).code, Some(0));
    process.wait("the soak");
    assert_eq!(child.wait().expect("a child that has ended").code(), Some(1));
    let stopped = report(&site, "stopped");
    assert_eq!((stopped.ended, stopped.verdict), (Ended::CpuStopped, Verdict::Broken));
    assert!(site.processes().is_empty());
}

#[test]
fn no_telegram_is_done_that_has_not_arrived_while_drivers_are_killed() {
    let site = Site::two_stations();
    let b = site.run("station-b.toml").until_run();
    let said = site.ob1(&[
        "soak",
        "station-a.toml",
        "--for",
        "12s",
        "--warm-up",
        "0ms",
        "--load",
        "cpu=1,io=1,driver-kill=60/min",
        "--seed",
        "3964",
        "--cells",
        "DB20.STARTED,DB20.DONE",
        "--doubled",
        "DB20.DOUBLED",
        "--wrong",
        "DB20.WRONG",
        "--budget",
        "telegrams.wrong=0",
        "--report",
        "killed",
    ]);
    assert_eq!(said.code, Some(0), "{said:?}");
    let report = report(&site, "killed");
    let cell = |name: &str| report.cells.iter().find(|cell| cell.name == name).expect("it was asked for").last as u64;
    let load = report.load.as_ref().expect("a load");
    let cp = &report.telegrams[0];
    assert!(load.driver_kills > 0 && load.cpu_slices > 0 && load.io_blocks > 0, "{load:?}");
    assert!(cp.drivers_lost >= load.driver_kills.saturating_sub(1) && cell("DB20.DONE") > 0, "{cp:?} {load:?}");
    // B's CP was not killed: it has received everything reported to A as done, and nothing that A has not sent.
    let status = b.status();
    let received = status.modules[0].counters["telegrams_received"];
    let of_b = Ledger::of_b(&b);
    assert!(cell("DB20.DONE") <= received, "done without an acknowledgement: {report:?} {of_b:?}");
    assert!(of_b["RECEIVED"] as u64 <= cell("DB20.STARTED") + 1, "{report:?} {of_b:?}");
    assert_eq!(b.interrupt().code(), Some(0));
}
