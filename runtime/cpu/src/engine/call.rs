//! Calls at run time: references and copies in, the frame, copies out.

use ob1_ir::{CallMode, DbRegister};
use ob1_model::{BlockId, Fault, FaultKind};

use super::code::{Call, CallTarget, InSource, InstanceOf, OutTarget, RefArg};
use super::regs::{OS, Regs};
use super::resolve::{POINTER_BITS, Where, in_db, locate, missing, number, open, read, reference, write};
use super::{Callee, Entry};
use crate::machine::{Blocks, Machine};
use crate::memory::Db;

/// Tops of the stacks of references and scratch before a call.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tops {
    refs: u32,
    scratch: u32,
}

impl Tops {
    pub(crate) fn of(m: &Machine) -> Self {
        Self { refs: m.refs_top, scratch: m.scratch_top }
    }

    /// Releases references and scratch of a call, after its copies out.
    pub(crate) fn release(self, m: &mut Machine) {
        m.refs_top = self.refs;
        m.scratch_top = self.scratch;
    }
}

/// The caller, while the called block runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// Its index.
    pub(crate) block: u32,
    /// The statement behind the call.
    pub(crate) pc: u32,
    /// Index of the call in the block's table.
    pub(crate) call: u32,
    pub(crate) tops: Tops,
    local_top: u32,
    db: Db,
    di: Db,
    ar2: u32,
    nest: u64,
    local: u32,
    local_len: u32,
    previous_local: u32,
    previous_local_len: u32,
    refs: u32,
    mcr: u32,
    mcr_active: bool,
    /// AR2 comes back: a function block was called with its instance.
    instance: bool,
}

/// What is to be done after the parameters are in place.
pub(crate) enum Prepared {
    /// `CC` with RLO = 0.
    Skipped,
    /// The block and its entry.
    Ready(Callee, Entry),
}

/// The status word at the beginning of a called block and after the call.
pub(crate) fn status_of_call(r: &mut Regs) {
    r.flags &= !OS;
    r.end_chain(true);
}

/// What a called block finds in the caller's registers.
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

/// One more block can be called.
pub(crate) fn check_depth(m: &Machine) -> Result<(), Fault> {
    if m.depth >= m.config.nesting_depth {
        return Err(Fault::new(FaultKind::NestingDepth, u32::from(m.depth)));
    }
    Ok(())
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
    let (callee, named) = match call.target {
        CallTarget::Known(callee) => (callee, None),
        CallTarget::Indirect(kind, n) => {
            let n = number(n, r, m)?;
            let id = BlockId::new(kind, n);
            (blocks.find(id).ok_or_else(|| missing(kind, n))?, Some(id))
        }
    };
    check_depth(m)?;
    let mut entry = entry(call, Tops::of(m), r);
    let (db, di) = (r.db, r.di);
    match call.instance {
        InstanceOf::None => match &call.list {
            Some(list) => {
                let signature = match list.signature {
                    Some(index) => blocks.signatures.0.get(index as usize),
                    None => named.and_then(|id| blocks.signatures.find(id)),
                };
                let formals = signature.map_or(&[][..], |s| &s.formals);
                entry.given = super::raw::references(&list.pointers, formals, r, m)?;
            }
            None => references(call, r, m)?,
        },
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
    // Fully qualified actuals have gone through the data block registers; the caller's come back.
    (r.db, r.di) = (db, di);
    status_of_call(r);
    Ok(Prepared::Ready(callee, entry))
}

/// The place of a call in its block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CallSite {
    pub(crate) block: u32,
    pub(crate) pc: u32,
    pub(crate) call: u32,
    pub(crate) instance: bool,
    pub(crate) tops: Tops,
}

/// Enters a block of statements: local data and a frame.
pub(crate) fn enter(at: CallSite, entry: &Entry, local_len: u32, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let full = Fault::new(FaultKind::NestingDepth, u32::from(m.depth));
    let local = m.memory.local.locate(m.local_top, local_len).ok_or(full)?;
    if m.frames.len() == m.frames.capacity() {
        return Err(full);
    }
    m.frames.push(Frame {
        block: at.block,
        pc: at.pc,
        call: at.call,
        tops: at.tops,
        local_top: m.local_top,
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
        instance: at.instance,
    });
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

impl Frame {
    /// Gives the caller its registers back. Statements' results (accumulators, AR1, RLO, flags) stay.
    pub(crate) fn leave(&self, r: &mut Regs, m: &mut Machine) {
        r.db = self.db;
        r.di = self.di;
        if self.instance {
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
        m.local_top = self.local_top;
        m.depth -= 1;
        status_of_call(r);
    }
}

/// References known at load, without patches.
pub(crate) fn fixed_references(call: &Call, m: &mut Machine) -> Result<(), Fault> {
    let base = m.refs_top as usize;
    let full = Fault::new(FaultKind::NestingDepth, u32::from(m.depth));
    m.refs.get_mut(base..base + call.refs.len()).ok_or(full)?.copy_from_slice(&call.refs);
    m.refs_top += call.refs.len() as u32;
    Ok(())
}

/// Puts the references to an FC's actuals on their stack.
pub(crate) fn references(call: &Call, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
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
            RefArg::Param { index, at } => super::raw::handed_on(reference(index, r, m), at, r, m),
            RefArg::Db { at, bits } => arena(in_db(r.db, DbRegister::Db, at, bits, false)?)?,
            RefArg::Number(n) => u32::from(number(n, r, m)?),
            RefArg::Value(place) => read(place, 16, r, m)?,
            RefArg::Bytes { at, len, scratch } => {
                let to = scratch_bit + scratch;
                m.memory.copy(at, to / 8, len);
                to
            }
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
            RefArg::Located { place, bits, out } => arena(locate(place, bits, out, r, m)?)?,
        };
        m.refs[base + usize::from(*index)] = reference;
    }
    m.refs_top += call.refs.len() as u32;
    m.scratch_top += call.scratch;
    Ok(())
}

/// The bit of a composed actual in the arena. In the peripheral area there is nothing to refer to: an area error.
fn arena(place: Where) -> Result<u32, Fault> {
    match place {
        Where::Arena(at) => Ok(at),
        Where::Peripheral(at) => Err(Fault::new(FaultKind::AreaRead, at / 8)),
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
                InSource::Place(place) => arena(locate(place, input.bits, false, r, m)?)?,
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
    in_db(entry.di, DbRegister::Di, entry.ar2 & POINTER_BITS, bytes * 8, true).and_then(arena)
}

/// Copies results to the caller's actuals, after its registers have come back. Fully qualified ones go through the data
/// block registers, which keep what they held.
pub(crate) fn copy_out(call: &Call, tops: Tops, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let (db, di) = (r.db, r.di);
    let result = match call.instance {
        InstanceOf::None => scratch_out(call, tops.scratch, r, m),
        InstanceOf::Db(n) => number(n, r, m).and_then(|n| open(m, n, DbRegister::Di)).and_then(|di| {
            let base = in_db(di, DbRegister::Di, 0, call.instance_bytes * 8, false).and_then(arena)?;
            instance_out(call, base, r, m)
        }),
        InstanceOf::Local(at) => {
            let at = (super::slow::add_ar(r.ar2, at)) & POINTER_BITS;
            let base = in_db(r.di, DbRegister::Di, at, call.instance_bytes * 8, false).and_then(arena);
            base.and_then(|base| instance_out(call, base, r, m))
        }
    };
    (r.db, r.di) = (db, di);
    result
}

fn scratch_out(call: &Call, scratch_top: u32, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    let scratch_bit = (m.memory.scratch.at + scratch_top) * 8;
    for (_, patch) in &call.patches {
        if let RefArg::Copy { place, bits, scratch, out: true } = *patch {
            let value = m.memory.read_bits(scratch_bit + scratch, bits as u8);
            write(place, bits as u8, value, r, m)?;
        }
    }
    Ok(())
}

fn instance_out(call: &Call, base: u32, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    for out in &call.outs {
        let from = base + out.at;
        if out.bits > 32 {
            let to = match out.to {
                OutTarget::Arena(to) => to,
                OutTarget::Place(place) => arena(locate(place, out.bits, true, r, m)?)?,
            };
            m.memory.copy(from / 8, to / 8, out.bits / 8);
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
