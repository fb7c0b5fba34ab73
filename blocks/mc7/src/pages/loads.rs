//! Load and transfer: absolute, memory-indirect, register-indirect, on formal parameters; constants.

use ob1_ir::{Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr};

use super::operands::{
    area, area_code, offset, param_place, param_word, pointer, pointer_code, register, register_bit, whole_byte,
};
use crate::bytes::{self, Bytes, Found, with_double, with_word};
use crate::statement::{ConstForm, Mc7Op, Statement};

/// Codes 1 to 3 load a byte, word, double word; 5 to 7 transfer one.
fn coded(code: u8, place: Place) -> Option<Op> {
    let width = match code & 3 {
        1 => Width::Byte,
        2 => Width::Word,
        3 => Width::DWord,
        _ => return None,
    };
    let operand = Operand { width, place };
    Some(if code & 4 == 0 { Op::Load(operand) } else { Op::Transfer(operand) })
}

/// The code of a width; bits have none.
const fn width_code(width: Width) -> Option<u8> {
    match width {
        Width::Bit => None,
        Width::Byte => Some(1),
        Width::Word => Some(2),
        Width::DWord => Some(3),
    }
}

/// The short form: M up to byte 255, E and A up to 127.
fn short(load: bool, operand: Operand) -> Option<[u8; 2]> {
    let Place::Fixed(area, at) = operand.place else { return None };
    let byte = u8::try_from(whole_byte(at)?).ok()?;
    let width = width_code(operand.width)? - 1;
    let (base, byte) = match area {
        Area::Memory => (0x0A, byte),
        Area::Input if byte < 0x80 => (0x4A, byte),
        Area::Output if byte < 0x80 => (0x4A, byte | 0x80),
        _ => return None,
    };
    Some([base + 8 * width + u8::from(!load), byte])
}

/// Reads `L` and `T` of places and constants.
pub(crate) fn read(b: &Bytes<'_>) -> Found {
    let (first, second) = (b.first(), b.second());
    let at = |byte: u8| BitAddr::byte_addr(u32::from(byte));
    let four = |op: Option<Op>| bytes::four(op?);
    match first {
        0x0A | 0x12 | 0x1A | 0x0B | 0x13 | 0x1B => {
            let code = ((first - 0x0A) / 8 + 1) | (first & 1) << 2;
            bytes::short(coded(code, Place::Fixed(Area::Memory, at(second)))?)
        }
        0x4A | 0x52 | 0x5A | 0x4B | 0x53 | 0x5B => {
            let code = ((first - 0x4A) / 8 + 1) | (first & 1) << 2;
            let area = if second < 0x80 { Area::Input } else { Area::Output };
            bytes::short(coded(code, Place::Fixed(area, at(second & 0x7F)))?)
        }
        0x7E => {
            let place = Place::Fixed(area(second >> 4)?, BitAddr::byte_addr(u32::from(b.word())));
            let op = coded(second & 15, place).filter(|_| second & 8 == 0)?;
            let fits = plain(&op).is_some_and(|(load, operand)| short(load, operand).is_some());
            bytes::long(op, fits)
        }
        0xBA | 0xBB => {
            let transfer = (second >> 7) << 2;
            let width = match (first, second & 8) {
                (0xBA, 0) => 1,
                (0xBB, 0) => 2,
                (0xBB, _) => 3,
                _ => return None,
            };
            let place = Place::Memory(area(second & 7)?, pointer(second >> 4 & 7, b.word())?);
            four(coded(width | transfer, place))
        }
        0xBE => {
            let place = Place::Register(Some(area(second >> 4)?), register(second), BitAddr(u32::from(b.word())));
            four(coded(second & 7, place))
        }
        0xFB if second < 0x10 => {
            four(coded(second & 7, Place::Register(None, register(second), BitAddr(u32::from(b.word())))))
        }
        0xFB if second & 0xF8 == 0xC0 => four(coded(second & 7, param_place(b.word())?)),
        0x28 => constant(ConstForm::Byte, u32::from(second), 2),
        0x30 => constant(ConstForm::Word(second), u32::from(b.word()), 4),
        0x38 => constant(ConstForm::DWord(second), b.double(), 6),
        _ => None,
    }
}

fn constant(form: ConstForm, value: u32, length: usize) -> Found {
    Some((Statement { op: Mc7Op::Constant(form, value), long: false }, length))
}

/// `L` (true) or `T`, and the operand.
const fn plain(op: &Op) -> Option<(bool, Operand)> {
    match op {
        Op::Load(operand) => Some((true, *operand)),
        Op::Transfer(operand) => Some((false, *operand)),
        _ => None,
    }
}

/// Writes `L` and `T` of places.
pub(crate) fn write(op: &Op, long: bool) -> Option<Vec<u8>> {
    let (load, operand) = plain(op)?;
    if !long && let Some(bytes) = short(load, operand) {
        return Some(bytes.to_vec());
    }
    let width = width_code(operand.width)?;
    let code = width | u8::from(!load) << 2;
    Some(match operand.place {
        Place::Fixed(area, at) => with_word(0x7E, area_code(area)? << 4 | code, whole_byte(at)?),
        Place::Memory(area, at) => {
            let (place, word) = pointer_code(at)?;
            let second = u8::from(!load) << 7 | place << 4 | u8::from(width == 3) << 3 | area_code(area)?;
            with_word(if width == 1 { 0xBA } else { 0xBB }, second, word)
        }
        Place::Register(Some(area), r, at) => {
            with_word(0xBE, area_code(area)? << 4 | register_bit(r) | code, offset(at)?)
        }
        Place::Register(None, r, at) => with_word(0xFB, register_bit(r) | code, offset(at)?),
        Place::Param { index, at: BitAddr(0) } => with_word(0xFB, 0xC0 | code, param_word(index)?),
        _ => return None,
    })
}

/// Writes `L` of a constant; `None` where the value is wider than the form.
pub(crate) fn write_constant(form: ConstForm, value: u32) -> Option<Vec<u8>> {
    Some(match form {
        ConstForm::Byte => vec![0x28, u8::try_from(value).ok()?],
        ConstForm::Word(sub) => with_word(0x30, sub, u16::try_from(value).ok()?),
        ConstForm::DWord(sub) => with_double(0x38, sub, value),
    })
}
