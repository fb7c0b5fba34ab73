//! A block under inspection by the lints, and what they ask of its statements.

use std::collections::BTreeSet;

use ob1_ir::{CallMode, Jump, Op, Place, Stmt, Target};
use ob1_model::BlockId;

use crate::syntax::Block;
use crate::token::Span;
use crate::world::Info;

/// A block under inspection.
pub(crate) struct Inspected<'i> {
    pub(crate) id: BlockId,
    pub(crate) block: &'i Block,
    pub(crate) info: &'i Info,
    /// One for each statement of the block.
    pub(crate) code: &'i [Stmt],
    /// Statements that jumps lead to.
    pub(crate) targets: BTreeSet<u32>,
}

impl Inspected<'_> {
    pub(crate) fn span(&self, at: usize) -> Span {
        self.block.statements.get(at).map_or(self.block.span, |s| s.span)
    }

    pub(crate) fn is_target(&self, at: usize) -> bool {
        self.targets.contains(&(at as u32))
    }
}

/// The place a statement writes itself, calls left out.
pub(crate) fn written(op: &Op) -> Option<Place> {
    op.operand().filter(|_| op.writes()).map(|operand| operand.place)
}

/// True for operations after which the next statement is not reached.
pub(crate) fn leaves(op: &Op) -> bool {
    matches!(op, Op::End | Op::Jump(Jump::Always, _) | Op::JumpList { .. })
}

/// A called block that is known by number, with `CALL`.
pub(crate) fn callee(op: &Op) -> Option<BlockId> {
    match op {
        Op::Call(call) if call.mode == CallMode::Call => match call.target {
            Target::Block(id) | Target::Local(id, _) => Some(id),
            Target::Indirect(..) => None,
        },
        _ => None,
    }
}
