//! Section 7 of the sheet: OK, EN, ENO and BR.

use crate::common::{refused, rows_behind};

const ANY: &str = "a, b : INT; x : BOOL; r : REAL;";

/// FC501 hands over what it gets as OK; FC502 counts its calls in MW50; FC503 leaves OK alone.
const BLOCKS: &str = "FUNCTION FC501 : INT VAR_INPUT x : BOOL; END_VAR BEGIN OK := x; FC501 := 5; END_FUNCTION
    FUNCTION FC502 : INT VAR_INPUT n : INT; END_VAR VAR_OUTPUT q : INT; END_VAR
    BEGIN MW50 := INT_TO_WORD(WORD_TO_INT(MW50) + 1); q := n; FC502 := n * 2; END_FUNCTION
    FUNCTION FC503 : INT VAR_INPUT n : INT; END_VAR BEGIN FC503 := n + 1; END_FUNCTION
    FUNCTION FC504 : WORD BEGIN IF OK THEN FC504 := 1; ELSE FC504 := 2; END_IF; END_FUNCTION
    FUNCTION_BLOCK FB1 VAR_INPUT x : BOOL; END_VAR VAR_OUTPUT q : BOOL; END_VAR BEGIN OK := x; q := x; END_FUNCTION_BLOCK";

#[test]
fn lines_1_and_4_of_each_block() {
    rows_behind(
        BLOCKS,
        &[
            ("7.1 TRUE at the start", ANY, "MW102 := FC504();", 1),
            (
                "7.1 copied to BR",
                ANY,
                "a := FC501(x := FALSE); M103.0 := ENO; a := FC501(x := TRUE); M103.1 := ENO;",
                2,
            ),
            ("7.1 never used: BR is 1", ANY, "a := FC501(x := FALSE); a := FC503(n := 32767); M103.0 := ENO;", 1),
            ("7.1 readable behind an assignment", ANY, "OK := FALSE; M103.0 := OK; OK := TRUE; M103.1 := OK;", 2),
            (
                "7.1 of a function block",
                ANY,
                "FB1.DB1(x := FALSE); M103.0 := ENO; FB1.DB1(x := TRUE); M103.1 := ENO;",
                2,
            ),
            ("7.4 EN FALSE skips the call", ANY, "a := FC502(EN := FALSE, n := 3, q := b); MW102 := MW50;", 0),
            (
                "7.4 outputs keep their values",
                ANY,
                "b := 9; a := FC502(EN := FALSE, n := 3, q := b); MW102 := INT_TO_WORD(b);",
                9,
            ),
            ("7.4 ENO is FALSE", ANY, "a := FC502(EN := FALSE, n := 3, q := b); M103.0 := ENO;", 0),
            (
                "7.4 EN TRUE calls",
                ANY,
                "x := TRUE; a := FC502(EN := x, n := 3, q := b); M103.0 := ENO; MB102 := INT_TO_BYTE(a + b);",
                0x0901,
            ),
            (
                "7.4 ENO =>",
                ANY,
                "FB1.DB1(x := FALSE, ENO => x); M103.0 := x; FB1.DB1(x := TRUE, ENO => x); M103.1 := x;",
                2,
            ),
            ("7.4 ENO => OK", ANY, "FB1.DB1(x := FALSE, ENO => OK); M103.0 := OK;", 0),
        ],
    );
    refused(
        "FC900",
        &[
            ("7.4 ENO of another type", "a : INT;", "a := 1; a := FC9(ENO => a);", &["S2405"]),
            ("7.4 EN of another type", "a : INT; r : REAL; i : INT;", "i := SFC64(EN := 5.0);", &["S2201"]),
        ],
    );
}

#[test]
fn lines_2_and_3_with_the_option() {
    // The number of a row is: OK behind the statement, and 2 where the calculation went on with the value at hand.
    for (line, declared, statement, expected) in [
        ("7.2 +", "i : INT;", "i := 32767; i := i + 1; IF i = -32768 THEN MB102 := 1; END_IF;", 0x100),
        ("7.2 -", "d : DINT;", "d := -2147483648; d := d - 1; IF d > 0 THEN MB102 := 1; END_IF;", 0x100),
        ("7.2 *", "i : INT;", "i := 300; i := i * 300; MB102 := 1;", 0x100),
        ("7.2 / of INT", "i, k : INT;", "i := 1; k := 0; i := i / k; MB102 := 1;", 0x100),
        ("7.2 / of REAL", "r, q : REAL;", "r := 1.0; q := 0.0; r := r / q; MB102 := 1;", 0x100),
        ("7.2 MOD", "d, e : DINT;", "d := 1; e := 0; d := d MOD e; MB102 := 1;", 0x100),
        ("7.2 SQRT", "r : REAL;", "r := SQRT(-1.0 - r * 0.0); MB102 := 1;", 0x100),
        ("7.2 LN", "r : REAL;", "r := 0.0; r := LN(r - 1.0); MB102 := 1;", 0x100),
        ("7.2 EXP", "r : REAL;", "r := 1000.0; r := EXP(r); MB102 := 1;", 0x100),
        ("7.2 ASIN", "r : REAL;", "r := 2.0; r := ASIN(r); MB102 := 1;", 0x100),
        ("7.2 RND", "r : REAL; d : DINT;", "r := 1.0E12; d := ROUND(r); MB102 := 1;", 0x100),
        ("7.2 TRUNC", "r : REAL; d : DINT;", "r := 1.0E12; d := TRUNC(r); MB102 := 1;", 0x100),
        ("7.2 NEGI", "i : INT;", "i := -32768; i := -i; MB102 := 1;", 0x100),
        ("7.2 nothing happens", "i : INT; r : REAL;", "i := 32766; i := i + 1; r := SQRT(4.0); MB102 := 1;", 0x101),
        ("7.3 ENO behind a standard function", "r : REAL;", "r := -1.0; r := SQRT(r); M102.0 := ENO;", 0),
        ("7.3 ENO behind a standard function", "r : REAL;", "r := 4.0; r := SQRT(r); M102.0 := ENO;", 0x101),
    ] {
        let block = format!(
            "{{SCL_SetOKFlag := 'y'}} FUNCTION FC510 : VOID VAR {declared} END_VAR BEGIN {statement} END_FUNCTION"
        );
        rows_behind(&block, &[(line, "", "FC510(); M103.0 := ENO;", expected)]);
        // Without the option nothing of this clears OK.
        let block = block.replace("'y'", "'n'");
        let kept = if line.starts_with("7.2") { 0x101 } else { continue };
        rows_behind(&block, &[(line, "", "FC510(); M103.0 := ENO;", kept)]);
    }
}

#[test]
fn array_limits_with_the_option() {
    for (option, index, expected) in [("'y'", "3", 1), ("'y'", "4", 0), ("'y'", "0", 0), ("'n'", "4", 1)] {
        let block = format!(
            "{{SCL_MonitorArrayLimits := {option}}} FUNCTION FC510 : VOID VAR_INPUT i : INT; END_VAR
             VAR y : ARRAY[0..9] OF INT; x : ARRAY[1..3] OF INT; z : INT; END_VAR BEGIN y[i] := 1; x[i] := 1; END_FUNCTION"
        );
        let call = &*format!("FC510(i := {index}); M103.0 := ENO;").leak();
        rows_behind(&block, &[("6 monitor array limits", "", call, expected)]);
    }
}

#[test]
fn line_5_of_tia_portal() {
    let blocks = "FUNCTION \"inner\" : Bool VAR_INPUT x : Bool; END_VAR BEGIN #inner := TRUE; ENO := #x; END_FUNCTION
        FUNCTION \"outer\" : Void VAR_TEMP x, y : Bool; END_VAR BEGIN #x := \"inner\"(x := FALSE); M103.0 := ENO; #x := \"inner\"(x := TRUE);
        M103.1 := ENO; #x := \"inner\"(x := FALSE, ENO => #y); M103.2 := #y; END_FUNCTION";
    rows_behind(blocks, &[("7.5 ENO is what the body says", "", "MD100 := 0; \"outer\"();", 2)]);
}
