//! A pair of stations of the examples in virtual time.

use std::path::{Path, PathBuf};

use ob1_line::sim::FaultRates;
use ob1_tests::sim::{self, Outcome, SECOND, Scenario};
use ob1_time::Span;

/// The folder of an example.
pub(crate) fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(name)
}

/// The files of an example in a new folder, changed so that its stations run on this engine.
pub(crate) fn on_engine(folder: &Path, engine: &str) -> tempfile::TempDir {
    let copy = tempfile::tempdir().expect("room for a folder");
    for entry in std::fs::read_dir(folder).expect("the example").map(|entry| entry.expect("a file")) {
        let to = copy.path().join(entry.file_name());
        match std::fs::read_to_string(entry.path()) {
            Ok(text) if entry.path().extension().is_some_and(|end| end == "toml") => {
                let engine = format!("[cpu]\nengine = \"{engine}\"\n");
                std::fs::write(to, super::site::replaced(&text, "[cpu]\n", &engine)).expect("room");
            }
            Ok(text) => std::fs::write(to, text).expect("room"),
            // A folder.
            Err(_) => {}
        }
    }
    copy
}

/// Checks that the same seed gives exactly the same log on each engine.
pub(crate) fn assert_engines_agree(folder: &Path, seeds: impl Iterator<Item = u64>) {
    let folders = ["reference", "native"].map(|engine| on_engine(folder, engine));
    for seed in seeds {
        let [one, two] = folders.each_ref().map(|folder| {
            let outcome = run(&Scenario { duration: 30 * SECOND, ..Scenario::demo(folder.path(), seed) });
            let engine = outcome.stations[0].engine();
            (outcome.log, engine)
        });
        assert_eq!((one.1, two.1), ("reference", "native"));
        assert!(one.0.lines().count() > 100, "something has happened");
        assert_eq!(one.0, two.0, "seed {seed}");
    }
}

/// Runs it.
pub(crate) fn run(scenario: &Scenario) -> Outcome {
    sim::run(scenario).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    })
}

/// Runs it undisturbed; no telegram is lost, and none of these columns counts anything.
pub(crate) fn loses_nothing(scenario: Scenario, duration: Span, columns: &[&str]) -> Outcome {
    let outcome = run(&scenario.undisturbed(duration));
    assert_eq!(outcome.verdict.broken, Vec::<String>::new(), "{}", outcome.log);
    for column in columns {
        assert_eq!(outcome.verdict.get(column), 0, "{column}\n{}\n{}", outcome.verdict, outcome.log);
    }
    outcome
}

/// What a pair on a good line never counts.
pub(crate) const FAULTS: [&str; 7] = ["error", "aborted", "wrong", "doubled", "late", "lost", "undetectable"];

/// On a bad line, with kills, the same seed gives the same log to the byte, and another seed another log.
pub(crate) fn assert_repeats(folder: &Path) {
    let scenario = |seed| Scenario {
        faults: FaultRates::all(200),
        kill_every: 3 * SECOND,
        duration: 30 * SECOND,
        ..Scenario::demo(folder, seed)
    };
    let (first, second) = (run(&scenario(11)), run(&scenario(11)));
    assert!(first.kills > 0 && first.log.lines().count() > 100, "something has happened");
    assert_eq!(first.log, second.log);
    assert_ne!(first.log, run(&scenario(12)).log);
}
