//! The last words: what a process that crashes still does.
//!
//! A segmentation fault, a bus error, an illegal instruction, an arithmetic fault, a trap or an abort comes from code
//! that is not safe Rust: a block in C, a library. Nothing of the process can be trusted then. The handler runs on a
//! stack of its own, switches the outputs off, writes what is known from a buffer of fixed size, and ends the process
//! with a code of its own. It allocates nothing, takes no lock that it would have to wait for, and nothing unwinds
//! from it.

use std::ffi::{c_int, c_void};
use std::fmt::{self, Write as _};
use std::io;
use std::mem::MaybeUninit;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicBool, AtomicPtr, Ordering};

use crate::exit::end_now;

/// Signals that a thread provokes itself. They are never blocked, so that they are heard.
pub(crate) const SYNCHRONOUS: [c_int; 7] =
    [libc::SIGSEGV, libc::SIGBUS, libc::SIGILL, libc::SIGFPE, libc::SIGABRT, libc::SIGTRAP, libc::SIGSYS];

/// Stack of the handler, in bytes.
const HANDLER_STACK: usize = 64 * 1024;
/// Longest text of the last words, in bytes.
const TEXT: usize = 1024;
/// A fault so near to the stack pointer is an overflow of the stack, in bytes.
const NEAR: usize = 64 * 1024;

/// What to do in a crash. Both functions run in a signal handler: they touch atomics and memory that is there, allocate
/// nothing, and wait for nothing.
pub struct LastWords {
    /// Switches the outputs off.
    pub outputs_off: Box<dyn Fn() + Send + Sync>,
    /// Writes where the program was, as the middle of a sentence.
    pub place: Box<Place>,
    /// How the process ends.
    pub exit_code: u8,
}

impl fmt::Debug for LastWords {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LastWords").field("exit_code", &self.exit_code).finish_non_exhaustive()
    }
}

/// Writes into a buffer of fixed size.
pub type Place = dyn Fn(&mut dyn fmt::Write) -> fmt::Result + Send + Sync;

/// Set once, never freed: a handler may look at any time.
static WORDS: AtomicPtr<LastWords> = AtomicPtr::new(null_mut());
/// A thread has begun to speak them.
static SPEAKING: AtomicBool = AtomicBool::new(false);

impl LastWords {
    /// From now on a crash of any thread ends this way. What was set before is forgotten, not freed.
    ///
    /// # Errors
    /// The system does not take the handler for one of the signals.
    pub fn keep(self) -> io::Result<()> {
        WORDS.store(Box::into_raw(Box::new(self)), Ordering::Release);
        for signal in SYNCHRONOUS {
            // SAFETY: an all-zero sigaction is a valid one without flags; sigfillset and sigaction get pointers to it,
            // and the handler has the form that SA_SIGINFO asks for.
            let answer = unsafe {
                let mut action: libc::sigaction = std::mem::zeroed();
                action.sa_sigaction = handler as *const () as usize;
                action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
                libc::sigfillset(&raw mut action.sa_mask);
                libc::sigaction(signal, &raw const action, null_mut())
            };
            if answer != 0 {
                return Err(io::Error::last_os_error());
            }
        }
        Ok(())
    }
}

/// Gives the calling thread a stack for the handler, so that an overflow of its own stack is handled, too. The memory
/// is never freed: the scan thread ends with the process.
///
/// # Errors
/// The system does not take the stack (sigaltstack(2)).
pub fn take_handler_stack() -> io::Result<()> {
    let room = Box::leak(vec![0u8; HANDLER_STACK].into_boxed_slice());
    let stack = libc::stack_t { ss_sp: room.as_mut_ptr().cast(), ss_flags: 0, ss_size: room.len() };
    // SAFETY: the memory is as large as said and stays forever.
    match unsafe { libc::sigaltstack(&raw const stack, null_mut()) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Takes the signals that a thread provokes itself out of a full set.
pub(crate) fn without_synchronous(set: &mut MaybeUninit<libc::sigset_t>) {
    for signal in SYNCHRONOUS {
        // SAFETY: the caller has filled the set, and the signals exist.
        unsafe { libc::sigdelset(set.as_mut_ptr(), signal) };
    }
}

/// Text in a buffer of fixed size; what does not fit is left out.
struct Text {
    bytes: [u8; TEXT],
    len: usize,
}

impl fmt::Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let rest = &mut self.bytes[self.len..];
        let len = text.len().min(rest.len());
        rest[..len].copy_from_slice(&text.as_bytes()[..len]);
        self.len += len;
        Ok(())
    }
}

/// Where the thread was: program counter and stack pointer.
fn registers(context: *const c_void) -> (usize, usize) {
    // SAFETY: the kernel hands a ucontext_t of this machine to a handler with SA_SIGINFO.
    let context = unsafe { &*context.cast::<libc::ucontext_t>() };
    #[cfg(target_arch = "x86_64")]
    let found = {
        let registers = &context.uc_mcontext.gregs;
        (registers[libc::REG_RIP as usize] as usize, registers[libc::REG_RSP as usize] as usize)
    };
    #[cfg(target_arch = "aarch64")]
    let found = (context.uc_mcontext.pc as usize, context.uc_mcontext.sp as usize);
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    let found = (context.uc_link as usize, 0);
    found
}

const fn name(signal: c_int) -> &'static str {
    match signal {
        libc::SIGSEGV => "segmentation fault",
        libc::SIGBUS => "bus error",
        libc::SIGILL => "illegal instruction",
        libc::SIGFPE => "arithmetic fault",
        // What a failed check of a compiler ends in, on some machines.
        libc::SIGTRAP => "trap",
        libc::SIGSYS => "forbidden system call",
        _ => "abort",
    }
}

extern "C" fn handler(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    // SAFETY: the pointer comes from Box::into_raw and is never freed.
    let Some(words) = (unsafe { WORDS.load(Ordering::Acquire).as_ref() }) else { end_now(i32::from(u8::MAX)) };
    if SPEAKING.swap(true, Ordering::AcqRel) {
        // Another thread has crashed before and is about to end the process.
        loop {
            std::hint::spin_loop();
        }
    }
    (words.outputs_off)();
    let mut text = Text { bytes: [0; TEXT], len: 0 };
    let (pc, sp) = registers(context);
    let _ = write!(text, "\nob1: {} at {pc:#x}", name(signal));
    if matches!(signal, libc::SIGSEGV | libc::SIGBUS) {
        // SAFETY: the kernel hands a siginfo_t over; for these signals it has an address.
        let address = unsafe { (*info).si_addr() } as usize;
        let what = if address.abs_diff(sp) < NEAR { "the stack has overflowed" } else { "a wrong address" };
        let _ = write!(text, ", {what}, {address:#x}");
    }
    let _ = write!(text, ", in ");
    let _ = (words.place)(&mut text);
    let _ = writeln!(text, "; outputs are off, the station ends");
    let _ =
        writeln!(text, "  = a block in C, or a library it uses, has an error there; report this message to its author");
    say(&text.bytes[..text.len]);
    end_now(i32::from(words.exit_code))
}

/// Writes to standard error what can be written without waiting.
fn say(text: &[u8]) {
    if !crate::system_calls::is_up() {
        let mut ready = libc::pollfd { fd: libc::STDERR_FILENO, events: libc::POLLOUT, revents: 0 };
        // SAFETY: one pollfd, no waiting.
        if unsafe { libc::poll(&raw mut ready, 1, 0) } != 1 {
            return;
        }
    }
    // SAFETY: the text is there; whether it is written no longer matters.
    unsafe { libc::write(libc::STDERR_FILENO, text.as_ptr().cast(), text.len()) };
}
