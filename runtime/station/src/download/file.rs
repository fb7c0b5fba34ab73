//! The file of downloads. A station that cannot read it starts from its sources, and says so.
//!
//! `ob1 load`, the version, a checksum over what follows, then block after block: kind, number, 1 and length and bytes,
//! or 0 for one that was deleted. All numbers are big-endian.

use std::fs;
use std::io;
use std::path::Path;

use ob1_model::{BlockId, BlockKind};

use super::changes::Changes;

const MAGIC: [u8; 8] = *b"ob1 load";
const VERSION: u8 = 1;

/// What the file holds; nothing where there is no file.
///
/// # Errors
/// Why it cannot be read, in one sentence.
pub fn read(path: &Path) -> Result<Changes, String> {
    let about = match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Changes::default()),
        Err(error) => return Err(error.to_string()),
        Ok(about) => about,
    };
    if !about.is_file() {
        return Err("it is not a file of downloads".into());
    }
    decode(&ob1_process::files::read(path, ob1_process::files::LONGEST).map_err(|error| error.to_string())?)
}

/// Writes the file: under another name, synced, renamed. Without changes there is no file.
///
/// # Errors
/// The folder or the file cannot be written, or the old file not removed; what the system says.
pub fn write(path: &Path, changes: &Changes) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    if !changes.is_empty() {
        return ob1_process::files::replace(path, &encode(changes));
    }
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => ob1_process::files::sync_folder_of(path),
    }
}

fn encode(changes: &Changes) -> Vec<u8> {
    let mut body = Vec::new();
    for (id, change) in &changes.0 {
        body.push(id.kind as u8);
        body.extend_from_slice(&id.number.to_be_bytes());
        match change {
            None => body.push(0),
            Some(bytes) => {
                body.push(1);
                body.extend_from_slice(&(bytes.len() as u32).to_be_bytes());
                body.extend_from_slice(bytes);
            }
        }
    }
    let mut out = MAGIC.to_vec();
    out.push(VERSION);
    out.extend_from_slice(&checksum(&body).to_be_bytes());
    out.extend_from_slice(&body);
    out
}

fn decode(bytes: &[u8]) -> Result<Changes, String> {
    let damaged = || "it is cut off or damaged".to_owned();
    let rest = bytes.strip_prefix(&MAGIC).ok_or("it is not a file of downloads")?;
    let (version, rest) = rest.split_first().ok_or_else(damaged)?;
    if *version != VERSION {
        return Err(format!("it has version {version}, this software reads version {VERSION}"));
    }
    let (sum, mut rest) = rest.split_first_chunk::<8>().ok_or_else(damaged)?;
    if u64::from_be_bytes(*sum) != checksum(rest) {
        return Err(damaged());
    }
    let mut changes = Changes::default();
    while let Some((&[kind, high, low, is_there], after)) = rest.split_first_chunk::<4>() {
        let kind = BlockKind::from_repr(kind).ok_or_else(damaged)?;
        let id = BlockId::new(kind, u16::from_be_bytes([high, low]));
        rest = after;
        if is_there == 0 {
            changes.delete(id);
            continue;
        }
        let (len, after) = rest.split_first_chunk::<4>().ok_or_else(damaged)?;
        let (block, after) = after.split_at_checked(u32::from_be_bytes(*len) as usize).ok_or_else(damaged)?;
        changes.put(id, block.to_vec());
        rest = after;
    }
    if rest.is_empty() { Ok(changes) } else { Err(damaged()) }
}

fn checksum(body: &[u8]) -> u64 {
    ob1_process::files::checksum(body.iter().copied())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes() -> Changes {
        let mut changes = Changes::default();
        changes.put(BlockId::new(BlockKind::Fc, 5), (0..200).collect());
        changes.put(BlockId::new(BlockKind::Db, 65_535), Vec::new());
        changes.delete(BlockId::new(BlockKind::Ob, 35));
        changes
    }

    #[test]
    fn what_was_written_comes_back_and_nothing_is_no_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = super::super::path(&folder.path().join("made"), "press");
        assert_eq!(read(&path), Ok(Changes::default()));
        write(&path, &changes()).expect("written");
        assert_eq!(read(&path), Ok(changes()));
        write(&path, &Changes::default()).expect("removed");
        assert!(!path.exists());
        write(&path, &Changes::default()).expect("nothing to remove");
        assert!(read(folder.path()).is_err(), "a folder");
    }

    #[test]
    fn what_is_not_whole_is_refused() {
        let good = encode(&changes());
        assert_eq!(decode(&good), Ok(changes()));
        for len in 0..good.len() {
            assert!(decode(&good[..len]).is_err(), "{len}");
        }
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0x10;
            assert!(decode(&bad).is_err(), "{at}");
        }
        // With the right checksum over nonsense.
        for body in [&[9, 0, 1, 0][..], &[0, 0, 1, 1, 0xFF, 0xFF, 0xFF, 0xFF], &[0, 0, 1], &[0, 0, 1, 1, 0, 0]] {
            let mut bytes = MAGIC.to_vec();
            bytes.push(VERSION);
            bytes.extend_from_slice(&checksum(body).to_be_bytes());
            bytes.extend_from_slice(body);
            assert!(decode(&bytes).is_err(), "{body:?}");
        }
    }
}
