//! Section 8 of the sheet: texts and dates, by the functions of the IEC library.

use crate::common::{refused, rows, tia_rows};

const TEXTS: &str = "s : STRING[10]; t : STRING[10]; n : STRING[3]; i : INT; x : BOOL;";

#[test]
fn line_4_texts() {
    rows(&[
        ("8.4 LEN", TEXTS, "s := 'abcd'; MW102 := INT_TO_WORD(LEN(s));", 4),
        ("8.4 LEN of nothing", TEXTS, "s := ''; MW102 := INT_TO_WORD(LEN(s));", 0),
        ("8.4 CONCAT", TEXTS, "s := ''; s := CONCAT(IN1 := 'ab', IN2 := 'cd'); M103.0 := s = 'abcd';", 1),
        ("8.4 LEFT", TEXTS, "s := 'abcd'; s := LEFT(IN := s, L := 2); M103.0 := s = 'ab';", 1),
        ("8.4 RIGHT", TEXTS, "s := 'abcd'; s := RIGHT(IN := s, L := 2); M103.0 := s = 'cd';", 1),
        ("8.4 MID", TEXTS, "s := 'abcd'; s := MID(IN := s, L := 2, P := 2); M103.0 := s = 'bc';", 1),
        ("8.4 INSERT", TEXTS, "s := 'abcd'; s := INSERT(IN1 := s, IN2 := 'XY', P := 1); M103.0 := s = 'aXYbcd';", 1),
        ("8.4 DELETE", TEXTS, "s := 'abcd'; s := DELETE(IN := s, L := 2, P := 2); M103.0 := s = 'ad';", 1),
        (
            "8.4 REPLACE",
            TEXTS,
            "s := 'abcd'; s := REPLACE(IN1 := s, IN2 := 'X', L := 2, P := 2); M103.0 := s = 'aXd';",
            1,
        ),
        ("8.4 FIND", TEXTS, "s := 'abcd'; MW102 := INT_TO_WORD(FIND(IN1 := s, IN2 := 'cd'));", 3),
        ("8.4 FIND of what is not there", TEXTS, "s := 'abcd'; MW102 := INT_TO_WORD(FIND(IN1 := s, IN2 := 'x'));", 0),
        ("8.4 =", TEXTS, "s := 'ab'; t := 'ab'; M103.0 := s = t; M103.1 := s <> t;", 1),
        ("8.4 >= and >", TEXTS, "s := 'b'; t := 'a'; M103.0 := s >= t; M103.1 := s > t; M103.2 := t > s;", 3),
        ("8.4 <= and <", TEXTS, "s := 'a'; t := 'a'; M103.0 := s <= t; M103.1 := s < t;", 1),
        (
            "8.4 within each other",
            TEXTS,
            "s := 'abcd'; s := CONCAT(IN1 := LEFT(IN := s, L := 1), IN2 := RIGHT(IN := s, L := 1)); M103.0 := s = 'ad';",
            1,
        ),
        ("8.4 one text three times", TEXTS, "s := 'ab'; s := CONCAT(IN1 := s, IN2 := s); M103.0 := s = 'abab';", 1),
        ("8.4 a character of it", TEXTS, "s := 'abc'; s[2] := 'X'; M103.0 := s = 'aXc';", 1),
        (
            "8.4 into a component",
            "v : STRUCT a : INT; s : STRING[4]; END_STRUCT;",
            "v.s := 'abc'; v.s := CONCAT(IN1 := v.s, IN2 := 'defg'); M103.0 := v.s = 'abcd';",
            1,
        ),
        (
            "8.4 of an array",
            "v : ARRAY[1..2] OF STRING[4]; i : INT;",
            "i := 2; v[i] := 'abc'; v[i] := CONCAT(IN1 := v[i], IN2 := 'd'); M103.0 := v[2] = 'abcd';",
            1,
        ),
    ]);
    tia_rows(&[
        ("8.4 LEN(IN := s)", "s : String[10];", "#s := 'abc'; MW102 := LEN(IN := #s);", 3),
        ("8.4 without names", "s : String[10];", "#s := CONCAT('ab', 'cd'); MW102 := LEN(#s);", 4),
    ]);
}

#[test]
fn line_8_what_does_not_fit() {
    rows(&[
        ("8.8 cut to the target", TEXTS, "n := ''; n := CONCAT(IN1 := 'ab', IN2 := 'cd'); M103.0 := n = 'abc';", 1),
        ("8.8 CONCAT clears ENO", TEXTS, "n := ''; n := CONCAT(IN1 := 'ab', IN2 := 'cd'); M103.0 := ENO;", 0),
        ("8.8 what fits leaves ENO", TEXTS, "n := ''; n := CONCAT(IN1 := 'a', IN2 := 'bc'); M103.0 := ENO;", 1),
        ("8.8 LEFT of more", TEXTS, "s := 'abc'; t := ''; t := LEFT(IN := s, L := 9); M103.0 := t = 'abc';", 1),
        ("8.8 RIGHT of more", TEXTS, "s := 'abc'; t := ''; t := RIGHT(IN := s, L := 9); M103.0 := t = 'abc';", 1),
        (
            "8.8 MID beyond the end",
            TEXTS,
            "s := 'abcd'; t := ''; t := MID(IN := s, L := 9, P := 3); M103.0 := t = 'cd';",
            1,
        ),
        (
            "8.8 an assignment cuts",
            TEXTS,
            "s := 'abcdef'; n := s; M103.0 := n = 'abc'; MB102 := INT_TO_BYTE(LEN(n));",
            0x0301,
        ),
    ]);
    refused("FC900", &[("8.8 a literal is too long", "n : STRING[3];", "n := 'abcd';", &["S2206"])]);
}

#[test]
fn line_5_dates() {
    const DATES: &str = "a, b : DT; d : DATE; z : TOD; t : TIME; i : INT;";
    const AT: &str = "a := DT#2021-3-4-5:6:7; b := DT#2021-3-4-5:6:8;";
    for (line, statements, expected) in [
        ("8.5 DT_DATE", "d := DT_DATE(a); M103.0 := d = D#2021-3-4;", 1),
        ("8.5 DT_DAY", "MW102 := INT_TO_WORD(DT_DAY(a));", 5),
        ("8.5 DT_TOD", "z := DT_TOD(a); M103.0 := z = TOD#5:6:7;", 1),
        ("8.5 D_TOD_DT", "a := D_TOD_DT(IN1 := D#2021-3-4, IN2 := TOD#5:6:8); M103.0 := a = b;", 1),
        ("8.5 DT + TIME", "a := a + T#1s; M103.0 := a = b;", 1),
        ("8.5 DT - TIME", "b := b - T#1s; M103.0 := a = b;", 1),
        ("8.5 DT - DT", "t := b - a; MD100 := DINT_TO_DWORD(TIME_TO_DINT(t));", 1000),
        ("8.5 =", "M103.0 := a = a; M103.1 := a = b;", 1),
        ("8.5 <>", "M103.0 := a <> b; M103.1 := a <> a;", 1),
        ("8.5 <", "M103.0 := a < b; M103.1 := b < a;", 1),
        ("8.5 <=", "M103.0 := a <= a; M103.1 := b <= a;", 1),
        ("8.5 >", "M103.0 := b > a; M103.1 := a > a;", 1),
        ("8.5 >=", "M103.0 := a >= a; M103.1 := a >= b;", 1),
    ] {
        rows(&[(line, DATES, &*format!("{AT} {statements}").leak(), expected)]);
    }
    const TIA: &str = "a, b : Date_And_Time; t : Time; d : Date; z : Time_Of_Day; n : DTL; i : Int;";
    for (line, statements, expected) in [
        ("8.9 T_ADD of DT", "#a := T_ADD(IN1 := #a, IN2 := T#1s); MD100 := 0; M103.0 := #a = #b;", 1),
        ("8.9 T_SUB of DT", "#b := T_SUB(IN1 := #b, IN2 := T#1s); MD100 := 0; M103.0 := #a = #b;", 1),
        ("8.9 T_DIFF of DT", "#t := T_DIFF(IN1 := #b, IN2 := #a); MD100 := TIME_TO_DINT(#t);", 1000),
        ("8.9 T_ADD of TIME", "#t := T_ADD(IN1 := T#1s, IN2 := T#2s); MD100 := TIME_TO_DINT(#t);", 3000),
        ("8.9 T_COMBINE", "#a := T_COMBINE(IN1 := D#2021-3-4, IN2 := TOD#5:6:8); MD100 := 0; M103.0 := #a = #b;", 1),
        (
            "8.9 RD_SYS_T into a DT",
            "#i := SET_CLK(#b); #i := RD_SYS_T(#a); MD100 := 0; M103.0 := #i = 0 AND #a = #b;",
            1,
        ),
        (
            "8.9 RD_LOC_T into a DTL",
            "#i := SET_CLK(#a); #i := RD_LOC_T(OUT => #n); MW102 := #n.YEAR; MB101 := #n.MONTH; MB100 := #n.WEEKDAY;",
            0x0503_07E5,
        ),
        (
            "8.9 RD_LOC_T into a DTL",
            "#i := SET_CLK(#a); #i := RD_LOC_T(OUT => #n); MB100 := #n.DAY; MB101 := #n.HOUR; MB102 := #n.MINUTE; MB103 := #n.SECOND;",
            0x0405_0607,
        ),
    ] {
        tia_rows(&[(
            line,
            TIA,
            &*format!("{} {statements}", AT.replace("a :=", "#a :=").replace("b :=", "#b :=")).leak(),
            expected,
        )]);
    }
    refused("\"f\"", &[("8.9 RD_SYS_T into a TIME", "t : Time; i : Int;", "#i := RD_SYS_T(#t);", &["S2405"])]);
}
