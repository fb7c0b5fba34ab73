//! What statements of SCL mean: each row is run on the reference engine.

use ob1_cpu::{Command, Cpu, CpuConfig, engine, system_blocks};
use ob1_stl::{Library, Options, Source};

use crate::common::{Still, result, run, table, tia};

const INTS: &str = "a, b, c : INT; d : DINT;";
const fn real(value: f32) -> u32 {
    value.to_bits()
}

#[test]
fn the_example_compiles_beside_stl() {
    let scl = include_str!("../../../../examples/mixing-tank/mixing-tank.scl");
    let stl =
        "FUNCTION FC 90 : VOID\nBEGIN\nCALL FC 10 (raw := MW 10, full := 5.0e2, RET_VAL := MD 12);\nEND_FUNCTION\n";
    let mut library = Library::new();
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    let sources = [Source::new("tank.scl", scl.as_bytes()), Source::new("main.awl", stl.as_bytes())];
    let output = ob1_scl::compile(&sources, &library, &Options::default());
    assert!(output.is_good(), "{}", ob1_stl::render_all(&output.diagnostics, &sources));
    assert_eq!(output.program.blocks.len(), 4);
    let external = |id| library.get(id).map(|block| &block.interface);
    assert!(ob1_ir::verify(&output.program, &external).is_ok());
}

#[test]
fn precedence() {
    table(&[
        (INTS, "a := 2; MD100 := DINT_TO_DWORD(a + 3 * 4);", 14),
        ("r : REAL;", "r := -2 ** 2; MD100 := REAL_TO_DWORD(r);", real(-4.0)),
        ("x, y : BOOL;", "x := FALSE; y := TRUE; M103.0 := NOT x = y;", 1),
        ("x, y, z : BOOL;", "x := TRUE; y := TRUE; z := FALSE; M103.0 := x OR y AND z;", 1),
        ("x, y, z : BOOL;", "x := TRUE; y := TRUE; M103.0 := x XOR y OR x;", 1),
        (INTS, "b := 1; c := 2; M103.0 := TRUE = b < c;", 1),
        (INTS, "a := 20; MD100 := DINT_TO_DWORD(a - 5 - 3);", 12),
        (INTS, "a := 20; MD100 := DINT_TO_DWORD(a / 3 MOD 4);", 2),
    ]);
}

#[test]
fn constants_take_the_type_of_their_place() {
    table(&[
        ("x : DWORD;", "x := 16#FFFF0000; M103.0 := x <> 0;", 1),
        ("r : REAL;", "r := 10; MD100 := REAL_TO_DWORD(r);", real(10.0)),
        ("b : BOOL;", "b := 1; M103.0 := b;", 1),
        ("x : BYTE;", "x := 16#F3; MB103 := x AND 2#1111;", 3),
        ("t : TIME;", "t := T#1s500ms; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));", 1500),
        (INTS, "d := 100000; MD100 := DINT_TO_DWORD(d);", 100_000),
    ]);
}

#[test]
fn conversions() {
    table(&[
        (INTS, "a := -1; MD100 := INT_TO_DWORD(a);", 0xFFFF),
        (INTS, "a := -1; MD100 := DINT_TO_DWORD(INT_TO_DINT(a));", u32::MAX),
        ("x : WORD;", "x := 16#FFFF; MD100 := DINT_TO_DWORD(WORD_TO_DINT(x));", 0xFFFF),
        ("x : DWORD;", "x := 16#12345678; MB103 := DWORD_TO_BYTE(x);", 0x78),
        ("r : REAL;", "r := 2.5; MD100 := DINT_TO_DWORD(REAL_TO_DINT(r));", 2),
        ("r : REAL;", "r := 3.5; MD100 := DINT_TO_DWORD(ROUND(r));", 4),
        ("r : REAL;", "r := -3.7; MD100 := DINT_TO_DWORD(TRUNC(r));", 0xFFFF_FFFD),
        (
            "x : DWORD; r : REAL;",
            "x := 16#3F800000; r := DWORD_TO_REAL(x); MD100 := REAL_TO_DWORD(r + 1.0);",
            real(2.0),
        ),
        ("x : BOOL;", "x := TRUE; MD100 := x;", 1),
        ("r : REAL; a : INT;", "a := 7; r := a; MD100 := REAL_TO_DWORD(r);", real(7.0)),
        ("x : BYTE;", "x := 16#F0; MD100 := DINT_TO_DWORD(BYTE_TO_INT(x) + 1);", 0xF1),
        ("d : DATE;", "d := D#1990-1-11; MD100 := DINT_TO_DWORD(DATE_TO_DINT(d));", 10),
    ]);
}

#[test]
fn whole_numbers_wrap_and_divide_toward_zero() {
    table(&[
        (INTS, "a := 32767; a := a + 1; MW102 := INT_TO_WORD(a);", 0x8000),
        (INTS, "a := -7; b := a / 2; MW102 := INT_TO_WORD(b);", 0xFFFD),
        (INTS, "a := -7; b := a MOD 3; MW102 := INT_TO_WORD(b);", 0xFFFF),
        (INTS, "a := -32768; b := ABS(a); MW102 := INT_TO_WORD(b);", 0x8000),
        (INTS, "a := 300; b := 300; d := a * b; MD100 := DINT_TO_DWORD(d);", 24_464),
    ]);
}

#[test]
fn loops_and_choices() {
    table(&[
        (INTS, "d := 0; FOR a := 1 TO 10 DO d := d + a; END_FOR; MD100 := DINT_TO_DWORD(d + a * 1000);", 11_055),
        (INTS, "b := 3; d := 0; FOR a := 1 TO b DO b := 9; d := d + 1; END_FOR; MD100 := DINT_TO_DWORD(d);", 3),
        (INTS, "d := 0; FOR a := 5 TO 1 BY -2 DO d := d * 10 + a; END_FOR; MD100 := DINT_TO_DWORD(d);", 531),
        (INTS, "c := -1; d := 0; FOR a := 3 TO 1 BY c DO d := d * 10 + a; END_FOR; MD100 := DINT_TO_DWORD(d);", 321),
        (
            INTS,
            "d := 0; FOR a := 1 TO 9 DO IF a = 3 THEN CONTINUE; END_IF; IF a = 5 THEN EXIT; END_IF; d := d + a;
                END_FOR; MD100 := DINT_TO_DWORD(d);",
            7,
        ),
        (INTS, "a := 5; WHILE a > 2 DO a := a - 1; END_WHILE; MD100 := DINT_TO_DWORD(a);", 2),
        (INTS, "a := 0; REPEAT a := a + 1; UNTIL a >= 4 END_REPEAT; MD100 := DINT_TO_DWORD(a);", 4),
        (
            INTS,
            "a := 7; CASE a OF 1, 2: d := 1; 5..9: d := 2; 7: d := 3; ELSE d := 4; END_CASE;
                MD100 := DINT_TO_DWORD(d);",
            2,
        ),
        (INTS, "a := -3; CASE a OF -5..-1: d := 1; ELSE: d := 4; END_CASE; MD100 := DINT_TO_DWORD(d);", 1),
        (INTS, "a := 1; GOTO out; a := 2; out: MD100 := DINT_TO_DWORD(a);", 1),
        (INTS, "MD100 := 5; RETURN; MD100 := 6;", 5),
    ]);
}

#[test]
fn functions() {
    table(&[
        (INTS, "MD100 := DINT_TO_DWORD(SEL(G := FALSE, IN0 := 3, IN1 := 4));", 3),
        (INTS, "a := 5; MD100 := DINT_TO_DWORD(LIMIT(MN := 1, IN := a, MX := 3));", 3),
        (INTS, "a := 5; MD100 := DINT_TO_DWORD(LIMIT(MN := 9, IN := a, MX := 3));", 9),
        (INTS, "a := 5; MD100 := DINT_TO_DWORD(MAX(IN1 := a, IN2 := 8) - MIN(IN1 := a, IN2 := 8));", 3),
        (INTS, "a := 2; MD100 := DINT_TO_DWORD(MUX(K := a, IN0 := 10, IN1 := 11, IN2 := 12));", 12),
        (INTS, "a := 7; MD100 := DINT_TO_DWORD(MUX(K := a, IN0 := 10, IN1 := 11));", 11),
        ("x : WORD; n : INT;", "x := 16#8001; n := 1; MW102 := SHL(IN := x, N := n);", 2),
        ("x : WORD; n : INT;", "x := 16#8001; n := 16; MW102 := SHR(IN := x, N := n);", 0),
        ("x : WORD; n : INT;", "x := 16#8001; n := 17; MW102 := ROL(IN := x, N := n);", 3),
        ("x : BYTE; n : INT;", "x := 16#81; n := 1; MB103 := ROR(IN := x, N := n);", 0xC0),
        ("x : BYTE;", "x := 16#81; MB103 := SHL(IN := x, N := 1);", 2),
        ("x : BYTE;", "x := 16#0F; MB103 := NOT x;", 0xF0),
        ("r : REAL;", "r := 2.0; MD100 := REAL_TO_DWORD(SQRT(r + 7.0));", real(3.0)),
        ("t : TOD;", "t := TOD#23:59:59; t := t + T#2s; MD100 := DINT_TO_DWORD(TOD_TO_DINT(t));", 1000),
        ("t : TIME;", "t := T#10s * 3 - T#1s; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));", 29_000),
        (INTS, "MD100 := DINT_TO_DWORD(BCD_TO_INT(16#123));", 123),
    ]);
}

#[test]
fn addresses_arrays_and_views() {
    table(&[
        (INTS, "a := 102; MW[a] := 16#1234;", 0x1234),
        (INTS, "a := 103; b := 2; MX[a, b] := TRUE;", 4),
        (
            "x : ARRAY[1..4] OF INT; i : INT;",
            "FOR i := 1 TO 4 DO x[i] := i * i; END_FOR; MW102 := INT_TO_WORD(x[3]);",
            9,
        ),
        (
            "x : ARRAY[0..2, 1..2] OF INT; i, k : INT;",
            "FOR i := 0 TO 2 DO FOR k := 1 TO 2 DO x[i, k] := i * 10 + k; END_FOR; END_FOR; MW102 := INT_TO_WORD(x[2, 1]);",
            21,
        ),
        ("x : DWORD; y AT x : ARRAY[0..31] OF BOOL;", "x := 0; y[24] := TRUE; MD100 := x;", 1),
        ("x : DWORD; y AT x : STRUCT a, b, c, d : BYTE; END_STRUCT;", "x := 16#01020304; MB103 := y.b;", 2),
        ("x : WORD;", "x := 16#1234; MB103 := x.%B0;", 0x34),
        (
            "x : STRUCT a : INT; b : ARRAY[0..1] OF BOOL; END_STRUCT; i : INT;",
            "i := 1; x.b[i] := TRUE; M103.1 := x.b[1];",
            2,
        ),
    ]);
}

#[test]
fn texts() {
    table(&[
        ("s : STRING[10];", "s := 'abc'; MD100 := DINT_TO_DWORD(LEN(s));", 3),
        ("s, t : STRING[4];", "s := 'abc'; t := ''; t := CONCAT(IN1 := s, IN2 := 'def'); M103.0 := t = 'abcd';", 1),
        ("s : STRING[4]; t : STRING[20];", "t := 'abcdefgh'; s := t; MD100 := DINT_TO_DWORD(LEN(s));", 4),
        ("s : STRING[8];", "s := 'b'; M103.0 := s > 'a'; M103.1 := s <> 'b';", 1),
        ("s : STRING[8]; i : INT;", "s := 'xyz'; i := 2; MB103 := CHAR_TO_BYTE(s[i]);", 0x79),
    ]);
}

#[test]
fn both_sides_of_and_are_evaluated() {
    let count = "FUNCTION FC501 : BOOL VAR_INPUT x : BOOL; END_VAR BEGIN MW102 := INT_TO_WORD(WORD_TO_INT(MW102) + 1);
        FC501 := x; END_FUNCTION";
    let mut cpu = run(count, "a : BOOL;", "a := FC501(FALSE) AND FC501(x := TRUE);");
    assert_eq!(result(&mut cpu), 2);
}

#[test]
fn calls() {
    let blocks =
        "FUNCTION FC501 : INT VAR_INPUT a : INT; END_VAR VAR_IN_OUT s : INT; END_VAR VAR_OUTPUT o : INT; END_VAR
        BEGIN a := a + 1; s := s + a; o := a * 2; FC501 := a; END_FUNCTION
        FUNCTION_BLOCK FB1 VAR_INPUT a : INT := 5; END_VAR VAR_OUTPUT q : INT; END_VAR VAR n : INT; END_VAR
        BEGIN n := n + a; q := n; END_FUNCTION_BLOCK
        FUNCTION_BLOCK FB2 VAR one : FB1; END_VAR VAR_OUTPUT q : INT; END_VAR
        BEGIN one(a := 3); one(); q := one.q; END_FUNCTION_BLOCK";
    for (statements, expected) in [
        (
            "x := 1; y := 10; r := FC501(a := x, s := y, o := z); MD100 := DINT_TO_DWORD(r + y * 10 + z * 1000 + x * 10000);",
            14_122,
        ),
        ("FB1.DB5(a := 2); FB1.DB5(); MD100 := DINT_TO_DWORD(DB5.q);", 4),
        ("FB2.DB6(); MD100 := DINT_TO_DWORD(DB6.q);", 6),
        ("r := 1; FB1.DB5(a := 2, q => r); MD100 := DINT_TO_DWORD(r);", 2),
        ("y := 0; x := 0; r := FC501(EN := FALSE, a := x, s := y, o := z); M103.0 := ENO;", 0),
    ] {
        let mut cpu = run(blocks, "x, y, z, r : INT;", statements);
        assert_eq!(result(&mut cpu), expected, "{statements}");
    }
}

#[test]
fn ok_follows_calculations_with_the_option() {
    for (option, expected) in [("'y'", 0), ("'n'", 1)] {
        let block = format!(
            "{{SCL_SetOKFlag := {option}}} FUNCTION FC501 : INT VAR_INPUT a : INT; END_VAR BEGIN FC501 := a + 1; END_FUNCTION"
        );
        let mut cpu = run(&block, "r : INT;", "r := FC501(a := 32767); M103.0 := ENO;");
        assert_eq!(result(&mut cpu), expected, "{option}");
    }
}

#[test]
fn unsigned_numbers_of_tia_portal() {
    const UNSIGNED: &str = "a, b : UInt; s : USInt; d, e : UDInt; i : Int; n : DInt; r : Real; x : Bool;";
    for (statements, expected) in [
        ("#a := 65535; #b := #a + 2; MW102 := #b;", 1),
        ("#a := 60000; #n := UINT_TO_DINT(#a / 7); MD100 := DINT_TO_DWORD(#n);", 8571),
        ("#a := 60000; #n := #a MOD 7; MD100 := DINT_TO_DWORD(#n);", 3),
        ("#a := 60000; #b := 5; M103.0 := #a > #b;", 1),
        ("#a := 60000; #i := -1; M103.0 := #a > #i;", 1),
        ("#d := 16#F000_0000; #e := 1; M103.0 := #d > #e;", 1),
        ("#d := 16#F000_0000; MD100 := #d + 16#10;", 0xF000_0010),
        ("#s := 250; #s := #s + 10; MB103 := #s;", 4),
        ("#a := 40000; #r := #a * 0.5; MD100 := REAL_TO_DWORD(#r);", real(20_000.0)),
        ("#a := 40000; #b := 3; #a := MAX(IN1 := #a, IN2 := #b); MW102 := #a;", 40_000),
        ("#d := 0; FOR #a := 1 TO 4 DO #d += #a; END_FOR; MD100 := #d;", 10),
        ("#d := 0; FOR #a := 40000 TO 40002 DO #d += 1; END_FOR; MD100 := #d;", 3),
        ("#a := 7; #i := #a; MW102 := #i;", 7),
        ("#r := 2.6; #a := REAL_TO_UINT(#r); MW102 := #a;", 3),
    ] {
        assert_eq!(tia(UNSIGNED, statements), expected, "{statements}");
    }
}

#[test]
fn memory_by_numbers() {
    for (statements, expected) in [
        ("#i := 102; POKE(area := 16#83, dbNumber := 0, byteOffset := #i, value := #w);", 0x1234),
        ("MB50 := 16#77; #i := 50; MB103 := PEEK(area := 16#83, dbNumber := 0, byteOffset := #i);", 0x77),
        ("MW50 := 16#1234; MW102 := PEEK_WORD(area := 16#83, dbNumber := 0, byteOffset := 50);", 0x1234),
        ("POKE_BOOL(area := 16#83, dbNumber := 0, byteOffset := 103, bitOffset := #k, value := TRUE);", 8),
        ("MB50 := 8; M103.0 := PEEK_BOOL(area := 16#83, dbNumber := 0, byteOffset := 50, bitOffset := #k);", 1),
    ] {
        let statements = format!("#w := 16#1234; #k := 3; {statements}");
        assert_eq!(tia("i, k : Int; w : Word;", &statements), expected, "{statements}");
    }
}

#[test]
fn classic_blocks_calculate_with_signed_numbers_only() {
    let text = "FUNCTION FC1 : VOID VAR w : WORD; END_VAR BEGIN w := w + w; END_FUNCTION\n";
    let output = ob1_scl::compile(&[Source::new("p.scl", text.as_bytes())], &Library::new(), &Options::default());
    assert_eq!(output.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["S2202"]);
}

#[test]
fn the_ok_flag_of_conversions_and_shifts() {
    for (declared, statement, ok) in [
        ("d : DINT; i : INT;", "d := 40000; i := DINT_TO_INT(d);", 0),
        ("d : DINT; i : INT;", "d := -40; i := DINT_TO_INT(d);", 1),
        ("i : INT; b : BYTE;", "i := 256; b := INT_TO_BYTE(i);", 0),
        ("i : INT; b : BYTE;", "i := 255; b := INT_TO_BYTE(i);", 1),
        ("w : DWORD; b : BYTE;", "w := DW#16#10000; b := DWORD_TO_BYTE(w);", 0),
        ("w : DWORD; v : WORD;", "w := DW#16#10000; v := DWORD_TO_WORD(w);", 0),
        ("w : DWORD; v : WORD;", "w := DW#16#FFFF; v := DWORD_TO_WORD(w);", 1),
        ("w : DWORD; x : BOOL;", "w := DW#16#2; x := DWORD_TO_BOOL(w);", 0),
        ("d : DINT; t : TOD;", "d := 86400000; t := DINT_TO_TOD(d);", 0),
        ("d : DINT; t : TOD;", "d := 86399999; t := DINT_TO_TOD(d);", 1),
        ("d : DINT; t : DATE;", "d := 65536; t := DINT_TO_DATE(d);", 0),
        ("r : REAL; d : DINT;", "r := 1.0E20; d := REAL_TO_DINT(r);", 0),
        ("r : REAL; i : INT;", "r := 40000.0; i := REAL_TO_INT(r);", 0),
        ("r : REAL; i : INT;", "r := -7.5; i := REAL_TO_INT(r);", 1),
        ("w : WORD; n : INT;", "n := -1; w := SHL(IN := w, N := n);", 0),
        ("w : DWORD; n : INT;", "n := 40; w := SHR(IN := w, N := n);", 1),
        ("i : INT;", "i := 32767; i := i + 1;", 0),
        ("i, k : INT;", "i := 5; k := 0; i := i / k;", 0),
        ("r : REAL;", "r := -1.0; r := SQRT(r);", 0),
        ("i : INT;", "i := -32768; i := ABS(i);", 0),
    ] {
        let block = format!(
            "{{SCL_SetOKFlag := 'y'}} FUNCTION FC501 : VOID VAR {declared} END_VAR BEGIN {statement} END_FUNCTION"
        );
        let mut cpu = run(&block, "", "FC501(); M103.0 := ENO;");
        assert_eq!(result(&mut cpu), ok, "{statement}");
    }
}

#[test]
fn real_constants_of_a_product_are_one() {
    table(&[
        (
            "r : REAL;",
            "r := 3.0; MD100 := REAL_TO_DWORD(r * 0.1 * 0.1);",
            real(3.0 * (0.1f32 as f64 * 0.1f32 as f64) as f32),
        ),
        ("r : REAL;", "r := 7.0; MD100 := REAL_TO_DWORD(1 / r * 1000);", real(1000.0 / 7.0)),
        ("r : REAL;", "r := -7.0; MD100 := REAL_TO_DWORD(r ** 2);", real(49.0)),
        ("r : REAL;", "r := -7.0; MD100 := REAL_TO_DWORD(r ** 1);", real(-7.0)),
        ("r : REAL;", "r := -8.0; r := r ** 3; M103.0 := r = r;", 0),
    ]);
}

/// A function of STL that leaves another address in AR2 does not take a function block its instance.
#[test]
fn address_register_2_is_kept() {
    let scl = "FUNCTION_BLOCK FB1 VAR x : INT; END_VAR BEGIN x := 1; FC2(); x := x + 1; MW102 := INT_TO_WORD(x); END_FUNCTION_BLOCK
        ORGANIZATION_BLOCK OB1 VAR_TEMP i : ARRAY[0..19] OF BYTE; END_VAR BEGIN FB1.DB1(); END_ORGANIZATION_BLOCK\n";
    let stl = "FUNCTION FC 2 : VOID\nBEGIN\nLAR2 P#500.0;\nEND_FUNCTION\n";
    let sources = [Source::new("p.scl", scl.as_bytes()), Source::new("p.awl", stl.as_bytes())];
    let output = ob1_scl::compile(&sources, &Library::new(), &Options::default());
    assert!(output.is_good(), "{}", ob1_stl::render_all(&output.diagnostics, &sources));
    let cpu = Cpu::new(CpuConfig::default(), &output.program, Vec::new(), Vec::new(), engine::REFERENCE);
    let mut cpu = cpu.expect("it loads");
    cpu.request(Command::Run);
    cpu.cycle(&mut Still);
    assert_eq!(result(&mut cpu), 2);
}

/// Without the IEC library texts are assigned by SFC 20, cut to their length.
#[test]
fn texts_without_the_iec_library() {
    let text = "ORGANIZATION_BLOCK OB1 VAR_TEMP i : ARRAY[0..19] OF BYTE; a : STRING[9]; b : STRING[3]; END_VAR
        BEGIN a := 'abcdef'; b := a; MB102 := CHAR_TO_BYTE(b[3]); MB103 := 0; END_ORGANIZATION_BLOCK\n";
    let mut library = Library::new();
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    let source = Source::new("p.scl", text.as_bytes());
    let output = ob1_scl::compile(std::slice::from_ref(&source), &library, &Options::default());
    assert!(output.is_good(), "{}", ob1_stl::render_all(&output.diagnostics, &[source]));
    let cpu = Cpu::new(CpuConfig::default(), &output.program, system_blocks(), Vec::new(), engine::REFERENCE);
    let mut cpu = cpu.expect("it loads");
    cpu.request(Command::Run);
    cpu.cycle(&mut Still);
    assert_eq!(result(&mut cpu), 0x6300);
}

/// A standard function stands before a block of the library with its name, one of the program before both.
#[test]
fn whose_function_is_called() {
    let mut cpu = run("", INTS, "a := 3; b := 5; MW102 := INT_TO_WORD(MAX(IN1 := a, IN2 := b));");
    assert_eq!(result(&mut cpu), 5, "FC 25 of the library takes and gives ANY");
    let own = "FUNCTION \"MAX\" : INT VAR_INPUT IN1, IN2 : INT; END_VAR BEGIN \"MAX\" := 77; END_FUNCTION";
    let mut cpu = run(own, INTS, "MW102 := INT_TO_WORD(MAX(IN1 := 3, IN2 := 5));");
    assert_eq!(result(&mut cpu), 77);
}

#[test]
fn timers_and_counters_as_functions() {
    let count = "x := TRUE; w := S_CUD(C_NO := C3, CU := x, S := x, PV := W#16#12, CV := v, Q := q);";
    table(&[
        ("x, q : BOOL; v, w : WORD;", &format!("{count} MW102 := w;"), 0x12),
        ("x, q : BOOL; v, w : WORD;", &format!("{count} MW102 := v;"), 12),
        ("x, q : BOOL; v, w : WORD;", &format!("{count} M103.0 := q;"), 1),
        ("x : BOOL; w : WORD;", "x := TRUE; w := S_CD(C_NO := C3, S := x, PV := W#16#12, R := x); MW102 := w;", 0),
        (
            "x, q : BOOL; w : WORD;",
            "x := TRUE; S_PULSE(T_NO := T5, S := x, TV := S5T#2s, BI := w, Q := q); MW102 := w;",
            200,
        ),
        (
            "x, q : BOOL; t : S5TIME;",
            "x := TRUE; t := S_ODT(T_NO := T5, S := x, TV := S5T#2s, Q := q); M103.0 := q OR t = S5T#0s;",
            0,
        ),
    ]);
}

/// What `ob1 new station --language scl` writes.
#[test]
fn the_program_of_a_new_station_compiles() {
    let symbols = include_str!("../../../../runtime/ob1/src/new/station/symbols.sdf.in");
    let symbols = ob1_stl::read_symbols(&Source::new("symbols.sdf", symbols.as_bytes())).symbols;
    let text = include_str!("../../../../runtime/ob1/src/new/station/main.scl.in");
    let source = Source::new("main.scl", text.as_bytes());
    let options = Options { symbols, lints: true, ..Options::default() };
    let output = ob1_scl::compile(std::slice::from_ref(&source), &Library::new(), &options);
    assert_eq!(ob1_stl::render_all(&output.diagnostics, &[source]), "");
    let lines: std::collections::BTreeSet<u32> = output.program.blocks[0].code.iter().map(|s| s.line).collect();
    assert!([10, 11, 13, 17, 20, 21, 23].iter().all(|line| lines.contains(line)), "{lines:?}");
}
