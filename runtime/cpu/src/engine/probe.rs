//! The probe: what an engine does while a block is watched. The engine without jobs has no code for it: each run loop
//! is a function of `WATCHES`, and the one with `false` knows nothing of this.

use ob1_model::PASS_JOBS;

use super::Caller;
use super::call::status_of_call;
use super::regs::Regs;
use crate::watching::Entering;
use crate::{Abort, Context};

/// The blocks that jobs are about, by their index in [`super::Plan::blocks`]; none: no job is armed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Watched {
    /// Blocks that are watched.
    pub blocks: [Option<u32>; PASS_JOBS],
    /// Blocks of which it must be known whether a watched one was called in them.
    pub callers: [Option<u32>; PASS_JOBS],
    /// Every block runs statement by statement: there are breakpoints, or values are forced.
    pub every: bool,
}

impl Watched {
    /// All watched blocks and their callers, by index.
    pub fn all(&self) -> impl Iterator<Item = u32> {
        self.blocks.into_iter().chain(self.callers).flatten()
    }
}

/// What watching costs in an engine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slow {
    /// A watched pass takes much longer than another: it is weighed before.
    pub weighs: bool,
    /// A watched block is part of others' machine code: these run without it while a job is armed.
    pub contained: bool,
}

/// A run of a block while there are jobs.
#[derive(Clone, Copy, Debug)]
pub struct Entered {
    entering: Entering,
    /// It must run statement by statement, with [`Context::next_statement`] before each.
    pub probed: bool,
    statements: u64,
}

impl Entered {
    /// The number of the run.
    #[must_use]
    pub const fn run(&self) -> u32 {
        self.entering.run
    }
}

impl Context<'_> {
    /// A number for a run of a block.
    #[must_use]
    pub fn new_run(&mut self) -> u32 {
        self.machine.watching.new_run()
    }

    /// While there are jobs: a block is entered, its registers in place. `contains`: a watched block is a part of its
    /// machine code. Every entering has its [`Context::leave`], unless the run is aborted.
    #[must_use]
    pub fn entered(&mut self, block: u32, caller: Option<Caller>, run: u32, contains: bool, r: &Regs) -> Entered {
        let entering = Entering { block, caller, run, contains };
        let called_by = caller.and_then(|caller| self.blocks.plan.blocks.get(caller.block as usize));
        let watched = self.machine.enter_watched(&entering, called_by.map(|block| block.id), r);
        let every = self.machine.watching.every();
        if every && let Some(entered) = self.blocks.plan.blocks.get(block as usize) {
            self.machine.debugging.entered(&entering, entered.id, &self.machine.ob, r);
        }
        Entered { entering, probed: watched || every, statements: self.statements() }
    }

    /// The block is left: its statements are accounted for.
    pub fn leave(&mut self, entered: &Entered) {
        if self.machine.forces_all() {
            self.machine.put_forced();
        }
        let inside = self.statements() - entered.statements;
        let block = self.blocks.plan.blocks.get(entered.entering.block as usize);
        // Without loops its own are no more than it has, whatever it calls.
        let own = block.filter(|block| !block.loops).map_or(inside, |block| block.ops.len() as u64);
        self.machine.leave_watched(&entered.entering, own);
        self.machine.debugging.left(entered.run());
    }

    /// The statement of a probed run that comes now. The CPU holds before it, if that is wanted.
    ///
    /// # Errors
    /// It has gone from HOLD to STOP.
    #[inline]
    pub fn next_statement(&mut self, run: u32, statement: u32, r: &Regs) -> Result<(), Abort> {
        if self.machine.forces_all() {
            self.machine.put_forced();
        }
        self.machine.watching.step(run, statement, r);
        self.may_hold(run, statement, r)
    }

    /// A probed run has come to its block's end; the registers are those that the end finds. Behind it the chain has
    /// ended, and OS is 0.
    pub fn pass_ends(&mut self, run: u32, r: &Regs) {
        let now = self.machine.real();
        let mut behind = *r;
        status_of_call(&mut behind);
        self.machine.watching.end(run, &behind, now);
    }

    fn statements(&self) -> u64 {
        self.machine.statements + u64::from(self.machine.hot.pending)
    }
}
