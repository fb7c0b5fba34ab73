//! The whole-station simulation: determinism, a good line, a bad line, kills.

use ob1_time::Span;
use std::path::PathBuf;

use ob1_line::sim::FaultRates;
use ob1_tests::sim::{SECOND, Scenario};

use crate::common::pair::{self, run};
use crate::common::site::replaced;

fn folder() -> PathBuf {
    pair::example("two-stations")
}

fn replay(seed: u64) -> String {
    format!("replay: cargo xtask sim --seed {seed} --log")
}

#[test]
fn a_good_line_loses_nothing() {
    let outcome = pair::loses_nothing(Scenario::demo(&folder(), 7), 20 * SECOND, &pair::FAULTS);
    // 250 bytes there and back at 115200 baud and a handshake block a scan: some ten telegrams a second.
    assert!(outcome.verdict.get("good") > 100, "{}", outcome.verdict);
}

#[test]
fn the_same_seed_gives_the_same_log_and_another_another() {
    pair::assert_repeats(&folder());
}

#[test]
fn either_engine_gives_the_same_log() {
    pair::assert_engines_agree(&folder(), 1..=4);
}

#[test]
fn seeds_of_a_simulated_minute() {
    for seed in 1..=16 {
        let outcome = run(&Scenario::demo(&folder(), seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}{}", outcome.verdict, replay(seed));
    }
}

/// Seeds found by longer runs, each with its cause. In all of them the check of the test did not consider errors that
/// the check character cannot detect.
#[test]
fn seeds_that_once_failed() {
    for seed in [
        // A 00 lost on the way to B; the acknowledgement of B's echo was corrupted, so that the wrong echo was received
        // twice. The third: a 00 lost on the way back, after a request that was answered by a request.
        911, 1762, 4778,
        // A driver was killed during a block. The next one refused each character of the rest, the sender repeated its
        // request after each NAK, and two of the requests were received as data: they cancel out in the check
        // character.
        2007,
        // The rest of an abandoned block has an STX in its data: it looks like a block with a correct check character.
        8162,
        // Both sent a request at the same time, one withdrew: the DLE of the other is not data, and the next request is
        // not a repetition.
        9754, 9981,
    ] {
        let outcome = run(&Scenario::demo(&folder(), seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}{}", outcome.verdict, replay(seed));
    }
}

#[test]
fn without_a_cable_no_order_is_ever_done() {
    // Every character is lost: checks that "done" is not reported without an acknowledgement.
    let scenario = Scenario {
        faults: FaultRates { lose: 1_000_000, ..FaultRates::NONE },
        kill_every: Span::ZERO,
        duration: 60 * SECOND,
        ..Scenario::demo(&folder(), 3)
    };
    // Nothing is lost in the calm at the end, so only the time before it is checked: the log contains each change of a
    // counter.
    let calm = 45_000_000;
    let outcome = run(&scenario);
    let mut errors = 0;
    for line in outcome.log.lines() {
        let mut words = line.split_whitespace();
        let (Some(at), Some(_), Some(what)) =
            (words.next().and_then(|w| w.parse::<u64>().ok()), words.next(), words.next())
        else {
            continue;
        };
        if at < calm {
            assert!(!matches!(what, "done" | "good" | "wrong" | "late"), "{line}");
            errors += u64::from(what == "error");
        }
    }
    assert!(errors > 3, "orders failed:\n{}", outcome.log);
    assert!(outcome.verdict.broken.is_empty(), "and it came back:\n{}", outcome.verdict);
}

/// B needs several seconds for the echo of a long telegram, longer than A waits: the echoes of the following short ones
/// arrive when A is two telegrams ahead. They are late, but correct.
#[test]
fn late_echoes_of_short_telegrams_are_known_as_such() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["a.awl", "b.awl", "station-a.toml", "station-b.toml"] {
        let text = std::fs::read_to_string(self::folder().join(name)).expect("a file of the example");
        // Telegram 249 is the longest, 250 to 252 have one to three bytes.
        let begun = "END_STRUCT;\nBEGIN\nNUMBER := L#246;\nCONFIRMED := L#246;\n";
        let text = match name {
            "a.awl" => {
                let (before, ledger) = text.split_once("TITLE = Ledger of station A").expect("DB 20");
                let ledger = ledger.replacen("END_STRUCT;\nBEGIN\n", begun, 1);
                format!("{before}TITLE = Ledger of station A{ledger}")
            }
            "station-b.toml" => {
                replaced(&text, "min_cycle = \"1ms\"", "min_cycle = \"200ms\"").replace("150ms", "500ms")
            }
            _ => text,
        };
        std::fs::write(folder.path().join(name), text).expect("room for a file");
    }
    let demo = Scenario::demo(folder.path(), 7);
    let outcome = run(&demo.undisturbed(60 * SECOND));
    let [lost, late] = ["lost", "late"].map(|column| outcome.verdict.get(column));
    assert!(lost > 2 && late > 2, "{}", outcome.log);
    assert_eq!((outcome.verdict.get("wrong"), outcome.verdict.get("undetectable")), (0, 0), "{}", outcome.log);
}
