//! The CP 341 pair of `examples/cp341-pair` in virtual time: P_SND_RK to P_RCV_RK over 3964R, SEND and FETCH over RK
//! 512.

use std::path::PathBuf;

use ob1_tests::sim::{Outcome, SECOND, Scenario};

use crate::common::pair::{self, run};

fn folder() -> PathBuf {
    pair::example("cp341-pair")
}

/// A cell of a station's ledger.
fn cell(outcome: &Outcome, station: &str, db: u16, byte: usize) -> u32 {
    let station = outcome.stations.iter().find(|s| s.name.ends_with(station)).expect("a station of the pair");
    station.ledger(db, byte)
}

#[test]
fn a_good_line_loses_nothing() {
    let outcome = pair::loses_nothing(Scenario::demo(&folder(), 7), 20 * SECOND, &pair::FAULTS);
    assert!(outcome.verdict.get("good") > 200, "{}", outcome.verdict);
    // RK 512: a SEND and a FETCH each, all correct.
    let (done, good) = (cell(&outcome, "-a", 21, 12), cell(&outcome, "-a", 21, 24));
    assert!(good > 100 && done >= 2 * good, "{done} jobs done, {good} blocks right");
    for (name, byte) in [("error", 16), ("aborted", 20), ("wrong", 28)] {
        assert_eq!(cell(&outcome, "-a", 21, byte), 0, "{name}");
    }
    let served = cell(&outcome, "-b", 21, 0);
    assert!((done..=done + 1).contains(&served), "{served} served, {done} done");
    assert_eq!(cell(&outcome, "-b", 21, 4), 0, "errors of P_RCV_RK");
}

#[test]
fn the_same_seed_gives_the_same_log_and_another_another() {
    pair::assert_repeats(&folder());
}

/// Good and bad lines, characters in bursts, killed drivers: each job ends exactly once, no wrong data are accepted,
/// and everything recovers.
#[test]
fn seeds_of_a_simulated_minute() {
    for seed in 1..=4 {
        let outcome = run(&Scenario::demo(&folder(), seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}", outcome.verdict);
        let [started, done, error, aborted, wrong] = [8, 12, 16, 20, 28].map(|byte| cell(&outcome, "-a", 21, byte));
        let ended = done + error + aborted;
        assert!(ended <= started && started <= ended + 1, "seed {seed}: {started} started, {ended} ended over RK 512");
        assert!(done > 0 && u64::from(wrong) <= outcome.verdict.get("undetectable"), "seed {seed}: {wrong} wrong");
    }
}
