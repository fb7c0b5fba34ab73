//! The meaning of every statement, executed straight from the intermediate code; jumps and calls only as far as they
//! change the status word. What an engine has no short form for comes here; tests run whole programs this way and
//! compare.

use ob1_ir::{AccuOp, AddressRegister, BitTest, DbRegister, Logic, NumberFormat, Op, Place, WordLogic};
use ob1_model::{Area, BitAddr, Fault, FaultKind};

use super::arith::{self, low_word};
use super::convert::convert;
use super::operand::{self, number, read, write};
use super::regs::{BR, CC0, CC1, OV, Regs, with_cc};
use super::shift::shift;
use crate::arena::Db;
use crate::machine::Machine;
use crate::timers::{Counter, Timer};

/// Bits of the status word that `L STW` shows and `T STW` writes on a CPU with two accumulators: not /FC, STA and OR
/// ["Statement List (STL) for S7-300 and S7-400 Programming", "L STW", "T STW", the notes on the S7-300].
const STATUS_300: u32 = 0x1F2;
/// The low 24 bits of an address register: the area code above them stays when addresses are added.
const AR_ADDRESS: u32 = 0x00FF_FFFF;

/// Executes one statement; a fault is handled by the caller.
pub(crate) fn step(op: &Op, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    match op {
        Op::Scan { .. }
        | Op::Open { .. }
        | Op::Close
        | Op::OrBranch
        | Op::Assign(_)
        | Op::Set(_)
        | Op::Reset(_)
        | Op::EdgePositive(_)
        | Op::EdgeNegative(_)
        | Op::SetRlo
        | Op::ClearRlo
        | Op::NotRlo
        | Op::SaveRlo => bit_logic(op, r, m),
        Op::Load(_)
        | Op::LoadConst(_)
        | Op::LoadParamPointer { .. }
        | Op::LoadParamCopy { .. }
        | Op::Transfer(_)
        | Op::LoadStatus
        | Op::TransferStatus
        | Op::LoadTimer(_)
        | Op::LoadTimerBcd(_)
        | Op::LoadCounter(_)
        | Op::LoadCounterBcd(_)
        | Op::LoadDbLength(_)
        | Op::LoadDbNumber(_) => load_transfer(op, r, m),
        Op::LoadAr(_)
        | Op::LoadArConst(..)
        | Op::LoadArFrom(..)
        | Op::CopyAr2ToAr1
        | Op::TransferAr(_)
        | Op::TransferArTo(..)
        | Op::CopyAr1ToAr2
        | Op::ExchangeArs
        | Op::AddAr(_)
        | Op::AddArConst(..)
        | Op::OpenDb(..)
        | Op::ExchangeDbs => address_registers(op, r, m),
        Op::StartTimer(..)
        | Op::ResetTimer(_)
        | Op::EnableTimer(_)
        | Op::CountUp(_)
        | Op::CountDown(_)
        | Op::SetCounter(_)
        | Op::ResetCounter(_)
        | Op::EnableCounter(_) => timers_counters(op, r, m),
        Op::McrActivate => {
            r.mcr_active = true;
            Ok(())
        }
        Op::McrDeactivate => {
            r.mcr_active = false;
            Ok(())
        }
        Op::McrOpen => {
            r.mcr = r.mcr << 1 | r.mcr & u32::from(r.rlo);
            r.end_chain(true);
            Ok(())
        }
        Op::McrClose => {
            r.mcr = (r.mcr >> 1).max(1);
            r.end_chain(true);
            Ok(())
        }
        // Jumps and calls are the run loop's own.
        Op::Nop | Op::Build(_) | Op::Jump(..) | Op::Loop(_) => Ok(()),
        Op::JumpList { .. } | Op::Call(_) | Op::End | Op::EndIf => Ok(()),
        _ => accumulators(op, r, m),
    }
}

/// The RLO after scanning `bit`, and what it does to the chain.
#[inline]
pub(crate) fn scan(logic: Logic, bit: bool, r: &mut Regs) {
    r.rlo = match logic {
        Logic::And => (!r.fc || r.rlo) & bit | r.or,
        Logic::Or => {
            r.or = false;
            r.fc && r.rlo || bit
        }
        Logic::Xor => {
            r.or = false;
            (r.fc && r.rlo) != bit
        }
    };
    r.sta = bit;
    r.fc = true;
}

/// Bits of an open bracket: the RLO so far (neutral at the start of a chain), OR, and how to combine.
pub(crate) fn open_bracket(logic: Logic, negate: bool, r: &mut Regs) {
    let rlo = if r.fc { r.rlo } else { logic == Logic::And };
    let entry = u64::from(rlo) | u64::from(r.or) << 1 | u64::from(negate) << 2 | (logic as u64) << 3;
    r.nest = r.nest << 8 | entry;
    r.end_chain(true);
}

/// `)`: combines the RLO of the bracket with the one in front of it.
pub(crate) fn close_bracket(r: &mut Regs) {
    let entry = r.nest & 0xFF;
    r.nest >>= 8;
    let (saved, or, negate) = (entry & 1 != 0, entry & 2 != 0, entry & 4 != 0);
    let inner = r.rlo != negate;
    r.or = or;
    r.rlo = match entry >> 3 & 3 {
        0 => saved & inner | or,
        1 => {
            r.or = false;
            saved | inner
        }
        _ => {
            r.or = false;
            saved != inner
        }
    };
    r.sta = true;
    r.fc = true;
}

/// `O` without an operand: what the ANDs in front gave is kept, the next AND begins.
#[inline]
pub(crate) fn or_branch(r: &mut Regs) {
    r.or = r.fc && r.rlo;
    r.fc = r.or;
    r.sta = true;
}

fn bit_logic(op: &Op, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    match *op {
        Op::Scan { logic, negate, test } => {
            let bit = match test {
                BitTest::Bit(place) => read(place, 1, r, m)? != 0,
                BitTest::Timer(n) => timer(n, r, m)?.output(m.hot.now),
                BitTest::Counter(n) => counter(n, r, m)?.value != 0,
                BitTest::Status(bit) => r.status_bit(bit),
            };
            scan(logic, bit != negate, r);
            if negate {
                // STA shows the operand as it is.
                r.sta = bit;
            }
        }
        Op::Open { logic, negate } => open_bracket(logic, negate, r),
        Op::Close => close_bracket(r),
        Op::OrBranch => or_branch(r),
        Op::Assign(place) => {
            let value = r.rlo && !r.mcr_off();
            write(place, 1, u32::from(value), r, m)?;
            r.end_chain(value);
        }
        Op::Set(place) => set_reset(place, true, r, m)?,
        Op::Reset(place) => set_reset(place, false, r, m)?,
        Op::EdgePositive(place) => {
            let (before, now) = edge(place, r, m)?;
            r.set_edge(now, now && !before);
        }
        Op::EdgeNegative(place) => {
            let (before, now) = edge(place, r, m)?;
            r.set_edge(now, !now && before);
        }
        Op::SetRlo => r.set_rlo(true),
        Op::ClearRlo => r.set_rlo(false),
        Op::NotRlo => r.invert_rlo(),
        Op::SaveRlo => r.flags = r.flags & !BR | (u32::from(r.rlo) * BR),
        _ => {}
    }
    Ok(())
}

fn set_reset(place: Place, value: bool, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    if r.rlo && !r.mcr_off() {
        write(place, 1, u32::from(value), r, m)?;
    } else {
        // Nothing is written, but the operand must be there.
        read(place, 1, r, m)?;
    }
    r.end_chain(r.rlo);
    Ok(())
}

/// Returns the previous edge memory bit, and the RLO, which the bit holds now.
fn edge(place: Place, r: &mut Regs, m: &mut Machine) -> Result<(bool, bool), Fault> {
    let before = read(place, 1, r, m)? != 0;
    write(place, 1, u32::from(r.rlo), r, m)?;
    Ok((before, r.rlo))
}

/// A value into ACCU1; what it held goes to ACCU2.
#[inline]
pub(crate) fn load(r: &mut Regs, value: u32) {
    r.a2 = r.a1;
    r.a1 = value;
}

/// True for statements that load ACCU1 from memory: one that fails loads 0, or what SFC 44 gives.
/// ["Inserting Substitute Values for Error Detection" of Programming with STEP 7]
pub(crate) const fn loads(op: &Op) -> bool {
    use Op::{Load, LoadCounter, LoadCounterBcd, LoadTimer, LoadTimerBcd};
    matches!(op, Load(_) | LoadTimer(_) | LoadTimerBcd(_) | LoadCounter(_) | LoadCounterBcd(_))
}

/// What `L STW` and `T STW` reach of the status word.
fn status_bits(m: &Machine) -> u32 {
    if m.config.accumulators == 4 { 0x1FF } else { STATUS_300 }
}

fn load_transfer(op: &Op, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    match *op {
        Op::Load(operand) => {
            let value = read(operand.place, operand.width.bits(), r, m)?;
            load(r, value);
        }
        Op::LoadConst(value) => load(r, value),
        Op::LoadParamPointer { index, at } => {
            let pointer = super::pointer_list::pointer_to(index, at, r, m)?;
            load(r, pointer);
        }
        Op::LoadParamCopy { index, bytes, at } => {
            // The last double word overlaps the one before: 6 and 10 bytes are no multiple of 4.
            let last = u32::from(bytes).saturating_sub(4);
            for offset in [0, 4, last].into_iter().filter(|offset| *offset <= last) {
                let value = read(Place::Param { index, at: BitAddr::byte_addr(offset) }, 32, r, m)?;
                write(Place::Fixed(Area::Local, BitAddr(at.0 + offset * 8)), 32, value, r, m)?;
            }
            load(r, super::operand::own_copy(at));
        }
        Op::Transfer(operand) => {
            let value = if r.mcr_off() { 0 } else { r.a1 };
            write(operand.place, operand.width.bits(), value, r, m)?;
        }
        Op::LoadStatus => {
            let seen = status_bits(m);
            load(r, r.status_word() & seen);
        }
        Op::TransferStatus => {
            let written = status_bits(m);
            r.set_status_word((r.status_word() & !written) | (r.a1 & written));
        }
        Op::LoadTimer(n) => {
            let value = timer(n, r, m)?.remaining(m.hot.now);
            load(r, u32::from(value));
        }
        Op::LoadTimerBcd(n) => {
            let value = timer(n, r, m)?.remaining_bcd(m.hot.now);
            load(r, u32::from(value));
        }
        Op::LoadCounter(n) => {
            let value = counter(n, r, m)?.value;
            load(r, u32::from(value));
        }
        Op::LoadCounterBcd(n) => {
            let value = counter(n, r, m)?.bcd();
            load(r, u32::from(value));
        }
        Op::LoadDbLength(register) => load(r, db(register, r).len),
        Op::LoadDbNumber(register) => load(r, u32::from(db(register, r).number)),
        _ => {}
    }
    Ok(())
}

fn db(register: DbRegister, r: &Regs) -> Db {
    match register {
        DbRegister::Db => r.db,
        DbRegister::Di => r.di,
    }
}

/// The result of an arithmetic statement, and its condition codes.
#[inline(never)]
pub(crate) fn arithmetic(format: NumberFormat, op: AccuOp, a2: u32, a1: u32) -> (u32, u32) {
    match format {
        NumberFormat::Int => arith::int(op, a2, a1),
        NumberFormat::DInt => arith::dint(op, a2, a1),
        NumberFormat::Real => arith::real(op, a2, a1),
    }
}

/// After arithmetic a CPU with four accumulators moves ACCU3 to ACCU2 and ACCU4 to ACCU3.
fn drop_accu2(r: &mut Regs, m: &Machine) {
    if m.config.accumulators == 4 {
        r.a2 = r.a3;
        r.a3 = r.a4;
    }
}

fn accumulators(op: &Op, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    match *op {
        Op::Arithmetic(format, op) => {
            let (result, cc) = arithmetic(format, op, r.a2, r.a1);
            r.a1 = result;
            r.set_cc(cc);
            drop_accu2(r, m);
        }
        Op::AddConst { format: NumberFormat::Int, value } => {
            r.a1 = low_word(r.a1, (r.a1 as u16).wrapping_add(value as u16));
        }
        Op::AddConst { value, .. } => r.a1 = r.a1.wrapping_add(value as u32),
        Op::Compare(format, compare) => {
            let (rlo, cc) = match format {
                NumberFormat::Int => arith::compare_int(compare, r.a2, r.a1),
                NumberFormat::DInt => arith::compare_dint(compare, r.a2, r.a1),
                NumberFormat::Real => arith::compare_real(compare, r.a2, r.a1),
            };
            r.set_cc(cc);
            r.set_result(rlo);
        }
        Op::WordLogic(op, constant) => {
            let with = constant.unwrap_or(r.a2 as u16);
            let result = word_logic(op, r.a1 & 0xFFFF, u32::from(with));
            r.a1 = low_word(r.a1, result as u16);
            r.flags = with_cc(r.flags, u32::from(result != 0) * CC1);
        }
        Op::DWordLogic(op, constant) => {
            r.a1 = word_logic(op, r.a1, constant.unwrap_or(r.a2));
            r.flags = with_cc(r.flags, u32::from(r.a1 != 0) * CC1);
        }
        Op::Shift(kind, count) => {
            if let Some((result, cc)) = shift(kind, r.a1, count.unwrap_or(r.a2 as u8)) {
                r.a1 = result;
                r.flags = with_cc(r.flags, cc);
            }
        }
        Op::RotateLeftCc1 => {
            let out = r.a1 >> 31;
            r.a1 = r.a1 << 1 | u32::from(r.flags & CC1 != 0);
            r.flags = r.flags & !(CC1 | CC0 | OV) | (out * CC1);
        }
        Op::RotateRightCc1 => {
            let out = r.a1 & 1;
            r.a1 = r.a1 >> 1 | u32::from(r.flags & CC1 != 0) << 31;
            r.flags = r.flags & !(CC1 | CC0 | OV) | (out * CC1);
        }
        Op::Convert(kind) => {
            (r.a1, r.flags) = convert(kind, r.a1, r.flags).map_err(|kind| Fault::new(kind, r.a1))?;
        }
        Op::Math(function) => {
            let (result, cc) = arith::math(function, r.a1);
            r.a1 = result;
            r.set_cc(cc);
        }
        Op::ExchangeAccus => std::mem::swap(&mut r.a1, &mut r.a2),
        Op::Push => {
            (r.a4, r.a3, r.a2) = (r.a3, r.a2, r.a1);
        }
        Op::Pop => {
            (r.a1, r.a2, r.a3) = (r.a2, if m.config.accumulators == 4 { r.a3 } else { r.a2 }, r.a4);
        }
        Op::Enter => (r.a4, r.a3) = (r.a3, r.a2),
        Op::Leave => (r.a2, r.a3) = (r.a3, r.a4),
        Op::Increment(n) => r.a1 = r.a1 & !0xFF | u32::from((r.a1 as u8).wrapping_add(n)),
        Op::Decrement(n) => r.a1 = r.a1 & !0xFF | u32::from((r.a1 as u8).wrapping_sub(n)),
        _ => {}
    }
    Ok(())
}

#[inline]
pub(crate) const fn word_logic(op: WordLogic, a: u32, b: u32) -> u32 {
    match op {
        WordLogic::And => a & b,
        WordLogic::Or => a | b,
        WordLogic::Xor => a ^ b,
    }
}

fn ar(register: AddressRegister, r: &mut Regs) -> &mut u32 {
    match register {
        AddressRegister::Ar1 => &mut r.ar1,
        AddressRegister::Ar2 => &mut r.ar2,
    }
}

/// An address register plus an address; its area code stays.
#[inline]
pub(crate) const fn add_ar(ar: u32, offset: u32) -> u32 {
    ar & !AR_ADDRESS | ar.wrapping_add(offset) & AR_ADDRESS
}

fn address_registers(op: &Op, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    match *op {
        Op::LoadAr(register) => *ar(register, r) = r.a1,
        Op::LoadArConst(register, value) => *ar(register, r) = value,
        Op::LoadArFrom(register, operand) => {
            let value = read(operand.place, operand.width.bits(), r, m)?;
            *ar(register, r) = value;
        }
        Op::CopyAr2ToAr1 => r.ar1 = r.ar2,
        Op::TransferAr(register) => {
            let value = *ar(register, r);
            load(r, value);
        }
        Op::TransferArTo(register, operand) => {
            let value = *ar(register, r);
            write(operand.place, operand.width.bits(), value, r, m)?;
        }
        Op::CopyAr1ToAr2 => r.ar2 = r.ar1,
        Op::ExchangeArs => std::mem::swap(&mut r.ar1, &mut r.ar2),
        Op::AddAr(register) => {
            // ACCU1-L is an INT: its sign fills the 24 bits.
            let offset = i32::from(r.a1 as i16) as u32;
            let register = ar(register, r);
            *register = add_ar(*register, offset);
        }
        Op::AddArConst(register, BitAddr(offset)) => {
            // 16 bits with a sign, as machine code has them: P#8190.0 goes two bytes back.
            let offset = i32::from(offset as u16 as i16) as u32;
            let register = ar(register, r);
            *register = add_ar(*register, offset);
        }
        Op::OpenDb(register, n) => {
            let db = match number(n, r, m)? {
                // The POINTER of an operand outside data blocks has number 0: no data block is open then, and that is
                // no error.
                0 => Db::default(),
                n => operand::open(m, n, register)?,
            };
            match register {
                DbRegister::Db => r.db = db,
                DbRegister::Di => r.di = db,
            }
        }
        Op::ExchangeDbs => std::mem::swap(&mut r.db, &mut r.di),
        _ => {}
    }
    Ok(())
}

fn timer<'m>(n: ob1_ir::Number, r: &Regs, m: &'m Machine) -> Result<&'m Timer, Fault> {
    let n = number(n, r, m)?;
    m.timers.get(usize::from(n)).ok_or(Fault::new(FaultKind::TimerNumber, u32::from(n)))
}

fn counter<'m>(n: ob1_ir::Number, r: &Regs, m: &'m Machine) -> Result<&'m Counter, Fault> {
    let n = number(n, r, m)?;
    m.counters.get(usize::from(n)).ok_or(Fault::new(FaultKind::CounterNumber, u32::from(n)))
}

fn timers_counters(op: &Op, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let (Op::StartTimer(_, n)
    | Op::ResetTimer(n)
    | Op::EnableTimer(n)
    | Op::CountUp(n)
    | Op::CountDown(n)
    | Op::SetCounter(n)
    | Op::ResetCounter(n)
    | Op::EnableCounter(n)) = op
    else {
        return Ok(());
    };
    let n = number(*n, r, m)?;
    // The chain ends, whatever happens to the timer.
    r.fc = false;
    r.or = false;
    let at = usize::from(n);
    if let Op::StartTimer(..) | Op::ResetTimer(_) | Op::EnableTimer(_) = op {
        let timer = m.timers.get_mut(at).ok_or(Fault::new(FaultKind::TimerNumber, u32::from(n)))?;
        match op {
            Op::StartTimer(kind, _) => {
                timer.run(*kind, r.rlo, r.a1 as u16, m.hot.now).map_err(|kind| Fault::new(kind, r.a1 & 0xFFFF))?;
            }
            Op::EnableTimer(_) => timer.enable(r.rlo),
            _ if r.rlo => timer.reset(),
            _ => {}
        }
        return Ok(());
    }
    let counter = m.counters.get_mut(at).ok_or(Fault::new(FaultKind::CounterNumber, u32::from(n)))?;
    match op {
        Op::CountUp(_) => counter.up(r.rlo),
        Op::CountDown(_) => counter.down(r.rlo),
        Op::SetCounter(_) => counter.set(r.rlo, r.a1 as u16).map_err(|kind| Fault::new(kind, r.a1 & 0xFFFF))?,
        Op::EnableCounter(_) => counter.enable(r.rlo),
        _ if r.rlo => counter.value = 0,
        _ => {}
    }
    Ok(())
}
