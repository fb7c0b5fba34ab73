//! No statement is left out in silence: a statement that nothing is found in has operations that write, call or jump.

use ob1_ir::Op;

use crate::common::compiled;

/// Declarations of one function: variables of each kind of type.
const DECLARED: &str = "VAR_TEMP x, y : BOOL; b : BYTE; c : CHAR; w : WORD; i, k : INT; dw : DWORD; d : DINT; r : REAL;
    t : TIME; u : DATE; z : TOD; f : S5TIME; dt : DT; s : STRING[9]; l : STRING[3]; a : ARRAY[0..3] OF INT;
    m : ARRAY[0..1, 1..2] OF STRING[5]; q : ARRAY[0..7] OF BOOL; v : STRUCT p : INT; s : STRING[4]; END_STRUCT;
    any : ANY; END_VAR";

/// What may stand on the left, and what cannot.
const TARGETS: [&str; 32] = [
    "x", "b", "c", "w", "i", "dw", "d", "r", "t", "u", "z", "f", "dt", "s", "l", "a", "a[1]", "a[i]", "m[0, 1]",
    "m[i, k]", "q[i]", "v", "v.p", "v.s", "s[1]", "any", "MW10", "M1.i", "DB9.n", "OK", "FC907", "T3",
];

/// Values of each kind, good ones and such with a mistake in them.
const VALUES: [&str; 76] = [
    "1",
    "-1",
    "70000",
    "1.5",
    "TRUE",
    "'a'",
    "'abc'",
    "T#1s",
    "D#2020-1-1",
    "TOD#1:0:0",
    "S5T#1s",
    "DT#2020-1-1-0:0:0",
    "P#M0.0",
    "x",
    "b",
    "c",
    "w",
    "i",
    "dw",
    "d",
    "r",
    "t",
    "u",
    "z",
    "f",
    "dt",
    "s",
    "l",
    "a",
    "m[i, 1]",
    "v",
    "any",
    "i + k",
    "r * 2",
    "x AND y",
    "b OR w",
    "NOT x",
    "NOT i",
    "i = k",
    "s = l",
    "dt < dt",
    "dt + t",
    "z - t",
    "u - u",
    "CONCAT(IN1 := s, IN2 := l)",
    "LEFT(IN := s, L := i)",
    "MAX(IN1 := , IN2 := 3)",
    "MAX(IN1 := i, IN2 := s)",
    "MUX(K := i)",
    "LIMIT(MN := 1, IN := x, MX := 3)",
    "SEL(G := x, IN0 := s, IN1 := l)",
    "FRAC(s)",
    "ROUND_STRING(r)",
    "TRUNC_S5TIME(r)",
    "ABS(x)",
    "SQRT(s)",
    "SHL(IN := w, N := r)",
    "PEEK(area := 16#84, dbNumber := i, byteOffset := 0)",
    "INT_TO_STRING(i)",
    "STRING_TO_INT(i)",
    "INT_TO_CHAR(i)",
    "BYTE_TO_CHAR(b)",
    "FC910()",
    "FC911()",
    "FC912()",
    "FC913()",
    "RD_SYS_T(dt)",
    "T_ADD(IN1 := dt, IN2 := t)",
    "UPPER_BOUND(ARR := a, DIM := 1)",
    "SWAP(w)",
    "s[i]",
    "v.s[1]",
    "FC907(n := , q := i)",
    "FC907(n := i, q := i)",
    "FC908(ENO => r)",
    "gone(i)",
];

/// Statements that are no assignments.
const OTHERS: [&str; 48] = [
    "DB9();",
    "DB99();",
    "DB99.n := 1;",
    "FB1.DB9();",
    "FB1.DB99();",
    "FB1();",
    "FC907 := 3;",
    "FC901 := 3;",
    "FC908 := 1;",
    "i();",
    "i.p();",
    "FC907(n := 1, q := 2);",
    "FC907(n := 1, q := i, ENO => i);",
    "FC907(n := 1, q := i, ENO => x);",
    "FC907(EN := r, n := 1, q := i);",
    "FC907(n := , q := i);",
    "FC908();",
    "FC908(EN := x);",
    "SFC64();",
    "GOTO;",
    "GOTO 5;",
    "EXIT",
    "CONTINUE;",
    "IF i THEN k := 1; END_IF;",
    "IF x THEN i := 1; ELSE i := 2; ELSE i := 3; END_IF;",
    "IF x THEN i := 1; ELSE i := 2; ELSIF y THEN i := 3; END_IF;",
    "CASE r OF 1: i := 1; END_CASE;",
    "CASE i OF 1 2: k := 1; END_CASE;",
    "CASE i OF k: k := 1; END_CASE;",
    "CASE s OF 1: i := 1; END_CASE;",
    "FOR r := 1 TO 2 DO i := 1; END_FOR;",
    "FOR i := 1 TO s DO k := 1; END_FOR;",
    "FOR i := 1 TO 2 BY r DO k := 1; END_FOR;",
    "FOR 5 := 1 TO 2 DO k := 1; END_FOR;",
    "WHILE i DO k := 1; END_WHILE;",
    "REPEAT k := 1; UNTIL s END_REPEAT;",
    "POKE(area := 16#84, dbNumber := s, byteOffset := 0, value := b);",
    "POKE(area := i, dbNumber := 1, byteOffset := 0, value := b);",
    "POKE(area := 16#83, dbNumber := 0, byteOffset := 10, value := r);",
    "POKE_BOOL(area := 16#83, dbNumber := 0, byteOffset := 10, value := x);",
    "MOVE_BLK(IN := a, COUNT := s, OUT => a[0]);",
    "MOVE_BLK(IN := a[0], COUNT := 1);",
    "FILL_BLK(IN := s, COUNT := 1, OUT => a[0]);",
    "S_ODT(S := x);",
    "S_CU(C_NO := T1, CU := x);",
    "S_PULSE(T_NO := T1, Q := 5);",
    "i ?= k;",
    "?;",
];

/// True for what has an effect besides the registers.
fn has_effect(op: &Op) -> bool {
    matches!(op, Op::Transfer(_) | Op::Assign(_) | Op::Reset(_) | Op::Call(_) | Op::Jump(..) | Op::SaveRlo | Op::End)
        || matches!(op, Op::StartTimer(..) | Op::ResetTimer(_) | Op::CountUp(_) | Op::SetCounter(_))
}

/// What is wrong with a statement: it gives no message, and nothing is made of it.
fn is_lost(statement: &str) -> bool {
    let text = format!(
        "DATA_BLOCK DB9 STRUCT n : INT; END_STRUCT BEGIN END_DATA_BLOCK
         FUNCTION_BLOCK FB1 VAR n : INT; END_VAR BEGIN n := 1; END_FUNCTION_BLOCK
         FUNCTION FC907 : INT VAR_INPUT n : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN q := n; FC907 := n; END_FUNCTION
         FUNCTION FC908 : VOID BEGIN MW20 := 1; END_FUNCTION
         FUNCTION FC910 : CHAR BEGIN FC910 := 'x'; END_FUNCTION
         FUNCTION FC911 : STRING BEGIN FC911 := 'xyz'; END_FUNCTION
         FUNCTION FC912 : DT BEGIN FC912 := DT#2020-1-1-0:0:0; END_FUNCTION
         FUNCTION FC913 : BOOL BEGIN FC913 := TRUE; END_FUNCTION
         FUNCTION FC901 : VOID {DECLARED}\nBEGIN\n{statement}\nEND_FUNCTION\n"
    );
    let line = text.lines().position(|l| l == "BEGIN").unwrap_or_default() as u32 + 2;
    let output = compiled(&text);
    if let Some(fault) = output.diagnostics.iter().find(|d| d.code == "S2902") {
        panic!("{statement}: {fault:?}");
    }
    let block = output.program.blocks.iter().find(|b| b.id.number == 901 && !b.id.kind.has_instance());
    let made = block.is_some_and(|b| b.code.iter().any(|s| s.line == line && has_effect(&s.op)));
    output.is_good() && !made
}

/// What is good here has no finding: a program that is never good would hide every loss.
#[test]
fn the_program_around_a_statement_is_good() {
    assert!(is_lost(""), "without a statement it is good, and has nothing in this line");
    assert!(!is_lost("i := k;"));
}

#[test]
fn every_assignment_has_an_effect_or_a_message() {
    for target in TARGETS {
        for value in VALUES {
            let statement = format!("{target} := {value};");
            assert!(!is_lost(&statement), "{statement}");
        }
    }
}

#[test]
fn every_other_statement_has_an_effect_or_a_message() {
    for statement in OTHERS {
        assert!(!is_lost(statement), "{statement}");
    }
    // Each value as an argument, a condition, an index and a bound.
    for value in VALUES {
        for around in [
            "FC907(n := #, q := i);",
            "k := FC907(n := i, q := i) + #;",
            "IF # THEN i := 1; END_IF;",
            "WHILE # DO i := 1; END_WHILE;",
            "a[#] := 1;",
            "i := a[#];",
            "FOR i := # TO 5 DO k := 1; END_FOR;",
            "FOR i := 1 TO # DO k := 1; END_FOR;",
            "CASE # OF 1: k := 1; END_CASE;",
            "k := SFC20(SRCBLK := #, RET_VAL := i, DSTBLK := a);",
            "k := BLKMOV(SRCBLK := #, DSTBLK := a);",
            "POKE(area := 16#84, dbNumber := 9, byteOffset := 0, value := #);",
            "POKE(area := 16#83, dbNumber := 0, byteOffset := #, value := b);",
            "FILL_BLK(IN := #, COUNT := 2, OUT => a[0]);",
            "S_ODT(T_NO := T1, S := #, TV := #);",
            "s := CONCAT(IN1 := #, IN2 := s);",
        ] {
            let statement = around.replace('#', value);
            assert!(!is_lost(&statement), "{statement}");
        }
    }
}

/// Without the blocks that do it texts are not assigned, and that is said.
#[test]
fn a_program_without_the_blocks_for_texts() {
    let text = format!("FUNCTION FC901 : VOID {DECLARED} BEGIN\nl := s;\nEND_FUNCTION\n");
    let sources = [ob1_stl::Source::new("p.scl", text.as_bytes())];
    let output = ob1_scl::compile(&sources, &ob1_stl::Library::new(), &ob1_stl::Options::default());
    let errors: Vec<_> = output.diagnostics.iter().filter(|d| d.severity == ob1_stl::Severity::Error).collect();
    assert!(errors.len() == 1 && errors[0].message.contains("CONCAT"), "{errors:?}");
}
