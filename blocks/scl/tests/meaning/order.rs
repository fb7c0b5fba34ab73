//! Section 5 of the sheet: what is evaluated, in which order, and what it gives.

use crate::common::{compiled, real, refused, rows, rows_behind, tia_rows};

const ANY: &str = "a, b, c : INT; d : DINT; r, q : REAL; w : WORD; y : BYTE; dw : DWORD; n : INT; x : BOOL;";

/// FC501 counts its calls in MW50 and gives what it gets; FC502 gives the count of that moment.
const COUNTED: &str = "FUNCTION FC501 : BOOL VAR_INPUT x : BOOL; END_VAR
    BEGIN MW50 := INT_TO_WORD(WORD_TO_INT(MW50) + 1); FC501 := x; END_FUNCTION
    FUNCTION FC502 : INT VAR_INPUT n : INT; END_VAR
    BEGIN MW50 := INT_TO_WORD(WORD_TO_INT(MW50) * 10 + n); FC502 := WORD_TO_INT(MW50); END_FUNCTION
    FUNCTION FC503 : INT BEGIN MW50 := 7; FC503 := 100; END_FUNCTION";

#[test]
fn lines_1_and_2_what_is_evaluated_when() {
    rows_behind(
        COUNTED,
        &[
            ("5.1 AND", ANY, "x := FC501(FALSE) AND FC501(TRUE); MW102 := MW50;", 2),
            ("5.1 OR", ANY, "x := FC501(TRUE) OR FC501(TRUE); MW102 := MW50;", 2),
            ("5.1 XOR", ANY, "x := FC501(TRUE) XOR FC501(TRUE); MW102 := MW50;", 2),
            ("5.1 beside a comparison", ANY, "a := 1; IF a > 2 AND FC501(TRUE) THEN b := 1; END_IF; MW102 := MW50;", 1),
            ("5.1 three", ANY, "x := FC501(FALSE) AND FC501(FALSE) AND FC501(FALSE); MW102 := MW50;", 3),
            (
                "5.1 the values count",
                ANY,
                "M103.0 := FC501(TRUE) AND NOT FC501(FALSE); M103.1 := FC501(FALSE) OR FC501(FALSE);",
                1,
            ),
            ("5.2 calls from left to right", ANY, "a := FC502(1) * 0 + FC502(2); MW102 := MW50;", 12),
            ("5.2 calls on both sides", ANY, "M103.0 := FC502(1) < FC502(2); M103.1 := MW50 = W#16#C;", 3),
            (
                "5.2 a plain variable last",
                ANY,
                "MW50 := 1; MD100 := DINT_TO_DWORD(WORD_TO_INT(MW50) - FC503());",
                0xFFFF_FFA3,
            ),
            ("5.2 and on the right", ANY, "MW50 := 1; MD100 := DINT_TO_DWORD(FC503() - WORD_TO_INT(MW50));", 93),
        ],
    );
}

#[test]
fn lines_3_to_5_numbers_at_their_ends() {
    rows(&[
        ("5.3 INT wraps up", ANY, "a := 32767; a := a + 2; MW102 := INT_TO_WORD(a);", 0x8001),
        ("5.3 INT wraps down", ANY, "a := -32768; a := a - 1; MW102 := INT_TO_WORD(a);", 0x7FFF),
        ("5.3 INT product", ANY, "a := 256; a := a * 257; MW102 := INT_TO_WORD(a);", 256),
        ("5.3 DINT wraps", ANY, "d := 2147483647; d := d + 1; MD100 := DINT_TO_DWORD(d);", 0x8000_0000),
        ("5.3 DINT product", ANY, "d := 65536; d := d * 65537; MD100 := DINT_TO_DWORD(d);", 65_536),
        ("5.3 ABS of the smallest INT", ANY, "a := -32768; MW102 := INT_TO_WORD(ABS(a));", 0x8000),
        ("5.3 minus the smallest INT", ANY, "a := -32768; a := -a; MW102 := INT_TO_WORD(a);", 0x8000),
        ("5.3 ABS of the smallest DINT", ANY, "d := -2147483648; MD100 := DINT_TO_DWORD(ABS(d));", 0x8000_0000),
        ("5.3 minus the smallest DINT", ANY, "d := -2147483648; d := -d; MD100 := DINT_TO_DWORD(d);", 0x8000_0000),
        ("5.4 toward 0", ANY, "a := -7; MW102 := INT_TO_WORD(a / 2);", 0xFFFD),
        ("5.4 toward 0", ANY, "a := 7; MW102 := INT_TO_WORD(a / -2);", 0xFFFD),
        ("5.4 MOD has the sign of the dividend", ANY, "a := -7; MW102 := INT_TO_WORD(a MOD 3);", 0xFFFF),
        ("5.4 MOD has the sign of the dividend", ANY, "a := 7; b := -3; MW102 := INT_TO_WORD(a MOD b);", 1),
        ("5.4 MOD of DINT", ANY, "d := -100001; MD100 := DINT_TO_DWORD(d MOD 10);", 0xFFFF_FFFF),
        ("5.4 by 0 the block goes on", ANY, "a := 7; b := 0; c := a / b; d := a MOD b; MB103 := 5;", 5),
        ("5.5 single precision", ANY, "r := 16777216.0; r := r + 1.0; MD100 := REAL_TO_DWORD(r);", real(16_777_216.0)),
        ("5.5 in every step", ANY, "r := 1.0; q := 3.0; MD100 := REAL_TO_DWORD(r / q * q);", real(1.0f32 / 3.0 * 3.0)),
        ("5.5 NaN", ANY, "r := -1.0; r := SQRT(r); M103.0 := r = r; M103.1 := r < 1.0; M103.2 := r >= 1.0;", 0),
        ("5.5 ** of a negative base", ANY, "r := -2.0; q := 3.0; r := r ** q; M103.0 := r = r;", 0),
        ("5.5 0 ** 0", ANY, "r := 0.0; q := 0.0; r := r ** q; M103.0 := r = r;", 0),
        ("5.5 **", ANY, "r := 2.0; q := 0.5; r := r ** q; M103.0 := ABS(r - 1.41421) < 0.0001;", 1),
        ("5.5 LOG", ANY, "r := 1000.0; r := LOG(r); M103.0 := ABS(r - 3.0) < 0.00001;", 1),
    ]);
}

#[test]
fn line_6_shifts() {
    rows(&[
        ("5.6 SHL of a BYTE is masked", ANY, "y := 16#C1; n := 1; MW102 := SHL(IN := y, N := n);", 0x82),
        ("5.6 SHL of a WORD is masked", ANY, "w := 16#8001; n := 4; MD100 := SHL(IN := w, N := n);", 0x10),
        ("5.6 SHR", ANY, "w := 16#8001; n := 4; MW102 := SHR(IN := w, N := n);", 0x0800),
        ("5.6 SHR of a DWORD", ANY, "dw := 16#80000000; n := 31; MD100 := SHR(IN := dw, N := n);", 1),
        ("5.6 as wide as the value", ANY, "y := 16#FF; n := 8; MW102 := SHL(IN := y, N := n);", 0),
        ("5.6 as wide as the value", ANY, "w := 16#FFFF; n := 16; MW102 := SHR(IN := w, N := n);", 0),
        ("5.6 as wide as the value", ANY, "dw := 16#FFFFFFFF; n := 32; MD100 := SHL(IN := dw, N := n);", 0),
        ("5.6 below 0", ANY, "w := 16#FFFF; n := -1; MW102 := SHL(IN := w, N := n);", 0),
        ("5.6 constant number", ANY, "y := 16#81; MB103 := SHR(IN := y, N := 7);", 1),
        ("5.6 ROL of a BYTE", ANY, "y := 16#81; n := 9; MW102 := ROL(IN := y, N := n);", 3),
        ("5.6 ROR of a WORD", ANY, "w := 16#0001; n := 17; MW102 := ROR(IN := w, N := n);", 0x8000),
        ("5.6 ROL of a DWORD", ANY, "dw := 16#80000001; n := 4; MD100 := ROL(IN := dw, N := n);", 0x18),
        ("5.6 ROR of a DWORD", ANY, "dw := 16#80000001; n := 4; MD100 := ROR(IN := dw, N := n);", 0x1800_0000),
    ]);
}

#[test]
fn lines_7_and_8_choices() {
    rows_behind(
        COUNTED,
        &[
            (
                "5.7 WHILE tests before",
                ANY,
                "a := 5; WHILE a < 5 DO a := a + 1; END_WHILE; MW102 := INT_TO_WORD(a);",
                5,
            ),
            (
                "5.7 REPEAT tests after",
                ANY,
                "a := 5; REPEAT a := a + 1; UNTIL TRUE END_REPEAT; MW102 := INT_TO_WORD(a);",
                6,
            ),
            (
                "5.7 REPEAT until TRUE",
                ANY,
                "a := 0; REPEAT a := a + 1; UNTIL a = 3 END_REPEAT; MW102 := INT_TO_WORD(a);",
                3,
            ),
            (
                "5.7 nothing behind the one that holds",
                ANY,
                "IF FC501(FALSE) THEN a := 1; ELSIF FC501(TRUE) THEN a := 2; ELSIF FC501(TRUE) THEN a := 3; END_IF; MW102 := INT_TO_WORD(WORD_TO_INT(MW50) * 10 + a);",
                22,
            ),
            (
                "5.8 selector once",
                ANY,
                "CASE FC502(3) OF 1: a := 1; 2: a := 2; 3: a := 3; END_CASE; MW102 := INT_TO_WORD(WORD_TO_INT(MW50) * 10 + a);",
                33,
            ),
            (
                "5.8 ranges with their ends",
                ANY,
                "d := 0; FOR a := 1 TO 6 DO CASE a OF 2..5: d := d * 10 + a; END_CASE; END_FOR; MD100 := DINT_TO_DWORD(d);",
                2345,
            ),
            (
                "5.8 no fall-through",
                ANY,
                "a := 1; CASE a OF 1: b := 1; 2: b := 2; ELSE b := 9; END_CASE; MW102 := INT_TO_WORD(b);",
                1,
            ),
            (
                "5.8 nothing without a match",
                ANY,
                "a := 7; b := 4; CASE a OF 1: b := 1; END_CASE; MW102 := INT_TO_WORD(b);",
                4,
            ),
            (
                "5.8 a list",
                ANY,
                "a := 7; CASE a OF 1, 5..8, -3: b := 1; ELSE b := 2; END_CASE; MW102 := INT_TO_WORD(b);",
                1,
            ),
            ("5.8 names of constants", ANY, "a := 2; CASE a OF 1 + 1: b := 6; END_CASE; MW102 := INT_TO_WORD(b);", 6),
        ],
    );
    tia_rows(&[
        ("5.8 DINT", "d : DInt; a : Int;", "#d := 100000; CASE #d OF 100000: #a := 1; END_CASE; MW102 := #a;", 1),
        ("5.8 WORD", "w : Word; a : Int;", "#w := 16#FFFF; CASE #w OF 16#FFFF: #a := 1; END_CASE; MW102 := #a;", 1),
        ("5.8 UDINT", "w : UDInt; a : Int;", "#w := 7; CASE #w OF 1..9: #a := 1; END_CASE; MW102 := #a;", 1),
    ]);
    // The first of two that match: a range that covers is a warning, and the first one counts.
    refused("FC900", &[("5.8", "a : INT;", "a := 3; CASE a OF 1..5: a := 1; 3: a := 2; END_CASE;", &["S2302"])]);
}

#[test]
fn line_9_for() {
    rows(&[
        (
            "5.9 the end before the start",
            ANY,
            "a := 3; d := 0; FOR a := 1 TO a DO d := d * 10 + a; END_FOR; MD100 := DINT_TO_DWORD(d);",
            123,
        ),
        (
            "5.9 the end once",
            ANY,
            "b := 2; d := 0; FOR a := 1 TO b DO b := b + 1; d := d + 1; END_FOR; MD100 := DINT_TO_DWORD(d);",
            2,
        ),
        (
            "5.9 tested before",
            ANY,
            "d := 0; FOR a := 2 TO 1 DO d := d + 1; END_FOR; MD100 := DINT_TO_DWORD(d * 100 + a);",
            2,
        ),
        ("5.9 the variable afterwards", ANY, "FOR a := 1 TO 5 BY 3 DO ; END_FOR; MW102 := INT_TO_WORD(a);", 7),
        (
            "5.9 negative step",
            ANY,
            "d := 0; FOR a := 3 TO 1 BY -1 DO d := d * 10 + a; END_FOR; MD100 := DINT_TO_DWORD(d * 10 + a);",
            3210,
        ),
        (
            "5.9 assigning to the variable counts",
            ANY,
            "d := 0; FOR a := 1 TO 9 DO a := a + 2; d := d + 1; END_FOR; MD100 := DINT_TO_DWORD(d * 100 + a);",
            310,
        ),
        ("5.9 DINT", ANY, "a := 0; FOR d := 100000 TO 100002 DO a := a + 1; END_FOR; MW102 := INT_TO_WORD(a);", 3),
        (
            "5.9 step by its sign at run time, up",
            ANY,
            "c := 2; d := 0; FOR a := 1 TO 5 BY c DO d := d * 10 + a; END_FOR; MD100 := DINT_TO_DWORD(d);",
            135,
        ),
        (
            "5.9 step by its sign at run time, down",
            ANY,
            "c := -2; d := 0; FOR a := 5 TO 1 BY c DO d := d * 10 + a; END_FOR; MD100 := DINT_TO_DWORD(d);",
            531,
        ),
        (
            "5.9 an element as variable",
            "x : ARRAY[1..2] OF INT; d : DINT;",
            "d := 0; FOR x[2] := 1 TO 3 DO d := d + x[2]; END_FOR; MD100 := DINT_TO_DWORD(d);",
            6,
        ),
    ]);
    refused("FC900", &[("5.9 never ends", "a : INT;", "FOR a := 1 TO 32767 DO ; END_FOR;", &["S2304"])]);
}

#[test]
fn line_10_leaving() {
    const INNER: &str = "d := 0; FOR a := 1 TO 2 DO FOR b := 1 TO 5 DO";
    rows(&[
        ("5.10 EXIT leaves the innermost", ANY, &*format!("{INNER} IF b = 2 THEN EXIT; END_IF; d := d + 1; END_FOR; d := d + 10; END_FOR; MD100 := DINT_TO_DWORD(d);").leak(), 22),
        ("5.10 CONTINUE counts on", ANY, &*format!("{INNER} IF b = 2 THEN CONTINUE; END_IF; d := d + 1; END_FOR; END_FOR; MD100 := DINT_TO_DWORD(d);").leak(), 8),
        ("5.10 CONTINUE to the test of WHILE", ANY, "a := 0; d := 0; WHILE a < 5 DO a := a + 1; IF a = 2 THEN CONTINUE; END_IF; d := d + a; END_WHILE; MD100 := DINT_TO_DWORD(d);", 13),
        ("5.10 CONTINUE to the test of REPEAT", ANY, "a := 0; d := 0; REPEAT a := a + 1; IF a >= 2 THEN CONTINUE; END_IF; d := d + a; UNTIL a = 4 END_REPEAT; MD100 := DINT_TO_DWORD(d * 10 + a);", 14),
        ("5.10 GOTO forward", ANY, "a := 1; GOTO out; a := 2; out: MW102 := INT_TO_WORD(a);", 1),
        ("5.10 GOTO back", ANY, "a := 0; again: a := a + 1; IF a < 4 THEN GOTO again; END_IF; MW102 := INT_TO_WORD(a);", 4),
        ("5.10 GOTO out of a loop", ANY, "FOR a := 1 TO 9 DO IF a = 3 THEN GOTO out; END_IF; END_FOR; out: MW102 := INT_TO_WORD(a);", 3),
    ]);
    rows_behind(
        "FUNCTION FC501 : INT VAR_INPUT x : BOOL; END_VAR BEGIN FC501 := 1; OK := x; RETURN; FC501 := 2; END_FUNCTION",
        &[
            ("5.10 RETURN ends", ANY, "a := FC501(x := TRUE); MW102 := INT_TO_WORD(a);", 1),
            (
                "5.10 RETURN copies OK to BR",
                ANY,
                "a := FC501(x := TRUE); M103.0 := ENO; a := FC501(x := FALSE); M103.1 := ENO;",
                1,
            ),
        ],
    );
    rows_behind(
        "FUNCTION FC501 : INT LABEL out, other; END_LABEL BEGIN GOTO out; FC501 := 1; out: FC501 := 2; END_FUNCTION",
        &[("5.10 declared labels", ANY, "MW102 := INT_TO_WORD(FC501());", 2)],
    );
    refused(
        "FC900",
        &[
            ("5.10 GOTO into a loop", "a : INT;", "GOTO l; FOR a := 1 TO 2 DO l: ; END_FOR;", &["S2306"]),
            ("5.10 GOTO into a branch", "a : INT;", "IF TRUE THEN GOTO l; ELSE l: a := 1; END_IF;", &["S2306"]),
            ("5.10 EXIT without a loop", "a : INT;", "IF TRUE THEN EXIT; END_IF;", &["S2305"]),
        ],
    );
}

#[test]
fn line_11_selection() {
    rows_behind(
        COUNTED,
        &[
            (
                "5.11 SEL calculates both",
                ANY,
                "a := SEL(G := TRUE, IN0 := FC502(1), IN1 := FC502(2)); MW102 := INT_TO_WORD(a);",
                12,
            ),
            ("5.11 FALSE takes IN0", ANY, "MW102 := INT_TO_WORD(SEL(G := FALSE, IN0 := 3, IN1 := 4));", 3),
            ("5.11 of BOOL", ANY, "x := TRUE; M103.0 := SEL(G := x, IN0 := FALSE, IN1 := TRUE);", 1),
            ("5.11 MIN", ANY, "a := 3; b := -3; MW102 := INT_TO_WORD(MIN(IN1 := a, IN2 := b));", 0xFFFD),
            (
                "5.11 MIN of NaN takes IN2",
                ANY,
                "r := -1.0; r := SQRT(r); MD100 := REAL_TO_DWORD(MIN(IN1 := r, IN2 := 2.0));",
                real(2.0),
            ),
            (
                "5.11 MAX of NaN takes IN2",
                ANY,
                "r := -1.0; r := SQRT(r); MD100 := REAL_TO_DWORD(MAX(IN1 := r, IN2 := 2.0));",
                real(2.0),
            ),
            ("5.11 MAX of three", ANY, "a := 3; b := 9; MW102 := INT_TO_WORD(MAX(IN1 := a, IN2 := b, IN3 := 5));", 9),
            ("5.11 LIMIT within", ANY, "a := 3; MW102 := INT_TO_WORD(LIMIT(MN := 1, IN := a, MX := 5));", 3),
            ("5.11 LIMIT below", ANY, "a := 0; MW102 := INT_TO_WORD(LIMIT(MN := 1, IN := a, MX := 5));", 1),
            ("5.11 LIMIT above", ANY, "a := 8; MW102 := INT_TO_WORD(LIMIT(MN := 1, IN := a, MX := 5));", 5),
            ("5.11 MN wins", ANY, "a := 3; MW102 := INT_TO_WORD(LIMIT(MN := 9, IN := a, MX := 5));", 9),
            (
                "5.11 NaN gives MN",
                ANY,
                "r := -1.0; r := SQRT(r); MD100 := REAL_TO_DWORD(LIMIT(MN := 1.0, IN := r, MX := 5.0));",
                real(1.0),
            ),
        ],
    );
}

#[test]
fn lines_12_and_13_times_and_texts() {
    rows(&[
        ("5.12 TIME with sign", "t : TIME;", "t := T#-1ms; M103.0 := t < T#0ms;", 1),
        ("5.12 TOD with sign", "t : TOD;", "t := DINT_TO_TOD(-1); M103.0 := t < TOD#0:0:0;", 1),
        (
            "5.12 DATE as signed INT",
            "y : DATE;",
            "y := D#2079-9-19; M103.0 := y < D#1990-1-1; y := D#2079-9-18; M103.1 := y < D#1990-1-1;",
            1,
        ),
        (
            "5.12 TOD + TIME",
            "t : TOD;",
            "t := TOD#23:59:59.999; t := t + T#1ms; MD100 := DINT_TO_DWORD(TOD_TO_DINT(t));",
            0,
        ),
        (
            "5.12 TOD + TIME below 0",
            "t : TOD;",
            "t := TOD#0:0:0; t := t + T#-1ms; MD100 := DINT_TO_DWORD(TOD_TO_DINT(t));",
            86_399_999,
        ),
        (
            "5.12 TOD - TIME",
            "t : TOD;",
            "t := TOD#0:0:1; t := t - T#2s; MD100 := DINT_TO_DWORD(TOD_TO_DINT(t));",
            86_399_000,
        ),
        ("5.13 byte by byte", "s, t : STRING[4];", "s := 'a'; t := 'Z'; M103.0 := s > t;", 1),
        ("5.13 no code page", "s, t : STRING[4];", "s := '$FF'; t := 'z'; M103.0 := s > t;", 1),
        (
            "5.13 the shorter comes first",
            "s, t : STRING[4];",
            "s := 'ab'; t := 'abc'; M103.0 := s < t; M103.1 := s = t;",
            1,
        ),
        (
            "5.13 DT",
            "a, b : DT;",
            "a := DT#2020-1-1-0:0:0; b := DT#1999-1-1-0:0:0; M103.0 := a > b; M103.1 := a <> b; M103.2 := a <= b;",
            3,
        ),
    ]);
}

#[test]
fn line_14_temporaries() {
    // In a classic block they are as they were: no statement clears them.
    let text = "FUNCTION FC1 : VOID VAR_TEMP a : ARRAY[0..99] OF INT; END_VAR BEGIN a[1] := 1; END_FUNCTION\n";
    let code = &compiled(text).program.blocks[0].code;
    assert!(code.len() < 6, "5.14: {code:?}");
    let dirty = "FUNCTION FC501 : VOID VAR_TEMP a : ARRAY[0..511] OF BYTE; i : INT; END_VAR BEGIN
        FOR i := 0 TO 511 DO a[i] := 16#AA; END_FOR; END_FUNCTION";
    let work = |declared: &str, statements: &str| {
        format!(
            "{dirty}\nFUNCTION \"w\" : Void {{ S7_Optimized_Access := 'TRUE' }} VAR_TEMP {declared} END_VAR BEGIN {statements} END_FUNCTION"
        )
    };
    for (declared, statements, expected) in [
        ("i : Int; n : DInt;", "MD100 := #n; MW100 := #i;", 0),
        ("a : Array[0..299] of Byte; i : Int;", "MB103 := #a[299]; MB102 := #a[0]; MB101 := #a[150];", 0),
        (
            "s : String[10];",
            "#s := CONCAT(IN1 := 'abc', IN2 := 'def'); MB103 := INT_TO_BYTE(LEN(#s)); MB102 := INT_TO_BYTE(MAX_LEN(#s));",
            0x0A06,
        ),
        ("t : DTL;", "MW102 := #t.YEAR;", 1970),
        ("a : Array[0..299] of Byte; t : DTL;", "MW102 := #t.YEAR; MB101 := #t.DAY;", 0x0001_07B2),
    ] {
        rows_behind(&work(declared, statements), &[("5.14 TIA", "", "FC501(); MD100 := 0; \"w\"();", expected)]);
    }
}
