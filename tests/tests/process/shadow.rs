//! `ob1 shadow` beside a station that plays the rack.

use std::collections::BTreeSet;
use std::net::TcpStream;

use serde_json::Value;

use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::wire::Between;

const PROGRAM: &str = "
FUNCTION FC 1 : VOID
VAR_INPUT
  start : BOOL;
  level : INT;
END_VAR
VAR_OUTPUT
  high : BOOL;
END_VAR
BEGIN
NETWORK
      L     #level;
      L     600;
      >=I   ;
      U     #start;
      =     #high;
END_FUNCTION

ORGANIZATION_BLOCK OB 1
BEGIN
NETWORK
      CALL FC 1 (start := E 0.0, level := EW 2, high := A 0.0);
NETWORK
      U     E 0.1;
      L     S5T#1S;
      SE    T 5;
NETWORK
      U     T 5;
      =     A 0.1;
NETWORK
      U     E 0.2;
      S     A 0.2;
      U     E 0.3;
      R     A 0.2;
END_ORGANIZATION_BLOCK
";

/// Inputs for six seconds, again and again.
const PANEL: &str = r#"
repeat = "6s"
[[at]]
time = "0ms"
set = { "E 0.0" = true, "E 0.1" = true, "E 0.2" = true, "EW 2" = 700 }
[[at]]
time = "500ms"
set = { "E 0.2" = false }
[[at]]
time = "1500ms"
set = { "EW 2" = 500 }
[[at]]
time = "3s"
set = { "E 0.1" = false, "E 0.3" = true, "EW 2" = 610 }
[[at]]
time = "4s"
set = { "E 0.0" = false, "E 0.3" = false }
"#;

fn file(name: &str, source: &str, more: &str) -> String {
    format!(
        "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"5ms\"\n[program]\nsources = [\"{source}\"]\n\
         [[module]]\ntype = \"di\"\nname = \"panel\"\naddress = 0\nbytes = 1\n\
         [[module]]\ntype = \"ai\"\nname = \"level\"\naddress = 2\nchannels = 1\n\
         [[module]]\ntype = \"do\"\nname = \"lamps\"\naddress = 0\nbytes = 1\n{more}"
    )
}

/// A rack with this program, and a shadow's station with the other one.
fn rack(site: &Site, name: &str, program: &str) -> (Running, Between) {
    let port = free_port();
    site.write("rack.awl", program);
    site.write("own.awl", PROGRAM);
    site.write("panel.toml", PANEL);
    let link = format!(
        "[process_io]\nstimulus = \"panel.toml\"\n[[link]]\ntype = \"s7\"\nname = \"plant\"\nlisten = \"127.0.0.1:{port}\"\n"
    );
    site.write("rack.toml", &file(name, "rack.awl", &link));
    site.write("own.toml", &file("own", "own.awl", ""));
    let station = site.run("rack.toml").until_run();
    station.until("the link listens", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    (station, Between::listen(port))
}

/// What a shadow says after so long: its exit code, its output, its report.
fn shadow(site: &Site, between: &Between, time: &str) -> (Option<i32>, String, Value) {
    let host = format!("127.0.0.1:{}", between.port);
    let args = ["shadow", "own.toml", "--rack", &host, "--for", time, "--report", "report.json"];
    let said = site.ob1(&[&args[..], &["--recording", "rack.ob1trace"]].concat());
    let report = std::fs::read(site.path("report.json")).unwrap_or_default();
    (said.code, said.out + &said.err, serde_json::from_slice(&report).unwrap_or_default())
}

/// Every telegram to the rack only reads: setup, read, upload; lists, blocks and the clock.
fn only_looks(between: &Between) {
    let mut seen = BTreeSet::new();
    for frame in between.requests() {
        match frame.get(7..) {
            Some([0x32, 1, .., _]) => {
                let function = frame[17];
                assert!([0xF0, 0x04, 0x1D, 0x1E, 0x1F].contains(&function), "{frame:02X?}");
                seen.insert(function);
            }
            Some([0x32, 7, .., _]) => {
                let service = (frame[22] & 15, frame[23]);
                assert!([(3, 1), (3, 2), (3, 3), (4, 1), (7, 1)].contains(&service), "{frame:02X?}");
            }
            // The call.
            _ => assert_eq!(frame[5], 0xE0, "{frame:02X?}"),
        }
    }
    assert!(seen.contains(&0x04), "it has read");
}

#[test]
fn a_rack_with_the_same_program_is_equal() {
    let site = Site::new();
    let (station, between) = rack(&site, "same", PROGRAM);
    let (code, text, report) = shadow(&site, &between, "14s");
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("3 cells compared, 0 of them different"), "{text}");
    assert!(report["equal"].as_u64() > Some(50), "{report}");
    only_looks(&between);
    // What was read can be replayed without the rack, one scan for each reading: a timer may end one reading apart.
    let replayed = site.ob1(&["exec", "own.awl", "--replay", "rack.ob1trace"]);
    let said = replayed.out + &replayed.err;
    assert!(matches!(replayed.code, Some(0 | 15)) && said.contains("scans replayed"), "{said}");
    assert!(!said.contains("A 0.0:") && !said.contains("A 0.2:"), "{said}");
    assert_eq!(station.status().state, "RUN");
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_rack_with_another_program_is_told_where() {
    let site = Site::new();
    let other = PROGRAM.replace("600;", "650;").replace("S5T#1S", "S5T#2S");
    let (_station, between) = rack(&site, "other", &other);
    let (code, text, report) = shadow(&site, &between, "20s");
    assert_eq!(code, Some(1), "{text}");
    for line in [
        "A 0.0 differs since",
        "it begins in FC 1, network 1, own.awl:16 (FC 1 #high)",
        "the rack's FC 1 is another one, network 1:",
        "- L 600;",
        "+ L 650;",
        "A 0.1 differs since",
        "it begins in OB 1, network 2, own.awl:26 (T 5)",
        "3 cells compared, 2 of them different",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    let differences = report["differences"].as_array().expect("a list");
    assert_eq!(differences.len(), 2, "{report}");
    assert_eq!(differences[0]["begins"][0]["block"], "FC 1");
    assert!(differences[0]["around"].as_array().is_some_and(|list| list.len() > 5));
    only_looks(&between);
}

#[test]
fn a_rack_that_is_not_there_is_told() {
    let site = Site::new();
    site.write("own.awl", PROGRAM);
    site.write("own.toml", &file("own", "own.awl", ""));
    let port = free_port();
    let said = site.ob1(&["shadow", "own.toml", "--rack", &format!("127.0.0.1:{port}"), "--for", "5s"]);
    assert_eq!(said.code, Some(2), "{}", said.err);
    assert!(said.err.contains("write another as HOST:PORT"), "{}", said.err);
}
