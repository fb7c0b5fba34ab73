//! The bounded sequence lock: one writer, one reader; neither ever waits for the other.
//!
//! The writer makes the sequence odd, writes, and makes it even again. The reader takes a copy between two readings of
//! the sequence; if a writer came between, it tries again, at most [`TRIES`] times, and then keeps its last copy. A
//! writer killed in the middle leaves an odd sequence: readers keep their last copy until the next writer has
//! written a *whole* new content, because the sequence stays odd until then.

use crate::sync::{AtomicU64, Ordering, Words, fence, spin_loop};

/// How often a reader tries before it keeps its last copy.
pub(crate) const TRIES: u32 = 4;

/// Whether a read saw the writer's newest complete content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Freshness {
    /// The copy is what the writer had completed last.
    Fresh,
    /// A writer was busy (or died) in every try: the copy is the reader's own last one.
    Stale,
}

/// Sequence and data of one sequence lock, as laid out in the segment.
#[repr(C)]
#[derive(Default)]
pub(crate) struct SeqCell<const N: usize> {
    pub(crate) sequence: AtomicU64,
    pub(crate) data: Words<N>,
}

impl<const N: usize> SeqCell<N> {
    /// Replaces the first words of the content. There must be one writer at a time.
    ///
    /// A sequence that a dead writer left odd goes to the next odd number, not to an even one: no reader may take the
    /// half-written content for whole.
    #[inline]
    pub(crate) fn write(&self, words: impl Iterator<Item = u64>) {
        let before = self.sequence.load(Ordering::Relaxed);
        let odd = before.wrapping_add(1).wrapping_add(before & 1);
        self.sequence.store(odd, Ordering::Relaxed);
        // Pairs with the reader's fence(Acquire): a reader of one of the words below reads `odd` (or later) afterwards.
        fence(Ordering::Release);
        for (cell, word) in self.data.0.iter().zip(words) {
            cell.store(word, Ordering::Relaxed);
        }
        // Pairs with the reader's first load (Acquire): a reader of this even number reads all the words above.
        self.sequence.store(odd.wrapping_add(1), Ordering::Release);
    }

    /// One try: copies the first words of the content, as many as `into` has. True if they are whole; if not, their
    /// content is undefined.
    #[cfg(not(loom))]
    pub(crate) fn copy(&self, into: &mut [u64]) -> bool {
        let copied = self.try_read(|cells| {
            for (word, cell) in into.iter_mut().zip(cells) {
                *word = cell.load(Ordering::Relaxed);
            }
        });
        copied.is_some()
    }

    /// All words, the sequence first: for tests that fill them with noise.
    #[cfg(not(loom))]
    pub(crate) fn words(&self) -> impl Iterator<Item = &AtomicU64> {
        core::iter::once(&self.sequence).chain(&self.data.0)
    }

    /// One try: takes a copy with `copy` and returns its sequence, or `None` if a writer was active (then the content
    /// of the copy is undefined).
    #[inline]
    fn try_read<T>(&self, copy: impl FnOnce(&[AtomicU64; N]) -> T) -> Option<(u64, T)> {
        let before = self.sequence.load(Ordering::Acquire);
        if before & 1 == 1 {
            return None;
        }
        let content = copy(&self.data.0);
        fence(Ordering::Acquire);
        (self.sequence.load(Ordering::Relaxed) == before).then_some((before, content))
    }
}

/// The reading end of one sequence lock: its own last copy.
pub(crate) struct SeqReader<const N: usize> {
    last: [u64; N],
    sequence: u64,
}

impl<const N: usize> SeqReader<N> {
    /// A reader that has seen nothing: its last copy is all zero.
    pub(crate) const fn new() -> Self {
        Self { last: [0; N], sequence: 0 }
    }

    /// Updates the first `words` words of the copy, if no writer interferes in every try.
    #[inline]
    pub(crate) fn read(&mut self, cell: &SeqCell<N>, words: usize) -> Freshness {
        if self.try_once(cell, words) { Freshness::Fresh } else { self.try_again(cell, words) }
    }

    /// Out of line: a writer seldom interferes, and what is left of [`Self::read`] is short enough for every caller.
    #[cold]
    #[inline(never)]
    fn try_again(&mut self, cell: &SeqCell<N>, words: usize) -> Freshness {
        for _ in 1..TRIES {
            spin_loop();
            if self.try_once(cell, words) {
                return Freshness::Fresh;
            }
        }
        Freshness::Stale
    }

    #[inline]
    fn try_once(&mut self, cell: &SeqCell<N>, words: usize) -> bool {
        // 16 bytes of registers are by far the most frequent size: two loads instead of a loop.
        if words == 2 { self.try_two(cell).is_some() } else { self.try_any(cell, words) }
    }

    /// One try to update the first two words of the copy; returns them.
    #[inline]
    pub(crate) fn try_two(&mut self, cell: &SeqCell<N>) -> Option<[u64; 2]> {
        let last = self.last.first_chunk_mut::<2>()?;
        let (sequence, pair) = cell.try_read(|cells| {
            cells.first_chunk::<2>().map(|pair| pair.each_ref().map(|cell| cell.load(Ordering::Relaxed)))
        })?;
        (*last, self.sequence) = (pair?, sequence);
        pair
    }

    #[inline(never)]
    fn try_any(&mut self, cell: &SeqCell<N>, words: usize) -> bool {
        let mut copy = [0; N];
        let read = cell.try_read(|cells| {
            for (word, cell) in copy.iter_mut().zip(cells).take(words) {
                *word = cell.load(Ordering::Relaxed);
            }
        });
        let Some((sequence, ())) = read else { return false };
        (self.last, self.sequence) = (copy, sequence);
        true
    }

    /// The last copy that was whole; zeros as long as nothing was read.
    #[inline]
    pub(crate) fn last(&self) -> &[u64; N] {
        &self.last
    }

    /// The (even) sequence the copy belongs to; 0 as long as nothing was read.
    pub(crate) fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Whether there is a whole content newer than the copy. While a writer is active there is none yet: a read would
    /// only compete with it, and the next check sees its end.
    #[inline]
    pub(crate) fn is_outdated(&self, cell: &SeqCell<N>) -> bool {
        let sequence = cell.sequence.load(Ordering::Relaxed);
        sequence != self.sequence && sequence & 1 == 0
    }
}
