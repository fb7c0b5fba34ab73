//! Many stations on one machine: `ob1 list` with its targets for Prometheus, `ob1 ctl ready`, and `ob1 roll`.

use ob1_tests::bench::fleet::Plan;
use serde_json::Value;

use crate::common::gate::Visitor;
use crate::common::program;
use crate::common::s7::free_port;
use crate::common::site::{Said, Site};
use crate::common::station::{Running, counting};

/// A station that keeps DB 10, and stops when M 2.0 is set.
fn station(site: &Site, name: &str, keys: &str) -> Running {
    let data = "DATA_BLOCK DB 10\nSTRUCT\nrecipe : INT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n";
    std::fs::create_dir_all(site.path(name)).expect("a folder");
    site.write(
        &format!("{name}/plant.awl"),
        &counting(data, "      U M 2.0;\n      SPBN on;\n      CALL SFC 46;\non:   NOP 0;\n"),
    );
    site.write(
        &format!("{name}.toml"),
        &format!(
            "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"10ms\"\nwatchdog = \"20s\"\n\n[program]\nsources = [\"{name}/plant.awl\"]\n\n\
             [retentive]\nmemory = [\"100..199\"]\nevery = \"100ms\"\n\n{keys}"
        ),
    );
    site.run(&format!("{name}.toml")).until_run()
}

fn listed(site: &Site) -> Vec<Value> {
    let said = site.ob1(&["list", "--json"]);
    serde_json::from_str(&said.out).expect("JSON")
}

/// Restarts a station as a service manager would.
const RENEW: &str = "set -e\npid=$(ob1 list --json | tr -d ' \\n' | sed 's/},{/\\n/g' | sed -n \"s/.*\\\"name\\\":\\\"$1\\\".*\\\"pid\\\":\\([0-9]*\\).*/\\1/p\")\n\
    kill -TERM $pid\nwhile ob1 ctl $1 status >/dev/null 2>&1; do :; done\nif [ \"$2\" = \"$1\" ]; then mv .$1.retentive.[ab] lost/; fi\n\
    setsid ob1 run --quiet $1.toml >$1.out 2>$1.err </dev/null &\n";

fn roll(site: &Site, args: &[&str]) -> Said {
    let folder = program("ob1").parent().expect("a folder").to_owned();
    let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap_or_default());
    let mut command = site.command(program("ob1"));
    let output = command.arg("roll").args(args).env("PATH", path).output().expect("ob1 starts");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    Said { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
}

#[test]
fn all_stations_are_listed_and_prometheus_finds_their_figures() {
    let site = Site::new();
    let port = free_port();
    // The port is that of the pattern: the number at the end of the name is 1.
    let figures =
        format!("[[link]]\ntype = \"metrics\"\nname = \"figures\"\nlisten = \"127.0.0.1:{}+{{number}}\"\n", port - 1);
    let rack1 = station(&site, "rack1", &figures);
    let rack2 = station(&site, "rack2", "");
    rack1.until("figures", |_| Visitor::at(port).try_get("/metrics"));
    assert_eq!(site.ob1(&["ctl", "rack2", "ready"]).code, Some(0));
    rack2.set("M 2.0", 1);
    rack2.until("STOP", |station| (station.status().state == "STOP").then_some(()));

    let all = listed(&site);
    let by = |name: &str| all.iter().find(|one| one["name"] == name).expect(name);
    assert_eq!((&by("rack1")["state"], &by("rack2")["state"]), (&"RUN".into(), &"STOP".into()));
    assert_eq!(by("rack1")["program"], by("rack2")["program"], "one program, one fingerprint, wherever it lies");
    assert_eq!(by("rack1")["program"].as_str().map(str::len), Some(8));
    assert_eq!(by("rack1")["min_cycle_ns"], 10_000_000);
    let stop = by("rack2")["last_stop"]["text"].as_str().expect("why");
    assert!(by("rack1")["last_stop"].is_null() && stop.contains("SFC 46"), "{stop}");
    let text = site.ob1(&["list"]).out;
    assert!(text.lines().any(|line| line.starts_with("rack1") && line.contains(" RUN ")), "{text}");
    assert!(text.contains(stop), "{text}");
    let ready = site.ob1(&["ctl", "rack2", "ready"]);
    assert_eq!(ready.code, Some(3));
    assert!(ready.err.contains("rack2 is in STOP"), "{}", ready.err);
    assert_eq!(site.ob1(&["ctl", "rack9", "ready"]).code, Some(5));

    assert_eq!(site.ob1(&["list", "--prometheus", "targets.json", "--host", "hall3"]).code, Some(0));
    let targets = std::fs::read_to_string(site.path("targets.json")).expect("written");
    let targets: Value = serde_json::from_str(&targets).expect("JSON");
    assert_eq!(targets.as_array().map(Vec::len), Some(1));
    assert_eq!(targets[0]["targets"][0], format!("127.0.0.1:{port}"));
    assert_eq!((&targets[0]["labels"]["station"], &targets[0]["labels"]["host"]), (&"rack1".into(), &"hall3".into()));
    // What is served there names version and program, as `ob1 list` does.
    let page = Visitor::at(port).get("/metrics").body;
    let info = page.lines().find(|line| line.starts_with("ob1_station_info{")).expect("a sample");
    assert!(info.contains(&format!("program=\"{}\"", by("rack1")["program"].as_str().expect("text"))), "{info}");
}

#[test]
fn a_fleet_is_renewed_one_by_one_and_stops_at_the_first_that_loses_its_values() {
    let site = Site::new();
    site.write("renew.sh", RENEW);
    std::fs::create_dir(site.path("lost")).expect("a folder");
    let racks: Vec<Running> = ["rack1", "rack2", "rack3"].iter().map(|name| station(&site, name, "")).collect();
    for rack in &racks {
        rack.set("DB10.DBW 0", 4711);
        let before = rack.status().retentive.and_then(|kept| kept.generation).unwrap_or(0);
        rack.until("kept", |rack| (rack.status().retentive?.generation? >= before + 2).then_some(()));
    }
    let pids = || -> Vec<u64> { listed(&site).iter().filter_map(|one| one["pid"].as_u64()).collect() };
    let before = pids();
    let names = ["rack1", "rack2", "rack3"];
    let common = ["--settle", "200ms", "--values", "DB10.DBW0"];
    // The second one loses its retentive files on the way.
    let run = ["--run", "sh renew.sh {} rack2", "--back", "mv lost/.{}.retentive.[ab] . && sh renew.sh {}"];
    let said = roll(&site, &[&names[..], &common, &run].concat());
    assert_eq!(said.code, Some(8), "{} {}", said.out, said.err);
    assert!(said.out.contains("rack1: back in RUN; ob1 "), "{}", said.out);
    assert!(said.err.contains("rack2 did not come back: DB10.DBW0 was 4711 and is 0"), "{}", said.err);
    assert!(said.err.contains("it was brought back") && said.err.contains("1 of 3 are renewed"), "{}", said.err);
    let after = pids();
    assert!(before[0] != after[0] && before[1] != after[1] && before[2] == after[2], "{before:?} {after:?}");
    // All is well the next time: nothing is lost.
    let said = roll(&site, &[&names[..], &common, &["--run", "sh renew.sh {}"]].concat());
    assert_eq!(said.code, Some(0), "{} {}", said.out, said.err);
    assert!(said.out.ends_with("3 stations are renewed\n"), "{}", said.out);
    // One in STOP is not touched, and nobody behind it.
    let before = pids();
    site.ob1(&["ctl", "rack1", "stop"]);
    let said = roll(&site, &[&names[..], &["--run", "sh renew.sh {}"]].concat());
    assert_eq!(said.code, Some(5));
    assert!(said.err.contains("rack1: it is in STOP") && said.err.contains("nothing was done to it"), "{}", said.err);
    assert_eq!(before, pids());
    for name in names {
        site.ob1(&["ctl", name, "stop"]);
    }
}

/// The short form of `cargo xtask bench fleet`: MQTT, Sparkplug and figures of simulated stations, and everything is
/// taken.
#[test]
fn what_a_small_fleet_sends_is_taken_by_the_broker_and_by_prometheus() {
    let programs = program("ob1").parent().expect("a folder").to_owned();
    let taken = ob1_tests::bench::fleet::measure(&programs, Plan { stations: 20, seconds: 8, scrape: 4 });
    assert!(taken.expect("it can be measured"), "see what it has printed");
}
