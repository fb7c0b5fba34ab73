//! The command with real processes, without drivers: exit codes, report, cells, one owner at a time, nothing left
//! behind.

use serde_json::Value;

use crate::bench;
use crate::bench::{Bench, PROGRAM, STATION, until};

#[test]
fn a_run_of_so_many_scans_leaves_a_report_and_nothing_else() {
    let bench = Bench::new();
    let output = bench.ob1(&["run", "bench.toml", "--scans", "50", "--report", "report.json", "--fence-scan"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("scans 50 "), "{output:?}");
    let report = std::fs::read(bench.folder.path().join("report.json")).expect("the report");
    let report: Value = serde_json::from_slice(&report).expect("JSON");
    let field = |name: &str| report[name].clone();
    assert_eq!((field("schema"), field("station"), field("ended")), (1.into(), "bench".into(), "scans".into()));
    assert_eq!((field("exit"), field("scans"), field("state")), (0.into(), 50.into(), "STOP".into()));
    assert_eq!(report["execution"]["count"], 50);
    assert!(report["memory"]["resident_kib"].as_u64() > Some(0));
    assert!(!bench.rundir().exists());
}

#[test]
fn cells_are_read_and_written_and_the_state_changed() {
    let bench = Bench::new();
    let _station = bench.start(&[]);
    until(|| bench.value("AW4") == 0x1234);
    assert_eq!(bench.value("DB5.SETPOINT"), 1.5);
    assert_eq!(bench.value("DB5.COUNT"), -3);
    assert_eq!(bench.code(&["set", "bench.toml", "DB5.SETPOINT=-2.25", "DB5.DBW4=16#FFFE"]), Some(0));
    assert_eq!((bench.value("DB5.SETPOINT"), bench.value("DB5.COUNT")), ((-2.25).into(), (-2).into()));
    for wrong in ["MW0=99999", "MX0=1", "T1=16#000A"] {
        assert_eq!(bench.code(&["set", "bench", wrong]), Some(8), "{wrong}");
    }
    assert_eq!(bench.code(&["set", "bench", "MW0"]), Some(1));
    assert_eq!(bench.code(&["get", "bench", "DB6.DBW0"]), Some(8));
    assert_eq!(bench.code(&["trace", "bench"]), Some(1), "it runs, and has no CP");

    assert_eq!(bench.code(&["ctl", "bench", "stop"]), Some(0));
    until(|| bench.json(&["ctl", "bench", "status", "--json"])["state"] == "STOP");
    assert_eq!(bench.value("AW4"), 0, "outputs are off");
    assert_eq!(bench.code(&["ctl", "bench", "cold"]), Some(0));
    until(|| bench.json(&["ctl", "bench", "status", "--json"])["state"] == "RUN");
    assert_eq!(bench.value("DB5.COUNT"), -3, "its load value");
    let hot = bench.ob1(&["ctl", "bench", "hot"]);
    assert_eq!(hot.status.code(), Some(8), "{hot:?}");
    assert!(String::from_utf8_lossy(&hot.stderr).contains("an S7-300 has no hot restart"), "{hot:?}");
    let events = bench.json(&["diag", "bench", "--json"]);
    let events: Vec<&str> =
        events["cpu"].as_array().expect("a list").iter().filter_map(|e| e["event"].as_str()).collect();
    assert_eq!(events, ["4302h", "4301h", "4304h", "4302h", "4301h"]);
}

/// A module reads its inputs again for each scan: what is set by hand is set there, and stays.
#[test]
fn an_input_set_by_hand_stays() {
    let bench = Bench::new();
    let _station = bench.start(&[]);
    until(|| bench.value("AW4") == 0x1234);
    assert_eq!(bench.code(&["set", "bench", "E0.0=1"]), Some(0));
    until(|| bench.value("AW4") == 0x1334);
    assert_eq!(bench.code(&["set", "bench", "EB1=16#56", "DB5.COUNT=8"]), Some(0));
    until(|| bench.value("AW4") == 0x1356);
    let scans = || bench.json(&["ctl", "bench", "status", "--json"])["scans"].as_u64();
    let then = scans();
    until(|| scans() > then.map(|count| count + 5));
    assert_eq!((bench.value("EW0"), bench.value("DB5.COUNT")), (0x1356.into(), 8.into()));
}

#[test]
fn an_s7_400_starts_hot() {
    let bench = Bench::new();
    bench.write("bench.toml", &format!("{STATION}\n[cpu]\nfamily = 400\n"));
    let _station = bench.start(&[]);
    assert_eq!(bench.code(&["set", "bench", "DB5.COUNT=7"]), Some(0));
    assert_eq!(bench.code(&["ctl", "bench", "hot"]), Some(0));
    let newest = || bench.json(&["diag", "bench", "--json"])["cpu"][1].clone();
    until(|| newest()["text"].as_str().is_some_and(|text| text.contains("hot restart")));
    assert_eq!(bench.value("DB5.COUNT"), 7, "everything keeps its value");
}

#[test]
fn a_fault_ends_a_bounded_run_and_not_an_unbounded_one() {
    let bench = Bench::new();
    let faulty = PROGRAM.replace("U     M      2.0", "UN    M      2.0");
    bench.write("bench.awl", &faulty);
    assert_eq!(bench.code(&["run", "bench.toml", "--for", "1h", "--report", "report.json", "--quiet"]), Some(3));
    let report = std::fs::read_to_string(bench.folder.path().join("report.json")).expect("the report");
    assert!(report.contains("4562h STOP by programming error") && report.contains("\"ended\": \"fault\""), "{report}");

    bench.write("bench.awl", PROGRAM);
    let mut station = bench.start(&[]);
    assert_eq!(bench.code(&["set", "bench", "M2.0=1"]), Some(0));
    until(|| bench.json(&["ctl", "bench", "status", "--json"])["state"] == "STOP");
    station.signal("-TERM");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(3));
    assert!(!bench.rundir().exists());
}

#[test]
fn one_runtime_for_a_station_and_ctrl_c_ends_it() {
    let bench = Bench::new();
    let mut station = bench.start(&[]);
    let second = bench.ob1(&["run", "bench.toml", "--scans", "1"]);
    assert_eq!(second.status.code(), Some(5), "{second:?}");
    assert!(String::from_utf8_lossy(&second.stderr).contains(&format!("process {}", station.child.id())), "{second:?}");
    station.signal("-INT");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
    assert!(!bench.rundir().exists());
    assert_eq!(bench.code(&["get", "bench", "M1.0"]), Some(5));
}

/// Signals that mean nothing to a station do nothing; Ctrl-\ and a failing power supply end it in order.
#[test]
fn no_signal_ends_a_station_without_a_word() {
    let bench = Bench::new();
    for ending in ["-QUIT", "-PWR", "-XCPU"] {
        let mut station = bench.start(&[]);
        for signal in ["-USR1", "-USR2", "-ALRM", "-VTALRM", "-PROF", "-IO"] {
            station.signal(signal);
        }
        let before = bench.value("MW0");
        until(|| bench.value("MW0") != before);
        station.signal(ending);
        assert_eq!(station.child.wait().expect("it ends").code(), Some(0), "{ending}");
        assert!(!bench.rundir().exists(), "{ending}");
    }
}

/// The loop triggers the cycle monitoring for ever: it is told of, questions are answered, STOP is obeyed.
#[test]
fn a_cycle_that_never_ends_is_told_of_and_stopped() {
    let bench = Bench::new();
    let endless = PROGRAM.replace("AUF   DB    77;", "SET;\nm: CALL SFC 43;\nSPA m;");
    bench.write("bench.awl", &endless);
    let mut station = bench.start(&[]);
    until(|| bench.value("MW0") != 0);
    assert_eq!(bench.code(&["set", "bench", "M2.0=1"]), Some(0));
    let status = || bench.json(&["ctl", "bench", "status", "--json"]);
    until(|| status()["stands_s"].as_u64() >= Some(3));
    assert_eq!(status()["state"], "RUN");
    let diag = bench.json(&["diag", "bench", "--json"]);
    assert_eq!(diag["cpu"][0]["event"], "F104h", "{diag}");
    assert_eq!(bench.code(&["ctl", "bench", "stop"]), Some(0));
    until(|| status()["state"] == "STOP");
    until(|| status()["stands_s"].is_null());
    station.signal("-INT");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
}

/// A wrong path is told from a station that does not run.
#[test]
fn a_station_file_that_is_not_there_is_named() {
    let bench = Bench::new();
    for args in [
        &["get", "nosuch.toml", "M1.0"][..],
        &["ctl", ".", "stop"],
        &["diag", "bench.awl"],
        &["top", "nosuch.toml", "--plain"],
        &["trace", "nosuch.toml"],
        &["bus", "watch", "nosuch.toml"],
    ] {
        let said = bench.ob1(args);
        assert_eq!(said.status.code(), Some(2), "{said:?}");
        let said = String::from_utf8_lossy(&said.stderr);
        assert!(said.contains("station file") && !said.contains("does not run"), "{args:?}: {said}");
    }
}

/// A FIFO to which nobody writes holds up no command; a pipe of the shell is read.
#[test]
fn a_fifo_is_not_waited_for() {
    let bench = Bench::new();
    for name in ["fifo", "fifo.toml", "fifo.xml"] {
        let made = std::process::Command::new("mkfifo").arg(bench.folder.path().join(name)).status();
        assert!(made.expect("mkfifo is there").success());
    }
    for (args, code) in [
        (&["check", "fifo"][..], 1),
        (&["check", "fifo.toml"], 1),
        (&["check", "fifo.xml"], 1),
        (&["check", "bench.awl", "--symbols", "fifo"], 1),
        (&["check", "bench.awl", "--numbers", "fifo"], 1),
        (&["check", "bench.awl", "--plugin", "./fifo"], 1),
        (&["run", "fifo.toml"], 2),
        (&["exec", "fifo"], 10),
        (&["test", "fifo"], 2),
        (&["trace", "--from", "fifo"], 6),
        (&["soak", "--compare", "fifo", "fifo"], 2),
    ] {
        let output = bench.ob1(args);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {output:?}");
        let text = String::from_utf8_lossy(&output.stdout).into_owned() + &said(&output);
        assert!(text.contains("it is a FIFO, not a file"), "{args:?}: {output:?}");
    }
    let ob1 = env!("CARGO_BIN_EXE_ob1");
    let mut piped = std::process::Command::new("sh");
    piped.args(["-c", &format!("cat bench.awl | {ob1} check /dev/stdin")]).current_dir(bench.folder.path());
    let output = piped.output().expect("sh starts");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn a_killed_runtime_leaves_nothing_behind() {
    let bench = Bench::new();
    let mut station = bench.start(&[]);
    assert!(bench.rundir().join("io").exists() && bench.rundir().join("control.sock").exists());
    station.child.kill().expect("it lives");
    station.child.wait().expect("it has ended");
    until(|| !bench.rundir().exists());
    // And the next one starts as if nothing had been.
    let _next = bench.start(&[]);
}

#[test]
fn check_says_what_is_wrong_and_where() {
    let bench = Bench::new();
    assert_eq!(bench.code(&["check", "bench.toml"]), Some(0));
    assert_eq!(bench.code(&["check", "bench.awl"]), Some(0));
    bench.write("bench.awl", &PROGRAM.replace("SPBN  ok", "SPRNG ok"));
    let found = bench.ob1(&["check", "bench.toml", "--json"]);
    assert_eq!(found.status.code(), Some(1));
    let found: Value = serde_json::from_slice(&found.stdout).expect("JSON");
    assert_eq!((found[0]["line"].clone(), found[0]["level"].clone()), (14.into(), "error".into()));
    assert_eq!(bench.code(&["run", "bench.toml"]), Some(2));
    bench.write("bench.awl", PROGRAM);
    bench.write("panel.toml", "[[at]]\ntime = \"1\"\nset = {}\n");
    assert_eq!(bench.code(&["check", "bench.toml"]), Some(1));
    assert_eq!(bench.code(&["run", "bench.toml"]), Some(2));
    bench.write("bench.toml", &format!("{STATION}\n[[plugin]]\npath = \"missing\"\n"));
    assert_eq!(bench.code(&["run", "bench.toml"]), Some(4));
    assert_eq!(bench.code(&["check", "bench.toml", "bench.awl"]), Some(1));
}

/// A CP with a simulated line, without the table of that.
const CP: &str = "
[[module]]
type = \"cp240\"
name = \"cp\"
address = 256
line = \"sim:a\"
params = { protocol = \"ascii\" }
";

#[test]
fn a_simulated_line_without_its_table_is_refused_with_a_hint() {
    let bench = Bench::new();
    bench.write("bench.toml", &format!("{STATION}{CP}"));
    let run = bench.ob1(&["run", "bench.toml"]);
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("[[simulated_line]] with name = \"a\""), "{run:?}");
    bench.write("bench.toml", &format!("{STATION}{CP}\n[[simulated_line]]\nname = \"a\"\n"));
    assert_eq!(bench.code(&["check", "bench.toml"]), Some(0));
}

#[test]
fn retentive_memory_outlasts_a_power_cycle() {
    let bench = Bench::new();
    let station = format!("{STATION}\n[retentive]\nmemory = [\"0..1\"]\nevery = \"100ms\"\n");
    bench.write("bench.toml", &station);
    let count = || i64::from_str_radix(&text_of(&bench, "MW0"), 16).expect("hexadecimal");
    {
        let mut running = bench.start(&[]);
        assert_eq!(bench.code(&["set", "bench", "DB5.SETPOINT=7.5", "MW0=1000", "MW2=0"]), Some(0));
        running.signal("-INT");
        assert_eq!(running.child.wait().expect("it ends").code(), Some(0));
    }
    {
        let mut running = bench.start(&["--fence-scan"]);
        assert_eq!(bench.value("DB5.SETPOINT"), 7.5);
        assert!(count() >= 1000);
        // Killed: what was written in RUN is there.
        assert_eq!(bench.code(&["set", "bench", "DB5.SETPOINT=-1.0"]), Some(0));
        let written = || file_with(&bench, &(-1.0f32).to_be_bytes());
        until(written);
        running.child.kill().expect("it lives");
        running.child.wait().expect("it has ended");
    }
    until(|| !bench.rundir().exists());
    {
        let _running = bench.start(&[]);
        assert_eq!(bench.value("DB5.SETPOINT"), -1.0);
        assert_eq!(bench.code(&["ctl", "bench", "cold"]), Some(0));
        until(|| bench.value("DB5.SETPOINT") == 1.5);
    }
    // Another program: it takes what it has in common.
    until(|| !bench.rundir().exists());
    bench.write("bench.awl", &PROGRAM.replace("SETPOINT : REAL", "OTHER : INT; SETPOINT : REAL"));
    let output = bench.ob1(&["run", "bench.toml", "--scans", "5"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("has no place for DB 5"), "{output:?}");
}

fn text_of(bench: &Bench, cell: &str) -> String {
    bench.json(&["get", "bench", cell, "--json"])[0]["hex"].as_str().unwrap_or_default().to_owned()
}

/// Whether a retentive file has these bytes.
fn file_with(bench: &Bench, bytes: &[u8]) -> bool {
    let read = |slot: &str| std::fs::read(bench.folder.path().join(format!(".bench.retentive.{slot}")));
    ["a", "b"].iter().filter_map(|slot| read(slot).ok()).any(|file| file.windows(bytes.len()).any(|w| w == bytes))
}

fn said(output: &std::process::Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Every change of state is reported once, with the place of the error and what helps; the end has its exit code.
#[test]
fn each_change_of_state_is_told_once() {
    let bench = Bench::new();
    let output = bench.ob1(&["run", "bench.toml", "--scans", "5"]);
    let text = said(&output);
    for part in ["STARTUP: 4301h", "RUN: 4302h", "STOP: 4304h STOP by operator"] {
        assert_eq!(text.matches(part).count(), 1, "{part}: {text}");
    }
    assert_eq!(output.status.code(), Some(0), "{text}");

    bench.write("bench.awl", &PROGRAM.replace("U     M      2.0", "UN    M      2.0"));
    let output = bench.ob1(&["run", "bench.toml", "--for", "1h"]);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    for part in [
        "STOP: 4562h STOP by programming error, OB 121 not loaded",
        "because of 253Ah data block not loaded (OB 1, network 1, line 15, ",
        "DB 77), bench.awl:15",
        "= Load the data block",
    ] {
        assert_eq!(text.matches(part).count(), 1, "{part}: {text}");
    }
}

/// What the system refuses the scan is reported when the run starts, however little else is printed.
#[test]
fn a_refused_posture_is_told_at_the_start() {
    let bench = Bench::new();
    bench.write("bench.toml", &format!("{STATION}\n[cpu.realtime]\naffinity = [1000]\n"));
    let output = bench.ob1(&["run", "bench.toml", "--scans", "5", "--quiet"]);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert_eq!(text.matches("WARN real time, not granted: cores [1000]. ").count(), 1, "{text}");
    assert_eq!(text.matches("How to get it: ob1 check bench.toml --posture").count(), 1, "{text}");
}

/// A STOP in start-up never was a RUN, and is not reported as one.
#[test]
fn a_stop_in_start_up_is_not_told_as_running() {
    let bench = Bench::new();
    let start_up = "ORGANIZATION_BLOCK OB 100\nBEGIN\nNETWORK\n      CALL SFC 46;\nEND_ORGANIZATION_BLOCK\n";
    bench.write("bench.awl", &format!("{PROGRAM}\n{start_up}"));
    for quiet in [&[][..], &["--quiet"]] {
        let args = [&["run", "bench.toml", "--for", "1h"], quiet].concat();
        let output = bench.ob1(&args);
        let text = said(&output);
        assert_eq!(output.status.code(), Some(3), "{text}");
        assert_eq!(text.matches("STOP: 4543h STOP by the program (SFC 46)").count(), 1, "{text}");
        assert!(!text.contains("RUN: ") && !text.contains("running"), "{text}");
    }
}

#[test]
fn a_program_without_ob_1_is_told() {
    let bench = Bench::new();
    bench.write(
        "bench.awl",
        &PROGRAM
            .replace("ORGANIZATION_BLOCK OB 1\n", "FUNCTION FC 1 : VOID\n")
            .replace("END_ORGANIZATION_BLOCK", "END_FUNCTION"),
    );
    for args in [
        &["check", "bench.toml"][..],
        &["run", "bench.toml", "--scans", "3"],
        &["run", "bench.toml", "--scans", "3", "--quiet"],
    ] {
        let output = bench.ob1(args);
        assert!(said(&output).contains("L021: the program has no OB 1"), "{args:?}: {output:?}");
        assert_eq!(output.status.code(), Some(0), "{args:?}: {output:?}");
    }
    let output = bench.ob1(&["exec", "bench.awl", "--limit", "10ms", "--quiet"]);
    assert!(said(&output).contains("L021: the program has no OB 1"), "{output:?}");
}

/// A statement that would be an error at run time, because `[cpu]` gives no such timer.
#[test]
fn a_timer_that_the_cpu_does_not_have_is_told() {
    let bench = Bench::new();
    let text = "ORGANIZATION_BLOCK OB 1\nBEGIN\n  U M 0.0;\n  L S5T#2S;\n  SE T 256;\nEND_ORGANIZATION_BLOCK\n";
    for (number, is_told) in [("T 255", false), ("T 256", true)] {
        bench.write("bench.awl", &text.replace("T 256", number));
        let output = bench.ob1(&["check", "bench.toml"]);
        assert_eq!(said(&output).contains("L031: the CPU has no T 256"), is_told, "{output:?}");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
    }
}

#[test]
fn an_empty_variable_counts_as_not_set() {
    let bench = Bench::new();
    bench.write("bench.toml", &format!("{STATION}{CP}\n[[simulated_line]]\nname = \"a\"\n"));
    let with = |args: &[&str], variable: &str, value: &str| {
        said(&bench.command(args).env(variable, value).output().expect("ob1 starts"))
    };
    let run = ["run", "bench.toml", "--scans", "3"];
    assert!(with(&run, "OB1_CP", "/none").contains("OB1_CP names /none, which is not there"));
    let text = with(&run, "OB1_CP", "");
    assert!(!text.contains("OB1_CP names"), "{text}");
    let text = with(&["check", "bench.awl", "--plugin", "none"], "OB1_PLUGIN_DIR", "");
    assert!(text.contains("libnone.so in /"), "{text}");
}

#[test]
fn exec_says_how_it_ended() {
    let bench = Bench::new();
    let output = bench.ob1(&["exec", "bench.awl", "--limit", "10ms"]);
    let text = said(&output);
    assert!(text.ends_with("ob1: the limit was reached in RUN after 10 scans, 0.010 s; exit code 3\n"), "{text}");
    bench.write("bench.awl", &PROGRAM.replace("U     M      2.0", "UN    M      2.0"));
    let output = bench.ob1(&["exec", "bench.awl", "--limit", "10ms"]);
    let text = said(&output);
    assert!(text.contains("253Ah data block not loaded") && text.contains(", bench.awl:15\n"), "{text}");
    assert!(text.contains("\nob1: a fault stopped the CPU after ") && text.ends_with("; exit code 11\n"), "{text}");
}

/// Idle clients keep nobody out: neither others nor the run itself.
#[test]
fn idle_clients_lock_nobody_out() {
    use std::io::{BufRead as _, BufReader, Write as _};
    use std::os::unix::net::UnixStream;

    let bench = Bench::new();
    let socket = bench.rundir().join("control.sock");
    // With few descriptors too: the shell's limit is the run's.
    for limit in ["", "ulimit -n 56; "] {
        let mut command = std::process::Command::new("sh");
        let ob1 = env!("CARGO_BIN_EXE_ob1");
        command.args(["-c", &format!("{limit}exec {ob1} run bench.toml --quiet")]).current_dir(bench.folder.path());
        command.env("XDG_RUNTIME_DIR", bench.folder.path()).stdin(std::process::Stdio::null());
        let mut station =
            bench::Station { child: command.stdout(std::process::Stdio::null()).spawn().expect("a shell") };
        bench.until_state("RUN");
        let idle: Vec<_> = (0..64).filter_map(|_| UnixStream::connect(&socket).ok()).collect();
        assert!(idle.len() > 32);
        assert_eq!(bench.code(&["ctl", "bench", "stop"]), Some(0), "{limit}");
        bench.until_state("STOP");
        // One that asks much and reads nothing.
        let mut slow = UnixStream::connect(&socket).expect("it listens");
        for _ in 0..200 {
            slow.write_all(b"{\"op\":\"timing\",\"histograms\":true}\n").expect("room in the socket");
        }
        for _ in 0..20 {
            assert_eq!(bench.code(&["ctl", "bench", "status"]), Some(0), "{limit}");
        }
        let mut first = String::new();
        BufReader::new(slow).read_line(&mut first).expect("an answer");
        assert!(first.contains("\"ok\":true"), "{first}");
        station.signal("-INT");
        assert_eq!(station.child.wait().expect("it ends").code(), Some(0), "{limit}");
        drop(idle);
    }
}

/// All cells of a request are of one scan, however many; a set lands whole or not at all.
#[test]
fn requests_are_of_one_scan() {
    let bench = Bench::new();
    // MW 0 counts; DB 6 holds the count a thousand times.
    let fill: String = (0..1000).map(|n| format!("      T     DB6.DBW {};\n", 2 * n)).collect();
    let code =
        PROGRAM.replace("      U     M      2.0;\n", &format!("      L     MW 0;\n{fill}      U     M      2.0;\n"));
    let block = "DATA_BLOCK DB 6\nSTRUCT\n  A : ARRAY [1..1000] OF WORD;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n";
    bench.write("bench.awl", &format!("{code}\n{block}"));
    let _station = bench.start(&[]);
    let names: Vec<String> = (0..1000).map(|n| format!("DB6.DBW{}", 2 * n)).chain(["MW0".to_owned()]).collect();
    let args: Vec<&str> = ["get", "bench", "--json"].into_iter().chain(names.iter().map(String::as_str)).collect();
    for _ in 0..10 {
        let values = bench.json(&args);
        let first = values[0]["hex"].clone();
        assert!(first.is_string(), "{values}");
        let all = values.as_array().expect("a list");
        assert_eq!(all.len(), 1001);
        assert!(all.iter().all(|value| value["hex"] == first), "torn: {values}");
    }
    // One cell outside refuses the request and names itself.
    let wrong = bench.ob1(&["get", "bench", "MW0", "DB6.DBW1999", "DB6.DBW0"]);
    assert_eq!(wrong.status.code(), Some(8));
    assert!(said(&wrong).contains("DB6.DBW1999: outside the area"), "{wrong:?}");
    assert_eq!(bench.code(&["set", "bench", "MW20=5", "DB5.COUNT=9"]), Some(0));
    assert_eq!((bench.value("MW20"), bench.value("DB5.COUNT")), (5.into(), 9.into()));
    let refused = bench.ob1(&["set", "bench", "DB5.COUNT=10", "DB77.DBW0=1", "MW20=6"]);
    assert_eq!(refused.status.code(), Some(8));
    assert!(said(&refused).contains("DB77.DBW0: the data block is not loaded"), "{refused:?}");
    assert_eq!((bench.value("MW20"), bench.value("DB5.COUNT")), (5.into(), 9.into()), "nothing was written");
}
