//! `ob1 debug STATION`: breakpoints and single step in a running station, and what becomes of them when nobody is
//! there.

use std::io::Write as _;
use std::process::{Child, Stdio};

use ob1_station::access::protocol::Op;

use crate::common::program;
use crate::common::site::Site;
use crate::common::station::Running;

const SOURCE: &str = "\
FUNCTION FC 5 : VOID
BEGIN
      L     3;
      L     4;
      +I;
      T     MW 2;
END_FUNCTION
ORGANIZATION_BLOCK OB 1
BEGIN
      L     MW 0;
      + 1;
      T     MW 0;
      SET;
      =     A 4.0;
      CALL FC 5;
      NOP 0;
END_ORGANIZATION_BLOCK
";

fn station(site: &Site, engine: &str) -> Running {
    site.write("p.awl", SOURCE);
    let module = "[[module]]\nname = \"lamps\"\ntype = \"do\"\naddress = 4\nbytes = 1\n";
    site.write(
        "st.toml",
        &format!(
            "[station]\nname = \"debugged\"\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"100ms\"\nengine = \"{engine}\"\n\
             [program]\nsources = [\"p.awl\"]\n{module}"
        ),
    );
    site.run("st.toml").until_run()
}

/// The prompt, to be told line by line.
fn prompt(site: &Site) -> Child {
    let mut command = site.command(program("ob1"));
    command
        .args(["debug", "debugged", "--break", "FC 5:5"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("ob1 starts")
}

fn tell(child: &mut Child, lines: &str) {
    child.stdin.as_mut().expect("a pipe").write_all(lines.as_bytes()).expect("it reads");
}

fn until_state(station: &Running, wanted: &str) {
    station.until(wanted, |s| (s.ask(Op::Status).ok()?.status?.state == wanted).then_some(()));
}

#[test]
fn it_holds_steps_and_goes_on() {
    for engine in ["reference", "native", "auto"] {
        let site = Site::new();
        let station = station(&site, engine);
        let mut child = prompt(&site);
        tell(&mut child, "wait\n");
        until_state(&station, "HOLD");
        // Values can be read and written, for longer than the cycle monitoring allows.
        for value in 0..50 {
            site.ob1(&["set", "debugged", &format!("MW100={value}")]).fine();
            assert!(site.ob1(&["get", "debugged", "MW100"]).fine().contains(&value.to_string()));
        }
        tell(&mut child, "registers\nstack\nstep\nstep\nout\nbreak FC 5:6\nbreak FC 77\ndelete\nquit\n");
        let said = child.wait_with_output().expect("it ends");
        let said = String::from_utf8(said.stdout).expect("text");
        for part in [
            "HOLD before FC 5, ",
            "p.awl:5, statement 2, in OB 1: +I\n",
            "ACCU1 00000004 ACCU2 00000003",
            "1: OB 1, ",
            "statement 3, in OB 1: T MW 2\n",
            "statement 4, in OB 1: end of the block\n",
            "FC 77 is not in the program",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
        until_state(&station, "RUN");
        let scans = |s: &Running| s.ask(Op::Status).ok()?.status.map(|status| status.scans);
        let before = station.until("scans", scans);
        station.until("more scans", |s| scans(s).filter(|scans| *scans > before + 20));
        let diag = site.ob1(&["diag", "debugged"]).fine();
        assert!(diag.contains("4305h breakpoint reached") && diag.contains("4306h breakpoint left"), "{diag}");
        assert!(!diag.contains("OB 80") && !diag.contains("3501h"), "the cycle monitoring stood still: {diag}");
        assert_eq!(station.interrupt().code(), Some(0));
    }
}

/// Whoever has stopped the program at a breakpoint and is gone has not said that it may go on.
#[test]
fn without_its_owner_a_cpu_in_hold_goes_to_stop() {
    let site = Site::new();
    let station = station(&site, "auto");
    for killed in [true, false] {
        let mut child = prompt(&site);
        tell(&mut child, "wait\n");
        until_state(&station, "HOLD");
        // Only one may set breakpoints.
        let other = site.ob1(&["debug", "debugged", "--break", "OB 1"]);
        assert_eq!(other.code, Some(8), "{}", other.err);
        if killed {
            child.kill().expect("it lives");
        } else {
            drop(child.stdin.take());
        }
        until_state(&station, "STOP");
        child.wait().expect("it ends");
        let diag = site.ob1(&["diag", "debugged"]).fine();
        assert!(diag.contains("430Ah HOLD left to STOP"), "{diag}");
        site.ob1(&["ctl", "debugged", "run"]).fine();
        until_state(&station, "RUN");
    }
    // STOP by command, and the end of the station.
    let mut child = prompt(&site);
    tell(&mut child, "wait\n");
    until_state(&station, "HOLD");
    site.ob1(&["ctl", "debugged", "stop"]).fine();
    until_state(&station, "STOP");
    site.ob1(&["ctl", "debugged", "run"]).fine();
    tell(&mut child, "break FC 5:5\nwait\n");
    until_state(&station, "HOLD");
    assert_eq!(station.interrupt().code(), Some(0), "it ends out of HOLD");
    let _ = child.wait();
}

/// In STOP nobody writes a peripheral output unless somebody has enabled them, and is still there.
#[test]
fn peripheral_outputs_are_written_in_stop_while_somebody_has_enabled_them() {
    let site = Site::new();
    let station = station(&site, "auto");
    let write = || site.ob1(&["set", "debugged", "PAB4=16#81"]);
    let field = ob1_backplane::IoField::open(&station.rundir.join("io")).expect("process I/O");
    let lamps = || {
        let mut byte = [0];
        field.read_outputs(4, &mut byte);
        byte[0]
    };
    let enable = || {
        let mut command = site.command(program("ob1"));
        command.args(["debug", "debugged"]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("ob1 starts")
    };
    write().fine();
    let mut child = enable();
    tell(&mut child, "outputs on\nquit\n");
    let said = String::from_utf8(child.wait_with_output().expect("it ends").stdout).expect("text");
    assert!(said.contains("only in STOP: in RUN the program drives the outputs"), "{said}");
    for killed in [true, false] {
        site.ob1(&["ctl", "debugged", "stop"]).fine();
        let refused = write();
        assert!(refused.code == Some(8) && refused.err.contains("`ob1 debug`, `outputs on`"), "{refused:?}");
        let mut child = enable();
        tell(&mut child, "outputs on\n");
        station.until("enabled", |_| (write().code == Some(0)).then_some(()));
        assert_eq!(lamps(), 0x81);
        if killed {
            child.kill().expect("it lives");
        } else {
            tell(&mut child, "outputs off\n");
        }
        station.until("disabled", |_| (write().code == Some(8)).then_some(()));
        assert_eq!(lamps(), 0, "safe again");
        drop(child.stdin.take());
        child.wait().expect("it ends");
        site.ob1(&["ctl", "debugged", "run"]).fine();
        write().fine();
    }
    assert_eq!(station.interrupt().code(), Some(0));
}
