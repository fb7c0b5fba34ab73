//! `ob1 diff`, through the binary: programs from sources, stations, projects and machine code.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

const PLANT: &str = "\
FUNCTION FC 5 : VOID
TITLE = the valve
VAR_INPUT
  open : BOOL;
END_VAR
VAR_TEMP
  steps : INT;
END_VAR
BEGIN
NETWORK
      U     #open;
      =     A 4.0;
NETWORK
      L     2;
      T     #steps;
      U     E 0.4;
      SPB   out;
      S     A 4.1;
out:  NOP 0;
END_FUNCTION
DATA_BLOCK DB 10
STRUCT
  limit : INT := 5;
  name : STRING[8] := 'press';
END_STRUCT
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
      CALL  FC 5 (open := E 0.0);
END_ORGANIZATION_BLOCK
";

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn put(&self, name: &str, text: &str) -> String {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("room");
        std::fs::write(&path, text).expect("room");
        path.display().to_string()
    }
}

fn diff(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ob1")).arg("diff").args(args).output().expect("ob1 starts")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[track_caller]
fn same(a: &str, b: &str) {
    let found = diff(&[a, b]);
    assert_eq!(found.status.code(), Some(0), "{}", text(&found));
}

/// Names, comments, labels, mnemonics and the number of the line do not change what a block does.
#[test]
fn what_only_reads_differently_is_the_same() {
    let folder = Folder::new();
    let plant = folder.put("a.awl", PLANT);
    same(&plant, &plant);
    let renamed = PLANT
        .replace("open", "opens")
        .replace("steps", "count")
        .replace("limit", "most")
        .replace("out", "end_")
        .replace("the valve", "another title")
        .replace("NOP 0", "NOP   0; // the end\n");
    same(&plant, &folder.put("b.awl", &renamed));
    let english = PLANT.replace("U     ", "A     ").replace("A 4", "Q 4").replace("E 0", "I 0").replace("SPB", "JC");
    same(&plant, &folder.put("c.awl", &english));
}

/// Each change is told with its block and the place in it, on both sides.
#[test]
fn what_a_block_does_is_told_line_by_line() {
    let folder = Folder::new();
    let plant = folder.put("a.awl", PLANT);
    for (old, new, block, at, gone, added) in [
        ("U     E 0.4", "UN    E 0.4", "FC 5", "network 2", "A I 0.4;", "AN I 0.4;"),
        ("L     2;", "L     3;", "FC 5", "network 2", "L 2;", "L 3;"),
        ("open : BOOL;", "open : BOOL; more : INT;", "FC 5", "declarations", "", "more : INT;"),
        (":= 5;", ":= 7;", "DB 10", "values", "limit := 5;", "limit := 7;"),
        ("STRING[8]", "STRING[9]", "DB 10", "declarations", "name : STRING [8];", "name : STRING [9];"),
    ] {
        // What FC 5 has more, its caller gives.
        let call = if new.contains("more") { "open := E 0.0, more := 0" } else { "open := E 0.0" };
        let other = PLANT.replace(old, new).replace("open := E 0.0", call);
        let other = folder.put("b.awl", &other);
        let found = diff(&[&plant, &other, "--json", "--block", block]);
        assert_eq!(found.status.code(), Some(1), "{old}: {}", text(&found));
        let found: Value = serde_json::from_str(&text(&found)).expect("JSON");
        let part = &found["changed"][0]["parts"][0];
        assert_eq!((&found["changed"][0]["block"], &part["at"]), (&json!(block), &json!(at)), "{found}");
        let lines = part["lines"].as_array().expect("lines");
        let of = |side: &str| {
            let mut all = lines.iter().filter(|line| line["side"] == side);
            all.next().map_or("", |line| line["text"].as_str().expect("text").trim()).to_owned()
        };
        assert_eq!((of("-").as_str(), of("+").as_str()), (gone, added), "{found}");
    }
}

/// A jump to another place is seen, though its line without the label is the same.
#[test]
fn a_jump_that_leads_elsewhere() {
    let folder = Folder::new();
    let plant = folder.put("a.awl", PLANT);
    let jump = PLANT.replace("      S     A 4.1;\nout:  NOP 0;", "out:  S     A 4.1;\n      NOP 0;");
    let found = diff(&[&plant, &folder.put("b.awl", &jump)]);
    assert_eq!(found.status.code(), Some(1));
    assert!(
        text(&found).contains("network 2") && text(&found).contains("1 block is different, 2 the same"),
        "{}",
        text(&found)
    );
    // One statement more moves every label behind it, and is one line.
    let more = PLANT.replace("      L     2;", "      U     M 1.0;\n      =     M 1.1;\n      L     2;");
    let found = text(&diff(&[&plant, &folder.put("c.awl", &more)]));
    let changed = found.lines().filter(|line| line.starts_with("  + ") || line.starts_with("  - ")).count();
    assert_eq!(changed, 2, "{found}");
}

#[test]
fn blocks_that_only_one_has() {
    let folder = Folder::new();
    let plant = folder.put("a.awl", PLANT);
    let more = folder.put("b.awl", &format!("{PLANT}FUNCTION FC 6 : VOID\nBEGIN\nEND_FUNCTION\n"));
    let found = diff(&[&plant, &more, "--brief"]);
    assert_eq!(found.status.code(), Some(1));
    assert!(text(&found).contains("\n+ FC 6\n1 block is different, 3 the same"), "{}", text(&found));
    let found = text(&diff(&[&more, &plant, "--json"]));
    let found: Value = serde_json::from_str(&found).expect("JSON");
    assert_eq!(found, json!({ "same": 3, "gone": ["FC 6"], "added": [], "changed": [] }));
}

/// A station with these sources, the project that a test of ob1 has written, the station made of it, and its blocks.
#[test]
fn programs_from_everywhere() {
    let folder = Folder::new();
    let plant = folder.put("press/plant.awl", PLANT);
    folder.put("press/station.toml", "[station]\nname = \"press\"\n\n[program]\nsources = [\"plant.awl\"]\n");
    let press = folder.0.path().join("press");
    same(&plant, &press.display().to_string());
    same(&plant, &press.join("station.toml").display().to_string());
    let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/step7-project");
    let project = project.display().to_string();
    let made = folder.0.path().join("made").display().to_string();
    let import = Command::new(env!("CARGO_BIN_EXE_ob1")).args(["import", &project, "--out", &made]).output();
    assert_eq!(import.expect("ob1 starts").status.code(), Some(0));
    same(&project, &made);
    // As text, for git: every block with its lines, and again as text for the station made of it.
    let shown = text(&diff(&["--text", &project]));
    assert!(shown.contains("ORGANIZATION_BLOCK OB 1") && shown.contains("NETWORK"), "{shown}");
}

#[test]
fn what_cannot_be_read_is_exit_code_2() {
    let folder = Folder::new();
    let plant = folder.put("a.awl", PLANT);
    let wrong = folder.put("wrong.awl", "FUNCTION FC 1 : VOID\nBEGIN\n      CALL FC 99;\nEND_FUNCTION\n");
    let gone = folder.0.path().join("gone.zip").display().to_string();
    let noise = folder.put("noise.mc7", "no block");
    for other in [wrong.as_str(), &gone, &noise, "cpu:127.0.0.1:1"] {
        let found = diff(&[&plant, other]);
        assert_eq!(found.status.code(), Some(2), "{other}");
        assert!(found.stdout.is_empty() && found.stderr.starts_with(b"ob1: "), "{other}: {found:?}");
    }
    assert_eq!(diff(&[&plant]).status.code(), Some(2), "one program");
    assert_eq!(diff(&[]).status.code(), Some(1), "no program");
}
