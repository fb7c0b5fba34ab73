//! The stacks of a CPU that has gone to STOP in its program: the blocks that were under way, as engines abandon them,
//! the registers of the innermost, and where the local data of each lie. They are there until the next start-up, or
//! another program. ("Programming with STEP 7", 23.6)

use ob1_model::{BlockId, HELD_LOCAL, Held, HeldBlock};

use crate::engine::{Caller, Regs};
use crate::machine::Machine;
use crate::{Context, ObInfo};

/// Most nested blocks that a stack shows.
pub(crate) const DEEPEST: usize = 128;

/// Local data of a block: first byte in the arena, and bytes.
type Local = (usize, usize);

/// An entry of a block stack. Date and time end the start information of an organization block.
pub(crate) fn entry(block: BlockId, statement: u32, blocks: [u16; 2], ob: &ObInfo) -> HeldBlock {
    let began = ob.start.last_chunk().copied().unwrap_or_default();
    HeldBlock { block, statement, blocks, ob: ob.number, priority: ob.priority, began, address: None }
}

/// Room for what is shown.
pub(crate) fn room() -> Held {
    Held { stack: Vec::with_capacity(DEEPEST), local: Vec::with_capacity(HELD_LOCAL), ..Held::default() }
}

/// What the CPU has gone to STOP in.
#[derive(Debug)]
pub(crate) struct Stacks {
    at: Held,
    /// For each block, the innermost first.
    locals: Vec<Local>,
}

impl Stacks {
    pub(crate) fn new() -> Self {
        Self { at: room(), locals: Vec::with_capacity(DEEPEST) }
    }

    pub(crate) fn forget(&mut self) {
        self.at.stack.clear();
        self.locals.clear();
    }
}

impl Context<'_> {
    /// The CPU goes to STOP, and the engine abandons this block at this statement. Its callers follow it, the innermost
    /// first.
    #[cold]
    pub fn abandoned(&mut self, at: Caller, r: &Regs) {
        self.leave_behind(at, [r.db.number, r.di.number], Some(r));
    }

    /// The same of a block that has called the one before, with what is in its DB and DI registers.
    #[cold]
    pub fn abandoned_caller(&mut self, at: Caller, blocks: [u16; 2]) {
        self.leave_behind(at, blocks, None);
    }

    /// Of the first one the registers are kept.
    fn leave_behind(&mut self, at: Caller, blocks: [u16; 2], r: Option<&Regs>) {
        let machine = &mut *self.machine;
        let stacks = &mut machine.stacks;
        // A block for an error may be left without a STOP; the second of two engines tells nothing new.
        if !machine.hot.stopping || machine.tape.as_ref().is_some_and(|tape| tape.plays()) {
            return;
        }
        let Some(block) = self.blocks.plan.blocks.get(at.block as usize) else { return };
        let len = block.local_len as usize;
        let local = match (stacks.locals.last(), r) {
            // Local data of called blocks lie behind those of their callers.
            (Some((before, _)), _) => before.saturating_sub(len),
            (None, Some(r)) => {
                registers(&mut stacks.at, r, &machine.ob);
                r.local.index()
            }
            (None, None) => return,
        };
        if stacks.at.stack.len() < DEEPEST {
            stacks.at.stack.push(entry(block.id, at.statement, blocks, &machine.ob));
            stacks.locals.push((local, len));
        }
    }
}

/// The registers, and what the running organization block was started with.
pub(crate) fn registers(held: &mut Held, r: &Regs, ob: &ObInfo) {
    held.status = r.status_word() as u16;
    held.accus = [r.a1, r.a2, r.a3, r.a4];
    held.addresses = [r.ar1, r.ar2];
    held.start = ob.start;
}

impl Machine {
    /// Copies local data, as many bytes as are shown.
    pub(crate) fn show_local(&self, (at, len): Local, into: &mut Vec<u8>) {
        let local = self.memory.bytes.get(at..).unwrap_or_default();
        into.clear();
        into.extend_from_slice(&local[..len.min(HELD_LOCAL).min(local.len())]);
    }

    /// Shows in what the CPU has gone to STOP, with the local data of the block at this place of the stack.
    pub(crate) fn show_stopped(&self, level: u8, held: &mut Held) {
        let Stacks { at, locals } = &self.stacks;
        held.stack.clear();
        held.stack.extend_from_slice(&at.stack);
        if !at.stack.is_empty() {
            (held.status, held.accus, held.addresses, held.start) = (at.status, at.accus, at.addresses, at.start);
        }
        held.local.clear();
        if let Some(local) = locals.get(usize::from(level)) {
            self.show_local(*local, &mut held.local);
        }
    }
}
