//! The result of a read: all of one scan.

use ob1_model::{OperatingState as State, Piece, Width};

use super::messages::Refusal;

/// The pieces of one read, all of one cycle control point. Reusing it allocates nothing.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// The cycle control point, counted from 1, those in STOP included.
    pub scan: u64,
    /// When that was, in nanoseconds of the runtime.
    pub time: u64,
    /// The operating state then.
    pub state: State,
    bytes: Vec<u8>,
    items: Vec<Item>,
}

#[derive(Clone, Copy, Debug)]
struct Item {
    from: usize,
    found: Result<usize, Refusal>,
    /// For a bit: its place in the byte.
    bit: Option<u32>,
}

impl Reading {
    /// An empty reading, to be filled by [`Door::read`](super::Door::read).
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of pieces that were asked for.
    #[must_use]
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there are no pieces.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// The bytes of a piece, big-endian as in the CPU.
    ///
    /// # Errors
    /// Why the CPU does not have it, or why it may not be read.
    pub fn piece(&self, index: usize) -> Result<&[u8], Refusal> {
        let item = self.items.get(index).ok_or(Refusal::NotThere)?;
        let len = item.found?;
        self.bytes.get(item.from..item.from + len).ok_or(Refusal::NotThere)
    }

    /// The same as a number of at most four bytes; for a bit 0 or 1.
    ///
    /// # Errors
    /// Why the CPU does not have the piece, or why it may not be read.
    pub fn value(&self, index: usize) -> Result<u32, Refusal> {
        let value = self.piece(index)?.iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
        let bit = self.items.get(index).and_then(|item| item.bit);
        Ok(bit.map_or(value, |_| value & 1))
    }

    pub(super) fn clear(&mut self, scan: u64, time: u64, state: State) {
        (self.scan, self.time, self.state) = (scan, time, state);
        self.bytes.clear();
        self.items.clear();
    }

    /// Appends a piece; `read` appends its bytes.
    pub(super) fn push(&mut self, piece: &Piece, read: impl FnOnce(&mut Vec<u8>) -> Result<(), Refusal>) {
        let from = self.bytes.len();
        let found = read(&mut self.bytes).map(|()| self.bytes.len() - from);
        let bit = matches!(piece, Piece::Value(_, Width::Bit)).then_some(0);
        self.items.push(Item { from, found, bit });
    }
}
