//! The native blocks of one CPU, and which of them runs.

use std::sync::atomic::{AtomicU32, Ordering};

use ob1_model::{BlockId, BlockKind};

use crate::NativeBlock;

/// Native blocks for one CPU.
///
/// Those of a plugin share memory, so they stay together: they go to another thread all at once or not at all, and only
/// a CPU takes them apart.
///
/// ```compile_fail
/// fn apart(natives: ob1_cpu::Natives) -> Vec<Box<dyn ob1_cpu::NativeBlock>> {
///     natives.into()
/// }
/// ```
#[derive(Default)]
pub struct Natives(Vec<Box<dyn NativeBlock>>);

impl Natives {
    /// Adds blocks.
    pub fn extend(&mut self, others: impl Into<Natives>) {
        self.0.extend(others.into().0);
    }

    /// Leaves blocks out.
    pub fn retain(&mut self, keep: impl Fn(BlockId) -> bool) {
        self.0.retain(|block| keep(block.id()));
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &dyn NativeBlock> {
        self.0.iter().map(|block| &**block as &dyn NativeBlock)
    }

    /// The block with this number.
    #[must_use]
    pub fn get(&self, id: BlockId) -> Option<&dyn NativeBlock> {
        self.iter().find(|block| block.id() == id)
    }

    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn into_blocks(self) -> Vec<Box<dyn NativeBlock>> {
        self.0
    }
}

impl From<Vec<Box<dyn NativeBlock>>> for Natives {
    fn from(blocks: Vec<Box<dyn NativeBlock>>) -> Self {
        Self(blocks)
    }
}

impl std::fmt::Debug for Natives {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter().map(NativeBlock::id)).finish()
    }
}

/// The native block that runs at the moment: written before each call and after it, so that a monitor can name one that
/// never returns.
#[derive(Debug, Default)]
pub struct Running(AtomicU32);

/// Set in the word while a block runs; kind and number below it.
const BUSY: u32 = 1 << 31;

impl Running {
    /// The innermost native block under way.
    #[must_use]
    pub fn block(&self) -> Option<BlockId> {
        let word = self.0.load(Ordering::Relaxed);
        let kind = BlockKind::from_repr((word >> 16 & 0xFF) as u8)?;
        (word & BUSY != 0).then_some(BlockId::new(kind, word as u16))
    }

    /// The word of a block.
    pub(crate) const fn word(id: BlockId) -> u32 {
        BUSY | (id.kind as u32) << 16 | id.number as u32
    }

    /// A block begins, or its caller continues. Only the scan thread writes: no read-modify-write is needed.
    #[inline]
    pub(crate) fn replace(&self, word: u32) -> u32 {
        let outer = self.0.load(Ordering::Relaxed);
        self.0.store(word, Ordering::Relaxed);
        outer
    }
}
