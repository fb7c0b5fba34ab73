//! Address registers: pointers and double words into and out of them, additions.

use ob1_ir::{Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr};

use super::operands::{offset, pointer, pointer_code, register, register_bit};
use crate::bytes::{self, Bytes, Found, with_double, with_word};

/// Reads a statement of page FE that has an operand.
pub(crate) fn read(b: &Bytes<'_>) -> Found {
    let second = b.second();
    if b.first() != 0xFE {
        return None;
    }
    let register = register(second);
    match second {
        0x03 | 0x0B => return bytes::six(Op::LoadArConst(register, b.double())),
        0x02 | 0x0A => return bytes::four(Op::AddArConst(register, BitAddr(u32::from(b.word())))),
        _ => {}
    }
    let at = pointer(second >> 4, b.word())?;
    let operand = Operand { width: Width::DWord, place: Place::Fixed(at.area, at.at) };
    match second & 7 {
        3 => bytes::four(Op::LoadArFrom(register, operand)),
        7 => bytes::four(Op::TransferArTo(register, operand)),
        _ => None,
    }
}

/// Writes such a statement.
pub(crate) fn write(op: &Op) -> Option<Vec<u8>> {
    let (register, operand, code) = match op {
        Op::LoadArConst(register, value) => return Some(with_double(0xFE, 3 | register_bit(*register), *value)),
        Op::AddArConst(register, at) => return Some(with_word(0xFE, 2 | register_bit(*register), offset(*at)?)),
        Op::LoadArFrom(register, operand) => (register, operand, 3),
        Op::TransferArTo(register, operand) => (register, operand, 7),
        _ => return None,
    };
    let Operand {
        width: Width::DWord,
        place: Place::Fixed(area @ (Area::Memory | Area::Db | Area::Di | Area::Local), at),
    } = *operand
    else {
        return None;
    };
    let (place, word) = pointer_code(ob1_ir::Pointer { area, at })?;
    Some(with_word(0xFE, place << 4 | register_bit(*register) | code, word))
}
