//! Section 4 of the sheet: types, literals, conversions.

use crate::common::{real, refused, result, rows, rows_behind, run, tia_rows};

const NUMBERS: &str =
    "b : BYTE; w : WORD; dw : DWORD; i, k : INT; d : DINT; r : REAL; x : BOOL; t : TIME; y : DATE; z : TOD;";

#[test]
fn line_1_a_bare_integer_takes_the_type_of_its_place() {
    rows(&[
        ("4.1 BYTE", NUMBERS, "b := 255; MB103 := b;", 255),
        ("4.1 WORD", NUMBERS, "w := 65535; MW102 := w;", 65_535),
        ("4.1 DWORD", NUMBERS, "dw := 1; MD100 := dw;", 1),
        ("4.1 DWORD beside a comparison", NUMBERS, "dw := 16#8000_0000; M103.0 := dw <> 0;", 1),
        ("4.1 REAL", NUMBERS, "r := 10; MD100 := REAL_TO_DWORD(r);", real(10.0)),
        ("4.1 REAL beside a comparison", NUMBERS, "r := 0.5; M103.0 := r > 0;", 1),
        ("4.1 REAL beside a sum", NUMBERS, "r := 0.5; MD100 := REAL_TO_DWORD(r + 1);", real(1.5)),
        ("4.1 BOOL", NUMBERS, "x := 1; M103.0 := x; x := 0; M103.1 := x;", 1),
        ("4.1 INT where it fits", NUMBERS, "i := 30000; MD100 := DINT_TO_DWORD(i + 10000);", 0xFFFF_9C40),
        ("4.1 else DINT", NUMBERS, "i := 30000; MD100 := DINT_TO_DWORD(i + 100000);", 130_000),
        ("4.1 negative", NUMBERS, "d := -32769; MD100 := DINT_TO_DWORD(d);", 0xFFFF_7FFF),
    ]);
    let constants = "FUNCTION FC501 : DWORD CONST ff := 16#FFFFFFFF; n := 7; f := 2.5; m := n * 2; END_CONST
        VAR r : REAL; b : BYTE; END_VAR
        BEGIN r := n; b := n; IF r = f * 2 + n - 5 AND b = 7 AND m = 14 THEN FC501 := ff; ELSE FC501 := 0; END_IF; END_FUNCTION";
    rows_behind(constants, &[("4.1 CONST is without a type", "", "MD100 := FC501();", u32::MAX)]);
}

#[test]
fn line_2_implicit_conversions() {
    rows(&[
        ("4.2 BOOL to BYTE", NUMBERS, "x := TRUE; b := x; MB103 := b;", 1),
        ("4.2 BOOL to DWORD", NUMBERS, "x := TRUE; MD100 := x;", 1),
        ("4.2 BYTE to WORD", NUMBERS, "b := 16#F0; w := b; MW102 := w;", 0xF0),
        ("4.2 BYTE to DWORD", NUMBERS, "b := 16#F0; MD100 := b;", 0xF0),
        ("4.2 WORD to DWORD", NUMBERS, "w := 16#8000; MD100 := w;", 0x8000),
        ("4.2 INT to DINT", NUMBERS, "i := -2; d := i; MD100 := DINT_TO_DWORD(d);", 0xFFFF_FFFE),
        ("4.2 INT to REAL", NUMBERS, "i := -2; r := i; MD100 := REAL_TO_DWORD(r);", real(-2.0)),
        ("4.2 DINT to REAL", NUMBERS, "d := 100000; r := d; MD100 := REAL_TO_DWORD(r);", real(1e5)),
        (
            "4.2 CHAR to STRING",
            "c : CHAR; s : STRING[4];",
            "c := 'A'; s := c; MB102 := CHAR_TO_BYTE(s[1]); MB103 := 0;",
            0x4100,
        ),
        ("4.2 a CHAR beside a STRING", "c : CHAR; s : STRING[4];", "c := 'A'; s := 'A'; M103.0 := s = c;", 1),
        ("4.2 INT for a REAL parameter", NUMBERS, "i := 4; MD100 := REAL_TO_DWORD(SQRT(i));", real(2.0)),
        ("4.2 TIME * INT", NUMBERS, "i := -3; t := T#2s * i; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));", 0xFFFF_E890),
        ("4.2 TIME / INT", NUMBERS, "i := 4; t := T#2s / i; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));", 500),
    ]);
    refused(
        "FC900",
        &[
            ("4.2 class B", "i : INT; d : DINT;", "d := 1; i := d;", &["S2201"]),
            ("4.2 class B", "i : INT; r : REAL;", "r := 1.0; i := r;", &["S2201"]),
            ("4.2 class B", "w : WORD; i : INT;", "w := 1; i := w;", &["S2201"]),
            ("4.2 class B", "b : BYTE; w : WORD;", "w := 1; b := w;", &["S2201"]),
            ("4.2 class B", "x : BOOL; b : BYTE;", "b := 1; x := b;", &["S2201"]),
            ("4.2 class B", "t : TIME; d : DINT;", "d := 1; t := d;", &["S2201"]),
            ("4.2 class B", "c : CHAR; s : STRING;", "s := 'a'; c := s;", &["S2201"]),
        ],
    );
    tia_rows(&[
        ("4.2 TIA without IEC check", "w : Word; i : Int;", "#w := 16#FFFF; #i := #w; MW102 := #i;", 0xFFFF),
        ("4.2 TIA without IEC check", "b : Byte; i : Int;", "#b := 200; #i := #b; MW102 := #i;", 200),
    ]);
}

#[test]
fn line_3_arithmetic() {
    rows(&[
        ("4.3 INT", NUMBERS, "i := 200; k := 200; d := i * k; MD100 := DINT_TO_DWORD(d);", 0xFFFF_9C40),
        (
            "4.3 the target has no say",
            NUMBERS,
            "i := 10; k := 5; d := 1; d := (i + k) * 3600 + d; MD100 := DINT_TO_DWORD(d);",
            0xFFFF_D2F1,
        ),
        ("4.3 widened to the larger", NUMBERS, "i := 10; d := 5; MD100 := DINT_TO_DWORD((i + d) * 3600);", 54_000),
        ("4.3 REAL beside INT", NUMBERS, "i := 3; r := 0.5; MD100 := REAL_TO_DWORD(i * r);", real(1.5)),
        ("4.3 REAL beside DINT", NUMBERS, "d := 3; r := 2.0; MD100 := REAL_TO_DWORD(d / r);", real(1.5)),
        ("4.3 MOD and DIV of INT", NUMBERS, "i := 17; k := 5; MW102 := INT_TO_WORD(i MOD k * 100 + i DIV k);", 203),
        (
            "4.3 MOD and DIV of DINT",
            NUMBERS,
            "d := 170000; i := 1000; MD100 := DINT_TO_DWORD(d DIV i * 100 + d MOD 9);",
            17_008,
        ),
        ("4.3 ** is REAL", NUMBERS, "i := 3; r := i ** 2; MD100 := REAL_TO_DWORD(r);", real(9.0)),
        (
            "4.3 TIME + TIME",
            NUMBERS,
            "t := T#1s; t := t + T#500ms - T#100ms; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));",
            1400,
        ),
        ("4.3 TIME * DINT", NUMBERS, "d := 70000; t := T#2ms * d; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));", 140_000),
        (
            "4.3 TOD + TIME",
            NUMBERS,
            "z := TOD#10:0:0; z := z + T#1s; MD100 := DINT_TO_DWORD(TOD_TO_DINT(z));",
            36_001_000,
        ),
        (
            "4.3 TOD - TIME",
            NUMBERS,
            "z := TOD#10:0:0; z := z - T#1s; MD100 := DINT_TO_DWORD(TOD_TO_DINT(z));",
            35_999_000,
        ),
        (
            "4.3 TOD - TOD",
            NUMBERS,
            "z := TOD#1:0:0; t := z - TOD#1:0:2; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));",
            0xFFFF_F830,
        ),
        (
            "4.3 DATE - DATE",
            NUMBERS,
            "y := D#1990-1-3; t := y - D#1990-1-1; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));",
            172_800_000,
        ),
        (
            "4.3 DT - DT",
            "a, b : DT;",
            "a := DT#2020-1-1-0:0:1; b := DT#2020-1-1-0:0:0; MD100 := DINT_TO_DWORD(TIME_TO_DINT(a - b));",
            1000,
        ),
        (
            "4.3 DT + TIME",
            "a : DT;",
            "a := DT#2020-12-31-23:59:59; a := a + T#1s; MD100 := DINT_TO_DWORD(TOD_TO_DINT(DT_TOD(a)));",
            0,
        ),
        (
            "4.3 DT - TIME",
            "a : DT;",
            "a := DT#2020-1-1-0:0:0; a := a - T#1s; MD100 := DINT_TO_DWORD(TOD_TO_DINT(DT_TOD(a)));",
            86_399_000,
        ),
    ]);
    refused(
        "FC900",
        &[
            ("4.3 none on bit strings", "w : WORD;", "w := 1; w := w + 1;", &["S2202"]),
            ("4.3 none on S5TIME", "s : S5TIME;", "s := S5T#1s; s := s + s;", &["S2202"]),
            ("4.3 MOD of REAL", "r : REAL;", "r := 1.0; r := r MOD 2.0;", &["S2202"]),
            ("4.3 DIV of REAL", "r : REAL;", "r := 1.0; r := r DIV 2.0;", &["S2202"]),
            ("4.3 none on BOOL", "x : BOOL;", "x := TRUE; x := x + x;", &["S2202"]),
            ("4.3 DT + DT", "a : DT;", "a := DT#2020-1-1-0:0:0; a := a + a;", &["S2202"]),
        ],
    );
}

#[test]
fn line_4_comparison() {
    rows(&[
        ("4.4 numbers", NUMBERS, "i := 3; r := 3.5; M103.0 := i < r; d := 3; M103.1 := i >= d;", 3),
        ("4.4 bit strings", NUMBERS, "b := 5; w := 5; M103.0 := b = w; M103.1 := b <> w;", 1),
        ("4.4 BOOL", NUMBERS, "x := TRUE; M103.0 := x = TRUE; M103.1 := x <> TRUE;", 1),
        ("4.4 CHAR", "c : CHAR;", "c := 'b'; M103.0 := c > 'a'; M103.1 := c = 'b';", 3),
        ("4.4 DWORD with the highest bit", NUMBERS, "dw := 16#80000000; M103.0 := dw = 16#80000000;", 1),
    ]);
    refused(
        "FC900",
        &[
            ("4.4 order of bit strings", "w : WORD; x : BOOL;", "w := 1; x := w < W#16#2;", &["S2202"]),
            ("4.4 order of BOOL", "x : BOOL;", "x := TRUE; x := x < FALSE;", &["S2202"]),
            ("4.4 two classes", "w : WORD; i : INT; x : BOOL;", "w := 1; i := 1; x := w = i;", &["S2202"]),
        ],
    );
}

#[test]
fn line_5_bit_operators() {
    rows(&[
        ("4.5 BOOL", NUMBERS, "x := TRUE; M103.0 := x AND NOT FALSE; M103.1 := x XOR x; M103.2 := FALSE OR x;", 5),
        ("4.5 &", NUMBERS, "x := TRUE; M103.0 := x & TRUE;", 1),
        ("4.5 the shorter is widened", NUMBERS, "b := 16#0F; w := 16#F0F0; MW102 := w OR b;", 0xF0FF),
        ("4.5 DWORD", NUMBERS, "dw := 16#FF00FF00; w := 16#FFFF; MD100 := dw XOR w;", 0xFF00_00FF),
        ("4.5 NOT of a BYTE", NUMBERS, "b := 16#F0; MW102 := NOT b;", 0x0F),
        ("4.5 NOT of a WORD", NUMBERS, "w := 16#F0; MD100 := NOT w;", 0xFF0F),
        ("4.5 NOT of a DWORD", NUMBERS, "dw := 1; MD100 := NOT dw;", 0xFFFF_FFFE),
    ]);
    refused("FC900", &[("4.5 no numbers", "i : INT;", "i := 1; i := i AND i;", &["S2202"])]);
}

#[test]
fn line_6_nothing_to_do() {
    rows(&[
        ("4.6 WORD INT", NUMBERS, "w := 16#FFFE; i := WORD_TO_INT(w); MW102 := INT_TO_WORD(i);", 0xFFFE),
        (
            "4.6 DWORD DINT",
            NUMBERS,
            "dw := 16#FFFFFFFE; d := DWORD_TO_DINT(dw); MD100 := DINT_TO_DWORD(d);",
            0xFFFF_FFFE,
        ),
        ("4.6 TIME DINT", NUMBERS, "t := DINT_TO_TIME(1234); MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));", 1234),
        ("4.6 TOD DINT", NUMBERS, "z := DINT_TO_TOD(1234); MD100 := DINT_TO_DWORD(TOD_TO_DINT(z));", 1234),
        (
            "4.6 DWORD to REAL takes the bits",
            NUMBERS,
            "dw := 16#40490FDB; r := DWORD_TO_REAL(dw); MD100 := REAL_TO_DWORD(r);",
            0x4049_0FDB,
        ),
        ("4.6 DATE to DINT without sign", NUMBERS, "y := D#2100-1-1; MD100 := DINT_TO_DWORD(DATE_TO_DINT(y));", 40_177),
    ]);
}

#[test]
fn lines_7_to_9_widening_and_cutting() {
    rows(&[
        ("4.7 BYTE_TO_INT", NUMBERS, "b := 16#FF; MD100 := DINT_TO_DWORD(BYTE_TO_INT(b));", 255),
        ("4.7 BYTE_TO_DINT", NUMBERS, "b := 16#FF; MD100 := DINT_TO_DWORD(BYTE_TO_DINT(b));", 255),
        ("4.7 BYTE_TO_WORD", NUMBERS, "b := 16#FF; MD100 := BYTE_TO_WORD(b);", 255),
        ("4.7 BYTE_TO_DWORD", NUMBERS, "b := 16#FF; MD100 := BYTE_TO_DWORD(b);", 255),
        ("4.7 WORD_TO_DINT", NUMBERS, "w := 16#FFFF; MD100 := DINT_TO_DWORD(WORD_TO_DINT(w));", 0xFFFF),
        ("4.7 WORD_TO_DWORD", NUMBERS, "w := 16#FFFF; MD100 := WORD_TO_DWORD(w);", 0xFFFF),
        ("4.7 INT_TO_DWORD", NUMBERS, "i := -1; MD100 := INT_TO_DWORD(i);", 0xFFFF),
        ("4.8 INT_TO_DINT", NUMBERS, "i := -1; MD100 := DINT_TO_DWORD(INT_TO_DINT(i));", u32::MAX),
        ("4.8 DINT_TO_REAL", NUMBERS, "d := -7; MD100 := REAL_TO_DWORD(DINT_TO_REAL(d));", real(-7.0)),
        ("4.8 INT_TO_REAL", NUMBERS, "i := -7; MD100 := REAL_TO_DWORD(INT_TO_REAL(i));", real(-7.0)),
        (
            "4.8 BOOL_TO_x",
            NUMBERS,
            "x := TRUE; MW102 := INT_TO_WORD(BOOL_TO_INT(x)); MB102 := BOOL_TO_BYTE(x);",
            0x0101,
        ),
        ("4.8 BOOL_TO_DWORD", NUMBERS, "x := TRUE; MD100 := BOOL_TO_DWORD(x);", 1),
        ("4.8 x_TO_BOOL", NUMBERS, "w := 16#FFFE; M103.0 := WORD_TO_BOOL(w); i := 3; M103.1 := INT_TO_BOOL(i);", 2),
        ("4.8 x_TO_BOOL", NUMBERS, "b := 5; M103.0 := BYTE_TO_BOOL(b); dw := 2; M103.1 := DWORD_TO_BOOL(dw);", 1),
        ("4.9 INT_TO_BYTE", NUMBERS, "i := 16#1234; MW102 := INT_TO_BYTE(i);", 0x34),
        ("4.9 WORD_TO_BYTE", NUMBERS, "w := 16#FEDC; MW102 := WORD_TO_BYTE(w);", 0xDC),
        ("4.9 DWORD_TO_BYTE", NUMBERS, "dw := 16#12345678; MD100 := DWORD_TO_BYTE(dw);", 0x78),
    ]);
}

#[test]
fn lines_10_to_13_of_longer_numbers_reals_decimals_and_texts() {
    const TEXTS: &str = "s : STRING[20]; i : INT; d : DINT; r : REAL;";
    rows(&[
        ("4.10 DINT_TO_INT", NUMBERS, "d := 100000; MW102 := INT_TO_WORD(DINT_TO_INT(d));", 0x86A0),
        ("4.10 DWORD_TO_INT", NUMBERS, "dw := 16#12348001; MW102 := INT_TO_WORD(DWORD_TO_INT(dw));", 0x8001),
        ("4.10 DWORD_TO_WORD", NUMBERS, "dw := 16#12348001; MD100 := DWORD_TO_WORD(dw);", 0x8001),
        ("4.10 DINT_TO_WORD", NUMBERS, "d := -1; MD100 := DINT_TO_WORD(d);", 0xFFFF),
        ("4.10 DINT_TO_DATE", NUMBERS, "d := 65537; y := DINT_TO_DATE(d); MD100 := DINT_TO_DWORD(DATE_TO_DINT(y));", 1),
        ("4.11 half to even, up", NUMBERS, "r := 1.5; MD100 := DINT_TO_DWORD(REAL_TO_DINT(r));", 2),
        ("4.11 half to even, down", NUMBERS, "r := -2.5; MD100 := DINT_TO_DWORD(REAL_TO_DINT(r));", 0xFFFF_FFFE),
        ("4.11 REAL_TO_INT low word", NUMBERS, "r := 65538.0; MW102 := INT_TO_WORD(REAL_TO_INT(r));", 2),
        ("4.11 ROUND", NUMBERS, "r := 2.5; MD100 := DINT_TO_DWORD(ROUND(r));", 2),
        ("4.11 TRUNC", NUMBERS, "r := -2.9; MD100 := DINT_TO_DWORD(TRUNC(r));", 0xFFFF_FFFE),
        ("4.11 REAL_TO_INT(TRUNC(x))", NUMBERS, "r := 2.9; MW102 := INT_TO_WORD(REAL_TO_INT(TRUNC(r)));", 2),
        ("4.12 BCD_TO_INT", NUMBERS, "w := 16#9123; MW102 := INT_TO_WORD(BCD_TO_INT(w));", 0xFF85),
        ("4.12 WORD_BCD_TO_INT", NUMBERS, "w := 16#123; MW102 := INT_TO_WORD(WORD_BCD_TO_INT(w));", 123),
        ("4.12 INT_TO_BCD", NUMBERS, "i := 987; MW102 := INT_TO_BCD(i);", 0x987),
        ("4.12 INT_TO_BCD_WORD", NUMBERS, "i := -1; MW102 := INT_TO_BCD_WORD(i);", 0xF001),
        (
            "4.12 DWORD_BCD_TO_DINT",
            NUMBERS,
            "dw := 16#1234567; MD100 := DINT_TO_DWORD(DWORD_BCD_TO_DINT(dw));",
            1_234_567,
        ),
        ("4.12 DINT_TO_BCD_DWORD", NUMBERS, "d := 1234567; MD100 := DINT_TO_BCD_DWORD(d);", 0x0123_4567),
        ("4.12 DINT_TO_BCD", NUMBERS, "d := 42; MD100 := DINT_TO_BCD(d);", 0x42),
        (
            "4.12 the code of a CHAR",
            "c : CHAR; i : INT;",
            "c := 'a'; i := CHAR_TO_INT(c); MW102 := INT_TO_WORD(i);",
            97,
        ),
        ("4.12 INT_TO_CHAR", "c : CHAR; i : INT;", "i := 97; c := INT_TO_CHAR(i); M103.0 := c = 'a';", 1),
        ("4.12 BYTE_TO_CHAR", "c : CHAR; b : BYTE;", "b := 16#41; c := BYTE_TO_CHAR(b); M103.0 := c = 'A';", 1),
        ("4.13 INT_TO_STRING", TEXTS, "i := -12; s := ''; s := INT_TO_STRING(i); M103.0 := s = '-12';", 1),
        ("4.13 DINT_TO_STRING", TEXTS, "d := 100000; s := ''; s := DINT_TO_STRING(d); M103.0 := s = '+100000';", 1),
        ("4.13 REAL_TO_STRING", TEXTS, "r := 1.0; s := ''; s := REAL_TO_STRING(r); MW102 := INT_TO_WORD(LEN(s));", 14),
        ("4.13 STRING_TO_INT", TEXTS, "s := '-123'; MW102 := INT_TO_WORD(STRING_TO_INT(s));", 0xFF85),
        ("4.13 STRING_TO_DINT", TEXTS, "s := '100000'; MD100 := DINT_TO_DWORD(STRING_TO_DINT(s));", 100_000),
        ("4.13 BLOCK_DB", "w : WORD;", "w := 7; MW102 := BLOCK_DB_TO_WORD(WORD_TO_BLOCK_DB(w));", 7),
        (
            "4.13 S5TIME_TO_TIME",
            "s : S5TIME;",
            "s := S5T#2s; MD100 := DINT_TO_DWORD(TIME_TO_DINT(S5TIME_TO_TIME(s)));",
            2000,
        ),
        ("4.13 TIME_TO_S5TIME", "s : S5TIME; t : TIME;", "t := T#2s; s := TIME_TO_S5TIME(t); M103.0 := s = S5T#2s;", 1),
    ]);
}

#[test]
fn line_14_conversions_of_tia_portal() {
    const TIA: &str = "r : Real; i : Int; d : DInt; w : Word; u : UInt; s : USInt; n : UDInt;";
    tia_rows(&[
        ("4.14 ROUND", TIA, "#r := 3.5; #d := ROUND(#r); MD100 := #d;", 4),
        ("4.14 TRUNC", TIA, "#r := -3.5; #d := TRUNC(#r); MD100 := #d;", 0xFFFF_FFFD),
        ("4.14 CEIL", TIA, "#r := 3.1; #d := CEIL(#r); MD100 := #d;", 4),
        ("4.14 FLOOR", TIA, "#r := -3.1; #d := FLOOR(#r); MD100 := #d;", 0xFFFF_FFFC),
        ("4.14 ROUND_REAL", TIA, "#r := 2.5; #r := ROUND_REAL(#r); MD100 := REAL_TO_DWORD(#r);", real(2.0)),
        ("4.14 TRUNC_INT", TIA, "#r := 2.9; #i := TRUNC_INT(#r); MW102 := #i;", 2),
        ("4.14 CEIL_UINT", TIA, "#r := 39999.5; #u := CEIL_UINT(#r); MW102 := #u;", 40_000),
        ("4.14 half to even", TIA, "#r := 0.5; #i := REAL_TO_INT(#r); MW102 := #i;", 0),
        ("4.14 DWORD_TO_REAL", TIA, "#r := DWORD_TO_REAL(16#3F800000); MD100 := REAL_TO_DWORD(#r);", real(1.0)),
        ("4.14 UINT_TO_REAL", TIA, "#u := 50000; #r := UINT_TO_REAL(#u); MD100 := REAL_TO_DWORD(#r);", real(50_000.0)),
        (
            "4.14 UDINT_TO_REAL",
            TIA,
            "#n := 16#C000_0000; #r := UDINT_TO_REAL(#n); MD100 := REAL_TO_DWORD(#r);",
            real(3_221_225_472.0),
        ),
        ("4.14 REAL_TO_UDINT", TIA, "#r := 3.0E9; #n := REAL_TO_UDINT(#r); MD100 := #n;", 3_000_000_000),
        ("4.14 REAL_TO_UDINT", TIA, "#r := 7.4; #n := REAL_TO_UDINT(#r); MD100 := #n;", 7),
        ("4.14 USINT_TO_INT", TIA, "#s := 200; #i := USINT_TO_INT(#s); MW102 := #i;", 200),
        ("4.14 INT_TO_USINT", TIA, "#i := 511; #s := INT_TO_USINT(#i); MW102 := #s;", 255),
    ]);
    refused("\"f\"", &[("4.14 no type of this name", "#r : Real;", "#r := 1.0; #r := ROUND_TIME(#r);", &["S2101"])]);
}

#[test]
fn line_15_sizes_of_tia_portal() {
    let sizes =
        "DATA_BLOCK DB9 STRUCT a : USInt; b : USInt; c : UInt; d : USInt; e : UDInt; f : DTL; g : UInt; h : WChar;
        END_STRUCT BEGIN END_DATA_BLOCK";
    for (component, word) in [("a", 0), ("c", 2), ("e", 6), ("f.YEAR", 10), ("f.NANOSECOND", 18), ("g", 22), ("h", 24)]
    {
        let statements = format!("\"DB9\".{component} := 1; MD100 := 0; MB103 := DB9.DB[{word}];");
        // The lowest byte is that of the last address.
        let mut cpu = run(sizes, "", &statements.replace("\"DB9\"", "DB9"));
        let first = if matches!(component, "a") { 1 } else { 0 };
        assert_eq!(result(&mut cpu), first, "4.15 {component} begins at {word}");
        let last = word
            + match component {
                "a" => 0,
                "e" | "f.NANOSECOND" => 3,
                _ => 1,
            };
        let mut cpu = run(sizes, "", &format!("DB9.{component} := 1; MB103 := DB9.DB[{last}];"));
        assert_eq!(result(&mut cpu), 1, "4.15 {component} ends at {last}");
    }
    for ty in ["LReal", "LInt", "ULInt", "LWord", "LTime", "LDT", "WString", "SInt"] {
        let text = format!("FUNCTION \"f\" : Void VAR_TEMP x : {ty}; END_VAR BEGIN ; END_FUNCTION\n");
        let found = crate::common::compiled(&text).diagnostics;
        assert_eq!(found.len(), 1, "4.15 {ty} is refused by one message: {found:?}");
    }
}
