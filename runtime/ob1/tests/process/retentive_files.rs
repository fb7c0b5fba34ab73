//! The files of retentive memory under a real run: a disk that takes nothing more, two runs at once, a folder that
//! cannot be used.

use serde_json::Value;

use crate::bench::{Bench, PROGRAM, STATION, until};

fn bench() -> Bench {
    let bench = Bench::new();
    // MW 0 counts scans: there is always something to write.
    bench.write("bench.toml", &format!("{STATION}\n[retentive]\nmemory = [\"0..255\"]\nevery = \"100ms\"\n"));
    bench
}

fn retentive(bench: &Bench) -> Value {
    bench.json(&["ctl", "bench", "status", "--json"])["retentive"].clone()
}

fn entries(bench: &Bench, event: &str) -> usize {
    let diag = bench.json(&["diag", "bench", "--json"]);
    diag["cpu"].as_array().map_or(0, |list| list.iter().filter(|entry| entry["event"] == event).count())
}

/// The station continues; each state is reported once, with the age of the last good image.
#[test]
fn a_disk_that_takes_nothing_more_is_told_once() {
    let bench = bench();
    let station = bench.start(&[]);
    until(|| retentive(&bench)["generation"].as_u64() > Some(2));
    station.limit_files(Some(100));
    until(|| retentive(&bench)["error"].as_str().is_some_and(|text| text.contains("File too large")));
    let age = || retentive(&bench)["age_ns"].as_u64();
    let then = age();
    // Some attempts more.
    until(|| age() > then.map(|age| age + 500_000_000));
    assert_eq!((entries(&bench, "F301h"), entries(&bench, "F302h")), (1, 0));
    assert_eq!(bench.json(&["ctl", "bench", "status", "--json"])["state"], "RUN");
    let status = bench.ob1(&["ctl", "bench", "status"]);
    assert!(String::from_utf8_lossy(&status.stdout).contains("cannot be written: File too large"), "{status:?}");
    station.limit_files(None);
    until(|| !retentive(&bench)["error"].is_string());
    until(|| entries(&bench, "F302h") == 1);
    assert_eq!(entries(&bench, "F301h"), 1);
}

/// `ob1 run station.toml` in the station's own folder: two generations, and nothing to complain of.
#[test]
fn a_bare_file_name_has_two_generations() {
    let bench = bench();
    let mut station = bench.start(&[]);
    until(|| retentive(&bench)["generation"].as_u64() >= Some(3));
    assert_eq!((retentive(&bench)["error"].clone(), entries(&bench, "F301h")), (Value::Null, 0));
    for slot in ["a", "b"] {
        assert!(bench.folder.path().join(format!(".bench.retentive.{slot}")).exists(), "{slot}");
    }
    station.signal("-INT");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
}

/// Whoever looks at the diagnostic buffer sees why the values are gone.
#[test]
fn files_that_are_refused_are_an_entry_of_the_diagnostic_buffer() {
    let bench = bench();
    for slot in ["a", "b"] {
        bench.write(&format!(".bench.retentive.{slot}"), "torn");
    }
    for refused in [1, 0] {
        let mut station = bench.start(&[]);
        until(|| retentive(&bench)["generation"].is_u64());
        assert_eq!(entries(&bench, "F303h"), refused);
        station.signal("-INT");
        assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
    }
}

/// After a start with the wrong program the right one gets its values back, as docs/station-file.md says.
#[test]
fn a_file_of_the_right_program_can_be_put_back() {
    let bench = bench();
    let count = || bench.value("DB5.COUNT");
    let run = |bench: &Bench, set: Option<&str>| {
        let mut station = bench.start(&[]);
        if let Some(set) = set {
            assert_eq!(bench.code(&["set", "bench", set]), Some(0));
        }
        let found = count();
        station.signal("-INT");
        assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
        found
    };
    assert_eq!(run(&bench, Some("DB5.COUNT=4711")), 4711);
    // DB 5 is declared differently there: bit memory is taken, the data block is not, and the file is kept.
    bench.write("bench.awl", &PROGRAM.replace("COUNT : INT := -3;", "COUNT : INT := -3;\n  MORE : INT;"));
    let station = bench.start(&[]);
    assert_eq!(count(), -3);
    assert_eq!(entries(&bench, "F304h"), 1);
    drop(station);
    assert_eq!(run(&bench, None), -3);
    bench.write("bench.awl", PROGRAM);
    let path = |name: &str| bench.folder.path().join(format!(".bench.retentive.{name}"));
    let kept = ["a.refused", "b.refused"].map(path).into_iter().find(|path| path.exists()).expect("kept");
    for slot in ["a", "b"] {
        let _ = std::fs::remove_file(path(slot));
    }
    std::fs::rename(kept, path("a")).expect("there");
    assert_eq!(run(&bench, None), 4711);
}

#[test]
fn a_station_runs_once_whatever_its_runtime_directory() {
    let bench = bench();
    let station = bench.start(&[]);
    let other = tempfile::tempdir().expect("a directory");
    let mut second = bench.command(&["run", "bench.toml", "--scans", "1"]);
    let output = second.env("XDG_RUNTIME_DIR", other.path()).output().expect("ob1 starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(5), "{said}");
    assert!(said.contains(&format!("in use by process {}", station.child.id())), "{said}");
}

#[test]
fn a_block_that_is_named_and_not_retentive_is_a_warning_with_its_place() {
    let bench = bench();
    let station = format!("{STATION}\n[retentive]\ndata = [\"DB 5\"]\n");
    bench.write("bench.toml", &station);
    let told = |args: &[&str]| {
        let output = bench.ob1(args);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout)
    };
    let check = ["check", "bench.toml"];
    assert!(!told(&check).contains("L023"));
    bench.write("bench.awl", &PROGRAM.replace("DATA_BLOCK DB 5\n", "DATA_BLOCK DB 5\nNON_RETAIN\n"));
    let place = format!("bench.toml:{}:9: warning L023: DB 5", station.lines().count());
    for args in [&check[..], &["run", "bench.toml", "--scans", "3"]] {
        let text = told(args);
        assert!(text.contains(&place), "{args:?}: {text}");
    }
}

#[test]
fn a_folder_that_cannot_be_used_is_refused_at_once() {
    let bench = bench();
    let text = std::fs::read_to_string(bench.folder.path().join("bench.toml")).expect("there");
    bench.write("bench.toml", &text.replace("name = \"bench\"", "name = \"bench\"\nstate = \"bench.awl/below\""));
    let began = std::time::Instant::now();
    let output = bench.ob1(&["run", "bench.toml", "--scans", "1"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(6), "{said}");
    // The guardian does not wait for what this process still holds.
    assert!(began.elapsed() < std::time::Duration::from_secs(4), "{:?}", began.elapsed());
    assert!(said.contains("bench.awl/below") && said.contains("  = name a folder"), "{said}");
    assert!(!said.contains("STARTUP") && !bench.rundir().exists(), "{said}");
}
