//! Breakpoints and single step: what is asked of a CPU, and what it shows while it holds.

use crate::BlockId;

/// Breakpoints at one time in a CPU.
pub const BREAKPOINTS: usize = 4;
/// Bytes of local data that a hold shows at most.
pub const HELD_LOCAL: usize = 256;

/// A statement before which the CPU goes to HOLD.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Breakpoint {
    /// The block with the statement.
    pub block: BlockId,
    /// Its statement, from 0.
    pub statement: u32,
}

/// How a CPU in HOLD goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resume {
    /// To the next breakpoint.
    Run,
    /// One statement, into a block that it calls.
    Into,
    /// One statement; a block that it calls runs to its end.
    Over,
    /// To the statement after the call of the running block.
    Out,
}

/// An order about breakpoints and HOLD.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DebugOrder {
    /// These breakpoints from now on, no others; at most [`BREAKPOINTS`].
    Breakpoints(Vec<Breakpoint>),
    /// The answer comes when the CPU holds, or after `wait` nanoseconds. A CPU in HOLD goes on before, if `resume` says
    /// how; without it the answer comes at once.
    Hold {
        /// How it goes on.
        resume: Option<Resume>,
        /// Nanoseconds, at most [`crate::PASS_WAIT`].
        wait: u64,
    },
    /// No breakpoints any more. A CPU in HOLD goes to STOP.
    End,
    /// The stacks of a CPU in HOLD or in STOP; they change nothing.
    Stack {
        /// The local data of the block at this place of the stack: 0 is the innermost.
        level: u8,
    },
    /// In STOP: peripheral outputs can be written, and forced outputs have their values, or no longer. A change of the
    /// operating state and [`DebugOrder::End`] disable them again. (STEP 7: "Enable Peripheral Outputs")
    Outputs(bool),
}

/// A block that runs, or has called another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeldBlock {
    /// Kind and number of the block.
    pub block: BlockId,
    /// Its statement, from 0: the next of the innermost, of the others the call.
    pub statement: u32,
    /// DB and DI register: of the innermost now, of the others when they were entered, and in STOP at their call. 0:
    /// none is open.
    pub blocks: [u16; 2],
    /// The organization block it runs in.
    pub ob: u16,
    /// Priority class of that organization block.
    pub priority: u8,
    /// When it began, as a DATE_AND_TIME.
    pub began: [u8; 8],
    /// Where the statement lies in the block's machine code, in bytes, if that is known.
    pub address: Option<u16>,
}

/// Where a CPU holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Held {
    /// The blocks under way, the innermost first.
    pub stack: Vec<HeldBlock>,
    /// The status word: from bit 0 /FC, RLO, STA, OR, OS, OV, CC0, CC1, BR.
    pub status: u16,
    /// ACCU1 to ACCU4, in this order.
    pub accus: [u32; 4],
    /// Address registers AR1 and AR2.
    pub addresses: [u32; 2],
    /// Local data of a block, the first [`HELD_LOCAL`] bytes: of the innermost, unless another was asked for.
    pub local: Vec<u8>,
    /// Start information of the organization block that was under way.
    pub start: [u8; 20],
}

/// How an order has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DebugEnd {
    /// The order was carried out.
    Done,
    /// The CPU is in HOLD, at [`DebugAnswer::held`].
    Held,
    /// The CPU runs; it has not come to a breakpoint in time.
    #[default]
    Runs,
    /// It is in STOP.
    Stopped,
    /// The program has no such block of statements, or the block no such statement: this entry of the list.
    NoStatement(u8),
}

/// The answer to an order about breakpoints.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DebugAnswer {
    /// How the order has ended.
    pub end: DebugEnd,
    /// Where it holds. In STOP, for who asks for the stacks: where the program has stopped; else an empty stack.
    pub held: Held,
}
