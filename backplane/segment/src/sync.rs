//! The only import of atomics: `core` in the product, `loom` in the model test, so that loom sees the real code.

#[cfg(not(loom))]
pub(crate) use core::{
    hint::spin_loop,
    sync::atomic::{Ordering, fence},
};

#[cfg(loom)]
pub(crate) use loom::{
    hint::spin_loop,
    sync::atomic::{Ordering, fence},
};

/// A word of shared memory.
#[cfg(not(loom))]
pub type AtomicU64 = core::sync::atomic::AtomicU64;
/// A word of shared memory.
#[cfg(loom)]
pub type AtomicU64 = loom::sync::atomic::AtomicU64;

/// `N` atomic words in a row, all zero at first.
#[repr(transparent)]
pub(crate) struct Words<const N: usize>(pub(crate) [AtomicU64; N]);

impl<const N: usize> Default for Words<N> {
    fn default() -> Self {
        Self(core::array::from_fn(|_| AtomicU64::new(0)))
    }
}

/// Unused words that pad a block to its full size. They are atomics too, so that a reference to a block never covers
/// plain memory. The model does not need them.
#[cfg(not(loom))]
pub(crate) type Pad<const N: usize> = Words<N>;

/// See the product's `Pad`.
#[cfg(loom)]
#[derive(Default)]
pub(crate) struct Pad<const N: usize>;
