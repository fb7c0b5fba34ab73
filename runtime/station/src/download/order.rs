//! `ob1 load`: what is ordered of the thread that changes the program, and what it tells.

use std::collections::BTreeSet;
use std::sync::mpsc::{self, Receiver, Sender};

use ob1_ir::{CodeBlock, DataBlock, Program};
use ob1_model::{BlockId, BlockKind};
use ob1_stl::Library;
use serde::{Deserialize, Serialize};

use super::loader::Order;
use crate::access::protocol::Download;

/// What is to be loaded.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(default)]
pub struct LoadOrder {
    /// The program before the last change; else what the sources say now.
    pub back: bool,
    /// Only tell what would change.
    pub check: bool,
    /// Only if it is this program: the fingerprint that was told.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expect: Option<String>,
    /// Tell the texts of both programs too.
    pub texts: bool,
}

/// What has changed, or would.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(default)]
pub struct LoadStatus {
    /// It has taken effect.
    pub loaded: bool,
    /// The blocks that differ.
    pub changed: Vec<Download>,
    /// Values of data blocks that are lost: `DB 5.level: gone`.
    pub lost: Vec<String>,
    /// Says which program it is.
    pub fingerprint: String,
    /// Why the change is lost when the station ends, if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_kept: Option<String>,
    /// The program that runs, the one that follows, and the blocks they call that are not their own, without
    /// statements.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texts: Option<[String; 3]>,
}

impl LoadStatus {
    /// What changes where `next` follows `now`.
    pub(super) fn new(now: &Program, next: &Program, lost: Vec<String>, texts: Option<&Library>) -> Self {
        let text = ob1_ir::write(next);
        let fingerprint = format!("{:016x}", ob1_process::files::checksum(text.bytes()));
        let change = |(block, what): (BlockId, &str)| Download { block: block.to_string(), what: what.to_owned() };
        let texts = texts.map(|library| [ob1_ir::write(now), text, ob1_ir::write(&declared(library))]);
        Self {
            changed: differing(now, next).into_iter().map(change).collect(),
            lost,
            fingerprint,
            texts,
            ..Self::default()
        }
    }
}

/// The blocks of a library, without statements.
fn declared(library: &Library) -> Program {
    let block = |(id, block): (BlockId, &ob1_stl::LibraryBlock)| CodeBlock {
        id,
        name: Some(block.name.clone()),
        interface: block.interface.clone(),
        code: Vec::new(),
        source: 0,
    };
    Program { blocks: library.iter().map(block).collect(), ..Program::default() }
}

/// The blocks that differ between two programs, in what they mean.
pub(super) fn differing(before: &Program, next: &Program) -> Vec<(BlockId, &'static str)> {
    let code = |program: &Program| program.blocks.iter().map(|block| block.id).collect::<BTreeSet<_>>();
    let data = |program: &Program| {
        program.data.iter().map(|db| BlockId::new(BlockKind::Db, db.number)).collect::<BTreeSet<_>>()
    };
    let all = code(before).into_iter().chain(code(next)).chain(data(before)).chain(data(next));
    let what = |id: BlockId| {
        let found = |old: bool, new: bool, same: bool| match (old, new) {
            (true, false) => Some("deleted"),
            (false, true) => Some("new"),
            _ => (!same).then_some("changed"),
        };
        if id.kind == BlockKind::Db {
            let of = |program: &'_ Program| program.data.iter().position(|db| db.number == id.number);
            let (old, new) = (of(before), of(next));
            let same = old.zip(new).is_some_and(|(old, new)| same_data(&before.data[old], &next.data[new]));
            return found(old.is_some(), new.is_some(), same);
        }
        let of = |program: &'_ Program| program.blocks.iter().position(|block| block.id == id);
        let (old, new) = (of(before), of(next));
        let same = old.zip(new).is_some_and(|(old, new)| before.blocks[old].means(&next.blocks[new]));
        found(old.is_some(), new.is_some(), same)
    };
    let all: BTreeSet<BlockId> = all.collect();
    all.into_iter().filter_map(|id| Some((id, what(id)?))).collect()
}

fn same_data(one: &DataBlock, other: &DataBlock) -> bool {
    let nameless = |db: &DataBlock| DataBlock { name: None, ..db.clone() };
    nameless(one) == nameless(other)
}

/// An order, and where its outcome is told.
pub(super) struct Loading {
    pub(super) order: LoadOrder,
    pub(super) tell: Sender<Result<LoadStatus, String>>,
}

/// Where loads are ordered.
#[derive(Clone, Debug)]
pub struct Loads(Sender<Order>);

impl Loads {
    pub(super) const fn new(orders: Sender<Order>) -> Self {
        Self(orders)
    }

    /// Orders a load; the outcome comes there. `None`: the station ends.
    pub(crate) fn load(&self, order: LoadOrder) -> Option<Receiver<Result<LoadStatus, String>>> {
        let (tell, told) = mpsc::channel();
        self.0.send(Order::Load(Loading { order, tell })).ok()?;
        Some(told)
    }
}
