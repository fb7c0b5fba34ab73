//! Digests by which programs and code files are told apart: 128 bits of the standard library's SipHash. Both ends are
//! the same executable, so it does not matter which SipHash that is.

use std::hash::{DefaultHasher, Hash, Hasher};

use ob1_cpu::engine::Plan;

/// Bytes of a digest.
pub(crate) const BYTES: usize = 16;

/// Bytes that are hashed at once: each call of SipHash costs as much as many bytes.
const CHUNK: usize = 4096;

/// A digest in the making. What is written into it may be longer than memory has room for.
pub(crate) struct Digest {
    hashers: [DefaultHasher; 2],
    /// Not hashed yet.
    waiting: Vec<u8>,
}

impl Digest {
    /// A digest that begins with these bytes: whoever does not know them cannot compute it.
    pub(crate) fn new(secret: &[u8]) -> Self {
        let hashers = [DefaultHasher::new(), DefaultHasher::new()];
        let mut digest = Self { hashers, waiting: Vec::with_capacity(CHUNK) };
        for (which, hasher) in (1u8..).zip(&mut digest.hashers) {
            hasher.write_u8(which);
        }
        digest.add(secret);
        digest
    }

    pub(crate) fn add(&mut self, bytes: &[u8]) {
        if self.waiting.len() + bytes.len() > CHUNK {
            self.hash(bytes);
        } else {
            self.waiting.extend_from_slice(bytes);
        }
    }

    /// Hashes what waits, then this.
    fn hash(&mut self, bytes: &[u8]) {
        for hasher in &mut self.hashers {
            hasher.write(&self.waiting);
            hasher.write(bytes);
        }
        self.waiting.clear();
    }

    pub(crate) fn bytes(mut self) -> [u8; BYTES] {
        self.hash(&[]);
        let mut all = [0; BYTES];
        for (place, hasher) in all.chunks_exact_mut(8).zip(&self.hashers) {
            place.copy_from_slice(&hasher.finish().to_le_bytes());
        }
        all
    }
}

impl Hasher for Digest {
    fn write(&mut self, bytes: &[u8]) {
        self.add(bytes);
    }

    fn finish(&self) -> u64 {
        let mut hasher = self.hashers[0].clone();
        hasher.write(&self.waiting);
        hasher.finish()
    }
}

/// 128 bits over everything in a loaded program that machine code depends on: code made for a plan with the same
/// fingerprint is code of this plan.
#[must_use]
pub fn fingerprint(plan: &Plan) -> [u8; BYTES] {
    let mut digest = Digest::new(b"plan");
    let Plan {
        blocks,
        signatures,
        areas,
        data,
        // Where wrong code would trap; right code does not depend on it.
        arena_reserved: _,
        // What the runtime has room for.
        stack_per_block: _,
        // It is one of the signatures.
        ob1: _,
        accumulators,
        timers,
        counters,
        nesting_depth,
        frames,
        // Grows while it runs.
        executed: _,
    } = plan;
    (blocks, signatures, areas, data).hash(&mut digest);
    (accumulators, timers, counters, nesting_depth, frames).hash(&mut digest);
    digest.bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_counts_however_it_is_written() {
        let digest = |bytes: &[u8], pieces: usize| {
            let mut digest = Digest::new(b"test");
            bytes.chunks(pieces).for_each(|piece| digest.add(piece));
            (digest.finish(), digest.bytes())
        };
        let bytes: Vec<u8> = (0..3 * CHUNK + 5).map(|at| at as u8).collect();
        let whole = digest(&bytes, bytes.len());
        for pieces in [1, 7, CHUNK - 1, CHUNK, CHUNK + 1] {
            assert_eq!(digest(&bytes, pieces), whole, "in pieces of {pieces}");
        }
        for at in [0, CHUNK - 5, CHUNK, 2 * CHUNK, bytes.len() - 1] {
            let mut other = bytes.clone();
            other[at] ^= 1;
            assert_ne!(digest(&other, 9).1, whole.1, "byte {at}");
        }
    }
}
