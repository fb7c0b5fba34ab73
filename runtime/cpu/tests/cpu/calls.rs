//! How parameters reach blocks and come back.

use ob1_cpu::{Cpu, CpuConfig, LoadError, OperatingState};
use ob1_ir::{
    AccuOp, Arg, BitTest, Call, CallMode, CodeBlock, DbRegister, Logic, Number, NumberFormat, Op, Operand, Place,
    Program, Target, Width,
};
use ob1_model::{Area, BitAddr, BlockKind, DataType, Interface, Section};

use crate::common;
use crate::common::*;

const ADD: Op = Op::Arithmetic(NumberFormat::Int, AccuOp::Add);

fn arg(operand: Operand) -> Arg {
    Arg::Operand(operand)
}

/// FC 1 (x IN INT, y IN INT, q IN_OUT INT, seen OUT INT): q := x + y, then seen := MW 50.
fn adder() -> CodeBlock {
    let int = || DataType::Int;
    block(
        fc(1),
        interface(
            BlockKind::Fc,
            &[
                ("x", Section::Input, int()),
                ("y", Section::Input, int()),
                ("seen", Section::Output, int()),
                ("q", Section::InOut, int()),
            ],
            0,
        ),
        vec![
            load(param(0, Width::Word)),
            load(param(1, Width::Word)),
            ADD,
            transfer(param(3, Width::Word)),
            load(mw(50)),
            transfer(param(2, Width::Word)),
        ],
    )
}

/// Runs a program on each engine and gives each to `check` after `scans` cycles.
fn each(program: &Program, scans: usize, check: impl Fn(&mut Bench)) {
    on_each_engine(|| {
        let mut bench = Bench::new(program);
        for _ in 0..scans {
            bench.run();
        }
        check(&mut bench);
    });
}

#[test]
fn bit_memory_goes_by_reference_and_is_seen_at_once() {
    let code = vec![c(30), transfer(mw(10)), call(fc(1), vec![arg(mw(10)), Arg::Const(12), arg(mw(20)), arg(mw(50))])];
    each(&program(vec![ob1(code), adder()], vec![]), 2, |bench| {
        assert_eq!((bench.mw(50), bench.mw(20)), (42, 42));
    });
}

#[test]
fn data_operands_are_copied_in_and_out() {
    // The callee writes q, and then reads the DB by itself: the old value, for the copy comes after the return.
    let mut adder = adder();
    adder.code[4].op = load(in_db(7, Width::Word, 4, 0));
    let args = vec![
        arg(in_db(7, Width::Word, 0, 0)),
        arg(in_db(7, Width::Word, 2, 0)),
        arg(mw(20)),
        arg(in_db(7, Width::Word, 4, 0)),
    ];
    each(&program(vec![ob1(vec![call(fc(1), args)]), adder], vec![db(7, &[0, 5, 0, 6, 0, 99])]), 1, |bench| {
        assert_eq!((bench.dbw(7, 4), bench.mw(20)), (11, 99));
    });
}

#[test]
fn local_data_and_opened_data_blocks_go_by_reference() {
    let code = vec![
        Op::OpenDb(DbRegister::Db, Number::Fixed(7)),
        c(3),
        transfer(lw(20)),
        call(fc(1), vec![arg(lw(20)), arg(dbw(0)), arg(lw(22)), arg(dbw(2))]),
        load(dbw(2)),
        transfer(mw(30)),
    ];
    each(&program(vec![ob1(code), adder()], vec![db(7, &[0, 5, 0, 0])]), 1, |bench| {
        assert_eq!(bench.mw(30), 8);
    });
}

#[test]
fn indirect_operands_are_copied() {
    let pointer = |byte: u32| ob1_ir::Pointer { area: Area::Memory, at: BitAddr::byte_addr(byte) };
    let indirect = operand(Width::Word, Place::Memory(Area::Memory, pointer(60)));
    let register = operand(Width::Word, Place::Register(None, ob1_ir::AddressRegister::Ar1, BitAddr::byte_addr(2)));
    let code = vec![
        c(70 * 8),
        transfer(md(60)),
        c(7),
        transfer(mw(70)),
        Op::LoadArConst(ob1_ir::AddressRegister::Ar1, 0x8300_0000 + 72 * 8),
        call(fc(1), vec![arg(indirect), Arg::Const(1), arg(mw(20)), arg(register)]),
    ];
    each(&program(vec![ob1(code), adder()], vec![]), 1, |bench| assert_eq!(bench.mw(74), 8));
}

#[test]
fn own_formals_can_be_passed_on() {
    // FC 2 (a IN, b OUT) calls FC 1 (x := #a, y := 1, q := #b).
    let outer = block(
        fc(2),
        interface(BlockKind::Fc, &[("a", Section::Input, DataType::Int), ("b", Section::Output, DataType::Int)], 0),
        vec![call(fc(1), vec![arg(param(0, Width::Word)), Arg::Const(1), arg(mw(20)), arg(param(1, Width::Word))])],
    );
    let code = vec![c(41), transfer(mw(10)), call(fc(2), vec![arg(mw(10)), arg(mw(50))])];
    each(&program(vec![ob1(code), outer, adder()], vec![]), 1, |bench| {
        assert_eq!((bench.mw(50), bench.mw(20)), (42, 0), "a copy, given back behind the call");
    });
}

#[test]
fn a_constant_on_an_output_can_be_written_and_is_there_again_next_time() {
    let code = vec![call(fc(1), vec![Arg::Const(1), Arg::Const(2), arg(mw(20)), Arg::Const(7)])];
    let mut adder = adder();
    // seen := q before q is written.
    adder.code.rotate_right(2);
    adder.code[0].op = load(param(3, Width::Word));
    each(&program(vec![ob1(code), adder], vec![]), 2, |bench| assert_eq!(bench.mw(20), 7));
}

#[test]
fn timers_and_counters_as_parameters() {
    let counter = block(
        fc(3),
        interface(BlockKind::Fc, &[("z", Section::Input, DataType::Counter)], 0),
        vec![Op::ClearRlo, Op::CountUp(Number::Param(0)), Op::SetRlo, Op::CountUp(Number::Param(0))],
    );
    let code =
        vec![call(fc(3), vec![Arg::Number(Number::Fixed(9))]), Op::LoadCounter(Number::Fixed(9)), transfer(mw(10))];
    each(&program(vec![ob1(code), counter], vec![]), 3, |bench| assert_eq!(bench.mw(10), 3));
}

/// FB 1: v IN INT, q OUT INT, io IN_OUT INT, n STATIC INT: n := n + v; q := n; io := io + 1.
fn counter_fb() -> CodeBlock {
    let int = || DataType::Int;
    let at = |byte: u32| operand(Width::Word, Place::Instance(BitAddr::byte_addr(byte)));
    block(
        fb(1),
        interface(
            BlockKind::Fb,
            &[
                ("v", Section::Input, int()),
                ("q", Section::Output, int()),
                ("io", Section::InOut, int()),
                ("n", Section::Static, int()),
            ],
            0,
        ),
        vec![
            load(at(6)),
            load(at(0)),
            ADD,
            transfer(at(6)),
            transfer(at(2)),
            load(at(4)),
            Op::AddConst { format: NumberFormat::Int, value: 1 },
            transfer(at(4)),
        ],
    )
}

#[test]
fn a_function_block_keeps_its_data_and_copies_results_out() {
    let code = vec![
        c(10),
        transfer(mw(10)),
        call_fb(fb(1), 5, vec![arg(mw(10)), arg(in_db(9, Width::Word, 0, 0)), arg(mw(30))]),
        call_fb(fb(1), 6, vec![Arg::Const(1), Arg::Open, Arg::Open]),
    ];
    let data = vec![instance_db(5, fb(1), 8), instance_db(6, fb(1), 8), db(9, &[0; 2])];
    each(&program(vec![ob1(code), counter_fb()], data), 3, |bench| {
        assert_eq!((bench.dbw(9, 0), bench.mw(30), bench.dbw(5, 6)), (30, 3, 30));
        assert_eq!((bench.dbw(6, 6), bench.dbw(6, 2), bench.dbw(6, 4)), (3, 3, 3));
    });
}

#[test]
fn multi_instances_and_the_registers_after_the_call() {
    // FB 2 has two instances of FB 1 at bytes 0 and 8, and calls them in turn.
    let local = |byte, value| {
        let target = Target::Local(fb(1), BitAddr::byte_addr(byte));
        let args = vec![Arg::Const(value), Arg::Open, Arg::Open];
        Op::Call(Box::new(Call { mode: CallMode::Call, target, instance: None, args }))
    };
    let outer = block(
        fb(2),
        Interface { instance_bytes: 16, ..Interface::default() },
        vec![
            local(0, 1),
            local(8, 2),
            Op::TransferAr(ob1_ir::AddressRegister::Ar2),
            transfer(md(40)),
            Op::LoadDbNumber(DbRegister::Di),
            transfer(mw(44)),
        ],
    );
    let code = vec![
        Op::OpenDb(DbRegister::Db, Number::Fixed(9)),
        Op::OpenDb(DbRegister::Di, Number::Fixed(9)),
        Op::LoadArConst(ob1_ir::AddressRegister::Ar2, 0x123),
        call_fb(fb(2), 5, vec![]),
        Op::TransferAr(ob1_ir::AddressRegister::Ar2),
        transfer(md(50)),
        Op::LoadDbNumber(DbRegister::Di),
        transfer(mw(54)),
        Op::LoadDbNumber(DbRegister::Db),
        transfer(mw(56)),
    ];
    let data = vec![instance_db(5, fb(2), 16), db(9, &[0; 2])];
    each(&program(vec![ob1(code), outer, counter_fb()], data), 2, |bench| {
        assert_eq!((bench.dbw(5, 6), bench.dbw(5, 14)), (2, 4));
        assert_eq!((bench.md(40) & 0xFF_FFFF, bench.mw(44)), (0, 5), "the caller's instance is back");
        assert_eq!((bench.md(50), bench.mw(54), bench.mw(56)), (0x123, 9, 5), "the DB register holds the instance");
    });
}

/// `CALL` of a function block exchanges the registers before it opens the instance (`TDB`): inside, the DB register is
/// the caller's DI.
#[test]
fn the_db_register_in_a_function_block_is_its_callers_di() {
    on_each_engine(|| {
        let source = "
            FUNCTION_BLOCK FB 1
            VAR_INPUT x : INT; at : INT; END_VAR
            VAR_TEMP pointer : DWORD; t : ARRAY [0..60] OF INT; END_VAR
            BEGIN
            L #at; SLD 3; L P#M 0.0; +D; LAR1; T #pointer;
            L DBNO; T W [AR1,P#0.0]; L DINO; T W [AR1,P#2.0]; L DBW 0; T W [AR1,P#4.0];
            END_FUNCTION_BLOCK
            FUNCTION_BLOCK FB 3
            VAR_INPUT x : INT; END_VAR
            BEGIN
            L DBW 0; T MW 60;
            END_FUNCTION_BLOCK
            FUNCTION_BLOCK FB 2
            VAR_INPUT y : INT; END_VAR
            VAR inner : FB 1; END_VAR
            BEGIN
            AUF DB 3; CALL #inner (x := 7, at := 30); L DBNO; T MW 36;
            AUF DB 3; CALL FB 1, DB 5 (x := DB4.DBW 0, at := 40);
            END_FUNCTION_BLOCK
            DATA_BLOCK DB 3 STRUCT a : INT := 33; END_STRUCT BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 4 STRUCT a : INT := 44; END_STRUCT BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 5 FB 1 BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 6 FB 2 BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 7 FB 3 BEGIN END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN
            AUF DB 3; AUF DI 4; CALL FB 1, DB 5 (x := DB3.DBW 0, at := 20); L DBNO; T MW 26; L DINO; T MW 28;
            AUF DB 3; AUF DI 4; CALL FB 3, DB 7 (x := 1);
            CALL FB 2, DB 6 (y := 66);
            END_ORGANIZATION_BLOCK";
        let mut bench = source::bench(source, &[]);
        bench.run();
        let words = |bench: &mut Bench, first: u32| [0, 2, 4].map(|n| bench.mw(first + n));
        assert_eq!(words(&mut bench, 20), [4, 5, 44]);
        assert_eq!((bench.mw(26), bench.mw(28)), (5, 4), "behind the call");
        assert_eq!(bench.mw(60), 44, "a short block");
        assert_eq!(words(&mut bench, 30), [6, 6, 66], "a multi-instance");
        assert_eq!(bench.mw(36), 6);
        assert_eq!(words(&mut bench, 40), [6, 5, 66]);
    });
}

#[test]
fn uc_cc_and_calls_by_number() {
    let inc = |n: u16, byte: u32| {
        let ops = vec![load(mw(byte)), Op::AddConst { format: NumberFormat::Int, value: 1 }, transfer(mw(byte))];
        block(fc(n), Interface::default(), ops)
    };
    let pointer = ob1_ir::Pointer { area: Area::Memory, at: BitAddr::byte_addr(0) };
    let indirect = Op::Call(Box::new(Call {
        mode: CallMode::Unconditional,
        target: Target::Indirect(BlockKind::Fc, Number::Memory(pointer)),
        instance: None,
        args: Vec::new(),
    }));
    let code = vec![
        uc(CallMode::Unconditional, fc(10)),
        Op::ClearRlo,
        uc(CallMode::Conditional, fc(11)),
        uc(CallMode::Conditional, fc(12)),
        c(13),
        transfer(mw(0)),
        indirect,
    ];
    let blocks = vec![ob1(code), inc(10, 20), inc(11, 22), inc(12, 24), inc(13, 26)];
    each(&program(blocks, vec![]), 1, |bench| {
        assert_eq!((bench.mw(20), bench.mw(22), bench.mw(24), bench.mw(26)), (1, 0, 1, 1), "CC sets the RLO");
    });
}

#[test]
fn composed_parameters_are_referred_to() {
    let text = DataType::String(4);
    let second = Place::Param { index: 0, at: BitAddr::byte_addr(3) };
    let copy = block(
        fc(4),
        interface(BlockKind::Fc, &[("s", Section::InOut, text)], 0),
        vec![c(u32::from(b'x')), transfer(operand(Width::Byte, second))],
    );
    let code = vec![call(fc(4), vec![arg(in_db(3, Width::Byte, 2, 0))])];
    each(&program(vec![ob1(code), copy], vec![db(3, b"\0\0\x04\x02ab\0\0")]), 1, |bench| {
        assert_eq!(bench.cpu.data_block(3), Some(&b"\0\0\x04\x02ax\0\0"[..]));
    });
}

#[test]
fn recursion_ends_with_a_fault() {
    let recursive = block(fc(1), Interface::default(), vec![uc(CallMode::Unconditional, fc(1))]);
    let mut bench = Bench::new(&program(vec![ob1(vec![uc(CallMode::Unconditional, fc(1))]), recursive], Vec::new()));
    assert_eq!(bench.cycle().state, OperatingState::Stop);
    assert_eq!(bench.events()[..2], [0x4562, 0x2575]);
}

#[test]
fn the_callers_data_through_area_code_v() {
    let deref = Place::Register(None, ob1_ir::AddressRegister::Ar1, BitAddr(0));
    let reader = block(
        fc(1),
        Interface::default(),
        vec![
            Op::LoadArConst(ob1_ir::AddressRegister::Ar1, 0x8700_0000 + 20 * 8),
            load(operand(Width::Word, deref)),
            transfer(mw(10)),
        ],
    );
    let code = vec![c(77), transfer(lw(20)), uc(CallMode::Unconditional, fc(1))];
    each(&program(vec![ob1(code), reader], vec![]), 1, |bench| assert_eq!(bench.mw(10), 77));
}

#[test]
fn bit_parameters_of_every_kind() {
    let bool = || DataType::Bool;
    let copy = block(
        fc(1),
        interface(BlockKind::Fc, &[("i", Section::Input, bool()), ("o", Section::Output, bool())], 0),
        vec![u(Place::Param { index: 0, at: BitAddr(0) }), Op::Assign(Place::Param { index: 1, at: BitAddr(0) })],
    );
    let bit = |place| arg(operand(Width::Bit, place));
    let code = vec![
        call(fc(1), vec![Arg::Const(1), bit(m(0, 1))]),
        call(fc(1), vec![bit(m(0, 1)), bit(Place::InDb(3, BitAddr::new(1, 6)))]),
        call(fc(1), vec![bit(Place::InDb(3, BitAddr::new(1, 6))), bit(l(20, 3))]),
        Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(l(20, 3)) },
        Op::Assign(m(0, 7)),
    ];
    each(&program(vec![ob1(code), copy], vec![db(3, &[0; 2])]), 1, |bench| {
        assert_eq!((bench.mb(0), bench.dbw(3, 0)), (0x82, 0x40));
    });
}

#[test]
fn what_does_not_fit_is_refused_at_load() {
    let load = |blocks| {
        Cpu::new(CpuConfig::default(), &program(blocks, vec![]), vec![], vec![], common::engine())
            .err()
            .unwrap_or_default()
    };
    let numbers = |errors: Vec<LoadError>| errors.iter().map(LoadError::number).collect::<Vec<_>>();
    assert_eq!(numbers(load(vec![ob1(vec![uc(CallMode::Unconditional, fc(99))])])), [3]);
    let wide = vec![arg(mb(1)), Arg::Const(0), arg(mw(2)), arg(mw(4))];
    for args in [vec![], wide, vec![Arg::Open, Arg::Open, Arg::Open, Arg::Open]] {
        let errors = load(vec![ob1(vec![Op::Nop, call(fc(1), args)]), adder()]);
        assert!(errors[0].to_string().starts_with("L004: OB 1, network 1, line 2, call of FC 1"), "{}", errors[0]);
    }
    assert_eq!(numbers(load(vec![ob1(vec![]), ob1(vec![])])), [2]);
    assert_eq!(numbers(load(vec![ob1(vec![Op::Jump(ob1_ir::Jump::Always, 2)])])), [9]);
    assert_eq!(numbers(load(vec![ob1(vec![Op::Close])])), [9]);
    assert_eq!(numbers(load(vec![ob1(vec![common::load(param(0, Width::Word))])])), [9]);
}

/// STEP 7 makes a `CALL` of a function block of statements that leave its instance in the DB register. The same for a
/// multi-instance, a system function block, and however the called block opens others; `UC` restores the registers.
#[test]
fn behind_the_call_of_a_function_block_its_instance_is_open() {
    let source = |call: &str| {
        format!(
            "FUNCTION_BLOCK FB 1 VAR_INPUT a : INT; END_VAR BEGIN AUF DB 3; AUF DI 3; END_FUNCTION_BLOCK
             FUNCTION_BLOCK FB 2 VAR_INPUT a : INT; END_VAR VAR sub : FB 1; END_VAR
             BEGIN AUF DB 2; CALL #sub (a := 7); L DBW 0; T MW 20; L DBNO; T MW 22; END_FUNCTION_BLOCK
             FUNCTION_BLOCK FB 3 VAR_INPUT a : INT; END_VAR VAR x : INT; END_VAR
             BEGIN L #a; + 1; T #x; END_FUNCTION_BLOCK
             FUNCTION FC 1 : VOID VAR_INPUT a : INT; END_VAR BEGIN AUF DB 3; END_FUNCTION
             DATA_BLOCK DB 1 FB 1 BEGIN END_DATA_BLOCK
             DATA_BLOCK DB 4 FB 2 BEGIN END_DATA_BLOCK
             DATA_BLOCK DB 5 FB 3 BEGIN END_DATA_BLOCK
             DATA_BLOCK DB 6 SFB 4 BEGIN END_DATA_BLOCK
             DATA_BLOCK DB 2 STRUCT b : INT := 222; END_STRUCT; BEGIN END_DATA_BLOCK
             DATA_BLOCK DB 3 STRUCT b : INT := 333; END_STRUCT; BEGIN END_DATA_BLOCK
             ORGANIZATION_BLOCK OB 1 BEGIN AUF DB 2; AUF DI 3; {call} L DBW 0; T MW 10; L DBNO; T MW 12; L DINO; T MW 14;
             END_ORGANIZATION_BLOCK"
        )
    };
    on_each_engine(|| {
        for (call, word, number) in [
            ("CALL FB 1, DB 1 (a := 5);", 5, 1),
            ("CALL FB 2, DB 4 (a := 6);", 6, 4),
            // Short enough to become part of its caller.
            ("CALL FB 3, DB 5 (a := 8);", 8, 5),
            ("SET; SPB M001; CALL FB 3, DB 5 (a := 8); M001: NOP 0;", 222, 2),
            ("CLR; SPB M001; CALL FB 3, DB 5 (a := 8); M001: NOP 0;", 8, 5),
            ("CALL SFB 4, DB 6 (IN := FALSE, PT := T#9S);", 0, 6),
            ("CALL FC 1 (a := 9);", 222, 2),
            ("UC FB 1;", 222, 2),
        ] {
            let mut bench = crate::common::source::bench(&source(call), &[]);
            bench.run();
            bench.run();
            assert_eq!((bench.mw(10), bench.mw(12), bench.mw(14)), (word, number, 3), "{call}");
            if number == 4 {
                assert_eq!((bench.mw(20), bench.mw(22)), (6, 4), "the multi-instance lies in the caller's own");
            }
        }
    });
}

/// A call that cannot be made, because an actual is not there, leaves the register as it is; so it does for what
/// follows in the same block, however the engine goes on there.
#[test]
fn a_call_of_a_function_block_that_cannot_be_made_opens_nothing() {
    let waits = "L 3; M001: T MW 90; LOOP M001;";
    on_each_engine(|| {
        for (byte, word, number) in [(0, 5, 5), (100, 222, 2)] {
            let source = format!(
                "FUNCTION_BLOCK FB 1 VAR_INPUT a : INT; b : INT := 5; END_VAR BEGIN {waits} END_FUNCTION_BLOCK
                 FUNCTION FC 1 : VOID BEGIN {waits} END_FUNCTION
                 DATA_BLOCK DB 5 FB 1 BEGIN END_DATA_BLOCK
                 DATA_BLOCK DB 2 STRUCT b : INT := 111; c : INT := 222; END_STRUCT; BEGIN END_DATA_BLOCK
                 ORGANIZATION_BLOCK OB 121 BEGIN END_ORGANIZATION_BLOCK
                 ORGANIZATION_BLOCK OB 1 BEGIN
                 AUF DB 2; CALL FB 1, DB 5 (a := DBW {byte}); CALL FC 1; L DBW 2; T MW 10; L DBNO; T MW 12;
                 END_ORGANIZATION_BLOCK"
            );
            let mut bench = crate::common::source::bench(&source, &[]);
            for _ in 0..3 {
                bench.run();
                assert_eq!((bench.mw(10), bench.mw(12)), (word, number), "DBW {byte}");
            }
        }
    });
}
