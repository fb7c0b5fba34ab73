//! Which calls of FC 0 follow each other in one scan, whatever the conditions in the program are.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{CallMode, CodeBlock, Jump, Op, Program};
use ob1_model::BlockId;

use super::sites::{Site, called, calls};

/// Of `sites`, those that surely follow another one in a scan: each with the earlier one. Both are calls for the same
/// CP. A call that a condition can leave out does not count as following: the condition may be the order of the other.
pub(super) fn twice<'a>(program: &'a Program, sites: &[Site<'a>]) -> Vec<(Site<'a>, Site<'a>)> {
    let mut known = Known { program, sites, sure: BTreeMap::new(), possible: BTreeMap::new() };
    let mut found: Vec<(Site<'a>, Site<'a>)> = Vec::new();
    for block in &program.blocks {
        let sure = known.sure_in(block);
        if sure.is_empty() {
            continue;
        }
        for (at, earlier) in known.possible_in(block) {
            let mut met = BTreeSet::new();
            if !next(block, at).into_iter().all(|next| next > at && surely(block, next, &sure, &mut met)) {
                continue;
            }
            let later = met.first().and_then(|at| sure.get(at)).copied();
            if let Some(later) = later
                && !found.iter().any(|(_, told)| told.caller.id == later.caller.id && told.at == later.at)
            {
                found.push((earlier, later));
            }
        }
    }
    found
}

/// The calls of a program, block by block.
struct Known<'a, 'b> {
    program: &'a Program,
    sites: &'b [Site<'a>],
    /// A call that each run of a block makes.
    sure: BTreeMap<BlockId, Option<Site<'a>>>,
    /// A call that a run of a block can make.
    possible: BTreeMap<BlockId, Option<Site<'a>>>,
}

impl<'a> Known<'a, '_> {
    fn own(&self, block: &CodeBlock, at: usize) -> Option<Site<'a>> {
        self.sites.iter().find(|site| site.caller.id == block.id && site.at == at).copied()
    }

    fn block(&self, id: BlockId) -> Option<&'a CodeBlock> {
        self.program.blocks.iter().find(|block| block.id == id)
    }

    /// The statements of a block that surely make such a call, once they are reached.
    fn sure_in(&mut self, block: &'a CodeBlock) -> BTreeMap<usize, Site<'a>> {
        let mut sure = BTreeMap::new();
        for (at, call) in calls(block).filter(|(_, call)| call.mode != CallMode::Conditional) {
            let site = self.own(block, at).or_else(|| self.sure_of(called(call)?));
            sure.extend(site.map(|site| (at, site)));
        }
        sure
    }

    fn sure_of(&mut self, id: BlockId) -> Option<Site<'a>> {
        if let Some(known) = self.sure.get(&id) {
            return *known;
        }
        // A block that calls itself gets no call of its own by that.
        self.sure.insert(id, None);
        let block = self.block(id)?;
        let sure = self.sure_in(block);
        let mut met = BTreeSet::new();
        let site = surely(block, 0, &sure, &mut met).then(|| sure.get(met.first()?).copied()).flatten();
        self.sure.insert(id, site);
        site
    }

    /// The statements of a block that can make such a call.
    fn possible_in(&mut self, block: &'a CodeBlock) -> Vec<(usize, Site<'a>)> {
        let mut possible = Vec::new();
        for (at, call) in calls(block) {
            let site = self.own(block, at).or_else(|| self.possible_of(called(call)?));
            possible.extend(site.map(|site| (at, site)));
        }
        possible
    }

    fn possible_of(&mut self, id: BlockId) -> Option<Site<'a>> {
        if let Some(known) = self.possible.get(&id) {
            return *known;
        }
        self.possible.insert(id, None);
        let block = self.block(id)?;
        let site = self.possible_in(block).first().map(|(_, site)| *site);
        self.possible.insert(id, site);
        site
    }
}

/// Whether every way from this statement comes to one of `goals`, jumps backwards left out; those it comes to are put
/// into `met`.
fn surely(block: &CodeBlock, from: usize, goals: &BTreeMap<usize, Site<'_>>, met: &mut BTreeSet<usize>) -> bool {
    let (mut seen, mut waiting) = (BTreeSet::new(), vec![from]);
    while let Some(at) = waiting.pop() {
        if goals.contains_key(&at) {
            met.insert(at);
            continue;
        }
        if !seen.insert(at) {
            continue;
        }
        let next = next(block, at);
        if next.is_empty() || next.iter().any(|next| *next <= at) {
            return false;
        }
        waiting.extend(next);
    }
    true
}

/// The statements that can follow this one; none if the block can end here.
fn next(block: &CodeBlock, at: usize) -> Vec<usize> {
    match block.code.get(at).map(|stmt| &stmt.op) {
        Some(Op::Jump(Jump::Always, to)) => vec![*to as usize],
        Some(Op::Jump(_, to) | Op::Loop(to)) => vec![at + 1, *to as usize],
        Some(Op::JumpList { targets, otherwise }) => targets.iter().chain([otherwise]).map(|to| *to as usize).collect(),
        Some(Op::End | Op::EndIf) | None => Vec::new(),
        Some(_) => vec![at + 1],
    }
}
