//! Back from what STEP 7's compiler makes of a statement to the statement.
//!
//! A `CALL` stands between two `BLD`, whose numbers tell what is called. Within them values that have no address of
//! their own are put into the caller's local data or the instance, then the block is called, then results are copied
//! out. A frame in which anything else happens does not fold and stays as it is.

mod component;
mod function;
mod instance;
mod values;

use ob1_ir::Call;
use ob1_model::BlockKind;

use crate::decode::{Callees, Item, MachineBlock};
use crate::statement::Mc7Op;

pub(crate) use component::{Base, component};
pub(crate) use instance::INSTANCE_START;

/// The kind of frame between two `BLD`; the closing number is one more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Frame {
    /// A function or system function.
    Function(BlockKind),
    /// A function block with its data block.
    DataBlock(BlockKind),
    /// A multi-instance.
    Multi(BlockKind),
}

/// The number of the opening `BLD` of each frame.
pub(crate) const FRAMES: [(u8, Frame); 6] = [
    (1, Frame::Function(BlockKind::Fc)),
    (7, Frame::Function(BlockKind::Sfc)),
    (3, Frame::DataBlock(BlockKind::Fb)),
    (9, Frame::DataBlock(BlockKind::Sfb)),
    (14, Frame::Multi(BlockKind::Fb)),
    (16, Frame::Multi(BlockKind::Sfb)),
];

/// The block in which a frame stands.
pub(crate) struct Caller<'c, 'b> {
    pub(crate) block: &'c MachineBlock<'b>,
    /// Its own formals in the order of the list.
    pub(crate) order: &'c [u16],
}

/// The number of statements from the opening to the closing `BLD`; 0 where no frame begins.
pub(crate) fn frame_length(rest: &[Item]) -> usize {
    let Some(Mc7Op::Build(open)) = rest.first().map(|item| &item.op) else { return 0 };
    if !FRAMES.iter().any(|(number, _)| number == open) {
        return 0;
    }
    for (at, item) in rest.iter().enumerate().skip(1) {
        match item.op {
            Mc7Op::Build(n) if n == open + 1 => return at + 1,
            // Frames are not nested: this one is not closed.
            Mc7Op::Build(n) if FRAMES.iter().any(|(number, _)| *number == n) => return 0,
            Mc7Op::BlockEnd => return 0,
            _ => {}
        }
    }
    0
}

/// The call a frame stands for. `None`: it does not fold.
pub(crate) fn call(open: u8, frame: &[Item], caller: &Caller<'_, '_>, callees: &Callees<'_>) -> Option<Call> {
    let (_, kind) = FRAMES.iter().find(|(number, _)| *number == open)?;
    let ops: Vec<&Mc7Op> = frame.iter().map(|item| &item.op).collect();
    match kind {
        Frame::Function(kind) => function::call(*kind, &ops, caller, callees),
        Frame::DataBlock(kind) => instance::call(*kind, false, &ops, caller, callees),
        Frame::Multi(kind) => instance::call(*kind, true, &ops, caller, callees),
    }
}
