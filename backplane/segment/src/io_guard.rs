//! The memory that a PLC and its guardian share besides the image, and the guardian's end of both.
//!
//! The image is open to any program, so nothing in it decides who drives the outputs. That is decided in a separate
//! page that only the two map: it holds a sign of life of each, and whether the guardian has taken over. The guardian
//! takes over once and for good.

use core::sync::atomic::{AtomicU64, Ordering, fence};
use std::fmt;
use std::os::fd::{BorrowedFd, OwnedFd};

use crate::fault::SegmentError;
use crate::io_layout::IO_AREA_BYTES;
use crate::io_memory::{AREA_WORDS, Memory};
use crate::io_outputs::make_safe;

const AT_BEAT: usize = 0x000;
const AT_TAKEN: usize = 0x080;
const AT_GUARDIAN_BEAT: usize = 0x100;
const AT_LET_GO: usize = 0x180;

/// The page. Clones are handles of the same page.
#[derive(Clone)]
pub struct GuardPage {
    memory: Memory,
}

impl GuardPage {
    /// A page on the heap, for tests and simulations.
    pub fn heap() -> Self {
        Self { memory: Memory::heap() }
    }

    /// A page that can be handed over.
    ///
    /// # Errors
    /// The system's error if no memory or no descriptor is left.
    pub fn create_shared() -> Result<Self, SegmentError> {
        Ok(Self { memory: Memory::create(c"ob1-guard")? })
    }

    /// The page that was handed over.
    ///
    /// # Errors
    /// [`SegmentError`] if it is not a sealed file of the right size.
    pub fn received(file: OwnedFd) -> Result<Self, SegmentError> {
        Ok(Self { memory: Memory::received(file)? })
    }

    /// The descriptor, to hand over; `None` on the heap.
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        self.memory.descriptor()
    }

    fn taken(&self) -> &AtomicU64 {
        self.memory.cells().word::<AT_TAKEN>()
    }

    /// A sign of life of the scan. Only the scan thread calls it.
    #[inline]
    pub fn beat(&self) {
        let beat = self.memory.cells().word::<AT_BEAT>();
        beat.store(beat.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
    }

    /// A number that changes with each sign of life of the scan.
    pub fn beats(&self) -> u64 {
        self.memory.cells().word::<AT_BEAT>().load(Ordering::Relaxed)
    }

    /// A sign of life of the guardian.
    pub fn guardian_beat(&self) {
        self.memory.cells().word::<AT_GUARDIAN_BEAT>().fetch_add(1, Ordering::Relaxed);
    }

    /// A number that changes with each sign of life of a guardian.
    pub fn guardian_beats(&self) -> u64 {
        self.memory.cells().word::<AT_GUARDIAN_BEAT>().load(Ordering::Relaxed)
    }

    /// Records that the PLC itself has set its outputs to their safe state, for good.
    pub(crate) fn let_go(&self) {
        self.memory.cells().word::<AT_LET_GO>().store(1, Ordering::Release);
    }

    /// Whether the PLC has released the outputs: then there is nothing to take over.
    pub fn has_let_go(&self) -> bool {
        self.memory.cells().word::<AT_LET_GO>().load(Ordering::Acquire) != 0
    }

    /// Whether the guardian has taken over.
    #[inline]
    pub fn is_taken(&self) -> bool {
        self.taken().load(Ordering::Acquire) != 0
    }
}

/// The guardian's end: holds image and page as long as it lives.
pub struct Guardian {
    image: Memory,
    page: GuardPage,
    safe: Box<[u64; AREA_WORDS]>,
}

impl Guardian {
    /// A guardian of an image and a page that were handed over, with the safe state of [`crate::IoImage::safe_state`].
    ///
    /// # Errors
    /// [`SegmentError`] if one of them is not a sealed file of the right size.
    pub fn received(image: OwnedFd, page: OwnedFd, safe: &[u8]) -> Result<Self, SegmentError> {
        Ok(Self::over(Memory::received(image)?, GuardPage::received(page)?, safe))
    }

    pub(crate) fn over(image: Memory, page: GuardPage, safe: &[u8]) -> Self {
        let mut words = Box::new([0; AREA_WORDS]);
        for (word, bytes) in
            words.iter_mut().zip(safe.get(..safe.len().min(IO_AREA_BYTES)).unwrap_or_default().chunks(8))
        {
            let mut whole = [0; 8];
            whole.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
            *word = u64::from_ne_bytes(whole);
        }
        Self { image, page, safe: words }
    }

    /// The page shared with the PLC: signs of life, and who has the outputs.
    pub const fn page(&self) -> &GuardPage {
        &self.page
    }

    /// Takes the outputs over and sets them to their safe state. It may be repeated at any time: whatever was written
    /// there since is undone.
    pub fn take_over(&self) {
        self.page.taken().store(1, Ordering::Release);
        // The other half is in `IoImage::put`.
        fence(Ordering::SeqCst);
        make_safe(&self.image, &self.safe);
    }
}

impl fmt::Debug for GuardPage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GuardPage").field("taken", &self.is_taken()).finish_non_exhaustive()
    }
}

impl fmt::Debug for Guardian {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Guardian").field("page", &self.page).finish_non_exhaustive()
    }
}
