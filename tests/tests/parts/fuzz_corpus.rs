//! Replays the committed inputs of the fuzz targets: each reaches new code, or once caused a panic.

use std::path::Path;

use ob1_tests::fuzz::TARGETS;

fn checkout(path: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

#[test]
fn no_input_makes_a_target_panic() {
    for (name, run) in TARGETS {
        let folder = checkout("fuzz/corpus").join(name);
        let entries = std::fs::read_dir(&folder).unwrap_or_else(|why| panic!("{}: {why}", folder.display()));
        let mut inputs = 0;
        for entry in entries {
            let path = entry.expect("an entry").path();
            let input = std::fs::read(&path).expect("a file");
            // Printed first, so that the name precedes a panic.
            println!("{}", path.display());
            run(&input);
            inputs += 1;
        }
        assert!(inputs > 0, "{} is empty", folder.display());
    }
}

#[test]
fn the_targets_are_those_of_the_fuzz_crate() {
    let manifest = std::fs::read_to_string(checkout("fuzz/Cargo.toml")).expect("its manifest");
    let binaries: Vec<&str> = manifest
        .split("[[bin]]")
        .skip(1)
        .filter_map(|bin| bin.lines().find_map(|line| line.strip_prefix("name = ")))
        .map(|name| name.trim_matches('"'))
        .collect();
    let names: Vec<&str> = TARGETS.iter().map(|(name, _)| *name).collect();
    assert_eq!(binaries, names);
    for name in names {
        let text = std::fs::read_to_string(checkout(&format!("fuzz/fuzz_targets/{name}.rs"))).expect("its target");
        assert!(text.contains(&format!("fuzz::{name}::run(data)")), "{name}: {text}");
    }
}
