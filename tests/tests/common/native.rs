//! C code built by tests: plugins and the allocation counter.

use std::fs::File;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;
use std::process::Command;

use rustix::fs::{MemfdFlags, memfd_create};

use super::checkout;
use super::site::Site;

/// Builds a shared library from a file of the checkout.
pub(crate) fn build(site: &Site, source: &str, library: &str, flags: &[&str]) -> PathBuf {
    let path = site.path(library);
    let output = Command::new("cc")
        .args(["-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-I"])
        .arg(checkout("include"))
        .args(flags)
        .arg("-o")
        .arg(&path)
        .arg(checkout(source))
        .output()
        .expect("a C compiler (cc) is needed");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    path
}

/// The counter of `tests/native/count_alloc.c`. In memory, because a write to a page of a file on a disk may wait for
/// the disk.
#[derive(Debug)]
pub(crate) struct Counts(File);

impl Counts {
    /// A new counter at zero.
    pub(crate) fn new() -> Self {
        let file = File::from(memfd_create("counts", MemfdFlags::CLOEXEC).expect("memory"));
        file.set_len(16).expect("memory");
        Self(file)
    }

    /// Its path for other processes, valid while this process exists.
    pub(crate) fn path(&self) -> PathBuf {
        PathBuf::from(format!("/proc/{}/fd/{}", std::process::id(), self.0.as_raw_fd()))
    }

    /// Heap calls so far: (in the scan thread, in all threads of the process and its children).
    pub(crate) fn read(&self) -> (u64, u64) {
        let mut bytes = [0; 16];
        self.0.read_exact_at(&mut bytes, 0).expect("the counter");
        let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
        (word(0), word(8))
    }
}
