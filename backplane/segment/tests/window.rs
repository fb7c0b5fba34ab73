//! The window of a link: a process that gets it can only read; no snapshot is torn.

// A test has threads; the product code of this crate has none.
#![allow(clippy::disallowed_methods)]

#[path = "../examples/window.rs"]
mod window;

use std::fs::File;
use std::io::Write as _;
use std::sync::atomic::Ordering;

use ob1_backplane::{SegmentError, WindowHead, WindowReader, WindowWriter};
use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, memfd_create};

#[test]
fn a_link_looks_and_cannot_write() {
    let mut writer = WindowWriter::create_shared().unwrap();
    let file = writer.reader().descriptor().unwrap().try_clone_to_owned().unwrap();
    let reader = WindowReader::received(file.try_clone().unwrap()).unwrap();
    let head = WindowHead { generation: 3, scan: 4, time: 5, state: 2 };
    writer.put(head, |words| words[0].store(77, Ordering::Relaxed));
    assert_eq!(reader.read(|head, words| (head, words[0].load(Ordering::Relaxed))), Some((head, 77)));

    let seals = fcntl_get_seals(&file).unwrap();
    assert!(seals.contains(SealFlags::FUTURE_WRITE | SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL));
    // Neither a writable mapping nor a write is possible.
    let mapped = memmap2::MmapOptions::new().len(4096).map_raw(&file);
    assert_eq!(mapped.map(|_| ()).unwrap_err().kind(), std::io::ErrorKind::PermissionDenied);
    let mut file = File::from(file);
    assert_eq!(file.write(&[0; 8]).unwrap_err().kind(), std::io::ErrorKind::PermissionDenied);
    assert!(file.set_len(0).is_err());
    assert_eq!(reader.newest(), Some(head), "and the scan goes on writing");
    writer.put(WindowHead { scan: 5, ..head }, |_| {});
    assert_eq!(reader.newest().map(|head| head.scan), Some(5));
}

#[test]
fn what_is_no_window_is_refused() {
    let made = |seals: SealFlags, len: u64| {
        let file = memfd_create(c"test", MemfdFlags::ALLOW_SEALING).unwrap();
        rustix::fs::ftruncate(&file, len).unwrap();
        fcntl_add_seals(&file, seals).unwrap();
        WindowReader::received(file)
    };
    let all = SealFlags::FUTURE_WRITE | SealFlags::SHRINK | SealFlags::GROW;
    let window = WindowWriter::create_shared().unwrap();
    let len = File::from(window.reader().descriptor().unwrap().try_clone_to_owned().unwrap()).metadata().unwrap().len();
    assert!(matches!(made(SealFlags::SHRINK | SealFlags::GROW, len), Err(SegmentError::NotSealed)));
    assert!(matches!(made(all, len - 1), Err(SegmentError::Size { .. })));
    assert!(matches!(made(all, len), Err(SegmentError::Header { field: "magic", .. })));
    assert!(WindowReader::received(File::open("/dev/null").unwrap().into()).is_err());
}

/// A short version of the example, which does this ten million times.
#[test]
fn no_snapshot_is_torn() {
    for readers in [1, 32] {
        let (seen, snapshots) = window::race(readers, 100_000 / readers as u64);
        assert!(seen.iter().all(|seen| seen.torn == 0 && seen.back == 0), "{seen:?}");
        assert!(snapshots > 0);
    }
}
