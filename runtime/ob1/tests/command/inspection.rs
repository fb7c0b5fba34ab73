//! `ob1 xref`, `ob1 check --listing` and `--lints`, through the binary.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn command(args: &[&str]) -> Command {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
    command.args(args).current_dir(examples).stdin(Stdio::null());
    command
}

fn ob1(args: &[&str]) -> Output {
    command(args).output().expect("ob1 starts")
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

/// The reader of GSD files panics at some: that is a finding about the file, and nothing else.
#[test]
fn a_gsd_file_that_cannot_be_read_is_one_finding() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("broken.gsd", "#Profibus_DP\nExt_User_Prm_Data_Ref(0) = 17\n");
    write("p.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nNOP 0;\nEND_ORGANIZATION_BLOCK\n");
    write(
        "p.toml",
        "[station]\nname = \"p\"\n\n[program]\nsources = [\"p.awl\"]\n\n[[bus]]\nname = \"profi\"\ntype = \"dp\"\n\
         line = \"serial:/dev/ttyUSB0\"\nbaud = 500000\n\n[[module]]\ntype = \"coupler\"\nbus = \"profi\"\n\
         name = \"rack\"\nstation = 8\ngsd = \"broken.gsd\"\nslots = [{ slot = 1, module = \"DI\", inputs = \"EB 0\" }]\n",
    );
    let checked = ob1(&["check", folder.path().join("p.toml").to_str().expect("a name")]);
    let said = text(&checked) + &String::from_utf8_lossy(&checked.stderr);
    assert_eq!(checked.status.code(), Some(1), "{said}");
    assert!(said.contains("leads nowhere"), "{said}");
    assert!(!said.contains("internal error") && !said.contains("has no modules"), "{said}");
}

#[test]
fn a_station_file_and_a_source_in_each_others_place_are_told() {
    for (args, code, part) in [
        (&["run", "traffic-light/traffic-light.awl"][..], 2, "this is a source or a symbol table, not a station file"),
        (&["exec", "traffic-light/station.toml"], 10, "C012: a station file among sources"),
        (&["xref", "traffic-light/traffic-light.awl", "traffic-light/station.toml"], 1, "a station file among sources"),
    ] {
        let output = ob1(args);
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(part), "{output:?}");
    }
}

#[test]
fn a_stimulus_without_inputs_is_told() {
    let folder = tempfile::tempdir().expect("a directory");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("writable");
    write("p.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n");
    write("play.toml", "[[at]]\ntime = \"0ms\"\nset = { \"E 0.0\" = true }\n");
    let station = "[station]\nname = \"s\"\n[program]\nsources = [\"p.awl\"]\n[process_io]\nstimulus = \"play.toml\"\n";
    let path = folder.path().join("s.toml").display().to_string();
    for (modules, told) in [("", true), ("[[module]]\ntype = \"di\"\nname = \"i\"\naddress = 0\nbytes = 1\n", false)] {
        write("s.toml", &format!("{station}{modules}"));
        let output = ob1(&["check", &path]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(said.contains("s.toml:6:12: warning C005: the station has no module"), told, "{said}");
    }
}

/// What works, and is probably not meant so, is a warning: the station can run.
#[test]
fn parameters_without_an_effect_are_warnings() {
    let folder = tempfile::tempdir().expect("a directory");
    std::fs::write(folder.path().join("p.awl"), "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n")
        .expect("written");
    let path = folder.path().join("s.toml");
    let head = "[station]\nname = \"s\"\n[program]\nsources = [\"p.awl\"]\n[[simulated_line]]\nname = \"l\"\n";
    for (module, says) in [
        ("raw = \"09 01 13 00 00 0A 01 00 00 00 00 00 00 00 00 07\"\n", "s.toml:11:53: warning C008: "),
        ("params = { protocol = \"mbus\" }\ndiagnostics = true\n", "s.toml:12:15: warning C020: "),
        (
            "params = { protocol = \"3964\", qvz_ms = 0 }\n",
            "s.toml:11:40: warning C008: QVZ = 0 means 2 character times",
        ),
    ] {
        let own = "[[module]]\ntype = \"cp240\"\nname = \"x\"\nline = \"sim:l\"\n";
        let text = format!("{head}{own}{module}address = 256\n");
        std::fs::write(&path, text).expect("writable");
        let output = ob1(&["check", &path.display().to_string()]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(0) && said.contains(says), "{says}: {said}");
    }
}

#[test]
fn a_missing_stimulus_is_told_at_the_line_that_names_it() {
    let folder = tempfile::tempdir().expect("a directory");
    let path = folder.path().join("s.toml");
    let di = "[[module]]\ntype = \"di\"\nname = \"i\"\naddress = 0\nbytes = 1\n";
    let station = format!("[station]\nname = \"s\"\n[process_io]\nstimulus = \"gone.toml\"\n{di}");
    std::fs::write(&path, station).expect("writable");
    let output = ob1(&["check", &path.display().to_string()]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = text(&output) + &String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("s.toml:4:12: error C001: the file ") && said.contains("gone.toml cannot be"), "{said}");
}

#[test]
fn a_reference_that_is_not_there_is_told() {
    let output = ob1(&["xref", "traffic-light/traffic-light.awl", "--operand", "MW 999"]);
    assert_eq!((output.status.code(), text(&output).as_str()), (Some(0), "no statement uses MW 999 by its address\n"));
    let output = ob1(&["xref", "web/station.toml", "--operand", "mistak"]);
    assert_eq!((output.status.code(), text(&output).as_str()), (Some(1), ""));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("error C021: ") && said.contains("Did you mean \"mistake\"?"), "{said}");
}

#[test]
fn an_option_for_sources_is_refused_with_a_station_file() {
    for (command, option, value) in [
        ("check", "--symbols", "nosuch.sdf"),
        ("check", "--mnemonics", "en"),
        ("check", "--plugin", "nosuch"),
        ("check", "--library", "IEC"),
        ("check", "--numbers", "nosuch.numbers"),
        ("check", "--library-source", "nosuch.awl"),
        ("xref", "--symbols", "nosuch.sdf"),
        ("xref", "--plugin", "nosuch"),
    ] {
        let output = ob1(&[command, "traffic-light/station.toml", option, value]);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(&format!("C012: {option} is for sources")), "{command}: {said}");
    }
}

#[test]
fn a_listing_has_blocks_and_layouts() {
    for file in ["traffic-light/station.toml", "traffic-light/traffic-light.awl"] {
        let listing = ob1(&["check", file, "--compiled"]);
        assert_eq!(listing.status.code(), Some(0), "{listing:?}");
        let listing = text(&listing);
        for part in ["OB 100", "FC 2", "LAMPS", "CROSSINGS", "ok"] {
            assert!(listing.contains(part), "{part} is not in\n{listing}");
        }
        assert!(!text(&ob1(&["check", file])).contains("CROSSINGS"));
    }
}

#[test]
fn a_listing_shows_machine_code() {
    for file in ["traffic-light/station.toml", "traffic-light/traffic-light.awl"] {
        let listing = ob1(&["check", file, "--compiled", "--native"]);
        assert_eq!(listing.status.code(), Some(0), "{listing:?}");
        let listing = text(&listing);
        let is_head = |line: &&str| line.starts_with("FC 2: ") && line.contains("bytes of machine code");
        let head = listing.lines().find(is_head).expect("a block");
        let bytes = head.split(' ').nth(4).and_then(|word| word.parse::<u32>().ok());
        assert!(bytes.is_some_and(|bytes| bytes > 0), "{head}");
        assert!(listing.contains("bytes  line "), "{listing}");
        // The code of a statement stands right below it.
        let below = |pair: &[&str]| {
            let is_statement = pair[0].contains(" bytes  line ") && !pair[0].starts_with("       0 ");
            is_statement && pair[1].starts_with("        ") && !pair[1].contains(" bytes  line ")
        };
        let lines: Vec<&str> = listing.lines().collect();
        assert!(lines.windows(2).filter(|pair| below(pair)).count() > 10, "{listing}");
    }
    assert_eq!(
        ob1(&["check", "traffic-light/station.toml", "--native"]).status.code(),
        Some(1),
        "with --compiled only"
    );
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

/// A station without a plugin whose program calls a handling block.
fn declared_station(folder: &Path, libraries: &str) -> String {
    let source = "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n CALL FC 106 (LADDR := 256, RTS := M 0.0, DTR := M 0.1);\nEND_ORGANIZATION_BLOCK\n";
    std::fs::write(folder.join("p.awl"), source).expect("writable");
    let station = format!("[station]\nname = \"declared\"\n\n[program]\nsources = [\"p.awl\"]\n{libraries}\n");
    let path = folder.join("s.toml");
    std::fs::write(&path, station).expect("writable");
    path.display().to_string()
}

#[test]
fn a_declared_block_compiles_but_does_not_run() {
    let folder = tempfile::tempdir().expect("a directory");
    let station = declared_station(folder.path(), "libraries = [\"CP240\"]\n[library]\n\"FC 106\" = \"CP341:FC6\"");
    let source = folder.path().join("p.awl").display().to_string();
    // The sources by themselves are right.
    let sources = ob1(&["check", &source, "--library", "FC106=CP341:FC6"]);
    assert_eq!((sources.status.code(), text(&sources).as_str()), (Some(0), "ok\n"));
    // The station is not: nobody serves the block.
    for (args, code) in
        [(&["check", &station][..], 1), (&["run", &station, "--scans", "1"], 2), (&["xref", &station], 0)]
    {
        // A runtime directory of its own: another run of this test has a station of the same name.
        let output = command(args).env("XDG_RUNTIME_DIR", folder.path()).output().expect("ob1 starts");
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        let stderr = String::from_utf8_lossy(&output.stderr);
        let told = stderr.contains("L020") && stderr.contains("V24_SET (CP341:FC6)");
        assert_eq!(told, code != 0, "{args:?}: {stderr}");
    }
}

#[test]
fn libraries_that_want_the_same_numbers_are_told_apart() {
    let folder = tempfile::tempdir().expect("a directory");
    let station = declared_station(folder.path(), "libraries = [\"IEC\", \"CP341\"]");
    let output = ob1(&["check", &station]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("C006") && stderr.contains("FC 5 would be both IEC:FC5 and CP341:FC5"), "{stderr}");
    assert!(stderr.contains("\"FC 5\" = \"IEC:FC5\""), "{stderr}");
    let source = folder.path().join("p.awl").display().to_string();
    for command in ["check", "xref"] {
        let output = ob1(&[command, &source, "--library", "IEC,CP341"]);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("FC 6 would be both"), "{output:?}");
    }
}
