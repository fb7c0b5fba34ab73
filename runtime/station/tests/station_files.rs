//! Station files and what is said about them: each `tests/station/NAME.toml` against `NAME.txt`.
//!
//! `OB1_UPDATE=1 cargo test -p ob1-station --test station_files` rewrites the texts; look at the difference before you
//! commit it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ob1_cpu::CpuConfig;
use ob1_station::station_file::Station;

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
    match ob1_station::station_file::parse(&text, &name, Path::new("/station")) {
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
        let station = ob1_station::station_file::load(&path).unwrap_or_else(|findings| panic!("{findings:?}"));
        assert_eq!(station.modules.len(), 1, "{name}");
        assert!(station.program.files.iter().all(|s| s.exists()), "{name}");
    }
}
