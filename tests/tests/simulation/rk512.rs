//! The RK 512 pair of `examples/rk512-pair` in virtual time: SEND, FETCH, the coordination flag, both directions at
//! once; a good line, a bad line, kills, the same seed twice.

use std::path::PathBuf;

use ob1_tests::sim::{Outcome, SECOND, Scenario};

use crate::common::pair::{self, run};

fn folder() -> PathBuf {
    pair::example("rk512-pair")
}

/// A cell of a station's DB 20.
fn cell(outcome: &Outcome, station: &str, byte: usize) -> u32 {
    let station = outcome.stations.iter().find(|s| s.name.ends_with(station)).expect("a station of the pair");
    station.ledger(20, byte)
}

#[test]
fn a_good_line_loses_nothing() {
    let outcome =
        pair::loses_nothing(Scenario::demo(&folder(), 7), 20 * SECOND, &["error", "aborted", "wrong", "undetectable"]);
    let good = outcome.verdict.get("good");
    assert!(good > 50, "{}", outcome.verdict);
    // B has passed on each block (one may still be in transit), and its own orders have arrived, all without an error.
    let received = u64::from(cell(&outcome, "-b", 4));
    assert!((good..=good + 1).contains(&received), "{received} handed on, {good} fetched back");
    let (done, error, aborted) = (cell(&outcome, "-b", 12), cell(&outcome, "-b", 16), cell(&outcome, "-b", 20));
    assert!(done > 50 && error + aborted == 0, "{done} done, {error} failed, {aborted} aborted");
    let counter = outcome.stations[0].ledger(30, 0) >> 16;
    assert!((done..=done + 1).contains(&counter), "A holds {counter}, B has sent {done}");
}

#[test]
fn the_same_seed_gives_the_same_log_and_another_another() {
    pair::assert_repeats(&folder());
}

#[test]
fn seeds_of_a_simulated_minute() {
    for seed in 1..=5 {
        let outcome = run(&Scenario::demo(&folder(), seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}", outcome.verdict);
    }
}
