//! The classic traps of ported programs, reported on request: legal statements that seldom mean what they do.
//!
//! The checks of one block run on its statements before anything is put around them. What concerns several blocks is
//! gathered in [`Whole`] and said at the end.

use std::collections::BTreeSet;

use ob1_ir::{Op, Place, Stmt};
use ob1_model::{BlockId, BlockKind, Section};

use crate::diagnostic::Sink;
use crate::inspect::{Inspected, written};
use crate::lint_accu;
use crate::lint_br::{self, BrUse};
use crate::lint_constant;
use crate::lint_memory::MemoryUse;
use crate::lint_paths;
use crate::messages;
use crate::syntax::Block;
use crate::token::File;
use crate::world::Info;

/// What is gathered over all blocks.
#[derive(Debug, Default)]
pub(crate) struct Whole {
    memory: MemoryUse,
    br: BrUse,
}

impl Whole {
    /// Inspects one block and its statements.
    pub(crate) fn block(
        &mut self,
        id: BlockId,
        block: &Block,
        info: &Info,
        code: &[Stmt],
        file: &File<'_>,
        sink: &mut Sink,
    ) {
        let inspected = Inspected { id, block, info, code, targets: jump_targets(code) };
        sink.steps += code.len() as u64;
        lint_paths::unassigned_outputs(&inspected, sink);
        lint_accu::lost(&inspected, sink);
        lint_br::overwritten(&inspected, sink);
        self.br.gather(&inspected);
        self.memory.gather(&inspected);
        inputs_written(&inspected, sink);
        unused_labels(&inspected, file, sink);
        lint_constant::started_with_a_time(&inspected, file, sink);
        lint_constant::long_without_sign(&inspected, file, sink);
    }

    /// What can be said when all blocks have been seen.
    pub(crate) fn finish(self, sink: &mut Sink) {
        self.br.report(sink);
        self.memory.report(sink);
    }
}

pub(crate) fn jump_targets(code: &[Stmt]) -> BTreeSet<u32> {
    let mut targets = BTreeSet::new();
    for stmt in code {
        match &stmt.op {
            Op::Jump(_, to) | Op::Loop(to) => {
                targets.insert(*to);
            }
            Op::JumpList { targets: list, otherwise } => {
                targets.extend(list.iter().copied());
                targets.insert(*otherwise);
            }
            _ => {}
        }
    }
    targets
}

/// Writing to an input: in a function it writes to the caller's operand, in a function block it is lost at the next
/// call.
fn inputs_written(i: &Inspected<'_>, sink: &mut Sink) {
    let params = &i.info.interface.params;
    let formals: Vec<_> = i.info.interface.formals().collect();
    let inputs: Vec<_> = params.iter().filter(|p| p.section == Section::Input).collect();
    let others = params.iter().filter(|p| !matches!(p.section, Section::Input | Section::Temp));
    let end = others.map(|p| p.at.0).min().unwrap_or(u32::MAX);
    for (at, stmt) in i.code.iter().enumerate() {
        let param = match written(&stmt.op) {
            Some(Place::Param { index, .. }) => formals.get(usize::from(index)).copied(),
            Some(Place::Instance(to)) if to.0 < end => {
                inputs.partition_point(|p| p.at.0 <= to.0).checked_sub(1).and_then(|n| inputs.get(n)).copied()
            }
            _ => None,
        };
        let Some(param) = param.filter(|p| p.section == Section::Input) else { continue };
        let effect =
            if i.id.kind == BlockKind::Fc { "the caller's operand" } else { "the instance, up to the next call" };
        let message = format!("{} is an input; this writes to {effect}", param.name);
        sink.report(i.block.file, i.span(at), &messages::INPUT_WRITTEN, message);
    }
}

fn unused_labels(i: &Inspected<'_>, file: &File<'_>, sink: &mut Sink) {
    for (at, statement) in i.block.statements.iter().enumerate() {
        let Some(token) = statement.label.and_then(|l| file.tokens.get(l)).copied() else { continue };
        if !i.is_target(at) {
            let shown: String = file.of(token).chars().take(32).collect();
            let message = format!("nothing jumps to the label {shown}");
            sink.report(i.block.file, token.span, &messages::UNUSED_LABEL, message);
        }
    }
}
