//! The window of a link: the snapshots that the scan makes for it, in shared memory that the link can only read.
//!
//! There are four slots, each with a sequence of its own. The scan fills them in turn and never waits: the slot it
//! fills is the one that has not been the newest for longest. The sequence is odd while a slot is filled, and then
//! twice the number of the snapshot; a reader takes the slot with the highest even one and reads the sequence again
//! when it has its copy. It must try again only if three whole snapshots were made meanwhile.
//!
//! The file is sealed with `F_SEAL_FUTURE_WRITE`: the mapping of the scan is the only one that ever writes.

use core::ptr::NonNull;
use std::fmt;
use std::sync::Arc;

#[cfg(not(loom))]
use crate::fault::SegmentError;
#[cfg(not(loom))]
use crate::memfd::SharedMemory;
use crate::sync::{AtomicU64, Ordering, fence, spin_loop};

/// Words of one snapshot, at most.
pub const WINDOW_WORDS: usize = if cfg!(loom) {
    2
} else if cfg!(miri) {
    64
} else {
    12 * 1024
};

/// Slots of a window.
const SLOTS: usize = if cfg!(loom) { 2 } else { 4 };
/// Words of the window's head, and of each slot's.
const HEAD: usize = if cfg!(loom) { 5 } else { 16 };
/// Words of a slot.
const SLOT: usize = HEAD + WINDOW_WORDS;
/// Words of a window.
const WORDS: usize = HEAD + SLOTS * SLOT;
/// First word: what this is.
const MAGIC: u64 = u64::from_be_bytes(*b"ob1 wind");
/// Second word: its layout.
const VERSION: u64 = 1;
/// How often a reader tries.
const TRIES: u32 = 16;

/// In a slot: its sequence, and what is said of the snapshot.
const SEQUENCE: usize = 0;
const GENERATION: usize = 1;
const SCAN: usize = 2;
const TIME: usize = 3;
const STATE: usize = 4;

/// What is said of a snapshot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WindowHead {
    /// The number of the list of pieces that are in it.
    pub generation: u64,
    /// Counts the cycle control points.
    pub scan: u64,
    /// When it was made, in nanoseconds of the runtime.
    pub time: u64,
    /// The operating state then, as a number that the two ends agree on.
    pub state: u64,
}

/// The memory of a window; clones lead to the same.
#[derive(Clone)]
struct Memory {
    /// Points to `WORDS` words in what `keep` holds, for as long as `keep` lives.
    words: NonNull<AtomicU64>,
    #[cfg_attr(loom, expect(dead_code, reason = "held only to keep the memory"))]
    keep: Keep,
}

#[derive(Clone)]
enum Keep {
    Heap(#[expect(dead_code, reason = "held only to keep the memory")] Arc<[AtomicU64]>),
    #[cfg(not(loom))]
    Shared(Arc<SharedMemory>),
}

// SAFETY: the pointer leads to memory that `keep` keeps in place, and there is nothing but atomics in it.
unsafe impl Send for Memory {}
// SAFETY: as for Send.
unsafe impl Sync for Memory {}

impl Memory {
    fn heap() -> Self {
        let words: Arc<[AtomicU64]> = (0..WORDS).map(|_| AtomicU64::new(0)).collect();
        Self { words: NonNull::from(&*words).cast(), keep: Keep::Heap(words) }
    }

    #[cfg(not(loom))]
    fn shared(memory: SharedMemory) -> Result<Self, SegmentError> {
        let words: NonNull<AtomicU64> = memory.start()?.cast();
        if memory.len() < WORDS * 8 || !words.is_aligned() {
            return Err(SegmentError::Size { found: memory.len() as u64, expected: (WORDS * 8) as u64 });
        }
        Ok(Self { words, keep: Keep::Shared(Arc::new(memory)) })
    }

    #[inline]
    fn words(&self) -> &[AtomicU64] {
        // SAFETY: `words` points to `WORDS` aligned words that `keep` keeps alive: an `Arc` of them, or a mapping that
        // is large enough (checked in `shared`) and whose file is sealed against shrinking. They are atomics, so any
        // content is valid, also while the scan of another process writes them. In a mapping for reading alone they are
        // only loaded, relaxed, which works on memory that cannot be written.
        unsafe { core::slice::from_raw_parts(self.words.as_ptr(), WORDS) }
    }

    /// Head and data of a slot.
    #[inline]
    fn slot(&self, index: usize) -> (&[AtomicU64], &[AtomicU64]) {
        let at = HEAD + (index % SLOTS) * SLOT;
        self.words().get(at..at + SLOT).unwrap_or_default().split_at(HEAD)
    }
}

/// The scan's end of a window. There is one.
pub struct WindowWriter {
    memory: Memory,
    made: u64,
}

impl WindowWriter {
    fn over(memory: Memory) -> Self {
        if let Some([magic, version, slots, words, ..]) = memory.words().get(..HEAD) {
            magic.store(MAGIC, Ordering::Relaxed);
            version.store(VERSION, Ordering::Relaxed);
            slots.store(SLOTS as u64, Ordering::Relaxed);
            words.store(WINDOW_WORDS as u64, Ordering::Relaxed);
        }
        Self { memory, made: 0 }
    }

    /// A window on the heap of one process.
    pub fn heap() -> Self {
        Self::over(Memory::heap())
    }

    /// A window that can be handed over.
    ///
    /// # Errors
    /// The system's error if no memory or no descriptor is left.
    #[cfg(not(loom))]
    pub fn create_shared() -> Result<Self, SegmentError> {
        Ok(Self::over(Memory::shared(SharedMemory::create_window(c"ob1-window", WORDS * 8)?)?))
    }

    /// A reader in this process.
    pub fn reader(&self) -> WindowReader {
        WindowReader { memory: self.memory.clone() }
    }

    /// Makes the next snapshot: `fill` gets its words, which hold an old one. Never waits.
    #[inline]
    pub fn put(&mut self, head: WindowHead, fill: impl FnOnce(&[AtomicU64])) {
        self.made = self.made.wrapping_add(1);
        let (about, data) = self.memory.slot((self.made % SLOTS as u64) as usize);
        let [sequence, generation, scan, time, state, ..] = about else { return };
        sequence.store(self.made.wrapping_mul(2).wrapping_sub(1), Ordering::Relaxed);
        // Pairs with the reader's fence: who reads one of the words below reads this odd number (or a later one)
        // afterwards.
        fence(Ordering::Release);
        generation.store(head.generation, Ordering::Relaxed);
        scan.store(head.scan, Ordering::Relaxed);
        time.store(head.time, Ordering::Relaxed);
        state.store(head.state, Ordering::Relaxed);
        fill(data);
        // Pairs with the reader's first fence: who reads this even number reads all the words above.
        sequence.store(self.made.wrapping_mul(2), Ordering::Release);
    }
}

/// A link's end of a window.
#[derive(Clone)]
pub struct WindowReader {
    memory: Memory,
}

impl WindowReader {
    /// The window that was handed over; it can only be read.
    ///
    /// # Errors
    /// [`SegmentError`] if it is not a sealed file of the right size, or not a window of this layout.
    #[cfg(not(loom))]
    pub fn received(file: std::os::fd::OwnedFd) -> Result<Self, SegmentError> {
        let memory = Memory::shared(SharedMemory::look_through(file, WORDS * 8)?)?;
        for (word, (field, expected)) in
            memory.words().iter().zip([("magic", MAGIC), ("version", VERSION), ("words", SLOTS as u64)])
        {
            let found = word.load(Ordering::Relaxed);
            if found != expected {
                return Err(SegmentError::Header { field, found });
            }
        }
        Ok(Self { memory })
    }

    /// The descriptor, to hand over; `None` on the heap.
    #[cfg(not(loom))]
    pub fn descriptor(&self) -> Option<std::os::fd::BorrowedFd<'_>> {
        match &self.memory.keep {
            Keep::Heap(_) => None,
            Keep::Shared(memory) => Some(memory.descriptor()),
        }
    }

    /// The slot with the newest whole snapshot, and its sequence.
    #[inline]
    fn newest_slot(&self) -> Option<(usize, u64)> {
        let mut newest = None;
        for index in 0..SLOTS {
            let (about, _) = self.memory.slot(index);
            let sequence = about.get(SEQUENCE)?.load(Ordering::Relaxed);
            if sequence != 0 && sequence & 1 == 0 && newest.is_none_or(|(_, most)| sequence > most) {
                newest = Some((index, sequence));
            }
        }
        newest
    }

    /// Calls `take` with the newest snapshot until what it saw was whole; that is its result. `None`: there is none, or
    /// the scan was faster than this reader in every try. Never waits.
    #[inline]
    pub fn read<T>(&self, mut take: impl FnMut(WindowHead, &[AtomicU64]) -> T) -> Option<T> {
        for _ in 0..TRIES {
            let (index, before) = self.newest_slot()?;
            // The load above is relaxed, because memory that cannot be written allows no other; the fence makes it an
            // acquire.
            fence(Ordering::Acquire);
            let (about, data) = self.memory.slot(index);
            let of = |at: usize| about.get(at).map_or(0, |word| word.load(Ordering::Relaxed));
            let head = WindowHead { generation: of(GENERATION), scan: of(SCAN), time: of(TIME), state: of(STATE) };
            let taken = take(head, data);
            fence(Ordering::Acquire);
            if of(SEQUENCE) == before {
                return Some(taken);
            }
            spin_loop();
        }
        None
    }

    /// What is said of the newest snapshot.
    pub fn newest(&self) -> Option<WindowHead> {
        self.read(|head, _| head)
    }
}

impl fmt::Debug for WindowWriter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WindowWriter").field("made", &self.made).finish_non_exhaustive()
    }
}

impl fmt::Debug for WindowReader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WindowReader").field("newest", &self.newest()).finish_non_exhaustive()
    }
}
