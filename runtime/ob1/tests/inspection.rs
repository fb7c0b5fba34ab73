//! `ob1 xref`, `ob1 check --listing` and `--lints`, through the binary.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn ob1(args: &[&str]) -> Output {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
    command.args(args).current_dir(examples).stdin(Stdio::null()).output().expect("ob1 starts")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn who_writes_the_lamps() {
    let all = ob1(&["xref", "traffic-light/station.toml", "--json"]);
    assert_eq!(all.status.code(), Some(0), "{all:?}");
    let all: Value = serde_json::from_slice(&all.stdout).expect("JSON");
    let lamps: Vec<&Value> = all.as_array().expect("a list").iter().filter(|r| r["operand"] == "AB 0").collect();
    let [lamps] = lamps[..] else { panic!("{lamps:?}") };
    assert_eq!((&lamps["access"], &lamps["via"]), (&"W".into(), &"FC 2.LAMPS".into()));
    assert_eq!((&lamps["block"], &lamps["network"]), (&"OB 1".into(), &5.into()));

    let one = ob1(&["xref", "traffic-light/traffic-light.awl", "--operand", "db1.dbw0"]);
    let one = text(&one);
    assert!(one.contains("DB1.DBW 0") && one.contains("OB 1") && !one.contains("MW 10"), "{one}");
    assert_eq!(ob1(&["xref", "traffic-light/README.md"]).status.code(), Some(1));
}

#[test]
fn a_listing_has_blocks_and_layouts() {
    for file in ["traffic-light/station.toml", "traffic-light/traffic-light.awl"] {
        let listing = ob1(&["check", file, "--listing"]);
        assert_eq!(listing.status.code(), Some(0), "{listing:?}");
        let listing = text(&listing);
        for part in ["OB 100", "FC 2", "LAMPS", "CROSSINGS", "ok"] {
            assert!(listing.contains(part), "{part} is not in\n{listing}");
        }
        assert!(!text(&ob1(&["check", file])).contains("CROSSINGS"));
    }
}

#[test]
fn lints_are_looked_for_on_request() {
    let folder = tempfile::tempdir().expect("a directory");
    let source =
        "FUNCTION FC 1 : VOID\nVAR_OUTPUT\n X : INT;\nEND_VAR\nBEGIN\nNETWORK\n U M 0.0;\n = M 0.1;\nEND_FUNCTION\n";
    let path = folder.path().join("p.awl");
    std::fs::write(&path, source).expect("writable");
    let path = path.display().to_string();
    assert!(text(&ob1(&["check", &path])).ends_with("ok\n"));
    let lints = ob1(&["check", &path, "--lints"]);
    assert_eq!(lints.status.code(), Some(0), "a lint is no error: {lints:?}");
    assert!(String::from_utf8_lossy(&lints.stderr).contains("lint S0"), "{lints:?}");
}
