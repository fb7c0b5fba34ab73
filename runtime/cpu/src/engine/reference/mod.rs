//! The reference engine: an interpreter of the pre-decoded form. It defines the meaning of every statement.

mod based;
mod bytes;
mod frames;
mod run;

use std::cell::Cell;
use std::sync::Arc;

use super::plan::{Block, Caller, Op, Plan};
use super::{Engine, Entered, Entry, Factory, Watched};
use crate::Abort;
use crate::context::Context;
use frames::{Frame, Frames};

/// Makes the reference engine.
pub const REFERENCE: &dyn Factory = &Short;

/// Makes the reference engine that keeps [`Plan::executed`] besides: for a program that is compiled meanwhile, its
/// hottest blocks first. The plain [`REFERENCE`] has no code for that.
pub const ACCOUNTING: &dyn Factory = &Accounting;

/// Makes the reference engine without short forms: every statement is executed straight from the intermediate code.
/// Slower; for comparing the two.
pub const PLAIN: &dyn Factory = &Plain;

struct Short;
struct Accounting;
struct Plain;

impl Factory for Short {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        Ok(Box::new(Reference::<false>::new(plan, None)))
    }
}

impl Factory for Accounting {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        Ok(Box::new(Reference::<true>::new(plan, None)))
    }
}

impl Factory for Plain {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        let mut blocks = plan.blocks.clone();
        for op in blocks.iter_mut().flat_map(|block| &mut block.ops).filter(|op| !op.is_control()) {
            *op = Op::Slow;
        }
        Ok(Box::new(Reference::<false>::new(plan, Some(blocks))))
    }
}

/// The engine that defines the meaning of every statement; `ACCOUNTS`: it keeps the account of what blocks execute.
struct Reference<const ACCOUNTS: bool> {
    plan: Arc<Plan>,
    /// The blocks without short forms, when it runs those.
    plain: Option<Box<[Block]>>,
    frames: Frames,
    /// A job is armed.
    watches: Cell<bool>,
    /// While a job is armed: for each frame, what its caller was entered with.
    entered: Box<[Cell<Option<Entered>>]>,
}

impl<const ACCOUNTS: bool> Reference<ACCOUNTS> {
    fn new(plan: &Arc<Plan>, plain: Option<Box<[Block]>>) -> Self {
        let entered = std::iter::repeat_with(Cell::default).take(plan.frames).collect();
        let watches = Cell::new(false);
        Self { plan: Arc::clone(plan), plain, frames: Frames::new(plan.frames), watches, entered }
    }

    fn blocks(&self) -> &[Block] {
        self.plain.as_ref().unwrap_or(&self.plan.blocks)
    }
}

impl<const ACCOUNTS: bool> Engine for Reference<ACCOUNTS> {
    fn name(&self) -> &'static str {
        if self.plain.is_some() { "plain" } else { "reference" }
    }

    fn plan(&self) -> &Arc<Plan> {
        &self.plan
    }

    fn call(&self, block: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<(), Abort> {
        let floor = self.frames.top();
        let ran = match self.watches.get() {
            false => self.run::<false>(block, entry, cx),
            true => self.run::<true>(block, entry, cx),
        };
        // Drops the frames of blocks that an abort has left.
        while self.frames.top() > floor
            && let Some(frame) = self.frames.pop()
        {
            let at = Caller { block: frame.block, statement: frame.pc.saturating_sub(1) };
            cx.abandoned_caller(at, frame.saved.blocks());
        }
        ran
    }

    fn watch(&self, watched: &Watched) {
        self.watches.set(*watched != Watched::default());
    }
}
