//! The list of pointers after `UC` and `CC`, as decompilers write it: the frames that STEP 7 makes of `CALL`, written
//! by hand.

use ob1_cpu::{Cpu, CpuConfig, Width};
use ob1_ir::{Arg, Call, CallMode, Op, Target};
use ob1_model::{DataType, Section};

use crate::common;
use crate::common::source::bench;
use crate::common::{Bench, fc, on_each_engine};

/// FC 5: `q := x`, FC 6 with a bit, FC 7 with numbers, FC 8 with composed parameters.
const CALLEES: &str = "
FUNCTION FC 5 : INT
VAR_INPUT x : INT; END_VAR
VAR_OUTPUT q : INT; END_VAR
VAR_IN_OUT io : INT; END_VAR
BEGIN
L #x; T #q; + 1; T #RET_VAL; L #io; + 1; T #io;
END_FUNCTION
FUNCTION FC 6 : VOID
VAR_INPUT b : BOOL; END_VAR
VAR_OUTPUT n : BOOL; END_VAR
BEGIN
UN #b; = #n;
END_FUNCTION
FUNCTION FC 7 : VOID
VAR_INPUT t : TIMER; d : BLOCK_DB; END_VAR
VAR_OUTPUT q : INT; END_VAR
BEGIN
AUF #d; L DBW 2; T #q;
L S5T#10S; SET; SI #t;
END_FUNCTION
FUNCTION FC 8 : VOID
VAR_INPUT s : STRING[10]; a : ARRAY [1..3] OF INT; p : ANY; END_VAR
VAR_OUTPUT q : INT; r : WORD; END_VAR
BEGIN
L #a[2]; T #q;
L P##p; LAR1; L W [AR1,P#4.0]; T #r;
L P##s; LAR1; L W [AR1,P#0.0]; T MW 80;
L D [AR1,P#2.0]; T MD 82;
L P##q; T MD 86;
END_FUNCTION
DATA_BLOCK DB 7 STRUCT a : ARRAY [1..3] OF INT := 11, 22, 33; w : INT := 44; s : STRING[10] := 'abc'; END_STRUCT; BEGIN END_DATA_BLOCK
DATA_BLOCK DB 8 STRUCT x : INT := 1; y : INT := 2; END_STRUCT; BEGIN END_DATA_BLOCK
";

fn run(body: &str) -> Bench {
    let mut bench = bench(
        &format!(
            "{CALLEES}ORGANIZATION_BLOCK OB 1 VAR_TEMP info : ARRAY [1..20] OF BYTE; t : ARRAY [0..29] OF WORD; END_VAR BEGIN\n{body}\nEND_ORGANIZATION_BLOCK"
        ),
        &[],
    );
    bench.run();
    bench
}

#[test]
fn the_list_is_in_the_order_of_machine_code() {
    on_each_engine(|| {
        // x, RET_VAL, q, io.
        let mut bench = run("L 5; T MW 10; L 7; T MW 16; UC FC 5 { P#M 10.0, P#M 12.0, P#M 14.0, P#M 16.0 };");
        assert_eq!([bench.mw(12), bench.mw(14), bench.mw(16)], [6, 5, 8]);
    });
}

#[test]
fn local_data_of_the_caller_is_area_v() {
    on_each_engine(|| {
        let mut bench = run(
            "L 9; T LW 30; T MW 20; UC FC 5 { P#V 30.0, P#V 32.0, P#V 34.0, P#M 20.0 };\nL LW 32; T MW 22; L LW 34; T MW 24;",
        );
        assert_eq!([bench.mw(22), bench.mw(24)], [10, 9]);
    });
}

/// What an SCL compiler makes: a result in local data that no declaration and no statement before it names.
#[test]
fn local_data_that_only_a_list_names_is_there() {
    on_each_engine(|| {
        let source = format!(
            "{CALLEES}FUNCTION FC 10 : VOID
            BEGIN
            UC FC 6 {{ P#M 1.3, P#V 8.0 }};
            UC FC 5 {{ P#M 10.0, P#V 2.0, P#V 12.0, P#M 16.0 }};
            END_FUNCTION
            ORGANIZATION_BLOCK OB 1 BEGIN L 5; T MW 10; UC FC 10; L 6; T MW 12; END_ORGANIZATION_BLOCK"
        );
        let mut bench = bench_of(&source);
        bench.run();
        assert_eq!((bench.mw(12), bench.mw(16)), (6, 1));
    });
}

#[test]
fn bits_go_by_their_address() {
    on_each_engine(|| {
        let mut bench = run("SET; S M 1.3; UC FC 6\n{ P#M 1.3,\n  P#M 2.5 };\nUC FC 6 { P#M 2.5, P#M 2.6 };");
        assert_eq!((bench.m(2, 5), bench.m(2, 6)), (false, true));
    });
}

#[test]
fn data_follows_the_register_of_the_block_called() {
    on_each_engine(|| {
        // The pointer says DBX: whatever FC 5 finds in the DB register.
        let mut bench = run("AUF DB 8; UC FC 5 { P#DBX 2.0, P#M 30.0, P#DBX 0.0, P#M 34.0 };");
        assert_eq!((bench.mw(30), bench.dbw(8, 0)), (3, 2));
        // Beyond its end: an area error where it is touched, once for reading and once for writing.
        let mut source = String::from(CALLEES);
        source.push_str("ORGANIZATION_BLOCK OB 121 BEGIN L MW 90; + 1; T MW 90; END_ORGANIZATION_BLOCK\n");
        source.push_str("ORGANIZATION_BLOCK OB 1 BEGIN AUF DB 8; UC FC 5 { P#DBX 4.0, P#M 30.0, P#DBX 6.0, P#M 34.0 }; END_ORGANIZATION_BLOCK");
        let mut bench = bench_of(&source);
        bench.run();
        assert_eq!(bench.mw(90), 2);
    });
}

fn bench_of(source: &str) -> Bench {
    bench(source, &[])
}

#[test]
fn numbers_stand_in_the_high_word() {
    on_each_engine(|| {
        let mut bench = run("UC FC 7 { N#15, N#8, P#M 40.0 };\nU T 15; = M 42.0;");
        assert_eq!((bench.mw(40), bench.m(42, 0)), (2, true));
    });
}

#[test]
fn composed_actuals_are_reached_by_their_pointer() {
    on_each_engine(|| {
        let body = "L 7; T LW 20; L P#DBX 8.0; T LD 22; L 7; T LW 26; L P#DBX 0.0; T LD 28;
            L DW#16#10020003; T LD 32; L 7; T LW 36; L P#DBX 6.0; T LD 38;
            UC FC 8 { P#V 20.0, P#V 26.0, P#V 32.0, P#M 50.0, P#M 52.0 };";
        let mut bench = run(body);
        assert_eq!((bench.mw(50), bench.mw(52)), (22, 7));
        // P## of a composed parameter: the POINTER to it; of an elementary one: the pointer of the list.
        assert_eq!((bench.mw(80), bench.md(82), bench.md(86)), (7, 0x8400_0040, 0x8300_0190));
    });
}

#[test]
fn cc_asks_for_the_rlo_and_indirect_calls_take_lists() {
    on_each_engine(|| {
        let mut bench = run("L 5; T MW 10; CLR; CC FC 5 { P#M 10.0, P#M 12.0, P#M 14.0, P#M 16.0 };
            SET; CC FC 5 { P#M 10.0, P#M 60.0, P#M 62.0, P#M 64.0 };
            L 5; T LW 20; UC FC [LW 20] { P#M 10.0, P#M 66.0, P#M 68.0, P#M 70.0 };");
        assert_eq!([bench.mw(12), bench.mw(60), bench.mw(66), bench.mw(70)], [0, 6, 6, 1]);
    });
}

#[test]
fn system_functions_take_lists() {
    on_each_engine(|| {
        // SFC 20: SRCBLK, RET_VAL, DSTBLK.
        let mut bench = run("L 1234; T MW 10; L DW#16#10020002; T LD 20; T LD 30; L 0; T LW 24; T LW 34;
            L P#M 10.0; T LD 26; L P#M 12.0; T LD 36; L -1; T MW 14;
            UC SFC 20 { P#V 20.0, P#M 14.0, P#V 30.0 };");
        assert_eq!((bench.mw(12), bench.mw(14)), (1234, 0));
    });
}

#[test]
fn a_short_list_is_an_area_error_where_the_rest_is_touched() {
    on_each_engine(|| {
        let source = format!(
            "{CALLEES}ORGANIZATION_BLOCK OB 121 BEGIN L MW 90; + 1; T MW 90; END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN L 5; T MW 10; UC FC 5 {{ P#M 10.0 }}; UC FC 5; END_ORGANIZATION_BLOCK"
        );
        let mut bench = bench_of(&source);
        bench.run();
        // q, RET_VAL, io twice; then x as well.
        assert_eq!(bench.mw(90), 9);
        assert_eq!(bench.cell(ob1_model::Area::Input, 0, Width::DWord), 0);
    });
}

#[test]
fn parameters_are_handed_on() {
    on_each_engine(|| {
        let source = format!("{CALLEES}FUNCTION FC 9 : VOID VAR_INPUT x : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN
            CALL FC 5 (x := #x, q := #q, io := MW 96, RET_VAL := MW 98); END_FUNCTION
            ORGANIZATION_BLOCK OB 1 BEGIN L 5; T LW 20; AUF DB 8; UC FC 9 {{ P#V 20.0, P#DBX 2.0 }}; END_ORGANIZATION_BLOCK");
        let mut bench = bench_of(&source);
        bench.run();
        assert_eq!((bench.dbw(8, 2), bench.mw(98)), (5, 6));
    });
}

#[test]
fn a_pointer_to_a_parameter_leads_to_whatever_is_supplied() {
    on_each_engine(|| {
        let source = "
            FUNCTION FC 10 : VOID VAR_INPUT x : INT; s : STRING[4]; END_VAR VAR_IN_OUT b : BOOL; END_VAR
            VAR_OUTPUT q : INT; c : BYTE; END_VAR BEGIN
            L P##x; LAR1; L W [AR1,P#0.0]; T #q;
            L 7; L 8; LAR1 P##b; +I; T MW 98; SET; S [AR1,P#0.0];
            L P##s; LAR1; L W [AR1,P#0.0]; T MW 96; AUF DB [MW 96]; L D [AR1,P#2.0]; LAR1; L B [AR1,P#2.0]; T #c;
            END_FUNCTION
            DATA_BLOCK DB 7 STRUCT w : INT := 44; b : BOOL; s : STRING[4] := 'abc'; END_STRUCT; BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 8 STRUCT w : INT; END_STRUCT; BEGIN END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1 VAR_TEMP info : ARRAY [1..20] OF BYTE; w : INT; b : BOOL; END_VAR BEGIN
            CALL FC 10 (x := 5, s := DB7.s, b := M 1.0, q := MW 10, c := MB 20);
            CALL FC 10 (x := DB7.w, s := DB7.s, b := DB7.b, q := MW 12, c := MB 21);
            L 6; T #w; CALL FC 10 (x := #w, s := DB7.s, b := #b, q := MW 14, c := MB 22); U #b; = M 1.1;
            L 9; T MW 30; L P#M 30.0; LAR1; CALL FC 10 (x := W [AR1,P#0.0], s := DB7.s, b := M 1.2, q := MW 16, c := MB 23);
            END_ORGANIZATION_BLOCK";
        let mut bench = bench_of(source);
        bench.run();
        assert_eq!([bench.mw(10), bench.mw(12), bench.mw(14), bench.mw(16)], [5, 44, 6, 9]);
        assert_eq!((bench.md(20), bench.mw(98), bench.mb(1)), (0x6161_6161, 15, 0b111));
        let cell = ob1_cpu::Cell::Db(7, 16);
        assert_eq!(bench.cpu.read(cell, Width::Bit), Ok(1));
    });
}

#[test]
fn a_list_does_not_belong_to_call() {
    on_each_engine(|| {
        let callee = common::block(
            fc(1),
            common::interface(ob1_model::BlockKind::Fc, &[("x", Section::Input, DataType::Int)], 0),
            vec![],
        );
        for (mode, arg) in [(CallMode::Call, Arg::Raw(0x8300_0000)), (CallMode::Unconditional, Arg::Const(1))] {
            let call = Call { mode, target: Target::Block(fc(1)), instance: None, args: vec![arg] };
            let ob = common::ob1(vec![Op::Call(Box::new(call))]);
            let program = common::program(vec![ob, callee.clone()], vec![]);
            assert!(
                Cpu::new(CpuConfig::default(), &program, Vec::new(), Vec::new(), common::engine()).is_err(),
                "{mode:?}"
            );
        }
    });
}
