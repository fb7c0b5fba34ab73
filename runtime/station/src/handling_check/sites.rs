//! The calls of handling blocks that a program can reach.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use ob1_host::plugin::Plugin;
use ob1_ir::{Arg, Call, CodeBlock, Number, Op, Program, Target};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_params::CpKind;

/// A block of the plugin of a CP.
pub(crate) struct Handling<'a> {
    /// Which CP it is for.
    pub(super) cp: CpKind,
    /// Its number in the plugin.
    pub(super) original: BlockId,
    /// Names of its parameters in the order of a call.
    formals: Vec<&'a str>,
}

/// The blocks of the CPs by their numbers in this program.
pub(crate) fn blocks_of(plugins: &[(Arc<Plugin>, BTreeMap<BlockId, BlockId>)]) -> BTreeMap<BlockId, Handling<'_>> {
    let mut blocks = BTreeMap::new();
    for (plugin, renumber) in plugins {
        let Some(cp) = CpKind::of_name(&plugin.info().name).filter(|cp| !cp.row().has_boxes) else { continue };
        for block in &plugin.info().blocks {
            let id = renumber.get(&block.id).copied().unwrap_or(block.id);
            blocks.insert(id, Handling::new(cp, block.id, &block.interface));
        }
    }
    blocks
}

impl<'a> Handling<'a> {
    /// A block of a CP, under its number in the plugin.
    pub(super) fn new(cp: CpKind, original: BlockId, interface: &'a Interface) -> Self {
        Self { cp, original, formals: interface.formals().map(|param| param.name.as_str()).collect() }
    }
}

/// A call of a handling block.
#[derive(Clone, Copy)]
pub(super) struct Site<'a> {
    /// The block that it stands in.
    pub(super) caller: &'a CodeBlock,
    /// Index of its statement in that block.
    pub(super) at: usize,
    call: &'a Call,
    /// Its number in this program.
    pub(super) id: BlockId,
    /// The handling block that is called.
    pub(super) block: &'a Handling<'a>,
}

impl<'a> Site<'a> {
    /// The number in the plugin, of a block of this CP.
    pub(super) fn number(&self, cp: CpKind) -> Option<u16> {
        (self.block.cp == cp).then_some(self.block.original.number)
    }

    fn arg(&self, name: &str) -> Option<&'a Arg> {
        self.call.args.get(self.block.formals.iter().position(|formal| *formal == name)?)
    }

    /// The constant supplied to a parameter.
    pub(super) fn constant(&self, name: &str) -> Option<u32> {
        match self.arg(name)? {
            Arg::Const(value) => Some(*value & 0xFFFF),
            _ => None,
        }
    }

    /// The number of a timer or block supplied to a parameter.
    pub(super) fn fixed(&self, name: &str) -> Option<u16> {
        match self.arg(name)? {
            Arg::Number(Number::Fixed(number)) => Some(*number),
            _ => None,
        }
    }

    /// The logical address of the CP, if it is a constant.
    pub(super) fn address(&self) -> Option<u32> {
        ["ADR", "LADDR", "ADDR_IN"].iter().find_map(|name| self.constant(name))
    }

    /// The instances it works with, as far as they are known before the run: each a data block, and the places in it
    /// from the outside to the inside. Several, if the block that it stands in has several.
    pub(super) fn instances(&self, program: &Program) -> BTreeSet<Vec<u32>> {
        instances_of(program, self.caller, self.call, &mut Vec::new())
    }

    /// Line in the source.
    pub(super) fn line(&self) -> u32 {
        self.caller.code.get(self.at).map_or(0, |stmt| stmt.line)
    }
}

/// The instances of a call in this block; `within`: the blocks whose instances are being looked for.
fn instances_of(program: &Program, caller: &CodeBlock, call: &Call, within: &mut Vec<BlockId>) -> BTreeSet<Vec<u32>> {
    match (call.target, call.instance) {
        (Target::Block(_), Some(Number::Fixed(db))) => [vec![u32::from(db)]].into(),
        (Target::Local(_, at), Some(Number::Fixed(db))) => [vec![u32::from(db), at.byte()]].into(),
        (Target::Local(_, at), None) if !within.contains(&caller.id) => {
            within.push(caller.id);
            let own = program.blocks.iter().flat_map(|block| calls(block).map(move |(_, call)| (block, call)));
            let outer = own.filter(|(_, call)| called(call) == Some(caller.id));
            let outer: BTreeSet<Vec<u32>> =
                outer.flat_map(|(block, call)| instances_of(program, block, call, within)).collect();
            within.pop();
            // Without a known one outside it is at least one.
            let outer = if outer.is_empty() { [Vec::new()].into() } else { outer };
            outer.into_iter().map(|outer| [outer, vec![at.byte()]].concat()).collect()
        }
        _ => BTreeSet::new(),
    }
}

/// Blocks that run: those that organization blocks reach. A call whose target is known only in the run can reach every
/// one.
fn reached(program: &Program) -> BTreeSet<BlockId> {
    let mut reached: BTreeSet<BlockId> =
        program.blocks.iter().map(|block| block.id).filter(|id| id.kind == BlockKind::Ob).collect();
    let mut waiting: Vec<BlockId> = reached.iter().copied().collect();
    while let Some(id) = waiting.pop() {
        let Some(block) = program.blocks.iter().find(|block| block.id == id) else { continue };
        for (_, call) in calls(block) {
            match called(call) {
                Some(next) if reached.insert(next) => waiting.push(next),
                Some(_) => {}
                None => return program.blocks.iter().map(|block| block.id).collect(),
            }
        }
    }
    reached
}

/// The calls of a block, with their statements.
pub(super) fn calls(block: &CodeBlock) -> impl Iterator<Item = (usize, &Call)> {
    block.code.iter().enumerate().filter_map(|(at, stmt)| match &stmt.op {
        Op::Call(call) => Some((at, call.as_ref())),
        _ => None,
    })
}

/// Which block a call calls; `None`: known only in the run.
pub(super) fn called(call: &Call) -> Option<BlockId> {
    match call.target {
        Target::Block(id) | Target::Local(id, _) => Some(id),
        Target::Indirect(..) => None,
    }
}

/// All calls of handling blocks in blocks that run.
pub(super) fn sites<'a>(program: &'a Program, blocks: &'a BTreeMap<BlockId, Handling<'a>>) -> Vec<Site<'a>> {
    if blocks.is_empty() {
        return Vec::new();
    }
    let reached = reached(program);
    let mut sites = Vec::new();
    for caller in program.blocks.iter().filter(|block| reached.contains(&block.id)) {
        for (at, call) in calls(caller) {
            let Some(id) = called(call) else { continue };
            if let Some(block) = blocks.get(&id) {
                sites.push(Site { caller, at, call, id, block });
            }
        }
    }
    sites
}
