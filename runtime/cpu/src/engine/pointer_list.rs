//! The list of pointers after a `UC` or `CC` of an FC or SFC, as machine code has it, and the pointers to a function's
//! own parameters.
//!
//! A reference to an actual is a bit of the arena, which fits 31 bits. With the highest bit set it is a pointer from
//! the list: its area is resolved at each access, as on the CPU. So an operand in a data block follows the data block
//! registers, an operand in the peripheral area is read there, and a pointer to nothing is an area error of the
//! statement that uses it.

use ob1_ir::DbRegister;
use ob1_model::{Area, BitAddr, Fault, FaultKind};

use super::operand::{COPIES, POINTER_BITS, RAW, Where, aligned, by_pointer, in_area, in_db, own_copy, reference};
use super::plan::Formal;
use super::regs::Regs;
use crate::arena::{ArenaBit, Range};
use crate::machine::Machine;

/// A reference to nothing: an area that does not exist.
const NOWHERE: u32 = 0xFF00_0000;

/// Bits of a POINTER.
const POINTER: u32 = 48;

/// Puts the references of a list on their stack: one for each formal, [`NOWHERE`] where the list is too short. Returns
/// which formals the list has.
pub(crate) fn references(list: &[u32], formals: &[Formal], r: &Regs, m: &mut Machine) -> Result<u64, Fault> {
    let base = m.hot.refs_top as usize;
    if m.refs.len() < base + formals.len() {
        return Err(Fault::new(FaultKind::NestingDepth, m.hot.depth));
    }
    let mut given = 0;
    for (index, formal) in formals.iter().enumerate() {
        let entry = list.get(usize::from(formal.listed)).copied();
        if let Some(slot) = m.refs.get_mut(base + index) {
            *slot = NOWHERE;
        }
        if let Some(entry) = entry {
            given |= 1u64.checked_shl(index as u32).unwrap_or(0);
            let reference = refer(entry, formal, r, m);
            if let Some(slot) = m.refs.get_mut(base + index) {
                *slot = reference;
            }
        }
    }
    m.hot.refs_top += formals.len() as u32;
    Ok(given)
}

/// The reference that an entry of the list is for a formal.
fn refer(entry: u32, formal: &Formal, r: &Regs, m: &Machine) -> u32 {
    if formal.number {
        return entry >> 16;
    }
    let at = entry & POINTER_BITS;
    let Some(area) = Area::from_pointer_code((entry >> 24) as u8) else { return NOWHERE };
    if formal.elementary {
        // These follow the registers of the block called; everything else stays where it is.
        if matches!(area, Area::Db | Area::Di | Area::Local | Area::Peripheral) {
            return entry;
        }
        return arena(place(area, at, formal.bits, r, m)).map_or(entry, |at| at.0);
    }
    if !formal.by_pointer {
        return arena(place(area, at, formal.bits, r, m)).map_or(NOWHERE, |at| at.0);
    }
    let Some(pointer) = arena(place(area, at, POINTER, r, m)) else { return NOWHERE };
    let db = m.memory.read_bits(pointer, 16) as u16;
    let bits = m.memory.read_bits(pointer.plus(16), 32);
    let to = bits & POINTER_BITS;
    let found = match Area::from_pointer_code((bits >> 24) as u8) {
        Some(Area::Db | Area::Di) if db > 0 => {
            m.memory.db(db).and_then(|db| arena(in_db(db, DbRegister::Db, to, formal.least_bits(), false)))
        }
        Some(area) => arena(place(area, to, formal.least_bits(), r, m)),
        None => None,
    };
    found.map_or(NOWHERE, |at| at.0)
}

/// A place as the caller sees it; area V of the block called is the caller's local data.
fn place(area: Area, at: u32, bits: u32, r: &Regs, m: &Machine) -> Result<Where, Fault> {
    let area = if area == Area::PreviousLocal { Area::Local } else { area };
    aligned(area, at, bits, false)?;
    in_area(area, at, bits, false, r, m)
}

fn arena(place: Result<Where, Fault>) -> Option<ArenaBit> {
    match place {
        Ok(Where::Arena(at)) => Some(at),
        Ok(Where::Peripheral(_)) | Err(_) => None,
    }
}

/// The reference for a called block that is passed the parameter of this one.
pub(crate) fn handed_on(reference: u32, at: u32, r: &Regs, m: &Machine) -> u32 {
    if reference & RAW == 0 {
        return reference + at;
    }
    match by_pointer(reference, at, 1, false, r, m) {
        Ok(Where::Arena(at)) => at.0,
        Ok(Where::Peripheral(_)) => reference + at,
        Err(_) => NOWHERE,
    }
}

/// `L P##name`: the pointer to the actual parameter `index`. With `by`, its POINTER is written to that place of the
/// local data, and the answer points there, in area V as on a rack.
pub(crate) fn pointer_to(index: u16, by: Option<BitAddr>, r: &Regs, m: &mut Machine) -> Result<u32, Fault> {
    let reference = reference(index, r, m);
    let Some(by) = by else {
        if reference & RAW != 0 {
            return Ok(reference);
        }
        return Ok(pointer(ArenaBit(reference), r, m)?.1);
    };
    let (db, bits) = if reference & RAW != 0 {
        return Err(Fault::new(FaultKind::AreaRead, reference >> 24));
    } else {
        pointer(ArenaBit(reference), r, m)?
    };
    let Where::Arena(at) = in_area(Area::Local, by.0, POINTER, true, r, m)? else { return Ok(0) };
    m.memory.write_bits(at, 16, u32::from(db));
    m.memory.write_bits(at.plus(16), 32, bits);
    Ok(own_copy(by))
}

/// Data block and pointer to a bit of the arena, as the running block can use them.
fn pointer(bit: ArenaBit, r: &Regs, m: &Machine) -> Result<(u16, u32), Fault> {
    let memory = &m.memory;
    let byte = bit.byte();
    let within = |range: Range| (range.at..range.end()).contains(&byte).then(|| bit.0 - range.at.bit(0).0);
    let areas = [
        (Area::Input, memory.inputs, 0),
        (Area::Output, memory.outputs, 0),
        (Area::Memory, memory.memory, 0),
        (Area::PreviousLocal, Range { at: r.previous_local, len: r.previous_local_len }, 0),
        (Area::Local, Range { at: r.local, len: r.local_len }, 0),
        (Area::PreviousLocal, memory.scratch, COPIES * 8),
    ];
    let code = |area: Area| u32::from(area.pointer_code()) << 24;
    for (area, range, offset) in areas {
        if let Some(at) = within(range) {
            return Ok((0, code(area) | (at + offset)));
        }
    }
    // The data blocks of the program are in ascending order; the few it has made itself are in any order.
    let (program, made) = memory.dbs.split_at(memory.program_dbs.min(memory.dbs.len()));
    let last = program.partition_point(|db| db.at <= byte);
    let candidates = program.get(last.saturating_sub(1)..last).into_iter().flatten().chain(made);
    for db in candidates.filter(|db| db.number > 0) {
        if let Some(at) = within(db.range()) {
            return Ok((db.number, code(Area::Db) | at));
        }
    }
    Err(Fault::new(FaultKind::AreaRead, 0))
}
