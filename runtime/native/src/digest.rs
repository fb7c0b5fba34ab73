//! Digests by which programs and code files are told apart: 128 bits of the standard library's SipHash. Both ends are
//! the same executable, so it does not matter which SipHash that is.

use std::hash::{DefaultHasher, Hash, Hasher};

use ob1_cpu::engine::Plan;

/// Bytes of a digest.
pub(crate) const BYTES: usize = 16;

/// A digest in the making. What is written into it may be longer than memory has room for.
pub(crate) struct Digest([DefaultHasher; 2]);

impl Digest {
    /// A digest that begins with these bytes: whoever does not know them cannot compute it.
    pub(crate) fn new(secret: &[u8]) -> Self {
        let mut digest = Self([DefaultHasher::new(), DefaultHasher::new()]);
        for (which, hasher) in (1u8..).zip(&mut digest.0) {
            hasher.write_u8(which);
        }
        digest.add(secret);
        digest
    }

    pub(crate) fn add(&mut self, bytes: &[u8]) {
        for hasher in &mut self.0 {
            hasher.write(bytes);
        }
    }

    pub(crate) fn bytes(&self) -> [u8; BYTES] {
        let mut all = [0; BYTES];
        for (place, hasher) in all.chunks_exact_mut(8).zip(&self.0) {
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
        self.0[0].finish()
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
