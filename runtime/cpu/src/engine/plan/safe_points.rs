//! Which calls are safe points. In front of a short block a look at the clock would take longer than the block.

use ob1_model::BlockKind;

use super::{Block, CallTarget, Callee, Op};

/// Most statements of a block in front of which there may be no safe point. Engines may make it part of its callers.
pub const SHORT_BLOCK: usize = 48;
/// Statements of straight code between two safe points, at most, those of short blocks included.
const STRAIGHT: u32 = 256;

/// The statements that a run of the block has at most, and its end, if it is short: without loops and calls.
fn short(block: &Block) -> Option<u32> {
    let is_called = matches!(block.id.kind, BlockKind::Fc | BlockKind::Fb);
    (is_called && !block.loops && block.calls.is_empty() && block.stmts.len() <= SHORT_BLOCK)
        .then_some(block.ops.len() as u32)
}

/// Marks the calls that are safe points: all but those of short blocks, and of these the one that is due.
///
/// Jumps forward leave statements out, and those back are safe points, so the order of the statements gives the bound.
pub(crate) fn mark(blocks: &mut [Block]) {
    let lengths: Vec<Option<u32>> = blocks.iter().map(short).collect();
    for block in blocks {
        let mut straight = 0;
        for op in &block.ops {
            straight += 1;
            let (Op::Call { call } | Op::CallNative { call, .. }) = op else { continue };
            let Some(call) = block.calls.get_mut(*call as usize) else { continue };
            let length = match call.target {
                CallTarget::Known(Callee::Code(callee)) => lengths.get(callee as usize).copied().flatten(),
                _ => None,
            };
            match length {
                Some(length) if straight + length <= STRAIGHT => {
                    (call.safe_point, straight) = (false, straight + length);
                }
                _ => (call.safe_point, straight) = (true, 0),
            }
        }
    }
}
