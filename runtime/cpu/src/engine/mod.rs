//! Engines: what executes blocks, and everything engines share.
//!
//! A loaded program is a [`Plan`]. A [`Factory`] makes an [`Engine`] of it; [`Cpu::new`](crate::Cpu::new) is given the
//! factory, and [`Cpu::exchange_engine`](crate::Cpu::exchange_engine) exchanges the engine between two scans. The
//! reference engine ([`REFERENCE`]) defines what a statement means; [`PLAIN`] is the same without short forms, and
//! [`ACCOUNTING`] the same with an account of what each block executes.
//!
//! # The contract of an engine
//!
//! [`Engine::call`] runs a block of statements to its end and everything it calls. It may be called again before it
//! returns: an organization block runs within a safe point or a fault, and a native block calls blocks. What an engine
//! keeps for nested blocks is its own affair; so are the registers of the running block, [`Regs`].
//!
//! **Registers.** Only the engine sees them. A helper of [`Context`] that needs them takes them as an argument: before
//! the call they must be in the structure, after it they are read back from there. An organization block that runs
//! within a safe point has its own.
//!
//! **The hot state.** [`Context::hot`] hands out [`Hot`], which the engine reads and writes directly, and which every
//! helper may change. The arena is one alias region: parameters, pointers, areas and data blocks may name the same
//! bytes. Registers and hot state are a second one.
//!
//! **Statements** are counted in [`Hot::pending`], one for each, the block's end included. The count must be true,
//! the running statement included, when a safe point looks, at each helper that is given a [`Caller`], and when
//! [`Engine::call`] returns; helpers may change it.
//!
//! **Safe points** are backward jumps that are taken and calls, conditional ones included; in no other place does time
//! move. A safe point looks when `pending >= look_after` or the flag `due` is set; then [`Context::safe_point`] tells
//! the clock, serves the operator's STOP, the cycle monitoring and interrupts of higher classes. `at` is the statement
//! that comes next: the jump's target, or the one after the call.
//!
//! **Faults** go to [`Context::fault_at`] with the statement that made them; the site in the source follows from it.
//! The organization block runs, and the program continues with the next statement.
//!
//! **[`Abort`]** comes back unchanged through every level at once. The caller of the engine restores stacks and
//! counters in the hot state.

mod arith;
mod both;
mod call;
mod convert;
mod helpers;
mod hot;
mod jump;
mod operand;
mod plan;
mod pointer_list;
mod probe;
mod reference;
mod regs;
mod shift;
mod statement;

use std::sync::Arc;

use ob1_arena::Arena;

use crate::Abort;

pub use crate::arena::{ArenaBit, ArenaByte, Db, Range};
pub use crate::context::Context;
pub use crate::timers::{Counter, Timer};
pub use arith::{compare_dint, compare_int, compare_real, dint, int, math, real};
pub use both::Both;
pub(crate) use both::Tape;
pub use call::{Prepared, Saved, Tops};
pub use convert::convert;
pub use hot::Hot;
pub use jump::condition;
pub use operand::{OWN_LOCAL, POINTER_BITS, RAW};
pub use plan::{
    AREA_IN_POINTER, Areas, Base, Block, Call, CallTarget, Callee, Caller, Executed, Formal, InSource, InstanceIn,
    InstanceOf, InstanceOut, List, Op, OutTarget, Plan, RefArg, SHORT_BLOCK, Scan, Signature, Signatures,
};
pub(crate) use plan::{Constants, Lowering, collect, lower, mark_safe_points, writes_param};
pub use probe::{Entered, Slow, Watched};
pub use reference::{ACCOUNTING, PLAIN, REFERENCE};
pub(crate) use regs::Interrupted;
pub use regs::{BR, CC0, CC1, FC, OR, OS, OV, RLO, Regs, STA, with_cc};
pub use shift::shift;

/// What a block finds when it is entered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entry {
    /// Where the references to its actual parameters begin in the stack of references.
    pub refs: u32,
    /// Bit n: parameter n was supplied.
    pub given: u64,
    /// The DB register, as the caller has left it.
    pub db: Db,
    /// The DI register: the instance of an FB.
    pub di: Db,
    /// Address register 2: where the instance begins in it.
    pub ar2: u32,
    /// The caller's local data.
    pub previous_local: ArenaByte,
    /// Length of the caller's local data in bytes.
    pub previous_local_len: u32,
}

/// What executes blocks of statements.
pub trait Engine: Send {
    /// Its name, for reports.
    fn name(&self) -> &'static str;

    /// The plan it was made of.
    fn plan(&self) -> &Arc<Plan>;

    /// Runs a block to its end.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    fn call(&self, block: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<(), Abort>;

    /// Program status: from now on these blocks are run with [`Context::entered`], [`Context::next_statement`],
    /// [`Context::pass_ends`] and [`Context::leave`], until it is said otherwise. Between two runs only; nothing is
    /// allocated. An engine that cannot do it leaves it.
    fn watch(&self, _watched: &Watched) {}

    /// What that costs here.
    fn watching(&self) -> Slow {
        Slow::default()
    }
}

/// What makes engines, and the memory that they work on.
pub trait Factory {
    /// The engine that runs this plan.
    ///
    /// # Errors
    /// Why it cannot, in words: this processor or this system lacks something.
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String>;

    /// The memory of the CPU: `bytes` bytes of 0. One that covers offsets of 32 bits lets the engine leave checks to
    /// the hardware.
    fn arena(&self, bytes: usize) -> Arena {
        Arena::new(bytes)
    }

    /// Bytes of the thread's stack that a nested block of statements takes at most, in this engine or any that may take
    /// its place.
    fn stack_per_block(&self) -> usize {
        0
    }

    /// That stack is for an engine that may take over later. If there is not enough room for it, the program is loaded
    /// without it, as [`Plan::stack_per_block`] then shows.
    fn stack_is_for_later(&self) -> bool {
        false
    }
}
