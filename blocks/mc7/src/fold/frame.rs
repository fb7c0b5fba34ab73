//! The two `BLD` around a frame, and how far it reaches.

use ob1_model::BlockKind;

use crate::block::Item;
use crate::statement::Mc7Op;

/// The kind of frame between two `BLD`; the closing number is one more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Frame {
    /// A function or system function.
    Function(BlockKind),
    /// A function block with its data block.
    DataBlock(BlockKind),
    /// A multi-instance of the caller.
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
