//! Windows on the heap: the newest complete snapshot, in every state of the writer.

use crate::sync::Ordering;
use crate::{WINDOW_WORDS, WindowHead, WindowWriter};

fn head(scan: u64) -> WindowHead {
    WindowHead { generation: scan / 10, scan, time: scan * 7, state: scan % 3 }
}

#[test]
fn the_newest_whole_snapshot_is_read() {
    let mut writer = WindowWriter::heap();
    let reader = writer.reader();
    assert_eq!(reader.newest(), None, "there is none yet");
    for scan in 1..40 {
        let seen = reader.clone();
        writer.put(head(scan), |words| {
            assert_eq!(words.len(), WINDOW_WORDS);
            // While a slot is filled, the previous one is the newest.
            let before = seen.newest();
            assert_eq!(before, (scan > 1).then(|| head(scan - 1)));
            words.iter().take(3).for_each(|word| word.store(scan, Ordering::Relaxed));
        });
        let read = reader.read(|head, words| (head, [0, 1, 2].map(|at| words[at].load(Ordering::Relaxed))));
        assert_eq!(read, Some((head(scan), [scan; 3])));
    }
}

/// A writer that dies during a write leaves the previous snapshot; the reader gets no torn snapshot, even if the writer
/// is always faster.
#[test]
fn a_torn_snapshot_is_never_the_result() {
    let mut writer = WindowWriter::heap();
    let reader = writer.reader();
    writer.put(head(1), |_| {});
    let died = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        writer.put(head(2), |words| {
            words[0].store(99, Ordering::Relaxed);
            panic!("half way");
        });
    }));
    assert!(died.is_err());
    assert_eq!(reader.newest(), Some(head(1)));
    let mut tries = 0;
    let overtaken = reader.read(|head, _| {
        tries += 1;
        for more in 1..=4 {
            writer.put(WindowHead { scan: head.scan + more, ..head }, |_| {});
        }
    });
    assert!(overtaken.is_none() && tries > 1, "{tries} tries, each overtaken by four snapshots");
    let mut writer = WindowWriter::heap();
    let reader = writer.reader();
    writer.put(head(1), |_| {});
    let mut tries = 0;
    let kept = reader.read(|head, _| {
        tries += 1;
        (0..3).for_each(|_| writer.put(head, |_| {}));
        head
    });
    assert_eq!((kept, tries), (Some(head(1)), 1), "three snapshots meanwhile do not matter");
}
