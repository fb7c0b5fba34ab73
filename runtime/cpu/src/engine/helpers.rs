//! What engines ask of the CPU.

use ob1_model::Fault;

use super::both::{Answer, Question};
use super::call::{self, Prepared, Saved, Tops};
use super::plan::{Block, Call, Caller, InstanceOf};
use super::regs::{BR, Regs};
use super::{Entry, Hot, statement};
use crate::arena::ArenaByte;
use crate::native;
use crate::scan_position::Packed;
use crate::{Abort, Context};

impl Context<'_> {
    /// The state engines read and write directly, its pointers filled in.
    pub fn hot(&mut self) -> &mut Hot {
        let m = &mut *self.machine;
        let hot = &mut m.hot;
        *hot.due.get_mut() = std::ptr::from_ref(m.attention.due()).cast_mut();
        *hot.arena.get_mut() = m.memory.bytes.as_mut_ptr();
        hot.arena_len = m.memory.bytes.len() as u32;
        *hot.refs.get_mut() = m.refs.as_mut_ptr();
        hot.refs_len = m.refs.len() as u32;
        *hot.db_index.get_mut() = m.memory.by_number.as_mut_ptr();
        hot.db_index_len = m.memory.by_number.len() as u32;
        *hot.dbs.get_mut() = m.memory.dbs.as_mut_ptr();
        hot.dbs_len = m.memory.dbs.len() as u32;
        *hot.timers.get_mut() = m.timers.as_mut_ptr();
        *hot.counters.get_mut() = m.counters.as_mut_ptr();
        hot
    }

    /// A safe point that is due: time, operator's STOP, cycle monitoring, interrupts of higher classes. `at` is the
    /// statement that comes next. Registers stay as they are; they are for the stacks of a CPU that goes to STOP.
    ///
    /// # Errors
    /// The CPU goes to STOP: leave every block.
    #[cold]
    pub fn safe_point(&mut self, at: Caller, r: &Regs) -> Result<(), Abort> {
        let answer = self.outside(Question::SafePoint(at), |cx| {
            cx.machine.at = Some(at);
            Answer::Done(cx.attend())
        });
        answer.done().inspect_err(|_| self.abandoned(at, r))
    }

    /// The statement `at` has failed: its organization block runs, and the program continues with the next
    /// statement. A statement that loads gives 0, or what SFC 44 has given.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    #[cold]
    pub fn fault_at(&mut self, at: Caller, fault: Fault, r: &mut Regs) -> Result<(), Abort> {
        let interrupted = r.interrupted();
        let answer = self.outside(Question::Fault(at, fault, interrupted), |cx| {
            Answer::Value(cx.fault(fault, cx.blocks.plan.site(at), &interrupted))
        });
        let value = answer.value().inspect_err(|_| self.abandoned(at, r))?;
        let block = self.blocks.plan.blocks.get(at.block as usize);
        let stmt = block.and_then(|block| block.stmts.get(at.statement as usize));
        if stmt.is_some_and(|stmt| statement::loads(&stmt.op)) {
            statement::load(r, 0);
        }
        r.a1 = value.unwrap_or(r.a1);
        Ok(())
    }

    /// Executes any statement except jumps, calls and ends directly from the intermediate code, including its fault.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    pub fn step(&mut self, at: Caller, r: &mut Regs) -> Result<(), Abort> {
        let block = self.blocks.plan.blocks.get(at.block as usize);
        let Some(stmt) = block.and_then(|block| block.stmts.get(at.statement as usize)) else { return Ok(()) };
        match statement::step(&stmt.op, r, self.machine) {
            Ok(()) => Ok(()),
            Err(fault) => self.fault_at(at, fault, r),
        }
    }

    /// Local data and registers for the block that [`super::Engine::call`] is asked for.
    ///
    /// # Errors
    /// There is no room; this is a fault of the block's first statement.
    pub fn begin(&mut self, block: &Block, entry: &Entry) -> Result<Regs, Fault> {
        call::begin(block, entry, self.machine)
    }

    /// The tops of the stacks that calls use, to be given back with [`Context::release`].
    #[inline]
    #[must_use]
    pub fn tops(&self) -> Tops {
        Tops::of(self.machine)
    }

    /// Releases references and scratch of a call, after its copies out.
    #[inline]
    pub fn release(&mut self, tops: Tops) {
        tops.release(self.machine);
    }

    /// Finds the block called and supplies its parameters.
    ///
    /// # Errors
    /// The call is faulty: registers are as before; call [`Context::release`] anyway.
    pub fn prepare(&mut self, call: &Call, r: &mut Regs) -> Result<Prepared, Fault> {
        call::prepare(call, r, self.machine, &self.blocks.plan.signatures)
    }

    /// Enters a block of statements with `local_len` bytes of local data; `instance`: it was called with one.
    ///
    /// # Errors
    /// The fault of a block that finds no room: nested too deep, or no local data left.
    pub fn enter(&mut self, instance: bool, entry: &Entry, local_len: u32, r: &mut Regs) -> Result<Saved, Fault> {
        call::enter(instance, entry, local_len, r, self.machine)
    }

    /// Ends the call of a block of statements: gives back the caller's registers, copies the results to the actuals,
    /// releases what [`Context::tops`] was asked before.
    ///
    /// # Errors
    /// An actual cannot be written.
    pub fn finish(&mut self, call: &Call, saved: &Saved, tops: Tops, r: &mut Regs) -> Result<(), Fault> {
        call::finish(call, saved, tops, r, self.machine)
    }

    /// Runs a native block whose parameters are in place; handles its results, stacks and faults.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    #[inline]
    pub fn run_native(
        &mut self,
        native: u32,
        at: Caller,
        call: &Call,
        entry: &Entry,
        tops: Tops,
        r: &mut Regs,
    ) -> Result<(), Abort> {
        let br = match self.native_block(native, at, call.site, entry) {
            Ok(br) => br,
            Err(abort) => {
                self.abandoned(at, r);
                return Err(abort);
            }
        };
        call::status_of_call(r);
        r.flags = r.flags & !BR | (u32::from(br) * BR);
        let instance = (!matches!(call.instance, InstanceOf::None)).then_some(entry.di);
        match call::results(call, instance, tops, r, self.machine) {
            Ok(()) => Ok(()),
            Err(fault) => self.fault_at(at, fault, r),
        }
    }

    #[inline]
    fn native_block(&mut self, native: u32, at: Caller, site: Packed, entry: &Entry) -> Result<bool, Abort> {
        self.machine.hot.depth += 1;
        let caller = self.machine.native_caller.replace(at);
        let br = if self.machine.tape.is_none() {
            native::call(native, site, entry, self)?
        } else {
            let question = Question::Native(native, at, *entry);
            self.outside(question, |cx| Answer::Result(native::call(native, site, entry, cx))).result()?
        };
        self.machine.native_caller = caller;
        self.machine.hot.depth -= 1;
        Ok(br)
    }

    /// Runs a whole [`super::Op::CallNative`], after its safe point. False: its parameters could not be supplied, and
    /// the error's organization block has run instead.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    pub fn call_native(&mut self, native: u32, at: Caller, call: &Call, r: &mut Regs) -> Result<bool, Abort> {
        let tops = Tops::of(self.machine);
        let entry = call::entry(call, tops, r);
        let supplied = call::check_depth(self.machine).and_then(|()| {
            if call.patches.is_empty() {
                return call::fixed_references(call, self.machine);
            }
            let (db, di) = (r.db, r.di);
            let supplied = call::references(call, r, self.machine);
            // Fully qualified actuals have gone through the data block registers; the caller's come back.
            (r.db, r.di) = (db, di);
            supplied
        });
        if let Err(fault) = supplied {
            tops.release(self.machine);
            return self.fault_at(at, fault, r).map(|()| false);
        }
        self.run_native(native, at, call, &entry, tops, r).map(|()| true)
    }

    /// [`Context::begin`] has failed for the first block of [`super::Engine::call`].
    ///
    /// # Errors
    /// The CPU goes to STOP.
    #[cold]
    pub fn no_room(&mut self, block: u32, fault: Fault) -> Result<(), Abort> {
        self.fault_at(Caller { block, statement: 0 }, fault, &mut Regs::new(&Entry::default(), ArenaByte(0), 0))
    }
}
