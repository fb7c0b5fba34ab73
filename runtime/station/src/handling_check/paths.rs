//! Which calls of FC 0 lie on one path through the program.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{CodeBlock, Jump, Op, Program};
use ob1_model::BlockId;

use super::sites::{Site, called, calls};

/// Of `sites`, those that a scan can reach after another one: each with the earlier one. Both are calls for the same
/// CP. Jumps backwards do not count: a loop has one call a turn.
pub(super) fn twice<'a>(program: &'a Program, sites: &[Site<'a>]) -> Vec<(Site<'a>, Site<'a>)> {
    let mut found: Vec<(Site<'a>, Site<'a>)> = Vec::new();
    // For each block its first call of them, its own or in a block that it calls.
    let mut firsts = BTreeMap::new();
    for block in &program.blocks {
        first_in(program, block.id, sites, &mut firsts);
    }
    for block in &program.blocks {
        let events: Vec<(usize, Site<'a>)> = calls(block)
            .filter_map(|(at, call)| {
                let own = sites.iter().find(|site| site.caller.id == block.id && site.at == at);
                let site = own.copied().or_else(|| firsts.get(&called(call)?).copied().flatten())?;
                Some((at, site))
            })
            .collect();
        for (n, (first, earlier)) in events.iter().enumerate() {
            let after = after(block, *first);
            let again = events.iter().skip(n + 1).find(|(at, _)| after.contains(at));
            if let Some((_, later)) = again
                && !found.iter().any(|(_, told)| told.caller.id == later.caller.id && told.at == later.at)
            {
                found.push((*earlier, *later));
            }
        }
    }
    found
}

fn first_in<'a>(
    program: &'a Program,
    id: BlockId,
    sites: &[Site<'a>],
    firsts: &mut BTreeMap<BlockId, Option<Site<'a>>>,
) -> Option<Site<'a>> {
    if let Some(known) = firsts.get(&id) {
        return *known;
    }
    // A block that calls itself gets no call of its own by that.
    firsts.insert(id, None);
    let block = program.blocks.iter().find(|block| block.id == id)?;
    let first = calls(block).find_map(|(at, call)| {
        let own = sites.iter().find(|site| site.caller.id == id && site.at == at);
        own.copied().or_else(|| first_in(program, called(call)?, sites, firsts))
    });
    firsts.insert(id, first);
    first
}

/// The statements that can follow this one, forwards.
fn after(block: &CodeBlock, from: usize) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut waiting = next(block, from);
    while let Some(at) = waiting.pop() {
        if at > from && at < block.code.len() && reached.insert(at) {
            waiting.extend(next(block, at).into_iter().filter(|next| *next > at));
        }
    }
    reached
}

fn next(block: &CodeBlock, at: usize) -> Vec<usize> {
    match block.code.get(at).map(|stmt| &stmt.op) {
        Some(Op::Jump(Jump::Always, to)) => vec![*to as usize],
        Some(Op::Jump(_, to) | Op::Loop(to)) => vec![at + 1, *to as usize],
        Some(Op::JumpList { targets, otherwise }) => targets.iter().chain([otherwise]).map(|to| *to as usize).collect(),
        Some(Op::End) | None => Vec::new(),
        Some(_) => vec![at + 1],
    }
}
