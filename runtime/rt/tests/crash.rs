//! A crash is handled, whatever thread and whatever signal: shown in a child process, which is this test binary again,
//! told by a variable how to crash.
#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "what kills a process is tried in another one"
)]
#![expect(unsafe_code, reason = "it crashes")]

use std::hint::black_box;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};

use ob1_rt::{LastWords, block_signals, fence_scan, spawn, take_handler_stack};

const TRY: &str = "OB1_CRASH_TRY";
const CODE: u8 = 77;
static OFF: AtomicBool = AtomicBool::new(false);

fn child(how: &str) -> Output {
    let mut command = Command::new(std::env::current_exe().expect("this binary has a path"));
    command.args(["--exact", "every_crash_has_its_last_words", "--nocapture"]).env(TRY, how);
    command.output().expect("the child starts")
}

#[inline(never)]
fn recurse(depth: u64) -> u64 {
    let room = black_box([depth; 64]);
    if room[0] == u64::MAX { 0 } else { recurse(depth + 1) + black_box(room)[1] }
}

fn crash(how: &str) -> u64 {
    // SAFETY: none. That is what is tried, in a process of its own.
    unsafe {
        match how {
            "null" => std::ptr::null_mut::<u64>().wrapping_add(2).write_volatile(1),
            "illegal" => {
                #[cfg(target_arch = "x86_64")]
                std::arch::asm!("ud2");
                #[cfg(not(target_arch = "x86_64"))]
                libc::raise(libc::SIGILL);
            }
            "trap" => {
                #[cfg(target_arch = "x86_64")]
                std::arch::asm!("int3");
                #[cfg(target_arch = "aarch64")]
                std::arch::asm!("brk #1000");
                #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
                libc::raise(libc::SIGTRAP);
            }
            "call" => _ = libc::raise(libc::SIGSYS),
            "abort" => std::process::abort(),
            "float" => _ = libc::raise(libc::SIGFPE),
            "bus" => _ = libc::raise(libc::SIGBUS),
            _ => return recurse(0),
        }
    }
    0
}

fn crashing(how: &str) -> ! {
    let words = LastWords {
        outputs_off: Box::new(|| OFF.store(true, Ordering::Relaxed)),
        place: Box::new(|text| write!(text, "FC 7, outputs {}", OFF.load(Ordering::Relaxed))),
        exit_code: CODE,
    };
    words.keep().expect("signals that may be caught");
    let (thread, how) = how.split_once(' ').expect("a thread and a way");
    let (fenced, how) = (thread == "fenced", how.to_owned());
    if thread == "main" {
        crash(&how);
    }
    let scan = spawn("ob1-scan", move || {
        block_signals();
        take_handler_stack().expect("a stack");
        if fenced {
            fence_scan().expect("the kernel has seccomp");
        }
        crash(&how)
    });
    let _ = scan.expect("a thread").join();
    std::process::exit(0)
}

#[test]
fn every_crash_has_its_last_words() {
    if let Ok(how) = std::env::var(TRY) {
        crashing(&how);
    }
    for (how, text) in [
        ("scan null", "segmentation fault at 0x"),
        ("scan null", ", a wrong address, 0x10, in FC 7, outputs true; outputs are off, the station ends"),
        ("scan overflow", "the stack has overflowed"),
        ("scan illegal", "ob1: illegal instruction at 0x"),
        ("scan trap", "ob1: trap at 0x"),
        ("scan call", "ob1: forbidden system call at 0x"),
        ("scan abort", "ob1: abort at 0x"),
        ("scan float", "ob1: arithmetic fault at 0x"),
        ("scan bus", "ob1: bus error at 0x"),
        ("fenced null", "segmentation fault at 0x"),
        ("main null", "segmentation fault at 0x"),
    ] {
        let output = child(how);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(i32::from(CODE)), "{how}: {} {said}", output.status);
        assert!(said.contains(text), "{how}: {said}");
    }
}
