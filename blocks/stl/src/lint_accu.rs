//! Accumulators used after a call that has changed them.

use ob1_ir::Op;

use crate::diagnostic::Sink;
use crate::inspect::{Inspected, callee, leaves};
use crate::messages;

/// Reports statements that use an accumulator which nothing has loaded since a CALL: the block called, and what STEP 7
/// puts around the call, leave something else there. Looked at up to the next label.
pub(crate) fn lost(i: &Inspected<'_>, sink: &mut Sink) {
    // Line of the call, and how many accumulators have been loaded since.
    let mut call: Option<(u32, u8)> = None;
    for (at, stmt) in i.code.iter().enumerate() {
        if i.is_target(at) {
            call = None;
        }
        if callee(&stmt.op).is_some() {
            call = Some((stmt.line, 0));
            continue;
        }
        let Some((line, loaded)) = &mut call else { continue };
        let needed = needs(&stmt.op);
        if needed > *loaded {
            let which = if *loaded == 0 { "ACCU1" } else { "ACCU2" };
            let message = format!("{which} is used here, but the CALL in line {line} has changed it");
            sink.report(i.block.file, i.span(at), &messages::ACCU_LOST, message);
            call = None;
            continue;
        }
        if stmt.op.loads() || matches!(stmt.op, Op::TransferAr(_)) {
            *loaded = (*loaded + 1).min(2);
        }
        if leaves(&stmt.op) {
            call = None;
        }
    }
}

/// How many accumulators an operation uses.
fn needs(op: &Op) -> u8 {
    match op {
        Op::Arithmetic(..)
        | Op::Compare(..)
        | Op::WordLogic(_, None)
        | Op::DWordLogic(_, None)
        | Op::Shift(_, None)
        | Op::ExchangeAccus
        | Op::Pop => 2,
        Op::Transfer(_)
        | Op::TransferStatus
        | Op::WordLogic(..)
        | Op::DWordLogic(..)
        | Op::Shift(..)
        | Op::RotateLeftCc1
        | Op::RotateRightCc1
        | Op::Convert(_)
        | Op::Math(_)
        | Op::Increment(_)
        | Op::Decrement(_)
        | Op::AddConst { .. }
        | Op::LoadAr(_)
        | Op::AddAr(_)
        | Op::StartTimer(..)
        | Op::SetCounter(_)
        | Op::Loop(_)
        | Op::JumpList { .. } => 1,
        _ => 0,
    }
}
