//! `ob1 new`: what it writes is checked, tested and run as its README says, without a change.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use clap::Parser as _;
use ob1_command::cli::Cli;

fn run(program: &str, folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(program);
    command.args(args).current_dir(folder).env("XDG_RUNTIME_DIR", folder).stdin(Stdio::null());
    command.output().unwrap_or_else(|error| panic!("{program}: {error}"))
}

fn ob1(folder: &Path, args: &[&str]) -> Output {
    run(env!("CARGO_BIN_EXE_ob1"), folder, args)
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn good(output: &Output) -> String {
    assert!(output.status.success(), "{:?}: {}", output.status, said(output));
    said(output)
}

/// The station of a folder: no finding, tests that pass, and a run.
fn it_runs(folder: &Path, tests: &str) {
    assert_eq!(good(&ob1(folder, &["check", "station.toml", "--lints"])), "ok\n");
    let told = good(&ob1(folder, &["test"]));
    assert!(told.contains(&format!("{tests} passed, 0 failed")), "{told}");
    good(&ob1(folder, &["run", "station.toml", "--scans", "5", "--quiet"]));
    the_readme_is_right(folder);
}

/// Its command lines are such, and the files it names are there.
fn the_readme_is_right(folder: &Path) {
    let readme = std::fs::read_to_string(folder.join("README.md")).expect("a README");
    let lines: Vec<&str> = readme.lines().filter_map(|line| line.strip_prefix("    ob1 ")).collect();
    assert!(lines.len() >= 5, "{readme}");
    for line in lines {
        let words = line.split('#').next().unwrap_or_default().split_whitespace();
        let parsed = Cli::try_parse_from(std::iter::once("ob1").chain(words));
        assert!(parsed.is_ok(), "{line}: {parsed:?}");
    }
    for name in readme.split("| `").skip(1).filter_map(|rest| rest.split('`').next()) {
        assert!(folder.join(name).is_file(), "{name} is not there:\n{readme}");
    }
}

#[test]
fn a_new_station_runs() {
    let base = tempfile::tempdir().expect("a directory");
    let told = good(&ob1(base.path(), &["new", "station", "press"]));
    assert!(told.contains("ob1 run station.toml") && told.contains("cd press"), "{told}");
    // The best posture that the user may have, and one line that says what is missing.
    assert_eq!(told.matches("\nreal time").count(), 1, "{told}");
    let press = base.path().join("press");
    let station = std::fs::read_to_string(press.join("station.toml")).expect("written");
    for key in ["\n[cpu.realtime]", "\npriority = 50", "\nlock_memory = true", "\nkeep_awake = true"] {
        assert!(station.contains(key), "{key}: {station}");
    }
    it_runs(&press, "2");
    // Its sources do not need the station.
    let exec = ob1(&press, &["exec", "main.awl", "--symbols", "symbols.sdf", "--limit", "1s"]);
    assert_eq!(exec.status.code(), Some(3), "{}", said(&exec));
    // The same machine in SCL, with the same tests.
    good(&ob1(base.path(), &["new", "station", "mill", "--language", "scl"]));
    it_runs(&base.path().join("mill"), "2");
    // Where systemd would look for it.
    good(&ob1(base.path(), &["new", "station", "etc/ob1/line-7"]));
    let station = std::fs::read_to_string(base.path().join("etc/ob1/line-7/station.toml")).expect("written");
    assert!(station.contains("name = \"line-7\""), "{station}");
}

/// Program status and breakpoints of a program in SCL show its lines.
#[test]
fn a_program_in_scl_is_watched_by_its_lines() {
    let base = tempfile::tempdir().expect("a directory");
    good(&ob1(base.path(), &["new", "station", "mill", "--language", "scl"]));
    let start = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
        command.args(args).current_dir(base.path()).env("XDG_RUNTIME_DIR", base.path());
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it starts")
    };
    let mut station = start(&["run", "mill/station.toml", "--quiet"]);
    let status = || ob1(base.path(), &["status", "mill", "OB", "1", "--once"]);
    let began = std::time::Instant::now();
    let mut shown = status();
    while !shown.status.success() && began.elapsed().as_secs() < 30 {
        shown = status();
    }
    let shown = good(&shown);
    let row = |line: &str| shown.lines().find(|row| row.trim_start().starts_with(line)).unwrap_or_default();
    assert!(row("10 ").contains("IF NOT \"Stop\" OR NOT \"Ready\" THEN"), "{shown}");
    assert!(row("17 ").contains("\"Lamp\" := ") && !row("17 ").ends_with(" -"), "{shown}");
    assert!(row("13 ").ends_with(" -"), "this line is jumped over: {shown}");
    let mut debug = start(&["debug", "mill", "--break", "OB 1:17"]);
    std::io::Write::write_all(debug.stdin.as_mut().expect("a pipe"), b"wait\nquit\n").expect("it reads");
    let said = debug.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.contains("main.scl:17, "), "{said}");
    station.kill().expect("it runs");
    station.wait().expect("it ends");
}

/// A user without rights: the same station, told once at its making and once at each start what is missing.
#[test]
fn a_user_without_rights_is_told_what_is_missing() {
    if !rustix::process::geteuid().is_root() {
        return eprintln!("skipped: only root can become a user without rights");
    }
    let base = tempfile::tempdir().expect("a directory");
    let open = std::os::unix::fs::PermissionsExt::from_mode(0o777);
    std::fs::set_permissions(base.path(), open).expect("ours");
    // The binaries of a build may be in a folder that only root can read.
    let program = base.path().join("ob1");
    std::fs::copy(env!("CARGO_BIN_EXE_ob1"), &program).expect("room");
    let user = |args: &[&str]| {
        let mut command = Command::new("setpriv");
        command.args(["--reuid=65534", "--regid=65534", "--clear-groups", "--inh-caps=-all"]).arg(&program).args(args);
        command.current_dir(base.path()).env("XDG_RUNTIME_DIR", base.path()).stdin(Stdio::null());
        good(&command.output().expect("util-linux"))
    };
    let line = "real time, not granted: lock memory";
    let (made, run) =
        (user(&["new", "station", "press"]), user(&["run", "press/station.toml", "--scans", "5", "--quiet"]));
    for (told, file) in [(&made, "station.toml"), (&run, "press/station.toml")] {
        assert_eq!(told.matches(line).count(), 1, "{told}");
        let found = told.lines().find(|l| l.contains(line)).expect("counted");
        let way = format!("How to get it: ob1 check {file} --posture");
        assert!(found.contains("SCHED_FIFO priority 50") && found.contains(&way), "{found}");
    }
}

#[test]
fn what_lies_there_stays_as_it_is() {
    let base = tempfile::tempdir().expect("a directory");
    good(&ob1(base.path(), &["new", "station", "press"]));
    let file = base.path().join("press/main.awl");
    std::fs::write(&file, "// mine\n").expect("written");
    for what in ["station", "plugin"] {
        let again = ob1(base.path(), &["new", what, "press"]);
        assert_eq!(again.status.code(), Some(1));
        assert!(said(&again).starts_with("press: error N002: it exists already"), "{}", said(&again));
    }
    assert_eq!(std::fs::read_to_string(&file).expect("there"), "// mine\n");
    for (args, code, exit) in [
        (&["new", "station", "a b"][..], "N001", 1),
        (&["new", "station", ".."], "N001", 1),
        (&["new", "station", "--", "-x"], "N001", 1),
        (&["new", "plugin", "x", "--language", "rust", "--sdk", "."], "N004", 1),
        (&["new", "plugin", "7x", "--language", "rust"], "N001", 1),
        (&["new", "station", "/proc/ob1/press"], "N003", 6),
    ] {
        let refused = ob1(base.path(), args);
        assert_eq!(refused.status.code(), Some(exit), "{args:?}: {}", said(&refused));
        assert!(said(&refused).contains(&format!(" error {code}: ")), "{args:?}: {}", said(&refused));
    }
    let left: Vec<_> = std::fs::read_dir(base.path()).expect("there").flatten().map(|e| e.file_name()).collect();
    assert_eq!(left, ["press"], "nothing else was made");
}

#[test]
fn a_new_plugin_in_c_runs() {
    let base = tempfile::tempdir().expect("a directory");
    good(&ob1(base.path(), &["new", "plugin", "batch-7"]));
    let folder = base.path().join("batch-7");
    let built = run("make", &folder, &["CFLAGS=-O2 -Wall -Wextra -Werror -pedantic"]);
    good(&built);
    let told = good(&ob1(&folder, &["check", "--plugin", "./batch-7.so"]));
    assert!(told.contains("plugin batch-7 ") && told.contains("FB 200 BATCH"), "{told}");
    it_runs(&folder, "1");
}

/// The crate lies outside of this workspace; nothing but the sdk and what it needs is compiled.
#[test]
fn a_new_plugin_in_rust_runs() {
    let base = tempfile::tempdir().expect("a directory");
    let sdk = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../plugins/sdk");
    let sdk = sdk.to_str().expect("UTF-8");
    good(&ob1(base.path(), &["new", "plugin", "batch-8", "--language", "rust", "--sdk", sdk]));
    let folder = base.path().join("batch-8");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["build", "--release", "--offline"]).current_dir(&folder).stdin(Stdio::null());
    cargo.env("CARGO_TARGET_DIR", folder.join("target")).env("RUSTFLAGS", "-D warnings");
    good(&cargo.output().expect("cargo starts"));
    let told = good(&ob1(&folder, &["check", "--plugin", "./target/release/libbatch_8.so"]));
    assert!(told.contains("plugin batch-8 ") && told.contains("FB 200 BATCH"), "{told}");
    it_runs(&folder, "1");
}
