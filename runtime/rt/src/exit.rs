//! A library that ends the whole process by `exit()`, `quick_exit()`, `_exit()` or `_Exit()`: caught at the last
//! moment, and reported by an exit code of its own. A system call past the C library is not caught.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, Once};

/// Gets the name of the function that was called, and says with which code the process ends.
type Action = Box<dyn Fn(&str) -> u8 + Send + Sync>;

unsafe extern "C" {
    /// As in C11; the libc crate does not have it.
    fn at_quick_exit(handler: extern "C" fn()) -> libc::c_int;
}

static FOREIGN: AtomicBool = AtomicBool::new(false);
/// The process that is guarded. Its forks end by `_exit()` as they like.
static GUARDED: AtomicU32 = AtomicU32::new(0);
static ACTION: Mutex<Option<Action>> = Mutex::new(None);
static REGISTERED: Once = Once::new();

/// While it lives, an end of the process by `exit()` counts as a fault. Dropping it makes `exit()` an ordinary end
/// again.
#[derive(Debug)]
#[must_use]
pub struct ExitGuard(());

impl ExitGuard {
    /// From here on `exit()` runs `action` on the calling thread, and ends the process with the code that returns. Of
    /// several actions the newest one counts.
    pub fn raise(action: impl Fn(&str) -> u8 + Send + Sync + 'static) -> Self {
        REGISTERED.call_once(|| {
            // SAFETY: the handler is a function of this program, which is never unloaded. Without room for it (there
            // is always room for 32) an `exit()` is only not reported.
            let _registered = unsafe { (libc::atexit(at_exit), at_quick_exit(at_exit)) };
        });
        if let Ok(mut place) = ACTION.lock() {
            *place = Some(Box::new(action));
        }
        GUARDED.store(std::process::id(), Ordering::Release);
        FOREIGN.store(true, Ordering::Release);
        Self(())
    }
}

impl Drop for ExitGuard {
    fn drop(&mut self) {
        lower_exit_guard();
    }
}

/// From here on `exit()` is an ordinary end.
pub fn lower_exit_guard() {
    FOREIGN.store(false, Ordering::Release);
}

extern "C" fn at_exit() {
    if let Some(code) = foreign_end("exit()") {
        end_now(code);
    }
}

/// The code of an end that is a fault.
fn foreign_end(way: &str) -> Option<i32> {
    if !FOREIGN.load(Ordering::Acquire) || std::process::id() != GUARDED.load(Ordering::Acquire) {
        return None;
    }
    if !FOREIGN.swap(false, Ordering::AcqRel) {
        return None;
    }
    let place = ACTION.try_lock().ok()?;
    // A panic here would end the process by SIGABRT: that is reported, too.
    place.as_ref().map(|action| i32::from(action(way)))
}

/// Ends the process at once, with no handler of anybody, and not as a fault.
pub fn end_now(code: i32) -> ! {
    loop {
        // SAFETY: ends the process.
        unsafe { libc::syscall(libc::SYS_exit_group, libc::c_long::from(code)) };
    }
}

/// From here on `signal` ends the process at once with this code, if it finds `armed` set.
///
/// # Errors
/// The system does not take a handler for this signal.
pub fn end_at_signal(signal: i32, code: i32, armed: Arc<AtomicBool>) -> io::Result<()> {
    let end = move || {
        if armed.load(Ordering::SeqCst) {
            end_now(code);
        }
    };
    // SAFETY: reads an atomic and makes one system call, as a handler of a signal may.
    unsafe { signal_hook::low_level::register(signal, end) }.map(drop)
}

/// Set by Ctrl-C or SIGTERM; a second one ends the process at once.
///
/// # Errors
/// The system does not take a handler.
pub fn ended_by_signal() -> io::Result<Arc<AtomicBool>> {
    let ended = Arc::new(AtomicBool::new(false));
    for signal in [libc::SIGINT, libc::SIGTERM] {
        // In this order: the first signal finds it unarmed.
        end_at_signal(signal, 128 + libc::SIGINT, Arc::clone(&ended))?;
        signal_hook::flag::register(signal, Arc::clone(&ended))?;
    }
    Ok(ended)
}

/// In place of the C library's: a plugin finds the symbols of the program first. The C library itself ends a process
/// that has called `exit()` by an internal name, not by this one. What is linked into the program finds it as well:
/// there [`end_now`] is meant.
#[unsafe(export_name = "_exit")]
extern "C" fn end_at_once(code: libc::c_int) -> ! {
    end_now(foreign_end("_exit()").unwrap_or(code))
}

/// The same by its name in C99.
#[unsafe(export_name = "_Exit")]
extern "C" fn end_at_once_c99(code: libc::c_int) -> ! {
    end_now(foreign_end("_Exit()").unwrap_or(code))
}
