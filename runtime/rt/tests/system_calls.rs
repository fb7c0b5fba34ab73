//! The fence kills: shown in a child process, which is this test binary again, told by a variable what to try.
#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "what kills a process is tried in another one"
)]

use std::io::Write as _;
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Command, ExitStatus, exit};
use std::sync::atomic::{AtomicBool, Ordering};

use ob1_rt::{MonotonicClock, ThreadLook, block_signals, fence_scan, prefault_stack, spawn, warm_heap};
use ob1_time::{Instant, Span};

const TRY: &str = "OB1_FENCE_TRY";
/// As far away as the kernel takes it.
const FOREVER: Instant = Instant::from_nanos(u64::MAX / 2);
static DONE: AtomicBool = AtomicBool::new(false);

/// Runs the test `name` of this binary as a child with the fence up.
fn child(name: &str, what: &str) -> ExitStatus {
    let mut command = Command::new(std::env::current_exe().expect("this binary has a path"));
    command.args(["--exact", name, "--nocapture"]).env(TRY, what).output().expect("the child starts").status
}

/// In the child: a fenced thread does what a scan does, and perhaps one thing more.
fn fenced(forbidden: bool) -> ! {
    let clock = MonotonicClock::start();
    let (_ear, mut bell) = std::io::pipe().expect("a pipe");
    let scan = spawn("ob1-scan", move || {
        prefault_stack();
        warm_heap();
        block_signals();
        let look = ThreadLook::open();
        fence_scan().expect("the kernel has seccomp");
        for _ in 0..3 {
            clock.sleep_until(clock.time() + Span::MILLISECOND);
            bell.write_all(&[1]).expect("the doorbell is allowed");
            look.times().expect("the look is allowed");
        }
        if forbidden {
            let _ = std::fs::File::open("/dev/null");
        }
        DONE.store(true, Ordering::Release);
        loop {
            clock.sleep_until(FOREVER);
        }
    });
    let _scan = scan.expect("a thread");
    while !DONE.load(Ordering::Acquire) {
        std::thread::yield_now();
    }
    exit(0)
}

#[test]
fn what_a_scan_needs_is_allowed() {
    if std::env::var_os(TRY).is_some() {
        fenced(false);
    }
    let status = child("what_a_scan_needs_is_allowed", "scan");
    assert_eq!(status.code(), Some(0), "{status}");
}

#[test]
fn anything_else_kills_the_process() {
    if std::env::var_os(TRY).is_some() {
        fenced(true);
    }
    let status = child("anything_else_kills_the_process", "open");
    assert_eq!(status.signal(), Some(libc::SIGSYS), "{status}");
}
