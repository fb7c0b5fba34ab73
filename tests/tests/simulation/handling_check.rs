//! `ob1 check` on the examples, with the plugins: no false alarm.

use std::path::{Path, PathBuf};

use ob1_station_file::{self, is_station_file};

/// All station files of the examples.
fn stations() -> Vec<PathBuf> {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
    let folders = std::fs::read_dir(examples).expect("the examples").flatten().map(|entry| entry.path());
    let files = folders.filter(|path| path.is_dir()).flat_map(|folder| std::fs::read_dir(folder).expect("readable"));
    let toml = files.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "toml"));
    let mut stations: Vec<PathBuf> =
        toml.filter(|path| is_station_file(path) && ob1_station_file::load(path).is_ok()).collect();
    stations.sort();
    stations
}

#[test]
fn nothing_is_said_of_the_handling_blocks_of_the_examples() {
    let (mut checked, mut said) = (0, String::new());
    for path in stations() {
        let (station, mut findings) = ob1_station::look::load(&path).expect("it has been read");
        // Those with a plugin of their own language are built by their own tests.
        let Ok(loaded) = ob1_station::program::load(&station) else { continue };
        checked += usize::from(station.modules.iter().any(|module| module.kind.cp().is_some()));
        findings.extend(loaded.findings);
        let of_handling =
            |code: &str| code == "L022" || ("L024".."L031").contains(&code) || matches!(code, "C008" | "C020");
        for finding in findings.iter().filter(|finding| of_handling(&finding.code)) {
            said.push_str(&finding.text);
        }
    }
    assert!(said.is_empty(), "{said}");
    assert!(checked > 20, "only {checked} stations with a CP");
}
