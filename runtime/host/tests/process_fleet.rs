//! The fleet with processes that are not drivers: programs that end at once, and one that is missing. (Real drivers:
//! the tests crate.)

use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ob1_backplane::{CpuSide, Segment};
use ob1_cpu::Clock;
use ob1_host::driver::{DriverCommand, DriverPort, Fleet};
use ob1_host::supervisor::{Exit, Report, Times};
use ob1_time::{Instant, Span};

/// Counts its readings, a millisecond each: the fleet asks often enough for time to pass.
struct Ticking(Instant);

impl Clock for Ticking {
    fn now(&mut self) -> Instant {
        self.0 += Span::MILLISECOND;
        self.0
    }

    fn executed(&mut self, _statements: u64) {}
}

/// Jumps by a minute with each reading, and counts them: a machine that stands still again and again.
struct Jumping(Arc<AtomicU64>);

impl Clock for Jumping {
    fn now(&mut self) -> Instant {
        Instant::from_secs(60 * self.0.fetch_add(1, Ordering::Relaxed))
    }

    fn executed(&mut self, _statements: u64) {}
}

fn fleet_of(program: &str) -> (Fleet, DriverPort) {
    fleet_over(program, Segment::create_shared().expect("memory"), Times::default())
}

fn fleet_over(program: &str, segment: Segment, times: Times) -> (Fleet, DriverPort) {
    let cpu = CpuSide::create(&segment, 16).expect("16 bytes");
    let command = DriverCommand {
        name: "cp".into(),
        program: PathBuf::from(program),
        args: Vec::new(),
        env: Vec::new(),
        descriptors: Vec::new(),
    };
    let mut fleet = Fleet::new();
    let port = fleet.add(command, segment, cpu.monitor().clone(), times).expect("descriptors");
    (fleet, port)
}

fn next_report(port: &mut DriverPort) -> Report {
    loop {
        if let Ok(report) = port.reports.pop() {
            return report;
        }
        std::thread::yield_now();
    }
}

#[test]
fn a_process_that_ends_at_once_is_reported_with_its_status() {
    let (fleet, mut port) = fleet_of("/bin/false");
    let running = fleet.start(Ticking(Instant::START)).expect("a thread");
    assert_eq!(next_report(&mut port), Report::Lost(Exit::Code(1)));
    running.stop();
    assert_eq!((port.status.pid(), port.status.starts(), port.status.losses()), (0, 0, 1));
}

#[test]
fn a_missing_program_is_reported_with_the_systems_error() {
    let (fleet, mut port) = fleet_of("/nonexistent/ob1-cp");
    let running = fleet.start(Ticking(Instant::START)).expect("a thread");
    assert_eq!(next_report(&mut port), Report::Lost(Exit::NotStarted(2)));
    running.stop();
    assert!(port.reports.pop().is_err(), "reported once");
    // The bell is hung up, and ringing it still does no harm.
    port.doorbell.ring();
}

/// A driver without a sign of life is killed, but a few minutes without a look at it do not make it one.
#[test]
#[expect(clippy::disallowed_methods, reason = "a program that gives no sign of life")]
fn a_machine_that_stands_still_uses_up_nothing_of_the_patience() {
    let folder = tempfile::tempdir().expect("a folder");
    let silent = folder.path().join("silent");
    std::fs::write(&silent, "#!/bin/sh\nexec sleep 1000\n").expect("writable");
    std::fs::set_permissions(&silent, std::fs::Permissions::from_mode(0o700)).expect("ours");
    let readings = Arc::<AtomicU64>::default();
    let (fleet, mut port) = fleet_of(silent.to_str().expect("UTF-8"));
    let running = fleet.start(Jumping(Arc::clone(&readings))).expect("a thread");
    assert_eq!(next_report(&mut port), Report::Lost(Exit::Hung));
    assert!(readings.load(Ordering::Relaxed) >= 40, "killed after {readings:?} looks");
    running.stop();
}

#[test]
fn whatever_was_written_into_the_header_each_driver_finds_it_whole() {
    let segment = Segment::create_shared().expect("memory");
    let wait = Span::from_millis(2);
    let times = Times { first_wait: wait, longest_wait: wait, ..Times::default() };
    let (fleet, mut port) = fleet_over("/bin/false", segment.clone(), times);
    let version = ob1_backplane::layout::FIELDS.iter().find(|f| f.name == "header.version").expect("there").offset;
    let running = fleet.start(Ticking(Instant::START)).expect("a thread");
    next_report(&mut port);
    for _ in 0..3 {
        let before = port.status.attempts();
        segment.poke(version, 0xDEAD);
        while port.status.attempts() < before + 2 {
            std::thread::yield_now();
        }
        assert_eq!(segment.peek(version), Some(ob1_backplane::layout::LAYOUT_VERSION));
    }
    running.stop();
    assert_eq!(port.status.incidents(), 1, "it never was healthy");
}
