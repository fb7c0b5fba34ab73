//! Records that the broker has not accepted yet: in memory, and beyond that on disk, up to a limit; then the oldest are
//! dropped.
//!
//! The next records are in memory; files contain the following ones, in the order of their numbers. A file that is read
//! into memory is deleted; what is in memory when the link ends is written back in front of the others.

use std::collections::VecDeque;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

/// Records in memory.
const FRONT: usize = 20_000;
/// Bytes of records in memory.
const FRONT_BYTES: usize = 4 << 20;
/// Bytes of a file: the maximum that one deletion loses.
const FILE_BYTES: u64 = 64 << 10;
/// Longest record.
pub(crate) const RECORD: usize = 256 << 10;
/// The first file number of a new store, high enough to leave room for files in front of it.
const FIRST: u64 = 1 << 32;

/// A record to send.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Record {
    /// The topic after the prefix; empty with Sparkplug.
    pub(crate) topic: String,
    pub(crate) payload: Vec<u8>,
}

impl Record {
    fn len(&self) -> usize {
        8 + self.topic.len() + self.payload.len()
    }

    fn encode(&self, out: &mut Vec<u8>) {
        out.extend((self.topic.len() as u32).to_le_bytes());
        out.extend((self.payload.len() as u32).to_le_bytes());
        out.extend(self.topic.as_bytes());
        out.extend(&self.payload);
    }

    /// The next record of a file; `None` at its end, or where it was cut off.
    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        let mut number = || -> Option<usize> {
            let (head, rest) = bytes.split_at_checked(4)?;
            *bytes = rest;
            Some(u32::from_le_bytes(head.try_into().ok()?) as usize)
        };
        let (topic, payload) = (number()?, number()?);
        let (topic, rest) = bytes.split_at_checked(topic)?;
        let (payload, rest) = rest.split_at_checked(payload)?;
        *bytes = rest;
        Some(Self { topic: std::str::from_utf8(topic).ok()?.to_owned(), payload: payload.to_vec() })
    }
}

/// See [the module](self).
#[derive(Debug)]
pub(crate) struct Store {
    folder: PathBuf,
    bound: u64,
    front: VecDeque<Record>,
    front_bytes: usize,
    /// Numbers and bytes of the files, oldest first.
    files: VecDeque<(u64, u64)>,
    on_disk: u64,
    lost: u64,
    /// The file being written, if any: the last one.
    open: Option<File>,
}

impl Store {
    /// Opens the store of a folder, with the records of an earlier run.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn open(folder: &Path, bound: u64) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let mut files = Vec::new();
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            if let Some(number) = number_of(&entry.path()) {
                files.push((number, entry.metadata()?.len()));
            }
        }
        files.sort_unstable();
        let on_disk = files.iter().map(|(_, bytes)| bytes).sum();
        Ok(Self {
            folder: folder.to_owned(),
            bound,
            front: VecDeque::new(),
            front_bytes: 0,
            files: files.into(),
            on_disk,
            lost: 0,
            open: None,
        })
    }

    /// The records in memory; the first ones are sent.
    pub(crate) fn ready(&mut self) -> io::Result<&VecDeque<Record>> {
        while self.front.len() < FRONT / 2 && self.front_bytes < FRONT_BYTES / 2 && !self.files.is_empty() {
            self.load()?;
        }
        Ok(&self.front)
    }

    /// Whether there is nothing on disk.
    pub(crate) fn in_memory(&self) -> bool {
        self.files.is_empty()
    }

    /// The number of records lost since the last call.
    pub(crate) fn take_lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }

    /// Appends a record.
    ///
    /// # Errors
    /// The system's error; the record is lost.
    pub(crate) fn push(&mut self, record: Record) -> io::Result<()> {
        if record.len() > RECORD {
            self.lost += 1;
            return Ok(());
        }
        if self.files.is_empty() && self.front.len() < FRONT && self.front_bytes < FRONT_BYTES {
            self.front_bytes += record.len();
            self.front.push_back(record);
            return Ok(());
        }
        let written = self.append(&record);
        if written.is_err() {
            // The following records go to a new file: this one may end in the middle of a record.
            (self.open, self.lost) = (None, self.lost + 1);
        }
        written
    }

    /// The first `count` records have arrived.
    pub(crate) fn arrived(&mut self, count: usize) {
        for record in self.front.drain(..count.min(self.front.len())) {
            self.front_bytes -= record.len();
        }
    }

    /// Writes what is in memory back in front of the files: the link ends.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn close(&mut self) -> io::Result<()> {
        let records: Vec<Record> = self.front.drain(..).collect();
        self.front_bytes = 0;
        let mut number = self.files.front().map_or(FIRST, |(number, _)| *number);
        for records in records.rchunks(256) {
            number -= 1;
            let mut bytes = Vec::new();
            records.iter().for_each(|record| record.encode(&mut bytes));
            self.create(number)?.write_all(&bytes)?;
            self.files.push_front((number, bytes.len() as u64));
            self.on_disk += bytes.len() as u64;
        }
        self.bounded();
        Ok(())
    }

    fn append(&mut self, record: &Record) -> io::Result<()> {
        let mut bytes = Vec::new();
        record.encode(&mut bytes);
        let full = self.files.back().is_none_or(|(_, len)| *len >= FILE_BYTES);
        if full || self.open.is_none() {
            let number = self.files.back().map_or(FIRST, |(number, _)| number + 1);
            self.open = Some(self.create(number)?);
            self.files.push_back((number, 0));
        }
        if let (Some(file), Some((_, len))) = (&mut self.open, self.files.back_mut()) {
            file.write_all(&bytes)?;
            *len += bytes.len() as u64;
            self.on_disk += bytes.len() as u64;
        }
        self.bounded();
        Ok(())
    }

    /// Deletes the oldest files until the rest is within the limit; the one being written stays.
    fn bounded(&mut self) {
        while self.on_disk > self.bound && self.files.len() > 1 {
            let Some((number, len)) = self.files.pop_front() else { return };
            let path = self.path(number);
            self.lost += fs::read(&path).map_or(0, |bytes| records(&bytes).len() as u64);
            let _ = fs::remove_file(path);
            self.on_disk -= len;
        }
    }

    fn load(&mut self) -> io::Result<()> {
        let Some((number, len)) = self.files.pop_front() else { return Ok(()) };
        if self.files.is_empty() {
            self.open = None;
        }
        self.on_disk -= len;
        let path = self.path(number);
        let mut bytes = Vec::new();
        File::open(&path)?.take(FILE_BYTES + 2 * RECORD as u64 + (64 << 20)).read_to_end(&mut bytes)?;
        for record in records(&bytes) {
            self.front_bytes += record.len();
            self.front.push_back(record);
        }
        fs::remove_file(path)
    }

    fn create(&self, number: u64) -> io::Result<File> {
        OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(self.path(number))
    }

    fn path(&self, number: u64) -> PathBuf {
        self.folder.join(format!("{number:016x}.records"))
    }
}

fn number_of(path: &Path) -> Option<u64> {
    let name = path.file_name()?.to_str()?.strip_suffix(".records")?;
    (name.len() == 16).then(|| u64::from_str_radix(name, 16).ok()).flatten()
}

fn records(mut bytes: &[u8]) -> Vec<Record> {
    std::iter::from_fn(|| Record::decode(&mut bytes)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(number: usize, len: usize) -> Record {
        Record { topic: format!("t{number}"), payload: vec![number as u8; len] }
    }

    fn drain(store: &mut Store) -> Vec<String> {
        let mut topics = Vec::new();
        loop {
            let ready: Vec<String> = store.ready().expect("a disk").iter().map(|record| record.topic.clone()).collect();
            if ready.is_empty() {
                return topics;
            }
            store.arrived(ready.len());
            topics.extend(ready);
        }
    }

    #[test]
    fn all_come_out_in_order_whatever_lies_on_disk() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::open(folder.path(), 64 << 20).expect("a folder");
        let wanted: Vec<String> = (0..30_000).map(|number| format!("t{number}")).collect();
        for number in 0..30_000 {
            store.push(record(number, 20)).expect("a disk");
        }
        assert!(!store.in_memory());
        assert_eq!(drain(&mut store), wanted);
        assert!(store.in_memory());
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0);
        assert_eq!(store.take_lost(), 0);
    }

    #[test]
    fn another_run_finds_what_the_first_has_left() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::open(folder.path(), 64 << 20).expect("a folder");
        (0..25_000).for_each(|number| store.push(record(number, 5)).expect("a disk"));
        store.ready().expect("a disk");
        store.arrived(700);
        store.close().expect("a disk");
        let mut store = Store::open(folder.path(), 64 << 20).expect("a folder");
        (25_000..25_010).for_each(|number| store.push(record(number, 5)).expect("a disk"));
        let wanted: Vec<String> = (700..25_010).map(|number| format!("t{number}")).collect();
        assert_eq!(drain(&mut store), wanted);
    }

    #[test]
    fn the_bound_holds_and_the_oldest_goes() {
        let folder = tempfile::tempdir().expect("a folder");
        let bound = 512 << 10;
        let mut store = Store::open(folder.path(), bound).expect("a folder");
        let count = 40_000;
        for number in 0..count {
            store.push(record(number, 300)).expect("a disk");
            assert!(store.on_disk <= bound + FILE_BYTES + 400);
        }
        let lost = store.take_lost();
        let left = drain(&mut store);
        assert_eq!(left.len() as u64 + lost, count as u64);
        assert_eq!(left.last(), Some(&format!("t{}", count - 1)), "the newest is there");
        assert!(lost > 0);
    }

    #[test]
    fn a_file_that_was_cut_off_gives_what_is_whole() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut bytes = Vec::new();
        (0..3).for_each(|number| record(number, 10).encode(&mut bytes));
        for len in 0..bytes.len() {
            fs::write(folder.path().join("0000000100000000.records"), &bytes[..len]).expect("a file");
            fs::write(folder.path().join("other"), "x").expect("a file");
            let mut store = Store::open(folder.path(), 1 << 20).expect("a folder");
            assert_eq!(drain(&mut store).len(), len / (bytes.len() / 3), "{len}");
        }
        let noise: Vec<u8> = (0..999u32).map(|n| ((n * 7919) >> 3) as u8).collect();
        fs::write(folder.path().join("0000000100000000.records"), noise).expect("a file");
        drain(&mut Store::open(folder.path(), 1 << 20).expect("a folder"));
    }

    #[test]
    fn what_is_too_long_is_lost_and_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::open(folder.path(), 1 << 20).expect("a folder");
        store.push(record(0, RECORD)).expect("no disk needed");
        assert_eq!((store.take_lost(), store.take_lost()), (1, 0));
    }
}
