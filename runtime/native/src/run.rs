//! The code of a plan as it runs: what compiled code and the reference hand each other, and the helpers that compiled
//! code calls.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use ob1_cpu::Abort;
use ob1_cpu::engine::{Callee, Caller, Context, Hot, Plan, Prepared, Regs, Timer, Watched};
use ob1_ir::Op;
use ob1_model::TimerKind;

use crate::code::CodeMemory;
use crate::frame::{Frame, frames};
use crate::image::{Compiled, Resume};
use crate::watched::Containing;

/// A helper of compiled code: this run, and two numbers.
pub(crate) type Helper = extern "C" fn(*mut Run, u32, u32) -> i32;

/// Compiled code of a block: 0 when it has ended, else it was aborted.
pub(crate) type Entry = unsafe extern "C" fn(*mut Run) -> i32;

/// The code of a plan, in place.
pub(crate) struct Code {
    pub(crate) plan: Arc<Plan>,
    pub(crate) functions: Vec<Compiled>,
    entries: Entries,
    /// What of a watched block is in the code of others.
    containing: Containing,
    pub(crate) watched: Cell<Watched>,
    /// Calls that need nothing but their frame: by block, then by statement.
    frames: Vec<Box<[Option<Frame>]>>,
    pub(crate) memory: Option<CodeMemory>,
    /// Blocks that the optimising tier has seen.
    pub(crate) optimised: usize,
}

/// Where the code of each block begins; null where there is none, and while the block is watched.
struct Entries(Box<[Cell<*const u8>]>);

// SAFETY: addresses in a mapping that is read and executed only, which lives as long as they do.
unsafe impl Send for Entries {}

impl Code {
    pub(crate) fn new(
        plan: &Arc<Plan>,
        functions: Vec<Compiled>,
        memory: Option<CodeMemory>,
        optimised: usize,
    ) -> Self {
        let entries = functions.iter().map(|_| Cell::new(std::ptr::null())).collect();
        let code = Self {
            plan: Arc::clone(plan),
            functions,
            entries: Entries(entries),
            containing: Containing::of(plan),
            watched: Cell::default(),
            frames: frames(plan),
            memory,
            optimised,
        };
        (0..code.functions.len() as u32).for_each(|block| code.enter_by(block, true));
        code
    }

    /// Where the code of a block lies, watched or not.
    fn address(&self, block: u32) -> *const u8 {
        let at = self.functions.get(block as usize).and_then(|function| function.at);
        at.zip(self.memory.as_ref()).and_then(|(at, memory)| memory.at(at)).unwrap_or(std::ptr::null())
    }

    /// Whether a block is entered by its machine code.
    fn enter_by(&self, block: u32, code: bool) {
        if let Some(entry) = self.entries.0.get(block as usize) {
            entry.set(if code { self.address(block) } else { std::ptr::null() });
        }
    }

    /// These blocks are watched from now on, no others: neither their own code is entered nor any they are a part of.
    pub(crate) fn watch(&self, watched: &Watched) {
        let before = self.watched.replace(*watched);
        if before.every || watched.every {
            (0..self.entries.0.len() as u32).for_each(|block| self.enter_by(block, !watched.every));
        }
        if watched.every {
            return;
        }
        for (set, code) in [(&before, true), (watched, false)] {
            for block in
                set.all().chain(set.blocks.into_iter().flatten().flat_map(|block| self.containing.of_block(block)))
            {
                self.enter_by(block, code);
            }
        }
    }

    /// The code of this block contains that of a watched one.
    pub(crate) fn contains_watched(&self, block: u32) -> bool {
        self.watched.get().blocks.into_iter().flatten().any(|watched| self.containing.has(watched, block))
    }

    /// The code of any block contains that of a watched one.
    pub(crate) fn any_contains_watched(&self) -> bool {
        self.watched
            .get()
            .blocks
            .into_iter()
            .flatten()
            .any(|watched| self.containing.of_block(watched).next().is_some())
    }

    /// The frame of a call that needs nothing else.
    fn frame(&self, block: u32, statement: u32) -> Option<&Frame> {
        self.frames.get(block as usize)?.get(statement as usize)?.as_ref()
    }

    /// The code of a block.
    fn entry(&self, block: u32) -> Option<Entry> {
        self.entry_at(self.entries.0.get(block as usize)?.get())
    }

    /// The same of a block that is watched.
    pub(crate) fn watched_entry(&self, block: u32) -> Option<Entry> {
        self.entry_at(self.address(block))
    }

    fn entry_at(&self, address: *const u8) -> Option<Entry> {
        if address.is_null() {
            return None;
        }
        // SAFETY: the address is that of a function that `Compiler` has made with this signature for this processor, in
        // memory that nobody can change.
        Some(unsafe { std::mem::transmute::<*const u8, Entry>(address) })
    }

    /// Runs a block whose registers and local data are in place.
    pub(crate) fn run(
        &self,
        block: u32,
        caller: Option<Caller>,
        r: &mut Regs,
        cx: &mut Context<'_>,
    ) -> Result<(), Abort> {
        match self.entry(block) {
            Some(entry) => self.run_code(entry, r, cx),
            None if self.watched.get() == Watched::default() => {
                interpret::<false>(self, block, 0, 0, &[], r, cx).map(|_| ())
            }
            None => crate::watched::run(self, block, caller, r, cx),
        }
    }

    /// Runs its machine code.
    pub(crate) fn run_code(&self, entry: Entry, r: &mut Regs, cx: &mut Context<'_>) -> Result<(), Abort> {
        let mut run = Run::new(*r, self, cx);
        // SAFETY: `run` outlives the call; its pointers are valid as long as `cx` is borrowed.
        let answer = unsafe { entry(&raw mut run) };
        *r = run.regs;
        if run.panicked {
            std::panic::resume_unwind(Box::new("a helper of compiled code has panicked"));
        }
        if answer == 0 { Ok(()) } else { Err(Abort) }
    }
}

/// The run of one block of statements, in memory.
#[repr(C)]
pub(crate) struct Run {
    pub(crate) regs: Regs,
    pub(crate) hot: *mut Hot,
    pub(crate) safe_point: Helper,
    pub(crate) step: Helper,
    pub(crate) leave: Helper,
    pub(crate) whole: Helper,
    pub(crate) call: Helper,
    pub(crate) abandoned: Helper,
    pub(crate) timer: Helper,
    pub(crate) time_left: Helper,
    /// The CPU. Only helpers look here.
    pub(crate) cpu: *mut Context<'static>,
    /// The code of all blocks.
    pub(crate) code: *const Code,
    /// By the number of a block: where its code begins; null: the reference runs it.
    pub(crate) entries: *const *const u8,
    /// A helper has panicked.
    pub(crate) panicked: bool,
}

/// The answers of helpers.
pub(crate) const DONE: i32 = 0;
/// A call was not made: an error organization block has run.
const FAILED: i32 = 1;
pub(crate) const ABORTED: i32 = -1;
/// The reference has reached the end of the block; other places are numbered from 1.
const ENDED: i32 = 0;

impl Run {
    pub(crate) fn new(regs: Regs, code: &Code, cx: &mut Context<'_>) -> Self {
        let hot = std::ptr::from_mut(cx.hot());
        Self {
            regs,
            hot,
            safe_point,
            step,
            leave,
            whole,
            call,
            abandoned,
            timer,
            time_left,
            cpu: std::ptr::from_mut(cx).cast(),
            code,
            entries: code.entries.0.as_ptr().cast(),
            panicked: false,
        }
    }
}

/// The parts of a run that helpers work with. Between two helpers the registers belong to compiled code alone.
struct Parts<'a> {
    regs: &'a mut Regs,
    cx: &'a mut Context<'static>,
    code: &'a Code,
}

/// Runs a helper's work; a panic ends the run as an abort does and is raised again after compiled code has returned.
fn guarded(run: *mut Run, work: impl FnOnce(Parts<'_>) -> Result<i32, Abort>) -> i32 {
    let done = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: compiled code passes on the pointer that `enter` gave it, which is valid until that returns; compiled
        // code holds no reference into it, and nobody else uses the registers, the CPU and the code meanwhile.
        let parts = unsafe { Parts { regs: &mut (*run).regs, cx: &mut *(*run).cpu, code: &*(*run).code } };
        work(parts)
    }));
    match done {
        Ok(Ok(answer)) => answer,
        Ok(Err(Abort)) => ABORTED,
        Err(_) => {
            // SAFETY: as above.
            unsafe { (*run).panicked = true };
            ABORTED
        }
    }
}

/// A safe point at which it is time to look.
extern "C" fn safe_point(run: *mut Run, block: u32, statement: u32) -> i32 {
    guarded(run, |parts| parts.cx.safe_point(Caller { block, statement }, parts.regs).map(|()| DONE))
}

/// A call whose block was aborted, the caller's DB and DI registers in place: for the stacks of the CPU.
#[cold]
extern "C" fn abandoned(run: *mut Run, block: u32, statement: u32) -> i32 {
    guarded(run, |parts| {
        let blocks = [parts.regs.db.number, parts.regs.di.number];
        parts.cx.abandoned_caller(Caller { block, statement }, blocks);
        Ok(ABORTED)
    })
}

/// One statement by the reference.
extern "C" fn step(run: *mut Run, block: u32, statement: u32) -> i32 {
    guarded(run, |parts| parts.cx.step(Caller { block, statement }, parts.regs).map(|()| DONE))
}

/// Starts a timer with a valid time. `timer`: its number in the high word, kind and RLO; `time`: the S5TIME.
extern "C" fn timer(run: *mut Run, timer: u32, time: u32) -> i32 {
    guarded(run, |parts| {
        let now = parts.cx.hot().now;
        let kind = TimerKind::ALL[(timer >> 1 & 7) as usize % TimerKind::ALL.len()];
        if let Some(found) = timer_of(parts.cx, timer >> 16) {
            // A wrong digit is impossible: the time is a constant that was checked.
            let _ = found.run(kind, timer & 1 == 1, time as u16, now);
        }
        Ok(DONE)
    })
}

/// What is left of a timer's time.
extern "C" fn time_left(run: *mut Run, timer: u32, _: u32) -> i32 {
    guarded(run, |parts| {
        let now = parts.cx.hot().now;
        Ok(timer_of(parts.cx, timer).map_or(0, |timer| i32::from(timer.remaining(now))))
    })
}

fn timer_of<'a>(cx: &'a mut Context<'static>, number: u32) -> Option<&'a mut Timer> {
    let timers = *cx.hot().timers.get_mut();
    // SAFETY: `Context::hot` has filled the pointer in. The number was checked against the plan's when the code was
    // made; the timers live as long as the CPU, which `cx` borrows.
    unsafe { timers.add(number as usize).as_mut() }
}

/// A call, with the safe point before it. The count already includes it.
extern "C" fn call(run: *mut Run, block: u32, statement: u32) -> i32 {
    // SAFETY: compiled code passes on the pointer that `Code::run` gave it, valid until that returns, as are the
    // pointers in it; nobody else uses what they point to meanwhile. An address of the table is that of the block's
    // code.
    unsafe {
        let (hot, code) = (&mut *(*run).hot, &*(*run).code);
        let looks = looks_at_call(hot, &code.plan, block, statement);
        if let Some(frame) = code.frame(block, statement).filter(|frame| !looks && frame.fits(hot, &code.plan))
            && let Some(entry) = code.entry(frame.callee)
        {
            let answer = frame.call(run, &code.plan, entry);
            return if answer == DONE { DONE } else { abandoned(run, block, statement) };
        }
    }
    guarded(run, |parts| {
        if looks_at_call(parts.cx.hot(), &parts.code.plan, block, statement) {
            parts.cx.safe_point(Caller { block, statement: statement + 1 }, parts.regs)?;
        }
        make_call(parts.code, block, statement, parts.regs, parts.cx)
    })
}

fn make_call(code: &Code, block: u32, statement: u32, r: &mut Regs, cx: &mut Context<'_>) -> Result<i32, Abort> {
    use ob1_cpu::engine::{InstanceOf, Op as PlanOp};
    let at = Caller { block, statement };
    let caller = &code.plan.blocks[block as usize];
    let call = match caller.ops[statement as usize] {
        PlanOp::Call { call } => &caller.calls[call as usize],
        PlanOp::CallNative { call, native } => {
            let made = cx.call_native(native, at, &caller.calls[call as usize], r)?;
            return Ok(if made { DONE } else { FAILED });
        }
        _ => return Ok(DONE),
    };
    let tops = cx.tops();
    let prepared = match cx.prepare(call, r) {
        Ok(prepared) => prepared,
        Err(fault) => {
            cx.release(tops);
            return cx.fault_at(at, fault, r).map(|()| FAILED);
        }
    };
    let (callee, entry) = match prepared {
        Prepared::Skipped => return Ok(DONE),
        Prepared::Ready(callee, entry) => (callee, entry),
    };
    let copied = match callee {
        // What fails from here on has left the chain ended.
        Callee::Native(native) => return cx.run_native(native, at, call, &entry, tops, r).map(|()| DONE),
        Callee::Code(next) => {
            let instance = !matches!(call.instance, InstanceOf::None);
            let local_len = code.plan.blocks[next as usize].local_len;
            let saved = match cx.enter(instance, &entry, local_len, r) {
                Ok(saved) => saved,
                Err(fault) => {
                    cx.release(tops);
                    return cx.fault_at(at, fault, r).map(|()| FAILED);
                }
            };
            code.run(next, Some(at), r, cx).inspect_err(|_| cx.abandoned_caller(at, saved.blocks()))?;
            cx.finish(call, &saved, tops, r)
        }
    };
    match copied {
        Ok(()) => Ok(DONE),
        Err(fault) => cx.fault_at(at, fault, r).map(|()| FAILED),
    }
}

/// The reference executes statements from `statement` on, up to the next place where compiled code can be entered;
/// returns the number of that place.
extern "C" fn leave(run: *mut Run, block: u32, statement: u32) -> i32 {
    guarded(run, |parts| {
        let resume = &parts.code.functions[block as usize].made.resume;
        interpret::<false>(parts.code, block, 0, statement, resume, parts.regs, parts.cx)
    })
}

/// The same up to the end of the block.
extern "C" fn whole(run: *mut Run, block: u32, statement: u32) -> i32 {
    guarded(run, |parts| interpret::<false>(parts.code, block, 0, statement, &[], parts.regs, parts.cx))
}

/// The reference executes the statements of a block from `from` on, up to one of `resume` or the end. `PROBED`: it is
/// the watched run of this number.
pub(crate) fn interpret<const PROBED: bool>(
    code: &Code,
    block: u32,
    run: u32,
    from: u32,
    resume: &[Resume],
    r: &mut Regs,
    cx: &mut Context<'_>,
) -> Result<i32, Abort> {
    let body = &code.plan.blocks[block as usize];
    let mut pc = from as usize;
    let mut first = true;
    loop {
        if !first && let Ok(i) = resume.binary_search_by_key(&(pc as u32), |(at, _)| *at) {
            return Ok(resume[i].1 as i32);
        }
        first = false;
        if PROBED {
            cx.next_statement(run, pc as u32, r)?;
        }
        cx.hot().pending += 1;
        let Some(stmt) = body.stmts.get(pc) else { return Ok(ENDED) };
        let at = Caller { block, statement: pc as u32 };
        pc += 1;
        let target = match &stmt.op {
            Op::Jump(on, to) => ob1_cpu::engine::condition(*on, r).then_some(*to),
            Op::Loop(to) => {
                let left = (r.a1 as u16).wrapping_sub(1);
                r.a1 = r.a1 & 0xFFFF_0000 | u32::from(left);
                (left != 0).then_some(*to)
            }
            Op::JumpList { targets, otherwise } => {
                let index = (r.a1 & 0xFF) as usize;
                // The jump that it takes runs, too.
                if PROBED && index < targets.len() {
                    cx.next_statement(run, (pc + index) as u32, r)?;
                }
                Some(targets.get(index).copied().unwrap_or(*otherwise))
            }
            Op::Call(_) => {
                if looks_at_call(cx.hot(), &code.plan, block, at.statement) {
                    cx.safe_point(Caller { block, statement: pc as u32 }, r)?;
                }
                make_call(code, block, at.statement, r, cx)?;
                None
            }
            Op::EndIf if !r.rlo => {
                r.set_rlo(true);
                None
            }
            Op::End | Op::EndIf => return Ok(ENDED),
            _ => {
                cx.step(at, r)?;
                None
            }
        };
        if let Some(target) = target {
            let back = (target as usize) < pc;
            pc = target as usize;
            let hot = cx.hot();
            if back && looks(hot) {
                cx.safe_point(Caller { block, statement: target }, r)?;
            }
        }
    }
}

/// A safe point looks.
fn looks(hot: &mut Hot) -> bool {
    hot.pending >= hot.look_after || is_due(hot)
}

/// The call is a safe point, and it looks.
fn looks_at_call(hot: &mut Hot, plan: &Plan, block: u32, statement: u32) -> bool {
    looks(hot) && plan.blocks[block as usize].call(statement as usize).is_none_or(|call| call.safe_point)
}

/// Another thread wants the next safe point to look.
fn is_due(hot: &mut Hot) -> bool {
    let due = *hot.due.get_mut();
    // SAFETY: `Context::hot` has filled the pointer in; the flag lives as long as the CPU.
    !due.is_null() && unsafe { (*due).load(std::sync::atomic::Ordering::Relaxed) }
}
