//! Result and status word of single statements, as tables from the STL reference. Each row runs on each engine, with
//! two accumulators and with four; the latter CPU shows the whole status word.

use ob1_cpu::engine::Factory;
use ob1_cpu::{Cpu, CpuConfig, Width};
use ob1_ir::{
    AccuOp, AddressRegister, BitTest, Compare, Convert, DbRegister, Jump, Logic, MathFn, NumberFormat, Op, Shift,
    StatusBit, WordLogic,
};
use ob1_model::FaultKind;

use crate::common::*;

const FC: u32 = 1;
const RLO: u32 = 2;
const STA: u32 = 4;
const OR: u32 = 8;
const OS: u32 = 16;
const OV: u32 = 32;
const CC0: u32 = 64;
const CC1: u32 = 128;
const BR: u32 = 256;

/// The place of the first statement given to [`run`]: its own come before.
const FIRST: u32 = 7;

/// Brings about /FC, STA and OR where `T STW` leaves them alone. OR without /FC is impossible.
fn first_bits(stw: u32) -> Vec<Op> {
    let (one, zero) = (scan(Logic::And, false, true), scan(Logic::And, false, false));
    match (stw & FC != 0, stw & STA != 0, stw & OR != 0) {
        (true, true, true) => vec![one, Op::OrBranch],
        (true, false, true) => vec![one, Op::OrBranch, zero],
        (true, true, false) => vec![one],
        (true, false, false) => vec![zero],
        (false, true, _) => vec![Op::SetRlo],
        (false, false, _) => vec![Op::ClearRlo],
    }
}

/// Runs `ops` with the given registers on each engine; ACCU1, ACCU2 and status word afterwards.
#[track_caller]
fn run(ops: &[Op], a1: u32, a2: u32, stw: u32, accumulators: u8) -> (u32, u32, u32) {
    let mut results = ENGINES.iter().map(|(name, engine)| (name, run_on(*engine, ops, a1, a2, stw, accumulators)));
    let (first, result) = results.next().expect("an engine");
    for (name, other) in results {
        assert_eq!(other, result, "{name} and {first}, {accumulators} accumulators: {ops:?}");
    }
    result
}

fn run_on(engine: &dyn Factory, ops: &[Op], a1: u32, a2: u32, stw: u32, accumulators: u8) -> (u32, u32, u32) {
    let mut code = if accumulators == 4 { Vec::new() } else { first_bits(stw) };
    code.resize(3, Op::Nop);
    code.extend([load(mw(2)), Op::TransferStatus, load(md(4)), load(md(8))]);
    code.extend_from_slice(ops);
    code.extend([transfer(md(12)), Op::ExchangeAccus, transfer(md(16)), Op::LoadStatus, transfer(mw(20))]);
    let program = program(vec![ob1(code)], Vec::new());
    let config = CpuConfig { accumulators, ..CpuConfig::default() };
    let cpu = Cpu::new(config, &program, Vec::new(), Vec::new(), engine);
    let mut bench = Bench::with(cpu.expect("loads"));
    // The start-up clears memory: a first cycle for it, a second with the values.
    bench.cycle();
    bench.set(2, Width::Word, stw);
    bench.set(4, Width::DWord, a2);
    bench.set(8, Width::DWord, a1);
    bench.set(100, Width::DWord, 0x0F00_0000);
    bench.run();
    (bench.md(12), bench.md(16), bench.mw(20))
}

/// One statement: what goes in, ACCU1 and status word out. ACCU2 must stay.
#[track_caller]
#[expect(clippy::needless_pass_by_value, reason = "tables read better")]
fn check(name: &str, op: Op, (a2, a1, stw): (u32, u32, u32), (out, stw_out): (u32, u32)) {
    for accumulators in [2, 4] {
        let mask = if accumulators == 4 { 0x1FF } else { 0x1F2 };
        let (got, got2, got_stw) = run(std::slice::from_ref(&op), a1, a2, stw, accumulators);
        let how = format!("{name} {a2:08X} {a1:08X} {stw:03X}, {accumulators} accumulators");
        assert_eq!((got, got_stw), (out, stw_out & mask), "{how}: {got:08X} {got_stw:03X}");
        if accumulators == 2 {
            assert_eq!(got2, a2, "{how}: ACCU2");
        }
    }
}

fn r(value: f32) -> u32 {
    value.to_bits()
}

#[test]
fn integer_arithmetic() {
    use AccuOp::{Add, Div, Mul, Sub};
    let all = OV | CC0 | CC1;
    for (op, a2, a1, out, stw) in [
        (Add, 1, 2, 3, CC1),
        (Add, 5, 0xFFFB, 0, 0),
        (Add, 0x7FFF, 1, 0x8000, CC0 | OV | OS),
        (Add, 0x8000, 0xFFFF, 0x7FFF, CC1 | OV | OS),
        (Add, 0x8000, 0x8000, 0, OV | OS),
        (Add, 0xAAAA_0001, 0xBBBB_0002, 0xBBBB_0003, CC1),
        (Sub, 3, 5, 0xFFFE, CC0),
        (Sub, 0x8000, 1, 0x7FFF, CC1 | OV | OS),
        (Mul, 300, 200, 60_000, CC1 | OV | OS),
        (Mul, 0xFFFF, 7, 0xFFFF_FFF9, CC0),
        (Mul, 0xFED4, 200, 0xFFFF_15A0, CC0 | OV | OS),
        (Mul, 0, 7, 0, 0),
        (Div, 17, 5, 0x0002_0003, CC1),
        (Div, 0xFFEF, 5, 0xFFFE_FFFD, CC0),
        (Div, 3, 5, 0x0003_0000, 0),
        (Div, 0x8000, 0xFFFF, 0x0000_8000, CC1 | OV | OS),
        (Div, 17, 0, 0, CC1 | CC0 | OV | OS),
    ] {
        check("I", Op::Arithmetic(NumberFormat::Int, op), (a2, a1, 0), (out, stw));
        // What was set before is cleared, except OS, BR, RLO.
        let before = all | OS | BR | RLO;
        check("I", Op::Arithmetic(NumberFormat::Int, op), (a2, a1, before), (out, stw | OS | BR | RLO));
    }
}

#[test]
fn double_integer_arithmetic() {
    use AccuOp::{Add, Div, Mod, Mul, Sub};
    for (op, a2, a1, out, stw) in [
        (Add, 0x7FFF_FFFF, 1, 0x8000_0000, CC0 | OV | OS),
        (Add, 0x8000_0000, 0x8000_0000, 0, OV | OS),
        (Sub, 10, 10, 0, 0),
        (Sub, 0x8000_0000, 1, 0x7FFF_FFFF, CC1 | OV | OS),
        (Mul, 100_000, 100_000, 1_410_065_408, CC1 | OV | OS),
        (Mul, 3, 0xFFFF_FFFF, 0xFFFF_FFFD, CC0),
        (Div, 17, 0xFFFF_FFFB, 0xFFFF_FFFD, CC0),
        (Div, 0x8000_0000, 0xFFFF_FFFF, 0x8000_0000, CC1 | OV | OS),
        (Div, 5, 0, 0, CC1 | CC0 | OV | OS),
        (Mod, 0xFFFF_FFEF, 5, 0xFFFF_FFFE, CC0),
        (Mod, 15, 5, 0, 0),
        (Mod, 0xFFFF_FFEF, 0xFFFF_FFFB, 0xFFFF_FFFE, CC0),
        (Mod, 17, 0xFFFF_FFFB, 2, CC1),
        (Mod, 0x8000_0000, 0x7FFF_FFFF, 0xFFFF_FFFF, CC0),
        (Div, 0x8000_0000, 1, 0x8000_0000, CC0),
        (Div, 4, 5, 0, 0),
        (Mod, 0x8000_0000, 0xFFFF_FFFF, 0, 0),
        (Mod, 15, 0, 0, CC1 | CC0 | OV | OS),
    ] {
        check("D", Op::Arithmetic(NumberFormat::DInt, op), (a2, a1, 0), (out, stw));
    }
}

#[test]
fn real_arithmetic() {
    use AccuOp::{Add, Div, Mul, Sub};
    let (inf, tiny) = (f32::INFINITY, f32::MIN_POSITIVE);
    for (op, a2, a1, out, stw) in [
        (Add, 1.5, 2.0, 3.5, CC1),
        (Sub, 1.5, 2.0, -0.5, CC0),
        (Sub, 2.0, 2.0, 0.0, 0),
        (Mul, f32::MAX, 2.0, inf, CC1 | OV | OS),
        (Mul, f32::MAX, -2.0, -inf, CC0 | OV | OS),
        (Mul, tiny, 0.5, tiny * 0.5, OV | OS),
        (Div, 1.0, 4.0, 0.25, CC1),
        (Div, 1.0, 0.0, inf, CC1 | OV | OS),
    ] {
        check("R", Op::Arithmetic(NumberFormat::Real, op), (r(a2), r(a1), 0), (r(out), stw));
    }
    // NaN: always the same one, whatever the processor makes.
    check("R", Op::Arithmetic(NumberFormat::Real, Div), (0, 0, 0), (0x7FFF_FFFF, CC1 | CC0 | OV | OS));
}

#[test]
fn comparisons() {
    use Compare::{Equal, Greater, GreaterEqual, Less, LessEqual, NotEqual};
    let yes = RLO | STA | FC;
    for (format, a2, a1, less, equal) in [
        (NumberFormat::Int, 0xFFFF, 1, true, false),
        (NumberFormat::Int, 0x0001_0005, 5, false, true),
        (NumberFormat::Int, 7, 5, false, false),
        (NumberFormat::DInt, 0x8000_0000, 1, true, false),
        (NumberFormat::DInt, 9, 9, false, true),
        (NumberFormat::Real, r(-1.0), r(1.0), true, false),
        (NumberFormat::Real, r(0.0), r(-0.0), false, true),
        (NumberFormat::Real, r(2.0), r(1.0), false, false),
    ] {
        let cc = if less {
            CC0
        } else if equal {
            0
        } else {
            CC1
        };
        for (compare, holds) in [
            (Equal, equal),
            (NotEqual, !equal),
            (Greater, !less && !equal),
            (Less, less),
            (GreaterEqual, !less),
            (LessEqual, less || equal),
        ] {
            let stw = cc | if holds { yes } else { FC };
            // OR and OV are cleared, OS stays.
            check("compare", Op::Compare(format, compare), (a2, a1, OR | OV | OS), (a1, stw | OS));
        }
    }
    let nan = r(f32::NAN);
    check("compare", Op::Compare(NumberFormat::Real, Equal), (nan, nan, RLO), (nan, CC1 | CC0 | OV | OS | FC));
}

#[test]
fn word_logic() {
    use WordLogic::{And, Or, Xor};
    for (op, a2, a1, out, stw) in [
        (Op::WordLogic(And, None), 0xFFFF_0FF0, 0xAAAA_3CC3, 0xAAAA_0CC0, CC1),
        (Op::WordLogic(And, None), 0xFF00, 0xAAAA_00FF, 0xAAAA_0000, 0),
        (Op::WordLogic(Or, Some(0x8000)), 0, 1, 0x8001, CC1),
        (Op::WordLogic(Xor, Some(0x1234)), 0, 0x1234, 0, 0),
        (Op::DWordLogic(And, None), 0xF0F0_F0F0, 0xFFFF_0000, 0xF0F0_0000, CC1),
        (Op::DWordLogic(Or, Some(1)), 0, 0, 1, CC1),
        (Op::DWordLogic(Xor, None), 5, 5, 0, 0),
    ] {
        check("word logic", op, (a2, a1, CC0 | OV | OS), (out, stw | OS));
    }
}

#[test]
fn shifts() {
    use Shift::{LeftDWord, LeftWord, RightDInt, RightDWord, RightInt, RightWord, RotateLeft, RotateRight};
    for (kind, n, a1, out, stw) in [
        (LeftWord, 1, 0xABCD_8001, 0xABCD_0002, CC1),
        (LeftWord, 16, 0xABCD_0001, 0xABCD_0000, CC1),
        (LeftWord, 17, 0xABCD_FFFF, 0xABCD_0000, 0),
        (RightWord, 4, 0xABCD_8008, 0xABCD_0800, CC1),
        (RightWord, 200, 0xABCD_FFFF, 0xABCD_0000, 0),
        (RightInt, 4, 0xABCD_8000, 0xABCD_F800, 0),
        (RightInt, 99, 0xABCD_8000, 0xABCD_FFFF, CC1),
        (RightInt, 99, 0xABCD_7000, 0xABCD_0000, 0),
        (LeftDWord, 32, 1, 0, CC1),
        (LeftDWord, 33, 0xFFFF_FFFF, 0, 0),
        (RightDWord, 1, 3, 1, CC1),
        (RightDInt, 8, 0x8000_0080, 0xFF80_0000, CC1),
        (RightDInt, 255, 0x8000_0000, 0xFFFF_FFFF, CC1),
        (RotateLeft, 4, 0xF000_0001, 0x0000_001F, CC1),
        (RotateLeft, 32, 0x8000_0001, 0x8000_0001, CC1),
        (RotateRight, 1, 1, 0x8000_0000, CC1),
        (RotateRight, 33, 2, 1, 0),
    ] {
        check("shift", Op::Shift(kind, Some(n)), (0, a1, CC0 | OV), (out, stw));
        check("shift by ACCU2", Op::Shift(kind, None), (0xFF00 | u32::from(n), a1, CC0 | OV), (out, stw));
    }
    check("shift by 0", Op::Shift(LeftWord, Some(0)), (0, 7, CC0 | OV), (7, CC0 | OV));
    check("RLDA", Op::RotateLeftCc1, (0, 0x8000_0000, CC0), (0, CC1));
    check("RLDA", Op::RotateLeftCc1, (0, 1, CC1), (3, 0));
    check("RRDA", Op::RotateRightCc1, (0, 2, CC1), (0x8000_0001, 0));
}

#[test]
fn conversions() {
    use Convert::*;
    let keep = RLO | CC1 | CC0 | BR;
    for (kind, a1, out, stw) in [
        (Bti, 0xABCD_0915, 0xABCD_0393, keep),
        (Bti, 0xABCD_F915, 0xABCD_FC6D, keep),
        (Btd, 0x0015_7821, 157_821, keep),
        (Btd, 0x8000_0010, 0xFFFF_FFF6, keep),
        (Itb, 0xABCD_0393, 0xABCD_0915, keep),
        (Itb, 0xFE63, 0xF413, keep),
        (Itb, 1000, 1000, keep | OV | OS),
        (Dtb, 0xFFFF_FD66, 0xF000_0666, keep),
        (Dtb, 10_000_000, 10_000_000, keep | OV | OS),
        (Itd, 0xABCD_FFF6, 0xFFFF_FFF6, keep),
        (Dtr, 500, r(500.0), keep),
        (Dtr, 0x7FFF_FFFF, r(2_147_483_648.0), keep),
        (Rnd, r(2.5), 2, keep),
        (Rnd, r(3.5), 4, keep),
        (Rnd, r(-2.5), 0xFFFF_FFFE, keep),
        (RndPlus, r(100.1), 101, keep),
        (RndMinus, r(-100.1), 0xFFFF_FF9B, keep),
        (Trunc, r(-1.9), 0xFFFF_FFFF, keep),
        (Rnd, r(0.5), 0, keep),
        (Rnd, r(-0.5), 0, keep),
        (Rnd, r(-1.5), 0xFFFF_FFFE, keep),
        (Rnd, r(-0.0), 0, keep),
        (RndPlus, r(0.5), 1, keep),
        (RndPlus, r(-0.5), 0, keep),
        (RndMinus, r(-0.5), 0xFFFF_FFFF, keep),
        (Trunc, r(1e-40), 0, keep),
        (Rnd, r(3e9), r(3e9), keep | OV | OS),
        // The last that are DINT, and the first that are not.
        (Rnd, r(2_147_483_520.0), 0x7FFF_FF80, keep),
        (RndPlus, r(2_147_483_648.0), r(2_147_483_648.0), keep | OV | OS),
        (Trunc, r(-2_147_483_648.0), 0x8000_0000, keep),
        (RndMinus, r(-2_147_483_904.0), r(-2_147_483_904.0), keep | OV | OS),
        (Rnd, r(f32::INFINITY), r(f32::INFINITY), keep | OV | OS),
        (RndMinus, r(f32::NEG_INFINITY), r(f32::NEG_INFINITY), keep | OV | OS),
        (Rnd, 0x7FFF_FFFF, 0x7FFF_FFFF, keep | OV | OS),
        (Trunc, 0xFF80_0001, 0xFF80_0001, keep | OV | OS),
        (Invi, 0xABCD_00FF, 0xABCD_FF00, keep),
        (Invd, 0, 0xFFFF_FFFF, keep),
        (Negr, r(1.5), r(-1.5), keep),
        (Abs, r(-1.5), r(1.5), keep),
        (Taw, 0x1234_5678, 0x1234_7856, keep),
        (Tad, 0x1234_5678, 0x7856_3412, keep),
        (Negi, 5, 0xFFFB, RLO | BR | CC0),
        (Negi, 0x8000, 0x8000, RLO | BR | CC0 | OV | OS),
        (Negi, 0, 0, RLO | BR),
        (Negd, 0xFFFF_FFFF, 1, RLO | BR | CC1),
        (Negd, 0x8000_0000, 0x8000_0000, RLO | BR | CC0 | OV | OS),
    ] {
        check(&format!("{kind:?}"), Op::Convert(kind), (77, a1, keep), (out, stw));
    }
}

#[test]
fn floating_point_functions() {
    for (function, a1, out, stw) in [
        (MathFn::Sqr, 3.0, 9.0, CC1),
        (MathFn::Sqrt, 2.25, 1.5, CC1),
        (MathFn::Ln, 1.0, 0.0, 0),
        (MathFn::Exp, 0.0, 1.0, CC1),
        (MathFn::Sin, 0.0, 0.0, 0),
        (MathFn::Cos, 0.0, 1.0, CC1),
        (MathFn::Atan, -1.0, -std::f32::consts::FRAC_PI_4, CC0),
        (MathFn::Asin, 1.0, std::f32::consts::FRAC_PI_2, CC1),
        (MathFn::Acos, 1.0, 0.0, 0),
        (MathFn::Exp, 1000.0, f32::INFINITY, CC1 | OV | OS),
    ] {
        check(&format!("{function:?}"), Op::Math(function), (7, r(a1), 0), (r(out), stw));
    }
    check("SQRT", Op::Math(MathFn::Sqrt), (7, r(-1.0), 0), (0x7FFF_FFFF, CC1 | CC0 | OV | OS));
}

#[test]
fn accumulators() {
    for (ops, accumulators, a1, a2) in [
        (vec![Op::ExchangeAccus], 2, 2, 1),
        (vec![Op::Push], 2, 1, 1),
        (vec![Op::Pop], 2, 2, 2),
        (vec![c(9), Op::Pop], 2, 1, 1),
        (vec![Op::Increment(255)], 2, 0, 2),
        (vec![Op::Decrement(2)], 2, 0xFF, 2),
        (vec![c(0x1_0000), Op::AddConst { format: NumberFormat::Int, value: -1 }], 2, 0x1_FFFF, 1),
        (vec![Op::AddConst { format: NumberFormat::DInt, value: -2 }], 2, 0xFFFF_FFFF, 2),
        (vec![Op::Enter, c(5), c(6), Op::Leave], 4, 6, 2),
        (vec![Op::Push, Op::Push, c(8), Op::Arithmetic(NumberFormat::Int, AccuOp::Add)], 4, 9, 1),
        (vec![Op::Enter, Op::Push, Op::Pop, Op::Pop], 4, 2, 2),
    ] {
        let (got1, got2, _) = run(&ops, 1, 2, 0, accumulators);
        assert_eq!((got1, got2), (a1, a2), "{ops:?}");
    }
}

/// RLO after a chain over the bits of MB 100 = 0Fh, and the whole status word.
#[track_caller]
fn chain(ops: &[Op], before: u32, stw: u32) {
    for accumulators in [2, 4] {
        let mask = if accumulators == 4 { 0x1FF } else { 0x1F2 };
        let got = run(ops, 0, 0, before, accumulators).2;
        assert_eq!(got, stw & mask, "{ops:?} after {before:03X}: {got:03X}, {accumulators}");
    }
}

fn scan(logic: Logic, negate: bool, one: bool) -> Op {
    // M 100.0 is 1, M 100.4 is 0.
    Op::Scan { logic, negate, test: BitTest::Bit(m(100, if one { 0 } else { 4 })) }
}

#[test]
fn scans_and_their_status() {
    use Logic::{And, Or, Xor};
    for (logic, negate, before, bit, rlo) in [
        // First scan: the RLO is the bit.
        (And, false, RLO, false, false),
        (And, false, 0, true, true),
        (Or, true, RLO, true, false),
        (Xor, true, RLO, false, true),
        (Xor, false, RLO, true, true),
        // In a chain.
        (And, false, RLO | FC, true, true),
        (And, true, RLO | FC, true, false),
        (Or, false, RLO | FC, false, true),
        (Or, true, FC, false, true),
        (Xor, false, RLO | FC, true, false),
        (Xor, true, RLO | FC, true, true),
    ] {
        let stw = FC | if rlo { RLO } else { 0 } | if bit { STA } else { 0 };
        chain(&[scan(logic, negate, bit)], before, stw);
    }
}

#[test]
fn and_before_or() {
    use Logic::{And, Or};
    let (one, zero) = (scan(And, false, true), scan(And, false, false));
    // 1 AND 0, OR, 1 AND 1
    chain(&[one.clone(), zero.clone(), Op::OrBranch, one.clone(), one.clone()], 0, FC | RLO | STA);
    // 1 AND 1, OR, 1 AND 0: the first AND decides.
    chain(&[one.clone(), one.clone(), Op::OrBranch, one.clone(), zero.clone()], 0, FC | RLO | OR);
    chain(&[one.clone(), zero.clone(), Op::OrBranch, zero.clone(), one.clone()], 0, FC | STA);
    // Three of them.
    let three = [zero.clone(), Op::OrBranch, zero.clone(), Op::OrBranch, one.clone()];
    chain(&three, 0, FC | RLO | STA);
    // What happens to an OR that waits for its second AND.
    let waiting = |then: Op| [one.clone(), Op::OrBranch, then];
    chain(&waiting(Op::SetRlo), 0, RLO | STA);
    chain(&waiting(Op::ClearRlo), 0, 0);
    chain(&waiting(Op::SaveRlo), 0, FC | OR | RLO | STA | BR);
    chain(&waiting(Op::NotRlo), 0, FC | OR | STA);
    chain(&[one.clone(), Op::OrBranch, Op::NotRlo, zero.clone()], 0, FC | OR | RLO);
    // An OR with an operand ends it.
    chain(&[one.clone(), Op::OrBranch, zero.clone(), scan(Or, false, false)], 0, FC | RLO);
}

#[test]
fn brackets() {
    use Logic::{And, Or, Xor};
    let open = |logic, negate| Op::Open { logic, negate };
    let (one, zero) = (scan(And, false, true), scan(And, false, false));
    let or_one = scan(Or, false, true);
    // 1 AND (0 OR 1)
    chain(&[one.clone(), open(And, false), zero.clone(), or_one.clone(), Op::Close], 0, FC | RLO | STA);
    // 1 AND NOT (0 OR 1)
    chain(&[one.clone(), open(And, true), zero.clone(), or_one.clone(), Op::Close], 0, FC | STA);
    // (1) XOR (1), from the start of a chain
    chain(&[open(Xor, false), one.clone(), Op::Close, open(Xor, false), one.clone(), Op::Close], 0, FC | STA);
    // 0 OR NOT (1 AND 0)
    chain(&[zero.clone(), open(Or, true), one.clone(), zero.clone(), Op::Close], 0, FC | RLO | STA);
    // Seven deep, and the RLO of before a bracket at the start of a chain does not count.
    let mut deep = vec![open(And, false); 7];
    deep.push(one.clone());
    deep.extend(vec![Op::Close; 7]);
    chain(&deep, RLO, FC | RLO | STA);
    // AND before OR around a bracket: 1 OR (0)
    chain(&[one.clone(), Op::OrBranch, open(And, false), zero, Op::Close], 0, FC | RLO | STA | OR);
    chain(&[open(Or, false), one, Op::Close], RLO, FC | RLO | STA);
}

#[test]
fn rlo_statements() {
    chain(&[Op::SetRlo], OR | FC, RLO | STA);
    chain(&[Op::ClearRlo], OR | FC | STA | RLO, 0);
    chain(&[Op::NotRlo], FC, FC | RLO | STA);
    chain(&[Op::NotRlo], FC | RLO, FC | STA);
    chain(&[Op::SaveRlo], FC | RLO, FC | RLO | BR);
    chain(&[Op::SaveRlo], BR, 0);
    chain(&[Op::Assign(m(101, 0))], FC | OR | RLO, RLO | STA);
    chain(&[Op::Assign(m(101, 0))], FC | OR | STA, 0);
    chain(&[Op::Set(m(101, 0))], FC | RLO, RLO | STA);
    chain(&[Op::Set(m(101, 0))], FC, 0);
    chain(&[Op::Reset(m(100, 1))], FC | RLO, RLO | STA);
    chain(&[Op::Reset(m(100, 1))], FC, 0);
    chain(&[Op::EdgePositive(m(101, 1))], RLO, FC | RLO | STA);
    chain(&[Op::EdgePositive(m(100, 1))], RLO, FC | STA);
    chain(&[Op::EdgeNegative(m(100, 1))], 0, FC | RLO);
    chain(&[Op::EdgeNegative(m(101, 1))], 0, FC);
}

#[test]
fn status_bits_as_operands() {
    use StatusBit::*;
    for (bit, when) in [
        (Zero, [true, false, false, false]),
        (Positive, [false, false, true, false]),
        (Negative, [false, true, false, false]),
        (NotZero, [false, true, true, false]),
        (NotNegative, [true, false, true, false]),
        (NotPositive, [true, true, false, false]),
        (Unordered, [false, false, false, true]),
    ] {
        for (cc, expected) in [0, CC0, CC1, CC0 | CC1].into_iter().zip(when) {
            let op = Op::Scan { logic: Logic::And, negate: false, test: BitTest::Status(bit) };
            chain(&[op], cc, cc | FC | if expected { RLO | STA } else { 0 });
        }
    }
    for (bit, flag) in [(Overflow, OV), (StoredOverflow, OS), (BinaryResult, BR)] {
        let op = Op::Scan { logic: Logic::Or, negate: false, test: BitTest::Status(bit) };
        chain(&[op], flag, flag | FC | RLO | STA);
    }
}

#[test]
fn jumps() {
    // Jumped: ACCU1 stays 1; not jumped: it becomes 5.
    for (jump, stw, taken, after) in [
        (Jump::Always, FC | RLO | OR, true, FC | RLO | OR),
        (Jump::IfRlo, FC | RLO | OR, true, RLO | STA),
        (Jump::IfRlo, FC | OR, false, RLO | STA),
        (Jump::IfNotRlo, FC, true, RLO | STA),
        (Jump::IfNotRlo, RLO, false, RLO | STA),
        (Jump::IfRloSaveBr, RLO, true, RLO | STA | BR),
        (Jump::IfRloSaveBr, BR, false, RLO | STA),
        (Jump::IfNotRloSaveBr, BR, true, RLO | STA),
        (Jump::IfNotRloSaveBr, RLO, false, RLO | STA | BR),
        (Jump::IfBr, BR | FC | OR, true, BR | STA),
        (Jump::IfBr, FC, false, STA),
        (Jump::IfNotBr, RLO, true, RLO | STA),
        (Jump::IfOverflow, OV | FC, true, OV | FC),
        (Jump::IfOverflow, OS, false, OS),
        (Jump::IfStoredOverflow, OS | OV, true, OV),
        (Jump::IfStoredOverflow, OV, false, OV),
        (Jump::IfZero, 0, true, 0),
        (Jump::IfZero, CC1, false, CC1),
        (Jump::IfNotZero, CC1, true, CC1),
        (Jump::IfNotZero, CC1 | CC0, false, CC1 | CC0),
        (Jump::IfPositive, CC1, true, CC1),
        (Jump::IfNegative, CC0, true, CC0),
        (Jump::IfNegative, CC1, false, CC1),
        (Jump::IfNotNegative, 0, true, 0),
        (Jump::IfNotNegative, CC0, false, CC0),
        (Jump::IfNotPositive, CC0, true, CC0),
        (Jump::IfUnordered, CC0 | CC1, true, CC0 | CC1),
        (Jump::IfUnordered, CC1, false, CC1),
    ] {
        let ops = [Op::Jump(jump, FIRST + 2), c(5)];
        let (a1, _, got) = run(&ops, 1, 0, stw, 4);
        assert_eq!((a1 == 1, got), (taken, after), "{jump:?} {stw:03X}: {got:03X}");
        // The same on every engine.
        run(&ops, 1, 0, stw, 2);
    }
}

#[test]
fn loops() {
    // MW 30 counts how often the body of LOOP runs.
    let body = [
        transfer(mw(22)),
        load(mw(30)),
        Op::AddConst { format: NumberFormat::Int, value: 1 },
        transfer(mw(30)),
        load(mw(22)),
        Op::Loop(FIRST),
        load(mw(30)),
    ];
    // The first cycle enters with 0, which LOOP takes as 65536: MW 30 comes round to 0. The second enters with 3.
    assert_eq!(run(&body, 3, 0, 0, 2).0, 3);
}

#[test]
fn jump_lists() {
    for (n, result) in [(0, 10), (1, 11), (2, 99), (255, 99), (0x101, 11)] {
        let list = Op::JumpList { targets: Box::new([FIRST + 2, FIRST + 4]), otherwise: FIRST + 6 };
        let end = Op::Jump(Jump::Always, FIRST + 7);
        let ops = [list, Op::Nop, c(10), end.clone(), c(11), end, c(99)];
        assert_eq!(run(&ops, n, 0, 0, 2).0, result, "SPL with {n}");
    }
}

#[test]
fn address_registers() {
    use AddressRegister::{Ar1, Ar2};
    for (ops, out) in [
        (vec![Op::LoadAr(Ar1), c(0), Op::TransferAr(Ar1)], 0x1234),
        (
            vec![Op::LoadArConst(Ar1, 0x8300_0010), Op::AddArConst(Ar1, ob1_model::BitAddr(8)), Op::TransferAr(Ar1)],
            0x8300_0018,
        ),
        (
            vec![Op::LoadArConst(Ar1, 0x84FF_FFF8), Op::AddArConst(Ar1, ob1_model::BitAddr(16)), Op::TransferAr(Ar1)],
            0x8400_0008,
        ),
        (vec![Op::LoadArConst(Ar2, 0x10), c(0xFFFF), Op::AddAr(Ar2), Op::TransferAr(Ar2)], 0xF),
        (vec![Op::LoadArConst(Ar2, 7), Op::CopyAr2ToAr1, Op::TransferAr(Ar1)], 7),
        (vec![Op::LoadArConst(Ar1, 7), Op::CopyAr1ToAr2, Op::TransferAr(Ar2)], 7),
        (vec![Op::LoadArConst(Ar1, 1), Op::LoadArConst(Ar2, 2), Op::ExchangeArs, Op::TransferAr(Ar1)], 2),
        (vec![c(5), transfer(md(40)), Op::LoadArFrom(Ar1, md(40)), Op::TransferArTo(Ar1, md(44)), load(md(44))], 5),
        (vec![Op::LoadDbNumber(DbRegister::Db)], 0),
        (vec![Op::LoadDbLength(DbRegister::Di)], 0),
    ] {
        assert_eq!(run(&ops, 0x1234, 0, 0, 2).0, out, "{ops:?}");
    }
}

#[test]
fn a_wrong_digit_is_a_bcd_error() {
    let mut bench = Bench::new(&program(vec![ob1(vec![c(0x00A1), Op::Convert(Convert::Bti)])], Vec::new()));
    bench.cycle();
    let entry = bench.cpu.diagnostics().find(|e| e.site.is_some()).copied().expect("an entry");
    assert_eq!(entry.event.0, FaultKind::BcdConversion.number());
    assert_eq!((entry.accus[0], entry.site.map(|s| s.line)), (0xA1, Some(2)));
}

#[test]
fn master_control_relay() {
    // Within MCR( with RLO = 0: = and T write 0, S and R nothing; nested brackets stay off.
    let ops = [
        Op::McrActivate,
        Op::ClearRlo,
        Op::McrOpen,
        Op::SetRlo,
        Op::McrOpen,
        Op::SetRlo,
        Op::Assign(m(100, 0)),
        Op::Set(m(101, 0)),
        Op::Reset(m(100, 1)),
        c(0xFFFF),
        transfer(mw(102)),
        Op::McrClose,
        Op::McrClose,
        Op::SetRlo,
        Op::Set(m(101, 7)),
        Op::McrDeactivate,
        load(md(100)),
    ];
    assert_eq!(run(&ops, 0, 0, 0, 2).0, 0x0E80_0000);
}
