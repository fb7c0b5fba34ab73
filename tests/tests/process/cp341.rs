//! `examples/cp341-pair` as real processes: two stations with two CP 341 each, 3964R and RK 512, on two simulated
//! lines. Nothing is lost, doubled or wrong; if a driver is killed, only its telegrams are lost, and they are not
//! reported as DONE.

use std::fs;

use ob1_line::sim::SplitMix64;
use rustix::process::Signal;

use crate::common::checkout;
use crate::common::ledger::{self, Ledger};
use crate::common::site::{Site, example_station, on_a_simulated_line};
use crate::common::station::Running;

/// The two CPs of each station, and the line between each pair.
const CPS: [(&str, &str); 2] = [("cp-3964r", "s3964r"), ("cp-rk512", "rk512")];

/// Scans that must run after a kill, at 1 ms.
const ACROSS: u64 = 1000;
/// Events of the diagnostic buffer.
const WATCHDOG: &str = "3501h";
const DRIVER_LOST: &str = "F201h";
/// STATUS of P_RCV_RK: the character delay time has expired within a block. (docs/cp341-events.md)
const CHARACTER_DELAY: i64 = 0x0806;

/// The example on simulated lines instead of ptys.
fn pair() -> (Site, Running, Running) {
    let site = Site::new();
    for name in ["a.awl", "b.awl"] {
        fs::copy(checkout("examples/cp341-pair").join(name), site.path(name)).expect("a file of the example");
    }
    for name in ["station-a.toml", "station-b.toml"] {
        let text = example_station("examples/cp341-pair", name, |text| {
            CPS.iter().fold(text, |text, (_, line)| on_a_simulated_line(&text, line))
        });
        site.write(name, &text);
    }
    let (a, b) = (site.run("station-a.toml"), site.run("station-b.toml"));
    let (a, b) = (a.until_run(), b.until_run());
    (site, a, b)
}

/// The ledgers of both stations' programs.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Books {
    /// 3964R: A sends numbered telegrams, B sends them back.
    a: Ledger,
    b: Ledger,
    /// RK 512: A gives SEND and FETCH alternately, B serves them.
    a_rk: Ledger,
    b_rk: Ledger,
}

impl Books {
    fn of(a: &Running, b: &Running) -> Self {
        const A: &[&str] =
            &["STARTED", "DONE", "ERROR", "ABORTED", "GOOD", "WRONG", "DOUBLED", "LATE", "LOST", "STATE"];
        const A_RK: &[&str] = &["STARTED", "DONE", "ERROR", "ABORTED", "GOOD", "WRONG", "STATE"];
        Self {
            a: Ledger::read(a, "DB20", A),
            b: Ledger::read(b, "DB20", &["RECEIVED", "STARTED", "DONE", "ERROR", "BUSY", "STATE", "LAST_STATUS"]),
            a_rk: Ledger::read(a, "DB21", A_RK),
            b_rk: Ledger::read(b, "DB21", &["SERVED", "ERROR", "LAST_STATUS"]),
        }
    }

    fn is_idle(&self) -> bool {
        self.a["STATE"] == 0 && self.b["STATE"] == 0 && self.a_rk["STATE"] == 0
    }
}

fn pause(a: &Running, on: bool) {
    a.set("DB20.PAUSE", i64::from(on));
    a.set("DB21.PAUSE", i64::from(on));
}

/// Waits until this many more telegrams and blocks have returned correctly.
fn flow(a: &Running, telegrams: i64, blocks: i64) {
    let good = || a.cells(&["DB20.GOOD", "DB21.GOOD"]);
    let begin = good();
    a.until("telegrams and blocks flow", |_| {
        let now = good();
        (now[0] >= begin[0] + telegrams && now[1] >= begin[1] + blocks).then_some(())
    });
}

/// Waits for the end of the last jobs and reads all ledgers.
fn rest(a: &Running, b: &Running) -> Books {
    pause(a, true);
    ledger::at_rest([a, b], || Books::of(a, b), Books::is_idle)
}

fn interrupt(site: &Site, stations: [Running; 2]) {
    for station in stations {
        let ended = station.interrupt();
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
    site.wait_until_empty();
}

#[test]
fn telegrams_and_blocks_go_both_ways_and_none_is_lost() {
    let (site, a, b) = pair();
    flow(&a, 130, 40);
    let books = rest(&a, &b);
    let Books { a: of_a, b: of_b, a_rk, b_rk } = &books;
    for column in ["ERROR", "ABORTED", "WRONG", "DOUBLED", "LATE", "LOST"] {
        assert_eq!(of_a[column], 0, "{column}: {books:?}");
    }
    assert_eq!((of_a["DONE"], of_a["GOOD"]), (of_a["STARTED"], of_a["STARTED"]), "{books:?}");
    assert_eq!(
        (of_b["RECEIVED"], of_b["STARTED"], of_b["DONE"]),
        (of_a["DONE"], of_a["DONE"], of_a["DONE"]),
        "{books:?}"
    );
    assert_eq!((of_b["ERROR"], of_b["BUSY"]), (0, 0), "{books:?}");
    // RK 512: a SEND and a FETCH for each block that returned correctly.
    assert_eq!((a_rk["DONE"], a_rk["STARTED"]), (2 * a_rk["GOOD"], 2 * a_rk["GOOD"]), "{books:?}");
    assert_eq!((a_rk["ERROR"], a_rk["ABORTED"], a_rk["WRONG"]), (0, 0, 0), "{books:?}");
    assert_eq!(b_rk["SERVED"], a_rk["DONE"], "{books:?}");
    // A busy host can pause a driver within a block. The receiver reports that; A's procedure repeats the block.
    assert!(b_rk["ERROR"] == 0 || b_rk["LAST_STATUS"] == CHARACTER_DELAY, "{books:?}");
    interrupt(&site, [a, b]);
}

/// Number of kills of the drivers of a station, in the order of [`CPS`].
type Kills = [i64; 2];

/// The rules after kills, with both stations idle.
fn assert_accounted(books: &Books, of_a: Kills, of_b: Kills, what: &str) {
    let Books { a, b, a_rk, b_rk } = books;
    let all = format!("{what}: {books:?}");
    assert_eq!((a["WRONG"], a_rk["WRONG"]), (0, 0), "{all}");
    for ledger in [a, a_rk] {
        assert_eq!(ledger["STARTED"], ledger["DONE"] + ledger["ERROR"] + ledger["ABORTED"], "{all}");
    }
    assert_eq!(b["STARTED"], b["DONE"] + b["ERROR"], "{all}");
    // DONE means that the partner's CP has the telegram. Its program also has it, unless that CP was killed before.
    assert!(a["DONE"] <= b["RECEIVED"] + of_b[0], "falsely DONE, {all}");
    assert!(b["DONE"] <= a.echoes() + of_a[0], "falsely DONE, {all}");
    assert!(a_rk["DONE"] <= b_rk["SERVED"] + of_b[1], "falsely DONE, {all}");
    // Nothing is received that was not sent; an aborted job may still have arrived.
    assert!(b["RECEIVED"] <= a["STARTED"] && a.echoes() <= b["STARTED"], "{all}");
    assert!(b_rk["SERVED"] <= a_rk["STARTED"], "{all}");
    assert!(a["DOUBLED"] <= of_a[0] + of_b[0], "{all}");
}

/// `kill -9` of each of the four drivers in turn while telegrams and blocks are transferred.
#[test]
fn a_driver_that_is_killed_leads_nobody_to_believe_what_is_not_so() {
    let (site, a, b) = pair();
    flow(&a, 5, 5);
    let (mut of_a, mut of_b): (Kills, Kills) = ([0; 2], [0; 2]);
    let mut random = SplitMix64::new(341);
    for (line, (cp, _)) in CPS.into_iter().enumerate() {
        for is_a in [true, false] {
            let what = format!("{cp} of station {}", if is_a { "A" } else { "B" });
            let victim = if is_a { &a } else { &b };
            let others = || CPS.map(|(other, _)| (other, victim.driver_of(other).1));
            let (starts, losses) = (others(), victim.driver_of(cp).2);
            let driver = victim.driver_process_of(cp);
            // At any point of a telegram or a block.
            victim.scans(random.below(40));
            driver.signal(Signal::KILL);
            driver.wait(&what);
            (if is_a { &mut of_a } else { &mut of_b })[line] += 1;

            // The scan has continued in RUN and in time; the driver has restarted, and that of the other CP was not
            // affected.
            victim.scans(ACROSS);
            let status = victim.status();
            assert_eq!((status.state.as_str(), status.watchdogs), ("RUN", 0), "{what}");
            assert_eq!(victim.entries(WATCHDOG), 0, "{what}: {:#?}", victim.diagnostics());
            assert!(victim.entries(DRIVER_LOST) > 0, "{what}: {:#?}", victim.diagnostics());
            victim.until("the driver is started again", |s| {
                let (pid, _, now) = s.driver_of(cp);
                (pid != 0 && now == losses + 1).then_some(())
            });
            for ((other, before), (_, now)) in starts.into_iter().zip(others()) {
                assert_eq!(now, before + u32::from(other == cp), "{what}: starts of {other}");
            }
            flow(&a, 5, 5);
            assert_accounted(&rest(&a, &b), of_a, of_b, &what);
            pause(&a, false);
            flow(&a, 3, 3);
        }
    }
    assert_eq!((a.status().watchdogs, b.status().watchdogs), (0, 0));
    interrupt(&site, [a, b]);
}
