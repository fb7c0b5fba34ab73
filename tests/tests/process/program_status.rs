//! `ob1 status STATION BLOCK` with a running station: text, JSON, conditions, what it refuses.

use std::io::Write as _;
use std::os::unix::net::UnixStream;

use serde_json::Value;

use crate::common::site::Site;

const SOURCE: &str = "\
FUNCTION_BLOCK FB 20
VAR_INPUT
  start : BOOL;
END_VAR
BEGIN
NETWORK
      L     3;           // three rounds
n:    T     MW 20;
      // a remark
      L     MW 20;
      LOOP  n;
NETWORK
      U     #start;
      SPB   e;
      L     7;
e:    NOP   0;
END_FUNCTION_BLOCK
DATA_BLOCK DB 21
FB 20
BEGIN
END_DATA_BLOCK
FUNCTION FC 6 : VOID
BEGIN
      SET;
      =     M 0.0;
      CALL FB 20, DB 21 (start := M 0.0);
END_FUNCTION
FUNCTION FC 7 : VOID
BEGIN
      NOP 0;
END_FUNCTION
ORGANIZATION_BLOCK OB 1
BEGIN
      CALL FC 6;
END_ORGANIZATION_BLOCK
";

fn station(engine: &str) -> String {
    format!(
        "[station]\nname = \"status\"\n[cpu]\nmin_cycle = \"2ms\"\nengine = \"{engine}\"\n[program]\nsources = [\"p.awl\"]\n"
    )
}

#[test]
fn each_line_of_the_source_with_what_is_behind_it() {
    for engine in ["reference", "native"] {
        let site = Site::new();
        site.write("p.awl", SOURCE);
        site.write("status.toml", &station(engine));
        let running = site.run("status.toml").until_run();
        let said = site.ob1(&["status", "status.toml", "FB", "20", "--once"]).fine();
        let row = |line: &str| said.lines().find(|row| row.trim_start().starts_with(line)).unwrap_or_default();
        assert!(said.starts_with("FB 20 in OB 1, called by FC 6, ") && said.contains("p.awl:26, "), "{said}");
        assert!(row("7 ").contains("L     3;           // three rounds   1   1 00000003"), "{said}");
        assert!(row("8 ").contains("00000001  00000002") && row("8 ").ends_with(" 3"), "three rounds: {said}");
        assert!(row("9 ").ends_with("// a remark"), "{said}");
        assert!(row("15 ").contains("L     7;") && row("15 ").ends_with(" -"), "jumped over: {said}");
        assert!(row("16 ").ends_with(" 1"), "{said}");

        // One network, as numbers, with both conditions.
        let args =
            ["status", "status", "FB20", "--from", "OB", "1", "--db", "21", "--network", "2", "--once", "--json"];
        let pass: Value = serde_json::from_str(&site.ob1(&args).fine()).expect("JSON");
        assert_eq!(
            (&pass["outcome"], &pass["ob"], &pass["lines"][0]["line"]),
            (&"whole".into(), &1.into(), &13.into())
        );
        let times: Vec<_> =
            pass["lines"].as_array().expect("lines").iter().map(|line| line["times"].as_u64()).collect();
        assert_eq!(times, [Some(1), Some(1), Some(0), Some(1)]);
        assert_eq!(pass["lines"][2].get("registers"), None, "never an old value");
        assert_eq!(pass["lines"][0]["registers"]["di"], 21);
        assert_eq!(pass["lines"][0]["registers"]["rlo"], true);

        for (args, exit, says) in [
            (&["FC", "99"][..], 8, "FC 99 is not in the program\n  = blocks of statements: OB 1, FB 20, FC 6, FC 7"),
            (&["FC", "7", "--wait", "200ms"], 8, "FC 7 was not called within 200ms\n  = "),
            (&["FB", "20", "--db", "5", "--wait", "200ms"], 8, "FB 20 was not called with DB 5 within 200ms\n  = "),
            (&["FB", "20", "--network", "3"], 8, "FB 20 has no statement in network 3\n  = "),
            (&["press", "fast"], 8, "\"press fast\" is no block\n  = "),
        ] {
            let said = site.ob1(&[&["status", "status"], args].concat());
            assert_eq!(said.code, Some(exit), "{args:?}");
            assert!(said.err.contains(says), "{args:?}: {}", said.err);
        }
        // A source that has been edited since is not shown beside values of another one.
        site.write("p.awl", &SOURCE.replace("three rounds", "3 rounds"));
        let said = site.ob1(&["status", "status", "FB 20", "--once"]).fine();
        assert!(said.contains("without its source") && said.contains("LOOP"), "{said}");
        let said = site.ob1(&["status", "status", "FC 6", "--once"]).fine();
        assert!(said.contains("CALL FB 20, DB 21 ( start := M 0.0);"), "a call is one line: {said}");
        assert_eq!(running.interrupt().code(), Some(0));
        assert_eq!(site.ob1(&["status", "status", "FB 20"]).code, Some(5));
    }
}

/// Clients that vanish leave no job behind: the places are free for others.
#[test]
fn a_client_that_is_gone_leaves_its_place() {
    let site = Site::new();
    site.write("p.awl", SOURCE);
    site.write("status.toml", &station("auto"));
    let running = site.run("status.toml").until_run();
    for _ in 0..5 {
        for _ in 0..2 {
            let mut socket = UnixStream::connect(site.rundir("status").join("control.sock")).expect("it listens");
            socket.write_all(b"{\"op\":\"pass\",\"block\":\"FC 7\",\"wait_ms\":60000}\n").expect("it reads");
        }
        let told = running.until("a place", |_| {
            let said = site.ob1(&["status", "status", "FB", "20", "--once"]);
            (said.code == Some(0)).then_some(said.out)
        });
        assert!(told.contains("FB 20"), "{told}");
    }
    assert_eq!(running.interrupt().code(), Some(0));
}
