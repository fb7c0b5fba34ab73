//! Reads a window at full speed while a writer fills it at full speed, and checks every word.
//!
//! `cargo run --release -p ob1-backplane --example window -- READS READERS`: by default 10,000,000 reads by one reader.
//! Ends with an error at the first torn snapshot.

#![allow(clippy::disallowed_methods, reason = "an example has threads; the product code of this crate has none")]

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use ob1_backplane::{WindowHead, WindowReader, WindowWriter};

/// Words of the pattern.
const WORDS: usize = 64;

/// What one reader has counted.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seen {
    /// Snapshots that were whole: all words of one scan.
    pub reads: u64,
    /// Reads in which the writer was faster in every try.
    pub busy: u64,
    /// Snapshots with words of two scans.
    pub torn: u64,
    /// Snapshots older than one seen before.
    pub back: u64,
}

fn look(reader: &WindowReader, reads: u64) -> Seen {
    let (mut seen, mut last) = (Seen::default(), 0);
    while seen.reads < reads {
        let read = reader.read(|head, words| {
            let whole = words.iter().take(WORDS).all(|word| word.load(Ordering::Relaxed) == head.scan);
            (head, whole)
        });
        match read {
            None => {
                seen.busy += 1;
                thread::yield_now();
            }
            Some((head, whole)) => {
                seen.reads += 1;
                seen.torn += u64::from(!whole || head.time != head.scan.wrapping_mul(3));
                seen.back += u64::from(head.scan < last);
                last = head.scan;
            }
        }
    }
    seen
}

/// Runs `readers` readers with `reads` reads each beside one writer. Returns what each counted and the number of
/// snapshots.
///
/// # Panics
/// Panics without shared memory or when no thread can be started.
#[must_use]
pub(crate) fn race(readers: usize, reads: u64) -> (Vec<Seen>, u64) {
    let mut writer = WindowWriter::create_shared().expect("shared memory");
    let reader = writer.reader();
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        let made = scope.spawn(|| {
            let mut scan = 0u64;
            while !done.load(Ordering::Relaxed) {
                scan += 1;
                let head = WindowHead { generation: 1, scan, time: scan.wrapping_mul(3), state: 0 };
                writer.put(head, |words| words.iter().take(WORDS).for_each(|word| word.store(scan, Ordering::Relaxed)));
            }
            scan
        });
        let readers: Vec<_> = (0..readers)
            .map(|_| {
                let file = reader.descriptor().expect("shared").try_clone_to_owned().expect("a descriptor");
                let through = WindowReader::received(file).expect("a window");
                scope.spawn(move || look(&through, reads))
            })
            .collect();
        let seen = readers.into_iter().map(|reader| reader.join().expect("it ends")).collect();
        done.store(true, Ordering::Relaxed);
        (seen, made.join().expect("it ends"))
    })
}

#[allow(dead_code, reason = "a test has this file as a module")]
fn main() {
    let mut numbers = std::env::args().skip(1).map(|arg| arg.parse().expect("a number"));
    let (reads, readers) = (numbers.next().unwrap_or(10_000_000), numbers.next().unwrap_or(1));
    let (seen, snapshots) = race(readers as usize, reads);
    println!("{snapshots} snapshots of {WORDS} words; {seen:?}");
    assert!(seen.iter().all(|seen| seen.torn == 0 && seen.back == 0), "a torn snapshot");
}
