//! The boxes of a CP 343: each job of a handling block has one, 512 bytes each way under a sequence lock. What they
//! mean is in `docs/cp343.md`; here they are bytes. The segment of any other CP ends before them.

use ob1_words::boxes::HEAD_BYTES;

use crate::bytes::{copy_out, words_of};
use crate::cells::{BOX_WORDS, BoxRow, BoxesCells};
use crate::channel::Way;
use crate::seqlock::{Freshness, SeqReader};

/// One end of all boxes: writes one way, reads the other.
pub(crate) struct BoxEnd {
    writes: Way,
    /// One for each box; none without boxes.
    readers: Box<[SeqReader<BOX_WORDS>]>,
}

impl BoxEnd {
    pub(crate) fn new(writes: Way, cells: Option<&BoxesCells>) -> Self {
        let boxes = cells.map_or(0, |cells| cells.to_cp.0.len());
        Self { writes, readers: (0..boxes).map(|_| SeqReader::new()).collect() }
    }

    const fn mine<'c>(&self, cells: &'c BoxesCells) -> &'c BoxRow {
        match self.writes {
            Way::ToCp => &cells.to_cp,
            Way::ToCpu => &cells.to_cpu,
        }
    }

    const fn other<'c>(&self, cells: &'c BoxesCells) -> &'c BoxRow {
        match self.writes {
            Way::ToCp => &cells.to_cpu,
            Way::ToCpu => &cells.to_cp,
        }
    }

    /// Zeroes the head of every box of this end, whatever a predecessor has left: without a head there is no job, and
    /// nobody reads the data. The scan does this for a new driver: 64 times four words, about a microsecond with cold
    /// caches.
    pub(crate) fn clear(&self, cells: Option<&BoxesCells>) {
        for cell in cells.iter().flat_map(|cells| &self.mine(cells).0) {
            cell.content.write(core::iter::repeat_n(0, HEAD_BYTES / 8));
        }
    }

    /// Writes bytes into a box, from its first byte on; the bytes after them stay as they are.
    pub(crate) fn write(&self, cells: Option<&BoxesCells>, index: usize, bytes: &[u8]) {
        if let Some(cell) = cells.and_then(|cells| self.mine(cells).0.get(index)) {
            cell.content.write(words_of(bytes));
        }
    }

    /// Copies what the other side has written, as many bytes as `into` has.
    pub(crate) fn read(&mut self, cells: Option<&BoxesCells>, index: usize, into: &mut [u8]) -> Freshness {
        let cell = cells.and_then(|cells| self.other(cells).0.get(index));
        let (Some(reader), Some(cell)) = (self.readers.get_mut(index), cell) else { return Freshness::Stale };
        let freshness = reader.read(&cell.content, into.len().div_ceil(8));
        copy_out(reader.last(), into);
        freshness
    }

    /// Whether the other side has written since the last read.
    pub(crate) fn changed(&self, cells: Option<&BoxesCells>, index: usize) -> bool {
        let cell = cells.and_then(|cells| self.other(cells).0.get(index));
        self.readers.get(index).zip(cell).is_some_and(|(reader, cell)| reader.is_outdated(&cell.content))
    }
}
