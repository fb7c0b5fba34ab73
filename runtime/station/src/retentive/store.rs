//! Two generations of a retentive file on the disk.
//!
//! `.NAME.retentive.a` and `.b` take turns. A file is written under another name, synced, renamed over the older
//! generation, and the folder synced: at every moment at least one whole generation is there under its name. Whoever
//! holds the lock on `.NAME.retentive.lock` owns them, whatever runtime directory it uses.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;

use super::format::{self, Content};

const SLOTS: [&str; 2] = ["a", "b"];
/// Only the station's user reads and writes them.
const MODE: u32 = 0o600;
/// Files that were refused and are kept, at most.
const KEPT: u32 = 10;

/// Why retentive files cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Another runtime uses them.
    #[error("the retentive files of station \"{station}\" in {} are in use by process {pid}", .folder.display())]
    InUse {
        /// Name of the station.
        station: String,
        /// The folder with its files.
        folder: PathBuf,
        /// The other runtime, as it says itself.
        pid: String,
    },
    /// The folder cannot be made, read or written.
    #[error("retentive memory cannot be kept in {}: {source}", .folder.display())]
    Folder {
        /// The folder that was tried.
        folder: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// The retentive files of one station.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    station: String,
    sequence: u64,
    /// The slot that is written next.
    next: usize,
    /// What lies in the slots: the numbers of whole generations.
    there: [Option<u64>; 2],
    /// Slots blocked by something that cannot be moved.
    blocked: [bool; 2],
    /// Held as long as the files are ours.
    _lock: Lock,
}

/// What was found on the disk.
#[derive(Debug, Default)]
pub struct Found {
    /// Whole generations, the newest first.
    pub generations: Vec<Content>,
    /// What was refused, in sentences.
    pub refused: Vec<String>,
}

impl Store {
    /// Locks the files and looks at what is there. What is refused is renamed to `….refused` and stays for inspection;
    /// a leftover of an interrupted writing is removed.
    ///
    /// # Errors
    /// [`StoreError::InUse`]: another runtime has the files; [`StoreError::Folder`]: the folder cannot be used.
    pub fn open(folder: &Path, station: &str) -> Result<(Self, Found), StoreError> {
        // `ob1 run station.toml` in the station's own folder.
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let failed = |source| StoreError::Folder { folder: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(failed)?;
        let lock = lock(folder, station)?;
        let mut store = Self {
            folder: folder.to_owned(),
            station: station.to_owned(),
            sequence: 0,
            next: 0,
            there: [None; 2],
            blocked: [false; 2],
            _lock: lock,
        };
        store.try_folder().map_err(failed)?;
        let found = store.look();
        if store.blocked == [true; 2] {
            return Err(failed(io::Error::other(found.refused.join("; "))));
        }
        Ok((store, found))
    }

    /// Makes and removes a file. A full disk is no reason to refuse: it may have room later.
    fn try_folder(&self) -> io::Result<()> {
        let temporary = self.temporary();
        let made = ob1_process::files::fresh(&temporary, MODE);
        let _ = fs::remove_file(&temporary);
        match made {
            Err(error) if !is_full(&error) => Err(error),
            _ => Ok(()),
        }
    }

    fn look(&mut self) -> Found {
        let mut found = Found::default();
        let mut newest = None;
        for (slot, _) in SLOTS.iter().enumerate() {
            let path = self.path(slot);
            let content = match read(&path) {
                Ok(None) => continue,
                Ok(Some(bytes)) => format::decode(&bytes, &self.station).map_err(|error| error.to_string()),
                Err(why) => Err(why),
            };
            match content {
                Ok(content) => {
                    if newest.is_none_or(|(sequence, _)| content.sequence > sequence) {
                        newest = Some((content.sequence, slot));
                    }
                    self.there[slot] = Some(content.sequence);
                    found.generations.push(content);
                }
                Err(why) => {
                    let kept = self.clear(slot);
                    found.refused.push(format!("{}: {why}; {kept}", path.display()));
                }
            }
        }
        found.generations.sort_by_key(|content| std::cmp::Reverse(content.sequence));
        if let Some((sequence, slot)) = newest {
            (self.sequence, self.next) = (sequence, 1 - slot);
        }
        if self.blocked[self.next] {
            self.next = 1 - self.next;
        }
        found
    }

    /// Takes a whole generation that does not fit out of the way of those that follow. Says what became of it.
    pub fn refuse(&mut self, sequence: u64) -> String {
        let Some(slot) = self.there.iter().position(|there| *there == Some(sequence)) else {
            return "it is not there any more".to_owned();
        };
        let kept = self.clear(slot);
        self.next = if self.blocked[slot] { 1 - slot } else { slot };
        kept
    }

    /// Keeps a whole generation of which not everything was used under another name, too; it stays the newest. Says
    /// what became of it.
    pub fn keep_too(&self, sequence: u64) -> String {
        let Some(slot) = self.there.iter().position(|there| *there == Some(sequence)) else {
            return "it is not there any more".to_owned();
        };
        match copy_aside(&self.path(slot)) {
            Ok(aside) => format!("it is kept as {}", aside.display()),
            Err(error) => format!("it cannot be kept: {error}"),
        }
    }

    /// Renames what lies in a slot. Says what became of it.
    fn clear(&mut self, slot: usize) -> String {
        self.there[slot] = None;
        match set_aside(&self.path(slot)) {
            Ok(aside) => format!("it is kept as {}", aside.display()),
            Err(error) => {
                self.blocked[slot] = true;
                format!("it cannot be moved: {error}")
            }
        }
    }

    fn path(&self, slot: usize) -> PathBuf {
        self.folder.join(format!(".{}.retentive.{}", self.station, SLOTS[slot]))
    }

    fn temporary(&self) -> PathBuf {
        self.folder.join(format!(".{}.retentive.new", self.station))
    }

    /// Writes a generation; it is on the disk when this returns. Gives its sequence number.
    ///
    /// # Errors
    /// What the system says; the generations that are there stay.
    pub fn write(&mut self, image: &[u8]) -> io::Result<u64> {
        let content = Content { station: self.station.clone(), sequence: self.sequence + 1, image: image.to_vec() };
        let bytes = format::encode(&content).map_err(io::Error::other)?;
        ob1_process::files::replace_by(&self.temporary(), &self.path(self.next), &bytes, MODE)?;
        self.sequence = content.sequence;
        if !self.blocked[1 - self.next] {
            self.next = 1 - self.next;
        }
        Ok(content.sequence)
    }
}

/// The disk, or what this user may have of it, is full.
fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

/// The lock. It is released explicitly, not by closing the descriptor: a child that is just being started has a copy of
/// that.
#[derive(Debug)]
struct Lock(File);

impl Drop for Lock {
    fn drop(&mut self) {
        // The process has no better use for a failure here.
        let _ = flock(&self.0, FlockOperation::Unlock);
    }
}

/// The lock of a station's files. It stays on the disk: a file that is removed and made again could be locked twice.
fn lock(folder: &Path, station: &str) -> Result<Lock, StoreError> {
    let name = format!(".{station}.retentive.lock");
    let path = folder.join(&name);
    let failed = |error: io::Error| {
        let source = io::Error::new(error.kind(), format!("the lock {name}: {error}"));
        StoreError::Folder { folder: folder.to_owned(), source }
    };
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32;
    let mut file = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(MODE)
        .custom_flags(flags)
        .open(&path)
        .map_err(failed)?;
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => {
            // For people; whoever holds the lock is the owner, whatever the file says.
            let _ = file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id()));
            Ok(Lock(file))
        }
        Err(Errno::WOULDBLOCK) => {
            let mut pid = String::new();
            let _ = file.take(32).read_to_string(&mut pid);
            let pid = pid.trim().to_owned();
            Err(StoreError::InUse { station: station.to_owned(), folder: folder.to_owned(), pid })
        }
        Err(errno) => Err(failed(errno.into())),
    }
}

/// The bytes of a file, if there is one; why it is refused, if it cannot be one of ours. Never waits.
fn read(path: &Path) -> Result<Option<Vec<u8>>, String> {
    let there = match fs::symlink_metadata(path) {
        Ok(there) => there,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error.to_string()),
    };
    // A FIFO would be waited for until somebody writes to it.
    let file = OpenOptions::new().read(true).custom_flags(OFlags::NONBLOCK.bits() as i32).open(path);
    let file = match file {
        Err(_) if there.is_symlink() && !path.exists() => return Err("a link that leads nowhere".into()),
        Err(error) => return Err(error.to_string()),
        Ok(file) => file,
    };
    let opened = file.metadata().map_err(|error| error.to_string())?;
    if !opened.is_file() {
        return Err("not a regular file".into());
    }
    if opened.len() > format::LONGEST {
        return Err(format!("{} bytes: longer than any retentive file", opened.len()));
    }
    let mut bytes = Vec::new();
    file.take(format::LONGEST).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    Ok(Some(bytes))
}

/// Renames what was refused; the new name.
fn set_aside(path: &Path) -> io::Result<PathBuf> {
    let last = name_aside(path, KEPT - 1);
    let free =
        (0..KEPT - 1).map(|number| name_aside(path, number)).filter(|aside| fs::symlink_metadata(aside).is_err());
    let mut failure = io::Error::other("too many refused files are kept");
    for aside in free.chain([last]) {
        match fs::rename(path, &aside) {
            Ok(()) => return Ok(aside),
            Err(error) => failure = error,
        }
    }
    Err(failure)
}

/// Copies a file to such a name, whole or not at all; the name. A station that is started again and again before it
/// writes a generation needs one copy.
fn copy_aside(path: &Path) -> io::Result<PathBuf> {
    let bytes = ob1_process::files::read(path, format::LONGEST)?;
    let is_it = |aside: &PathBuf| ob1_process::files::read(aside, format::LONGEST).is_ok_and(|there| there == bytes);
    let mut names = (0..KEPT).map(|number| name_aside(path, number));
    if let Some(aside) = names.clone().find(is_it) {
        return Ok(aside);
    }
    let aside = names.find(|aside| fs::symlink_metadata(aside).is_err());
    let aside = aside.unwrap_or_else(|| name_aside(path, KEPT - 1));
    ob1_process::files::replace_by(&name_aside(path, KEPT), &aside, &bytes, MODE)?;
    Ok(aside)
}

/// A name for a file that is kept.
fn name_aside(path: &Path, number: u32) -> PathBuf {
    let mut aside = path.as_os_str().to_owned();
    aside.push(".refused");
    if number > 0 {
        aside.push(format!(".{number}"));
    }
    aside.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn images(found: &Found) -> Vec<&[u8]> {
        found.generations.iter().map(|g| g.image.as_slice()).collect()
    }

    /// A folder with the generations 1, 2 (the newest, in slot b).
    fn two() -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a directory");
        let (mut store, _) = Store::open(folder.path(), "s").expect("writable");
        for image in [b"1", b"2"] {
            store.write(image).expect("writable");
        }
        folder
    }

    #[test]
    fn two_generations_take_turns() {
        let folder = tempfile::tempdir().expect("a directory");
        let deep = folder.path().join("deep/er");
        let (mut store, found) = Store::open(&deep, "s").expect("writable");
        assert!(found.generations.is_empty() && found.refused.is_empty());
        for image in [b"1", b"2", b"3"] {
            store.write(image).expect("writable");
        }
        drop(store);
        let (mut store, found) = Store::open(&deep, "s").expect("readable");
        assert_eq!(images(&found), [b"3", b"2"]);
        assert_eq!(store.write(b"4").expect("writable"), 4);
        drop(store);
        let (_, found) = Store::open(&deep, "s").expect("readable");
        assert_eq!(images(&found), [b"4", b"3"]);
    }

    #[test]
    fn a_torn_newest_falls_back_to_the_older() {
        let folder = two();
        let newest = folder.path().join(".s.retentive.b");
        let bytes = fs::read(&newest).expect("there");
        fs::write(&newest, &bytes[..bytes.len() - 1]).expect("writable");
        fs::write(folder.path().join(".s.retentive.new"), "half").expect("writable");
        let (mut store, found) = Store::open(folder.path(), "s").expect("readable");
        assert_eq!(images(&found), [b"1"]);
        assert!(found.refused.len() == 1 && found.refused[0].contains("torn or damaged"), "{:?}", found.refused);
        assert!(
            folder.path().join(".s.retentive.b.refused").exists() && !folder.path().join(".s.retentive.new").exists()
        );
        // The whole generation is not the one that is overwritten.
        store.write(b"3").expect("writable");
        drop(store);
        assert_eq!(images(&Store::open(folder.path(), "s").expect("readable").1), [b"3", b"1"]);
    }

    /// The image of another program is whole, and belongs to somebody.
    #[test]
    fn what_does_not_fit_is_kept_too() {
        let folder = two();
        let (mut store, _) = Store::open(folder.path(), "s").expect("usable");
        for (sequence, slot) in [(2, "b"), (1, "a")] {
            assert!(store.refuse(sequence).ends_with(&format!(".s.retentive.{slot}.refused")), "{sequence}");
        }
        assert_eq!(store.refuse(2), "it is not there any more");
        assert_eq!(store.write(b"3").expect("its place is free"), 3);
        assert_eq!(store.write(b"4").expect("its place is free"), 4);
        drop(store);
        for slot in ["a", "b"] {
            let name = folder.path().join(format!(".s.retentive.{slot}"));
            fs::rename(name.with_extension(format!("{slot}.refused")), name).expect("kept");
        }
        assert_eq!(images(&Store::open(folder.path(), "s").expect("usable").1), [b"2", b"1"]);
    }

    #[test]
    fn a_foreign_file_is_refused_and_kept() {
        let folder = tempfile::tempdir().expect("a directory");
        let (mut other, _) = Store::open(folder.path(), "other").expect("writable");
        other.write(b"1").expect("writable");
        fs::rename(folder.path().join(".other.retentive.a"), folder.path().join(".s.retentive.a")).expect("there");
        fs::write(folder.path().join(".s.retentive.b"), "my diary").expect("writable");
        let (_, found) = Store::open(folder.path(), "s").expect("readable");
        assert!(found.generations.is_empty());
        assert!(found.refused[0].contains("belongs to the station \"other\""), "{:?}", found.refused);
        assert!(found.refused[1].contains("not a retentive file"), "{:?}", found.refused);
        assert_eq!(fs::read(folder.path().join(".s.retentive.b.refused")).ok(), Some(b"my diary".to_vec()));
    }

    /// Whatever is in the place of the newest generation is reported and not waited for; the older one is used, and the
    /// next generation gets that place.
    #[test]
    fn what_is_no_file_is_refused_and_waited_for_by_nobody() {
        type Put = fn(&Path);
        let kinds: [(&str, Put); 5] = [
            ("not a regular file", |path| {
                let made = std::process::Command::new("mkfifo").arg(path).status().expect("mkfifo is there");
                assert!(made.success());
            }),
            ("8589934592 bytes", |path| File::create(path).and_then(|f| f.set_len(8 << 30)).expect("a sparse file")),
            ("a link that leads nowhere", |path| std::os::unix::fs::symlink("/nowhere/x", path).expect("a link")),
            ("not a regular file", |path| {
                fs::create_dir(path).and_then(|()| fs::write(path.join("x"), "x")).expect("a directory");
            }),
            ("not a regular file", |path| std::os::unix::fs::symlink("/dev/zero", path).expect("a link")),
        ];
        let folder = two();
        let (newest, whole) = (folder.path().join(".s.retentive.b"), folder.path().join(".s.retentive.a"));
        for (number, (why, put)) in kinds.into_iter().enumerate() {
            fs::remove_file(&newest).expect("there");
            put(&newest);
            let older = fs::read(&whole).expect("there");
            let (mut store, found) = Store::open(folder.path(), "s").expect("usable");
            assert_eq!((images(&found), found.refused.len()), (vec![&b"1"[..]], 1), "{why}");
            assert!(found.refused[0].contains(why), "{why}: {:?}", found.refused);
            assert!(found.refused[0].contains(".b.refused"), "{:?}", found.refused);
            store.write(b"2").expect("its place is free");
            drop(store);
            assert_eq!(images(&Store::open(folder.path(), "s").expect("usable").1), [b"2", b"1"], "{why}");
            assert_eq!(fs::read(&whole).expect("there"), older, "{number}: the older one is untouched");
        }
    }

    #[test]
    fn the_files_have_one_owner() {
        let folder = two();
        let held = Store::open(folder.path(), "s").expect("free");
        match Store::open(folder.path(), "s") {
            Err(StoreError::InUse { pid, .. }) => assert_eq!(pid, std::process::id().to_string()),
            other => panic!("{other:?}"),
        }
        Store::open(folder.path(), "another station").expect("its own files");
        drop(held);
        Store::open(folder.path(), "s").expect("free again");
    }

    #[test]
    fn an_unusable_folder_is_refused_at_once() {
        let folder = tempfile::tempdir().expect("a directory");
        fs::create_dir(folder.path().join(".s.retentive.lock")).expect("room");
        let error = Store::open(folder.path(), "s").expect_err("no lock").to_string();
        assert!(error.contains("the lock .s.retentive.lock: "), "{error}");
        let file = folder.path().join("file");
        fs::write(&file, "").expect("writable");
        for unusable in [file.as_path(), &file.join("below"), Path::new("/proc/nothing"), Path::new("/dev/null/x")] {
            let error = Store::open(unusable, "s").expect_err("unusable");
            assert!(error.to_string().contains(&unusable.display().to_string()), "{error}");
        }
    }
}
