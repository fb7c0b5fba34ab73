//! From an operand to a place in the arena or the peripheral area.

use ob1_ir::{AddressRegister, DbRegister, Number, Place, Pointer};
use ob1_model::{Area, BitAddr, BlockKind, Fault, FaultKind};

use super::regs::Regs;
use crate::arena::{ArenaBit, Db, Range};
use crate::machine::Machine;

/// The part of a pointer that is an address: 16 bits of byte, 3 of bit.
pub const POINTER_BITS: u32 = 0x7_FFFF;

/// Set in a reference that is a pointer of a list.
pub const RAW: u32 = 0x8000_0000;

/// Addresses of area V from here on are the copies that calls make of constants and of operands without an address.
pub(crate) const COPIES: u32 = 0x8000;

/// Addresses of area V from here on are the running block's own local data: there lie the POINTERs that `L P##name`
/// makes of composed parameters. On a rack the caller has made them, in its local data.
pub const OWN_LOCAL: u32 = 0xC000;
const _: () = assert!(COPIES + crate::memory::SCRATCH_BYTES <= OWN_LOCAL, "both are told apart");

/// Where an operand lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Where {
    /// In the arena, at this bit.
    Arena(ArenaBit),
    /// Byte and bit in the peripheral area.
    Peripheral(BitAddr),
}

/// The place of `bits` bits (any number; above 1 they are whole bytes) for reading or writing.
pub(crate) fn locate(place: Place, bits: u32, write: bool, r: &mut Regs, m: &Machine) -> Result<Where, Fault> {
    match place {
        Place::Fixed(area, at) => in_area(area, at.0, bits, write, r, m),
        Place::InDb(number, at) => {
            r.db = open(m, number, DbRegister::Db)?;
            in_db(r.db, DbRegister::Db, at.0, bits, write)
        }
        Place::InDi(number, at) => {
            r.di = open(m, number, DbRegister::Di)?;
            in_db(r.di, DbRegister::Di, at.0, bits, write)
        }
        Place::Param { index, at } => param(index, at.0, bits, write, r, m),
        Place::Instance(at) => in_db(r.di, DbRegister::Di, (r.ar2 & POINTER_BITS).wrapping_add(at.0), bits, write),
        Place::Memory(area, pointer) => {
            let at = read_pointer(pointer, 32, r, m)? & POINTER_BITS;
            aligned(area, at, bits, write)?;
            in_area(area, at, bits, write, r, m)
        }
        Place::Register(area, register, offset) => {
            let pointer = match register {
                AddressRegister::Ar1 => r.ar1,
                AddressRegister::Ar2 => r.ar2,
            };
            let at = pointer.wrapping_add(offset.0) & POINTER_BITS;
            let area = match area {
                Some(area) => area,
                None => Area::from_pointer_code((pointer >> 24) as u8).ok_or_else(|| {
                    Fault::new(if write { FaultKind::AreaWrite } else { FaultKind::AreaRead }, pointer >> 24)
                })?,
            };
            aligned(area, at, bits, write)?;
            in_area(area, at, bits, write, r, m)
        }
    }
}

/// The reference to the actual parameter `index`.
#[inline]
pub(crate) fn reference(index: u16, r: &Regs, m: &Machine) -> u32 {
    m.refs.get(r.refs as usize + usize::from(index)).copied().unwrap_or(0)
}

/// The place of an actual, `at` bits into it.
fn param(index: u16, at: u32, bits: u32, write: bool, r: &Regs, m: &Machine) -> Result<Where, Fault> {
    let reference = reference(index, r, m);
    if reference & RAW != 0 {
        return by_pointer(reference, at, bits, write, r, m);
    }
    Ok(Where::Arena(ArenaBit(reference.wrapping_add(at))))
}

/// The place a reference that is a pointer names now, `at` bits into it.
#[cold]
pub(crate) fn by_pointer(pointer: u32, at: u32, bits: u32, write: bool, r: &Regs, m: &Machine) -> Result<Where, Fault> {
    let Some(area) = Area::from_pointer_code((pointer >> 24) as u8) else {
        let kind = if write { FaultKind::AreaWrite } else { FaultKind::AreaRead };
        return Err(Fault::new(kind, pointer >> 24));
    };
    let at = (pointer & POINTER_BITS) + at;
    aligned(area, at, bits, write)?;
    in_area(area, at, bits, write, r, m)
}

/// Checks that an operand of whole bytes begins at a byte.
pub(crate) fn aligned(area: Area, at: u32, bits: u32, write: bool) -> Result<(), Fault> {
    if bits > 1 && at & 7 != 0 {
        let kind = if write { FaultKind::AlignmentWrite } else { FaultKind::AlignmentRead };
        return Err(Fault::at(kind, area, bits, at / 8));
    }
    Ok(())
}

/// `bits` bits at `at` of an area.
pub(crate) fn in_area(area: Area, at: u32, bits: u32, write: bool, r: &Regs, m: &Machine) -> Result<Where, Fault> {
    let range = match area {
        Area::Input => m.memory.inputs,
        Area::Output => m.memory.outputs,
        Area::Memory => m.memory.memory,
        Area::Local => Range { at: r.local, len: r.local_len },
        Area::PreviousLocal => Range { at: r.previous_local, len: r.previous_local_len },
        Area::Db => return in_db(r.db, DbRegister::Db, at, bits, write),
        Area::Di => return in_db(r.di, DbRegister::Di, at, bits, write),
        Area::Peripheral => return Ok(Where::Peripheral(BitAddr(at))),
    };
    match range.locate(at / 8, bits.div_ceil(8)) {
        Some(byte) => Ok(Where::Arena(byte.bit(at % 8))),
        None if area == Area::PreviousLocal => beyond(at, bits, r, m).ok_or_else(|| outside(area, at, bits, write)),
        None => Err(outside(area, at, bits, write)),
    }
}

/// The place in area V beyond the caller's local data: what calls and the block itself have copied.
fn beyond(at: u32, bits: u32, r: &Regs, m: &Machine) -> Option<Where> {
    let (range, from) = match at / 8 {
        OWN_LOCAL.. => (Range { at: r.local, len: r.local_len }, OWN_LOCAL),
        _ => (m.memory.scratch, COPIES),
    };
    let byte = range.locate((at / 8).checked_sub(from)?, bits.div_ceil(8))?;
    Some(Where::Arena(byte.bit(at % 8)))
}

/// The pointer, in area V, to what a block has put at `at` of its own local data for `L P##name`.
pub(crate) fn own_copy(at: BitAddr) -> u32 {
    let (area, at) = if at.byte() < 0x1_0000 - OWN_LOCAL {
        (Area::PreviousLocal, at.0 + OWN_LOCAL * 8)
    } else {
        (Area::Local, at.0)
    };
    u32::from(area.pointer_code()) << 24 | at
}

#[cold]
fn outside(area: Area, at: u32, bits: u32, write: bool) -> Fault {
    let kind = if write { FaultKind::AreaLengthWrite } else { FaultKind::AreaLengthRead };
    Fault::at(kind, area, bits, at / 8)
}

/// `bits` bits at `at` of the data block in a register.
pub(crate) fn in_db(db: Db, register: DbRegister, at: u32, bits: u32, write: bool) -> Result<Where, Fault> {
    let Some(byte) = db.range().locate(at / 8, bits.div_ceil(8)) else {
        let area = match register {
            DbRegister::Db => Area::Db,
            DbRegister::Di => Area::Di,
        };
        return Err(outside(area, at, bits, write));
    };
    // An instance without any data has nothing to protect.
    if write && db.writable == 0 && bits > 0 {
        return Err(Fault::new(
            match register {
                DbRegister::Db => FaultKind::WriteProtectedDb,
                DbRegister::Di => FaultKind::WriteProtectedDi,
            },
            u32::from(db.number),
        ));
    }
    Ok(Where::Arena(byte.bit(at % 8)))
}

/// The data block `AUF DB/DI number` opens.
pub(crate) fn open(m: &Machine, number: u16, register: DbRegister) -> Result<Db, Fault> {
    if number == 0 {
        let kind = match register {
            DbRegister::Db => FaultKind::DbNumber,
            DbRegister::Di => FaultKind::DiNumber,
        };
        return Err(Fault::new(kind, 0));
    }
    m.memory.db(number).ok_or(Fault::new(FaultKind::DbNotLoaded, u32::from(number)))
}

fn read_pointer(pointer: Pointer, bits: u8, r: &Regs, m: &Machine) -> Result<u32, Fault> {
    match in_area(pointer.area, pointer.at.0, u32::from(bits), false, r, m)? {
        Where::Arena(at) => Ok(m.memory.read_bits(at, bits)),
        Where::Peripheral(at) => Err(outside(pointer.area, at.0, u32::from(bits), false)),
    }
}

/// The number of a timer, counter or block.
pub(crate) fn number(number: Number, r: &Regs, m: &Machine) -> Result<u16, Fault> {
    match number {
        Number::Fixed(n) => Ok(n),
        Number::Memory(pointer) => read_pointer(pointer, 16, r, m).map(|n| n as u16),
        Number::Param(index) => Ok(reference(index, r, m) as u16),
        Number::Instance(BitAddr(at)) => {
            match in_db(r.di, DbRegister::Di, (r.ar2 & POINTER_BITS).wrapping_add(at), 16, false)? {
                Where::Arena(at) => Ok(m.memory.read_bits(at, 16) as u16),
                Where::Peripheral(_) => Ok(0),
            }
        }
    }
}

/// Reads up to 32 bits of an operand.
pub(crate) fn read(place: Place, bits: u8, r: &mut Regs, m: &mut Machine) -> Result<u32, Fault> {
    match locate(place, u32::from(bits), false, r, m)? {
        Where::Arena(at) => Ok(m.memory.read_bits(at, bits)),
        Where::Peripheral(at) => read_peripheral(m, at, bits),
    }
}

/// Writes up to 32 bits of an operand.
pub(crate) fn write(place: Place, bits: u8, value: u32, r: &mut Regs, m: &mut Machine) -> Result<(), Fault> {
    match locate(place, u32::from(bits), true, r, m)? {
        Where::Arena(at) => {
            m.memory.write_bits(at, bits, value);
            Ok(())
        }
        Where::Peripheral(at) => write_peripheral(m, at, bits, value),
    }
}

fn read_peripheral(m: &mut Machine, at: BitAddr, bits: u8) -> Result<u32, Fault> {
    let mut bytes = [0; 4];
    let len = usize::from(bits.div_ceil(8));
    m.io_read(at.byte(), &mut bytes[4 - len..]).map_err(|_| peripheral(FaultKind::PeripheralRead, at, bits))?;
    let value = u32::from_be_bytes(bytes);
    Ok(if bits == 1 { value >> at.bit() & 1 } else { value })
}

fn write_peripheral(m: &mut Machine, at: BitAddr, bits: u8, value: u32) -> Result<(), Fault> {
    if bits == 1 {
        // There are no peripheral bits.
        return Err(peripheral(FaultKind::PeripheralWrite, at, bits));
    }
    let len = usize::from(bits / 8);
    let from = &value.to_be_bytes()[4 - len..];
    m.io_write(at.byte(), from).map_err(|_| peripheral(FaultKind::PeripheralWrite, at, bits))
}

fn peripheral(kind: FaultKind, at: BitAddr, bits: u8) -> Fault {
    Fault::at(kind, Area::Peripheral, u32::from(bits), at.byte())
}

/// The block kinds' "not loaded" and number faults.
pub(crate) fn missing(kind: BlockKind, number: u16) -> Fault {
    let fault = match kind {
        BlockKind::Fb => FaultKind::FbNotLoaded,
        BlockKind::Sfc => FaultKind::SfcNotLoaded,
        BlockKind::Sfb => FaultKind::SfbNotLoaded,
        BlockKind::Db | BlockKind::Sdb => FaultKind::DbNotLoaded,
        BlockKind::Fc | BlockKind::Ob => FaultKind::FcNotLoaded,
    };
    Fault::new(fault, u32::from(number))
}
