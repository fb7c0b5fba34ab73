//! Things in C that a test builds for itself: plugins and the allocation counter.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

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

/// The counter of `tests/native/count_alloc.c`.
#[derive(Debug)]
pub(crate) struct Counts(PathBuf);

impl Counts {
    /// A new counter at zero.
    pub(crate) fn new(path: PathBuf) -> Self {
        File::create(&path).and_then(|file| file.set_len(16)).expect("room for a file");
        Self(path)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }

    /// Heap calls so far: (of the scan thread, of all threads of the process and its children).
    pub(crate) fn read(&self) -> (u64, u64) {
        let bytes = fs::read(&self.0).expect("the counter");
        let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
        (word(0), word(8))
    }
}
