//! Every way to name an operand, from source text: what is read, what is written, and which bytes around it stay.

use crate::common::{on_each_engine, source::bench};

/// How an operand is prepared and named, as bit, byte, word and double word; `-` where there is no such form. Each
/// means byte 24 and, as a bit, 24.5 of its area.
const FORMS: &[(&str, &str, [&str; 4])] = &[
    ("M", "", ["M 24.5", "MB 24", "MW 24", "MD 24"]),
    ("E", "", ["E 24.5", "EB 24", "EW 24", "ED 24"]),
    ("A", "", ["A 24.5", "AB 24", "AW 24", "AD 24"]),
    ("L", "", ["L 24.5", "LB 24", "LW 24", "LD 24"]),
    ("DB", "AUF DB 10;", ["DBX 24.5", "DBB 24", "DBW 24", "DBD 24"]),
    ("DI", "AUF DI 10;", ["DIX 24.5", "DIB 24", "DIW 24", "DID 24"]),
    ("DB", "", ["DB10.DBX 24.5", "DB10.DBB 24", "DB10.DBW 24", "DB10.DBD 24"]),
    ("DI", "", ["DI10.DIX 24.5", "DI10.DIB 24", "DI10.DIW 24", "DI10.DID 24"]),
    // The pointer in M, L, DB and DI.
    ("M", "L P#24.0; T MD 60; L P#24.5; T MD 64;", ["M [MD 64]", "MB [MD 60]", "MW [MD 60]", "MD [MD 60]"]),
    ("A", "L P#24.0; T LD 40; L P#24.5; T LD 44;", ["A [LD 44]", "AB [LD 40]", "AW [LD 40]", "AD [LD 40]"]),
    (
        "DB",
        "AUF DB 10; L P#24.0; T DBD 40; L P#24.5; T DBD 44;",
        ["DBX [DBD 44]", "DBB [DBD 40]", "DBW [DBD 40]", "DBD [DBD 40]"],
    ),
    (
        "DI",
        "AUF DI 10; L P#24.0; T DID 40; L P#24.5; T DID 44;",
        ["DIX [DID 44]", "DIB [DID 40]", "DIW [DID 40]", "DID [DID 40]"],
    ),
    ("L", "L P#24.0; T MD 60; L P#24.5; T MD 64;", ["L [MD 64]", "LB [MD 60]", "LW [MD 60]", "LD [MD 60]"]),
    // Address registers, area in the operand.
    ("E", "LAR1 P#20.3;", ["E [AR1,P#4.2]", "-", "-", "-"]),
    ("E", "LAR1 P#20.0;", ["-", "EB [AR1,P#4.0]", "EW [AR1,P#4.0]", "ED [AR1,P#4.0]"]),
    ("M", "LAR2 P#24.0;", ["M [AR2,P#0.5]", "MB [AR2,P#0.0]", "MW [AR2,P#0.0]", "MD [AR2,P#0.0]"]),
    ("DB", "AUF DB 10; LAR1 P#24.0;", ["DBX [AR1,P#0.5]", "DBB [AR1,P#0.0]", "DBW [AR1,P#0.0]", "DBD [AR1,P#0.0]"]),
    ("DI", "AUF DI 10; LAR2 P#24.0;", ["DIX [AR2,P#0.5]", "DIB [AR2,P#0.0]", "DIW [AR2,P#0.0]", "DID [AR2,P#0.0]"]),
    ("L", "LAR1 P#24.0;", ["L [AR1,P#0.5]", "LB [AR1,P#0.0]", "LW [AR1,P#0.0]", "LD [AR1,P#0.0]"]),
    // Area in the register.
    ("M", "LAR1 P#M 24.0;", ["[AR1,P#0.5]", "B [AR1,P#0.0]", "W [AR1,P#0.0]", "D [AR1,P#0.0]"]),
    ("E", "LAR2 P#E 20.0;", ["[AR2,P#4.5]", "B [AR2,P#4.0]", "W [AR2,P#4.0]", "D [AR2,P#4.0]"]),
    ("A", "LAR1 P#A 24.0;", ["[AR1,P#0.5]", "B [AR1,P#0.0]", "W [AR1,P#0.0]", "D [AR1,P#0.0]"]),
    ("L", "LAR1 P#L 24.0;", ["[AR1,P#0.5]", "B [AR1,P#0.0]", "W [AR1,P#0.0]", "D [AR1,P#0.0]"]),
    ("DB", "AUF DB 10; LAR1 P#DBX 24.0;", ["[AR1,P#0.5]", "B [AR1,P#0.0]", "W [AR1,P#0.0]", "D [AR1,P#0.0]"]),
    ("DI", "AUF DI 10; LAR2 P#DIX 24.0;", ["[AR2,P#0.5]", "B [AR2,P#0.0]", "W [AR2,P#0.0]", "D [AR2,P#0.0]"]),
];

/// The six bytes around the operand, byte 23 to 28, moved to MB 100 on, and from MB 110 on before.
fn around(area: &str, out: bool) -> String {
    let (open, name) = match area {
        "DB" | "DI" => ("AUF DB 10;", "DBB"),
        "L" => ("", "LB"),
        "M" => ("", "MB"),
        "E" => ("", "EB"),
        _ => ("", "AB"),
    };
    let bytes = (0..6).map(|i| {
        if out {
            format!("L {name} {}; T MB {};", 23 + i, 100 + i)
        } else {
            format!("L B#16#{:02X}; T {name} {};", 0x11 * (i + 1), 23 + i)
        }
    });
    format!("{open}{}", bytes.collect::<String>())
}

#[test]
fn what_an_operand_reads_and_writes() {
    on_each_engine(|| {
        for (area, prepare, names) in FORMS {
            for (name, (bits, value, written)) in names.iter().zip([
                // 22h has bit 5: it is read, then reset.
                (1, 1, "110233445566"),
                (8, 0x22, "11A533445566"),
                (16, 0x2233, "11B7A5445566"),
                (32, 0x2233_4455, "11D9C8B7A566"),
            ]) {
                if *name == "-" {
                    continue;
                }
                let (read, write) = if bits == 1 {
                    (format!("U {name}; = M 0.0; L MB 0; T MD 4;"), format!("CLR; = {name};"))
                } else {
                    (format!("L {name}; T MD 4;"), format!("L DW#16#D9C8B7A5; T {name};"))
                };
                let source = format!(
                    "DATA_BLOCK DB 10 STRUCT a : ARRAY[0..63] OF BYTE; END_STRUCT BEGIN END_DATA_BLOCK
                     FUNCTION FC 1 : VOID VAR_TEMP t : ARRAY[0..63] OF BYTE; END_VAR BEGIN
                     {} {prepare} {read} {prepare} {write} {} END_FUNCTION
                     ORGANIZATION_BLOCK OB 1 BEGIN CALL FC 1; END_ORGANIZATION_BLOCK",
                    around(area, false),
                    around(area, true),
                );
                let mut bench = bench(&source, &[]);
                bench.run();
                assert_eq!(bench.md(4), value, "{prepare} L {name}");
                let after: String = bench.cpu.bit_memory()[100..106].iter().map(|b| format!("{b:02X}")).collect();
                assert_eq!(after, written, "{prepare} T {name}");
            }
        }
    });
}

#[test]
fn numbers_in_memory() {
    on_each_engine(|| {
        let source = "
            DATA_BLOCK DB 10 STRUCT a : WORD := W#16#10AA; END_STRUCT BEGIN END_DATA_BLOCK
            DATA_BLOCK DB 11 STRUCT a : WORD := W#16#11BB; END_STRUCT BEGIN END_DATA_BLOCK
            FUNCTION FC 8 : VOID BEGIN L MW 30; + 1; T MW 30; END_FUNCTION
            FUNCTION FC 9 : VOID VAR_INPUT t : TIMER; c : COUNTER; d : BLOCK_DB; f : BLOCK_FC; END_VAR BEGIN
            U #t; = M 32.0; L #c; T MW 34; AUF #d; L DBW 0; T MW 36; UC #f; SET; CC #f; END_FUNCTION
            ORGANIZATION_BLOCK OB 1 VAR_TEMP info : ARRAY[0..19] OF BYTE; n : WORD; END_VAR BEGIN
            L 5; T MW 0; L 6; T #n; L 11; T MW 2; L 8; T MW 4;
            CLR; SI T [MW 0]; L S5T#3S; SET; SI T [MW 0]; L T [MW 0]; T MW 10; L T 5; T MW 12;
            L C#42; CLR; S Z [#n]; SET; S Z [#n]; L Z 6; T MW 14; ZV Z [#n]; LC Z [#n]; T MW 16;
            AUF DB [MW 2]; L DBW 0; T MW 18; AUF DI [MW 2]; L DIW 0; T MW 20; L DINO; T MW 22;
            UC FC [MW 4]; CLR; CC FC [MW 4]; SET; CC FC [MW 4];
            CALL FC 9 (t := T 5, c := Z 6, d := DB 10, f := FC 8);
            END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &[]);
        bench.run();
        assert_eq!([10, 12, 14, 16].map(|at| bench.mw(at)), [300, 300, 42, 0x43]);
        assert_eq!([18, 20, 22].map(|at| bench.mw(at)), [0x11BB, 0x11BB, 11]);
        assert_eq!((bench.m(32, 0), bench.mw(34), bench.mw(36)), (true, 43, 0x10AA));
        assert_eq!(bench.mw(30), 4, "UC and CC, twice each");
    });
}
