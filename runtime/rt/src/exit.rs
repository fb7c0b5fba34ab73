//! A library that ends the whole process by `exit()` or `quick_exit()`: caught at the last moment, and reported by an
//! exit code of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, Once};

type Action = Box<dyn Fn() -> u8 + Send + Sync>;

unsafe extern "C" {
    /// As in C11; the libc crate does not have it.
    fn at_quick_exit(handler: extern "C" fn()) -> libc::c_int;
}

static FOREIGN: AtomicBool = AtomicBool::new(false);
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
    pub fn raise(action: impl Fn() -> u8 + Send + Sync + 'static) -> Self {
        REGISTERED.call_once(|| {
            // SAFETY: the handler is a function of this program, which is never unloaded. Without room for it (there
            // is always room for 32) an `exit()` is only not reported.
            let _registered = unsafe { (libc::atexit(at_exit), at_quick_exit(at_exit)) };
        });
        if let Ok(mut place) = ACTION.lock() {
            *place = Some(Box::new(action));
        }
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
    if FOREIGN.swap(false, Ordering::AcqRel)
        && let Ok(place) = ACTION.try_lock()
        && let Some(action) = &*place
    {
        // A panic here would end the process by SIGABRT: that is reported, too.
        let code = action();
        // SAFETY: `_exit` is the end that `exit` would come to anyway, without the rest of the handlers.
        unsafe { libc::_exit(i32::from(code)) }
    }
}
