//! Whether a shared library is whole. The system's loader maps what the head of the file promises and does not look
//! whether the file has it: one that was cut off, by a full disk or a copy that broke off, would end the process with
//! SIGBUS.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

/// Bytes of the head of an ELF file with 64 bits.
const HEAD: usize = 64;
/// Bytes of an entry of its table of segments.
const ENTRY: usize = 56;
/// The kind of a segment that is loaded.
const LOADED: u32 = 1;

/// Why the library cannot be whole; `None`: nothing speaks against it. What is no library of this machine is left to
/// the loader, which says so.
pub(crate) fn cut_off(path: &Path) -> Option<String> {
    if ob1_process::files::is_fifo(path) {
        return Some(ob1_process::files::NO_FILE.to_owned());
    }
    let file = File::open(path).ok()?;
    let length = file.metadata().ok().filter(std::fs::Metadata::is_file)?.len();
    let mut head = [0; HEAD];
    file.read_exact_at(&mut head, 0).ok()?;
    // ELF, 64 bits, little-endian.
    if !head.starts_with(&[0x7F, b'E', b'L', b'F', 2, 1]) {
        return None;
    }
    let promised = segments_end(&file, &head).unwrap_or(u64::MAX);
    (promised > length).then(|| match promised {
        u64::MAX => format!("the file is cut off after {length} bytes"),
        _ => format!("the file is cut off: it has {length} of {promised} bytes"),
    })
}

/// The end of the last segment in the file; `None`: the table of segments is not there.
fn segments_end(file: &File, head: &[u8; HEAD]) -> Option<u64> {
    let at = number(head, 32)?;
    let word = |at: usize| Some(u16::from_le_bytes(*head.get(at..)?.first_chunk()?));
    let (size, count) = (usize::from(word(54)?), usize::from(word(56)?));
    let mut end = 0;
    for index in 0..count {
        let mut entry = [0; ENTRY];
        let place = at.checked_add((index * size) as u64)?;
        file.read_exact_at(&mut entry, place).ok()?;
        let kind = u32::from_le_bytes(*entry.first_chunk()?);
        if kind == LOADED {
            end = end.max(number(&entry, 8)?.checked_add(number(&entry, 32)?)?);
        }
    }
    Some(end)
}

fn number(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_is_whole_until_it_is_cut() {
        // A program is laid out like a library.
        let whole = std::fs::read(std::env::current_exe().expect("this test")).expect("readable");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.so");
        let told = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("room");
            cut_off(&path)
        };
        assert_eq!(told(&whole), None);
        assert_eq!(told(&whole[..HEAD]), Some("the file is cut off after 64 bytes".into()));
        let told_short = told(&whole[..10_000]).expect("cut off");
        assert!(told_short.starts_with("the file is cut off: it has 10000 of "), "{told_short}");
        for other in [&b""[..], b"\x7FELF", b"no library, but much longer than the head of one has to be, by far"] {
            assert_eq!(told(other), None, "the loader says what it is");
        }
        let mut lies = whole[..10_000].to_vec();
        lies[32..40].fill(0xFF);
        assert!(told(&lies).is_some());
        assert_eq!(cut_off(Path::new("/dev/null")), None);
    }
}
