//! Operations with a number in the statement: shifts, counts, additions, word logic with a constant.

use ob1_ir::{NumberFormat, Op, Shift, WordLogic};

use crate::bytes::{self, Bytes, Found, with_double, with_word};
use crate::statement::{Mc7Op, Statement};

/// First byte, shift, and the greatest count in the second byte.
const COUNTED: [(u8, Shift, u8); 6] = [
    (0x61, Shift::LeftWord, 15),
    (0x69, Shift::RightWord, 15),
    (0x29, Shift::LeftDWord, 32),
    (0x71, Shift::RightDInt, 32),
    (0x64, Shift::RotateLeft, 32),
    (0x74, Shift::RotateRight, 32),
];

/// The high nibble of word logic with a constant on page 68.
const LOGIC: [(u8, WordLogic); 3] = [(0x30, WordLogic::And), (0x40, WordLogic::Or), (0x50, WordLogic::Xor)];

/// `SRD n` has the second bytes C0 to E0 of page FE.
const SRD: u8 = 0xC0;

/// Reads a statement with a number in it.
pub(crate) fn read(b: &Bytes<'_>) -> Found {
    let (first, second) = (b.first(), b.second());
    if let Some((_, shift, most)) = COUNTED.iter().find(|(code, ..)| *code == first) {
        return if second <= *most { bytes::short(Op::Shift(*shift, Some(second))) } else { None };
    }
    match first {
        0xFE if (SRD..=SRD + 32).contains(&second) => bytes::short(Op::Shift(Shift::RightDWord, Some(second - SRD))),
        0x68 if second & 15 == 1 => bytes::short(Op::Shift(Shift::RightInt, Some(second >> 4))),
        0x68 => {
            let (_, logic) = LOGIC.iter().find(|(code, _)| *code == second & 0xF0)?;
            match second & 15 {
                4 => bytes::four(Op::WordLogic(*logic, Some(b.word()))),
                6 => bytes::six(Op::DWordLogic(*logic, Some(b.double()))),
                _ => None,
            }
        }
        0x58 if second == 0 => {
            bytes::four(Op::AddConst { format: NumberFormat::Int, value: i32::from(b.word() as i16) })
        }
        0x60 if second == 5 => bytes::six(Op::AddConst { format: NumberFormat::DInt, value: b.double() as i32 }),
        0x11 => bytes::short(Op::Increment(second)),
        0x19 => bytes::short(Op::Decrement(second)),
        0x10 => Some((Statement { op: Mc7Op::Build(second), long: false }, 2)),
        _ => None,
    }
}

/// Writes a statement with a number in it.
pub(crate) fn write(op: &Op) -> Option<Vec<u8>> {
    let logic_code = |logic: WordLogic| LOGIC.iter().find(|(_, l)| *l == logic).map(|(code, _)| *code);
    Some(match op {
        Op::Shift(Shift::RightDWord, Some(n)) if *n <= 32 => vec![0xFE, SRD + n],
        Op::Shift(Shift::RightInt, Some(n)) if *n <= 15 => vec![0x68, n << 4 | 1],
        Op::Shift(shift, Some(n)) => {
            let (code, ..) = COUNTED.iter().find(|(_, s, most)| s == shift && n <= most)?;
            vec![*code, *n]
        }
        Op::WordLogic(logic, Some(value)) => with_word(0x68, logic_code(*logic)? | 4, *value),
        Op::DWordLogic(logic, Some(value)) => with_double(0x68, logic_code(*logic)? | 6, *value),
        Op::AddConst { format: NumberFormat::Int, value } => with_word(0x58, 0, i16::try_from(*value).ok()? as u16),
        Op::AddConst { format: NumberFormat::DInt, value } => with_double(0x60, 5, *value as u32),
        Op::Increment(n) => vec![0x11, *n],
        Op::Decrement(n) => vec![0x19, *n],
        _ => return None,
    })
}
