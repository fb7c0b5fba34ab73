//! The memory of an image, and of its additional page: words of atomics, on the heap or in a sealed file.

use core::ptr::NonNull;
use core::sync::atomic::{AtomicU64, Ordering};
use std::os::fd::{BorrowedFd, OwnedFd};
use std::path::PathBuf;
use std::sync::Arc;

use crate::fault::SegmentError;
use crate::io_layout::{IO_AREA_BYTES, IO_IMAGE_BYTES};
use crate::memfd::SharedMemory;

pub(crate) const IMAGE_WORDS: usize = IO_IMAGE_BYTES / 8;
pub(crate) const AREA_WORDS: usize = IO_AREA_BYTES / 8;

/// The words of an image. Nothing but atomics: other programs write to it at any time.
#[repr(C, align(128))]
pub(crate) struct ImageCells(pub(crate) [AtomicU64; IMAGE_WORDS]);

impl ImageCells {
    /// `AT` is one of the constants above, checked when the program is compiled.
    #[inline]
    pub(crate) fn word<const AT: usize>(&self) -> &AtomicU64 {
        const { assert!(AT.is_multiple_of(8) && AT < IO_IMAGE_BYTES) };
        &self.0[AT / 8]
    }

    #[inline]
    pub(crate) fn area<const AT: usize>(&self) -> &[AtomicU64; AREA_WORDS] {
        const { assert!(AT.is_multiple_of(8) && AT + IO_AREA_BYTES <= IO_IMAGE_BYTES) };
        let (_, area) = self.0.split_at(AT / 8);
        area.first_chunk().expect("the area lies inside the image: asserted above")
    }
}

/// The content of such a memory.
///
/// # Safety
/// Nothing but atomics, in a fixed layout: any content is valid, also while others write. Aligned to no more than a
/// page.
pub(crate) unsafe trait Cells {
    /// Size of the file: at least that of the cells.
    const BYTES: usize;

    /// Zeros on the heap.
    fn zeros() -> Arc<Self>;
}

// SAFETY: an array of atomics.
unsafe impl Cells for ImageCells {
    const BYTES: usize = IO_IMAGE_BYTES;

    fn zeros() -> Arc<Self> {
        Arc::new(ImageCells([const { AtomicU64::new(0) }; IMAGE_WORDS]))
    }
}

enum Keep<C> {
    Heap(Arc<C>),
    Shared(Arc<SharedMemory>),
}

/// A handle of the memory; clones refer to the same memory.
pub(crate) struct Memory<C: Cells = ImageCells> {
    /// Points into what `keep` holds, for as long as `keep` lives.
    cells: NonNull<C>,
    keep: Keep<C>,
}

impl<C: Cells> Clone for Memory<C> {
    fn clone(&self) -> Self {
        let keep = match &self.keep {
            Keep::Heap(cells) => Keep::Heap(Arc::clone(cells)),
            Keep::Shared(memory) => Keep::Shared(Arc::clone(memory)),
        };
        Self { cells: self.cells, keep }
    }
}

// SAFETY: the pointer leads to memory that `keep` keeps in place, and there is nothing but atomics in it.
unsafe impl<C: Cells> Send for Memory<C> {}
// SAFETY: as for Send.
unsafe impl<C: Cells> Sync for Memory<C> {}

impl<C: Cells> Memory<C> {
    /// Zeros on the heap.
    pub(crate) fn heap() -> Self {
        let cells = C::zeros();
        Self { cells: NonNull::from(&*cells), keep: Keep::Heap(cells) }
    }

    /// Zeros in a new sealed file.
    pub(crate) fn create(name: &core::ffi::CStr) -> Result<Self, SegmentError> {
        Self::shared(SharedMemory::create(name, C::BYTES)?)
    }

    /// A sealed file that was handed over.
    pub(crate) fn received(file: OwnedFd) -> Result<Self, SegmentError> {
        Self::shared(SharedMemory::of(file, &[C::BYTES])?)
    }

    pub(crate) fn path(&self) -> Option<PathBuf> {
        match &self.keep {
            Keep::Heap(_) => None,
            Keep::Shared(memory) => Some(memory.path()),
        }
    }

    pub(crate) fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        match &self.keep {
            Keep::Heap(_) => None,
            Keep::Shared(memory) => Some(memory.descriptor()),
        }
    }

    pub(crate) fn shared(memory: SharedMemory) -> Result<Self, SegmentError> {
        let cells: NonNull<C> = memory.start()?.cast();
        if memory.len() < size_of::<C>() || !cells.is_aligned() {
            return Err(SegmentError::Size { found: memory.len() as u64, expected: C::BYTES as u64 });
        }
        Ok(Self { cells, keep: Keep::Shared(Arc::new(memory)) })
    }

    #[inline]
    pub(crate) fn cells(&self) -> &C {
        // SAFETY: `cells` points to cells kept alive by `keep`: an `Arc` of it, or a mapping of at least its
        // size at a page boundary whose file is sealed against shrinking. Atomics only: any content is valid, also
        // while others write.
        unsafe { self.cells.as_ref() }
    }
}

impl Memory {
    /// One word by its offset; `None` outside or if unaligned.
    pub(crate) fn peek(&self, offset: usize) -> Option<u64> {
        let cell = offset.is_multiple_of(8).then(|| self.cells().0.get(offset / 8)).flatten();
        cell.map(|cell| cell.load(Ordering::Acquire))
    }
}
