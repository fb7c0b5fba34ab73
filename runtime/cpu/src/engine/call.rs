//! Calls at run time: references and copies in, the frame, copies out.

use ob1_ir::{CallMode, DbRegister};
use ob1_model::{Fault, FaultKind};

use super::code::{Call, CallTarget, InSource, InstanceOf, RefArg};
use super::regs::{OS, Regs};
use super::resolve::{POINTER_BITS, Where, in_db, locate, missing, number, open, read, reference, write};
use super::{Callee, Entry};
use crate::machine::{Blocks, Machine};
use crate::memory::Db;

/// The caller, while the called block runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) block: u32,
    pub(crate) pc: u32,
    /// Index of the call in the block's table.
    pub(crate) call: u32,
    saved: Saved,
}

/// What a return gives back to the caller.
#[derive(Clone, Copy, Debug)]
struct Saved {
    db: Db,
    di: Db,
    ar2: u32,
    /// AR2 comes back: a function block was called with its instance.
    instance: bool,
    nest: u64,
    local: u32,
    local_len: u32,
    previous_local: u32,
    previous_local_len: u32,
    refs: u32,
    refs_top: u32,
    scratch_top: u32,
    local_top: u32,
    mcr: u32,
    mcr_active: bool,
}

/// What is to be done after the parameters are in place.
pub(crate) enum Prepared {
    /// `CC` with RLO = 0.
    Skipped,
    /// The block, its entry and the caller's registers.
    Ready(Callee, Entry, Saving),
}

/// The caller's registers, opaque to the run loop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Saving(Saved);

/// The status word at the beginning of a called block and after the call.
fn status_of_call(r: &mut Regs) {
    r.flags &= !OS;
    r.end_chain(true);
}

/// Finds the callee and supplies its parameters.
pub(crate) fn prepare(call: &Call, r: &mut Regs, m: &mut Machine, blocks: &Blocks) -> Result<Prepared, Fault> {
    if call.mode == CallMode::Conditional {
        let rlo = std::mem::replace(&mut r.rlo, true);
        if !rlo {
            r.end_chain(true);
            return Ok(Prepared::Skipped);
        }
    }
    let callee = match call.target {
        CallTarget::Known(callee) => callee,
        CallTarget::Indirect(kind, n) => {
            let n = number(n, r, m)?;
            blocks.find(ob1_model::BlockId::new(kind, n)).ok_or_else(|| missing(kind, n))?
        }
    };
    if m.depth >= m.config.nesting_depth {
        return Err(Fault::new(FaultKind::NestingDepth, u32::from(m.depth)));
    }
    let saved = Saved {
        db: r.db,
        di: r.di,
        ar2: r.ar2,
        instance: !matches!(call.instance, InstanceOf::None),
        nest: r.nest,
        local: r.local,
        local_len: r.local_len,
        previous_local: r.previous_local,
        previous_local_len: r.previous_local_len,
        refs: r.refs,
        refs_top: m.refs_top,
        scratch_top: m.scratch_top,
        local_top: m.local_top,
        mcr: r.mcr,
        mcr_active: r.mcr_active,
    };
    let mut entry = Entry {
        refs: m.refs_top,
        given: call.given,
        db: r.db,
        di: r.di,
        ar2: r.ar2,
        previous_local: r.local,
        previous_local_len: r.local_len,
    };
    match call.instance {
        InstanceOf::None => references(call, r, m)?,
        InstanceOf::Db(n) => {
            let n = number(n, r, m)?;
            entry.di = open(m, n, DbRegister::Di)?;
            entry.ar2 = u32::from(ob1_model::Area::Db.pointer_code()) << 24;
            inputs(call, &entry, r, m)?;
        }
        InstanceOf::Local(at) => {
            entry.ar2 = super::slow::add_ar(r.ar2, at);
            inputs(call, &entry, r, m)?;
        }
    }
    // Fully qualified actuals have gone through the DB register; the caller's comes back.
    r.db = saved.db;
    r.di = saved.di;
    status_of_call(r);
    Ok(Prepared::Ready(callee, entry, Saving(saved)))
}

/// Enters a block of statements: local data and a frame.
pub(crate) fn enter(
    frame: (u32, u32, u32),
    saving: Saving,
    entry: &Entry,
    local_len: u32,
    r: &mut Regs,
    m: &mut Machine,
) -> Result<(), Fault> {
    let full = Fault::new(FaultKind::NestingDepth, u32::from(m.depth));
    let local = m.memory.local.locate(m.local_top, local_len).ok_or(full)?;
    if m.frames.len() == m.frames.capacity() {
        return Err(full);
    }
    m.frames.push(Frame { block: frame.0, pc: frame.1, call: frame.2, saved: saving.0 });
    m.local_top += local_len;
    m.depth += 1;
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
    Ok(())
}

/// Gives the caller its registers back. Statements' results (accumulators, AR1, RLO, flags) stay.
pub(crate) fn leave(saving: Saving, r: &mut Regs, m: &mut Machine) {
    let saved = saving.0;
    r.db = saved.db;
    r.di = saved.di;
    if saved.instance {
        r.ar2 = saved.ar2;
    }
    r.nest = saved.nest;
    r.local = saved.local;
    r.local_len = saved.local_len;
    r.previous_local = saved.previous_local;
    r.previous_local_len = saved.previous_local_len;
    r.refs = saved.refs;
    r.mcr = saved.mcr;
    r.mcr_active = saved.mcr_active;
    m.local_top = saved.local_top;
    status_of_call(r);
}

/// Releases references and scratch of a call, after its copies out.
pub(crate) fn release(saving: Saving, m: &mut Machine) {
    m.refs_top = saving.0.refs_top;
    m.scratch_top = saving.0.scratch_top;
}

impl Frame {
    pub(crate) fn saving(&self) -> Saving {
        Saving(self.saved)
    }
}

/// Puts the references to an FC's actuals on their stack.
fn references(call: &Call, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let full = Fault::new(FaultKind::NestingDepth, u32::from(m.depth));
    let base = m.refs_top as usize;
    let slots = m.refs.get_mut(base..base + call.refs.len()).ok_or(full)?;
    slots.copy_from_slice(&call.refs);
    let scratch_bit = (m.memory.scratch.at + m.scratch_top) * 8;
    if m.scratch_top + call.scratch > m.memory.scratch.len {
        return Err(full);
    }
    for (index, patch) in &call.patches {
        let reference = match *patch {
            RefArg::Local(at) => r.local * 8 + at,
            RefArg::Param { index, at } => reference(index, r, m) + at,
            RefArg::Db { at, bits } => arena(in_db(r.db, DbRegister::Db, at, bits, false)?),
            RefArg::Number(n) => u32::from(number(n, r, m)?),
            RefArg::Value(place) => read(place, 16, r, m)?,
            RefArg::Scratch { value, bits, scratch } => {
                let at = scratch_bit + scratch;
                m.memory.write_bits(at, bits, value);
                at
            }
            RefArg::Copy { place, bits, scratch, .. } => {
                let at = scratch_bit + scratch;
                let value = read(place, bits as u8, r, m)?;
                m.memory.write_bits(at, bits as u8, value);
                at
            }
            RefArg::Located { place, bits, out } => arena(locate(place, bits, out, r, m)?),
        };
        m.refs[base + usize::from(*index)] = reference;
    }
    m.refs_top += call.refs.len() as u32;
    m.scratch_top += call.scratch;
    Ok(())
}

/// Composed actuals in the peripheral area are refused at load; an indirect one reads nothing.
fn arena(place: Where) -> u32 {
    match place {
        Where::Arena(at) => at,
        Where::Peripheral(_) => 0,
    }
}

/// Copies the inputs into the instance.
fn inputs(call: &Call, entry: &Entry, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let base = instance(entry, call.instance_bytes)?;
    for input in &call.ins {
        let to = base + input.at;
        if input.bits > 32 {
            let from = match input.from {
                InSource::Arena(at) => at,
                InSource::Bytes { at, len } => {
                    m.memory.copy(at, to / 8, len);
                    continue;
                }
                InSource::Place(place) => arena(locate(place, input.bits, false, r, m)?),
                InSource::Const(_) | InSource::Number(_) => continue,
            };
            m.memory.copy(from / 8, to / 8, input.bits / 8);
            continue;
        }
        let bits = input.bits as u8;
        let value = match input.from {
            InSource::Const(value) => value,
            InSource::Arena(at) => m.memory.read_bits(at, bits),
            InSource::Bytes { at, .. } => m.memory.read_bits(at * 8, bits),
            InSource::Place(place) => read(place, bits, r, m)?,
            InSource::Number(n) => u32::from(number(n, r, m)?),
        };
        m.memory.write_bits(to, bits, value);
    }
    Ok(())
}

/// The first bit in the arena of the instance an entry names, when it is long enough.
fn instance(entry: &Entry, bytes: u32) -> Result<u32, Fault> {
    in_db(entry.di, DbRegister::Di, entry.ar2 & POINTER_BITS, bytes * 8, true).map(arena)
}

/// Copies results to the caller's actuals, after its registers have come back.
pub(crate) fn copy_out(call: &Call, saving: Saving, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let saved = saving.0;
    let (db, di) = (r.db, r.di);
    let result = (|| {
        match call.instance {
            InstanceOf::None => {
                let scratch_bit = (m.memory.scratch.at + saved.scratch_top) * 8;
                for (_, patch) in &call.patches {
                    if let RefArg::Copy { place, bits, scratch, out: true } = *patch {
                        let value = m.memory.read_bits(scratch_bit + scratch, bits as u8);
                        write(place, bits as u8, value, r, m)?;
                    }
                }
                return Ok(());
            }
            InstanceOf::Db(_) | InstanceOf::Local(_) => {}
        }
        let entry = match call.instance {
            InstanceOf::Db(n) => Entry { di: open(m, number(n, r, m)?, DbRegister::Di)?, ..Entry::default() },
            InstanceOf::Local(at) => Entry { di: r.di, ar2: super::slow::add_ar(r.ar2, at), ..Entry::default() },
            InstanceOf::None => return Ok(()),
        };
        let base = instance(&entry, call.instance_bytes)?;
        for out in &call.outs {
            let from = base + out.at;
            if out.bits > 32 {
                let to = arena(locate(out.to, out.bits, true, r, m)?);
                m.memory.copy(from / 8, to / 8, out.bits / 8);
            } else {
                let value = m.memory.read_bits(from, out.bits as u8);
                write(out.to, out.bits as u8, value, r, m)?;
            }
        }
        Ok(())
    })();
    (r.db, r.di) = (db, di);
    result
}
