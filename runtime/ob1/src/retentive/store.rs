//! Two generations of a retentive file on the disk.
//!
//! `.NAME.retentive.a` and `.b` take turns. A file is written under another name, synced, renamed over the older
//! generation, and the folder synced: at every moment at least one whole generation is there under its name.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use super::format::{self, Content};

const SLOTS: [&str; 2] = ["a", "b"];

/// The retentive files of one station.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    station: String,
    sequence: u64,
    /// The slot that is written next.
    next: usize,
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
    /// Looks at what is there. A file that is refused is renamed to `….refused` and stays for inspection; a leftover
    /// of an interrupted writing goes.
    ///
    /// # Errors
    /// The folder cannot be made or read.
    pub fn open(folder: &Path, station: &str) -> io::Result<(Self, Found)> {
        fs::create_dir_all(folder)?;
        let mut store = Self { folder: folder.to_owned(), station: station.to_owned(), sequence: 0, next: 0 };
        let mut found = Found::default();
        let mut newest = None;
        for (slot, _) in SLOTS.iter().enumerate() {
            let path = store.path(slot);
            let bytes = match fs::read(&path) {
                Ok(bytes) => bytes,
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                Err(error) => return Err(error),
            };
            match format::decode(&bytes, station) {
                Ok(content) => {
                    if newest.is_none_or(|(sequence, _)| content.sequence > sequence) {
                        newest = Some((content.sequence, slot));
                    }
                    found.generations.push(content);
                }
                Err(error) => {
                    let aside = path.with_extension(format!("{}.refused", SLOTS[slot]));
                    let kept = match fs::rename(&path, &aside) {
                        Ok(()) => format!("it is kept as {}", aside.display()),
                        Err(error) => format!("it cannot be kept: {error}"),
                    };
                    found.refused.push(format!("{}: {error}; {kept}", path.display()));
                }
            }
        }
        found.generations.sort_by_key(|content| std::cmp::Reverse(content.sequence));
        if let Some((sequence, slot)) = newest {
            (store.sequence, store.next) = (sequence, 1 - slot);
        }
        let _ = fs::remove_file(store.temporary());
        Ok((store, found))
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
        let temporary = self.temporary();
        let mut file = File::create(&temporary)?;
        file.write_all(&bytes)?;
        file.sync_all()?;
        drop(file);
        fs::rename(&temporary, self.path(self.next))?;
        File::open(&self.folder)?.sync_all()?;
        (self.sequence, self.next) = (content.sequence, 1 - self.next);
        Ok(content.sequence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn images(found: &Found) -> Vec<&[u8]> {
        found.generations.iter().map(|g| g.image.as_slice()).collect()
    }

    #[test]
    fn two_generations_take_turns() {
        let folder = tempfile::tempdir().expect("a directory");
        let (mut store, found) = Store::open(&folder.path().join("deep/er"), "s").expect("writable");
        assert!(found.generations.is_empty() && found.refused.is_empty());
        for image in [b"1", b"2", b"3"] {
            store.write(image).expect("writable");
        }
        let (mut store, found) = Store::open(&folder.path().join("deep/er"), "s").expect("readable");
        assert_eq!(images(&found), [b"3", b"2"]);
        assert_eq!(store.write(b"4").expect("writable"), 4);
        let (_, found) = Store::open(&folder.path().join("deep/er"), "s").expect("readable");
        assert_eq!(images(&found), [b"4", b"3"]);
    }

    #[test]
    fn a_torn_newest_falls_back_to_the_older() {
        let folder = tempfile::tempdir().expect("a directory");
        let (mut store, _) = Store::open(folder.path(), "s").expect("writable");
        for image in [b"1", b"2"] {
            store.write(image).expect("writable");
        }
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
        // The whole one is not what is overwritten.
        store.write(b"3").expect("writable");
        assert_eq!(images(&Store::open(folder.path(), "s").expect("readable").1), [b"3", b"1"]);
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
        assert!(found.refused[1].contains("no retentive file"), "{:?}", found.refused);
        assert_eq!(fs::read(folder.path().join(".s.retentive.b.refused")).ok(), Some(b"my diary".to_vec()));
    }
}
