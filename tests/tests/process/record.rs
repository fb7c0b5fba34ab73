//! Recordings of real stations: what they hold is what the accounts hold, Perfetto's own messages read them, and a
//! death of the station costs its last block at most.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ob1_station::access::protocol::Op;
use ob1_timing::Timing;
use rustix::process::Signal;
use serde_json::Value;

use crate::common::site::Site;
use crate::common::station::{Running, counting};
use crate::common::{checkout, python};

/// A station that counts in MW 100 and records itself from its first scan on.
fn recording_station(site: &Site, tables: &str) {
    let toml = format!(
        "[station]\nname = \"recorded\"\n\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"0ms\"\n\n\
         [[cpu.cyclic]]\nob = 35\nperiod = \"7ms\"\n\n[program]\nsources = [\"recorded.awl\"]\n\n{tables}"
    );
    // A busy machine runs late: OB 80 lets the CPU go on.
    let cyclic = "ORGANIZATION_BLOCK OB 80\nBEGIN\nEND_ORGANIZATION_BLOCK\n\
                  ORGANIZATION_BLOCK OB 35\nBEGIN\nNETWORK\nL MW 102;\n+ 1;\nT MW 102;\nEND_ORGANIZATION_BLOCK\n";
    let bits = "      U     M 100.0;\n      =     M 104.0;\n";
    site.write("recorded.toml", &toml);
    site.write("recorded.awl", &(counting("", bits) + cyclic));
}

/// The files of its trace.
fn files(site: &Site) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(site.path("")).expect("a folder").flatten().map(|entry| entry.path());
    entries.filter(|path| path.extension().is_some_and(|ending| ending == "ob1trace")).collect()
}

/// What a recording is as a trace for Perfetto, by tracks, after its rules have been checked.
fn perfetto(site: &Site, file: &str) -> BTreeMap<String, Value> {
    let mut script = site.command(python());
    let read = script.arg(checkout("tests/peers/pftrace.py")).arg(site.path(file)).output().expect("Python starts");
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let read: Value = serde_json::from_slice(&read.stdout).expect("JSON");
    serde_json::from_value(read["tracks"].clone()).expect("tracks")
}

/// Number, and the sum of the durations, of the slices of a track.
fn slices(track: &Value) -> (u64, u64) {
    let slices = track["slices"].as_array().expect("slices");
    (slices.len() as u64, slices.iter().map(|slice| slice[1].as_u64().expect("a time")).sum())
}

/// A table by its columns.
fn table(site: &Site, file: &str) -> BTreeMap<String, Vec<i64>> {
    let text = std::fs::read_to_string(site.path(file)).expect("a table");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("a head").split(',').collect();
    let mut columns: BTreeMap<String, Vec<i64>> = BTreeMap::new();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            columns.entry((*name).to_owned()).or_default().push(cell.parse().unwrap_or(-1));
        }
    }
    columns
}

fn timing(station: &Running) -> Timing {
    *station.ask(Op::Timing { histograms: false }).expect("never refused").timing.expect("an answer to timing")
}

/// Count and sum of an account; its mean is not rounded.
fn account(spread: &ob1_timing::snapshot::Spread) -> (u64, u64) {
    (spread.count, (spread.mean_ns * spread.count as f64).round() as u64)
}

#[test]
fn a_recording_holds_what_the_accounts_hold() {
    let site = Site::new();
    let signals = "signals = [\"MW100\", \"MW102\", \"M104.0\", \"MD100\"]";
    recording_station(&site, &format!("[[trace]]\nname = \"all\"\n{signals}\n"));
    // The scan makes no system call and allocates nothing while it is recorded.
    let station = site.run_with("recorded.toml", &["--fence-scan"], &[]).until_run();
    station.scans(2000);
    assert_eq!(site.ob1(&["ctl", "recorded", "stop"]).code, Some(0));
    station.until("STOP", |station| (station.status().state == "STOP").then_some(()));
    let accounts = timing(&station);
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0), "{}", ended.err);
    let [file] = &files(&site)[..] else { panic!("{:?}", files(&site)) };
    let file = file.display().to_string();
    let told = site.ob1(&["record", "--from", &file, "--out", "all.csv"]).fine();
    assert!(told.contains("of 4 signals in 1 part, 0 lost"), "{told}");
    site.ob1(&["record", "--from", &file, "--out", "all.pftrace"]).fine();
    // The table: every scan once, in order; its values follow from each other.
    let table = table(&site, "all.csv");
    let scans: Vec<i64> = table["scan"].clone();
    let last = *scans.last().expect("rows");
    assert_eq!(last, accounts.scans as i64, "the last scan before STOP is there");
    let run: Vec<usize> = (0..scans.len()).filter(|at| *at == 0 || scans[at - 1] != scans[*at]).collect();
    assert!(run.iter().zip(0..).all(|(at, scan)| scans[*at] == scan), "each scan once");
    assert!(run.iter().all(|at| table["MW100"][*at] == scans[*at]), "of its own scan");
    assert!(run.iter().all(|at| table["M104.0"][*at] == (table["MW100"][*at] >> 8) & 1));
    assert!(run.iter().all(|at| table["MD100"][*at] == table["MW100"][*at] << 16 | table["MW102"][*at]));
    // Perfetto: counts and sums are those of the accounts.
    let tracks = perfetto(&site, "all.pftrace");
    for (track, spread) in
        [("scan", &accounts.execution), ("scan / inputs", &accounts.inputs), ("scan / outputs", &accounts.outputs)]
    {
        assert_eq!(slices(&tracks[track]), account(spread), "{track}");
    }
    for ob in accounts.obs.iter().filter(|ob| [1, 35].contains(&ob.ob)) {
        let slices = tracks[&format!("OB {}", ob.ob)]["slices"].as_array().expect("slices");
        let own: u64 = slices.iter().map(|slice| slice[3]["own_ns"].as_u64().expect("a time")).sum();
        assert_eq!((slices.len() as u64, own), account(&ob.execution), "OB {}", ob.ob);
        assert!(ob.runs > 100, "{ob:?}");
    }
    // Counters change where the table does.
    for signal in ["MW100", "MW102", "M104.0", "MD100"] {
        let mut changes = table[signal].clone();
        changes.dedup();
        let values = tracks[&format!("signals / {signal}")]["values"].as_array().expect("values");
        let values: Vec<i64> = values.iter().map(|value| value[1].as_i64().expect("a number")).collect();
        assert_eq!(values, changes, "{signal}");
    }
    let late = tracks.get("late scans").map_or(0, |track| track["instants"].as_array().expect("instants").len() as u64);
    // Those that were pending may have been explained since.
    let told = late..=late + accounts.late.pending + accounts.late.lost;
    assert!(told.contains(&accounts.late.scans), "{late} of {:?}", accounts.late);
    assert_eq!(tracks["operating state"]["slices"].as_array().map(Vec::len), Some(2), "RUN and STOP");
}

#[test]
fn a_station_that_is_killed_leaves_its_last_block() {
    let site = Site::new();
    recording_station(&site, "[[trace]]\nname = \"all\"\nsignals = [\"MW100\"]\n");
    let station = site.run("recorded.toml").until_run();
    station.scans(1500);
    let before = station.cell("MW100");
    station.kill();
    let [file] = &files(&site)[..] else { panic!("{:?}", files(&site)) };
    let told = site.ob1(&["record", "--from", &file.display().to_string(), "--out", "all.csv"]);
    assert_eq!(told.code, Some(0), "{}", told.err);
    let table = table(&site, "all.csv");
    // A block waits a fifth of a second at most; a busy machine has half a second more.
    let last = *table["MW100"].last().expect("rows");
    assert!(last >= before - 700, "{last} of {before}");
    assert!(table["scan"].windows(2).all(|pair| pair[1] - pair[0] <= 1), "none is missing");
}

#[test]
fn a_trigger_records_what_was_before_it() {
    let site = Site::new();
    recording_station(&site, "");
    let station = site.run("recorded.toml").until_run();
    let args = ["record", "recorded", "--signals", "MW100", "--trigger", "M104.0 rising"];
    let more = ["--before", "40ms", "--for", "20ms", "--repeat", "2", "--out", "edge.csv"];
    let told = site.ob1(&[&args[..], &more[..]].concat()).fine();
    assert!(told.contains("of 2 signals in 2 parts, 0 lost"), "{told}");
    let table = table(&site, "edge.csv");
    let rises = table["M104.0"].windows(2).filter(|pair| pair[0] == 0 && pair[1] == 1).count();
    assert_eq!(rises, 2, "one in each part");
    let first = table["M104.0"].iter().position(|bit| *bit == 1).expect("a rise");
    let before = table["time_ns"][first] - table["time_ns"][0];
    assert!((30_000_000..=40_000_000).contains(&before) || first < 20, "{before} ns");
    let refused = site.ob1(&["record", "recorded", "--signals", "Nothing", "--for", "1s", "--out", "no.csv"]);
    assert_eq!(refused.code, Some(1));
    assert!(refused.err.contains("\"Nothing\" is not the name of a cell"), "{}", refused.err);
    assert!(!site.path("no.csv").exists());
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Orders of a CP, its characters and telegrams, the death of its driver.
#[test]
fn the_lines_are_on_the_same_axis() {
    let site = Site::two_stations_on_a_cable();
    ["station-a.toml", "station-b.toml"].iter().for_each(|file| site.without_watchdog(file));
    let (a, b) = (site.run("station-a.toml").until_run(), site.run("station-b.toml").until_run());
    a.until("telegrams flow", |a| (a.cell("DB20.DONE") > 5).then_some(()));
    let args =
        ["record", "station-a.toml", "--signals", "M2.0,DB20.DONE,DB20.NUMBER", "--for", "3s", "--out", "a.ob1trace"];
    let recording = std::thread::scope(|scope| {
        let recording = scope.spawn(|| site.ob1(&args));
        a.until("it records", |_| site.path("a.ob1trace").exists().then_some(()));
        let done = a.cell("DB20.DONE");
        a.until("more telegrams", |a| (a.cell("DB20.DONE") > done + 5).then_some(()));
        a.driver_process().signal(Signal::KILL);
        recording.join().expect("recorded")
    });
    recording.fine();
    site.ob1(&["record", "--from", "a.ob1trace", "--out", "a.csv"]).fine();
    site.ob1(&["record", "--from", "a.ob1trace", "--out", "a.pftrace"]).fine();
    let (rows, tracks) = (table(&site, "a.csv")["DB20.DONE"].len(), perfetto(&site, "a.pftrace"));
    assert!(rows > 100, "{rows} rows");
    let ended = tracks["cp orders"]["slices"].as_array().expect("orders");
    let is_done = |order: &&Value| order[2].as_str().is_some_and(|text| text.ends_with(": order done"));
    let done = ended.iter().filter(is_done).count();
    // Until the driver died; then nobody listens until the new one does, and the cable goes on.
    let died = tracks["drivers and links"]["instants"][0][0].as_i64().expect("a time");
    let end = |order: &&Value| order[0].as_i64().expect("a time") + order[1].as_i64().expect("a time");
    let heard = ended.iter().filter(is_done).filter(|order| end(order) < died).count() as i64;
    let begin = tracks["signals / DB20.DONE"]["values"].as_array().expect("values");
    let until = begin.iter().take_while(|value| value[0].as_i64().is_some_and(|time| time < died)).last();
    let counted = until.expect("rows before")[1].as_i64().expect("a number") - begin[0][1].as_i64().expect("a number");
    // One is under way at either end, and the program counts it scans later.
    assert!((counted - heard).abs() <= 3 && heard > 2, "{heard} of {counted}");
    assert!(done > 5, "{done}");
    let out = tracks["cp line / out"]["slices"].as_array().expect("telegrams").len();
    let names = |track: &str| -> Vec<String> {
        let instants = tracks[track]["instants"].as_array().expect("instants");
        instants.iter().map(|instant| instant[1].as_str().expect("a name").to_owned()).collect()
    };
    assert!(out >= done && out <= ended.len() + 3, "{out} telegrams, {done} orders");
    let controls = names("cp line / out");
    assert!(controls.iter().filter(|name| name.starts_with("STX")).count() + 2 >= out, "{controls:?}");
    let notes = names("cp line / line");
    let stages = notes.iter().filter(|note| note.starts_with("times of the order: taken after "));
    let whole = stages.filter(|note| note.contains(" last out after ") && note.contains(" given after ")).count();
    assert!(whole + 1 >= done, "{notes:?}");
    let processes = names("drivers and links");
    assert!(processes.starts_with(&["cp is gone".to_owned(), "cp is up".to_owned()]), "{processes:?}");
    assert!(names("diagnostic buffer").iter().any(|name| name.starts_with("F2")), "the driver's loss");
    for station in [a, b] {
        assert_eq!(station.interrupt().code(), Some(0));
    }
}
