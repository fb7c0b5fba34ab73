//! The native blocks of one CPU, and which of them runs.

use std::sync::atomic::{AtomicU64, Ordering};

use ob1_model::{BlockId, BlockKind, Section};

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
    /// Adds blocks; which numbers clash is found at load.
    pub fn extend(&mut self, others: impl Into<Natives>) {
        self.0.extend(others.into().0);
    }

    /// Leaves out the blocks for which `keep` is false.
    pub fn retain(&mut self, keep: impl Fn(BlockId) -> bool) {
        self.0.retain(|block| keep(block.id()));
    }

    /// All blocks, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = &dyn NativeBlock> {
        self.0.iter().map(|block| &**block as &dyn NativeBlock)
    }

    /// The block with this number.
    #[must_use]
    pub fn get(&self, id: BlockId) -> Option<&dyn NativeBlock> {
        self.iter().find(|block| block.id() == id)
    }

    /// How many blocks there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
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

/// A formal parameter of a native block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Formal {
    /// Bits; above 32 it is read as bytes.
    pub(crate) bits: u32,
    /// The reference is a number.
    pub(crate) number: bool,
    pub(crate) input: bool,
    /// Bit in the instance.
    pub(crate) at: u32,
}

/// A loaded native block.
pub(crate) struct Native {
    pub(crate) block: Box<dyn NativeBlock>,
    pub(crate) id: BlockId,
    pub(crate) formals: Box<[Formal]>,
    pub(crate) has_instance: bool,
    pub(crate) instance_bytes: u32,
    pub(crate) is_plugin: bool,
    /// What [`Running`] holds while it runs.
    pub(crate) word: u32,
    /// Its account, for a block of a plugin.
    pub(crate) account: Option<u32>,
}

impl Native {
    /// All native blocks; those of plugins get their accounts, in their order, when `timed`.
    pub(crate) fn all(blocks: Natives, timed: bool) -> Vec<Self> {
        let mut accounts = 0..;
        let account = |block: &dyn NativeBlock, accounts: &mut std::ops::RangeFrom<u32>| {
            if timed && block.is_plugin() { accounts.next() } else { None }
        };
        let blocks = blocks.0.into_iter();
        blocks.map(|block| Self { account: account(&*block, &mut accounts), ..Self::new(block) }).collect()
    }

    fn new(block: Box<dyn NativeBlock>) -> Self {
        let interface = block.interface();
        let formals = interface
            .formals()
            .map(|p| Formal {
                bits: p.passed_bits(block.id().kind.has_instance()),
                number: p.ty.is_parameter_type(),
                input: p.section == Section::Input,
                at: p.at.0,
            })
            .collect();
        let (id, instance_bytes, is_plugin) = (block.id(), interface.instance_bytes, block.is_plugin());
        let (word, has_instance) = (Running::word(id), id.kind.has_instance());
        Self { id, formals, has_instance, instance_bytes, is_plugin, word, account: None, block }
    }
}

/// The native block that runs at the moment: written before each call and after it, so that a monitor can name one that
/// never returns.
#[derive(Debug, Default)]
pub struct Running(AtomicU64);

/// Set in the word while a block runs; kind and number below it.
const BUSY: u32 = 1 << 31;
/// One call more, above the word.
const CALL: u64 = 1 << 32;

impl Running {
    /// The innermost native block under way.
    #[must_use]
    pub fn block(&self) -> Option<BlockId> {
        Some(self.call()?.1)
    }

    /// The same, with a number by which one call is told from the next of the same block.
    #[must_use]
    pub fn call(&self) -> Option<(u32, BlockId)> {
        let all = self.0.load(Ordering::Relaxed);
        let word = all as u32;
        let kind = BlockKind::from_repr((word >> 16 & 0xFF) as u8)?;
        (word & BUSY != 0).then_some(((all / CALL) as u32, BlockId::new(kind, word as u16)))
    }

    /// The word of a block.
    const fn word(id: BlockId) -> u32 {
        BUSY | (id.kind as u32) << 16 | id.number as u32
    }

    /// A block begins, or its caller continues. Only the scan thread writes: no read-modify-write is needed.
    #[inline]
    pub(crate) fn replace(&self, word: u32) -> u32 {
        let outer = self.0.load(Ordering::Relaxed);
        self.0.store((outer & !(CALL - 1)).wrapping_add(CALL) | u64::from(word), Ordering::Relaxed);
        outer as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_call_is_told_from_the_next() {
        let (running, id) = (Running::default(), BlockId::new(BlockKind::Sfc, 43));
        let outer = running.replace(Running::word(id));
        let first = running.call();
        assert_eq!((first, running.block()), (Some((1, id)), Some(id)));
        running.replace(outer);
        assert_eq!(running.call(), None);
        running.replace(Running::word(id));
        assert_eq!(running.call(), Some((3, id)));
    }
}
