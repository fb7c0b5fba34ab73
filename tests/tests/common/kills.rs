//! Kills drivers while telegrams are transferred, and checks the consequences.

use ob1_line::sim::SplitMix64;
use rustix::process::Signal;

use super::ledger::{self, Ledger};
use super::processes::Watched;
use super::site::Site;
use super::station::Running;

/// Scans that must run after each kill, at 1 ms.
const ACROSS: u64 = 1000;
/// Event of an expired cycle watchdog.
const WATCHDOG: &str = "3501h";
/// Event of a driver that has started.
const DRIVER_UP: &str = "F202h";
/// Event of a driver that ended.
pub(crate) const DRIVER_LOST: &str = "F201h";

/// Starts both stations in RUN with telegrams being transferred.
pub(crate) fn start(site: &Site) -> (Running, Running) {
    let (a, b) = (site.run("station-a.toml"), site.run("station-b.toml"));
    let stations = (a.until_run(), b.until_run());
    ledger::flow(&stations.0, 5);
    stations
}

/// Checks that the scan has continued in RUN and in time, and that the driver has restarted.
pub(crate) fn assert_survived(station: &Running, lost_before: u32, what: &str) {
    station.scans(ACROSS);
    let status = station.status();
    assert_eq!((status.state.as_str(), status.watchdogs), ("RUN", 0), "{what}");
    assert_eq!(station.entries(WATCHDOG), 0, "{what}: {:#?}", station.diagnostics());
    assert!(station.entries(DRIVER_LOST) > 0, "{what}: {:#?}", station.diagnostics());
    station.until("the driver is started again", |s| {
        let (pid, _, losses) = s.driver();
        (pid != 0 && losses > lost_before).then_some(())
    });
}

/// The rules after kills, with both stations idle. Only telegrams in a killed CP may be lost.
pub(crate) fn assert_accounted(a: &Ledger, b: &Ledger, kills_of_a: i64, kills_of_b: i64, what: &str) {
    let all = format!("{what}\n{a:?}\n{b:?}");
    for (ledger, column) in [(a, "PAFE_SEND"), (a, "PAFE_RECEIVE"), (b, "PAFE_SEND"), (b, "PAFE_RECEIVE")] {
        assert_eq!(ledger[column], 0, "{column}: {all}");
    }
    assert_eq!((a["WRONG"], b["TOO_LONG"]), (0, 0), "wrong: {all}");
    for ledger in [a, b] {
        assert_eq!(ledger["STARTED"], ledger["DONE"] + ledger["ERROR"] + ledger["ABORTED"], "{all}");
    }
    // Done means: the partner's CP has the telegram. Its program also has it, unless that CP was killed before.
    assert!(a["DONE"] <= b["RECEIVED"] + kills_of_b, "done without an acknowledgement: {all}");
    assert!(b["DONE"] <= a.echoes() + a["WRONG"] + kills_of_a, "done without an acknowledgement: {all}");
    // Nothing is received that was not sent; an aborted order may still have arrived.
    assert!(b["RECEIVED"] <= a["STARTED"] && a.echoes() <= b["STARTED"], "{all}");
    assert!(a["DOUBLED"] <= kills_of_a + kills_of_b, "{all}");
}

/// The kind of attack on a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Blow {
    /// `kill -9`.
    Kill,
    /// Stopped: the supervisor finds that it hangs, and kills it.
    Stop,
    /// A terminating signal.
    Signal(Signal),
}

impl Blow {
    fn strike(self, driver: &Watched) {
        driver.signal(match self {
            Blow::Kill => Signal::KILL,
            Blow::Stop => Signal::STOP,
            Blow::Signal(signal) => signal,
        });
    }
}

/// The result of a series of kills.
#[derive(Debug, Default)]
pub(crate) struct Losses {
    /// Echoes received by A's program.
    pub(crate) echoes: i64,
    /// Orders that ended with an error or were aborted, both sides.
    pub(crate) failed: i64,
    /// Telegrams received twice because the acknowledgement of the first was lost with a driver.
    pub(crate) doubled: i64,
    /// Milliseconds from the entry "driver process ended" to the next "driver process is up", after a longer time
    /// without failure.
    pub(crate) up_again: Vec<f64>,
}

/// Attacks the drivers of A and B in turn, at times and in ways given by the seed.
pub(crate) fn kill_drivers(seed: u64, kills: u32, blows: &[Blow]) -> Losses {
    let site = Site::two_stations_on_a_cable();
    let (a, b) = start(&site);
    let mut random = SplitMix64::new(seed);
    let (mut kills_of_a, mut kills_of_b) = (0, 0);
    let mut losses = Losses::default();
    for kill in 0..kills {
        let of_a = kill % 2 == 0;
        let blow = blows[random.below(blows.len() as u64) as usize];
        let what = format!("seed {seed}, kill {kill} ({}, {blow:?})", if of_a { "A" } else { "B" });
        let victim = if of_a { &a } else { &b };
        // At any point of a telegram or its echo: after some telegrams and then some scans.
        ledger::flow(&a, random.below(12) as i64 + 1);
        let driver = victim.driver_process();
        let (_, _, lost_before) = victim.driver();
        victim.scans(random.below(40));
        blow.strike(&driver);
        driver.wait(&what);
        *(if of_a { &mut kills_of_a } else { &mut kills_of_b }) += 1;

        assert_survived(victim, lost_before, &what);
        ledger::flow(&a, 5);
        let (of_a, of_b) = ledger::rest(&a, &b);
        assert_accounted(&of_a, &of_b, kills_of_a, kills_of_b, &what);
        // FC 9 of the manual's program has synchronised with each new CP.
        assert_eq!(
            (of_a["SYNCS"], of_b["SYNCS"]),
            (1 + kills_of_a, 1 + kills_of_b),
            "{what}\n{:#?}\n{:#?}",
            a.diagnostics(),
            b.diagnostics()
        );
        losses.echoes = of_a.echoes();
        losses.failed = ["ERROR", "ABORTED"].iter().map(|column| of_a[column] + of_b[column]).sum();
        losses.doubled = of_a["DOUBLED"];
        losses.up_again.extend(up_again(victim));
        ledger::pause(&a, false);
    }
    for station in [&a, &b] {
        assert_eq!(station.status().watchdogs, 0);
    }
    for ended in [a.interrupt(), b.interrupt()] {
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
    site.wait_until_empty();
    losses
}

/// For the last loss: time until the driver had restarted, in milliseconds.
fn up_again(station: &Running) -> Option<f64> {
    let entries = station.diagnostics();
    let lost = entries.iter().position(|entry| entry.event == DRIVER_LOST)?;
    let up = entries[..lost].iter().rev().find(|entry| entry.event == DRIVER_UP)?;
    Some((up.time_ns - entries[lost].time_ns) as f64 / 1e6)
}
