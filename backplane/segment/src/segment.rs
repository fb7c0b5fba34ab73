//! The memory of a segment: on the heap of one process, or in a file that two processes map.

#[cfg(not(loom))]
use core::mem::offset_of;
use core::ptr::NonNull;
use std::fmt;
use std::sync::Arc;

use crate::cells::{BoxedCells, BoxesCells, SegmentCells};
#[cfg(not(loom))]
use crate::cells::{as_words, box_words};
use crate::fault::SegmentError;
use crate::layout::{SEGMENT_BYTES, SEGMENT_BYTES_BOXES};
#[cfg(not(loom))]
use crate::{memfd::SharedMemory, sync::Ordering};

/// A segment. Clones are handles of the same memory; it is freed with the last handle and the last end.
#[derive(Clone)]
pub struct Segment {
    /// Points into what `keep` holds, for as long as `keep` lives.
    cells: NonNull<SegmentCells>,
    /// After the cells, in the same memory, if the CP has boxes.
    boxes: Option<NonNull<BoxesCells>>,
    keep: Keep,
}

#[derive(Clone)]
enum Keep {
    Heap(#[expect(dead_code, reason = "held only to keep the memory")] Arc<SegmentCells>),
    Boxed(#[expect(dead_code, reason = "held only to keep the memory")] Arc<BoxedCells>),
    #[cfg(not(loom))]
    Shared(Arc<SharedMemory>),
}

// SAFETY: the pointers lead to memory that `keep` keeps in place, and there is nothing but atomics in it, which may be
// used from any thread.
unsafe impl Send for Segment {}
// SAFETY: as for Send.
unsafe impl Sync for Segment {}

impl Segment {
    /// A segment on the heap: for tests, for the simulation in one thread, for Miri and loom.
    pub fn heap() -> Self {
        let memory = Arc::new(SegmentCells::default());
        Self { cells: NonNull::from(&*memory), boxes: None, keep: Keep::Heap(memory) }
    }

    /// The same for a CP that has boxes.
    pub fn heap_with_boxes() -> Self {
        let memory = Arc::new(BoxedCells::default());
        let boxes = Some(NonNull::from(&memory.boxes));
        Self { cells: NonNull::from(&memory.segment), boxes, keep: Keep::Boxed(memory) }
    }

    /// Claims the driver's end for this process, for its lifetime: the lock ends with the process, however it ends. On
    /// the heap there is only one process.
    pub(crate) fn claim(&self) -> Result<(), SegmentError> {
        match &self.keep {
            Keep::Heap(_) | Keep::Boxed(_) => Ok(()),
            #[cfg(not(loom))]
            Keep::Shared(memory) => memory.lock(),
        }
    }

    /// The cells, for this crate's ends.
    #[inline]
    pub(crate) fn cells(&self) -> &SegmentCells {
        // SAFETY: `cells` points to a `SegmentCells` in memory kept alive by `keep`: an `Arc` of it, or a mapping that
        // is large and aligned enough (checked in `from_shared`) and whose file is sealed against shrinking. It
        // consists of atomics only, so any content is valid, also while other threads or processes write to it.
        unsafe { self.cells.as_ref() }
    }

    /// The boxes, for this crate's ends.
    #[inline]
    pub(crate) fn boxes(&self) -> Option<&BoxesCells> {
        // SAFETY: as for the cells: the pointer is there only when `keep` holds a `BoxedCells`, or a mapping as long as
        // one, and leads to the boxes in it.
        self.boxes.map(|boxes| unsafe { boxes.as_ref() })
    }

    /// Size in bytes: it says whether there are boxes.
    pub fn bytes(&self) -> usize {
        if self.boxes.is_some() { SEGMENT_BYTES_BOXES } else { SEGMENT_BYTES }
    }
}

/// Sizes that a segment may have.
#[cfg(not(loom))]
const SIZES: [usize; 2] = [SEGMENT_BYTES, SEGMENT_BYTES_BOXES];

#[cfg(not(loom))]
impl Segment {
    /// A new shared segment: an anonymous file, fully allocated and sealed against any change of its size.
    ///
    /// # Errors
    /// The system's error when it has no memory or no descriptor left.
    pub fn create_shared() -> Result<Self, SegmentError> {
        Self::from_shared(SharedMemory::create(c"ob1-backplane", SEGMENT_BYTES)?)
    }

    /// The same for a CP that has boxes.
    ///
    /// # Errors
    /// [`SegmentError::Io`]: the system refuses the memory, its size or its seals.
    pub fn create_shared_with_boxes() -> Result<Self, SegmentError> {
        Self::from_shared(SharedMemory::create(c"ob1-backplane", SEGMENT_BYTES_BOXES)?)
    }

    /// Opens a shared segment that another process has made, through a path like `/proc/PID/fd/N`; its size says
    /// whether it has boxes.
    ///
    /// # Errors
    /// [`SegmentError::NotSealed`] or [`SegmentError::Size`] for a file that could be shrunk while mapped or is not a
    /// segment; the system's error when it cannot be opened.
    pub fn open(path: &std::path::Path) -> Result<Self, SegmentError> {
        Self::from_shared(SharedMemory::open(path, &SIZES)?)
    }

    /// The shared segment that another process has handed over.
    ///
    /// # Errors
    /// [`SegmentError::NotSealed`], [`SegmentError::Size`] or [`SegmentError::Header`]: it is no segment of this
    /// version, or could be shrunk while mapped; [`SegmentError::Io`]: it cannot be mapped.
    pub fn received(file: std::os::fd::OwnedFd) -> Result<Self, SegmentError> {
        Self::from_shared(SharedMemory::of(file, &SIZES)?)
    }

    fn from_shared(memory: SharedMemory) -> Result<Self, SegmentError> {
        let start = memory.start()?;
        let cells: NonNull<SegmentCells> = start.cast();
        if memory.len() < size_of::<SegmentCells>() || !cells.is_aligned() {
            return Err(SegmentError::Size { found: memory.len() as u64, expected: SEGMENT_BYTES as u64 });
        }
        let has_boxes = memory.len() >= size_of::<BoxedCells>();
        // SAFETY: the mapping has room for a `BoxedCells`: its boxes lie inside.
        let boxes = has_boxes.then(|| unsafe { start.byte_add(offset_of!(BoxedCells, boxes)).cast() });
        Ok(Self { cells, boxes, keep: Keep::Shared(Arc::new(memory)) })
    }

    /// The path under which another process of the same user opens this segment, as long as this process lives; `None`
    /// for a segment on the heap.
    pub fn path(&self) -> Option<std::path::PathBuf> {
        match &self.keep {
            Keep::Heap(_) | Keep::Boxed(_) => None,
            Keep::Shared(memory) => Some(memory.path()),
        }
    }

    /// The descriptor of a shared segment, for a runtime that passes it on.
    pub fn descriptor(&self) -> Option<std::os::fd::BorrowedFd<'_>> {
        match &self.keep {
            Keep::Heap(_) | Keep::Boxed(_) => None,
            Keep::Shared(memory) => Some(memory.descriptor()),
        }
    }

    /// Fills the segment with noise, word by word: what a faulty driver may do. For tests of its users.
    pub fn scribble(&self, mut noise: impl FnMut(usize) -> u64) {
        for (index, cell) in self.words().enumerate() {
            cell.store(noise(index * 8), Ordering::Relaxed);
        }
    }

    /// All words, in the order of the memory map.
    pub(crate) fn words(&self) -> impl Iterator<Item = &crate::sync::AtomicU64> {
        as_words(self.cells()).iter().chain(self.boxes().into_iter().flat_map(box_words))
    }

    /// Reads one word by its offset in the memory map, as a foreign driver would; `None` outside or if unaligned. For
    /// tests and tools.
    pub fn peek(&self, offset: usize) -> Option<u64> {
        self.word(offset).map(|cell| cell.load(Ordering::Acquire))
    }

    /// Writes one word by its offset in the memory map; false outside or if unaligned. For tests and tools.
    pub fn poke(&self, offset: usize, word: u64) -> bool {
        self.word(offset).map(|cell| cell.store(word, Ordering::Release)).is_some()
    }

    /// One word by its offset in the memory map, for tools that spin on it; `None` outside or if unaligned.
    pub fn word(&self, offset: usize) -> Option<&crate::sync::AtomicU64> {
        offset.is_multiple_of(8).then(|| self.words().nth(offset / 8)).flatten()
    }
}

impl fmt::Debug for Segment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.keep {
            Keep::Heap(_) | Keep::Boxed(_) => "heap",
            #[cfg(not(loom))]
            Keep::Shared(_) => "shared",
        };
        f.debug_tuple("Segment").field(&kind).finish()
    }
}
