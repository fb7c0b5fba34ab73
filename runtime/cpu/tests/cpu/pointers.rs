//! POINTER, ANY and the composed in/outs of function blocks: what arrives, what is reached through them, and the
//! program of the compiler's own pointer tests run to its end.

use crate::common::source::bench;
use crate::common::{Bench, on_each_engine};

/// Bytes of bit memory as hexadecimal digits.
fn hex(bench: &Bench, at: usize, len: usize) -> String {
    bench.cpu.bit_memory()[at..at + len].iter().map(|b| format!("{b:02X}")).collect()
}

/// What calls: an FB with statics, temps, an ANY and a POINTER of its own; what is called stores the bytes it was
/// given.
fn pointer_program(callee: &str, call: &str, formal: &str, actual: &str) -> String {
    let store = |width: &str, at: u32| format!("L {width} [AR1,P#{at}.0]; T M{width} {};", 20 + at);
    let bytes = if formal == "ANY" {
        ["D", "D", "W"].iter().zip([0, 4, 8]).map(|(w, at)| store(w, at)).collect::<String>()
    } else {
        ["W", "D"].iter().zip([0, 2]).map(|(w, at)| store(w, at)).collect()
    };
    // In an FB the parameter's address is relative to the instance, which begins at 0 in DB 5.
    let begin = if callee.starts_with("FUNCTION_BLOCK") { "LAR1 P##p;" } else { "L P##p; LAR1;" };
    format!(
        "{callee} VAR_INPUT p : {formal}; END_VAR BEGIN {begin} {bytes} {end}
         FUNCTION_BLOCK FB 6
         VAR_INPUT any : ANY; ptr : POINTER; END_VAR
         VAR_IN_OUT io : STRUCT a : INT; b : ARRAY[0..3] OF INT; END_STRUCT; END_VAR
         VAR pad : INT; s : INT; str : STRUCT a : INT; b : REAL; END_STRUCT; END_VAR
         VAR_TEMP pad2 : INT; t : WORD; bits : ARRAY[0..15] OF BOOL; own : ANY; END_VAR
         BEGIN LAR1 P##own; L DW#16#10020003; T D [AR1,P#0.0]; L W#16#A; T W [AR1,P#4.0];
         L P#DBX 7.0; T D [AR1,P#6.0]; AUF DB 10; {call} (p := {actual}); END_FUNCTION_BLOCK
         DATA_BLOCK DB 6 FB 6 BEGIN END_DATA_BLOCK
         DATA_BLOCK DB 10 STRUCT w : WORD; x : BOOL; y : BOOL; str : STRUCT a : INT; b : REAL; END_STRUCT; END_STRUCT
         BEGIN END_DATA_BLOCK
         {data}
         ORGANIZATION_BLOCK OB 1 BEGIN
         CALL FB 6 , DB 6 (any := P#DB10.DBX 2.0 BYTE 4, ptr := P#DB10.DBX 3.1, io := P#DB10.DBX 4.0);
         END_ORGANIZATION_BLOCK",
        end = if callee.starts_with("FUNCTION_BLOCK") { "END_FUNCTION_BLOCK" } else { "END_FUNCTION" },
        data = if callee.starts_with("FUNCTION_BLOCK") { "DATA_BLOCK DB 5 FB 5 BEGIN END_DATA_BLOCK" } else { "" },
    )
}

#[test]
fn the_bytes_of_a_pointer_and_of_an_any() {
    on_each_engine(|| {
        // FB 6's instance: any 0.0, ptr 10.0, io 16.0, pad 22.0, s 24.0, str 26.0.
        for (actual, pointer, any) in [
            ("M 3.5", "000083000 01D", "1001000100008300001D"),
            ("MB 3", "000083000018", "10020001000083000018"),
            ("EW 4", "000081000020", "10040001000081000020"),
            ("AD 8", "000082000040", "10060001000082000040"),
            ("PEW 256", "000080000800", "10040001000080000800"),
            ("DB10.DBX 2.1", "000A84000011", "1001000 1000A84000011"),
            ("DB10.w", "000A84000000", "1004000 1000A84000000"),
            ("DB10.y", "000A84000011", "10010001000A84000011"),
            ("DB10.str", "000A84000020", "10020006000A84000020"),
            ("P#DB10.DBX 2.0", "000A84000010", ""),
            ("P#M 4.0 BYTE 10", "", "1002000A000083000020"),
            ("P#DB10.DBX 0.0 WORD 3", "", "10040003000A84000000"),
            ("#t", "000087000010", "10040001000087000010"),
            ("#bits", "000087000020", "10020002000087000020"),
            ("#s", "0006840000C0", "10050001000684 0000C0"),
            ("#str", "0006840000D0", "100200060006840000D0"),
            ("#str.b", "0006840000E0", "100800010006840000E0"),
            ("#io.b[2]", "000A84000050", "10050001000A84000050"),
            ("#io", "000A84000020", "1002000A000A84000020"),
            ("#ptr", "000A84000019", ""),
            ("#any", "", "10020004000A84000010"),
            ("#own", "", "10020003000A84000038"),
            ("DB 10", "000A84000000", "10190001000019 00000A"),
            ("T 5", "", "101D000100001D000005"),
            ("Z 6", "", "101C000100001C000006"),
        ] {
            for (formal, expected) in [("POINTER", pointer), ("ANY", any)] {
                let expected = expected.replace(' ', "");
                if expected.is_empty() {
                    continue;
                }
                for (callee, call) in
                    [("FUNCTION FC 5 : VOID", "CALL FC 5"), ("FUNCTION_BLOCK FB 5", "CALL FB 5 , DB 5")]
                {
                    let mut bench = bench(&pointer_program(callee, call, formal, actual), &[]);
                    bench.run();
                    assert_eq!(hex(&bench, 20, expected.len() / 2), expected, "{actual} for {formal} of {call}");
                }
            }
        }
    });
}

/// A composed in/out passed on from FB to FB, to a multi-instance, to an FC, to a system function: the innermost block
/// adds to the words of the actual, wherever that lies.
#[test]
fn a_composed_in_out_handed_on() {
    on_each_engine(|| {
        let text = "
            TYPE UDT 5 STRUCT a : INT; list : ARRAY [1..3] OF DINT; on : BOOL; END_STRUCT END_TYPE
            FUNCTION FC 30 : VOID
            VAR_INPUT i : UDT 5; END_VAR VAR_OUTPUT o : INT; END_VAR VAR_IN_OUT x : UDT 5; END_VAR
            BEGIN L #i.a; T #o; L #x.list[2]; + L#100; T #x.list[2]; SET; S #x.on; END_FUNCTION
            FUNCTION_BLOCK FB 30
            VAR_IN_OUT p : UDT 5; END_VAR
            BEGIN L #p.a; + 1; T #p.a; L #p.list[2]; + L#10; T #p.list[2]; SET; = #p.on; END_FUNCTION_BLOCK
            FUNCTION_BLOCK FB 31
            VAR_IN_OUT pad : UDT 5; io : UDT 5; END_VAR
            VAR sub : FB 30; many : ARRAY [1..3] OF FB 30; copy : UDT 5; err : INT; END_VAR
            VAR_TEMP t : INT; END_VAR
            BEGIN {body} END_FUNCTION_BLOCK
            DATA_BLOCK DB 30 FB 30 BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 31 FB 31 BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 50 STRUCT gap : WORD; u : UDT 5; END_STRUCT BEGIN END_DATA_BLOCK
            FUNCTION_BLOCK FB 32
            VAR s : UDT 5; f : FB 31; END_VAR VAR_TEMP gap : WORD; t : UDT 5; END_VAR
            BEGIN L MW 100; T {actual}.a; L MD 104; T {actual}.list[2]; R {actual}.on;
            CALL #f (pad := DB50.u, io := {actual}); L {actual}.a; T MW 110; L {actual}.list[2]; T MD 112; U {actual}.on;
            = M 116.0; END_FUNCTION_BLOCK
            DATA_BLOCK DB 32 FB 32 BEGIN END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN CALL FB 32 , DB 32; END_ORGANIZATION_BLOCK";
        for (body, a, second, on) in [
            ("L #io.a; + 1; T #io.a; L #io.list[2]; + L#1; T #io.list[2]; SET; S #io.on;", 8, 21, true),
            ("CALL FB 30 , DB 30 (p := #io);", 8, 30, true),
            ("CALL #sub (p := #io);", 8, 30, true),
            ("CALL #many[3] (p := #io); CALL #many[1] (p := #io);", 9, 40, true),
            ("CALL FC 30 (i := #io, o := #io.a, x := #io);", 7, 120, true),
            ("CALL FC 30 (i := #io, o := #t, x := #io); L #t; + 3; T #io.a;", 10, 120, true),
            (
                "CALL SFC 20 (SRCBLK := #io, RET_VAL := #err, DSTBLK := #copy); L #copy.a; + 5; T #copy.a; SET; = #copy.on;
                 CALL SFC 20 (SRCBLK := #copy, RET_VAL := #err, DSTBLK := #io);",
                12,
                20,
                true,
            ),
            ("CALL SFC 20 (SRCBLK := #io.list[2], RET_VAL := #err, DSTBLK := #t); L 4; T #io.a;", 4, 20, false),
        ] {
            // A temp reaches one call deep, as on the hardware: the area V is that of the direct caller.
            let own = !body.contains("CALL");
            for actual in ["DB50.u", "#s", if own { "#t" } else { "DB50.u" }] {
                let source = text.replace("{body}", body).replace("{actual}", actual);
                let mut bench = bench(&source, &[]);
                bench.run();
                bench.set(100, ob1_cpu::Width::Word, 7);
                bench.set(104, ob1_cpu::Width::DWord, 20);
                bench.run();
                let got = (bench.mw(110), bench.md(112), bench.m(116, 0));
                assert_eq!(got, (a, second, on), "{body} on {actual}");
            }
        }
    });
}

/// An ANY of a function's own handed to a system function: composed by hand in a temp, copied from a parameter, or
/// the parameter itself.
#[test]
fn an_any_put_together_by_hand() {
    on_each_engine(|| {
        let source = "
            FUNCTION FC 1 : VOID
            VAR_INPUT from : ANY; END_VAR
            VAR_TEMP gap : WORD; src : ANY; dst : ANY; err : INT; END_VAR
            BEGIN
            LAR1 P##src;
            L W#16#1002; T LW 2; L 4; T LW 4; L 10; T LW 6; L P#DBX 2.0; T LD 8;
            LAR1 P##dst;
            L W#16#1002; T W [AR1,P#0.0]; L 4; T W [AR1,P#2.0]; L 0; T W [AR1,P#4.0]; L P#M 20.0; T D [AR1,P#6.0];
            CALL SFC 20 (SRCBLK := #src, RET_VAL := #err, DSTBLK := #dst);
            L #err; T MW 10;
            CALL SFC 20 (SRCBLK := #from, RET_VAL := MW 12, DSTBLK := P#M 30.0 BYTE 4);
            // A parameter copied into a temp, moved on by one byte.
            L P##from; LAR1; L D [AR1,P#0.0]; T LD 2; L D [AR1,P#4.0]; T LD 6; L W [AR1,P#8.0]; T LW 10;
            L LD 8; L P#1.0; +D; T LD 8;
            CALL SFC 20 (SRCBLK := #src, RET_VAL := MW 14, DSTBLK := P#M 40.0 BYTE 4);
            END_FUNCTION
            DATA_BLOCK DB 10 STRUCT a : ARRAY[0..9] OF BYTE := B#16#0,B#16#1,B#16#2,B#16#3,B#16#4,B#16#5,B#16#6,B#16#7;
            END_STRUCT BEGIN END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN CALL FC 1 (from := P#DB10.DBX 3.0 BYTE 4); END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &[]);
        bench.run();
        assert_eq!((bench.mw(10), bench.mw(12), bench.mw(14)), (0, 0, 0));
        assert_eq!((bench.md(20), bench.md(30), bench.md(40)), (0x0203_0405, 0x0304_0506, 0x0405_0607));
    });
}

/// `P##` of a composed parameter of a function is a pointer into area V, whatever is supplied: programs look at it.
#[test]
fn a_composed_parameter_of_a_function_is_in_area_v() {
    on_each_engine(|| {
        let source = "
            FUNCTION FC 2 : VOID
            VAR_INPUT s : STRING[4]; a : ANY; p : POINTER; END_VAR
            BEGIN
            L P##s; LAR1; T MD 20; L W [AR1,P#0.0]; T MW 40; L D [AR1,P#2.0]; T MD 42; TAR1; T MD 24;
            LAR1 P##a; TAR1; T MD 28; L D [AR1,P#6.0]; T MD 46; L W [AR1,P#2.0]; T MW 50; U [AR1,P#3.0]; = M 52.0;
            L P##p; LAR1; T MD 32;
            END_FUNCTION
            FUNCTION FC 1 : VOID
            VAR_INPUT s : STRING[4]; a : ANY; END_VAR
            VAR_TEMP t : INT; u : STRING[4]; END_VAR
            BEGIN
            CALL FC 2 (s := #s, a := #a, p := P#M 3.0);
            L P##s; LAR1; T MD 36;
            END_FUNCTION
            DATA_BLOCK DB 10 STRUCT x : INT; s : STRING[4] := 'ab'; END_STRUCT BEGIN END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN
            CALL FC 1 (s := DB10.s, a := P#DB10.DBX 3.0 BYTE 257);
            END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &[]);
        bench.run();
        for at in [20, 24, 28, 32, 36] {
            assert_eq!(bench.md(at) >> 24, 0x87, "MD {at}");
        }
        assert_eq!((bench.mw(40), bench.md(42)), (10, 0x8400_0010));
        assert_eq!((bench.md(46), bench.mw(50), bench.m(52, 0)), (0x8400_0018, 257, true));
    });
}

/// `blocks/stl/tests/data/pointers.awl`, with the jumps around its code taken out, to its end.
#[test]
fn the_pointer_program_of_the_compiler_runs() {
    on_each_engine(|| {
        let text = include_str!("../../../../blocks/stl/tests/data/pointers.awl");
        let text = text.replace("  SPA end;\n", "").replace("  SPA m1;\n", "").replace("  SPB loop;\n", "");
        let source = format!(
            "{text}
            DATA_BLOCK DB 10 STRUCT b : ARRAY[0..9] OF BYTE; END_STRUCT BEGIN
            b[0] := B#16#A0; b[1] := B#16#A1; b[7] := B#16#A7; END_DATA_BLOCK
            DATA_BLOCK DB 50 STRUCT one : UDT 5; two : UDT 5; src : UDT 5; END_STRUCT BEGIN
            one.run := TRUE; one.speed := 40; one.name := 'one'; one.list[2] := L#222; one.list[3] := L#333;
            src.speed := 77; src.list[1] := L#11; END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN
            CALL FC 31 (any := P#DB50.DBX 0.0 BYTE 4, ptr := P#M 7.0);
            CALL FB 31, DB 43 (any := DB50.src, io := DB50.one, two := DB50.two);
            L DB42.n; T MW 60; L DB43.stat.speed; T MW 62;
            END_ORGANIZATION_BLOCK"
        );
        let mut bench = bench(&source, &[]);
        bench.run();
        assert_eq!(bench.mw(0), 0xA0A1, "FC 31: ten bytes of DB 10, of which four words fit");
        assert_eq!(bench.mb(7), 0xA7);
        // FB 31: io.speed becomes 41, two.speed what io had then, stat.speed 5; SFC 20 copies stat over io.
        let speed = |bench: &mut Bench, at| bench.dbw(50, at);
        assert_eq!((speed(&mut bench, 2), speed(&mut bench, 28)), (5, 41), "io has got what stat had; two what io had");
        assert_eq!(bench.dbw(50, 26) & 0x0100, 0x0100, "two.run");
        assert_eq!(bench.mw(2), 0, "x of the second FC 30: what d.speed was before q is copied back to stat.speed");
        assert_eq!((bench.mw(60), bench.mw(62)), (5, 5), "FB 30 on DB 42 has seen stat");
        assert_eq!(bench.dbw(43, 54), 77, "sub.n: what SFC 20 has copied from #any into the temp that is p of #sub");
        assert_eq!(bench.dbw(43, 70), 0, "many[2].n: DB 41");
        assert_eq!(bench.dbw(43, 80), 0, "err");
    });
}
