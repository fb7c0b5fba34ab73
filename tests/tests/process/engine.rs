//! The change to machine code while a station runs, and a station that gets no machine code.

use std::fs;
use std::path::Path;

use rustix::process::Signal;

use crate::common;
use crate::common::processes::Watched;
use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::{Guard, program, python};

/// A station with a counter that each scan increments, and this many additional statements.
fn site(statements: usize, more: &str) -> Site {
    let site = Site::new();
    let load: String =
        (0..statements / 4).map(|n| format!("L MW {};\nL {n};\n+I;\nT MW {};\n", n % 90, n % 90)).collect();
    let awl = format!(
        "FUNCTION FC 1 : VOID\nBEGIN\n{load}END_FUNCTION\n\
         ORGANIZATION_BLOCK OB 1\nBEGIN\nL MD 200;\nL L#1;\n+D;\nT MD 200;\nU M 210.0;\nSPBN end;\nCALL FC 1;\nend: NOP 0;\n\
         END_ORGANIZATION_BLOCK\n"
    );
    site.write("e.awl", &awl);
    let toml = format!(
        "[station]\nname = \"engines\"\n\n[cpu]\nmin_cycle = \"5ms\"\n{more}\n[program]\nsources = [\"e.awl\"]\n"
    );
    site.write("e.toml", &toml);
    site
}

/// The process that compiles.
fn compiler(site: &Site) -> Option<Watched> {
    let compiles = |process: &Watched| {
        let words = fs::read(format!("/proc/{}/cmdline", process.pid)).unwrap_or_default();
        words.split(|byte| *byte == 0).any(|word| word == b"compile-blocks")
    };
    site.processes().into_iter().find(compiles)
}

fn until_native(station: &Running) {
    station.until("machine code has taken over", |s| (s.status().engine == "native").then_some(()));
}

/// Permissions and file of each mapping of a process.
fn mappings(pid: u32) -> Vec<(String, String)> {
    let maps = fs::read_to_string(format!("/proc/{pid}/maps")).expect("a living process");
    let of = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        (words[1].to_owned(), words.get(5).copied().unwrap_or_default().to_owned())
    };
    maps.lines().map(of).collect()
}

#[test]
fn machine_code_takes_over_between_two_scans() {
    let site = site(400, "");
    let station = site.run("e.toml").until_run();
    until_native(&station);
    let before = station.cell("MD200");
    station.set("M210.0", 1);
    station.scans(20);
    assert!(station.cell("MD200") >= before + 20, "the counter goes on from where it was");
    // Every scan has counted once, on any engine.
    station.ask(ob1_station::access::protocol::Op::Command { command: ob1_model::Command::Stop }).expect("a command");
    station.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    let (counted, scans) = (station.cell("MD200"), station.status().scans);
    assert_eq!(u64::try_from(counted), Ok(scans), "scans and their count");
    let pid = station.process.pid;
    let maps = mappings(pid);
    assert!(maps.iter().all(|(rights, _)| !(rights.contains('w') && rights.contains('x'))), "{maps:?}");
    assert!(maps.iter().any(|(rights, file)| rights == "r-xp" && file.contains("memfd:ob1-code")), "{maps:?}");
    assert!(compiler(&site).is_none(), "its work is done");
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    assert!(ended.out.contains("engine native"), "{ended:?}");
}

/// A station whose FC 1 has a loop; a thousand other functions are called once in each scan. It counts its scans.
fn hot_site() -> Site {
    let site = Site::new();
    let body = "L MW 2;\nL 3;\n+I;\nT MW 2;\n".repeat(15);
    let mut awl = format!("FUNCTION FC 1 : VOID\nBEGIN\nL 20000;\nm: {}LOOP m;\nEND_FUNCTION\n", "T MW 0;\n".repeat(8));
    for n in 2..=1001 {
        awl.push_str(&format!("FUNCTION FC {n} : VOID\nBEGIN\n{body}END_FUNCTION\n"));
    }
    awl.push_str("ORGANIZATION_BLOCK OB 1\nBEGIN\nL MD 200;\nL L#1;\n+D;\nT MD 200;\n");
    for n in 1..=1001 {
        awl.push_str(&format!("UC FC {n};\n"));
    }
    awl.push_str("END_ORGANIZATION_BLOCK\n");
    site.write("e.awl", &awl);
    site.write(
        "e.toml",
        "[station]\nname = \"engines\"\n\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"2s\"\n\n[program]\nsources = [\"e.awl\"]\n",
    );
    site
}

/// Ends the station in STOP and compares its count of scans with that of the CPU.
fn counted(station: Running) -> common::station::Ended {
    station.ask(ob1_station::access::protocol::Op::Command { command: ob1_model::Command::Stop }).expect("a command");
    station.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    let (counted, scans) = (station.cell("MD200"), station.status().scans);
    assert_eq!(u64::try_from(counted), Ok(scans), "scans and their count");
    station.interrupt()
}

#[test]
fn the_hottest_blocks_are_optimised_first() {
    let site = hot_site();
    let mut command = site.command(program("ob1"));
    command.args(["run", "e.toml"]).env("OB1_LOG", "info");
    let station = Running::start_command(&site, "e.toml", command).until_run();
    until_native(&station);
    let ended = counted(station);
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    let steps = ["native, fast tier", "native, hottest blocks", "native"];
    let of = |name: &&str| ended.err.find(&format!("machine code: {name}, 1002 of 1002 blocks, "));
    let at: Vec<_> = steps.iter().map(of).collect();
    assert!(at.iter().all(Option::is_some) && at.is_sorted(), "{at:?} {ended:?}");
    assert!(ended.err.contains("machine code: native, hottest blocks, 1002 of 1002 blocks, 1 optimised"), "{ended:?}");
}

#[test]
fn a_station_whose_compiler_is_killed_behind_the_first_step_stays_there() {
    let site = hot_site();
    let station = site.run("e.toml").until_run();
    station
        .until("the hottest blocks are optimised", |s| (s.status().engine == "native, hottest blocks").then_some(()));
    let compiler = compiler(&site).expect("it is at work for long");
    compiler.signal(Signal::KILL);
    compiler.wait("the process that compiles");
    station.scans(20);
    assert_eq!(station.status().engine, "native, hottest blocks");
    let ended = counted(station);
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    assert_eq!(ended.err.matches("machine code: the process that compiles is gone").count(), 1, "{ended:?}");
}

#[test]
fn a_compiler_that_is_killed_is_started_again() {
    // Long enough to compile for some time.
    let site = site(60_000, "");
    let station = site.run("e.toml");
    let guard = Guard::begin();
    let compiler = loop {
        if let Some(compiler) = compiler(&site) {
            break compiler;
        }
        assert!(!guard.is_over(), "no process compiles");
        std::thread::yield_now();
    };
    compiler.signal(Signal::KILL);
    compiler.wait("the process that compiles");
    let station = station.until_run();
    station.until("the status says why", |station| {
        station.status().engine_lacks.is_some_and(|why| why.contains("signal 9")).then_some(())
    });
    station.until("another one has made code", |station| (station.status().engine != "reference").then_some(()));
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    assert_eq!(ended.err.matches("machine code: the process that compiles is gone").count(), 1, "{ended:?}");
    assert!(ended.err.contains("signal 9"), "{ended:?}");
}

#[test]
fn nothing_compiles_when_the_engine_is_named() {
    let site = site(400, "engine = \"reference\"");
    let station = site.run("e.toml").until_run();
    station.scans(20);
    assert_eq!((station.status().engine.as_str(), compiler(&site).is_none()), ("reference", true));
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn the_compiler_ends_with_its_runtime() {
    let site = site(60_000, "");
    let station = site.run("e.toml");
    let guard = Guard::begin();
    while compiler(&site).is_none() {
        assert!(!guard.is_over(), "no process compiles");
        std::thread::yield_now();
    }
    station.kill();
    site.wait_until_empty();
}

/// Starts `ob1 run` with the restriction of systemd's `MemoryDenyWriteExecute`: no memory is both writable and
/// executable, or becomes executable. Exit 77: the kernel does not support it.
const DENY: &str = "
import ctypes, os, sys
if ctypes.CDLL(None, use_errno=True).prctl(65, 1, 0, 0, 0) != 0:
    sys.exit(77)
os.execv(sys.argv[1], sys.argv[1:])
";

/// Whether the kernel supports this: Linux 6.3 and later.
fn kernel_denies() -> bool {
    let release = fs::read_to_string("/proc/sys/kernel/osrelease").expect("a kernel");
    let mut numbers = release.split(['.', '-']).map_while(|part| part.trim().parse::<u32>().ok());
    (numbers.next(), numbers.next()) >= (Some(6), Some(3))
}

#[test]
fn machine_code_runs_where_memory_is_never_writable_and_executable() {
    let site = site(400, "");
    let ob1 = program("ob1");
    let probe = site.command(python()).args(["-c", DENY]).arg(Path::new("/bin/true")).status().expect("it starts");
    if probe.code() == Some(77) {
        assert!(!kernel_denies(), "this kernel should know PR_SET_MDWE");
        return;
    }
    let mut command = site.command(python());
    command.args(["-c", DENY]).arg(&ob1).args(["run", "e.toml"]);
    let station = Running::start_command(&site, "e.toml", command).until_run();
    until_native(&station);
    station.scans(20);
    assert_eq!(station.interrupt().code(), Some(0));
}
