//! The diagnostic buffer of a CP: its newest entries in a ring that is never emptied. It belongs to the module, not to
//! the driver: a killed driver leaves it as it is, and the next driver appends to it.
//!
//! An entry is one word, so it is never half written. The ring has one slot more than entries: the slot the writer is
//! filling. A reader that was overtaken stops there.

use crate::cells::BufferCells;
use crate::layout::{BUFFER_ENTRIES, BUFFER_SLOTS};
use crate::sync::{AtomicU64, Ordering};

/// Set in every word that holds an entry; a word without it was never written.
const USED: u64 = 1 << 17;
const INCOMING: u64 = 1 << 16;
const TIME_SHIFT: u32 = 18;

/// One entry of a CP's diagnostic buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferEntry {
    /// Event class (high byte) and number (low byte), as in STATUS of the handling blocks.
    pub number: u16,
    /// True: the event has come. False: a state that had come has gone.
    pub incoming: bool,
    /// Time of the CPU (`cpu.time`) in milliseconds, as of its last scan.
    pub time_ms: u64,
}

impl BufferEntry {
    fn to_word(self) -> u64 {
        let incoming = if self.incoming { INCOMING } else { 0 };
        self.time_ms << TIME_SHIFT | USED | incoming | u64::from(self.number)
    }

    fn from_word(word: u64) -> Option<Self> {
        let entry = Self { number: word as u16, incoming: word & INCOMING != 0, time_ms: word >> TIME_SHIFT };
        (word & USED != 0).then_some(entry)
    }
}

fn slot(cells: &BufferCells, number: u64) -> &AtomicU64 {
    // The remainder is always a valid index, and the compiler knows it.
    &cells.entries.0[(number % BUFFER_SLOTS as u64) as usize]
}

/// The driver's end: appends entries, and counts them across all drivers of the module.
pub(crate) struct BufferWriter {
    written: u64,
}

impl BufferWriter {
    /// Continues after the existing entries.
    pub(crate) fn resume(cells: &BufferCells) -> Self {
        Self { written: cells.written.load(Ordering::Relaxed) }
    }

    pub(crate) fn enter(&mut self, cells: &BufferCells, entry: BufferEntry) {
        // Pairs with the reader's load(Acquire) of the slot: a reader that sees this entry also sees the `written` that
        // shows which entry was overwritten.
        slot(cells, self.written).store(entry.to_word(), Ordering::Release);
        self.written = self.written.wrapping_add(1);
        // Pairs with the reader's first load(Acquire): a reader that sees this number sees all entries before it.
        cells.written.store(self.written, Ordering::Release);
    }
}

/// The entries, newest first. Fewer if the writer overtakes the reader.
pub(crate) fn read(cells: &BufferCells) -> impl Iterator<Item = BufferEntry> {
    let written = cells.written.load(Ordering::Acquire);
    let words = (1..=written.min(BUFFER_ENTRIES as u64)).map_while(move |back| {
        let number = written.wrapping_sub(back);
        let word = slot(cells, number).load(Ordering::Acquire);
        let newest = cells.written.load(Ordering::Acquire);
        (newest.wrapping_sub(number) <= BUFFER_ENTRIES as u64).then_some(word)
    });
    words.filter_map(BufferEntry::from_word)
}
