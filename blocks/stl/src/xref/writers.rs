//! Who writes a bit, timer or counter, and which blocks a call leads to.

use std::collections::BTreeSet;
use std::ops::Deref;

use ob1_ir::{BitTest, Number, Op, Place, Program, Target};
use ob1_model::{Area, BlockId};

use super::extent::{Match, Wanted};
use super::{Access, CrossReference, Reference};

impl<P: Deref<Target = Program>> CrossReference<P> {
    /// The statements that certainly write what a scan reads, calls with their parameters included.
    pub fn writers(&self, test: &BitTest) -> Vec<&Reference> {
        let wanted = match *test {
            BitTest::Bit(Place::Fixed(area @ (Area::Input | Area::Output | Area::Memory), at)) => {
                Wanted::Bits { area, at: at.0, bits: 1, written: None }
            }
            BitTest::Bit(Place::InDb(db, at)) => Wanted::Data { db, at: at.0, bits: 1 },
            BitTest::Timer(Number::Fixed(n)) => Wanted::Timers(n, n),
            BitTest::Counter(Number::Fixed(n)) => Wanted::Counters(n, n),
            _ => return Vec::new(),
        };
        let certain = self.meeting(&wanted).filter(|(how, _)| *how != Match::Possible);
        certain.map(|(_, reference)| reference).filter(|reference| reference.writes()).collect()
    }

    /// The statements that call a block.
    pub fn callers(&self, block: BlockId) -> Vec<&Reference> {
        let wanted = Wanted::Blocks(block.kind, block.number, block.number);
        self.meeting(&wanted).map(|(_, reference)| reference).filter(|r| r.access == Access::Call).collect()
    }

    /// A block and all those that it calls, directly or through others.
    pub fn reached_from(&self, block: BlockId) -> BTreeSet<BlockId> {
        let (mut seen, mut open) = (BTreeSet::new(), vec![block]);
        while let Some(id) = open.pop() {
            if !seen.insert(id) {
                continue;
            }
            let code = self.program.blocks.iter().find(|block| block.id == id).map(|block| block.code.as_slice());
            for stmt in code.unwrap_or_default() {
                if let Op::Call(call) = &stmt.op
                    && let Target::Block(id) | Target::Local(id, _) = call.target
                {
                    open.push(id);
                }
            }
        }
        seen
    }

    /// The name and the symbol of an operand at a line, `E 1.0` as the reference has it.
    pub fn named_at(&self, block: BlockId, line: u32, operand: &str) -> Option<&Reference> {
        let of_line = |r: &&Reference| r.block == block && r.line == line && r.via.is_none();
        let mut all = self.all.iter().filter(of_line);
        let exact = self.all.iter().filter(of_line).find(|r| r.operand == operand);
        // A name of the block has its own form; where the line has one operand only, it is that.
        exact.or_else(|| all.next().filter(|_| all.next().is_none()))
    }
}
