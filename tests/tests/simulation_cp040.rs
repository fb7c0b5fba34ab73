//! `examples/cp040-cp240` in virtual time: a CP 040 with FB 60 and FB 61 talks to a CP 240 with FC 0 and FC 1; a good line, a bad line,
//! kills, the same seed twice.

use std::path::{Path, PathBuf};

use ob1_line::sim::FaultRates;
use ob1_tests::sim::{self, Outcome, SECOND, Scenario};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/cp040-cp240")
}

fn run(scenario: &Scenario) -> Outcome {
    sim::run(scenario).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    })
}

#[test]
fn a_good_line_loses_nothing() {
    let scenario =
        Scenario { faults: FaultRates::NONE, kill_every: 0, duration: 20 * SECOND, ..Scenario::demo(&folder(), 7) };
    let outcome = run(&scenario);
    assert_eq!(outcome.verdict.broken, Vec::<String>::new(), "{}", outcome.log);
    for column in ["error", "aborted", "wrong", "doubled", "late", "lost", "undetectable"] {
        assert_eq!(outcome.verdict.get(column), 0, "{column}\n{}", outcome.verdict);
    }
    assert!(outcome.verdict.get("good") > 100, "{}", outcome.verdict);
    let a = outcome.stations.iter().find(|s| s.name.ends_with("-a")).expect("station A");
    assert_eq!(a.ledger(20, 52), 0, "errors of FB 61");
}

#[test]
fn fb_65_does_both() {
    let scenario = |seed| Scenario {
        stations: ["station-com.toml", "station-b.toml"].map(|name| folder().join(name)).to_vec(),
        ..Scenario::demo(&folder(), seed)
    };
    let good = Scenario { faults: FaultRates::NONE, kill_every: 0, duration: 20 * SECOND, ..scenario(7) };
    let outcome = run(&good);
    assert_eq!(outcome.verdict.broken, Vec::<String>::new(), "{}", outcome.log);
    for column in ["error", "aborted", "wrong", "doubled", "late", "lost"] {
        assert_eq!(outcome.verdict.get(column), 0, "{column}\n{}", outcome.verdict);
    }
    assert!(outcome.verdict.get("good") > 100, "{}", outcome.verdict);
    for seed in 1..=2 {
        let outcome = run(&scenario(seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}", outcome.verdict);
    }
}

#[test]
fn the_same_seed_gives_the_same_log_and_another_another() {
    let scenario = |seed| Scenario {
        faults: FaultRates::all(200),
        kill_every: 3 * SECOND,
        duration: 30 * SECOND,
        ..Scenario::demo(&folder(), seed)
    };
    let (first, second) = (run(&scenario(11)), run(&scenario(11)));
    assert!(first.kills > 0 && first.log.lines().count() > 100, "something has happened");
    assert_eq!(first.log, second.log);
    assert_ne!(first.log, run(&scenario(12)).log);
}

#[test]
fn seeds_of_a_simulated_minute() {
    for seed in 1..=6 {
        let outcome = run(&Scenario::demo(&folder(), seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}", outcome.verdict);
    }
}
