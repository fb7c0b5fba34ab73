//! Brackets of bit logic and the master control relay: opened, closed, and not nested too deep.

use ob1_ir::{Op, Stmt};

use crate::diagnostic::Sink;
use crate::messages;
use crate::syntax::Block;

/// Entries of the nesting stack [STL reference, "Nesting stack"].
const BIT_DEPTH: usize = 7;

/// Entries of the MCR stack.
const MCR_DEPTH: usize = 8;

/// Checks a block in textual order, as STEP 7 does.
pub(crate) fn check(block: &Block, code: &[Stmt], sink: &mut Sink) {
    let mut bits = Vec::new();
    let mut mcr = Vec::new();
    for (stmt, statement) in code.iter().zip(&block.statements) {
        let message = match stmt.op {
            Op::Open { .. } => {
                bits.push(statement.span);
                (bits.len() == BIT_DEPTH + 1).then(|| format!("more than {BIT_DEPTH} brackets are open"))
            }
            Op::Close => bits.pop().is_none().then(|| "no bracket is open".to_owned()),
            Op::McrOpen => {
                mcr.push(statement.span);
                (mcr.len() == MCR_DEPTH + 1).then(|| format!("more than {MCR_DEPTH} MCR( are open"))
            }
            Op::McrClose => mcr.pop().is_none().then(|| "no MCR( is open".to_owned()),
            _ => None,
        };
        if let Some(message) = message {
            sink.report(block.file, statement.span, &messages::BRACKETS, message);
        }
    }
    for span in [bits.first(), mcr.first()].into_iter().flatten().copied() {
        sink.report(block.file, span, &messages::BRACKETS, "the bracket is not closed in this block");
    }
}
