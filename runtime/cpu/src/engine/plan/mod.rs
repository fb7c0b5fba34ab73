//! What is loaded, as every engine runs it: blocks in pre-decoded form, calls with their parameters resolved, the
//! places of areas and data blocks. Made once at load, never changed except for the account of what has been executed.

mod call;
mod executed;
mod lower;
mod lower_call;
mod lowering;
mod op;
mod safe_points;
mod signature;

use ob1_ir::Stmt;
use ob1_model::{BlockId, Site};

use crate::arena::{Db, Range};

pub use call::{Call, CallTarget, InSource, InstanceIn, InstanceOf, InstanceOut, List, OutTarget, RefArg};
pub use executed::Executed;
pub(crate) use lower::{lower, writes_param};
pub(crate) use lower_call::collect;
pub(crate) use lowering::{Constants, Lowering};
pub use op::{AREA_IN_POINTER, Base, Op, Scan};
pub use safe_points::SHORT_BLOCK;
pub(crate) use safe_points::mark as mark_safe_points;
pub use signature::{Formal, Signature, Signatures};

/// A loaded block, found without its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Callee {
    /// Statements: index of [`Plan::blocks`].
    Code(u32),
    /// A native block, by index.
    Native(u32),
}

/// A statement, as engines number them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caller {
    /// Index of the block in [`Plan::blocks`].
    pub block: u32,
    /// Index of the statement in the block.
    pub statement: u32,
}

/// The places of the areas in the arena.
#[derive(Clone, Copy, Debug, Hash)]
pub struct Areas {
    /// Process image of the inputs.
    pub inputs: Range,
    /// Process image of the outputs.
    pub outputs: Range,
    /// Bit memory, from M 0.0 on.
    pub memory: Range,
    /// The stack of local data.
    pub local: Range,
    /// What calls copy in and out.
    pub scratch: Range,
    /// Constants that calls refer to.
    pub constants: Range,
}

impl Areas {
    /// The byte of the arena is one of the process images or of bit memory.
    pub fn is_image(&self, at: u32) -> bool {
        let within = |range: &Range| (range.at.0..range.at.0 + range.len).contains(&at);
        [&self.inputs, &self.outputs, &self.memory].into_iter().any(within)
    }
}

/// A block, ready to run.
#[derive(Clone, Debug, Hash)]
pub struct Block {
    /// Kind and number of the block.
    pub id: BlockId,
    /// One per statement, and the block's end, which counts as the `BE` it is on the CPU.
    pub ops: Box<[Op]>,
    /// The statements in the intermediate code, as many as there are operations but one.
    pub stmts: Box<[Stmt]>,
    /// Bytes of local data.
    pub local_len: u32,
    /// Calls, by the index in [`Op::Call`] and [`Op::CallNative`].
    pub calls: Box<[Call]>,
    /// A jump leads back: a run may execute more statements than there are.
    pub loops: bool,
    /// Targets of `SPL`, the last one for numbers beyond the list.
    pub lists: Box<[Box<[u32]>]>,
}

impl Block {
    /// Where a statement is in the source.
    #[must_use]
    pub fn site(&self, statement: usize) -> Site {
        let stmt = self.stmts.get(statement);
        Site { block: self.id, network: stmt.map_or(0, |s| s.network), line: stmt.map_or(0, |s| s.line) }
    }

    /// The call at a statement, if it is one.
    #[must_use]
    pub fn call(&self, statement: usize) -> Option<&Call> {
        match self.ops.get(statement)? {
            Op::Call { call } | Op::CallNative { call, .. } => self.calls.get(*call as usize),
            _ => None,
        }
    }
}

/// Everything engines know of a loaded program.
#[derive(Debug)]
pub struct Plan {
    /// Blocks of statements, indexed by [`Callee::Code`].
    pub blocks: Box<[Block]>,
    /// Every loaded block and its parameters, sorted by id.
    pub signatures: Signatures,
    /// OB 1, which every scan calls.
    pub ob1: Option<Callee>,
    /// Where the areas lie.
    pub areas: Areas,
    /// The data blocks of the program in ascending order of their numbers. Their place, length and write protection
    /// never change; a program makes and deletes only others.
    pub data: Box<[Db]>,
    /// Bytes of address space, from the arena's first on, in which an access either reaches the arena or traps.
    pub arena_reserved: u64,
    /// Number of accumulators: 2 (S7-300) or 4 (S7-400).
    pub accumulators: u8,
    /// Timers T 0 to T n-1.
    pub timers: u16,
    /// Counters Z 0 to Z n-1.
    pub counters: u16,
    /// Blocks that can be nested in one organization block.
    pub nesting_depth: u8,
    /// Bytes of stack that the thread of the CPU has for each nested block of statements; an engine that needs more
    /// cannot take over.
    pub stack_per_block: usize,
    /// Most blocks of statements under way at one time, in all organization blocks together.
    pub frames: usize,
    /// Statements executed in each block, if the engine counts them.
    pub executed: Executed,
}

impl Plan {
    /// Where a statement is in the source.
    #[must_use]
    pub fn site(&self, at: Caller) -> Option<Site> {
        Some(self.blocks.get(at.block as usize)?.site(at.statement as usize))
    }
}
