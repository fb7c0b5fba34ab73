//! The run loop of the reference engine.

use ob1_ir::{Compare, Logic};
use ob1_model::Fault;

use super::based;
use super::bytes::{byte, dword, get, put, put_bit, put_byte, put_dword, put_word, word};
use super::{Frame, Reference};
use crate::Abort;
use crate::context::Context;
use crate::engine::arith::{self, low_word};
use crate::engine::call::{self, Prepared, Tops};
use crate::engine::plan::{Callee, Caller, InstanceOf, Op, Scan};
use crate::engine::regs::{Regs, with_cc};
use crate::engine::{Entry, jump, statement};

#[inline(always)]
fn scan_bit(scan: Scan, bit: bool, r: &mut Regs) {
    statement::scan(scan.logic, bit != scan.negate, r);
    r.sta = bit;
}

impl<const ACCOUNTS: bool> Reference<ACCOUNTS> {
    /// Runs `block` until it ends. The registers live in this function; nested blocks of statements run in the same
    /// loop, native blocks and organization blocks for faults are called out of it. `WATCHES`: a job is armed.
    pub(super) fn run<const WATCHES: bool>(
        &self,
        block: u32,
        entry: &Entry,
        cx: &mut Context<'_>,
    ) -> Result<(), Abort> {
        let runtime = cx.blocks;
        let blocks = self.blocks();
        let floor = self.frames.top();
        let tops = (cx.machine.hot.local_top, cx.machine.hot.depth);
        let mut current = block;
        let Some(mut code) = blocks.get(current as usize) else { return Ok(()) };
        // Lent to what needs them, never copied: a copy loads many bytes at a time and waits for the single stores that
        // came before.
        let mut r = match call::begin(code, entry, cx.machine) {
            Ok(r) => r,
            Err(fault) => return cx.no_room(block, fault),
        };
        let mut pc = 0usize;
        // Statements of the running stretch are counted when it is left: those from `from` to `pc`.
        let mut from = 0usize;
        let mut executed = cx.machine.hot.pending;

        macro_rules! count {
            () => {
                executed += (pc - from) as u32;
                if ACCOUNTS {
                    runtime.plan.executed.add(current, (pc - from) as u64);
                }
            };
        }
        macro_rules! attend {
            () => {
                if executed >= cx.machine.hot.look_after || runtime.attention.is_due() {
                    cx.machine.hot.pending = executed;
                    cx.safe_point(Caller { block: current, statement: pc as u32 }, &r)?;
                    executed = cx.machine.hot.pending;
                }
            };
        }
        macro_rules! jump {
            ($target:expr) => {{
                let target = $target as usize;
                count!();
                let back = target < pc;
                pc = target;
                from = target;
                if back {
                    attend!();
                }
            }};
        }
        // The statement that has just been counted.
        macro_rules! here {
            () => {
                Caller { block: current, statement: (pc - 1) as u32 }
            };
        }
        // Runs the fault's organization block; the program continues with the next statement.
        macro_rules! fail {
            ($fault:expr) => {{
                let fault: Fault = $fault;
                count!();
                from = pc;
                cx.machine.hot.pending = executed;
                cx.fault_at(here!(), fault, &mut r)?;
                executed = cx.machine.hot.pending;
                continue;
            }};
        }
        macro_rules! step_slowly {
            () => {{
                if let Err(fault) = statement::step(&code.stmts[pc - 1].op, &mut r, cx.machine) {
                    fail!(fault);
                }
                continue;
            }};
        }
        // The byte and the mask of a based operand.
        macro_rules! place {
            ($base:expr, $at:expr, $bits:expr, $write:expr) => {
                match based::find($base, $at, $bits, $write, &r, cx.machine) {
                    Some(place) => place,
                    // The peripheral area, and faults.
                    None => step_slowly!(),
                }
            };
        }
        macro_rules! mem {
            () => {
                cx.machine.memory.bytes
            };
        }
        macro_rules! and {
            ($bit:expr, $value:expr) => {{
                let bit: bool = $bit;
                r.rlo = (!r.fc | r.rlo) & $value(bit) | r.or;
                r.sta = bit;
                r.fc = true;
            }};
        }
        macro_rules! or {
            ($bit:expr, $value:expr) => {{
                let bit: bool = $bit;
                r.rlo = r.fc & r.rlo | $value(bit);
                r.or = false;
                r.sta = bit;
                r.fc = true;
            }};
        }
        macro_rules! xor {
            ($bit:expr, $value:expr) => {{
                let bit: bool = $bit;
                r.rlo = (r.fc & r.rlo) ^ $value(bit);
                r.or = false;
                r.sta = bit;
                r.fc = true;
            }};
        }
        macro_rules! bit {
            ($at:expr, $mask:expr) => {
                byte(&mem!(), $at) & $mask != 0
            };
        }
        macro_rules! arithmetic {
            ($function:path, $op:expr) => {{
                let (result, cc) = $function($op, r.a2, r.a1);
                r.a1 = result;
                r.flags = with_cc(r.flags, cc);
            }};
        }
        macro_rules! compare {
            ($function:path, $op:expr) => {{
                let compare: Compare = $op;
                let (rlo, cc) = $function(compare, r.a2, r.a1);
                r.flags = with_cc(r.flags, cc);
                r.set_result(rlo);
            }};
        }

        // What runs a native block.
        macro_rules! native {
            ($run:expr) => {{
                cx.machine.hot.pending = executed;
                $run?;
                executed = cx.machine.hot.pending;
            }};
        }

        // Enters a block for the jobs there are.
        macro_rules! entered {
            ($caller:expr) => {{
                let run = cx.new_run();
                cx.entered(current, $caller, run, false, &r)
            }};
        }
        let mut watched = if WATCHES { Some(entered!(None)) } else { None };

        loop {
            if WATCHES && let Some(watched) = &watched {
                cx.next_statement(watched.run(), pc as u32, &r)?;
            }
            let op = code.ops[pc];
            pc += 1;
            match op {
                Op::And { at, mask } => and!(bit!(at, mask), |b: bool| b),
                Op::AndNot { at, mask } => and!(bit!(at, mask), |b: bool| !b),
                Op::Or { at, mask } => or!(bit!(at, mask), |b: bool| b),
                Op::OrNot { at, mask } => or!(bit!(at, mask), |b: bool| !b),
                Op::Xor { at, mask } => xor!(bit!(at, mask), |b: bool| b),
                Op::XorNot { at, mask } => xor!(bit!(at, mask), |b: bool| !b),
                Op::Assign { at, mask } => {
                    put_bit(&mut mem!(), at, mask, r.rlo);
                    r.end_chain(r.rlo);
                }
                Op::Set { at, mask } => {
                    if r.rlo {
                        put_bit(&mut mem!(), at, mask, true);
                    }
                    r.end_chain(r.rlo);
                }
                Op::Reset { at, mask } => {
                    if r.rlo {
                        put_bit(&mut mem!(), at, mask, false);
                    }
                    r.end_chain(r.rlo);
                }
                Op::EdgePositive { at, mask } => {
                    let before = bit!(at, mask);
                    put_bit(&mut mem!(), at, mask, r.rlo);
                    r.set_edge(r.rlo, r.rlo & !before);
                }
                Op::EdgeNegative { at, mask } => {
                    let before = bit!(at, mask);
                    put_bit(&mut mem!(), at, mask, r.rlo);
                    r.set_edge(r.rlo, !r.rlo & before);
                }
                Op::ScanAt { scan, base, at } => {
                    let (at, mask) = place!(base, at, 1, false);
                    let bit = bit!(at, mask);
                    match scan.logic {
                        Logic::And => and!(bit, |b: bool| b ^ scan.negate),
                        Logic::Or => or!(bit, |b: bool| b ^ scan.negate),
                        Logic::Xor => xor!(bit, |b: bool| b ^ scan.negate),
                    }
                }
                Op::AssignAt { base, at } => {
                    let (at, mask) = place!(base, at, 1, true);
                    put_bit(&mut mem!(), at, mask, r.rlo);
                    r.end_chain(r.rlo);
                }
                Op::SetAt { base, at } => {
                    let (at, mask) = place!(base, at, 1, r.rlo);
                    if r.rlo {
                        put_bit(&mut mem!(), at, mask, true);
                    }
                    r.end_chain(r.rlo);
                }
                Op::ResetAt { base, at } => {
                    let (at, mask) = place!(base, at, 1, r.rlo);
                    if r.rlo {
                        put_bit(&mut mem!(), at, mask, false);
                    }
                    r.end_chain(r.rlo);
                }
                Op::ScanTimer { scan, number } => {
                    let m = &*cx.machine;
                    let bit = m.timers.get(usize::from(number)).is_some_and(|t| t.output(m.hot.now));
                    scan_bit(scan, bit, &mut r);
                }
                Op::ScanCounter { scan, number } => {
                    let bit = cx.machine.counters.get(usize::from(number)).is_some_and(|c| c.value != 0);
                    scan_bit(scan, bit, &mut r);
                }
                Op::Open { scan } => statement::open_bracket(scan.logic, scan.negate, &mut r),
                Op::Close => statement::close_bracket(&mut r),
                Op::OrBranch => statement::or_branch(&mut r),
                Op::SetRlo => r.set_rlo(true),
                Op::ClearRlo => r.set_rlo(false),
                Op::NotRlo => r.invert_rlo(),

                Op::LoadByte { at } => statement::load(&mut r, u32::from(byte(&mem!(), at))),
                Op::LoadWord { at } => statement::load(&mut r, word(&mem!(), at)),
                Op::LoadDWord { at } => statement::load(&mut r, dword(&mem!(), at)),
                Op::StoreByte { at } => put_byte(&mut mem!(), at, r.a1),
                Op::StoreWord { at } => put_word(&mut mem!(), at, r.a1),
                Op::StoreDWord { at } => put_dword(&mut mem!(), at, r.a1),
                Op::LoadInDb { bits, db, at } => {
                    r.db = cx.machine.memory.db(db).unwrap_or(r.db);
                    statement::load(&mut r, get(&mem!(), bits, at));
                }
                Op::StoreInDb { bits, db, at } => {
                    r.db = cx.machine.memory.db(db).unwrap_or(r.db);
                    put(&mut mem!(), bits, at, r.a1);
                }
                Op::LoadAt { bits, base, at } => {
                    let (at, _) = place!(base, at, u32::from(bits), false);
                    statement::load(&mut r, get(&mem!(), bits, at));
                }
                Op::StoreAt { bits, base, at } => {
                    let (at, _) = place!(base, at, u32::from(bits), true);
                    put(&mut mem!(), bits, at, r.a1);
                }
                Op::LoadConst { value } => statement::load(&mut r, value),

                Op::Int(op) => arithmetic!(arith::int, op),
                Op::DInt(op) => arithmetic!(arith::dint, op),
                Op::Real(op) => arithmetic!(arith::real, op),
                Op::Four(format, op) => {
                    let (result, cc) = statement::arithmetic(format, op, r.a2, r.a1);
                    (r.a1, r.a2, r.a3) = (result, r.a3, r.a4);
                    r.flags = with_cc(r.flags, cc);
                }
                Op::CompareInt(op) => compare!(arith::compare_int, op),
                Op::CompareDInt(op) => compare!(arith::compare_dint, op),
                Op::CompareReal(op) => compare!(arith::compare_real, op),
                Op::AddInt { value } => r.a1 = low_word(r.a1, (r.a1 as u16).wrapping_add(value)),
                Op::AddDInt { value } => r.a1 = r.a1.wrapping_add(value),

                Op::Jump { target } => jump!(target),
                Op::JumpIf { target } => {
                    let rlo = std::mem::replace(&mut r.rlo, true);
                    r.end_chain(true);
                    if rlo {
                        jump!(target);
                    }
                }
                Op::JumpIfNot { target } => {
                    let rlo = std::mem::replace(&mut r.rlo, true);
                    r.end_chain(true);
                    if !rlo {
                        jump!(target);
                    }
                }
                Op::JumpOn { on, target } => {
                    if jump::condition(on, &mut r) {
                        jump!(target);
                    }
                }
                Op::Loop { target } => {
                    let left = (r.a1 as u16).wrapping_sub(1);
                    r.a1 = low_word(r.a1, left);
                    if left != 0 {
                        jump!(target);
                    }
                }
                Op::JumpList { list } => {
                    let targets = &code.lists[list as usize];
                    let index = (r.a1 & 0xFF) as usize;
                    let target = targets[index.min(targets.len() - 1)];
                    // The jump that it takes runs, too.
                    if WATCHES
                        && index + 1 < targets.len()
                        && let Some(watched) = &watched
                    {
                        cx.next_statement(watched.run(), (pc + index) as u32, &r)?;
                    }
                    jump!(target);
                }
                Op::CallNative { call, native } => {
                    count!();
                    from = pc;
                    attend!();
                    native!(cx.call_native(native, here!(), &code.calls[call as usize], &mut r));
                }
                Op::Call { call: index } => {
                    count!();
                    from = pc;
                    let call = &code.calls[index as usize];
                    if call.safe_point {
                        attend!();
                    }
                    let tops = Tops::of(cx.machine);
                    match call::prepare(call, &mut r, cx.machine, &runtime.plan.signatures) {
                        Err(fault) => {
                            tops.release(cx.machine);
                            fail!(fault);
                        }
                        Ok(Prepared::Skipped) => {}
                        Ok(Prepared::Ready(Callee::Code(next), entry)) => {
                            let called = &blocks[next as usize];
                            let instance = !matches!(call.instance, InstanceOf::None);
                            match call::enter(instance, &entry, called.local_len, &mut r, cx.machine) {
                                Ok(saved) => {
                                    if WATCHES {
                                        self.entered[self.frames.top()].set(watched);
                                    }
                                    self.frames.push(Frame { block: current, pc: pc as u32, call: index, tops, saved });
                                }
                                Err(fault) => {
                                    tops.release(cx.machine);
                                    fail!(fault);
                                }
                            }
                            let caller = here!();
                            code = called;
                            current = next;
                            pc = 0;
                            from = 0;
                            if WATCHES {
                                watched = Some(entered!(Some(caller)));
                            }
                        }
                        Ok(Prepared::Ready(Callee::Native(native), entry)) => {
                            native!(cx.run_native(native, here!(), call, &entry, tops, &mut r));
                        }
                    }
                }
                Op::EndIf if !r.rlo => {
                    r.set_rlo(true);
                }
                Op::End | Op::EndIf => {
                    count!();
                    if WATCHES && let Some(watched) = &watched {
                        cx.pass_ends(watched.run(), &r);
                        cx.leave(watched);
                    }
                    if self.frames.top() == floor {
                        break;
                    }
                    let Some(frame) = self.frames.pop() else { break };
                    if WATCHES {
                        watched = self.entered[self.frames.top()].get();
                    }
                    current = frame.block;
                    code = &blocks[current as usize];
                    pc = frame.pc as usize;
                    from = pc;
                    let call = &code.calls[frame.call as usize];
                    if let Err(fault) = call::finish(call, &frame.saved, frame.tops, &mut r, cx.machine) {
                        fail!(fault);
                    }
                }
                Op::Nop => {}
                Op::Slow => step_slowly!(),
            }
        }
        let hot = &mut cx.machine.hot;
        hot.pending = executed;
        (hot.local_top, hot.depth) = tops;
        Ok(())
    }
}
