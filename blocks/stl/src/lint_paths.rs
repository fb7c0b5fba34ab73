//! Outputs of functions that are not assigned on every path.

use ob1_ir::{Arg, Op, Place};
use ob1_model::{BlockKind, Section};

use crate::diagnostic::Sink;
use crate::inspect::{Inspected, written};
use crate::messages;

/// Most passes over a block. Each carries along what backward jumps bring; what is not settled after the last is not
/// reported.
const PASSES: u32 = 32;

/// One bit for each output: assigned so far on every path.
type Bits = Box<[u64]>;

/// Reports outputs and function values of an FC that some path from its begin to its end leaves unassigned: the
/// caller's operand then keeps its old value, or takes what the call's local data held. `S` and `R` count as
/// assignments.
pub(crate) fn unassigned_outputs(i: &Inspected<'_>, sink: &mut Sink) {
    if i.id.kind != BlockKind::Fc {
        return;
    }
    let outputs: Vec<(usize, &str)> = i
        .info
        .interface
        .formals()
        .enumerate()
        .filter(|(_, p)| matches!(p.section, Section::Output | Section::Return))
        .map(|(index, p)| (index, p.name.as_str()))
        .collect();
    if outputs.is_empty() || outputs.len() * i.code.len() > 4_000_000 {
        return;
    }
    let at_end = assigned_at_end(i, &outputs, sink);
    for (bit, (_, name)) in outputs.iter().enumerate() {
        if at_end.get(bit / 64).is_some_and(|word| word >> (bit % 64) & 1 == 0) {
            let message = format!("{name} is not assigned on every path through {}", i.id);
            sink.report(i.block.file, i.block.span, &messages::OUTPUT_UNASSIGNED, message);
        }
    }
}

/// What every path to the block's end has assigned.
fn assigned_at_end(i: &Inspected<'_>, outputs: &[(usize, &str)], sink: &mut Sink) -> Bits {
    let words = outputs.len().div_ceil(64);
    let all = || vec![u64::MAX; words].into_boxed_slice();
    // Entry `code.len()` is the end. Statements not reached yet count as having assigned everything.
    let mut states: Vec<Bits> = (0..=i.code.len()).map(|_| all()).collect();
    if let Some(first) = states.first_mut() {
        first.fill(0);
    }
    for _ in 0..PASSES {
        let mut changed = false;
        for (at, stmt) in i.code.iter().enumerate() {
            sink.steps += 1;
            let Some(mut state) = states.get(at).cloned() else { continue };
            assign(&stmt.op, outputs, &mut state);
            each_successor(&stmt.op, at, i.code.len(), &mut |to| {
                let Some(target) = states.get_mut(to) else { return };
                for (old, new) in target.iter_mut().zip(&state) {
                    changed |= to <= at && *old & new != *old;
                    *old &= new;
                }
            });
        }
        if !changed {
            break;
        }
    }
    states.pop().unwrap_or_else(all)
}

fn assign(op: &Op, outputs: &[(usize, &str)], state: &mut Bits) {
    let mut mark = |place: Place| {
        let Place::Param { index, .. } = place else { return };
        if let Ok(bit) = outputs.binary_search_by_key(&usize::from(index), |(i, _)| *i)
            && let Some(word) = state.get_mut(bit / 64)
        {
            *word |= 1 << (bit % 64);
        }
    };
    if let Some(place) = written(op) {
        mark(place);
    }
    if let Op::Call(call) = op {
        for arg in &call.args {
            if let Arg::Operand(operand) = arg {
                mark(operand.place);
            }
        }
    }
}

/// Where a statement can lead; `end` is the end of the block.
fn each_successor(op: &Op, at: usize, end: usize, see: &mut dyn FnMut(usize)) {
    match op {
        Op::End => return see(end),
        Op::EndIf => see(end),
        Op::Jump(jump, to) => {
            see(*to as usize);
            if *jump == ob1_ir::Jump::Always {
                return;
            }
        }
        Op::Loop(to) => see(*to as usize),
        Op::JumpList { targets, otherwise } => {
            targets.iter().for_each(|to| see(*to as usize));
            return see(*otherwise as usize);
        }
        _ => {}
    }
    see((at + 1).min(end));
}
