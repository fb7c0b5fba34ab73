//! The stack of callers.

use std::cell::Cell;

use crate::engine::call::{Saved, Tops};

/// The caller, while the called block runs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Frame {
    /// Its index among the blocks of the plan.
    pub(super) block: u32,
    /// The statement after the call.
    pub(super) pc: u32,
    /// Index of the call in the block's table.
    pub(super) call: u32,
    pub(super) tops: Tops,
    pub(super) saved: Saved,
}

/// A stack of callers, the outermost first, as deep as blocks can be nested. The engine is entered again while it runs;
/// all its runs share the stack.
pub(super) struct Frames {
    list: Box<[Cell<Frame>]>,
    top: Cell<usize>,
}

impl Frames {
    pub(super) fn new(most: usize) -> Self {
        Self { list: vec![Cell::default(); most].into_boxed_slice(), top: Cell::new(0) }
    }

    pub(super) fn top(&self) -> usize {
        self.top.get()
    }

    /// There is room: the depth of nesting was checked.
    #[inline]
    pub(super) fn push(&self, frame: Frame) {
        let top = self.top.get();
        self.list[top].set(frame);
        self.top.set(top + 1);
    }

    #[inline]
    pub(super) fn pop(&self) -> Option<Frame> {
        let top = self.top.get().checked_sub(1)?;
        self.top.set(top);
        Some(self.list[top].get())
    }
}
