//! `examples/cp040-cp240` in virtual time: a CP 040 with FB 60 and FB 61 talks to a CP 240 with FC 0 and FC 1; a good
//! line, a bad line, kills, the same seed twice.

mod common;

use ob1_time::Span;
use std::path::PathBuf;

use common::pair::{self, run};
use ob1_line::sim::FaultRates;
use ob1_tests::sim::{SECOND, Scenario};

fn folder() -> PathBuf {
    pair::example("cp040-cp240")
}

#[test]
fn a_good_line_loses_nothing() {
    let scenario = Scenario {
        faults: FaultRates::NONE,
        kill_every: Span::ZERO,
        duration: 20 * SECOND,
        ..Scenario::demo(&folder(), 7)
    };
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
    let good = Scenario { faults: FaultRates::NONE, kill_every: Span::ZERO, duration: 20 * SECOND, ..scenario(7) };
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
    pair::assert_repeats(&folder());
}

#[test]
fn seeds_of_a_simulated_minute() {
    for seed in 1..=6 {
        let outcome = run(&Scenario::demo(&folder(), seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}", outcome.verdict);
    }
}
