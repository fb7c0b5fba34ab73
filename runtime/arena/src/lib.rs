//! A fence: unsafe code, so that the CPU has none. The bytes of a CPU's memory: from the heap, or from another owner,
//! as a piece at the beginning of a reservation in which every other byte traps. The CPU sees bytes; it does not learn
//! where they are from.

// Fenced by the house rules: bytes that do not come from the allocator have no safe owner.
#![allow(unsafe_code)]

use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

/// Bytes at a place that never changes.
pub struct Arena {
    bytes: NonNull<[u8]>,
    reserved: u64,
    /// Dropped after the last use of `bytes`.
    owner: Owner,
}

/// The owner of the bytes, who frees them.
enum Owner {
    Heap,
    Other(#[expect(dead_code, reason = "its drop gives the bytes back")] Box<dyn Send + Sync>),
}

// SAFETY: an arena owns its bytes alone, as a boxed slice does; its owner is Send itself.
unsafe impl Send for Arena {}
// SAFETY: a shared arena gives out shared slices only; its owner is Sync itself.
unsafe impl Sync for Arena {}

impl Arena {
    /// `len` bytes of 0 from the heap.
    #[must_use]
    pub fn new(len: usize) -> Self {
        let bytes = Box::into_raw(vec![0u8; len].into_boxed_slice());
        // SAFETY: a box is never null.
        let bytes = unsafe { NonNull::new_unchecked(bytes) };
        Self { bytes, reserved: len as u64, owner: Owner::Heap }
    }

    /// Bytes that somebody else owns, at the beginning of `reserved` bytes of address space. `owner` gives them back
    /// when it is dropped.
    ///
    /// # Safety
    /// `bytes` can be read and written until `owner` is dropped, nobody else does, and each access to the `reserved`
    /// bytes from their beginning reaches them or traps.
    #[must_use]
    pub unsafe fn from_parts(bytes: NonNull<[u8]>, reserved: u64, owner: Box<dyn Send + Sync>) -> Self {
        Self { bytes, reserved, owner: Owner::Other(owner) }
    }

    /// Bytes of address space from the first on in which an access reaches the arena or traps.
    #[must_use]
    pub const fn reserved(&self) -> u64 {
        self.reserved
    }
}

impl Deref for Arena {
    type Target = [u8];

    #[inline(always)]
    fn deref(&self) -> &[u8] {
        // SAFETY: the bytes live as long as the arena, and are borrowed as it is.
        unsafe { self.bytes.as_ref() }
    }
}

impl DerefMut for Arena {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [u8] {
        // SAFETY: as above; the exclusive borrow of the arena is that of its bytes.
        unsafe { self.bytes.as_mut() }
    }
}

impl Drop for Arena {
    fn drop(&mut self) {
        if matches!(self.owner, Owner::Heap) {
            // SAFETY: these bytes came out of a box, whole, and are used no more.
            drop(unsafe { Box::from_raw(self.bytes.as_ptr()) });
        }
    }
}

impl std::fmt::Debug for Arena {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Arena").field("len", &self.len()).field("reserved", &self.reserved).finish()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn bytes_of_the_heap() {
        let mut arena = Arena::new(10);
        arena[9] = 7;
        arena[..2].copy_from_slice(&[1, 2]);
        assert_eq!((&arena[..], arena.reserved()), (&[1, 2, 0, 0, 0, 0, 0, 0, 0, 7][..], 10));
        assert_eq!(Arena::new(0).len(), 0);
    }

    #[test]
    fn bytes_of_another_owner_are_given_back_once() {
        struct Gives(NonNull<[u8]>, Arc<AtomicBool>);
        // SAFETY: nobody else has the bytes.
        unsafe impl Send for Gives {}
        // SAFETY: as for Send.
        unsafe impl Sync for Gives {}
        impl Drop for Gives {
            fn drop(&mut self) {
                assert!(!self.1.swap(true, Ordering::Relaxed));
                // SAFETY: they were leaked below, and are given back once.
                drop(unsafe { Box::from_raw(self.0.as_ptr()) });
            }
        }
        let back = Arc::new(AtomicBool::new(false));
        let bytes = NonNull::from(Box::leak(vec![3; 4].into_boxed_slice()));
        let gives = Gives(bytes, Arc::clone(&back));
        // SAFETY: leaked bytes stay where they are, and their owner looks at them only to give them back.
        let mut arena = unsafe { Arena::from_parts(bytes, 4, Box::new(gives)) };
        arena[1] = 5;
        assert_eq!((&arena[..], back.load(Ordering::Relaxed)), (&[3, 5, 3, 3][..], false));
        drop(arena);
        assert!(back.load(Ordering::Relaxed));
    }
}
