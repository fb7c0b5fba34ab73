//! The way to the disk, also for crates that are not allowed to touch it by themselves. Files are read with a limit,
//! and written so that a name always stands for a whole content.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::Path;

/// More than any file that people write or tools make of a program, in bytes.
pub const LONGEST: u64 = 64 << 20;

/// Why a FIFO is not read.
pub const NO_FILE: &str = "it is a FIFO, not a file";

/// True for a FIFO in a folder: opening it waits for a writer, perhaps for ever. A pipe that a shell makes
/// (`/dev/stdin`, `<(...)`) is in no folder, and it has a writer.
pub fn is_fifo(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|file| file.file_type().is_fifo()) && fs::canonicalize(path).is_ok()
}

/// The content of a file of at most so many bytes. A device without an end is not read for ever.
///
/// # Errors
/// What the system says; `FileTooLarge`; `InvalidInput`: it is a FIFO.
pub fn read(path: &Path, longest: u64) -> io::Result<Vec<u8>> {
    if is_fifo(path) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, NO_FILE));
    }
    let file = File::open(path)?;
    let expected = file.metadata()?.len().min(longest);
    let mut bytes = Vec::with_capacity(expected as usize + 1);
    let read = file.take(longest + 1).read_to_end(&mut bytes)?;
    if read as u64 > longest {
        let why = format!("it is longer than {} MiB", longest >> 20);
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, why));
    }
    Ok(bytes)
}

/// The same as text.
///
/// # Errors
/// As [`read`]; `InvalidData`: it is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path, LONGEST)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes()[..at].iter().filter(|byte| **byte == b'\n').count() + 1;
        io::Error::new(io::ErrorKind::InvalidData, format!("line {line} is not UTF-8"))
    })
}

/// Gives a file this content: written beside it, synced, renamed; it is on the disk when this returns.
///
/// # Errors
/// What the system says; what was there before stays.
pub fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut beside = OsString::from(path);
    beside.push(".new");
    replace_by(Path::new(&beside), path, content, 0o666)
}

/// Writes a file that a user has named. A file that is there is replaced as a whole and keeps its rights. Anything else
/// (`/dev/stdout`, a FIFO, a link) is written into, and so is a file in a folder where nothing may be created.
///
/// # Errors
/// What the system says. A file that could not be replaced stays; one that is written into may end half-way.
pub fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    let mode = match fs::symlink_metadata(path) {
        Ok(there) if there.is_file() => there.permissions().mode() & 0o777,
        Ok(_) => return fs::write(path, content),
        Err(_) => 0o666,
    };
    let mut beside = OsString::from(".");
    beside.push(path.file_name().unwrap_or_default());
    beside.push(format!(".{}.new", std::process::id()));
    match replace_by(&path.with_file_name(beside), path, content, mode) {
        // The file may be a mount point of its own, as in a container.
        Err(error) if matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ResourceBusy) => {
            fs::write(path, content)
        }
        written => written,
    }
}

/// The same as [`replace`] by way of this name, with these rights.
///
/// # Errors
/// What the system says of writing or renaming, as with [`replace`]; `path` is then as it was.
pub fn replace_by(beside: &Path, path: &Path, content: &[u8], mode: u32) -> io::Result<()> {
    let written = fresh(beside, mode).and_then(|mut file| {
        file.write_all(content)?;
        file.sync_all()?;
        fs::rename(beside, path)
    });
    if let Err(error) = written {
        // Half a file takes the room the next one needs.
        let _ = fs::remove_file(beside);
        return Err(error);
    }
    sync_folder_of(path)
}

/// A new file; what stands in its place, whatever it is, is removed and never written into.
pub fn fresh(path: &Path, mode: u32) -> io::Result<File> {
    let _ = fs::remove_file(path).or_else(|_| fs::remove_dir(path));
    OpenOptions::new().write(true).create_new(true).mode(mode).open(path)
}

/// The checksum of what is kept in files: FNV-1a, 64 bits.
pub fn checksum(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xCBF2_9CE4_8422_2325, |sum, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}

/// What was renamed or removed there outlasts a power failure.
pub fn sync_folder_of(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_a_bare_name_is_the_current_one() {
        sync_folder_of(Path::new("retentive.a")).expect("the current folder");
        let folder = tempfile::tempdir().expect("a folder");
        sync_folder_of(&folder.path().join("x")).expect("it exists");
        sync_folder_of(&folder.path().join("y/x")).expect_err("it does not exist");
    }

    #[test]
    fn a_file_without_an_end_ends() {
        let refused = read(Path::new("/dev/zero"), 1 << 20).expect_err("endless");
        assert_eq!(
            (refused.kind(), refused.to_string().as_str()),
            (io::ErrorKind::FileTooLarge, "it is longer than 1 MiB")
        );
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x");
        fs::write(&path, [0; 1000]).expect("room");
        assert_eq!(read(&path, 1000).expect("not longer").len(), 1000);
        assert!(read(&path, 999).is_err());
        fs::write(&path, b"a\nb\n\xFF").expect("room");
        assert_eq!(read_text(&path).expect_err("no text").to_string(), "line 3 is not UTF-8");
    }

    #[test]
    fn a_fifo_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x");
        let made = std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo is there");
        assert!(made.success());
        assert_eq!(read(&path, 1).expect_err("nobody writes").to_string(), NO_FILE);
    }

    /// A file is replaced and keeps its rights; a link or a FIFO is written into and stays one.
    #[test]
    fn a_file_is_replaced_and_anything_else_is_written_into() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, link) = (folder.path().join("x"), folder.path().join("link"));
        write(&path, b"first").expect("a new file");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("mine");
        write(&path, b"second").expect("replaced");
        assert_eq!(fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o600);
        std::os::unix::fs::symlink(&path, &link).expect("a link");
        write(&link, b"third").expect("written through it");
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&path).expect("there"), "third");
        let fifo = folder.path().join("fifo");
        let made = std::process::Command::new("mkfifo").arg(&fifo).status().expect("mkfifo is there");
        assert!(made.success());
        let reader = std::process::Command::new("cat").arg(&fifo).stdout(std::process::Stdio::piped()).spawn();
        let reader = reader.expect("cat is there");
        write(&fifo, b"fourth").expect("it is read");
        assert_eq!(reader.wait_with_output().expect("it ends").stdout, b"fourth");
        assert!(fs::metadata(&fifo).expect("there").file_type().is_fifo());
        assert!(write(Path::new("/dev/full"), b"no").is_err() && !Path::new("/dev/full").is_file());
        assert!(write(&folder.path().join("nowhere/x"), b"no").is_err());
        assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 3, "nothing is left over");
    }

    /// Whatever stands where the new content is prepared: it is neither followed nor written into nor waited for.
    #[test]
    fn a_file_is_replaced_as_a_whole_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, beside, other) = (folder.path().join("x"), folder.path().join("x.new"), folder.path().join("other"));
        fs::write(&other, "mine").expect("room");
        let traps: [fn(&Path, &Path); 3] = [
            |beside, other| std::os::unix::fs::symlink(other, beside).expect("a link"),
            |beside, _| {
                let made = std::process::Command::new("mkfifo").arg(beside).status().expect("mkfifo is there");
                assert!(made.success());
            },
            |beside, _| fs::create_dir(beside).expect("a folder"),
        ];
        for (number, trap) in traps.into_iter().enumerate() {
            trap(&beside, &other);
            let content = number.to_string();
            replace(&path, content.as_bytes()).expect("replaced");
            assert_eq!(fs::read_to_string(&path).expect("there"), content);
            assert_eq!(fs::read_to_string(&other).expect("there"), "mine");
            assert!(fs::symlink_metadata(&beside).is_err());
        }
        fs::create_dir(folder.path().join("full"))
            .and_then(|()| fs::create_dir(folder.path().join("full/x")))
            .expect("room");
        assert!(replace(&folder.path().join("full"), b"no").is_err(), "a folder stays");
        assert!(fs::symlink_metadata(folder.path().join("full.new")).is_err(), "nothing is left of it");
    }
}
