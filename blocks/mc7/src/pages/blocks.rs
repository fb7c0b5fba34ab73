//! Blocks: data blocks opened, calls with their lists of pointers, ends.

use ob1_ir::{DbRegister, Number, Op};
use ob1_model::BlockKind;

use super::operands::{param, param_number, param_word, pointer, pointer_code};
use crate::bytes::{self, Bytes, Found, with_word};
use crate::statement::{Mc7Op, Statement, Uncond};

/// The words that begin a list: a jump over it, then its length in words, these two included.
const LIST: u16 = 0x700B;

/// Calls of one page FB byte: `(second byte, kind, conditional)`.
const CALLS: [(u8, BlockKind, bool); 8] = [
    (0x70, BlockKind::Fc, false),
    (0x71, BlockKind::Fc, true),
    (0x72, BlockKind::Fb, false),
    (0x73, BlockKind::Fb, true),
    (0x74, BlockKind::Sfc, false),
    (0x75, BlockKind::Sfc, true),
    (0x76, BlockKind::Sfb, false),
    (0x77, BlockKind::Sfb, true),
];

/// Short calls: the first byte, kind of the block, and whether it is conditional.
const SHORT: [(u8, BlockKind, bool); 4] = [
    (0x3D, BlockKind::Fc, false),
    (0x1D, BlockKind::Fc, true),
    (0x75, BlockKind::Fb, false),
    (0x55, BlockKind::Fb, true),
];

/// Reads a statement about blocks.
pub(crate) fn read(b: &Bytes<'_>) -> Found {
    let (first, second) = (b.first(), b.second());
    let register = |code: u8| if code & 1 == 0 { DbRegister::Db } else { DbRegister::Di };
    if let Some((_, kind, conditional)) = SHORT.iter().find(|(code, ..)| *code == first) {
        return call(b, 2, *kind, *conditional, Number::Fixed(u16::from(second)), false);
    }
    let plain = |op| Some((Statement { op, long: false }, 2));
    match (first, second) {
        (0x20, n) => return bytes::short(Op::OpenDb(DbRegister::Db, Number::Fixed(u16::from(n)))),
        (0x65, 0x00) => return plain(Mc7Op::BlockEnd),
        (0x65, 0x01) => return plain(Mc7Op::End),
        (0xFB, 0x78 | 0x79) => {
            let fits = second == 0x78 && b.word() <= 0xFF;
            return bytes::long(Op::OpenDb(register(second), Number::Fixed(b.word())), fits);
        }
        (0xFB, 0xD8 | 0xD9) => return bytes::four(Op::OpenDb(register(second), param_number(b.word())?)),
        (0xFB, 0xD0) => return call(b, 4, BlockKind::Fc, false, param_number(b.word())?, false),
        (0xFB, 0xD2) => return call(b, 4, BlockKind::Fb, false, param_number(b.word())?, false),
        (0xFB, 0xCA | 0xCB) => {
            let op = Mc7Op::ParamPointer { index: param(b.word())?, other: second == 0xCA };
            return Some((Statement { op, long: false }, 4));
        }
        (0xFB, _) => {}
        _ => return None,
    }
    if let Some((_, kind, conditional)) = CALLS.iter().find(|(code, ..)| *code == second) {
        let fits = b.word() <= 0xFF && SHORT.iter().any(|(_, k, c)| (*k, *c) == (*kind, *conditional));
        return call(b, 4, *kind, *conditional, Number::Fixed(b.word()), fits);
    }
    let at = || pointer(second >> 4, b.word()).map(Number::Memory);
    match second & 15 {
        0 => call(b, 4, BlockKind::Fc, false, at()?, false),
        1 => call(b, 4, BlockKind::Fc, true, at()?, false),
        2 => call(b, 4, BlockKind::Fb, false, at()?, false),
        3 => call(b, 4, BlockKind::Fb, true, at()?, false),
        8 | 9 => bytes::four(Op::OpenDb(register(second), at()?)),
        _ => None,
    }
}

/// A call whose own bytes end at `length`, with its list.
fn call(b: &Bytes<'_>, length: usize, kind: BlockKind, conditional: bool, number: Number, long: bool) -> Found {
    let mut end = length;
    let mut list = None;
    if kind.is_function() {
        let words = usize::from(b.word_at(length + 2));
        let whole = b.0.len() >= length + 4;
        if whole && (b.word_at(length) != LIST || words < 2 || !words.is_multiple_of(2) || words > 0x7FFF) {
            return None;
        }
        end = if whole { length + 2 * words } else { length + 4 };
        // Nothing is allocated for a list that the code does not hold; by its length the caller sees that it does not.
        if b.0.len() < end {
            return Some((Statement { op: Mc7Op::BlockEnd, long: false }, end));
        }
        list = Some((length + 4..end).step_by(4).map(|at| b.double_at(at)).collect());
    }
    Some((Statement { op: Mc7Op::Call(Uncond { kind, number, conditional, list }), long }, end))
}

/// Writes a data block opened.
pub(crate) fn write(op: &Op, long: bool) -> Option<Vec<u8>> {
    let Op::OpenDb(register, number) = op else { return None };
    let di = u8::from(*register == DbRegister::Di);
    Some(match number {
        Number::Fixed(n) => match u8::try_from(*n) {
            Ok(n) if di == 0 && !long => vec![0x20, n],
            _ => with_word(0xFB, 0x78 | di, *n),
        },
        Number::Memory(at) => {
            let (place, word) = pointer_code(*at)?;
            with_word(0xFB, place << 4 | 8 | di, word)
        }
        Number::Param(index) => with_word(0xFB, 0xD8 | di, param_word(*index)?),
        Number::Instance(_) => return None,
    })
}

/// Writes a call with its list.
pub(crate) fn write_call(call: &Uncond, long: bool) -> Option<Vec<u8>> {
    let Uncond { kind, number, conditional, list } = call;
    let find = |table: &[(u8, BlockKind, bool)]| {
        table.iter().find(|(_, k, c)| (k, c) == (kind, conditional)).map(|(code, ..)| *code)
    };
    let mut bytes = match number {
        Number::Fixed(n) => match (u8::try_from(*n), find(&SHORT)) {
            (Ok(n), Some(code)) if !long => vec![code, n],
            _ => with_word(0xFB, find(&CALLS)?, *n),
        },
        other => {
            let fb = match kind {
                BlockKind::Fc => 0,
                BlockKind::Fb => 2,
                _ => return None,
            };
            match other {
                Number::Memory(at) => {
                    let (place, word) = pointer_code(*at)?;
                    with_word(0xFB, place << 4 | fb | u8::from(*conditional), word)
                }
                Number::Param(index) if !conditional => with_word(0xFB, 0xD0 | fb, param_word(*index)?),
                _ => return None,
            }
        }
    };
    if let Some(list) = list {
        let words = list.len().checked_mul(2)?.checked_add(2).filter(|w| *w <= 0x7FFF)?;
        bytes.extend_from_slice(&LIST.to_be_bytes());
        bytes.extend_from_slice(&(words as u16).to_be_bytes());
        list.iter().for_each(|pointer| bytes.extend_from_slice(&pointer.to_be_bytes()));
    }
    (list.is_some() == kind.is_function()).then_some(bytes)
}

/// Writes `L P##parameter`; `None`: the index is too high.
pub(crate) fn write_pointer(index: u16, other: bool) -> Option<Vec<u8>> {
    Some(with_word(0xFB, if other { 0xCA } else { 0xCB }, param_word(index)?))
}
