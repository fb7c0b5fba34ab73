//! The accounts are correct: a delay caused by a test is found in them, with its class and at least its size. And only
//! the scan has the priority.
//!
//! Sizes are only checked against lower limits: a busy machine increases all times and causes further delays. If it
//! interrupts our delay, the class is correctly another one, and the test tries again.

use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ob1_rt::Outcome;
use ob1_station::access::protocol::Op;
use ob1_time::Span;
use ob1_timing::snapshot::LateEntry;
use ob1_timing::{Class, Recorder, Timing};
use rustix::process::Signal;

use crate::common::native;
use crate::common::site::{Site, replaced};
use crate::common::station::Running;

const MS: u64 = 1_000_000;
/// Iterations of the slow block, three statements each: longer than the 10 ms of a cycle and much shorter than the
/// watchdog on all machines.
const TURNS: u64 = 200 * 60_000;

/// OB 1 calls the slow block of statements if M 200.0 is set, and the slow block of a plugin if M 200.1 is set, once
/// each. With M 200.2 it never ends.
fn station(site: &Site) -> Running {
    station_with(site, "20s", "")
}

/// The same with this watchdog and additional tables.
fn station_with(site: &Site, watchdog: &str, tables: &str) -> Running {
    let plugin = native::build(site, "tests/native/timing_blocks.c", "timing_blocks.so", &[]);
    let toml = format!(
        "[station]\nname = \"timed\"\n\n[cpu]\nmin_cycle = \"10ms\"\nwatchdog = \"{watchdog}\"\nmissed = \"skip\"\nengine = \"reference\"\n\n\
         [timing]\nlate = \"5ms\"\nlong = \"3ms\"\nrecorder = 20\n\n[program]\nsources = [\"timed.awl\"]\n\n\
         [[plugin]]\npath = \"{}\"\n{tables}",
        plugin.display()
    );
    let awl = "FUNCTION FC 7 : VOID\nBEGIN\nNETWORK\nL 200;\nmore: T MW 210;\nL W#16#EA60;\nturn: T MW 212;\nL MW 212;\n\
               LOOP turn;\nL MW 210;\nLOOP more;\nEND_FUNCTION\n\
               ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nU M 200.0;\nR M 200.0;\nSPBN next;\nCALL FC 7;\n\
               next: U M 200.1;\nR M 200.1;\nSPBN end;\nCALL FC 233;\nend: U M 200.2;\nSPB end;\nEND_ORGANIZATION_BLOCK\n";
    site.write("timed.toml", &toml);
    site.write("timed.awl", awl);
    site.run("timed.toml").until_run()
}

fn timing(station: &Running) -> Timing {
    *station.ask(Op::Timing { histograms: true }).expect("never refused").timing.expect("an answer to timing")
}

fn recorder(station: &Running) -> Recorder {
    *station.ask(Op::Recorder).expect("never refused").recorder.expect("an answer to recorder")
}

/// Causes delays until one is in the ledger with this class.
fn found(station: &Running, class: Class, make: impl Fn()) -> LateEntry {
    station.until("the delay is explained", |station| {
        make();
        let late = timing(station).late;
        // The worst entries are kept, so that our delay is not lost among those of a busy machine.
        late.worst.iter().chain(&late.newest).find(|entry| entry.class == class).cloned()
    })
}

#[test]
fn a_delay_in_a_block_is_the_programs() {
    let site = Site::new();
    let station = station(&site);
    let entry = found(&station, Class::Program, || station.set("M200.0", 1));
    assert!(entry.what.contains("OB 1") && entry.what.contains("FC 7"), "{entry:?}");
    // No statement takes less than a nanosecond.
    assert!(entry.size_ns >= TURNS * 3 && entry.execution_ns >= entry.size_ns, "{entry:?}");
    // Time attributed to the program was not spent waiting.
    let waited = entry.evidence.measured.map_or(Span::ZERO, |measured| measured.waited_at_least());
    assert!(waited < Span::from_nanos(entry.size_ns) / 2, "{entry:?}");
    // The flight record of the worst overrun was kept.
    let flight = station.until("a frozen flight", |station| recorder(station).worst).scans;
    let last = flight.last().expect("a scan");
    assert!(last.flags.contains(&"overran".to_owned()) && flight.len() <= 20, "{last:?}");
    assert!(flight.windows(2).all(|pair| pair[0].scan + 1 == pair[1].scan), "no scan is left out");
    let of_ob1 = timing(&station).obs.into_iter().find(|ob| ob.ob == 1).expect("OB 1");
    assert!(of_ob1.execution.max_ns >= entry.size_ns, "{of_ob1:?}");
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_delay_in_a_plugin_is_the_plugins() {
    let site = Site::new();
    let station = station(&site);
    let entry = found(&station, Class::Plugin, || station.set("M200.1", 1));
    assert!(entry.what.starts_with("FC 233"), "{entry:?}");
    assert!(entry.size_ns >= 10 * MS, "fifty million turns: {entry:?}");
    let blocks = timing(&station).blocks;
    assert_eq!(blocks.len(), 1);
    assert!(blocks[0].execution.count > 0 && blocks[0].execution.max_ns >= 10 * MS, "{blocks:?}");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Threads that compute on one core, until they are dropped.
struct Hogs {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Hogs {
    fn on(core: usize, count: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let hog = |_| {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                assert_eq!(ob1_rt::pin_to(&[core]).outcome, Outcome::Granted);
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            })
        };
        Self { threads: (0..count).map(hog).collect(), stop }
    }
}

impl Drop for Hogs {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

#[test]
fn a_scan_that_waits_for_its_core_is_told_so_with_what_was_measured() {
    let site = Site::new();
    let station = station_with(&site, "20s", "\n[cpu.realtime]\naffinity = [0]\n");
    let hogs = Hogs::on(0, 3);
    let entry = station.until("a scan that waited", |station| {
        // A long-running program is more likely to be interrupted than one that mostly sleeps.
        station.set("M200.0", 1);
        let late = timing(station).late;
        late.worst.iter().chain(&late.newest).find(|entry| entry.what.ends_with("for a core")).cloned()
    });
    drop(hogs);
    let measured = entry.evidence.measured.expect("a kernel with schedstat");
    assert_eq!(entry.class, Class::Kernel, "{entry:?}");
    let (delay, execution) = (Span::from_nanos(entry.size_ns), Span::from_nanos(entry.execution_ns));
    assert!(measured.waited >= delay / 2 && measured.window >= execution, "{entry:?}");
    assert!(measured.waited_at_least() >= delay / 2, "not the waiting of other scans: {entry:?}");
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn the_watchdog_says_what_stood_in_the_way() {
    // On a busy machine the loop may have had the core only for a short time, and then that is rightly what is told.
    let named = (0..5).any(|_| what_the_watchdog_says().contains("program: OB 1"));
    assert!(named, "five endless programs, and none was named");
}

/// What stood in the way of an endless program that the watchdog has ended.
fn what_the_watchdog_says() -> String {
    let site = Site::new();
    let station = station_with(&site, "100ms", "");
    station.set("M200.2", 1);
    let exceeded = station.until("the cycle that was too long is explained", |station| {
        station.diagnostics().into_iter().find(|entry| entry.event == "3501h" && !entry.because.is_empty())
    });
    assert!(exceeded.told().ends_with(&exceeded.because), "{exceeded:?}");
    let late = timing(&station).late;
    let ended = late.worst.iter().any(|entry| entry.execution_ns >= 100 * MS);
    assert!(ended, "the scan that was ended is in the ledger: {late:?}");
    let ended = station.interrupt();
    let told = ended.err.lines().filter(|line| line.contains("the cycle that led to STOP: of "));
    assert_eq!(told.count(), 1, "told once: {}", ended.err);
    exceeded.because
}

/// Whether all threads of the process are stopped.
fn is_stopped(pid: u32) -> bool {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).expect("a living process");
    tasks.flatten().all(|task| fields(&task.path().join("stat"))[0] == "T")
}

/// The fields of a `stat` after the name, beginning with the state.
fn fields(stat: &std::path::Path) -> Vec<String> {
    let text = fs::read_to_string(stat).expect("a living process");
    let (_, rest) = text.rsplit_once(") ").expect("a name in brackets");
    rest.split_whitespace().map(str::to_owned).collect()
}

#[test]
fn a_process_that_was_stopped_is_told_by_its_signal() {
    let site = Site::new();
    let station = station(&site);
    let before = timing(&station);
    let stopped = || {
        station.process.signal(Signal::STOP);
        while !is_stopped(station.process.pid) {
            std::thread::yield_now();
        }
        let began = Instant::now();
        while began.elapsed() < Duration::from_millis(300) {
            assert!(!station.process.ends_within(Duration::from_millis(50)));
        }
        let lasted = began.elapsed();
        station.process.signal(Signal::CONT);
        lasted
    };
    let lasted = std::cell::Cell::new(stopped());
    let entry = found(&station, Class::Stopped, || {
        let scans = timing(&station).scans;
        station.until("it is explained", |s| (timing(s).scans > scans + 50).then_some(()));
        if timing(&station).late.classes.contains_key(&Class::Stopped) {
            return;
        }
        lasted.set(lasted.get().min(stopped()));
    });
    // It woke late or ran longer by the stop time; the deadline may have been up to a cycle after the stop.
    assert!(u128::from(entry.size_ns) + 10 * 1_000_000 >= lasted.get().as_nanos(), "{entry:?}");
    // Figures read during a scan may be from two scans; not in STOP.
    site.ob1(&["ctl", "timed.toml", "stop"]).fine();
    let after = timing(&station);
    assert!(after.missed >= before.missed + 25, "300 ms are thirty cycles");
    assert_eq!(after.deadlines.count, after.scans + after.missed, "none is left out");
    assert!(after.deadlines.p50_ns <= after.deadlines.p99_ns && after.deadlines.max_ns >= 250 * MS);
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn the_priority_is_the_scans_alone_and_a_driver_does_not_inherit_it() {
    let site = Site::two_stations();
    let toml = fs::read_to_string(site.path("station-a.toml")).expect("the station file");
    let realtime = "\n[cpu.realtime]\npriority = 7\nlock_memory = true\n\n[program]";
    site.write("station-a.toml", &replaced(&toml, "\n[program]", realtime));
    let station = site.run("station-a.toml").until_run();
    let driver = station.driver_process();
    let status = station.status();
    let asked = status.posture.iter().find(|grant| grant.what.contains("SCHED_FIFO")).expect("it was asked for");
    let granted = asked.outcome == "granted";
    assert_eq!(granted, asked.remedy.is_none(), "{asked:?}");
    let mut scans = 0;
    for pid in [station.process.pid, driver.pid] {
        for task in fs::read_dir(format!("/proc/{pid}/task")).expect("a living process").flatten() {
            let name = fs::read_to_string(task.path().join("comm")).expect("a living thread");
            let fields = fields(&task.path().join("stat"));
            // Real-time priority and policy: fields 40 and 41 of all.
            let (priority, policy) = (fields[37].as_str(), fields[38].as_str());
            let scan = name.trim() == "ob1-scan";
            scans += u32::from(scan);
            let expected = if scan && granted { ("7", "1") } else { ("0", "0") };
            assert_eq!((priority, policy), expected, "{name}");
        }
    }
    assert_eq!(scans, 1);
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_scan_that_would_starve_its_core_is_refused_with_a_number() {
    let site = Site::new();
    let toml = "[station]\nname = \"starving\"\n\n[cpu]\nmin_cycle = \"0ms\"\n\n[cpu.realtime]\npriority = 50\n";
    site.write("starving.toml", toml);
    for command in ["run", "check"] {
        let said = site.ob1(&[command, "starving.toml"]);
        assert_ne!(said.code, Some(0), "{said:?}");
        assert!(said.err.contains("C014") && said.err.contains("isolcpus"), "{said:?}");
    }
    // The privileges granted by the system, as text and as JSON; for each refused one there is a remedy.
    site.write("asking.toml", &toml.replace("0ms", "10ms").replace("starving", "asking"));
    let said = site.ob1(&["check", "asking.toml", "--posture", "--json"]);
    let grants: Vec<serde_json::Value> = serde_json::from_str(&said.out).expect("JSON");
    let refused = grants.iter().filter(|grant| grant["outcome"] == "refused");
    assert!(refused.clone().all(|grant| grant["remedy"].is_string()), "{said:?}");
    assert_eq!(said.code == Some(0), refused.count() == 0, "{said:?}");
    assert!(grants.iter().any(|grant| grant["what"] == "clock source"), "{said:?}");
}
