//! `examples/cp040-cp240` in virtual time: a CP 040 with FB 60 and FB 61 communicates with a CP 240 with FC 0 and FC 1;
//! a good line, a bad line, kills, the same seed twice.

use std::path::PathBuf;

use ob1_tests::sim::{SECOND, Scenario};

use crate::common::pair::{self, run};

fn folder() -> PathBuf {
    pair::example("cp040-cp240")
}

#[test]
fn a_good_line_loses_nothing() {
    let outcome = pair::loses_nothing(Scenario::demo(&folder(), 7), 20 * SECOND, &pair::FAULTS);
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
    let outcome = pair::loses_nothing(scenario(7), 20 * SECOND, &pair::FAULTS);
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
