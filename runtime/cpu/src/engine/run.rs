//! The run loop of the reference engine.

use ob1_ir::{Compare, Jump, Logic, StatusBit};
use ob1_model::{Area, Fault, FaultKind, Site};

use super::arith::{self, low_word};
use super::call::{self, CallSite, Prepared, Tops};
use super::code::{AREA_IN_POINTER, Base, Block, Call, InstanceOf, Op, Scan};
use super::regs::{BR, Interrupted, OS, Regs, status_bit, with_cc};
use super::resolve::{self, Where};
use super::slow;
use super::{Callee, Engine, Entry};
use crate::machine::{Caller, Context, Machine};
use crate::{Abort, native};

/// The engine that defines the meaning of every statement.
pub(crate) struct Reference {
    pub(crate) blocks: Box<[Block]>,
}

impl Engine for Reference {
    fn call(&self, block: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<(), Abort> {
        self.run(block, entry, cx)
    }

    fn site(&self, caller: Caller) -> Option<Site> {
        Some(self.blocks.get(caller.block as usize)?.site(caller.statement as usize))
    }
}

/// Why the loop cannot reach an operand itself.
enum Miss {
    Fault(Fault),
    /// It lies in the peripheral area: the slow form goes there.
    Peripheral,
}

impl From<Fault> for Miss {
    fn from(fault: Fault) -> Self {
        Miss::Fault(fault)
    }
}

/// The place of a based operand for `bits` bits, as bit address in the arena.
#[inline(always)]
fn based(base: Base, at: u32, bits: u32, write: bool, r: &Regs, m: &Machine) -> Result<u32, Miss> {
    let found = match base {
        Base::Local => return Ok(r.local * 8 + at),
        Base::Param(index) => resolve::param(index, at, bits, write, r, m)?,
        Base::Db => resolve::in_db(r.db, ob1_ir::DbRegister::Db, at, bits, write)?,
        Base::Instance => {
            let at = (r.ar2 & resolve::POINTER_BITS).wrapping_add(at);
            resolve::in_db(r.di, ob1_ir::DbRegister::Di, at, bits, write)?
        }
        Base::Ar1(code) => register_indirect(r.ar1, code, at, bits, write, r, m)?,
        Base::Ar2(code) => register_indirect(r.ar2, code, at, bits, write, r, m)?,
        Base::Pointer(code) => {
            let pointer = m.memory.read_bits(at * 8, 32);
            register_indirect(pointer & resolve::POINTER_BITS, code, 0, bits, write, r, m)?
        }
    };
    match found {
        Where::Arena(at) => Ok(at),
        Where::Peripheral(_) => Err(Miss::Peripheral),
    }
}

#[inline(always)]
fn register_indirect(
    pointer: u32,
    code: u8,
    offset: u32,
    bits: u32,
    write: bool,
    r: &Regs,
    m: &Machine,
) -> Result<Where, Fault> {
    let at = pointer.wrapping_add(offset) & resolve::POINTER_BITS;
    let code = if code == AREA_IN_POINTER { (pointer >> 24) as u8 } else { code };
    let Some(area) = Area::from_pointer_code(code) else {
        return Err(Fault::new(if write { FaultKind::AreaWrite } else { FaultKind::AreaRead }, u32::from(code)));
    };
    resolve::aligned(area, at, bits, write)?;
    resolve::in_area(area, at, bits, write, r, m)
}

#[inline(always)]
fn word(bytes: &[u8], at: u32) -> u32 {
    let at = at as usize;
    bytes.get(at..at + 2).map_or(0, |b| u32::from(u16::from_be_bytes([b[0], b[1]])))
}

#[inline(always)]
fn dword(bytes: &[u8], at: u32) -> u32 {
    let at = at as usize;
    bytes.get(at..at + 4).map_or(0, |b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]))
}

#[inline(always)]
fn put_word(bytes: &mut [u8], at: u32, value: u32) {
    let at = at as usize;
    if let Some(b) = bytes.get_mut(at..at + 2) {
        b.copy_from_slice(&(value as u16).to_be_bytes());
    }
}

#[inline(always)]
fn put_dword(bytes: &mut [u8], at: u32, value: u32) {
    let at = at as usize;
    if let Some(b) = bytes.get_mut(at..at + 4) {
        b.copy_from_slice(&value.to_be_bytes());
    }
}

#[inline(always)]
fn byte(bytes: &[u8], at: u32) -> u8 {
    bytes.get(at as usize).copied().unwrap_or(0)
}

#[inline(always)]
fn put_bit(bytes: &mut [u8], at: u32, mask: u8, value: bool) {
    if let Some(b) = bytes.get_mut(at as usize) {
        *b = if value { *b | mask } else { *b & !mask };
    }
}

#[inline(always)]
fn scan_bit(scan: Scan, bit: bool, r: &mut Regs) {
    slow::scan(scan.logic, bit != scan.negate, r);
    r.sta = bit;
}

impl Reference {
    /// Runs `block` until it ends. The registers live in this function; nested blocks of statements run in the same
    /// loop, native blocks and organization blocks for faults are called out of it.
    fn run(&self, block: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<(), Abort> {
        let blocks = cx.blocks;
        let floor = cx.machine.frames.len();
        let tops = (cx.machine.local_top, cx.machine.depth);
        let mut current = block;
        let Some(mut code) = self.blocks.get(current as usize) else { return Ok(()) };
        let mut r = match self.begin(code, entry, cx.machine) {
            Ok(r) => r,
            Err(fault) => return cx.fault(fault, Some(code.site(0)), &Interrupted::default()).map(|_| ()),
        };
        let mut pc = 0usize;
        // Statements of the running stretch are counted when it is left: those from `from` to `pc`.
        let mut from = 0usize;
        let mut executed = cx.machine.pending;

        macro_rules! count {
            () => {
                executed += (pc - from) as u32;
            };
        }
        macro_rules! attend {
            () => {
                if executed >= cx.machine.look_after || blocks.interrupt.is_due() {
                    cx.machine.pending = executed;
                    cx.machine.at = Some(Caller { block: current, statement: pc as u32 });
                    cx.attend()?;
                    executed = cx.machine.pending;
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
        // Runs the fault's organization block; the program goes on with the next statement.
        macro_rules! fail {
            ($fault:expr) => {{
                let fault: Fault = $fault;
                count!();
                from = pc;
                cx.machine.pending = executed;
                let mut regs = r;
                let value = cx.fault(fault, Some(code.site(pc - 1)), &regs.interrupted())?;
                if code.stmts.get(pc - 1).is_some_and(|stmt| slow::loads(&stmt.op)) {
                    slow::load(&mut regs, 0);
                }
                regs.a1 = value.unwrap_or(regs.a1);
                r = regs;
                executed = cx.machine.pending;
                continue;
            }};
        }
        macro_rules! step_slowly {
            () => {{
                let mut regs = r;
                let done = slow::step(&code.stmts[pc - 1].op, &mut regs, cx.machine);
                r = regs;
                if let Err(fault) = done {
                    fail!(fault);
                }
                continue;
            }};
        }
        macro_rules! place {
            ($base:expr, $at:expr, $bits:expr, $write:expr) => {
                match based($base, $at, $bits, $write, &r, cx.machine) {
                    Ok(at) => at,
                    Err(Miss::Peripheral) => step_slowly!(),
                    Err(Miss::Fault(fault)) => fail!(fault),
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

        // A native block with its parameters in place. The caller's registers are out of its reach.
        macro_rules! run_native {
            ($call:expr, $native:expr, $entry:expr, $tops:expr) => {{
                let call: &Call = $call;
                cx.machine.pending = executed;
                cx.machine.depth += 1;
                let site = Caller { block: current, statement: (pc - 1) as u32 };
                let caller = cx.machine.native_caller.replace(site);
                let br = native::call($native, &$entry, cx)?;
                cx.machine.native_caller = caller;
                cx.machine.depth -= 1;
                executed = cx.machine.pending;
                call::status_of_call(&mut r);
                r.flags = r.flags & !BR | u32::from(br) * BR;
                if call.copies_out {
                    let mut regs = r;
                    let copied = call::copy_out(call, $tops, &mut regs, cx.machine);
                    $tops.release(cx.machine);
                    if let Err(fault) = copied {
                        fail!(fault);
                    }
                } else {
                    $tops.release(cx.machine);
                }
            }};
        }

        loop {
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
                    let at = place!(base, at, 1, false);
                    let bit = bit!(at / 8, 1 << (at % 8));
                    match scan.logic {
                        Logic::And => and!(bit, |b: bool| b ^ scan.negate),
                        Logic::Or => or!(bit, |b: bool| b ^ scan.negate),
                        Logic::Xor => xor!(bit, |b: bool| b ^ scan.negate),
                    }
                }
                Op::AssignAt { base, at } => {
                    let at = place!(base, at, 1, true);
                    put_bit(&mut mem!(), at / 8, 1 << (at % 8), r.rlo);
                    r.end_chain(r.rlo);
                }
                Op::SetAt { base, at } => {
                    let at = place!(base, at, 1, r.rlo);
                    if r.rlo {
                        put_bit(&mut mem!(), at / 8, 1 << (at % 8), true);
                    }
                    r.end_chain(r.rlo);
                }
                Op::ResetAt { base, at } => {
                    let at = place!(base, at, 1, r.rlo);
                    if r.rlo {
                        put_bit(&mut mem!(), at / 8, 1 << (at % 8), false);
                    }
                    r.end_chain(r.rlo);
                }
                Op::ScanTimer { scan, number } => {
                    let m = &*cx.machine;
                    let bit = m.timers.get(usize::from(number)).is_some_and(|t| t.output(m.now));
                    scan_bit(scan, bit, &mut r);
                }
                Op::ScanCounter { scan, number } => {
                    let bit = cx.machine.counters.get(usize::from(number)).is_some_and(|c| c.value != 0);
                    scan_bit(scan, bit, &mut r);
                }
                Op::Open { scan } => slow::open_bracket(scan.logic, scan.negate, &mut r),
                Op::Close => slow::close_bracket(&mut r),
                Op::OrBranch => slow::or_branch(&mut r),
                Op::SetRlo => {
                    r.rlo = true;
                    r.end_chain(true);
                }
                Op::ClearRlo => {
                    r.rlo = false;
                    r.end_chain(false);
                }
                Op::NotRlo => {
                    r.rlo = !r.rlo;
                    r.sta = true;
                }

                Op::LoadByte { at } => slow::load(&mut r, u32::from(byte(&mem!(), at))),
                Op::LoadWord { at } => slow::load(&mut r, word(&mem!(), at)),
                Op::LoadDWord { at } => slow::load(&mut r, dword(&mem!(), at)),
                Op::StoreByte { at } => {
                    if let Some(b) = mem!().get_mut(at as usize) {
                        *b = r.a1 as u8;
                    }
                }
                Op::StoreWord { at } => put_word(&mut mem!(), at, r.a1),
                Op::StoreDWord { at } => put_dword(&mut mem!(), at, r.a1),
                Op::LoadInDb { bits, db, at } => {
                    r.db = cx.machine.memory.db(db).unwrap_or(r.db);
                    slow::load(&mut r, cx.machine.memory.read_bits(at * 8, bits));
                }
                Op::StoreInDb { bits, db, at } => {
                    r.db = cx.machine.memory.db(db).unwrap_or(r.db);
                    cx.machine.memory.write_bits(at * 8, bits, r.a1);
                }
                Op::LoadAt { bits, base, at } => {
                    let at = place!(base, at, u32::from(bits), false) / 8;
                    let value = match bits {
                        8 => u32::from(byte(&mem!(), at)),
                        16 => word(&mem!(), at),
                        _ => dword(&mem!(), at),
                    };
                    slow::load(&mut r, value);
                }
                Op::StoreAt { bits, base, at } => {
                    let at = place!(base, at, u32::from(bits), true) / 8;
                    match bits {
                        8 => {
                            if let Some(b) = mem!().get_mut(at as usize) {
                                *b = r.a1 as u8;
                            }
                        }
                        16 => put_word(&mut mem!(), at, r.a1),
                        _ => put_dword(&mut mem!(), at, r.a1),
                    }
                }
                Op::LoadConst { value } => slow::load(&mut r, value),

                Op::Int(op) => arithmetic!(arith::int, op),
                Op::DInt(op) => arithmetic!(arith::dint, op),
                Op::Real(op) => arithmetic!(arith::real, op),
                Op::Four(format, op) => {
                    let (result, cc) = slow::arithmetic(format, op, r.a2, r.a1);
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
                    let mut regs = r;
                    let taken = condition(on, &mut regs);
                    r = regs;
                    if taken {
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
                    jump!(target);
                }
                Op::CallNative { call, native } => {
                    count!();
                    from = pc;
                    attend!();
                    let call = &code.calls[call as usize];
                    let tops = Tops::of(cx.machine);
                    let entry = call::entry(call, tops, &r);
                    let supplied = call::check_depth(cx.machine).and_then(|()| {
                        if call.patches.is_empty() {
                            return call::fixed_references(call, cx.machine);
                        }
                        let mut regs = r;
                        call::references(call, &mut regs, cx.machine)
                    });
                    if let Err(fault) = supplied {
                        tops.release(cx.machine);
                        fail!(fault);
                    }
                    run_native!(call, native, entry, tops);
                }
                Op::Call { call: index } => {
                    count!();
                    from = pc;
                    attend!();
                    let call = &code.calls[index as usize];
                    let tops = Tops::of(cx.machine);
                    let mut regs = r;
                    let prepared = call::prepare(call, &mut regs, cx.machine, blocks);
                    match prepared {
                        Err(fault) => {
                            tops.release(cx.machine);
                            fail!(fault);
                        }
                        Ok(Prepared::Skipped) => r = regs,
                        Ok(Prepared::Ready(Callee::Code(next), entry)) => {
                            let called = &self.blocks[next as usize];
                            let instance = !matches!(call.instance, InstanceOf::None);
                            let at = CallSite { block: current, pc: pc as u32, call: index, instance, tops };
                            let entered = call::enter(at, &entry, called.local_len, &mut regs, cx.machine);
                            r = regs;
                            if let Err(fault) = entered {
                                tops.release(cx.machine);
                                fail!(fault);
                            }
                            code = called;
                            current = next;
                            pc = 0;
                            from = 0;
                        }
                        Ok(Prepared::Ready(Callee::Native(native), entry)) => {
                            r = regs;
                            run_native!(call, native, entry, tops);
                        }
                    }
                }
                Op::EndIf if !r.rlo => {
                    r.rlo = true;
                    r.end_chain(true);
                }
                Op::End | Op::EndIf => {
                    count!();
                    if cx.machine.frames.len() == floor {
                        break;
                    }
                    let Some(frame) = cx.machine.frames.pop() else { break };
                    current = frame.block;
                    code = &self.blocks[current as usize];
                    pc = frame.pc as usize;
                    from = pc;
                    let call = &code.calls[frame.call as usize];
                    let mut regs = r;
                    frame.leave(&mut regs, cx.machine);
                    let copied =
                        if call.copies_out { call::copy_out(call, frame.tops, &mut regs, cx.machine) } else { Ok(()) };
                    r = regs;
                    frame.tops.release(cx.machine);
                    if let Err(fault) = copied {
                        fail!(fault);
                    }
                }
                Op::Nop => {}
                Op::Slow => step_slowly!(),
            }
        }
        let m = &mut *cx.machine;
        m.pending = executed;
        (m.local_top, m.depth) = tops;
        Ok(())
    }

    /// Local data for the first block of a run.
    fn begin(&self, code: &Block, entry: &Entry, m: &mut Machine) -> Result<Regs, Fault> {
        let full = Fault::new(FaultKind::NestingDepth, u32::from(m.depth));
        let local = m.memory.local.locate(m.local_top, code.local_len).ok_or(full)?;
        m.local_top += code.local_len;
        m.depth += 1;
        let mut r = Regs::new(entry, local, code.local_len);
        if let Some(interrupted) = m.interrupted.take() {
            r.take_over(&interrupted);
        }
        Ok(r)
    }
}

/// The rarer jump conditions and what they do to the status word.
fn condition(on: Jump, r: &mut Regs) -> bool {
    let flags = r.flags;
    match on {
        Jump::Always => true,
        Jump::IfRlo | Jump::IfRloSaveBr | Jump::IfNotRlo | Jump::IfNotRloSaveBr => {
            let rlo = r.rlo;
            if matches!(on, Jump::IfRloSaveBr | Jump::IfNotRloSaveBr) {
                r.flags = flags & !BR | (u32::from(rlo) * BR);
            }
            r.rlo = true;
            r.end_chain(true);
            rlo == matches!(on, Jump::IfRlo | Jump::IfRloSaveBr)
        }
        Jump::IfBr | Jump::IfNotBr => {
            r.end_chain(true);
            (flags & BR != 0) == (on == Jump::IfBr)
        }
        Jump::IfOverflow => status_bit(flags, StatusBit::Overflow),
        Jump::IfStoredOverflow => {
            r.flags &= !OS;
            flags & OS != 0
        }
        Jump::IfZero => status_bit(flags, StatusBit::Zero),
        Jump::IfNotZero => status_bit(flags, StatusBit::NotZero),
        Jump::IfPositive => status_bit(flags, StatusBit::Positive),
        Jump::IfNegative => status_bit(flags, StatusBit::Negative),
        Jump::IfNotNegative => status_bit(flags, StatusBit::NotNegative),
        Jump::IfNotPositive => status_bit(flags, StatusBit::NotPositive),
        Jump::IfUnordered => status_bit(flags, StatusBit::Unordered),
    }
}
