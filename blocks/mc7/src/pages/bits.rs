//! Bit logic: absolute, memory-indirect, register-indirect, and on formal parameters.

use ob1_ir::{BitTest, Logic, Op, Place};
use ob1_model::{Area, BitAddr};

use super::fixed::{SCANS, scan_code};
use super::operands::{
    area_code, bit_area, offset, param_place, param_word, pointer, pointer_code, register, register_bit,
};
use crate::bytes::{self, Bytes, Found, with_word};

/// A bit operation without its operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bit {
    Scan(Logic, bool),
    Set,
    Reset,
    Assign,
    Positive,
    Negative,
}

use Bit::{Assign, Negative, Positive, Reset, Scan, Set};

const U: Bit = Scan(Logic::And, false);
const UN: Bit = Scan(Logic::And, true);
const O: Bit = Scan(Logic::Or, false);
const ON: Bit = Scan(Logic::Or, true);
const X: Bit = Scan(Logic::Xor, false);
const XN: Bit = Scan(Logic::Xor, true);

/// Short forms: bits 3 to 5 of the first byte. M begins at 80h, E and A at C0h.
const SHORT: [Bit; 7] = [U, O, Set, Assign, UN, ON, Reset];

/// Long forms: first byte, operation, operation with 80h in the second byte.
const LONG: [(u8, Bit, Option<Bit>); 6] = [
    (0x00, U, Some(UN)),
    (0x01, O, Some(ON)),
    (0x05, X, Some(XN)),
    (0x09, Set, Some(Reset)),
    (0x41, Assign, None),
    (0x49, Positive, Some(Negative)),
];

/// Memory-indirect forms: first byte, then the operation as it stands, with 08h, with 80h, with both.
const MEMORY: [(u8, [Option<Bit>; 4]); 3] = [
    (0x51, [Some(U), Some(O), Some(UN), Some(ON)]),
    (0x58, [Some(X), Some(Set), Some(XN), Some(Reset)]),
    (0x59, [Some(Assign), Some(Positive), None, Some(Negative)]),
];

/// The low codes of the operations that are not scans, in the register-indirect and parameter forms.
const ACTIONS: [(u8, Bit); 5] = [(0, Set), (1, Reset), (2, Assign), (4, Positive), (5, Negative)];

fn action(code: u8) -> Option<Bit> {
    ACTIONS.iter().find(|(c, _)| *c == code).map(|(_, bit)| *bit)
}

fn scan(code: u8) -> Option<Bit> {
    SCANS.get(usize::from(code)).map(|(logic, negate)| Scan(*logic, *negate))
}

fn op(bit: Bit, place: Place) -> Op {
    match bit {
        Scan(logic, negate) => Op::Scan { logic, negate, test: BitTest::Bit(place) },
        Set => Op::Set(place),
        Reset => Op::Reset(place),
        Assign => Op::Assign(place),
        Positive => Op::EdgePositive(place),
        Negative => Op::EdgeNegative(place),
    }
}

fn parts(op: &Op) -> Option<(Bit, Place)> {
    Some(match op {
        Op::Scan { logic, negate, test: BitTest::Bit(place) } => (Scan(*logic, *negate), *place),
        Op::Set(place) => (Set, *place),
        Op::Reset(place) => (Reset, *place),
        Op::Assign(place) => (Assign, *place),
        Op::EdgePositive(place) => (Positive, *place),
        Op::EdgeNegative(place) => (Negative, *place),
        _ => return None,
    })
}

/// The short form of an operation: M up to byte 255, E and A up to 127; none of `X XN FP FN`.
fn short(bit: Bit, place: Place) -> Option<[u8; 2]> {
    let group = SHORT.iter().position(|s| *s == bit)? as u8;
    let Place::Fixed(area, at) = place else { return None };
    let byte = u8::try_from(at.byte()).ok()?;
    let (base, byte) = match area {
        Area::Memory => (0x80, byte),
        Area::Input if byte < 0x80 => (0xC0, byte),
        Area::Output if byte < 0x80 => (0xC0, byte | 0x80),
        _ => return None,
    };
    Some([base | group << 3 | at.bit(), byte])
}

/// Reads a bit statement.
pub(crate) fn read(b: &Bytes<'_>) -> Found {
    let (first, second) = (b.first(), b.second());
    let found = match first {
        0x80..=0xB7 => {
            let bit = *SHORT.get(usize::from(first >> 3 & 7))?;
            let at = BitAddr::new(u32::from(second), first & 7);
            return bytes::short(op(bit, Place::Fixed(Area::Memory, at)));
        }
        0xC0..=0xF7 => {
            let bit = *SHORT.get(usize::from(first >> 3 & 7))?;
            let area = if second < 0x80 { Area::Input } else { Area::Output };
            let at = BitAddr::new(u32::from(second & 0x7F), first & 7);
            return bytes::short(op(bit, Place::Fixed(area, at)));
        }
        0x00 | 0x01 | 0x05 | 0x09 | 0x41 | 0x49 => {
            let (_, plain, high) = LONG.iter().find(|(code, ..)| *code == first)?;
            let bit = if second & 0x80 == 0 { *plain } else { (*high)? };
            if second & 8 != 0 {
                return None;
            }
            let area = bit_area(second >> 4 & 7)?;
            let place = Place::Fixed(area, BitAddr::new(u32::from(b.word()), second & 7));
            return bytes::long(op(bit, place), short(bit, place).is_some());
        }
        0x51 | 0x58 | 0x59 => {
            let (_, bits) = MEMORY.iter().find(|(code, _)| *code == first)?;
            let bit = (*bits.get(usize::from(second >> 6 & 2 | second >> 3 & 1))?)?;
            op(bit, Place::Memory(bit_area(second & 7)?, pointer(second >> 4 & 7, b.word())?))
        }
        0x79 => {
            let bit = if second & 0x80 == 0 { scan(second & 7) } else { action(second & 7) }?;
            let area = bit_area(second >> 4 & 7)?;
            op(bit, Place::Register(Some(area), register(second), BitAddr(u32::from(b.word()))))
        }
        0xFB => {
            let bit = match second {
                0x10..=0x1F | 0x80..=0x87 => scan(second & 7),
                0x20..=0x2F | 0x90..=0x97 => action(second & 7),
                _ => None,
            }?;
            let place = if second & 0x80 == 0 {
                Place::Register(None, register(second), BitAddr(u32::from(b.word())))
            } else {
                param_place(b.word())?
            };
            op(bit, place)
        }
        _ => return None,
    };
    bytes::four(found)
}

/// Writes a bit statement.
pub(crate) fn write(op: &Op, long: bool) -> Option<Vec<u8>> {
    let (bit, place) = parts(op)?;
    if !long && let Some(bytes) = short(bit, place) {
        return Some(bytes.to_vec());
    }
    let low = match bit {
        Scan(logic, negate) => scan_code(logic, negate),
        other => ACTIONS.iter().find(|(_, b)| *b == other).map(|(code, _)| *code),
    }?;
    let is_scan = matches!(bit, Scan(..));
    let (first, second, word) = match place {
        Place::Fixed(area, at) => {
            let (first, plain, _) = LONG.iter().find(|(_, plain, high)| *plain == bit || *high == Some(bit))?;
            let high = if *plain == bit { 0 } else { 0x80 };
            let area = area_code(area).filter(|a| *a > 0)?;
            (*first, high | area << 4 | at.bit(), u16::try_from(at.byte()).ok()?)
        }
        Place::Memory(area, at) => {
            let found =
                MEMORY.iter().find_map(|(f, bits)| Some((*f, bits.iter().position(|b| *b == Some(bit))? as u8)));
            let (first, which) = found?;
            let (place, word) = pointer_code(at)?;
            let area = area_code(area).filter(|a| *a > 0)?;
            (first, (which & 2) << 6 | place << 4 | (which & 1) << 3 | area, word)
        }
        Place::Register(Some(area), r, at) => {
            let area = area_code(area).filter(|a| *a > 0)?;
            (0x79, u8::from(!is_scan) << 7 | area << 4 | register_bit(r) | low, offset(at)?)
        }
        Place::Register(None, r, at) => (0xFB, if is_scan { 0x10 } else { 0x20 } | register_bit(r) | low, offset(at)?),
        Place::Param { index, at: BitAddr(0) } => (0xFB, if is_scan { 0x80 } else { 0x90 } | low, param_word(index)?),
        _ => return None,
    };
    Some(with_word(first, second, word))
}
