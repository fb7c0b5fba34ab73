//! Section 8 of the sheet: standard functions, but for texts and dates.

use crate::common::{compiled, real, refused, rows, rows_behind, tia_rows};

const ANY: &str = "a, b, k : INT; d : DINT; r, q : REAL; w : WORD; x : BOOL;";

#[test]
fn lines_1_and_2_numbers_and_choices() {
    rows(&[
        ("8.1 SQR", ANY, "r := -3.0; MD100 := REAL_TO_DWORD(SQR(r));", real(9.0)),
        ("8.1 SQRT", ANY, "r := 9.0; MD100 := REAL_TO_DWORD(SQRT(r));", real(3.0)),
        ("8.1 EXP", ANY, "r := 0.0; MD100 := REAL_TO_DWORD(EXP(r));", real(1.0)),
        ("8.1 EXPD", ANY, "r := 3.0; r := EXPD(r); M103.0 := ABS(r - 1000.0) < 0.01;", 1),
        ("8.1 LN", ANY, "r := 1.0; MD100 := REAL_TO_DWORD(LN(r));", real(0.0)),
        ("8.1 LOG", ANY, "r := 100.0; r := LOG(r); M103.0 := ABS(r - 2.0) < 0.0001;", 1),
        ("8.1 SIN", ANY, "r := 0.0; MD100 := REAL_TO_DWORD(SIN(r));", real(0.0)),
        ("8.1 COS", ANY, "r := 0.0; MD100 := REAL_TO_DWORD(COS(r));", real(1.0)),
        ("8.1 TAN", ANY, "r := 0.7853982; r := TAN(r); M103.0 := ABS(r - 1.0) < 0.0001;", 1),
        ("8.1 ASIN", ANY, "r := 1.0; r := ASIN(r); M103.0 := ABS(r - 1.570796) < 0.0001;", 1),
        ("8.1 ACOS", ANY, "r := 1.0; r := ACOS(r); M103.0 := ABS(r) < 0.0001;", 1),
        ("8.1 ATAN", ANY, "r := 1.0; r := ATAN(r); M103.0 := ABS(r - 0.7853982) < 0.0001;", 1),
        ("8.1 ABS of INT", ANY, "a := -5; MW102 := INT_TO_WORD(ABS(a));", 5),
        ("8.1 ABS of DINT", ANY, "d := -100000; MD100 := DINT_TO_DWORD(ABS(d));", 100_000),
        ("8.1 ABS of REAL", ANY, "r := -1.5; MD100 := REAL_TO_DWORD(ABS(r));", real(1.5)),
        ("8.2 SEL", ANY, "x := TRUE; MD100 := REAL_TO_DWORD(SEL(G := x, IN0 := 1.0, IN1 := 2.0));", real(2.0)),
        ("8.2 MUX", ANY, "k := 1; MW102 := INT_TO_WORD(MUX(K := k, IN0 := 10, IN1 := 20, IN2 := 30));", 20),
        (
            "8.2 MUX below its inputs: the last",
            ANY,
            "k := -1; MW102 := INT_TO_WORD(MUX(K := k, IN0 := 10, IN1 := 20));",
            20,
        ),
        (
            "8.2 MUX above its inputs: the last",
            ANY,
            "k := 2; MW102 := INT_TO_WORD(MUX(K := k, IN0 := 10, IN1 := 20));",
            20,
        ),
        (
            "8.2 MAX of DINT and INT",
            ANY,
            "a := 3; d := 70000; MD100 := DINT_TO_DWORD(MAX(IN1 := a, IN2 := d));",
            70_000,
        ),
        ("8.2 MIN of four", ANY, "a := 3; MW102 := INT_TO_WORD(MIN(IN1 := 9, IN2 := a, IN3 := 5, IN4 := 7));", 3),
        (
            "8.2 LIMIT of REAL",
            ANY,
            "r := 7.5; MD100 := REAL_TO_DWORD(LIMIT(MN := 0.0, IN := r, MX := 5.0));",
            real(5.0),
        ),
        (
            "8.2 MAX of TIME",
            "t : TIME;",
            "t := T#1s; MD100 := DINT_TO_DWORD(TIME_TO_DINT(MAX(IN1 := t, IN2 := T#2s)));",
            2000,
        ),
    ]);
    refused(
        "FC900",
        &[
            ("8.2 a parameter is missing", "a : INT;", "a := SEL(G := TRUE, IN0 := 1);", &["S2408"]),
            ("8.2 a parameter is empty", "a : INT;", "a := MAX(IN1 := , IN2 := 1);", &["S2408"]),
            ("8.2 one value", "a : INT;", "a := MAX(IN1 := 1);", &["S2408"]),
        ],
    );
}

#[test]
fn line_3_shifts_and_memory_of_tia_portal() {
    const TIA: &str = "w : Word; d : DWord; y : Byte; x : Bool; n : Int; u : UInt;";
    tia_rows(&[
        ("8.3 SHL_WORD", TIA, "#w := 16#8001; MD100 := SHL_WORD(IN := #w, N := 1);", 2),
        ("8.3 SHR_DWORD", TIA, "#d := 16#80000000; MD100 := SHR_DWORD(IN := #d, N := 4);", 0x0800_0000),
        ("8.3 ROL_BYTE", TIA, "#y := 16#81; MB103 := ROL_BYTE(IN := #y, N := 1);", 3),
        ("8.3 SWAP", TIA, "#w := 16#1234; MW102 := SWAP(#w);", 0x3412),
        ("8.3 SWAP_DWORD", TIA, "#d := 16#12345678; MD100 := SWAP_DWORD(#d);", 0x7856_3412),
        ("8.3 PEEK", TIA, "MB50 := 16#77; MB103 := PEEK(area := 16#83, dbNumber := 0, byteOffset := 50);", 0x77),
        ("8.3 PEEK_DWORD", TIA, "MD50 := 7; MD100 := PEEK_DWORD(area := 16#83, dbNumber := 0, byteOffset := 50);", 7),
        (
            "8.3 POKE_BOOL",
            TIA,
            "MD100 := 0; POKE_BOOL(area := 16#83, dbNumber := 0, byteOffset := 103, bitOffset := 2, value := TRUE);",
            4,
        ),
        (
            "8.3 POKE",
            TIA,
            "MD100 := 0; #w := 7; POKE(area := 16#83, dbNumber := 0, byteOffset := 102, value := #w);",
            7,
        ),
        (
            "8.3 MOD and / of UDINT",
            "a, b : UDInt;",
            "#a := 4000000000; #b := 7; MD100 := #a / #b * 10 + #a MOD #b;",
            571_428_571u32.wrapping_mul(10).wrapping_add(3),
        ),
        ("8.3 / of UDINT by a large one", "a, b : UDInt;", "#a := 4000000000; #b := 3000000000; MD100 := #a / #b;", 1),
        (
            "8.3 MOD of UDINT by a large one",
            "a, b : UDInt;",
            "#a := 4000000000; #b := 3000000000; MD100 := #a MOD #b;",
            1_000_000_000,
        ),
        (
            "8.3 / of UDINT by a larger one",
            "a, b : UDInt;",
            "#a := 5; #b := 3000000000; MD100 := #a / #b * 10 + #a MOD #b;",
            5,
        ),
        ("8.3 UDINT / 1", "a : UDInt;", "#a := 16#FFFFFFFF; MD100 := #a / 1;", u32::MAX),
        (
            "8.3 MAX of UDINT",
            "a, b : UDInt;",
            "#a := 4000000000; #b := 7; MD100 := MAX(IN1 := #a, IN2 := #b);",
            4_000_000_000,
        ),
        (
            "8.3 LIMIT of UDINT",
            "a : UDInt;",
            "#a := 4000000000; MD100 := LIMIT(MN := 1, IN := #a, MX := 3000000000);",
            3_000_000_000,
        ),
        (
            "8.3 UDINT beside REAL",
            "a : UDInt; r : Real;",
            "#a := 3000000000; #r := #a * 0.5; MD100 := REAL_TO_DWORD(#r);",
            real(1.5e9),
        ),
    ]);
}

#[test]
fn line_6_timers_and_counters() {
    // The state of the timer and counter is that of this call; times go on in the tests of the engine.
    rows(&[
        (
            "8.6 S_PULSE",
            "q, s : BOOL; t : S5TIME;",
            "s := TRUE; t := S_PULSE(T_NO := T1, S := s, TV := S5T#5s, Q := q); M103.0 := q; M103.1 := t = S5T#5s;",
            3,
        ),
        (
            "8.6 S_PEXT",
            "q, s : BOOL; w : WORD;",
            "s := TRUE; S_PEXT(T_NO := T1, S := s, TV := S5T#5s, BI := w, Q := q); M103.0 := q; M103.1 := w = 500;",
            3,
        ),
        ("8.6 S_ODT", "q, s : BOOL;", "s := TRUE; S_ODT(T_NO := T1, S := s, TV := S5T#5s, Q := q); M103.0 := q;", 0),
        (
            "8.6 S_ODTS",
            "q, s : BOOL; w : WORD;",
            "s := TRUE; S_ODTS(T_NO := T1, S := s, TV := S5T#5s, BI := w, Q := q); M103.0 := q; M103.1 := w = 500;",
            2,
        ),
        (
            "8.6 S_OFFDT",
            "q, s : BOOL;",
            "s := TRUE; S_OFFDT(T_NO := T1, S := s, TV := S5T#5s, Q := q); M103.0 := q;",
            1,
        ),
        ("8.6 only the number", "t : S5TIME;", "t := S_PULSE(T_NO := T1); M103.0 := t = S5T#0s;", 1),
        (
            "8.6 R",
            "q, s : BOOL;",
            "s := TRUE; S_PULSE(T_NO := T1, S := s, TV := S5T#5s, R := s, Q := q); M103.0 := q;",
            0,
        ),
        (
            "8.6 S_CU",
            "q, s : BOOL; v : WORD;",
            "s := TRUE; MW102 := S_CU(C_NO := C1, CU := s, CV := v, Q := q); M102.0 := q; M102.1 := v = 1;",
            0x301,
        ),
        (
            "8.6 S_CD",
            "q, s : BOOL; v : WORD;",
            "s := TRUE; MW102 := S_CD(C_NO := C1, CD := s, S := s, PV := W#16#20, CV := v); M102.1 := v = 20;",
            0x220,
        ),
        ("8.6 S_CUD in BCD", "s : BOOL;", "s := TRUE; MW102 := S_CUD(C_NO := C1, S := s, PV := W#16#123);", 0x123),
        ("8.6 S_CUD R", "s : BOOL;", "s := TRUE; MW102 := S_CUD(C_NO := C1, S := s, PV := W#16#123, R := s);", 0),
    ]);
}

/// MOVE_BLK and FILL_BLK in a block of TIA Portal.
#[test]
fn line_9_blocks_of_elements() {
    const ARRAYS: &str =
        "a : Array[0..7] of Int; b : Array[1..8] of Int; x, y : Array[0..15] of Bool; s : Array[0..2] of String[4];
        t : Array[0..2] of String[9]; i, n : Int; u : UInt;";
    const FILLED: &str = "FOR #i := 0 TO 7 DO #a[#i] := #i + 1; END_FOR;";
    for (line, statements, expected) in [
        (
            "8.9 MOVE_BLK",
            "MOVE_BLK(IN := #a[2], COUNT := 3, OUT => #b[1]); MW102 := #b[1] * 1000 + #b[3] * 10 + #b[4];",
            3050,
        ),
        (
            "8.9 the count is a variable",
            "#u := 8; MOVE_BLK(IN := #a[0], COUNT := #u, OUT => #b[1]); MW102 := #b[8];",
            8,
        ),
        (
            "8.9 the index is a variable",
            "#i := 6; MOVE_BLK(IN := #a[#i], COUNT := 2, OUT => #b[#i + 1]); MW102 := #b[8] * 10 + #b[7];",
            87,
        ),
        ("8.9 whole arrays", "MOVE_BLK(IN := #a, COUNT := 8, OUT => #b); MW102 := #b[8] * 10 + #b[1];", 81),
        (
            "8.9 beyond IN: nothing, ENO 0",
            "#u := 3; MOVE_BLK(IN := #a[6], COUNT := #u, OUT => #b[1]); MW102 := #b[1]; M100.0 := ENO;",
            0,
        ),
        (
            "8.9 beyond OUT: nothing, ENO 0",
            "#i := 7; MOVE_BLK(IN := #a[0], COUNT := 3, OUT => #b[#i]); MW102 := #b[7]; M100.0 := ENO;",
            0,
        ),
        (
            "8.9 before OUT: nothing",
            "#i := 0; MOVE_BLK(IN := #a[0], COUNT := 3, OUT => #b[#i]); MW102 := #b[1]; M100.0 := ENO;",
            0,
        ),
        ("8.9 ENO 1", "MOVE_BLK(IN := #a[0], COUNT := 1, OUT => #b[1]); MD100 := 0; M103.0 := ENO;", 1),
        (
            "8.9 no element",
            "#n := 0; MOVE_BLK(IN := #a[0], COUNT := #n, OUT => #b[1]); MW102 := #b[1]; M103.0 := ENO;",
            1,
        ),
        ("8.9 upwards within one array", "MOVE_BLK(IN := #a[0], COUNT := 3, OUT => #a[1]); MW102 := #a[3];", 1),
        (
            "8.9 BOOL",
            "#x[3] := TRUE; MOVE_BLK(IN := #x[1], COUNT := 5, OUT => #y[9]); MD100 := 0; M103.0 := #y[11]; M103.1 := #y[10];",
            1,
        ),
        ("8.9 STRING", "#t[1] := 'abcdef'; MOVE_BLK(IN := #t[1], COUNT := 1, OUT => #s[2]); MW102 := LEN(#s[2]);", 4),
        ("8.9 UMOVE_BLK", "UMOVE_BLK(IN := #a[7], COUNT := 1, OUT => #b[1]); MW102 := #b[1];", 8),
        (
            "8.9 FILL_BLK",
            "FILL_BLK(IN := 5, COUNT := 3, OUT => #b[2]); MW102 := #b[1] * 1000 + #b[2] * 100 + #b[4] * 10 + #b[5];",
            550,
        ),
        (
            "8.9 FILL_BLK calculates its value once",
            "FILL_BLK(IN := #a[2] + #a[0], COUNT := 8, OUT => #a[0]); MW102 := #a[0] * 10 + #a[7];",
            44,
        ),
        (
            "8.9 UFILL_BLK",
            "UFILL_BLK(IN := TRUE, COUNT := 3, OUT => #y[1]); MD100 := 0; M103.0 := #y[3]; M103.1 := #y[4];",
            1,
        ),
        (
            "8.9 FILL_BLK of texts",
            "FILL_BLK(IN := 'xyz', COUNT := 2, OUT => #s[1]); MW102 := LEN(#s[2]) * 10 + LEN(#s[0]);",
            30,
        ),
        (
            "8.9 LOWER_BOUND and UPPER_BOUND",
            "MD100 := UPPER_BOUND(ARR := #b, DIM := 1) * 10 + LOWER_BOUND(ARR := #b, DIM := 1);",
            81,
        ),
    ] {
        let statements = &*format!("{FILLED} {statements}").leak();
        tia_rows(&[(line, ARRAYS, statements, expected)]);
    }
    let twice = "a : Array[0..3] of Int; b : Array[0..1, 0..1] of Int; r : Array[0..3] of Real; i : Int; x : Bool;";
    refused(
        "\"f\"",
        &[
            ("8.9 another type", twice, "MOVE_BLK(IN := #a[0], COUNT := 1, OUT => #r[0]);", &["S2201"]),
            ("8.9 two dimensions", twice, "MOVE_BLK(IN := #b[0, 0], COUNT := 1, OUT => #a[0]);", &["S2408"]),
            ("8.9 no array", twice, "#i := 1; MOVE_BLK(IN := #i, COUNT := 1, OUT => #a[0]);", &["S2408"]),
            ("8.9 beyond the end", twice, "MOVE_BLK(IN := #a[2], COUNT := 3, OUT => #a[0]);", &["S2105"]),
            ("8.9 outside", twice, "MOVE_BLK(IN := #a[4], COUNT := 1, OUT => #a[0]);", &["S2105"]),
            ("8.9 a parameter is missing", twice, "MOVE_BLK(IN := #a[0], OUT => #a[1]);", &["S2408"]),
            ("8.9 the value does not fit", twice, "FILL_BLK(IN := 1.5, COUNT := 1, OUT => #a[0]);", &["S2203"]),
            ("8.9 a count that is none", twice, "MOVE_BLK(IN := #a[0], COUNT := 1.5, OUT => #a[1]);", &["S2203"]),
            (
                "8.9 no dimension of this number",
                twice,
                "#i := DINT_TO_INT(UPPER_BOUND(ARR := #a, DIM := 2));",
                &["S2408"],
            ),
        ],
    );
}

#[test]
fn line_9_functions_of_tia_portal() {
    const TIA: &str = "r : Real; i : Int; d : DInt;";
    tia_rows(&[
        ("8.9 FRAC", TIA, "#r := 2.75; MD100 := REAL_TO_DWORD(FRAC(#r));", real(0.75)),
        (
            "8.9 NORM_X",
            TIA,
            "#i := 30; #r := NORM_X(MIN := 10, VALUE := #i, MAX := 50); MD100 := REAL_TO_DWORD(#r);",
            real(0.5),
        ),
        (
            "8.9 SCALE_X",
            TIA,
            "#r := SCALE_X(MIN := 10.0, VALUE := 0.5, MAX := 20.0); MD100 := REAL_TO_DWORD(#r);",
            real(15.0),
        ),
        (
            "8.9 SCALE_X of INT rounds",
            TIA,
            "#r := 0.25; #i := SCALE_X_INT(MIN := 0, VALUE := #r, MAX := 10); MW102 := #i;",
            2,
        ),
        ("8.9 ABS_INT", TIA, "#i := -4; #i := ABS_INT(#i); MW102 := #i;", 4),
        ("8.9 MAX_REAL", TIA, "#i := 4; #r := MAX_REAL(IN1 := #i, IN2 := 2.5); MD100 := REAL_TO_DWORD(#r);", real(4.0)),
    ]);
    // What is not there is named, with its line.
    for function in
        ["MOVE_BLK_VARIANT", "S_CONV", "VAL_STRG", "STRG_VAL", "DECO", "ENCO", "T_CONV", "POKE_BLK", "Chars_TO_Strg"]
    {
        let text =
            format!("FUNCTION \"f\" : Void VAR_TEMP i : Int; END_VAR BEGIN\n#i := 1;\n{function}(#i);\nEND_FUNCTION\n");
        let found = compiled(&text).diagnostics;
        let named = found.iter().all(|d| d.line == 3 && d.message.contains(function));
        assert!(found.len() == 1 && named, "8.9 {function}: {found:?}");
    }
}

/// BLKMOV, FILL and UBLKMOV are system functions.
#[test]
fn blocks_of_bytes() {
    const ARRAYS: &str = "a, b : ARRAY[1..4] OF INT; c : INT; k : INT;";
    rows_behind(
        "",
        &[
            (
                "6 BLKMOV",
                ARRAYS,
                "a[1] := 7; a[4] := 9; c := BLKMOV(SRCBLK := a, DSTBLK := b); MW102 := INT_TO_WORD(b[1] * 10 + b[4] + c);",
                79,
            ),
            ("6 SFC 20", ARRAYS, "a[4] := 9; c := SFC20(SRCBLK := a, DSTBLK := b); MW102 := INT_TO_WORD(b[4]);", 9),
            ("6 FILL", ARRAYS, "c := 5; k := FILL(BVAL := c, BLK := b); MW102 := INT_TO_WORD(b[1] * 10 + b[4]);", 55),
            ("6 UBLKMOV", ARRAYS, "a[4] := 9; c := UBLKMOV(SRCBLK := a, DSTBLK := b); MW102 := INT_TO_WORD(b[4]);", 9),
            ("6 a whole array", ARRAYS, "a[3] := 6; b := a; MW102 := INT_TO_WORD(b[3]);", 6),
        ],
    );
}
