//! Threads of the runtime: small stacks, names, and for the scan thread a stack and a heap that are already there.

use std::hint::black_box;
use std::io;
use std::mem::MaybeUninit;
use std::thread::{Builder, JoinHandle};

/// Stack of every thread of the runtime, in bytes.
pub const THREAD_STACK_BYTES: usize = 256 * 1024;

/// Stack that a main thread has in every usual setting, and half of what a test's thread has.
const MAIN_STACK_BYTES: usize = 1024 * 1024;

/// How much of the stack [`prefault_stack`] touches below its caller, in bytes.
pub const PREFAULT_BYTES: usize = 160 * 1024;

/// Page size assumed for touching; larger pages are only touched more than once.
const PAGE: usize = 4096;

/// Starts a thread with a name and a stack of [`THREAD_STACK_BYTES`].
///
/// # Errors
/// What the system says when it has no room for another thread.
pub fn spawn<T: Send + 'static>(name: &str, body: impl FnOnce() -> T + Send + 'static) -> io::Result<JoinHandle<T>> {
    spawn_with_stack(name, THREAD_STACK_BYTES, body)
}

/// The same with a stack of at least `bytes`: the scan thread's, as the CPU says (`Cpu::stack_bytes`). Only
/// what is used of it takes memory.
///
/// # Errors
/// What the system says when it has no room for another thread.
pub fn spawn_with_stack<T: Send + 'static>(
    name: &str,
    bytes: usize,
    body: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    Builder::new().name(name.to_owned()).stack_size(bytes.max(THREAD_STACK_BYTES)).spawn(body)
}

/// Runs `body` on a stack of at least `bytes`: here, or on a thread of its own when that is more than a main thread
/// surely has.
///
/// # Errors
/// What the system says when it has no room for another thread.
pub fn with_stack<T: Send>(bytes: usize, body: impl FnOnce() -> T + Send) -> io::Result<T> {
    if bytes <= MAIN_STACK_BYTES {
        return Ok(body());
    }
    std::thread::scope(|scope| {
        let thread = Builder::new().name("ob1-cpu".to_owned()).stack_size(bytes).spawn_scoped(scope, body)?;
        thread.join().or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Touches [`PREFAULT_BYTES`] of stack, so that no scan pays for its first use.
#[inline(never)]
pub fn prefault_stack() {
    let mut room = [const { MaybeUninit::<u8>::uninit() }; PREFAULT_BYTES];
    for cell in room.iter_mut().step_by(PAGE) {
        cell.write(0);
        black_box(cell);
    }
    black_box(&mut room);
}

/// Makes the allocator set up what it keeps for the calling thread. The scan allocates nothing; this is for the one
/// thing that does, a panic on its way to the edge of a plugin.
pub fn warm_heap() {
    black_box(vec![0u8; 32 * 1024]);
}

/// Blocks all signals on the calling thread, so that those sent to the process are handled by another one; but not
/// those a thread provokes itself (SIGSEGV and its like): blocked, they would end the process without a word.
pub fn block_signals() {
    let mut all = MaybeUninit::<libc::sigset_t>::uninit();
    // SAFETY: sigfillset initialises the set it is given; pthread_sigmask only reads it and accepts a null old set.
    unsafe {
        libc::sigfillset(all.as_mut_ptr());
        crate::crash::without_synchronous(&mut all);
        libc::pthread_sigmask(libc::SIG_SETMASK, all.as_ptr(), std::ptr::null_mut());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prefault_fits_the_stack() {
        let name = spawn("ob1-test", || {
            prefault_stack();
            warm_heap();
            block_signals();
            std::thread::current().name().map(str::to_owned)
        });
        assert_eq!(name.expect("a thread").join().expect("no panic").as_deref(), Some("ob1-test"));
    }
}
