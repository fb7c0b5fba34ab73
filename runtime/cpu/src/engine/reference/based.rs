//! Places whose base is in a register, as far as they need no second look: [`crate::engine::operand`] has them all,
//! with the peripheral area and the faults.

use ob1_model::{Area, BitAddr};

use super::bytes::dword;
use crate::arena::{ArenaBit, ArenaByte, Db, Range};
use crate::engine::operand::{OWN_LOCAL, POINTER_BITS, RAW, reference};
use crate::engine::plan::{AREA_IN_POINTER, Base};
use crate::engine::regs::Regs;
use crate::machine::Machine;

/// The byte of an operand of `bits` bits, and the mask of its bit there. `None`: it lies in the peripheral area, or is
/// faulty.
#[inline(always)]
pub(super) fn find(base: Base, at: BitAddr, bits: u32, write: bool, r: &Regs, m: &Machine) -> Option<(ArenaByte, u8)> {
    let BitAddr(at) = at;
    match base {
        // Verified.
        Base::Local => Some((r.local.plus(at / 8), mask(at))),
        Base::Db => inside(data(r.db, write), at, bits),
        Base::Instance => inside(data(r.di, write), (r.ar2 & POINTER_BITS).wrapping_add(at), bits),
        Base::Param(index) => {
            let reference = reference(index, r, m);
            let at = ArenaBit(reference.wrapping_add(at));
            (reference & RAW == 0).then(|| (at.byte(), at.mask()))
        }
        Base::Ar1(code) => indirect(r.ar1, code, at, bits, write, r, m),
        Base::Ar2(code) => indirect(r.ar2, code, at, bits, write, r, m),
        Base::Pointer { code, md } => {
            let pointer = dword(&m.memory.bytes, m.memory.memory.at.plus(u32::from(md)));
            indirect(pointer, code, 0, bits, write, r, m)
        }
    }
}

#[inline(always)]
fn indirect(
    pointer: u32,
    code: u8,
    offset: u32,
    bits: u32,
    write: bool,
    r: &Regs,
    m: &Machine,
) -> Option<(ArenaByte, u8)> {
    let at = pointer.wrapping_add(offset) & POINTER_BITS;
    if bits > 1 && !at.is_multiple_of(8) {
        return None;
    }
    let code = if code == AREA_IN_POINTER { (pointer >> 24) as u8 } else { code };
    let range = match Area::from_pointer_code(code)? {
        Area::Db => data(r.db, write),
        Area::Di => data(r.di, write),
        Area::Memory => m.memory.memory,
        Area::Input => m.memory.inputs,
        Area::Output => m.memory.outputs,
        Area::Local => Range { at: r.local, len: r.local_len },
        Area::PreviousLocal if at >= OWN_LOCAL * 8 => {
            return inside(Range { at: r.local, len: r.local_len }, at - OWN_LOCAL * 8, bits);
        }
        Area::PreviousLocal => Range { at: r.previous_local, len: r.previous_local_len },
        Area::Peripheral => return None,
    };
    inside(range, at, bits)
}

/// What of a data block can be read or written.
#[inline(always)]
fn data(db: Db, write: bool) -> Range {
    Range { at: db.at, len: if write { db.writable } else { db.len } }
}

#[inline(always)]
fn inside(range: Range, at: u32, bits: u32) -> Option<(ArenaByte, u8)> {
    range.locate(at / 8, bits.div_ceil(8)).map(|byte| (byte, mask(at)))
}

#[inline(always)]
fn mask(at: u32) -> u8 {
    1 << (at % 8)
}
