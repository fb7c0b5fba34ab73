//! Watched blocks: while there is a job, these have no machine code as far as their callers know, and are run here.

use ob1_cpu::Abort;
use ob1_cpu::engine::{Caller, Context, Op, Plan, Regs};

use crate::inline::candidate;
use crate::run::{Code, interpret};

/// For each block: those whose code contains its own, in ascending order.
#[derive(Debug)]
pub(crate) struct Containing(Box<[Box<[u32]>]>);

impl Containing {
    /// Of a plan. The compiler may have left some of them out.
    pub(crate) fn of(plan: &Plan) -> Self {
        let mut lists = vec![Vec::new(); plan.blocks.len()];
        for (caller, block) in (0..).zip(&plan.blocks) {
            for op in &block.ops {
                if let Op::Call { call } = *op
                    && let Some((callee, _)) = candidate(plan, &block.calls[call as usize])
                    && let Some(list) = lists.get_mut(callee as usize)
                    && list.last() != Some(&caller)
                {
                    list.push(caller);
                }
            }
        }
        Self(lists.into_iter().map(Into::into).collect())
    }

    /// The blocks whose code contains that of this one.
    pub(crate) fn of_block(&self, block: u32) -> impl Iterator<Item = u32> {
        self.0.get(block as usize).into_iter().flatten().copied()
    }

    pub(crate) fn has(&self, block: u32, caller: u32) -> bool {
        self.0.get(block as usize).is_some_and(|list| list.binary_search(&caller).is_ok())
    }
}

/// Runs a block that a job is about: by its machine code if this run is none to be watched.
#[cold]
pub(crate) fn run(
    code: &Code,
    block: u32,
    caller: Option<Caller>,
    r: &mut Regs,
    cx: &mut Context<'_>,
) -> Result<(), Abort> {
    let run = cx.new_run();
    let entered = cx.entered(block, caller, run, code.contains_watched(block), r);
    match code.watched_entry(block) {
        Some(entry) if !entered.probed => code.run_code(entry, r, cx)?,
        _ if !entered.probed => interpret::<false>(code, block, run, 0, &[], r, cx).map(|_| ())?,
        _ => {
            interpret::<true>(code, block, run, 0, &[], r, cx)?;
            cx.pass_ends(run, r);
        }
    }
    cx.leave(&entered);
    Ok(())
}
