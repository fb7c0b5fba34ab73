//! Panics of a plugin: a hook that copies the message into a fixed buffer, without a backtrace, a lock or an allocation
//! of its own, and the function by which the host fetches it.
//!
//! Every plugin has a standard library of its own and so a hook of its own.

use core::fmt::{self, Write};
use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
use std::panic::PanicHookInfo;

/// Longest message kept, in bytes; the rest is cut.
const MESSAGE_BYTES: usize = 512;

// The one place a plugin keeps outside the host's memory. It is written by the hook and read by the host after the
// entry has returned; if two stations of one process panic at the same time, their texts can mix, but nothing else
// happens.
static MESSAGE: [AtomicU8; MESSAGE_BYTES] = [const { AtomicU8::new(0) }; MESSAGE_BYTES];
static LEN: AtomicUsize = AtomicUsize::new(0);

/// Installs the hook: `init` of the plugin's table.
pub(crate) unsafe extern "C" fn init() -> crate::abi::Status {
    std::panic::set_hook(Box::new(keep));
    crate::abi::OK
}

/// Copies the last message: `panic_message` of the plugin's table.
///
/// # Safety
/// `into` is valid for writing `len` bytes.
pub(crate) unsafe extern "C" fn message(into: *mut u8, len: u32) -> u32 {
    let len = LEN.load(Ordering::Acquire).min(len as usize).min(MESSAGE_BYTES);
    if into.is_null() {
        return 0;
    }
    for (at, byte) in MESSAGE.iter().enumerate().take(len) {
        // SAFETY: `at` is below `len`, for which the caller vouches.
        unsafe { into.add(at).write(byte.load(Ordering::Relaxed)) };
    }
    len as u32
}

fn keep(info: &PanicHookInfo<'_>) {
    let mut buffer = Buffer { len: 0 };
    let text = info.payload_as_str().unwrap_or("a panic without a text");
    // The only error is the full buffer.
    let _full = match info.location() {
        Some(at) => write!(buffer, "{text} ({}:{})", at.file(), at.line()),
        None => buffer.write_str(text),
    };
    LEN.store(buffer.len, Ordering::Release);
}

struct Buffer {
    len: usize,
}

impl Write for Buffer {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let part = &s[..s.floor_char_boundary(MESSAGE_BYTES - self.len)];
        for (to, from) in MESSAGE.iter().skip(self.len).zip(part.bytes()) {
            to.store(from, Ordering::Relaxed);
        }
        self.len += part.len();
        if part.len() == s.len() { Ok(()) } else { Err(fmt::Error) }
    }
}
