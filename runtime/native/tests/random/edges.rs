//! Statements that only mean something together: operations with the values at the edges of what they take.

use ob1_ir::{
    AccuOp, AddressRegister, BitTest, Compare, Convert, DbRegister, Jump, Logic, MathFn, Number, NumberFormat, Op,
    Operand, Place, Pointer, Shift, StatusBit, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, TimerKind};

use super::Random;

/// REAL: 0, halves, the ends of DINT, denormalised numbers, infinity, NaN; each with both signs.
const REALS: &[u32] = &[
    0,
    0x3F00_0000,
    0x3FC0_0000,
    0x4020_0000,
    0x3EFF_FFFF,
    0x3F80_0000,
    0x4B00_0001,
    0x4EFF_FFFF,
    0x4F00_0000,
    0x4F00_0001,
    0x0000_0001,
    0x007F_FFFF,
    0x0080_0000,
    0x7F7F_FFFF,
    0x7F80_0000,
    0x7F80_0001,
    0x7FC0_0000,
    0x7FFF_FFFF,
];
/// INT and DINT at their ends, and valid and invalid BCD numbers.
const WHOLE: &[u32] = &[
    0,
    1,
    2,
    0xFFFF,
    0xFFFF_FFFF,
    0x7FFF,
    0x8000,
    0x8001,
    0xFFFF_8000,
    0x7FFF_FFFF,
    0x8000_0000,
    0x8000_0001,
    0x7FFF_8000,
    0x1_0000,
    0x0999,
    0xF999,
    0x00A0,
    0x0999_9999,
    0xF999_9999,
    0x0098_967F,
    0x0098_9680,
];
/// Where shifts end.
const COUNTS: &[u8] = &[0, 1, 8, 15, 16, 17, 31, 32, 33, 63, 64, 127, 128, 255];
/// Byte addresses at and beyond the ends of areas and data blocks.
const ADDRESSES: &[u32] = &[0, 5, 6, 31, 32, 63, 64, 124, 125, 127, 128, 252, 255, 256, 1023, 1024, 65_532, 65_535];
const AREAS: &[u32] = &[0x00, 0x80, 0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0xFF];

fn real(r: &mut Random) -> u32 {
    r.of(REALS) | r.next(2) << 31
}

/// A pointer to the end of an area, or beyond what an address can be.
pub(super) fn pointer(r: &mut Random) -> u32 {
    let address = match r.next(4) {
        0 => r.of(&[0x7_FFFF, 0x7_FFF8, 0x8_0000, 0xFF_FFFF, 0xFF_FFF8]),
        _ => r.of(ADDRESSES) * 8 + r.of(&[0, 0, 1, 7]),
    };
    r.of(AREAS) << 24 | address
}

/// A place that an address register leads to, mostly at an edge.
fn indirect(r: &mut Random, register: AddressRegister) -> Place {
    let areas = [Area::Input, Area::Output, Area::Memory, Area::Db, Area::Di, Area::Local, Area::Peripheral];
    let area = if r.one_in(2) { Some(r.of(&areas)) } else { None };
    let offset = if r.one_in(2) { r.of(&[0, 0, 8, 1]) } else { r.of(ADDRESSES) * 8 + r.of(&[0, 1, 7]) };
    Place::Register(area, register, BitAddr(offset))
}

fn counter(r: &mut Random) -> Number {
    if r.one_in(4) {
        Number::Memory(Pointer { area: r.of(&[Area::Local, Area::Db, Area::Di]), at: BitAddr::byte_addr(22) })
    } else {
        Number::Fixed(r.next(3) as u16)
    }
}

fn bit(r: &mut Random) -> Op {
    let place = Place::Fixed(Area::Memory, BitAddr(r.next(100)));
    Op::Scan { logic: r.of(&Logic::ALL), negate: r.one_in(2), test: BitTest::Bit(place) }
}

/// A few statements; jumps lead to one of `targets`.
pub(super) fn edge(r: &mut Random, targets: [u32; 2]) -> Vec<Op> {
    let c = Op::LoadConst;
    match r.next(16) {
        0 => vec![c(real(r)), Op::Convert(r.of(&[Convert::Rnd, Convert::RndPlus, Convert::RndMinus, Convert::Trunc]))],
        1 => vec![c(if r.one_in(3) { real(r) } else { r.of(WHOLE) }), Op::Convert(r.of(&Convert::ALL))],
        2 | 3 => {
            let format = r.of(&[NumberFormat::Int, NumberFormat::DInt]);
            let op = match format {
                NumberFormat::DInt => r.of(&AccuOp::ALL),
                _ => r.of(&[AccuOp::Add, AccuOp::Sub, AccuOp::Mul, AccuOp::Div]),
            };
            vec![c(r.of(WHOLE)), c(r.of(WHOLE)), Op::Arithmetic(format, op), Op::Jump(r.of(&Jump::ALL), targets[0])]
        }
        4 => {
            let op = r.of(&[AccuOp::Add, AccuOp::Sub, AccuOp::Mul, AccuOp::Div]);
            vec![c(real(r)), c(real(r)), Op::Arithmetic(NumberFormat::Real, op), Op::LoadStatus]
        }
        5 => {
            let format = r.of(&NumberFormat::ALL);
            let value = |r: &mut Random| if format == NumberFormat::Real { real(r) } else { r.of(WHOLE) };
            vec![c(value(r)), c(value(r)), Op::Compare(format, r.of(&Compare::ALL))]
        }
        6 => vec![c(real(r)), Op::Math(r.of(&[MathFn::Sqr, MathFn::Sqrt, MathFn::Ln, MathFn::Exp, MathFn::Tan]))],
        7 => {
            let index = r.of(&[0, 1, 2, 3, 255, 256, 257, 0xFF00]);
            let list = (0..r.next(4)).map(|i| targets[i as usize % 2]).collect();
            vec![c(index), Op::JumpList { targets: list, otherwise: targets[1] }]
        }
        8 => vec![c(r.of(&[0, 1, 2, 0x1_0000, 0x1_0001])), Op::Loop(targets[0])],
        9 => {
            let n = counter(r);
            let count = r.of(&[Op::CountUp as fn(Number) -> Op, Op::CountDown, Op::ResetCounter, Op::LoadCounter]);
            vec![
                c(r.of(&[0, 1, 0x998, 0x999, 0x99A, 0x1999])),
                Op::ClearRlo,
                bit(r),
                Op::SetCounter(n),
                count(n),
                Op::SetRlo,
                r.of(&[Op::CountUp as fn(Number) -> Op, Op::CountDown])(n),
            ]
        }
        10 => {
            let n = counter(r);
            let times = [0, 1, 0x0001, 0x0999, 0x1001, 0x1999, 0x2127, 0x3000, 0x3999, 0x4001, 0xFFFF, 0x000A, 0x0A00];
            let read = r.of(&[Op::LoadTimer as fn(Number) -> Op, Op::LoadTimerBcd]);
            vec![c(r.of(&times)), bit(r), Op::StartTimer(r.of(&TimerKind::ALL), n), read(n)]
        }
        11 => {
            let kind = r.of(&Shift::ALL);
            let count = r.of(COUNTS);
            let shift = Op::Shift(kind, if r.one_in(2) { Some(count) } else { None });
            vec![c(u32::from(count) | r.next(2) << 8), c(r.of(WHOLE)), shift, Op::LoadStatus]
        }
        12 | 13 => {
            let register = r.of(&[AddressRegister::Ar1, AddressRegister::Ar2]);
            let mut code = vec![Op::LoadArConst(register, pointer(r))];
            match r.next(4) {
                0 => code.push(Op::AddArConst(register, BitAddr(r.of(&[1, 7, 8, 0x7FFF, 0x8000, 0xFFF8, 0xFFFF])))),
                1 => code.extend([c(r.of(WHOLE)), Op::AddAr(register)]),
                _ => {}
            }
            let place = indirect(r, register);
            let operand = Operand { width: r.of(&[Width::Byte, Width::Word, Width::DWord]), place };
            code.push(match r.next(6) {
                0 => Op::Load(operand),
                1 => Op::Transfer(operand),
                2 => Op::Assign(place),
                3 => r.of(&[Op::Set as fn(Place) -> Op, Op::Reset, Op::EdgePositive, Op::EdgeNegative])(place),
                _ => Op::Scan { logic: r.of(&Logic::ALL), negate: r.one_in(2), test: BitTest::Bit(place) },
            });
            code
        }
        14 => {
            let which = r.of(&[DbRegister::Db, DbRegister::Di]);
            let number = r.of(&[0, 7, 9, 22, 50, 0xFFFF]);
            let read = r.of(&[Op::LoadDbLength as fn(DbRegister) -> Op, Op::LoadDbNumber]);
            let mut code = vec![Op::OpenDb(which, Number::Fixed(number)), read(which)];
            code.extend(r.one_in(2).then_some(Op::ExchangeDbs));
            code.push(read(r.of(&[DbRegister::Db, DbRegister::Di])));
            let area = r.of(&[Area::Db, Area::Di]);
            let at = BitAddr::byte_addr(r.of(ADDRESSES));
            code.push(Op::Load(Operand { width: Width::Word, place: Place::Fixed(area, at) }));
            code
        }
        // An OR is pending.
        _ => {
            let after = match r.next(8) {
                0 => Op::SetRlo,
                1 => Op::ClearRlo,
                2 => Op::SaveRlo,
                3 => Op::NotRlo,
                4 => Op::Jump(r.of(&Jump::ALL), targets[0]),
                5 => Op::DWordLogic(r.of(&WordLogic::ALL), None),
                6 => Op::Scan { logic: r.of(&Logic::ALL), negate: false, test: BitTest::Status(r.of(&StatusBit::ALL)) },
                _ => Op::LoadStatus,
            };
            vec![bit(r), Op::OrBranch, after, bit(r)]
        }
    }
}
