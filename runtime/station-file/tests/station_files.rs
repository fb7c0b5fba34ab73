//! Station files and what is said about them: each `tests/station/NAME.toml` against `NAME.txt`.
//!
//! `OB1_UPDATE=1 cargo test -p ob1-station-file --test station_files` rewrites the texts; look at the difference before
//! you commit it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ob1_cpu::CpuConfig;
use ob1_station_file::Station;

fn files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/station");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .expect("the folder is part of the crate")
        .map(|entry| entry.expect("readable").path())
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .collect();
    files.sort();
    files
}

/// The station; of the CPU only what is not the default, so that a new setting does not change every answer.
fn describe(mut station: Station) -> String {
    let cpu = std::mem::take(&mut station.cpu);
    let default = format!("{:#?}", CpuConfig::default());
    let default: Vec<&str> = default.lines().collect();
    let cpu = format!("{cpu:#?}");
    let own = cpu.lines().filter(|line| !default.contains(line)).map(|line| format!("{line}\n"));
    let cpu = format!("cpu:\n{}", own.collect::<String>());
    let whole = default.iter().map(|line| format!("    {line}")).collect::<Vec<_>>().join("\n");
    format!("{cpu}{station:#?}\n").replace(&format!("cpu: {}", whole.trim_start()), "cpu: (above)")
}

fn answer(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("readable");
    let name = path.file_name().expect("a file").to_string_lossy();
    match ob1_station_file::parse(&text, &name, Path::new("/station")) {
        Ok(station) => describe(station),
        Err(findings) => {
            assert!(!findings.is_empty(), "{name}: refused without a reason");
            findings.iter().fold(String::new(), |mut out, finding| {
                let _ = writeln!(out, "{finding}");
                out
            })
        }
    }
}

/// Each module is looked at once, not beside each other.
#[test]
fn many_modules_are_read() {
    let read = |modules: usize| {
        let mut text = String::from("[station]\nname = \"many\"\n");
        for n in 0..modules {
            let _ = write!(text, "[[module]]\ntype = \"do\"\nname = \"m{n}\"\naddress = {n}\nbytes = 1\n");
        }
        let station = ob1_station_file::parse(&text, "many.toml", Path::new("."));
        station.map(|station| station.modules.len()).map_err(|found| (found.len(), found[200].message.clone()))
    };
    assert_eq!(read(16_384), Ok(16_384));
    // The others have no address: an error for each of them, and for each of its bytes.
    assert_eq!(read(40_000), Err((201, "47032 errors more".to_owned())));
}

#[test]
fn every_station_file_gets_its_answer() {
    let files = files();
    assert!(files.len() > 10, "the files have gone");
    let mut wrong = String::new();
    for path in files {
        let expected_path = path.with_extension("txt");
        let answer = answer(&path);
        if std::env::var_os("OB1_UPDATE").is_some() {
            std::fs::write(&expected_path, &answer).expect("writable");
        }
        let expected = std::fs::read_to_string(&expected_path).unwrap_or_default();
        if answer != expected {
            let _ = writeln!(wrong, "== {}\n-- expected\n{expected}\n-- got\n{answer}", path.display());
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn the_examples_are_good() {
    for name in ["two-stations/station-a.toml", "two-stations/station-b.toml"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name);
        let station = ob1_station_file::load(&path).unwrap_or_else(|findings| panic!("{findings:?}"));
        assert_eq!(station.modules.len(), 1, "{name}");
        assert!(station.program.files.iter().all(|s| s.exists()), "{name}");
    }
}

/// What is said of a table of alarm texts, by number, file and line; the text of a message number.
fn alarms(table: Option<&str>) -> Result<String, Vec<(String, String, u32)>> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("s.toml");
    std::fs::write(&path, "[station]\nname = \"s\"\n[program]\nsources = []\nalarms = \"alarms.csv\"\n")
        .expect("writable");
    if let Some(table) = table {
        std::fs::write(folder.path().join("alarms.csv"), table).expect("writable");
    }
    let told = |finding: ob1_station_file::finding::Finding| {
        let file = Path::new(&finding.file).file_name().expect("a file").to_string_lossy().into_owned();
        (finding.code, file, finding.line)
    };
    let (station, _) =
        ob1_station_file::load_and_look(&path).map_err(|found| found.into_iter().map(told).collect::<Vec<_>>())?;
    Ok(station.alarm_texts.of(7, 1).map(|row| row.text.with(&[&[0, 5]])).unwrap_or_default())
}

#[test]
fn the_table_of_alarm_texts_is_read_and_checked() {
    assert_eq!(alarms(Some("number;text\n7;Pump @1W%d@\n")), Ok("Pump 5".to_owned()));
    let found = |code: &str, file: &str, line| (code.to_owned(), file.to_owned(), line);
    assert_eq!(alarms(None), Err(vec![found("C001", "s.toml", 5)]));
    let wrong = "number;text\n7;Pump @1W%q@\n8;Tank\n8;Tank\n";
    assert_eq!(alarms(Some(wrong)), Err(vec![found("C022", "alarms.csv", 2), found("C022", "alarms.csv", 4)]));
}

/// What is said of a module, by number and place.
fn said_of(module: &str) -> Vec<(String, u32, String)> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("s.toml");
    let head = "[station]\nname = \"s\"\n[program]\nsources = []\n[[simulated_line]]\nname = \"l\"\n";
    let text = format!("{head}[[module]]\nname = \"x\"\naddress = 256\nline = \"sim:l\"\n{module}");
    std::fs::write(&path, text).expect("writable");
    let found = match ob1_station_file::load_and_look(&path) {
        Ok((_, warnings)) => warnings,
        Err(errors) => errors,
    };
    found.into_iter().map(|finding| (finding.code, finding.line, finding.text)).collect()
}

fn codes(module: &str) -> Vec<String> {
    said_of(module).into_iter().map(|(code, ..)| code).collect()
}

/// Hardware configurations write there: a record is accepted with a warning at its first such byte.
#[test]
fn reserved_bytes_of_a_record_are_a_warning() {
    for (kind, raw, byte) in [
        ("cp240", "09 04 53 07 00 0A 19 64 05 06 01 00 00 00 00 00", "2 (53h), 3 (07h)"),
        ("cp240", "09 0B 13 00 00 00 00 00 00 00 00 00 00 00 00 01", "15 (01h)"),
        ("cp040", "09 01 13 00 00 00 C8 01 05 00 00 00 00 00 00 00", "8 (05h)"),
    ] {
        let said = said_of(&format!("type = \"{kind}\"\nraw = \"{raw}\"\n"));
        let [(code, line, text)] = said.as_slice() else { panic!("{said:?}") };
        assert_eq!((code.as_str(), *line), ("C008", 12), "{text}");
        assert!(text.contains(": warning C008: ") && text.contains(&format!("in byte {byte}")), "{text}");
    }
    // The address of a master is ignored; EnOcean and M-Bus do not evaluate the others.
    for raw in ["09 0B 13 00 00 00 00 00 00 00 00 00 00 00 00 00", "09 F0 13 01 02 03 00 00 00 00 00 00 00 00 00 00"] {
        assert_eq!(said_of(&format!("type = \"cp240\"\nraw = \"{raw}\"\n")), [], "{raw}");
    }
}

#[test]
fn sixteen_zeros_are_a_cp_without_parameters() {
    let zeros = ["00"; 16].join(" ");
    for kind in ["cp240", "cp040"] {
        assert_eq!(said_of(&format!("type = \"{kind}\"\nraw = \"{zeros}\"\n")), [], "{kind}");
        let said = said_of(&format!("type = \"{kind}\"\n"));
        assert!(said[0].0 == "C004" && said[0].2.contains("sixteen 00 are a CP without parameters"), "{said:?}");
    }
}

#[test]
fn a_qvz_of_0_is_a_warning() {
    for kind in ["cp240", "cp040"] {
        let with =
            |qvz: u32| codes(&format!("type = \"{kind}\"\nparams = {{ protocol = \"3964r\", qvz_ms = {qvz} }}\n"));
        assert_eq!((with(0), with(20)), (vec!["C008".to_owned()], vec![]), "{kind}");
    }
}

/// [S0 L4717], [S1 L781]
#[test]
fn diagnostics_without_an_effect_are_a_warning() {
    for (protocol, effect) in [("mbus", false), ("enocean", false), ("ascii", true)] {
        let with =
            |on| codes(&format!("type = \"cp240\"\nparams = {{ protocol = \"{protocol}\" }}\ndiagnostics = {on}\n"));
        let expected = if effect { vec![] } else { vec!["C020".to_owned()] };
        assert_eq!((with(true), with(false)), (expected, vec![]), "{protocol}");
    }
}

/// [S0 L1351], [S0 L1504], [S0 L1526]
#[test]
fn an_interface_says_what_it_cannot_do() {
    let with = |interface: &str, flow: &str| {
        let said = said_of(&format!(
            "type = \"cp240\"\nparams = {{ protocol = \"ascii\", flow = \"{flow}\" }}\ninterface = \"{interface}\"\n"
        ));
        said.into_iter().map(|(code, _, text)| (code, text.contains(": error "))).collect::<Vec<_>>()
    };
    let told = |error: bool| vec![("C008".to_owned(), error)];
    for (interface, flow, expected) in [
        ("rs232", "hardware", vec![]),
        ("rs422", "hardware", told(true)),
        ("rs485", "hardware", told(true)),
        ("rs422", "xon-xoff", vec![]),
        ("rs485", "xon-xoff", told(false)),
        ("rs485", "none", vec![]),
        ("rs", "none", vec![("C005".to_owned(), true)]),
    ] {
        assert_eq!(with(interface, flow), expected, "{interface} {flow}");
    }
    assert_eq!(codes("type = \"cp040\"\nparams = { protocol = \"ascii\" }\ninterface = \"rs485\"\n"), ["C010"]);
    assert_eq!(codes("type = \"cp240\"\nparams = { protocol = \"mbus\" }\ninterface = \"rs485\"\n"), ["C010"]);
}
