//! What STL of an S7-1500 has beyond that of an S7-300: indices known at run time, slices, overlays, instances of IEC
//! timers.

use ob1_cpu::{CpuConfig, Family};

use crate::common::source::{bench, bench_with};

/// An FB with arrays everywhere, whose statements are `body`. The arrays begin with their
/// number times ten and count on.
fn program(body: &str, i: i32, k: i32) -> String {
    let fill = |array: &str, first: i32, low: i32, ten: i32, word: &str| -> String {
        (0..3).map(|n| format!("L {word}{}; T {array}[{}];", ten + n + first, low + n)).collect()
    };
    let fills = [
        fill("#near", 0, -1, 10, ""),
        fill("#list", 0, 1, 20, "L#"),
        fill("#far", 0, 0, 30, ""),
        fill("DB7.x", 0, 2, 40, ""),
        (0..3).map(|n| format!("L {}; T #rows[{n}].b[1, {}];", 50 + n, n + 1)).collect(),
    ];
    format!(
        "FUNCTION_BLOCK FB 5
         VAR_INPUT i : INT; k : DINT; END_VAR
         VAR_IN_OUT far : ARRAY [0..9] OF INT; END_VAR
         VAR pad : BOOL; list : ARRAY [1..8] OF DINT; bits : ARRAY [0..15] OF BOOL; half AT bits : ARRAY [0..1] OF BYTE;
           rows : ARRAY [0..3] OF STRUCT a : INT; b : ARRAY [0..2, 1..3] OF INT; END_STRUCT; END_VAR
         VAR_TEMP t : INT; near : ARRAY [-1..2] OF INT; w : WORD; END_VAR
         BEGIN {} {body} END_FUNCTION_BLOCK
         FUNCTION FC 5 : DINT VAR_INPUT a : INT; END_VAR VAR_IN_OUT x : DINT; END_VAR
         BEGIN L #x; L 100; +D; T #x; L #a; ITD; T #RET_VAL; END_FUNCTION
         DATA_BLOCK DB 5 FB 5 BEGIN END_DATA_BLOCK
         DATA_BLOCK DB 7 STRUCT pad : INT; x : ARRAY [2..8] OF INT; f : ARRAY [0..9] OF INT; END_STRUCT BEGIN END_DATA_BLOCK
         ORGANIZATION_BLOCK OB 1 BEGIN CALL FB 5 , DB 5 (i := {i}, k := L#{k}, far := DB7.f); END_ORGANIZATION_BLOCK",
        fills.concat()
    )
}

#[test]
fn an_index_known_at_run_time() {
    for (family, body, i, k, expected) in [
        (Family::S7_300, "L #near[#i]; T MW 20;", 1, 0, "000C"),
        (Family::S7_300, "L #near[#i]; T MW 20;", -1, 0, "000A"),
        (Family::S7_300, "L #list[#k]; T MD 20;", 0, 3, "00000016"),
        (Family::S7_300, "L #list[#i]; T MD 20;", 2, 0, "00000015"),
        (Family::S7_300, "L #far[#i]; T MW 20;", 2, 0, "0020"),
        (Family::S7_300, "L DB7.x[#i]; T MW 20;", 3, 0, "0029"),
        (Family::S7_300, "L #rows[#i].b[1, #k]; T MW 20;", 1, 2, "0033"),
        (Family::S7_300, "L 7; T #rows[#i].b[#k, 3]; L #rows[2].b[0, 3]; T MW 20;", 2, 0, "0007"),
        (
            Family::S7_300,
            "SET; = #bits[#i]; U #bits[9]; = M 20.0; U #bits[8]; = M 20.1; L #half[1]; T MB 21;",
            9,
            0,
            "0102",
        ),
        (Family::S7_300, "L 5; T #far[#k]; L DB7.f[4]; T MW 20;", 0, 4, "0005"),
        // An actual by value, and one that is written back.
        (
            Family::S7_300,
            "CALL FC 5 (a := #near[#i], x := #list[#k], RET_VAL := MD 20); L #list[2]; T MD 24;",
            0,
            2,
            "0000000B00000079",
        ),
        // Accumulators, AR1, the result and the condition codes stay.
        (Family::S7_300, "L 3; L 4; T #near[#i]; +I; T MW 20;", 0, 0, "0007"),
        (Family::S7_300, "LAR1 P#M 3.1; L #near[#i]; TAR1 MD 20;", 0, 0, "83000019"),
        (Family::S7_300, "SET; L #near[#i]; = M 20.0; CLR; L #near[#i]; = M 20.1;", 0, 0, "01"),
        (Family::S7_300, "L 1; L 2; -I; T #near[#i]; SPM neg; L 1; T MB 20; BEA; neg: L 2; T MB 20;", 0, 0, "02"),
        (Family::S7_400, "L 1; L 2; -I; T #near[#i]; SPM neg; L 1; T MB 20; BEA; neg: L 2; T MB 20;", 0, 0, "02"),
        (Family::S7_400, "SET; U M 99.0; O; U #bits[#i]; = M 20.0; U #far[#k].%X0; = M 20.1;", 0, 1, "02"),
        (Family::S7_400, "L #near[#i]; T MW 20;", 1, 0, "000C"),
    ] {
        let config = CpuConfig { family, ..CpuConfig::default() };
        let mut bench = bench_with(&program(body, i, k), &[], config, vec![]);
        bench.run();
        let found: String =
            bench.cpu.bit_memory()[20..20 + expected.len() / 2].iter().map(|b| format!("{b:02X}")).collect();
        assert_eq!(found, expected, "{family:?} {body} i {i} k {k}");
    }
}

#[test]
fn slices_and_overlays_of_parameters() {
    let source = "FUNCTION FC 5 : VOID
         VAR_INPUT d : DWORD; part AT d : ARRAY [0..3] OF BYTE; END_VAR VAR_OUTPUT w : WORD; END_VAR
         BEGIN L #part[1]; T MB 20; L #d.%B0; T MB 21; U #d.%X31; = M 22.0; U #d.%X0; = M 22.1; L 0; T #w; SET; = #w.%X9;
         L MD 0; L MD0.%W1; T MW 26; END_FUNCTION
         ORGANIZATION_BLOCK OB 1 BEGIN L DW#16#81020304; T MD 0; CALL FC 5 (d := MD 0, w := MW 24); END_ORGANIZATION_BLOCK";
    let mut bench = bench(source, &[]);
    bench.run();
    assert_eq!(bench.cpu.bit_memory()[20..28], [0x02, 0x04, 0x01, 0, 0x02, 0, 0x81, 0x02]);
}

#[test]
fn a_timer_with_the_instance_of_an_s7_1500() {
    let source = "FUNCTION_BLOCK FB 5 VAR pad : BOOL; delay : TON_TIME; one : IEC_TIMER; END_VAR
         BEGIN CALL #delay (IN := M 0.0, PT := T#1s); CALL TP, #one (IN := M 0.0, PT := T#1s);
         U #delay.RU; = M 20.0; U #delay.Q; = M 20.1; U #one.Q; = M 20.2; L #delay.PT; T MD 22; L DB5.DBD 6; T MD 26; END_FUNCTION_BLOCK
         DATA_BLOCK DB 5 FB 5 BEGIN END_DATA_BLOCK
         ORGANIZATION_BLOCK OB 1 BEGIN CALL FB 5 , DB 5; END_ORGANIZATION_BLOCK";
    let mut bench = bench(source, &[]);
    bench.run();
    bench.set_m(0, 0, true);
    bench.run();
    assert_eq!(bench.cpu.bit_memory()[20] & 7, 0b101, "both run");
    assert_eq!(bench.cpu.bit_memory()[22..30], [0, 0, 3, 0xE8, 0, 0, 3, 0xE8], "PT lies 4 bytes into the instance");
}

#[test]
fn timers_within_structures_and_data_blocks() {
    let source = "FUNCTION_BLOCK FB 5 VAR pad : BOOL; q : BOOL; s : STRUCT n : INT; one : IEC_TIMER; END_STRUCT; END_VAR
         BEGIN CALL TP, #s.one (IN := M 0.0, PT := T#1s, Q := #q); U #q; = M 20.0; END_FUNCTION_BLOCK
         FUNCTION_BLOCK FB 6 VAR pad : DINT; q : BOOL; in : BOOL; END_VAR
         BEGIN U M 0.0; = #in; CALL TP, DB7.list[1] (IN := #in, PT := T#1s, Q := #q); U #q; = M 20.1; U DB7.list[1].RU; = M 20.2;
         L DB7.list[1].PT; T MD 22; L DB7.DBD 22; T MD 26; L DB7.list[0].PT; T MD 30; END_FUNCTION_BLOCK
         FUNCTION_BLOCK FB 8 VAR pad : DINT; inner : FB 6; END_VAR BEGIN CALL #inner; END_FUNCTION_BLOCK
         DATA_BLOCK DB 5 FB 5 BEGIN END_DATA_BLOCK
         DATA_BLOCK DB 8 FB 8 BEGIN END_DATA_BLOCK
         DATA_BLOCK DB 7 STRUCT n : INT; list : ARRAY [0..2] OF TON_TIME; END_STRUCT BEGIN END_DATA_BLOCK
         ORGANIZATION_BLOCK OB 1 BEGIN CALL FB 5 , DB 5; CALL FB 8 , DB 8; END_ORGANIZATION_BLOCK";
    let mut bench = bench(source, &[]);
    bench.run();
    bench.set_m(0, 0, true);
    bench.run();
    assert_eq!(bench.cpu.bit_memory()[20] & 7, 0b111, "both run");
    assert_eq!(bench.cpu.bit_memory()[22..34], [0, 0, 3, 0xE8, 0, 0, 3, 0xE8, 0, 0, 0, 0], "the second one");
}

/// A jump to the first statement does not ask anew.
#[test]
fn initial_call_is_true_in_the_first_cycle_alone() {
    let source = "ORGANIZATION_BLOCK OB 1 VAR_INPUT Initial_Call : BOOL; END_VAR
         BEGIN m1: L MB 20; INC 1; T MB 20; U #Initial_Call; R #Initial_Call; SPB m1; END_ORGANIZATION_BLOCK";
    let mut bench = bench(source, &[]);
    bench.run();
    assert_eq!(bench.mb(20), 2, "the first cycle");
    bench.run();
    assert_eq!(bench.mb(20), 3, "the second one");
}
