//! A station with PROFIBUS, Modbus RTU and Modbus TCP in virtual time with faults: lost, doubled and damaged
//! characters, wrong checksums, interrupted cables, devices that lose their power and report faults, killed processes.
//! The rules: `plant/judge.rs`.

use ob1_time::Span;

use crate::plant;
use crate::plant::Told;

#[test]
fn a_hundred_seeds_of_a_plant_in_trouble() {
    let seeds = std::env::var("OB1_SEEDS").map_or(100, |text| text.parse().expect("a number"));
    let folder = tempfile::tempdir().expect("a folder");
    let mut all = Told::default();
    let mut interrupts = [0_u32; 2];
    for seed in 1..=seeds {
        let told = plant::run(seed, folder.path());
        (all.kills, all.expired) = (all.kills + told.kills, all.expired + told.expired);
        (0..2).for_each(|n| interrupts[n] += u32::from(told.interrupts[n]));
    }
    let Told { kills, expired, .. } = all;
    println!(
        "{seeds} seeds: {kills} kills, OB 86 {}, OB 82 {} times, {expired} watchdogs",
        interrupts[0], interrupts[1]
    );
    let enough = kills > 50 && interrupts[0] > 500 && interrupts[1] > 50 && expired > 50;
    assert!(enough, "nothing went wrong: {all:?} {interrupts:?}");
}

/// The process is restarted after 100 ms; all devices of all buses have returned within a second after the kill.
#[test]
fn a_killed_process_has_everything_back_within_a_second() {
    let folder = tempfile::tempdir().expect("a folder");
    let times = (1..=10).map(|seed| plant::killed(seed, folder.path()));
    let longest = times.max().expect("ten");
    assert!(longest < Span::SECOND, "{longest}");
}
