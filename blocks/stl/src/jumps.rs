//! Labels and jumps.

use std::collections::BTreeMap;

use ob1_ir::{Jump, Op, Stmt};
use ob1_model::BlockId;

use crate::diagnostic::Sink;
use crate::messages;
use crate::reader::Reader;
use crate::syntax::Block;
use crate::token::{File, Span};

/// Letters and digits of a label in STEP 7.
pub(crate) const LABEL_LENGTH: usize = 4;

/// Targets of one jump list.
const LIST_LENGTH: usize = 255;

/// The labels of a block, and those of all others.
pub(crate) struct Labels<'l> {
    own: BTreeMap<&'l str, u32>,
    elsewhere: &'l BTreeMap<&'l str, BlockId>,
}

impl<'l> Labels<'l> {
    /// The labels of a block. Upper and lower case are different letters, as in STEP 7.
    pub(crate) fn collect(
        block: &Block,
        file: &File<'l>,
        elsewhere: &'l BTreeMap<&'l str, BlockId>,
        sink: &mut Sink,
    ) -> Self {
        let mut own = BTreeMap::new();
        for (at, statement) in (0u32..).zip(&block.statements) {
            let Some(token) = statement.label.and_then(|l| file.tokens.get(l)).copied() else { continue };
            let name = file.of(token);
            if name.chars().count() > LABEL_LENGTH {
                let message = format!("STEP 7 labels have at most {LABEL_LENGTH} characters");
                sink.report(block.file, token.span, &messages::LONG_LABEL, message);
            }
            if own.contains_key(name) {
                let shown: String = name.chars().take(32).collect();
                sink.report(
                    block.file,
                    token.span,
                    &messages::DUPLICATE_LABEL,
                    format!("the label {shown} occurs twice"),
                );
            } else {
                own.insert(name, at);
            }
        }
        Self { own, elsewhere }
    }

    /// The statement of a label. `None` when there is none in this block (reported).
    pub(crate) fn find(&self, name: &str, reader: &mut Reader<'_, '_>, span: Span) -> Option<u32> {
        if let Some(at) = self.own.get(name) {
            return Some(*at);
        }
        let shown: String = name.chars().take(32).collect();
        if let Some(block) = self.elsewhere.get(name) {
            let message = format!("the label {shown} is in {block}");
            reader.report(span, &messages::LABEL_ELSEWHERE, message);
        } else {
            let known = self.own.keys().copied();
            let message = format!("the block has no label {shown}");
            reader.sink.report_unknown(reader.index, span, &messages::UNKNOWN_LABEL, message, name, known);
        }
        None
    }
}

/// Gives each `SPL` the targets of its list: the `SPA`s from it to its own label, which follows the list.
pub(crate) fn jump_lists(block: &Block, code: &mut [Stmt], sink: &mut Sink) {
    // From the end, so that each run of jumps is gathered once, whatever the number of lists.
    let mut run: Vec<u32> = Vec::new();
    for at in (0..code.len()).rev() {
        let Some(stmt) = code.get_mut(at) else { continue };
        match &mut stmt.op {
            Op::Jump(Jump::Always, to) => run.push(*to),
            Op::JumpList { targets, otherwise } => {
                run.reverse();
                let behind = (*otherwise as usize).saturating_sub(at + 1);
                if (1..run.len()).contains(&behind) {
                    run.truncate(behind);
                }
                let wrong = match run.len() {
                    0 => Some("no SPA follows"),
                    1..=LIST_LENGTH => None,
                    _ => Some("more than 255 SPA follow"),
                };
                if let (Some(message), Some(statement)) = (wrong, block.statements.get(at)) {
                    sink.report(block.file, statement.span, &messages::JUMP_LIST, message);
                }
                *targets = std::mem::take(&mut run).into_boxed_slice();
            }
            _ => run.clear(),
        }
    }
}
