//! Statements at the edges of what they do, from source text: what a program leaves in bit memory after one cycle, on
//! each engine.

use crate::common::{on_each_engine, source::bench};

/// A name, blocks before OB 1, its statements, and words of bit memory with what they hold then. M 0.0 is 1.
type Row = (&'static str, &'static str, &'static str, &'static [(u32, u32)]);

const ROWS: &[Row] = &[
    (
        "counters stay at 999 and at 0",
        "",
        "L C#999; CLR; S Z 1; SET; S Z 1; CLR; ZV Z 1; SET; ZV Z 1; L Z 1; T MW 10; LC Z 1; T MW 12;\n\
         L C#1; CLR; S Z 2; SET; S Z 2; CLR; ZR Z 2; SET; ZR Z 2; L Z 2; T MW 14; CLR; ZR Z 2; SET; ZR Z 2; L Z 2; T MW 16;\n\
         L 7; U Z 1; = M 18.0; U Z 2; = M 18.1; U Z 3; = M 18.2;",
        &[(10, 999), (12, 0x999), (14, 0), (16, 0), (18, 0x0100)],
    ),
    (
        "the time base of a timer is that of its value",
        "",
        "CLR; SE T 1; SE T 2; SE T 3; SE T 4; SET; L S5T#9S_990MS; SE T 1; L S5T#1M39S; SE T 2; L S5T#16M39S; SE T 3;\n\
         L S5T#2H46M30S; SE T 4; LC T 1; T MW 10; LC T 2; T MW 12; LC T 3; T MW 14; LC T 4; T MW 16; L T 2; T MW 18;\n\
         L W#16#1000; CLR; SI T 5; SET; SI T 5; U T 5; = M 20.0; LC T 5; T MW 22;",
        &[(10, 0x0999), (12, 0x1990), (14, 0x2999), (16, 0x3999), (18, 990), (20, 0)],
    ),
    (
        "a jump out of a zone of the master control relay leaves it open",
        "",
        "SET; = M 10.0; = M 10.1; = M 10.2; MCRA; CLR; MCR(; SPA out; NOP 0; )MCR; out: SET; = M 10.0; S M 10.3; R M 10.1;\n\
         L 5; T MW 12; MCRD; L 6; T MW 14;",
        &[(10, 0x0600), (12, 0), (14, 6)],
    ),
    (
        "a zone ends with its block, and that of the caller goes on",
        "FUNCTION FC 1 : VOID\nBEGIN\nMCRA; CLR; MCR(; SET; S M 10.0; BEA; )MCR; END_FUNCTION\n\
         FUNCTION FC 2 : VOID\nBEGIN\nSET; S M 10.1; END_FUNCTION\n",
        "MCRA; SET; UC FC 1; S M 10.2; CLR; MCR(; UC FC 2; SET; S M 10.3; )MCR; SET; S M 10.4; MCRD;",
        &[(10, 0x1600)],
    ),
    (
        "an instance data block opened in a function block is what its variables and multi-instances lie in",
        "DATA_BLOCK DB 9\nSTRUCT\n a, b : INT := 70;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
         FUNCTION_BLOCK FB 1\nVAR\n n : INT;\nEND_VAR\nBEGIN\nL #n; + 1; T #n; END_FUNCTION_BLOCK\n\
         FUNCTION_BLOCK FB 2\nVAR\n a : INT;\n b : FB 1;\nEND_VAR\nBEGIN\nCALL #b; AUF DI 9; L #a; T MW 10; CALL #b;\n\
         L DINO; T MW 12; END_FUNCTION_BLOCK\n\
         DATA_BLOCK DB 2\nFB 2\nBEGIN\nEND_DATA_BLOCK\n",
        "CALL FB 2, DB 2; L DB2.DBW 2; T MW 14; L DB9.DBW 2; T MW 16; L DINO; T MW 18;",
        &[(10, 70), (12, 9), (14, 1), (16, 71), (18, 0)],
    ),
    (
        "the data block registers change places, and one without a data block is 0 bytes long",
        "DATA_BLOCK DB 7\nSTRUCT\n a : DINT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
         DATA_BLOCK DB 8\nSTRUCT\n a : INT := 8;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "L DBLG; T MW 10; L DILG; T MW 12; AUF DB 7; TDB; L DBLG; T MW 14; L DILG; T MW 16; AUF DB 8; TDB; L DIW 0; T MW 18;\n\
         L DBNO; T MW 20; L DINO; T MW 22; TDB; L DBW 0; T MW 24;",
        &[(10, 0), (12, 0), (14, 0), (16, 4), (18, 8), (20, 7), (22, 8), (24, 8)],
    ),
    (
        "pointers beyond the last address come round, bits carry into bytes",
        "",
        "L W#16#1234; T MW 4; LAR1 P#65535.7; L P#4.1; +AR1; L MW [AR1,P#0.0]; T MW 10; L B#16#80; T MB 6; LAR1 P#M 3.7;\n\
         U [AR1,P#3.0]; = M 12.0; LAR2 P#M 4.0; +AR2 P#1.7; U [AR2,P#0.7]; = M 12.1; SET; S [AR2,P#8.1]; L P#4.4; T MD 30;\n\
         U M [MD 30]; = M 12.2; L W [AR2,P#0.1]; T MW 16;",
        &[(10, 0x1234), (12, 0x0500), (14, 0x0100), (16, 0x8000)],
    ),
    (
        "conditions of a comparison and of a chain around BE",
        "FUNCTION FC 1 : BOOL\nBEGIN\nL 3; L 5; <I; SAVE; = #RET_VAL; CLR; BEB; U BIE; = M 10.0; END_FUNCTION\n",
        "CALL FC 1 (RET_VAL := M 11.0); U BIE; = M 10.1; SPBI j; NOP 0; j: SET; = M 10.2; UN BIE; = M 10.3;",
        &[(10, 0x0701)],
    ),
];

#[test]
fn what_is_left_in_bit_memory() {
    on_each_engine(|| {
        for (name, blocks, code, words) in ROWS {
            let source =
                format!("{blocks}ORGANIZATION_BLOCK OB 1\nBEGIN\nSET; = M 0.0;\n{code}\nEND_ORGANIZATION_BLOCK\n");
            let mut bench = bench(&source, &[]);
            bench.run();
            for (at, value) in *words {
                assert_eq!(bench.mw(*at), *value, "{name}: MW {at}");
            }
        }
    });
}
