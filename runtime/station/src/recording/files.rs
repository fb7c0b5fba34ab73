//! The files of a trace: each at most so long, and so many of them.

use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use ob1_station_file::StationTrace;

use crate::wall_clock::unix_now;

/// How the files of recordings end.
pub(super) const ENDING: &str = "ob1trace";

/// The files of one trace.
#[derive(Debug)]
pub(super) struct Files {
    folder: PathBuf,
    name: String,
    /// The bytes each begins with.
    head: Vec<u8>,
    longest: u64,
    keep: usize,
    file: Option<File>,
    written: u64,
    /// The time in the name of the newest: names that were free again are not used again.
    newest: u64,
    /// What is wrong has been reported.
    told: bool,
}

impl Files {
    pub(super) fn new(folder: PathBuf, trace: &StationTrace, head: Vec<u8>) -> Self {
        let (longest, keep, name) = (trace.size, trace.keep, trace.name.clone());
        Self { folder, name, head, longest, keep, file: None, written: 0, newest: 0, told: false }
    }

    /// Writes these bytes, into another file when this one is full. A disk that refuses ends the trace.
    pub(super) fn put(&mut self, bytes: &[u8]) -> bool {
        if bytes.is_empty() {
            return true;
        }
        match self.write(bytes) {
            Ok(()) => true,
            Err(error) => {
                if !std::mem::replace(&mut self.told, true) {
                    tracing::error!("trace \"{}\": {}: {error}; it ends", self.name, self.folder.display());
                }
                false
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.file.is_some() && self.written.saturating_add(bytes.len() as u64) > self.longest {
            self.file = None;
        }
        let file = match &mut self.file {
            Some(file) => file,
            None => {
                let (head, mut file) = (&self.head, begin(&self.folder, &self.name, &mut self.newest)?);
                file.write_all(head)?;
                self.written = head.len() as u64;
                remove_old(&self.folder, &self.name, self.keep);
                self.file.insert(file)
            }
        };
        file.write_all(bytes)?;
        self.written += bytes.len() as u64;
        Ok(())
    }
}

/// A new file: the name of the trace and the time, so that the names are in order.
fn begin(folder: &Path, name: &str, newest: &mut u64) -> io::Result<File> {
    std::fs::create_dir_all(folder)?;
    loop {
        *newest = (*newest + 1).max(unix_now() / 1_000_000);
        let path = folder.join(format!("{name}-{newest:015}.{ENDING}"));
        match OpenOptions::new().write(true).create_new(true).open(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            outcome => return outcome,
        }
    }
}

/// Removes the oldest files of a trace.
fn remove_old(folder: &Path, name: &str, keep: usize) {
    let is_one = |path: &PathBuf| {
        let stem = path.file_name().and_then(|file| file.to_str()?.strip_suffix(ENDING)?.strip_suffix('.'));
        let time = stem.and_then(|stem| stem.strip_prefix(name)?.strip_prefix('-'));
        time.is_some_and(|time| time.len() == 15 && time.bytes().all(|digit| digit.is_ascii_digit()))
    };
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_one).collect();
    files.sort();
    for old in files.iter().take(files.len().saturating_sub(keep.max(1))) {
        let _ = std::fs::remove_file(old);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_files_make_room_for_new_ones() {
        let folder = tempfile::tempdir().expect("a directory");
        let trace = StationTrace { name: "press".into(), size: 100, keep: 3, ..StationTrace::default() };
        let other = folder.path().join("press-notes.ob1trace");
        std::fs::write(&other, "mine").expect("writable");
        let mut files = Files::new(folder.path().to_owned(), &trace, b"head".to_vec());
        for byte in 0..20_u8 {
            assert!(files.put(&[byte; 40]));
        }
        let mut left: Vec<PathBuf> =
            std::fs::read_dir(folder.path()).expect("a folder").flatten().map(|entry| entry.path()).collect();
        left.retain(|path| *path != other);
        left.sort();
        assert_eq!(left.len(), 3);
        for (path, first) in left.iter().zip([14, 16, 18]) {
            let content = std::fs::read(path).expect("a file");
            let expected = [&b"head"[..], &[first; 40], &[first + 1; 40]].concat();
            assert_eq!(content, expected, "{}", path.display());
        }
        assert!(other.exists());
    }

    #[test]
    fn a_disk_that_refuses_ends_the_trace() {
        let folder = tempfile::tempdir().expect("a directory");
        let file = folder.path().join("no-folder");
        std::fs::write(&file, "").expect("writable");
        let trace = StationTrace { name: "press".into(), ..StationTrace::default() };
        assert!(!Files::new(file, &trace, Vec::new()).put(&[1]));
    }
}
