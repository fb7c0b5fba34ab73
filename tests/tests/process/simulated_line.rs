//! Stations on a simulated line, as real processes: a cable shared by two, one that is killed, an echo, two wires
//! within one station.

use std::fs;
use std::process::Stdio;

use rustix::process::Signal;

use crate::common;
use crate::common::checkout;
use crate::common::ledger::{self, Ledger};
use crate::common::processes::Watched;
use crate::common::site::{PATIENT, Site, replaced};
use crate::common::station::Running;

/// The example in its own folder; `edit` changes the tables of the line.
fn example(edit: impl Fn(String) -> String) -> Site {
    let site = Site::two_stations();
    for name in ["station-a.toml", "station-b.toml"] {
        let text = fs::read_to_string(checkout("examples/simulated-line").join(name)).expect("a file of the example");
        let text = replaced(&text, "../two-stations/", "");
        let text = replaced(&text, "watchdog = \"150ms\"", "watchdog = \"500ms\"");
        site.write(name, &edit(replaced(&text, "priority = ", &format!("{PATIENT}priority = "))));
    }
    site
}

fn start(site: &Site) -> (Running, Running) {
    (site.run("station-a.toml").until_run(), site.run("station-b.toml").until_run())
}

/// The processes that simulate lines.
fn hubs(site: &Site) -> Vec<Watched> {
    let is_hub = |process: &Watched| {
        let line = fs::read(format!("/proc/{}/cmdline", process.pid)).unwrap_or_default();
        line.split(|byte| *byte == 0).any(|word| word == b"--hub")
    };
    site.processes().into_iter().filter(is_hub).collect()
}

#[test]
fn the_example_runs_on_its_bad_cable() {
    // Without the bursts, which are only for demonstration: a short run would depend on chance.
    let site = example(|text| text.lines().filter(|l| !l.starts_with("bursts")).map(|l| format!("{l}\n")).collect());
    let (a, b) = start(&site);
    // A listener that never reads blocks nothing.
    let sleeper = site.command(common::program("ob1")).args(["trace", "station-a.toml"]).stdout(Stdio::piped()).spawn();
    let mut sleeper = sleeper.expect("ob1 starts");
    let asleep = Watched::find(sleeper.id()).expect("it listens until it is ended");
    asleep.signal(Signal::STOP);
    ledger::flow(&a, 75);
    let live = site.ob1(&["trace", "station-a.toml", "cp", "--for", "1s", "--record", "line.trace"]).fine();
    for what in [
        "cp of station \"simulated-line-a\": 3964r, 115200 8N1",
        "STX: connection request",
        "BCC",
        "DLE: block received",
    ] {
        assert!(live.contains(what), "no {what:?} in:\n{live}");
    }
    assert_eq!(site.ob1(&["trace", "--from", "line.trace"]).fine(), live, "a recording says the same");
    ledger::flow(&a, 75);
    sleeper.kill().and_then(|()| sleeper.wait().map(drop)).expect("a child");
    let (of_a, of_b) = ledger::rest(&a, &b);
    // 150 telegrams and their echoes are some 20,000 characters: dozens were damaged, and the protocol has corrected
    // this.
    assert!(of_a["GOOD"] >= 150 && of_a["WRONG"] == 0, "{of_a:?}\n{of_b:?}");
    assert_eq!(of_a["STARTED"], of_a["DONE"] + of_a["ERROR"] + of_a["ABORTED"], "{of_a:?}");
    let errors = |station: &Running| -> u64 {
        let counters = &station.status().modules[0].counters;
        counters.get("receive_errors").copied().unwrap_or(0)
    };
    assert!(errors(&a) + errors(&b) > 0, "a bad cable without errors");
    assert_eq!(hubs(&site).len(), 2, "one is the line, one stands by");
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
    site.wait_until_empty();
}

/// The line ends behind its CPs: an orderly end is no fault of the line.
#[test]
fn the_end_of_a_station_is_no_fault_of_its_line() {
    let site = Site::new();
    site.write("p.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n");
    site.write(
        "s.toml",
        "[station]\nname = \"ending\"\n[program]\nsources = [\"p.awl\"]\n\
         [[module]]\ntype = \"cp240\"\nname = \"cp\"\naddress = 256\nline = \"sim:wire\"\n\
         params = { protocol = \"ascii\" }\n\
         [[simulated_line]]\nname = \"wire\"\n",
    );
    for _ in 0..5 {
        let said = site.ob1(&["run", "s.toml", "--scans", "300"]);
        assert_eq!(said.code, Some(0), "{said:?}");
        assert!(said.err.contains("the line is up") && !said.err.contains("the line is gone"), "{}", said.err);
    }
    site.wait_until_empty();
}

#[test]
fn a_line_outlives_the_station_that_started_it_and_its_own_death() {
    let quiet = |text: String| {
        text.lines()
            .filter(|l| !l.starts_with("bursts") && !l.starts_with("faults"))
            .map(|l| format!("{l}\n"))
            .collect()
    };
    let site = example(quiet);
    let (a, b) = start(&site);
    ledger::flow(&a, 20);
    // One of the two is the line. After killing both the line is interrupted for a short time in any case.
    for hub in hubs(&site) {
        hub.signal(Signal::KILL);
    }
    a.until("the line is gone", |a| (a.entries("F203h") > 0 || line_errors(a) > 0).then_some(()));
    ledger::flow(&a, 20);
    let of_a = Ledger::of_a(&a);
    assert_eq!(of_a["WRONG"], 0, "{of_a:?}");
    // A is restarted: B stays on the line, or its own process takes over the line.
    let code = a.interrupt().code();
    assert_eq!(code, Some(0));
    let a = site.run("station-a.toml").until_run();
    ledger::flow(&a, 20);
    // B may have sent the echo of a telegram of the first A, whose number is unknown to the second.
    let of_a = Ledger::of_a(&a);
    assert!(of_a["WRONG"] <= 1, "{of_a:?}");
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
    site.wait_until_empty();
}

fn line_errors(station: &Running) -> u64 {
    station.status().modules[0].counters.get("line_faults").copied().unwrap_or(0)
}
