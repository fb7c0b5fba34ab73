//! What a client may touch, and what the record says of its questions.

use std::fmt::Write as _;

use ob1_access::Cell;
use ob1_access::door::Refusal;
use ob1_model::{Area, BlockId, BlockKind, DebugOrder, Forced, ForcedArea};

use crate::LinkConfig;

/// Blocks in words: `FC 1, DB 2`.
pub(crate) fn list(ids: impl Iterator<Item = BlockId>) -> String {
    let mut text = String::new();
    for id in ids {
        // Writing into a String cannot fail.
        let _ = write!(text, "{}{id}", if text.is_empty() { "" } else { ", " });
    }
    text
}

/// A cell may be forced if its area may be written.
pub(crate) fn may_force(cell: &Forced, config: &LinkConfig) -> Result<(), Refusal> {
    let at = match cell.area {
        ForcedArea::Input => Cell::Area(Area::Input, cell.bit),
        ForcedArea::Output => Cell::Area(Area::Output, cell.bit),
        ForcedArea::Memory => Cell::Area(Area::Memory, cell.bit),
        ForcedArea::PeripheralInput | ForcedArea::PeripheralOutput => Cell::Peripheral(cell.bit),
    };
    if config.allowed.has(at) { Ok(()) } else { Err(Refusal::Right) }
}

/// A data block may be seen or changed if its values may be, a block of statements if the program may be.
pub(crate) fn may_touch(id: BlockId, config: &LinkConfig) -> Result<(), Refusal> {
    let is_data = id.kind == BlockKind::Db;
    let allowed = if is_data { config.allowed.has(Cell::Db(id.number, 0)) } else { config.allowed.has_program() };
    if allowed { Ok(()) } else { Err(Refusal::Right) }
}

/// What is asked about breakpoints, in a word for the record; what changes nothing is not recorded.
pub(crate) const fn word(order: &DebugOrder) -> Option<&'static str> {
    match order {
        DebugOrder::Breakpoints(_) => Some("breakpoints"),
        DebugOrder::Hold { resume: Some(_), .. } => Some("leave HOLD"),
        DebugOrder::End => Some("no breakpoints"),
        DebugOrder::Outputs(true) => Some("peripheral outputs on in STOP"),
        DebugOrder::Outputs(false) => Some("peripheral outputs off in STOP"),
        DebugOrder::Hold { resume: None, .. } | DebugOrder::Stack { .. } => None,
    }
}
