//! A bad cable between two ptys: transfers bytes in both directions and sometimes corrupts one bit.
//!
//! Only single bits: the block check of 3964R, an exclusive or, detects each of them. The positions of the corrupted
//! bytes are the same in every run, but their content is not, because the two stations run in real time.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use crate::failure::{Outcome, step};

/// About one byte in this many is corrupted: some telegrams of 250 bytes need two attempts, few need three.
const ONE_IN: u64 = 2_000;

/// Number of corrupted bytes so far.
pub(super) struct Spoiled(Arc<AtomicU64>);

impl Spoiled {
    pub(super) fn count(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Waits until both ends exist, then transfers bytes until one of them closes. Their creators have set raw mode.
pub(super) fn join(a: &Path, b: &Path, patience: Duration) -> Outcome<Spoiled> {
    let (ends_a, ends_b) = (open(a, patience)?, open(b, patience)?);
    let spoiled = Arc::new(AtomicU64::new(0));
    for (seed, from, to) in [(1, &ends_a, &ends_b), (2, &ends_b, &ends_a)] {
        let clone = |end: &File| end.try_clone().map_err(|why| step(format!("the null modem: {why}")));
        let (from, to, count) = (clone(from)?, clone(to)?, Arc::clone(&spoiled));
        thread::spawn(move || carry(from, to, Cable::new(seed), &count));
    }
    Ok(Spoiled(spoiled))
}

fn open(path: &Path, patience: Duration) -> Outcome<File> {
    let start = Instant::now();
    loop {
        match OpenOptions::new().read(true).write(true).open(path) {
            Ok(end) => return Ok(end),
            Err(why) if start.elapsed() > patience => return Err(step(format!("{}: {why}", path.display()))),
            Err(_) => sleep(Duration::from_millis(20)),
        }
    }
}

fn carry(mut from: File, mut to: File, mut cable: Cable, spoiled: &AtomicU64) {
    let mut bytes = [0; 512];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        let hits = cable.spoil(&mut bytes[..count]);
        spoiled.fetch_add(hits, Ordering::Relaxed);
        if to.write_all(&bytes[..count]).is_err() {
            return;
        }
    }
}

/// Selects the byte and the bit to corrupt.
struct Cable(fastrand::Rng);

impl Cable {
    fn new(seed: u64) -> Self {
        Self(fastrand::Rng::with_seed(seed))
    }

    /// Inverts some bits; returns how many.
    fn spoil(&mut self, bytes: &mut [u8]) -> u64 {
        let mut hits = 0;
        for byte in bytes {
            if self.0.u64(..ONE_IN) == 0 {
                *byte ^= 1 << self.0.u32(..8);
                hits += 1;
            }
        }
        hits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn about_one_byte_in_so_many_loses_one_bit() {
        let mut bytes = vec![0; 1_000_000];
        let hits = Cable::new(1).spoil(&mut bytes);
        assert!((300..=700).contains(&hits), "{hits}");
        assert_eq!(bytes.iter().map(|byte| u64::from(byte.count_ones())).sum::<u64>(), hits);
        let mut again = vec![0; 1_000_000];
        Cable::new(1).spoil(&mut again);
        assert_eq!(again, bytes);
    }
}
