//! Program status: what is asked of one pass through a block, and what is seen in it.

use crate::BlockId;

/// Most statements of one job.
pub const PASS_STATEMENTS: usize = 512;
/// Jobs at one time in a CPU.
pub const PASS_JOBS: usize = 2;
/// The longest time a pass is waited for, in nanoseconds.
pub const PASS_WAIT: u64 = 60_000_000_000;

/// A job: watch one pass through a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PassOrder {
    /// The block that is watched.
    pub block: BlockId,
    /// Only a pass that this block has called, directly or through others.
    pub from: Option<BlockId>,
    /// Only a pass with this data block: in the DI register of an FB, in the DB register of others. 0: any.
    pub db: u16,
    /// The first watched statement, from 0, and how many from there on.
    pub first: u32,
    /// How many statements are recorded, at most [`PASS_STATEMENTS`].
    pub count: u32,
    /// How long the pass is waited for, in nanoseconds; at most [`PASS_WAIT`].
    pub wait: u64,
    /// The registers in front of each statement are wanted too: [`Pass::before`].
    pub before: bool,
}

/// The registers behind a statement, at its last execution in the pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassLine {
    /// How often it ran in the pass; 0: not at all, and nothing else here means anything.
    pub times: u32,
    /// The status word: from bit 0 /FC, RLO, STA, OR, OS, OV, CC0, CC1, BR.
    pub status: u16,
    /// ACCU1 and ACCU2, in this order.
    pub accus: [u32; 2],
    /// Address registers AR1 and AR2.
    pub addresses: [u32; 2],
    /// The numbers in the DB and DI register; 0: none is open.
    pub blocks: [u16; 2],
}

/// How a job has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PassEnd {
    /// The pass ran to the block's end.
    Whole,
    /// The CPU went to STOP in the pass; what ran until then is there.
    Stopped,
    /// No such pass came in time.
    #[default]
    NotCalled,
    /// The program has no such block of statements.
    NoBlock,
    /// [`PASS_JOBS`] are under way already.
    Full,
    /// The pass would make the scan longer than `[cpu] test_load` allows: nothing was watched.
    TooLong,
}

/// One pass through a block, as far as it was recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pass {
    /// How the job has ended.
    pub end: PassEnd,
    /// Recording was cut after so many statements of the pass, because of `[cpu] test_load`; 0: it was not. Of
    /// [`PassEnd::TooLong`]: the statements that a pass takes.
    pub cut: u32,
    /// Statements of the block.
    pub statements: u32,
    /// The organization block in which it ran.
    pub ob: u16,
    /// Who called it: block and statement; none for an organization block, or when a native block did.
    pub caller: Option<(BlockId, u32)>,
    /// When it ended, in nanoseconds of the CPU's time.
    pub time: u64,
    /// The watched statements, from [`PassOrder::first`] on.
    pub lines: Vec<PassLine>,
    /// The registers in front of each of them, if they were wanted.
    pub before: Vec<PassLine>,
}

/// A statement of the machine code that an upload gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodeAddress {
    /// Where it begins, in bytes.
    pub at: u32,
    /// The statement of the block that it is of, from 0; the one behind the last is the end.
    pub statement: u32,
    /// It opens the data block for this statement, which is another one in machine code: nothing else changes.
    pub opens: bool,
}
