//! Timers and counters, by number, indirect and as formal parameters.

use ob1_ir::{BitTest, Number, Op};
use ob1_model::TimerKind;

use super::fixed::{SCANS, scan_code};
use super::operands::{param_number, param_word, pointer, pointer_code};
use crate::bytes::{self, Bytes, Found, with_word};

/// Short forms: first byte, whether of a counter, and the code of the operation in the long form.
#[rustfmt::skip]
const SHORT: [(u8, bool, u8); 24] = [
    (0x02, false, 0x6), (0x0C, false, 0x9), (0x04, false, 0x8), (0x14, false, 0xA), (0x1C, false, 0xB),
    (0x24, false, 0xC), (0x2C, false, 0xD), (0x34, false, 0xE), (0x3C, false, 0xF),
    (0xF8, false, 0x0), (0xFC, false, 0x1), (0xF9, false, 0x2), (0xFD, false, 0x3),
    (0x42, true, 0x6), (0x4C, true, 0x9), (0x44, true, 0x8), (0x54, true, 0xA), (0x5C, true, 0xB), (0x6C, true, 0xD),
    (0x7C, true, 0xF), (0xB8, true, 0x0), (0xBC, true, 0x1), (0xB9, true, 0x2), (0xBD, true, 0x3),
];

/// The kinds of timers from code Ah on.
const KINDS: [TimerKind; 5] =
    [TimerKind::OffDelay, TimerKind::ExtendedPulse, TimerKind::OnDelay, TimerKind::RetentiveOnDelay, TimerKind::Pulse];

/// The operation of a code.
fn op(counter: bool, code: u8, n: Number) -> Option<Op> {
    if let Some((logic, negate)) = SCANS.get(usize::from(code)) {
        let test = if counter { BitTest::Counter(n) } else { BitTest::Timer(n) };
        return Some(Op::Scan { logic: *logic, negate: *negate, test });
    }
    Some(match (counter, code) {
        (false, 0x6) => Op::LoadTimer(n),
        (false, 0x8) => Op::EnableTimer(n),
        (false, 0x9) => Op::LoadTimerBcd(n),
        (false, 0xA..=0xE) => Op::StartTimer(*KINDS.get(usize::from(code - 0xA))?, n),
        (false, 0xF) => Op::ResetTimer(n),
        (true, 0x6) => Op::LoadCounter(n),
        (true, 0x8) => Op::EnableCounter(n),
        (true, 0x9) => Op::LoadCounterBcd(n),
        (true, 0xA) => Op::CountDown(n),
        (true, 0xB) => Op::SetCounter(n),
        (true, 0xD) => Op::CountUp(n),
        (true, 0xF) => Op::ResetCounter(n),
        _ => return None,
    })
}

/// Whether of a counter, the code, and the number.
fn parts(op: &Op) -> Option<(bool, u8, Number)> {
    Some(match op {
        Op::Scan { logic, negate, test: BitTest::Timer(n) } => (false, scan_code(*logic, *negate)?, *n),
        Op::Scan { logic, negate, test: BitTest::Counter(n) } => (true, scan_code(*logic, *negate)?, *n),
        Op::LoadTimer(n) => (false, 0x6, *n),
        Op::EnableTimer(n) => (false, 0x8, *n),
        Op::LoadTimerBcd(n) => (false, 0x9, *n),
        Op::StartTimer(kind, n) => (false, 0xA + KINDS.iter().position(|k| k == kind)? as u8, *n),
        Op::ResetTimer(n) => (false, 0xF, *n),
        Op::LoadCounter(n) => (true, 0x6, *n),
        Op::EnableCounter(n) => (true, 0x8, *n),
        Op::LoadCounterBcd(n) => (true, 0x9, *n),
        Op::CountDown(n) => (true, 0xA, *n),
        Op::SetCounter(n) => (true, 0xB, *n),
        Op::CountUp(n) => (true, 0xD, *n),
        Op::ResetCounter(n) => (true, 0xF, *n),
        _ => return None,
    })
}

fn short(counter: bool, code: u8, n: u16) -> Option<[u8; 2]> {
    let (first, ..) = SHORT.iter().find(|(_, c, o)| (*c, *o) == (counter, code))?;
    Some([*first, u8::try_from(n).ok()?])
}

/// Reads a statement of a timer or counter.
pub(crate) fn read(b: &Bytes<'_>) -> Found {
    let (first, second) = (b.first(), b.second());
    if let Some((_, counter, code)) = SHORT.iter().find(|(byte, ..)| *byte == first) {
        return bytes::short(op(*counter, *code, Number::Fixed(u16::from(second)))?);
    }
    let code = second & 15;
    let counter = second & 0x10 != 0;
    match (first, second >> 4) {
        (0xBF, high @ 3..=6) => bytes::four(op(false, code, Number::Memory(pointer(high, b.word())?))?),
        (0xBF, high @ 0xB..=0xE) => bytes::four(op(true, code, Number::Memory(pointer(high - 8, b.word())?))?),
        (0xFB, 0xA | 0xB) => bytes::four(op(counter, code, param_number(b.word())?)?),
        (0xFB, 0xE | 0xF) => {
            let n = b.word();
            bytes::long(op(counter, code, Number::Fixed(n))?, short(counter, code, n).is_some())
        }
        _ => None,
    }
}

/// Writes such a statement.
pub(crate) fn write(op: &Op, long: bool) -> Option<Vec<u8>> {
    let (counter, code, number) = parts(op)?;
    let which = u8::from(counter) << 4 | code;
    Some(match number {
        Number::Fixed(n) => match short(counter, code, n).filter(|_| !long) {
            Some(bytes) => bytes.to_vec(),
            None => with_word(0xFB, 0xE0 | which, n),
        },
        Number::Memory(at) => {
            let (place, word) = pointer_code(at)?;
            with_word(0xBF, (place + 8 * u8::from(counter)) << 4 | code, word)
        }
        Number::Param(index) => with_word(0xFB, 0xA0 | which, param_word(index)?),
        Number::Instance(_) => return None,
    })
}
