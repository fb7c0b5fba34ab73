//! The binary result BR (BIE), by which a block tells its caller whether it did its work (ENO).

use std::collections::BTreeMap;

use ob1_ir::{BitTest, Jump, Op, StatusBit};
use ob1_model::BlockId;

use crate::diagnostic::Sink;
use crate::inspect::{Inspected, callee, leaves};
use crate::messages;
use crate::token::Span;

/// What changes BR, named as a message names it.
fn sets(op: &Op) -> Option<&'static str> {
    Some(match op {
        Op::SaveRlo => "SAVE",
        Op::Jump(Jump::IfRloSaveBr, _) => "SPBB",
        Op::Jump(Jump::IfNotRloSaveBr, _) => "SPBNB",
        Op::TransferStatus => "T STW",
        Op::Call(_) => "the block called",
        _ => return None,
    })
}

fn asks(op: &Op) -> bool {
    matches!(
        op,
        Op::Scan { test: BitTest::Status(StatusBit::BinaryResult), .. }
            | Op::Jump(Jump::IfBr | Jump::IfNotBr, _)
            | Op::LoadStatus
    )
}

/// Reports each SAVE whose BR is overwritten before anything reads it. Checked up to the next label or jump.
pub(crate) fn overwritten(i: &Inspected<'_>, sink: &mut Sink) {
    let mut saved: Option<usize> = None;
    for (at, stmt) in i.code.iter().enumerate() {
        if i.is_target(at) || asks(&stmt.op) || matches!(stmt.op, Op::EndIf) {
            saved = None;
        }
        if let (Some(by), Some(save)) = (sets(&stmt.op), saved) {
            let message = format!("nothing reads the BR that SAVE sets before {by} in line {} changes it", stmt.line);
            sink.report(i.block.file, i.span(save), &messages::BR_MISUSED, message);
            saved = None;
        }
        if leaves(&stmt.op) || matches!(stmt.op, Op::Jump(..) | Op::Loop(_)) {
            saved = None;
        }
        if stmt.op == Op::SaveRlo {
            saved = Some(at);
        }
    }
}

/// Which blocks set BR, and where it is read, over all blocks.
#[derive(Debug, Default)]
pub(crate) struct BrUse {
    /// For each block of the program: whether it sets BR somewhere.
    sets: BTreeMap<BlockId, bool>,
    /// Where BR is read after a call: the called block, the file, the place.
    asks: Vec<(BlockId, usize, Span)>,
}

impl BrUse {
    /// Gathers whether this block sets BR, and where it reads the BR of a block it has called.
    pub(crate) fn gather(&mut self, i: &Inspected<'_>) {
        let mut sets_br = false;
        let mut called = None;
        for (at, stmt) in i.code.iter().enumerate() {
            if asks(&stmt.op)
                && stmt.op != Op::LoadStatus
                && let Some(id) = called.take()
            {
                self.asks.push((id, i.block.file, i.span(at)));
            }
            if sets(&stmt.op).is_some() {
                sets_br = true;
                called = callee(&stmt.op);
            }
            if leaves(&stmt.op) {
                called = None;
            }
        }
        self.sets.insert(i.id, sets_br);
    }

    /// Reports where BR is read after a call of a block that never sets it.
    pub(crate) fn report(&self, sink: &mut Sink) {
        for (id, file, span) in &self.asks {
            if self.sets.get(id) == Some(&false) {
                let message = format!("{id} never sets BR, so this reads the BR from before the call");
                sink.report(*file, *span, &messages::BR_MISUSED, message);
            }
        }
    }
}
