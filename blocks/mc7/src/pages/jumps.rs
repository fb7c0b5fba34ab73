//! Jumps: distances are signed words from the first byte of the jump itself.

use ob1_ir::Jump;

use crate::bytes::{Bytes, Found, with_word};
use crate::statement::{Mc7Op, Statement};

/// First word of each conditional and unconditional jump.
const JUMPS: [(u16, Jump); 16] = [
    (0x700B, Jump::Always),
    (0xFFF8, Jump::IfRlo),
    (0xFFB8, Jump::IfNotRlo),
    (0xFFD8, Jump::IfRloSaveBr),
    (0xFF98, Jump::IfNotRloSaveBr),
    (0xFFE8, Jump::IfBr),
    (0xFF78, Jump::IfNotBr),
    (0xFF18, Jump::IfOverflow),
    (0xFF08, Jump::IfStoredOverflow),
    (0xFF88, Jump::IfZero),
    (0xFF68, Jump::IfNotZero),
    (0xFF28, Jump::IfPositive),
    (0xFF48, Jump::IfNegative),
    (0xFFA8, Jump::IfNotNegative),
    (0xFFC8, Jump::IfNotPositive),
    (0xFF58, Jump::IfUnordered),
];

const LOOP: u16 = 0x7008;
const LIST: u16 = 0x7009;

/// Reads a jump, or one of the two statements that do nothing.
pub(crate) fn read(b: &Bytes<'_>) -> Found {
    let distance = b.word() as i16;
    let op = match b.head() {
        0x0000 => return Some((Statement { op: Mc7Op::Nop0, long: false }, 2)),
        0xFFFF => return Some((Statement { op: Mc7Op::Nop1, long: false }, 2)),
        LOOP => Mc7Op::Loop(distance),
        LIST => Mc7Op::JumpList(b.word()),
        head => Mc7Op::Jump(JUMPS.iter().find(|(code, _)| *code == head)?.1, distance),
    };
    Some((Statement { op, long: false }, 4))
}

/// Writes a jump, or one of the two statements that do nothing.
pub(crate) fn write(op: &Mc7Op) -> Option<Vec<u8>> {
    let (head, word) = match op {
        Mc7Op::Nop0 => return Some(vec![0, 0]),
        Mc7Op::Nop1 => return Some(vec![0xFF, 0xFF]),
        Mc7Op::Loop(distance) => (LOOP, *distance as u16),
        Mc7Op::JumpList(entries) => (LIST, *entries),
        Mc7Op::Jump(jump, distance) => (JUMPS.iter().find(|(_, j)| j == jump)?.0, *distance as u16),
        _ => return None,
    };
    let [first, second] = head.to_be_bytes();
    Some(with_word(first, second, word))
}
