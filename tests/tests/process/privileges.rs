//! The privileges of the processes of a station, checked from outside; and forbidden actions of a driver, tried from
//! inside.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, chown};
use std::path::Path;
use std::process::Command;

use crate::common;
use crate::common::ledger;
use crate::common::program;
use crate::common::s7::free_port;
use crate::common::site::{Site, replaced};

/// A field of `/proc/PID/status`.
fn status(pid: u32, field: &str) -> String {
    let text = fs::read_to_string(format!("/proc/{pid}/status")).expect("a living process");
    let line = text.lines().find_map(|line| line.strip_prefix(field)?.strip_prefix(':'));
    line.unwrap_or_else(|| panic!("no {field} in {text}")).trim().to_owned()
}

fn words(pid: u32, file: &str) -> Vec<String> {
    let bytes = fs::read(format!("/proc/{pid}/{file}")).expect("a living process");
    bytes.split(|byte| *byte == 0).filter(|w| !w.is_empty()).map(|w| String::from_utf8_lossy(w).into_owned()).collect()
}

/// Asserts that a child is confined: no privileges and no new ones, a clean environment, limited data, and an end
/// before or after the others when memory runs out.
fn assert_least(kind: &str, pid: u32, data: u64, oom: i64) {
    for (field, value) in [("NoNewPrivs", "1"), ("Seccomp", "2")] {
        assert_eq!(status(pid, field), value, "{kind}: {field}");
    }
    for field in ["CapInh", "CapPrm", "CapEff", "CapAmb"] {
        assert_eq!(u64::from_str_radix(&status(pid, field), 16), Ok(0), "{kind}: {field}");
    }
    for variable in words(pid, "environ") {
        let name = variable.split('=').next().unwrap_or_default().to_owned();
        let known = ["PATH", "XDG_RUNTIME_DIR", "OB1_LOG", "JOURNAL_STREAM", "OB1_FENCE"];
        assert!(known.contains(&name.as_str()), "{kind}: {variable}");
    }
    let limits = fs::read_to_string(format!("/proc/{pid}/limits")).expect("a living process");
    let limit = limits.lines().find(|line| line.starts_with("Max data size")).expect("a limit");
    assert!(limit.contains(&data.to_string()), "{kind}: {limit}");
    let score = fs::read_to_string(format!("/proc/{pid}/oom_score_adj")).expect("a living process");
    // Root without CAP_SYS_RESOURCE, in a container, lowers no score.
    let wanted = if oom < 0 && !has_capability(24) { 0 } else { oom };
    assert_eq!(score.trim().parse(), Ok(wanted), "{kind}: oom_score_adj");
}

/// Whether this process has the capability with this number.
fn has_capability(number: u32) -> bool {
    u64::from_str_radix(&status(std::process::id(), "CapEff"), 16).unwrap_or(0) >> number & 1 == 1
}

const MIB: u64 = 1 << 20;

#[test]
fn a_driver_that_tries_what_is_forbidden_fails() {
    let site = Site::new();
    let fence = |network: &str| format!(r#"{{"folders":["{}"],"network":"{network}"}}"#, site.path("run").display());
    let done = |network: &str| {
        let output = site.command(program("ob1-cp")).arg("--selftest").env("OB1_FENCE", fence(network)).output();
        let output = output.expect("it starts");
        let said = String::from_utf8_lossy(&output.stderr);
        let done: Vec<String> =
            said.lines().filter_map(|line| line.strip_prefix("DONE    ")).map(str::to_owned).collect();
        let refused = said.lines().filter(|line| line.starts_with("refused ")).count();
        assert_eq!(done.len() + refused, 14, "{said}");
        assert_eq!(output.status.code(), Some(i32::from(!done.is_empty())), "{said}");
        done
    };
    assert_eq!(done("none"), [""; 0]);
    // What a network allows is done: the test detects the difference.
    assert_eq!(done("address"), ["listen on TCP"]);
    let names = ["open a file of the system", "listen on TCP", "speak UDP"];
    assert_eq!(done("name"), [&names[..], &["have a stream to a socket of this machine"]].concat());
    let output = site.command(program("ob1-cp")).arg("--selftest").env("OB1_FENCE", "{}x").output().expect("it starts");
    assert_eq!(output.status.code(), Some(2), "a fence that cannot be understood is no fence");
}

#[test]
fn drivers_lines_and_guardian_have_the_least_that_they_need() {
    let site = Site::two_stations_on_a_cable();
    // A shell that passes on an open descriptor.
    let mut leaky = site.command("sh");
    let ob1 = program("ob1");
    leaky.env("JOURNAL_STREAM", "1:2");
    leaky.args(["-c", "exec 9</etc/passwd; exec \"$0\" run station-a.toml"]).arg(&ob1);
    let a = common::station::Running::start_command(&site, "station-a.toml", leaky).until_run();
    let b = site.run_with("station-b.toml", &[], &[("JOURNAL_STREAM", OsStr::new("1:2"))]).until_run();
    ledger::flow(&a, 5);
    let mut seen = BTreeMap::<&str, usize>::new();
    for process in site.processes() {
        let pid = process.pid;
        let command = words(pid, "cmdline");
        let kind = match () {
            () if command.iter().any(|word| word == "guardian") => "guardian",
            () if command.iter().any(|word| word == "--hub") => "line",
            () if command.iter().any(|word| word == "--segment") => "driver",
            () => continue,
        };
        *seen.entry(kind).or_default() += 1;
        assert_least(kind, pid, 64 * MIB, if kind == "guardian" { -500 } else { 500 });
        let environment = words(pid, "environ");
        assert!(environment.contains(&"JOURNAL_STREAM=1:2".to_owned()), "{kind}: {environment:?}");
        let open = fs::read_dir(format!("/proc/{pid}/fd")).expect("ours");
        for link in open.flatten().filter_map(|entry| fs::read_link(entry.path()).ok()) {
            assert_ne!(link, Path::new("/etc/passwd"), "{kind}: a descriptor that is not its own");
        }
    }
    assert!(seen.len() == 3 && seen["driver"] == 2 && seen["guardian"] == 2, "{seen:?}");
    assert_eq!((a.interrupt().code(), b.interrupt().code()), (Some(0), Some(0)));
    site.wait_until_empty();
}

/// A station with a bus whose coupler is not there, a page and an S7 link; and the process that makes machine code,
/// which waits for its order here.
#[test]
fn buses_links_and_the_compiler_have_the_least_that_they_need() {
    let site = Site::new();
    let station = format!(
        "[station]\nname = \"least\"\n\n[program]\nsources = [\"least.awl\"]\n\n\
         [[bus]]\nname = \"field\"\ntype = \"modbus-tcp\"\nline = \"tcp:127.0.0.1:9\"\n\n\
         [[module]]\ntype = \"coupler\"\nbus = \"field\"\nname = \"rio\"\n\
         inputs = [{{ at = \"EB 0\", from = \"input:0\", registers = 1 }}]\n\n\
         [[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{}\"\n\n\
         [[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"127.0.0.1:{}\"\n",
        free_port(),
        free_port()
    );
    site.write("least.toml", &station);
    let blocks = ["OB 1", "OB 86"].map(|ob| format!("ORGANIZATION_BLOCK {ob}\nBEGIN\nEND_ORGANIZATION_BLOCK\n"));
    site.write("least.awl", &blocks.concat());
    let station = site.run("least.toml").until_run();
    for (name, data, oom) in [("ob1-io", 64 * MIB, 500), ("ob1-s7", 256 * MIB, 500), ("ob1-gate", 1024 * MIB, 600)] {
        let is_it = |pid: &u32| fs::read_to_string(format!("/proc/{pid}/comm")).is_ok_and(|comm| comm.trim() == name);
        // The gate opens its files before it confines itself.
        let pid = station.until(name, |_| {
            let pid = site.processes().iter().map(|process| process.pid).find(is_it)?;
            (status(pid, "Seccomp") == "2").then_some(pid)
        });
        assert_least(name, pid, data, oom);
    }
    assert_eq!(station.interrupt().code(), Some(0));
    let (ours, theirs) = ob1_socket::handover::pair().expect("a socket");
    let mut command = site.command(program("ob1"));
    command.arg("compile-blocks").env_clear().stdin(theirs);
    let mut compiler = command.spawn().expect("it starts");
    let guard = common::Guard::begin();
    while status(compiler.id(), "Seccomp") != "2" {
        assert!(!guard.is_over(), "it does not confine itself");
        std::thread::yield_now();
    }
    assert_least("compiler", compiler.id(), 4096 * MIB, 1000);
    drop(ours);
    assert_eq!(compiler.wait().expect("ours").code(), Some(6), "no order has come");
}

/// A driver of somebody else does not close what it inherits: there is nothing to close.
#[test]
fn a_driver_of_your_own_inherits_nothing_either() {
    let site = Site::two_stations_on_a_cable();
    let driver = format!("#!/bin/sh\nls -l /proc/self/fd >\"$0.open\"\nexec {} \"$@\"\n", program("ob1-cp").display());
    fs::set_permissions(site.write("my-driver", &driver), fs::Permissions::from_mode(0o755)).expect("ours");
    let toml = fs::read_to_string(site.path("station-a.toml")).expect("the demo");
    site.write("station-a.toml", &replaced(&toml, "type = \"cp240\"\n", "type = \"cp240\"\ndriver = \"my-driver\"\n"));
    let mut leaky = site.command("sh");
    leaky.args(["-c", "exec 9</etc/passwd; exec \"$0\" run station-a.toml"]).arg(program("ob1"));
    let a = common::station::Running::start_command(&site, "station-a.toml", leaky).until_run();
    let open = a.until("the driver's start", |_| {
        fs::read_to_string(site.path("my-driver.open")).ok().filter(|list| list.contains("/proc/"))
    });
    assert!(open.contains("0 -> ") && !open.contains("/etc/passwd"), "{open}");
    assert_eq!(a.interrupt().code(), Some(0));
}

#[test]
fn a_station_with_a_user_runs_as_that_user_or_not_at_all() {
    let site = Site::new();
    let toml = "[station]\nname = \"dropped\"\nuser = \"nobody\"\n\n[cpu.realtime]\npriority = 5\n\n[program]\n\
                sources = [\"dropped.awl\"]\n\n[[module]]\ntype = \"do\"\nname = \"lamps\"\naddress = 0\nbytes = 1\n";
    site.write("dropped.toml", toml);
    site.write("dropped.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL B#16#A1;\nT AB 0;\nEND_ORGANIZATION_BLOCK\n");
    if !rustix::process::geteuid().is_root() {
        let said = site.ob1(&["run", "dropped.toml"]);
        assert_eq!(said.code, Some(6), "{said:?}");
        assert!(said.err.contains("only root can become another user"), "{said:?}");
        return;
    }
    let passwd = fs::read_to_string("/etc/passwd").expect("a system with users");
    let fields: Vec<&str> = passwd.lines().find(|l| l.starts_with("nobody:")).expect("nobody").split(':').collect();
    let (uid, gid) = (fields[2].parse().expect("a number"), fields[3].parse().expect("a number"));
    for place in [site.path(""), site.path("run"), site.path("dropped.toml"), site.path("dropped.awl")] {
        chown(&place, Some(uid), Some(gid)).expect("root may");
    }
    // The binaries of a build may be in a folder that only root can read.
    let bin = site.path("bin");
    fs::create_dir(&bin).expect("room");
    fs::set_permissions(&bin, fs::Permissions::from_mode(0o755)).expect("ours");
    fs::copy(program("ob1"), bin.join("ob1")).expect("room");
    let mut command: Command = site.command(bin.join("ob1"));
    command.args(["run", "dropped.toml"]);
    let station = common::station::Running::start_command(&site, "dropped.toml", command).until_run();
    let pid = station.process.pid;
    assert_eq!(status(pid, "Uid"), format!("{uid}\t{uid}\t{uid}\t{uid}"));
    assert_eq!(status(pid, "Gid"), format!("{gid}\t{gid}\t{gid}\t{gid}"));
    for field in ["CapInh", "CapPrm", "CapEff", "CapAmb", "CapBnd"] {
        assert_eq!(u64::from_str_radix(&status(pid, field), 16), Ok(0), "{field}");
    }
    assert_eq!(status(pid, "NoNewPrivs"), "1");
    // Root without CAP_SYS_RESOURCE, in a container, raises no limit above its own.
    if has_capability(24) {
        let granted = station.status().posture.into_iter().find(|grant| grant.what.contains("SCHED_FIFO"));
        assert_eq!(granted.map(|grant| grant.outcome).as_deref(), Some("granted"), "raised before it was given up");
    }
    let field = ob1_backplane::IoField::open(&station.rundir.join("io")).expect("the link leads to the image");
    let mut lamps = [0];
    station.until("outputs", |_| {
        field.read_outputs(0, &mut lamps);
        (lamps == [0xA1]).then_some(())
    });
    assert_eq!(station.kill().signal(), Some(9));
    let guard = common::Guard::begin();
    while lamps != [0] {
        field.read_outputs(0, &mut lamps);
        assert!(!guard.is_over(), "its guardian has the image all the same");
        std::thread::yield_now();
    }
    let wrong = replaced(toml, "\"nobody\"", "\"nobody-of-this-name\"");
    site.write("dropped.toml", &wrong);
    let said = site.ob1(&["run", "dropped.toml"]);
    assert_eq!(said.code, Some(6), "{said:?}");
    assert!(said.err.contains("there is no such user") && said.err.contains("\n  = "), "{said:?}");
}

#[test]
fn a_segment_has_one_driver_and_a_module_may_have_its_own_program() {
    let site = Site::two_stations_on_a_cable();
    // Named in the station file, relative to its folder.
    fs::copy(program("ob1-cp"), site.path("my-driver")).expect("room");
    let toml = fs::read_to_string(site.path("station-a.toml")).expect("the demo");
    site.write("station-a.toml", &replaced(&toml, "type = \"cp240\"\n", "type = \"cp240\"\ndriver = \"my-driver\"\n"));
    let a = site.run("station-a.toml").until_run();
    let b = site.run("station-b.toml").until_run();
    ledger::flow(&a, 5);
    let driver = a.driver_process();
    let program_of = fs::read_link(format!("/proc/{}/exe", driver.pid)).expect("ours");
    assert_eq!(program_of, fs::canonicalize(site.path("my-driver")).expect("there"));
    // A second station at the same time.
    let link = fs::read_dir(&a.rundir).expect("ours").flatten().map(|entry| entry.path());
    let segment = link.into_iter().find(|path| path.extension().is_some_and(|e| e == "segment")).expect("a segment");
    let second = site.command(program("ob1-cp")).arg("--segment").arg(&segment).output().expect("it starts");
    let said = String::from_utf8_lossy(&second.stderr);
    assert_eq!(second.status.code(), Some(1), "{said}");
    assert!(said.contains("a driver is attached to the segment already"), "{said}");
    ledger::flow(&a, 5);
    assert_eq!(a.driver(), (driver.pid, 1, 0), "the first one has not noticed");
    assert_eq!((a.interrupt().code(), b.interrupt().code()), (Some(0), Some(0)));
}
