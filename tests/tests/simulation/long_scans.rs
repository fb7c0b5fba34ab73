//! A long scan, in virtual time: lines and drivers continue between two calls of handling blocks, and a killed driver
//! starts again during a scan. It must not silently lose the orders that the program then gives.

use ob1_line::sim::FaultRates;
use ob1_tests::sim::{MS, SECOND, Scenario};
use ob1_time::Span;

use crate::common::pair::{self, run};

/// Kills on a good line: each order ends, and the exchange recovers each time.
fn comes_back(example: &str, call: Span) {
    let folder = pair::example(example);
    let mut up_in_scans = 0;
    for seed in 1..=6 {
        let scenario = Scenario {
            faults: FaultRates::NONE,
            kill_every: 2 * SECOND,
            duration: 60 * SECOND,
            call,
            ..Scenario::demo(&folder, seed)
        };
        let outcome = run(&scenario);
        assert!(outcome.verdict.broken.is_empty(), "{example}, seed {seed}\n{}\n{}", outcome.log, outcome.verdict);
        assert!(outcome.kills > 10, "{example}, seed {seed}: {} kills", outcome.kills);
        up_in_scans += outcome.up_in_scans;
    }
    assert!(up_in_scans > 20, "{example}: {up_in_scans} drivers came up while a scan was under way");
}

#[test]
fn a_cp_240_that_comes_up_within_a_scan_loses_no_order_unsaid() {
    comes_back("two-stations", 3 * MS);
}

#[test]
fn a_cp_040_that_comes_up_within_a_scan_loses_no_order_unsaid() {
    comes_back("cp040-cp240", 3 * MS);
}

#[test]
fn a_cp_340_that_comes_up_within_a_scan_loses_no_order_unsaid() {
    comes_back("cp340-pair", 3 * MS);
}

#[test]
fn a_cp_341_that_comes_up_within_a_scan_loses_no_order_unsaid() {
    comes_back("cp341-pair", 3 * MS);
}
