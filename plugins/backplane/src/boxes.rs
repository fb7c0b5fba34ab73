//! The boxes of a CP 343: each job of a handling block has one, 512 bytes each way under a sequence lock. What they
//! mean is in `docs/cp343.md`; here they are bytes.

use crate::bytes::{copy_out, words_of};
use crate::cells::{BOX_WORDS, BoxRow, BoxesCells};
use crate::channel::Way;
use crate::layout::BOXES;
use crate::seqlock::{Freshness, SeqReader};

/// One end of all boxes: writes one way, reads the other.
pub(crate) struct BoxEnd {
    writes: Way,
    readers: Box<[SeqReader<BOX_WORDS>]>,
}

impl BoxEnd {
    pub(crate) fn new(writes: Way) -> Self {
        Self { writes, readers: (0..BOXES).map(|_| SeqReader::new()).collect() }
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

    /// Zeros in every box of this end that has something in it, whatever a predecessor has left.
    pub(crate) fn clear(&self, cells: &BoxesCells) {
        for cell in &self.mine(cells).0 {
            cell.content.write(core::iter::repeat_n(0, BOX_WORDS));
        }
    }

    /// Shows bytes in a box, from its first one on; what lies behind them stays.
    pub(crate) fn write(&self, cells: &BoxesCells, index: usize, bytes: &[u8]) {
        if let Some(cell) = self.mine(cells).0.get(index) {
            cell.content.write(words_of(bytes));
        }
    }

    /// Copies what the other side shows, as many bytes as `into` has.
    pub(crate) fn read(&mut self, cells: &BoxesCells, index: usize, into: &mut [u8]) -> Freshness {
        let cell = self.other(cells).0.get(index);
        let (Some(reader), Some(cell)) = (self.readers.get_mut(index), cell) else { return Freshness::Stale };
        let freshness = reader.read(&cell.content, into.len().div_ceil(8));
        copy_out(reader.last(), into);
        freshness
    }

    /// Whether the other side shows another content than the one read last.
    pub(crate) fn changed(&self, cells: &BoxesCells, index: usize) -> bool {
        let found = self.readers.get(index).zip(self.other(cells).0.get(index));
        found.is_some_and(|(reader, cell)| reader.is_outdated(&cell.content))
    }
}
