//! Two whole stations over Ethernet, in virtual time: BSEND, USEND, PUT and GET, and the AG blocks over ISO on TCP, TCP
//! and UDP, in both directions, on a network with delays, splitting and loss; connections break or become silent, the
//! process of a CP is killed, a station goes to STOP. The rules: `coupled/judge.rs`.

use ob1_tests::siege;
use ob1_time::{Instant, Span};

use crate::coupled::{KILL, MS, Outcome, SECOND, STOP, STREAMS, Scenario, run};

/// Telegrams in the test suite.
const TELEGRAMS: u64 = 50_000;

fn trouble(seed: u64) -> Scenario {
    let every = [60 * MS, 250 * MS, SECOND][(seed % 3) as usize];
    Scenario {
        seed,
        trouble: Instant::from_secs(4 + seed % 5),
        every,
        only: None,
        loses: [8, 20][(seed % 2) as usize],
        call: Span::ZERO,
        late: Span::ZERO,
    }
}

#[test]
fn on_a_good_network_everything_comes() {
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = run(
        Scenario {
            seed: 7,
            trouble: Instant::from_secs(3),
            every: Span::ZERO,
            only: None,
            loses: 0,
            call: Span::ZERO,
            late: Span::ZERO,
        },
        folder.path(),
    );
    let Outcome { told, .. } = &outcome;
    assert!(told.telegrams.iter().all(|count| *count > 200), "{outcome:?}");
    // Jobs may fail until the connections are established, and newer data of USEND may overwrite older ones.
    assert_eq!((told.late, outcome.left_out), (0, 0), "{outcome:?}");
}

#[test]
fn the_same_seed_gives_the_same_log_and_another_another() {
    let folder = tempfile::tempdir().expect("a folder");
    let of = |seed| run(trouble(seed), folder.path());
    let (first, second) = (of(3), of(3));
    assert!(first.log.lines().count() > 10, "something has happened: {first:?}");
    assert_eq!(first, second);
    assert_ne!(first.log, of(6).log);
}

/// Two milliseconds before and after each call of a handling block: a killed CP is often ready again during a scan. The
/// orders that the program writes in the rest of that scan must not be lost.
#[test]
fn a_cp_that_becomes_ready_within_a_scan_loses_no_order() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut again_in_scans = 0;
    for seed in 1..=14 {
        // Short runs, because a later kill would end a wait without end that an earlier one has caused.
        let every = 400 * MS;
        let scenario = Scenario {
            seed,
            trouble: Instant::from_secs(3),
            every,
            only: Some(KILL),
            loses: 0,
            call: 2 * MS,
            late: Span::ZERO,
        };
        let outcome = run(scenario, folder.path());
        // The first start of each station is not a restart.
        again_in_scans += outcome.up_in_scans.saturating_sub(2);
    }
    assert!(again_in_scans > 30, "{again_in_scans}");
}

/// The programs call their blocks again before the CPs have seen what they have taken: what a program has is not
/// refused to its sender (the judge's rule), and none is left out.
#[test]
fn a_cp_that_is_slower_than_the_cycle_refuses_nothing_that_was_given() {
    let folder = tempfile::tempdir().expect("a folder");
    for late in [4 * MS, 12 * MS] {
        let trouble = Instant::from_secs(4);
        let outcome = run(
            Scenario { seed: 11, trouble, every: Span::ZERO, only: None, loses: 0, call: Span::ZERO, late },
            folder.path(),
        );
        assert!(outcome.told.telegrams.iter().all(|count| *count > 30), "{outcome:?}");
        assert_eq!((outcome.told.late, outcome.left_out), (0, 0), "{outcome:?}");
    }
    // CPUs that stop at any moment.
    for seed in 1..=4 {
        let scenario = Scenario { late: 8 * MS, every: 100 * MS, loses: 0, ..trouble(seed) };
        let outcome = run(Scenario { only: Some(STOP), ..scenario }, folder.path());
        assert!(outcome.stops > 3, "{outcome:?}");
    }
}

/// `cargo xtask siege s7_simulation`: a million telegrams.
#[test]
fn s7_simulation() {
    let folder = tempfile::tempdir().expect("a folder");
    let wanted = siege::rounds(TELEGRAMS);
    let mut all = Outcome::default();
    let mut seeds = 0;
    while all.telegrams() < wanted {
        seeds += 1;
        let outcome = run(trouble(siege::first() + seeds), folder.path());
        (all.breaks, all.mutes) = (all.breaks + outcome.breaks, all.mutes + outcome.mutes);
        (all.kills, all.stops) = (all.kills + outcome.kills, all.stops + outcome.stops);
        all.told.telegrams.iter_mut().zip(outcome.told.telegrams).for_each(|(sum, count)| *sum += count);
        for (what, count) in outcome.told.failed {
            *all.told.failed.entry(what).or_default() += count;
        }
    }
    println!(
        "{} telegrams in {seeds} seeds: {} connections broken, {} mute, {} CPs killed, {} times in STOP",
        all.telegrams(),
        all.breaks,
        all.mutes,
        all.kills,
        all.stops
    );
    for (stream, count) in STREAMS.iter().zip(all.told.telegrams) {
        println!("{:>12} {count}", stream.name);
    }
    all.told.failed.iter().for_each(|((name, which, status), count)| {
        println!("{name:>12}, {which}: STATUS {status:04X} {count} times");
    });
    assert!(all.told.telegrams.iter().all(|count| *count > 200), "{all:?}");
    assert!(all.breaks > 3 && all.kills > 5 && all.stops > 1, "{all:?}");
}
