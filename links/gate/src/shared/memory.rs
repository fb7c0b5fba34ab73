//! The memory this process uses, compared with its limit.
//!
//! Some libraries allocate memory for a stranger's input as long as it arrives. Code that serves strangers checks here,
//! and drops them before the kernel refuses memory, which would end the process.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;

/// The data of this process. Clones are the same.
#[derive(Clone, Debug)]
pub(crate) struct Memory(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    /// The kernel's status of the process; opened before the process confines itself.
    status: Option<File>,
    most: u64,
}

impl Memory {
    /// The memory of this process, which may have `most` bytes of data. Call it before the process is confined.
    #[must_use]
    pub(crate) fn open(most: u64) -> Self {
        Self(Arc::new(Inner { status: File::open("/proc/self/status").ok(), most }))
    }

    /// Whether the process is near its limit. A growing buffer doubles, so at half of the limit it could not grow any
    /// more.
    #[must_use]
    pub(crate) fn is_short(&self) -> bool {
        self.data().is_some_and(|data| data > self.0.most / 16 * 7)
    }

    /// Bytes of data; `None` if the kernel does not tell.
    fn data(&self) -> Option<u64> {
        let mut text = [0; 4096];
        let read = self.0.status.as_ref()?.read_at(&mut text, 0).ok()?;
        let text = String::from_utf8_lossy(text.get(..read)?);
        let line = text.lines().find_map(|line| line.strip_prefix("VmData:"))?;
        line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib << 10)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_taken_is_seen() {
        let memory = Memory::open(1 << 40);
        let before = memory.data().expect("the kernel says it");
        let taken = std::hint::black_box(vec![1_u8; 64 << 20]);
        let now = memory.data().expect("the kernel says it");
        assert!(now >= before + (60 << 20), "{before}, {now}");
        assert!(!memory.is_short());
        assert!(Memory::open(32 << 20).is_short());
        drop(taken);
    }
}
