//! The registers of a module as one end writes them: the periphery bytes of one direction.

use crate::bytes::overlay;
use crate::cells::IO_WORDS;
use crate::layout::{IO_BYTES_MAX, IO_BYTES_MIN};
use crate::seqlock::SeqCell;

/// Number of register bytes each way, checked: 8 to 64.
#[derive(Clone, Copy, Debug)]
pub(crate) struct IoBytes(usize);

impl IoBytes {
    pub(crate) const MAX: Self = Self(IO_BYTES_MAX);

    pub(crate) fn new(bytes: usize) -> Option<Self> {
        (IO_BYTES_MIN..=IO_BYTES_MAX).contains(&bytes).then_some(Self(bytes))
    }

    pub(crate) fn get(self) -> usize {
        self.0
    }

    /// Words that hold them.
    pub(crate) fn words(self) -> usize {
        self.0.div_ceil(8)
    }
}

/// The writing end of one direction. It remembers what it has written last and does not write when nothing has changed,
/// so that an idle scan does not keep the driver awake.
pub(crate) struct RegisterWriter {
    last: [u64; IO_WORDS],
    io: IoBytes,
}

impl RegisterWriter {
    /// A writer that has written zeros.
    pub(crate) fn new(io: IoBytes) -> Self {
        Self { last: [0; IO_WORDS], io }
    }

    /// Zeroes all registers, and completes a write that a dead writer may have left unfinished.
    pub(crate) fn clear(&mut self, cell: &SeqCell<IO_WORDS>) {
        self.last = [0; IO_WORDS];
        self.rewrite(cell);
    }

    /// Writes the last content of all registers again.
    pub(crate) fn rewrite(&mut self, cell: &SeqCell<IO_WORDS>) {
        cell.write(self.last.into_iter());
    }

    /// Writes `data` over the beginning of the registers; true if that changed anything. Bytes that `data` does not
    /// reach keep their value, bytes beyond the registers are ignored.
    #[inline]
    pub(crate) fn write(&mut self, cell: &SeqCell<IO_WORDS>, data: &[u8]) -> bool {
        if self.io.get() == 16
            && let ([low, high], []) = data.as_chunks::<8>()
        {
            let words = [u64::from_ne_bytes(*low), u64::from_ne_bytes(*high)];
            return self.replace(cell, words);
        }
        self.write_any(cell, data)
    }

    #[inline]
    fn replace<const N: usize>(&mut self, cell: &SeqCell<IO_WORDS>, words: [u64; N]) -> bool {
        let Some(last) = self.last.first_chunk_mut::<N>() else { return false };
        if *last == words {
            return false;
        }
        *last = words;
        cell.write(words.into_iter());
        true
    }

    fn write_any(&mut self, cell: &SeqCell<IO_WORDS>, data: &[u8]) -> bool {
        let mut words = self.last;
        let len = data.len().min(self.io.get());
        overlay(&mut words, data.get(..len).unwrap_or_default());
        if words == self.last {
            return false;
        }
        self.last = words;
        cell.write(words.into_iter().take(self.io.words()));
        true
    }
}
