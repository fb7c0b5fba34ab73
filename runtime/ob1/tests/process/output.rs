//! The reader of what the command writes may be slow or gone, or the disk full: the command does not care.

use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

use crate::bench::{Bench, PROGRAM, STATION, STIMULUS, Station, until};

/// The writing end of a pipe that takes no byte more, and its reading end.
fn full_pipe() -> (io::PipeReader, io::PipeWriter) {
    let (reader, mut writer) = io::pipe().expect("descriptors");
    let flags = fcntl_getfl(&writer).expect("a descriptor");
    fcntl_setfl(&writer, flags | OFlags::NONBLOCK).expect("a pipe");
    while writer.write(&[b'.'; 4096]).is_ok() {}
    while writer.write(b".").is_ok() {}
    fcntl_setfl(&writer, flags).expect("a pipe");
    (reader, writer)
}

fn full_disk() -> File {
    File::options().write(true).open("/dev/full").expect("there")
}

fn run(bench: &Bench, args: &[&str]) -> Command {
    let mut command = bench.command(&["run", "bench.toml"]);
    command.args(args).stdout(Stdio::null());
    command
}

/// To STOP and to RUN again: each is logged.
fn there_and_back(bench: &Bench) {
    for (word, state) in [("stop", "STOP"), ("run", "RUN")] {
        assert_eq!(bench.code(&["ctl", "bench", word]), Some(0));
        bench.until_state(state);
    }
}

fn lost(bench: &Bench) -> Option<u64> {
    bench.json(&["ctl", "bench", "status", "--json"])["log_lost"].as_u64()
}

#[test]
fn a_log_on_a_full_disk_is_counted_and_changes_nothing() {
    let bench = Bench::new();
    let output = run(&bench, &["--scans", "50"]).stderr(full_disk()).status().expect("ob1 starts");
    assert_eq!(output.code(), Some(0));
    let mut station = Station { child: run(&bench, &[]).stderr(full_disk()).spawn().expect("ob1 starts") };
    bench.until_state("RUN");
    there_and_back(&bench);
    until(|| lost(&bench) > Some(0));
    let status = bench.ob1(&["ctl", "bench", "status"]);
    assert!(String::from_utf8_lossy(&status.stdout).contains("log lines lost"), "{status:?}");
    station.signal("-INT");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
}

/// A limit of files, as of a shell or of a service: the log has reached it.
#[test]
fn a_log_that_may_not_grow_any_more_is_counted_and_changes_nothing() {
    let bench = Bench::new();
    let log = File::create(bench.folder.path().join("log")).expect("writable");
    let mut station = Station { child: run(&bench, &[]).stderr(log).spawn().expect("ob1 starts") };
    bench.until_state("RUN");
    station.limit_files(Some(1));
    there_and_back(&bench);
    until(|| lost(&bench) > Some(0));
    station.signal("-INT");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
}

#[test]
fn a_reader_of_the_log_that_ends_changes_nothing() {
    let bench = Bench::new();
    let mut station = Station { child: run(&bench, &[]).stderr(Stdio::piped()).spawn().expect("ob1 starts") };
    bench.until_state("RUN");
    drop::<Option<ChildStderr>>(station.child.stderr.take());
    there_and_back(&bench);
    station.signal("-INT");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
}

#[test]
fn a_log_that_nobody_reads_holds_nothing_up() {
    let bench = Bench::new();
    let (reader, writer) = full_pipe();
    let mut command = run(&bench, &[]);
    // Its summary too.
    command.stdout(writer.try_clone().expect("a descriptor")).stderr(writer);
    let mut station = Station { child: command.spawn().expect("ob1 starts") };
    drop(command);
    bench.until_state("RUN");
    there_and_back(&bench);
    station.signal("-INT");
    assert_eq!(station.child.wait().expect("it ends").code(), Some(0));
    assert!(!bench.rundir().exists());
    drop(reader);
}

/// A service has a stream of the journal as standard error, and `JOURNAL_STREAM` names it; here a file stands for it.
#[test]
fn each_line_for_the_journal_begins_with_its_priority() {
    let bench = Bench::new();
    let path = bench.folder.path().join("log");
    let told = |stream: &str, args: &[&str]| {
        let log = File::create(&path).expect("writable");
        let own = log.metadata().expect("a file");
        let stream = stream.replace("OWN", &format!("{}:{}", own.dev(), own.ino()));
        run(&bench, args).env("JOURNAL_STREAM", stream).stderr(log).status().expect("ob1 starts");
        std::fs::read_to_string(&path).expect("a log")
    };
    let well = told("OWN", &["--scans", "5"]);
    assert!(well.lines().any(|line| line.starts_with("<6>") && line.contains("station bench, process")), "{well}");
    assert!(well.lines().all(|line| line.is_empty() || line.starts_with('<')), "{well}");
    // Somebody has redirected standard error.
    let elsewhere = told("1:2", &["--scans", "5"]);
    assert!(elsewhere.lines().all(|line| !line.starts_with('<')), "{elsewhere}");
    // A message of several lines, and a warning.
    bench.write("bench.toml", &STATION.replace("[program]", "[program]\nsuorces = []"));
    let wrong = told("OWN", &["--scans", "5"]);
    assert!(wrong.lines().filter(|line| line.starts_with("<3>")).count() > 1, "{wrong}");
    bench.write("bench.toml", STATION);
    bench.write("panel.toml", &STIMULUS.replace("EW 0", "EW 50"));
    let warned = told("OWN", &["--scans", "1"]);
    assert!(warned.lines().any(|line| line.starts_with("<4>") && line.contains("panel.toml")), "{warned}");
}

fn ends(child: io::Result<Child>) -> (ExitStatus, String) {
    let output = child.and_then(Child::wait_with_output).expect("ob1 starts and ends");
    (output.status, String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Every command that prints, with its exit code.
const PRINTING: &[(&[&str], i32)] = &[
    (&["--help"], 0),
    (&["--version"], 0),
    (&["check", "bench.toml"], 0),
    (&["check", "bench.toml", "--json"], 0),
    (&["check", "bench.toml", "--listing"], 0),
    (&["check", "wrong.awl"], 1),
    (&["xref", "bench.toml"], 0),
    (&["xref", "bench.toml", "--json"], 0),
    (&["test", "bench.test.toml"], 1),
    (&["get", "bench", "MW0"], 0),
    (&["get", "bench", "MW0", "--json"], 0),
    (&["ctl", "bench", "status"], 0),
    (&["ctl", "bench", "status", "--json"], 0),
    (&["ctl", "bench", "timing"], 0),
    (&["ctl", "bench", "recorder"], 0),
    (&["diag", "bench"], 0),
    (&["diag", "bench", "--json"], 0),
    (&["top", "bench", "--plain", "--count", "1"], 0),
];

const TEST: &str = "[[test]]\nname = \"fails\"\n[[test.step]]\nexpect = { \"MW 0\" = 7 }\n";

#[test]
fn a_command_ends_quietly_when_nobody_reads_it_any_more() {
    let bench = Bench::new();
    bench.write("wrong.awl", &PROGRAM.replace("SPBN  ok", "SPRNG ok"));
    bench.write("bench.test.toml", &format!("station = \"bench.toml\"\n{TEST}"));
    let _station = bench.start(&[]);
    for (args, code) in PRINTING {
        let (reader, writer) = io::pipe().expect("descriptors");
        drop(reader);
        let (status, said) = ends(bench.command(args).stdout(writer).stderr(Stdio::piped()).spawn());
        assert_eq!(status.code(), Some(*code), "{args:?}: {said}");
        assert!(!said.contains("panick") && !said.contains("internal error"), "{args:?}: {said}");
    }
    // One without an end of its own.
    let mut top = bench.command(&["top", "bench", "--plain", "--every", "10ms"]);
    let mut child = top.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("ob1 starts");
    drop(child.stdout.take());
    assert_eq!(ends(Ok(child)).0.code(), Some(0));
}

#[test]
fn an_output_that_cannot_be_written_is_told() {
    let bench = Bench::new();
    let _station = bench.start(&[]);
    for (args, code) in PRINTING.iter().filter(|(args, code)| *code == 0 && args[0] != "test") {
        let (status, said) = ends(bench.command(args).stdout(full_disk()).stderr(Stdio::piped()).spawn());
        assert_eq!(status.code(), Some(6), "{args:?} ({code}): {said}");
        assert!(said.contains("ob1: standard output: No space left on device"), "{args:?}: {said}");
    }
}
