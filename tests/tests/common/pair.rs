//! A pair of stations in virtual time, as the examples have them.

use std::path::{Path, PathBuf};

use ob1_line::sim::FaultRates;
use ob1_tests::sim::{self, Outcome, SECOND, Scenario};

/// The folder of an example.
pub(crate) fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(name)
}

/// Runs it.
pub(crate) fn run(scenario: &Scenario) -> Outcome {
    sim::run(scenario).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    })
}

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
