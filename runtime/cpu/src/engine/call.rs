//! Calls at run time: references and copies in, the frame, copies out.

use ob1_ir::{CallMode, DbRegister};
use ob1_model::{BlockId, Fault, FaultKind};

use super::Entry;
use super::operand::{POINTER_BITS, Where, in_db, locate, missing, number, open, read, reference, write};
use super::plan::{Block, Call, CallTarget, Callee, InSource, InstanceOf, OutTarget, RefArg, Signatures};
use super::regs::{OS, Regs};
use crate::arena::{ArenaBit, ArenaByte, Db};
use crate::machine::Machine;

/// Tops of the stacks of references and scratch before a call.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tops {
    refs: u32,
    scratch: u32,
}

impl Tops {
    pub(crate) fn of(m: &Machine) -> Self {
        Self { refs: m.hot.refs_top, scratch: m.hot.scratch_top }
    }

    /// Releases references and scratch of a call, after its copies out.
    pub(crate) fn release(self, m: &mut Machine) {
        m.hot.refs_top = self.refs;
        m.hot.scratch_top = self.scratch;
    }
}

/// What a caller gets back when the called block ends.
#[derive(Clone, Copy, Debug, Default)]
pub struct Saved {
    local_top: u32,
    db: Db,
    di: Db,
    ar2: u32,
    nest: u64,
    local: ArenaByte,
    local_len: u32,
    previous_local: ArenaByte,
    previous_local_len: u32,
    refs: u32,
    mcr: u32,
    mcr_active: bool,
    /// A function block was called with its instance, which lies in this data block: AR2 is restored.
    instance: Option<Db>,
}

/// What is to be done after the parameters are in place.
pub enum Prepared {
    /// `CC` with RLO = 0.
    Skipped,
    /// The block and its entry.
    Ready(Callee, Entry),
}

/// The status word at the beginning of a called block and after the call.
#[inline]
pub(crate) fn status_of_call(r: &mut Regs) {
    r.flags &= !OS;
    r.end_chain(true);
}

/// What a called block finds in the caller's registers.
#[inline]
pub(crate) fn entry(call: &Call, tops: Tops, r: &Regs) -> Entry {
    Entry {
        refs: tops.refs,
        given: call.given,
        db: r.db,
        di: r.di,
        ar2: r.ar2,
        previous_local: r.local,
        previous_local_len: r.local_len,
    }
}

/// Checks that one more block can be nested.
pub(crate) fn check_depth(m: &Machine) -> Result<(), Fault> {
    if m.hot.depth >= u32::from(m.config.nesting_depth) {
        return Err(Fault::new(FaultKind::NestingDepth, m.hot.depth));
    }
    Ok(())
}

/// Finds the callee and supplies its parameters. A faulty call leaves the registers as they were.
pub(crate) fn prepare(call: &Call, r: &mut Regs, m: &mut Machine, signatures: &Signatures) -> Result<Prepared, Fault> {
    let (db, di, rlo) = (r.db, r.di, r.rlo);
    let prepared = supply(call, r, m, signatures);
    // Fully qualified actuals have gone through the data block registers; the caller's come back.
    (r.db, r.di) = (db, di);
    match &prepared {
        Ok(Prepared::Ready(..)) => status_of_call(r),
        Ok(Prepared::Skipped) => r.end_chain(true),
        Err(_) => r.rlo = rlo,
    }
    prepared
}

#[inline]
fn supply(call: &Call, r: &mut Regs, m: &mut Machine, signatures: &Signatures) -> Result<Prepared, Fault> {
    if call.mode == CallMode::Conditional {
        let rlo = std::mem::replace(&mut r.rlo, true);
        if !rlo {
            return Ok(Prepared::Skipped);
        }
    }
    let (callee, named) = match call.target {
        CallTarget::Known(callee) => (callee, None),
        CallTarget::Indirect(kind, n) => {
            let n = number(n, r, m)?;
            let id = BlockId::new(kind, n);
            (signatures.find(id).ok_or_else(|| missing(kind, n))?.callee, Some(id))
        }
    };
    check_depth(m)?;
    let mut entry = entry(call, Tops::of(m), r);
    match call.instance {
        InstanceOf::None => match &call.list {
            Some(list) => {
                let signature = match list.signature {
                    Some(index) => signatures.0.get(index as usize),
                    None => named.and_then(|id| signatures.find(id)),
                };
                let formals = signature.map_or(&[][..], |s| &s.formals);
                entry.given = super::pointer_list::references(&list.pointers, formals, r, m)?;
            }
            None => references(call, r, m)?,
        },
        InstanceOf::Db(n) | InstanceOf::Within(n, _) => {
            let n = number(n, r, m)?;
            entry.di = open(m, n, DbRegister::Di)?;
            entry.ar2 = (u32::from(ob1_model::Area::Db.pointer_code()) << 24) | first_bit(call.instance);
            inputs(call, &entry, r, m)?;
        }
        InstanceOf::Local(at) => {
            entry.ar2 = super::statement::add_ar(r.ar2, at);
            inputs(call, &entry, r, m)?;
        }
    }
    Ok(Prepared::Ready(callee, entry))
}

/// Where an instance begins in its data block, when that is known at load.
const fn first_bit(instance: InstanceOf) -> u32 {
    match instance {
        InstanceOf::Within(_, at) => at & POINTER_BITS,
        _ => 0,
    }
}

/// Enters a block of statements: gives it local data and its registers, and says what the caller gets back.
#[inline]
pub(crate) fn enter(
    instance: bool,
    entry: &Entry,
    local_len: u32,
    r: &mut Regs,
    m: &mut Machine,
) -> Result<Saved, Fault> {
    let full = Fault::new(FaultKind::NestingDepth, m.hot.depth);
    let local = m.memory.local.locate(m.hot.local_top, local_len).ok_or(full)?;
    let saved = Saved {
        local_top: m.hot.local_top,
        db: r.db,
        di: r.di,
        ar2: r.ar2,
        nest: r.nest,
        local: r.local,
        local_len: r.local_len,
        previous_local: r.previous_local,
        previous_local_len: r.previous_local_len,
        refs: r.refs,
        mcr: r.mcr,
        mcr_active: r.mcr_active,
        instance: instance.then_some(entry.di),
    };
    m.hot.local_top += local_len;
    m.hot.depth += 1;
    if instance {
        // STEP 7 exchanges the registers (`TDB`) before it opens the instance.
        r.db = r.di;
    }
    r.di = entry.di;
    r.ar2 = entry.ar2;
    r.refs = entry.refs;
    r.previous_local = entry.previous_local;
    r.previous_local_len = entry.previous_local_len;
    r.local = local;
    r.local_len = local_len;
    r.nest = 0;
    r.mcr = 1;
    r.mcr_active = false;
    Ok(saved)
}

/// The end of a call of a block of statements: the caller gets its registers back, then the results.
pub(crate) fn finish(call: &Call, saved: &Saved, tops: Tops, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    saved.leave(r, m);
    results(call, saved.instance, tops, r, m)
}

/// Copies the results of a call to its actuals and releases its stacks. Behind the call of a function block the DB
/// register holds the data block of its `instance`: STEP 7 makes a `CALL` of statements that leave it there.
pub(crate) fn results(
    call: &Call,
    instance: Option<Db>,
    tops: Tops,
    r: &mut Regs,
    m: &mut Machine,
) -> Result<(), Fault> {
    let copied = if call.copies_out { copy_out(call, tops, r, m) } else { Ok(()) };
    if let Some(db) = instance {
        r.db = db;
    }
    tops.release(m);
    copied
}

impl Saved {
    /// What is in the caller's DB and DI registers.
    #[must_use]
    pub const fn blocks(&self) -> [u16; 2] {
        [self.db.number, self.di.number]
    }

    /// Gives the caller its registers back. Statements' results (accumulators, AR1, RLO, flags) stay.
    #[inline]
    fn leave(&self, r: &mut Regs, m: &mut Machine) {
        r.db = self.db;
        r.di = self.di;
        if self.instance.is_some() {
            r.ar2 = self.ar2;
        }
        r.nest = self.nest;
        r.local = self.local;
        r.local_len = self.local_len;
        r.previous_local = self.previous_local;
        r.previous_local_len = self.previous_local_len;
        r.refs = self.refs;
        r.mcr = self.mcr;
        r.mcr_active = self.mcr_active;
        m.hot.local_top = self.local_top;
        m.hot.depth -= 1;
        status_of_call(r);
    }
}

/// References known at load, without patches.
pub(crate) fn fixed_references(call: &Call, m: &mut Machine) -> Result<(), Fault> {
    let base = m.hot.refs_top as usize;
    let full = Fault::new(FaultKind::NestingDepth, m.hot.depth);
    m.refs.get_mut(base..base + call.refs.len()).ok_or(full)?.copy_from_slice(&call.refs);
    m.hot.refs_top += call.refs.len() as u32;
    Ok(())
}

/// Puts the references to an FC's actuals on their stack.
pub(crate) fn references(call: &Call, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let full = Fault::new(FaultKind::NestingDepth, m.hot.depth);
    let base = m.hot.refs_top as usize;
    let slots = m.refs.get_mut(base..base + call.refs.len()).ok_or(full)?;
    slots.copy_from_slice(&call.refs);
    let scratch = m.memory.scratch.at.plus(m.hot.scratch_top);
    if m.hot.scratch_top + call.scratch > m.memory.scratch.len {
        return Err(full);
    }
    for (index, patch) in &call.patches {
        let reference = match *patch {
            RefArg::Local(at) => r.local.bit(at).0,
            RefArg::Param { index, at } => super::pointer_list::handed_on(reference(index, r, m), at, r, m),
            RefArg::Db { at, bits } => arena(in_db(r.db, DbRegister::Db, at, bits, false)?)?.0,
            RefArg::Number(n) => u32::from(number(n, r, m)?),
            RefArg::Value(place) => read(place, 16, r, m)?,
            RefArg::Bytes { at, len, scratch: bit } => {
                let to = scratch.bit(bit);
                m.memory.copy(at, to.byte(), len);
                to.0
            }
            RefArg::Scratch { value, bits, scratch: bit } => {
                let at = scratch.bit(bit);
                m.memory.write_bits(at, bits, value);
                at.0
            }
            RefArg::Copy { place, bits, scratch: bit, .. } => {
                let at = scratch.bit(bit);
                let value = read(place, bits as u8, r, m)?;
                m.memory.write_bits(at, bits as u8, value);
                at.0
            }
            RefArg::Located { place, bits, out } => arena(locate(place, bits, out, r, m)?)?.0,
        };
        m.refs[base + usize::from(*index)] = reference;
    }
    m.hot.refs_top += call.refs.len() as u32;
    m.hot.scratch_top += call.scratch;
    Ok(())
}

/// The bit of a composed actual in the arena. In the peripheral area there is nothing to refer to: an area error.
fn arena(place: Where) -> Result<ArenaBit, Fault> {
    match place {
        Where::Arena(at) => Ok(at),
        Where::Peripheral(at) => Err(Fault::new(FaultKind::AreaRead, at.byte())),
    }
}

/// Copies the inputs into the instance.
fn inputs(call: &Call, entry: &Entry, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let base = instance(entry, call.instance_bytes)?;
    for input in &call.ins {
        let to = base.plus(input.at);
        if input.bits > 32 {
            let from = match input.from {
                InSource::Arena(at) => at,
                InSource::Bytes { at, len } => {
                    m.memory.copy(at, to.byte(), len);
                    continue;
                }
                InSource::Place(place) => arena(locate(place, input.bits, false, r, m)?)?,
                InSource::Const(_) | InSource::Number(_) => continue,
            };
            m.memory.copy(from.byte(), to.byte(), input.bits / 8);
            continue;
        }
        let bits = input.bits as u8;
        let value = match input.from {
            InSource::Const(value) => value,
            InSource::Arena(at) => m.memory.read_bits(at, bits),
            InSource::Bytes { at, .. } => m.memory.read_bits(at.bit(0), bits),
            InSource::Place(place) => read(place, bits, r, m)?,
            InSource::Number(n) => u32::from(number(n, r, m)?),
        };
        m.memory.write_bits(to, bits, value);
    }
    Ok(())
}

/// The first bit in the arena of the instance an entry names, when it is long enough.
fn instance(entry: &Entry, bytes: u32) -> Result<ArenaBit, Fault> {
    in_db(entry.di, DbRegister::Di, entry.ar2 & POINTER_BITS, bytes * 8, true).and_then(arena)
}

/// Copies results to the caller's actuals, after its registers have come back. Fully qualified ones go through the data
/// block registers, which keep what they held.
fn copy_out(call: &Call, tops: Tops, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let (db, di) = (r.db, r.di);
    let result = match call.instance {
        InstanceOf::None => scratch_out(call, tops.scratch, r, m),
        InstanceOf::Db(n) | InstanceOf::Within(n, _) => {
            number(n, r, m).and_then(|n| open(m, n, DbRegister::Di)).and_then(|di| {
                let first = first_bit(call.instance);
                let base = in_db(di, DbRegister::Di, first, call.instance_bytes * 8, false).and_then(arena)?;
                instance_out(call, base, r, m)
            })
        }
        InstanceOf::Local(at) => {
            let at = (super::statement::add_ar(r.ar2, at)) & POINTER_BITS;
            let base = in_db(r.di, DbRegister::Di, at, call.instance_bytes * 8, false).and_then(arena);
            base.and_then(|base| instance_out(call, base, r, m))
        }
    };
    (r.db, r.di) = (db, di);
    result
}

fn scratch_out(call: &Call, scratch_top: u32, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let scratch_bit = m.memory.scratch.at.plus(scratch_top).bit(0);
    for (_, patch) in &call.patches {
        if let RefArg::Copy { place, bits, scratch, out: true } = *patch {
            let value = m.memory.read_bits(scratch_bit.plus(scratch), bits as u8);
            write(place, bits as u8, value, r, m)?;
        }
    }
    Ok(())
}

fn instance_out(call: &Call, base: ArenaBit, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    for out in &call.outs {
        let from = base.plus(out.at);
        if out.bits > 32 {
            let to = match out.to {
                OutTarget::Arena(to) => to,
                OutTarget::Place(place) => arena(locate(place, out.bits, true, r, m)?)?,
            };
            m.memory.copy(from.byte(), to.byte(), out.bits / 8);
            continue;
        }
        let value = m.memory.read_bits(from, out.bits as u8);
        match out.to {
            OutTarget::Arena(to) => m.memory.write_bits(to, out.bits as u8, value),
            OutTarget::Place(place) => write(place, out.bits as u8, value, r, m)?,
        }
    }
    Ok(())
}

/// Local data and registers for the first block of a run.
pub(crate) fn begin(block: &Block, entry: &Entry, m: &mut Machine) -> Result<Regs, Fault> {
    let full = Fault::new(FaultKind::NestingDepth, m.hot.depth);
    let local = m.memory.local.locate(m.hot.local_top, block.local_len).ok_or(full)?;
    m.hot.local_top += block.local_len;
    m.hot.depth += 1;
    let mut r = Regs::new(entry, local, block.local_len);
    if let Some(interrupted) = m.interrupted.take() {
        r.take_over(&interrupted);
    }
    Ok(r)
}
