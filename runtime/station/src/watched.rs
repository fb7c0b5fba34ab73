//! Which native block runs: written before each call and after it, so that a monitor can name one that never returns.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ob1_cpu::{Abort, NativeBlock, NativeContext};
use ob1_model::{BlockId, BlockKind, Interface};

/// The native block that runs at the moment.
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
}

/// Wraps blocks so that `running` names the one under way.
#[must_use]
pub fn watch_all(blocks: Vec<Box<dyn NativeBlock>>, running: &Arc<Running>) -> Vec<Box<dyn NativeBlock>> {
    blocks.into_iter().map(|inner| Box::new(Watched::new(inner, Arc::clone(running))) as Box<dyn NativeBlock>).collect()
}

struct Watched {
    inner: Box<dyn NativeBlock>,
    word: u32,
    running: Arc<Running>,
}

impl Watched {
    fn new(inner: Box<dyn NativeBlock>, running: Arc<Running>) -> Self {
        let id = inner.id();
        Self { word: BUSY | (id.kind as u32) << 16 | u32::from(id.number), inner, running }
    }
}

impl NativeBlock for Watched {
    fn id(&self) -> BlockId {
        self.inner.id()
    }

    fn name(&self) -> &str {
        self.inner.name()
    }

    fn interface(&self) -> &Interface {
        self.inner.interface()
    }

    fn is_plugin(&self) -> bool {
        self.inner.is_plugin()
    }

    fn reset(&self) {
        self.inner.reset();
    }

    #[inline]
    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        // Only the scan thread writes: no read-modify-write is needed.
        let outer = self.running.0.load(Ordering::Relaxed);
        self.running.0.store(self.word, Ordering::Relaxed);
        let result = self.inner.call(cx);
        self.running.0.store(outer, Ordering::Relaxed);
        result
    }
}
