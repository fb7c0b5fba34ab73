//! The call structure: who calls whom, from the organization blocks on.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::ops::Deref;

use ob1_ir::{CodeBlock, Number, Op, Program, Target};
use ob1_model::{BlockId, BlockKind};

use super::CrossReference;

/// A call, as the tree has it.
struct Called<'p> {
    depth: usize,
    /// None: known at run time only.
    id: Option<BlockId>,
    /// What is called, with its instance.
    text: String,
    /// The calling block; none for an organization block.
    caller: Option<&'p CodeBlock>,
    line: u32,
    network: u16,
}

impl<P: Deref<Target = Program>> CrossReference<P> {
    /// The call structure as text: each block is opened where it stands first. Then the blocks that nothing calls.
    pub fn calls(&self) -> String {
        let program: &Program = &self.program;
        let blocks: BTreeMap<BlockId, &CodeBlock> = program.blocks.iter().map(|block| (block.id, block)).collect();
        let mut out = String::new();
        let mut opened = BTreeSet::new();
        let mut at_run_time = BTreeSet::new();
        let obs = blocks.keys().filter(|id| id.kind == BlockKind::Ob).rev();
        let root =
            |id: &BlockId| Called { depth: 0, id: Some(*id), text: id.to_string(), caller: None, line: 0, network: 0 };
        let mut open: Vec<Called<'_>> = obs.map(root).collect();
        while let Some(call) = open.pop() {
            let block = call.id.and_then(|id| blocks.get(&id).copied());
            let name =
                block.and_then(|block| block.name.as_ref()).map(|name| format!(" \"{name}\"")).unwrap_or_default();
            let first = call.id.is_none_or(|id| opened.insert(id));
            let again = if first || block.is_none_or(|block| calls_of(block, 0).is_empty()) { "" } else { "  (above)" };
            let place = call.caller.map_or_else(String::new, |caller| place(program, caller, &call));
            let _ = writeln!(out, "{}{}{name}{place}{again}", "  ".repeat(call.depth), call.text);
            if let (Some(block), true) = (block, first) {
                let mut inner = calls_of(block, call.depth + 1);
                at_run_time.extend(inner.iter().filter(|call| call.id.is_none()).map(|call| call.text.clone()));
                inner.reverse();
                open.append(&mut inner);
            }
        }
        let uncalled: Vec<String> = blocks.keys().filter(|id| !opened.contains(id)).map(BlockId::to_string).collect();
        if !uncalled.is_empty() {
            let _ = writeln!(out, "not called by an organization block: {}", uncalled.join(", "));
        }
        if !at_run_time.is_empty() {
            let list: Vec<String> = at_run_time.into_iter().collect();
            let _ = writeln!(out, "called by a number known at run time only: {}", list.join(", "));
        }
        out
    }
}

fn place(program: &Program, caller: &CodeBlock, call: &Called<'_>) -> String {
    let file = program.sources.get(caller.source as usize);
    let line = file.map_or_else(|| format!("line {}", call.line), |file| format!("{file}:{}", call.line));
    format!("  network {}, {line}", call.network)
}

/// The calls in a block, each target and instance once.
fn calls_of(block: &CodeBlock, depth: usize) -> Vec<Called<'_>> {
    let mut seen = BTreeSet::new();
    let calls = block.code.iter().filter_map(|stmt| {
        let Op::Call(call) = &stmt.op else { return None };
        let (id, mut text) = match call.target {
            Target::Block(id) => (Some(id), id.to_string()),
            Target::Local(id, at) => {
                let name = crate::names::in_instance(block, at, u32::MAX).unwrap_or_default();
                (Some(id), format!("{id} {name}").trim_end().to_owned())
            }
            Target::Indirect(kind, number) => (None, format!("{} {number}", kind.name())),
        };
        match call.instance {
            Some(Number::Fixed(db)) => text += &format!(", DB {db}"),
            Some(number) => text += &format!(", DB {number}"),
            None => {}
        }
        let (line, network) = (stmt.line, stmt.network);
        seen.insert(text.clone()).then_some(Called { depth, id, text, caller: Some(block), line, network })
    });
    calls.collect()
}
