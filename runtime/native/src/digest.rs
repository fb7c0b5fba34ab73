//! What tells two programs, and two code files, apart: 128 bits of SipHash, as the standard library has it. Both ends
//! are the same executable, so that nothing depends on which SipHash it is.

use std::fmt::{self, Write};
use std::hash::{DefaultHasher, Hasher};

use ob1_cpu::engine::Plan;

/// Bytes of a digest.
pub(crate) const BYTES: usize = 16;

/// A digest in the making. What is written into it may be longer than memory has room for.
pub(crate) struct Digest([DefaultHasher; 2]);

impl Digest {
    /// One that begins with these bytes: nobody who does not know them can make it.
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

impl Write for Digest {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.add(text.as_bytes());
        Ok(())
    }
}

/// Everything machine code depends on of a loaded program, in 128 bits: code that was made of a plan with the same
/// fingerprint is code of this plan.
#[must_use]
pub fn fingerprint(plan: &Plan) -> [u8; BYTES] {
    let mut digest = Digest::new(b"plan");
    let Plan {
        blocks,
        signatures,
        areas,
        data,
        // Where code that is wrong would trap: nothing that is right depends on it.
        arena_reserved: _,
        // What the runtime has room for.
        stack_per_block: _,
        accumulators,
        timers,
        counters,
        nesting_depth,
        frames,
        // Grows while it runs.
        executed: _,
    } = plan;
    // A digest takes whatever is written.
    let _ = write!(
        digest,
        "{blocks:?}{signatures:?}{areas:?}{data:?}{accumulators} {timers} {counters} {nesting_depth} {frames}"
    );
    digest.bytes()
}
