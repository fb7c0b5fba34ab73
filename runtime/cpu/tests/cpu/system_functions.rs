//! Every system function called from STL in a running CPU: parameters in and out, RET_VAL, BR, and what the CPU does
//! about it.

use std::collections::BTreeSet;

use ob1_cpu::{CpuConfig, CyclicInterrupt, Module, ModuleSlot, OperatingState};
use ob1_model::{BlockId, BlockKind, Event};
use ob1_time::Span;

use crate::common::calls::{module, on_demand};
use crate::common::rack::TestModule;
use crate::common::source::{bench, bench_with, blocks};
use crate::common::{MS, on_each_engine};

/// One call: the block, its call with the result in MW 10 and other results from MB 20 on, the result, BR, and bytes
/// from MB 20 on.
type Row = (&'static str, &'static str, u32, bool, &'static [u8]);

/// Calls that need no event and no second block. `CALL` is put in front, `RET_VAL := MW 10` is written out where there
/// is one.
const CALLS: &[Row] = &[
    ("SFC 0", "(PDT := DB10.at, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 0", "(PDT := P#DB10.DBX 32.0, RET_VAL := MW 10)", 0x8080, false, &[]),
    ("SFC 1", "(RET_VAL := MW 10, CDT := DB10.now)", 0, true, &[]),
    ("SFC 2", "(NR := B#16#0, PV := 100, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 2", "(NR := B#16#9, PV := 100, RET_VAL := MW 10)", 0x8080, false, &[]),
    ("SFC 2", "(NR := B#16#0, PV := -1, RET_VAL := MW 10)", 0x8081, false, &[]),
    ("SFC 3", "(NR := B#16#0, S := TRUE, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 4", "(NR := B#16#0, RET_VAL := MW 10, CQ := M 20.0, CV := MW 22)", 0, true, &[0, 0, 0, 0]),
    ("SFC 6", "(RET_VAL := MW 10, TOP_SI := DB10.top, START_UP_SI := DB10.up)", 0, true, &[]),
    ("SFC 9", "(REQ := TRUE, MODE := B#16#0, MESGN := DW#16#0, RET_VAL := MW 10, BUSY := M 20.0)", 0, true, &[0]),
    ("SFC 10", "(REQ := TRUE, MODE := B#16#9, MESGN := MD 40, RET_VAL := MW 10, BUSY := M 20.0)", 0x8082, false, &[]),
    (
        "SFC 13",
        "(REQ := TRUE, LADDR := W#16#100, RET_VAL := MW 10, RECORD := P#M 20.0 BYTE 6, BUSY := M 30.0)",
        0x8090,
        false,
        &[],
    ),
    ("SFC 14", "(LADDR := W#16#100, RET_VAL := MW 10, RECORD := P#M 20.0 BYTE 4)", 0, true, &[1, 2, 3, 4]),
    ("SFC 14", "(LADDR := W#16#200, RET_VAL := MW 10, RECORD := P#M 20.0 BYTE 4)", 0x8090, false, &[]),
    ("SFC 14", "(LADDR := W#16#100, RET_VAL := MW 10, RECORD := P#M 20.0 BYTE 3)", 0x80B1, false, &[]),
    ("SFC 14", "(LADDR := W#16#100, RET_VAL := MW 10, RECORD := P#M 20.0 WORD 2)", 0x8092, false, &[]),
    ("SFC 15", "(LADDR := W#16#100, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 15", "(LADDR := W#16#200, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10)", 0x8090, false, &[]),
    ("SFC 17", "(SIG := TRUE, ID := W#16#EEEE, EV_ID := DW#16#1, SD := MW 0, RET_VAL := MW 10)", 0x8085, false, &[]),
    ("SFC 18", "(SIG := FALSE, ID := W#16#EEEE, EV_ID := DW#16#2, SD := MW 0, RET_VAL := MW 10)", 0x8087, false, &[]),
    ("SFC 18", "(SIG := TRUE, ID := W#16#EEEE, EV_ID := DW#16#0, SD := MW 0, RET_VAL := MW 10)", 0x8081, false, &[]),
    ("SFC 20", "(SRCBLK := DB10.four, RET_VAL := MW 10, DSTBLK := P#M 20.0 BYTE 4)", 0, true, &[5, 6, 7, 8]),
    ("SFC 20", "(SRCBLK := P#DB99.DBX 0.0 BYTE 4, RET_VAL := MW 10, DSTBLK := P#M 20.0 BYTE 4)", 0x813A, false, &[]),
    ("SFC 20", "(SRCBLK := P#M 0.0 BYTE 4, RET_VAL := MW 10, DSTBLK := P#DB11.DBX 0.0 BYTE 2)", 0x8330, false, &[]),
    ("SFC 20", "(SRCBLK := T 1, RET_VAL := MW 10, DSTBLK := P#M 20.0 BYTE 4)", 0x8124, false, &[]),
    ("SFC 20", "(SRCBLK := P#M 250.0 BYTE 10, RET_VAL := MW 10, DSTBLK := P#M 20.0 BYTE 10)", 0x8122, false, &[]),
    ("SFC 21", "(BVAL := DB10.two, RET_VAL := MW 10, BLK := P#M 20.0 BYTE 5)", 0, true, &[5, 6, 5, 6, 5]),
    (
        "SFC 22",
        "(LOW_LIMIT := W#16#40, UP_LIMIT := W#16#41, COUNT := W#16#8, RET_VAL := MW 10, DB_NUMBER := MW 20)",
        0,
        true,
        &[0, 0x40],
    ),
    (
        "SFC 22",
        "(LOW_LIMIT := W#16#41, UP_LIMIT := W#16#40, COUNT := W#16#8, RET_VAL := MW 10, DB_NUMBER := MW 20)",
        0x80A1,
        false,
        &[],
    ),
    (
        "SFC 22",
        "(LOW_LIMIT := W#16#A, UP_LIMIT := W#16#B, COUNT := W#16#8, RET_VAL := MW 10, DB_NUMBER := MW 20)",
        0x80B1,
        false,
        &[],
    ),
    (
        "SFC 22",
        "(LOW_LIMIT := W#16#40, UP_LIMIT := W#16#41, COUNT := W#16#7, RET_VAL := MW 10, DB_NUMBER := MW 20)",
        0x80A2,
        false,
        &[],
    ),
    ("SFC 23", "(DB_NUMBER := W#16#A, RET_VAL := MW 10)", 0x80B3, false, &[]),
    ("SFC 23", "(DB_NUMBER := W#16#63, RET_VAL := MW 10)", 0x80B1, false, &[]),
    (
        "SFC 24",
        "(DB_NUMBER := W#16#B, RET_VAL := MW 10, DB_LENGTH := MW 20, WRITE_PROT := M 22.0)",
        0,
        true,
        &[0, 2, 1],
    ),
    (
        "SFC 24",
        "(DB_NUMBER := W#16#63, RET_VAL := MW 10, DB_LENGTH := MW 20, WRITE_PROT := M 22.0)",
        0x80B1,
        false,
        &[],
    ),
    ("SFC 26", "(PART := B#16#0, RET_VAL := MW 10, FLADDR := MW 20)", 0, true, &[]),
    ("SFC 26", "(PART := B#16#1, RET_VAL := MW 10, FLADDR := MW 20)", 0x8091, false, &[]),
    ("SFC 27", "(PART := B#16#1F, RET_VAL := MW 10, FLADDR := MW 20)", 0x8090, false, &[]),
    ("SFC 28", "(OB_NR := 10, SDT := DB10.at, PERIOD := W#16#1001, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 29", "(OB_NR := 10, RET_VAL := MW 10)", 0x80A0, false, &[]),
    ("SFC 30", "(OB_NR := 10, RET_VAL := MW 10)", 0x80A0, false, &[]),
    ("SFC 31", "(OB_NR := 10, RET_VAL := MW 10, STATUS := MW 20)", 0, true, &[0, 0x10]),
    ("SFC 31", "(OB_NR := 20, RET_VAL := MW 10, STATUS := MW 20)", 0x8090, false, &[]),
    ("SFC 32", "(OB_NR := 20, DTIME := T#5S, SIGN := W#16#1, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 32", "(OB_NR := 20, DTIME := T#0S, SIGN := W#16#1, RET_VAL := MW 10)", 0x8091, false, &[]),
    ("SFC 33", "(OB_NR := 20, RET_VAL := MW 10)", 0x80A0, false, &[]),
    ("SFC 34", "(OB_NR := 20, RET_VAL := MW 10, STATUS := MW 20)", 0, true, &[0, 0x10]),
    (
        "SFC 36",
        "(PRGFLT_SET_MASK := DW#16#2, ACCFLT_SET_MASK := DW#16#C, RET_VAL := MW 10, PRGFLT_MASKED := MD 20, ACCFLT_MASKED := MD 24)",
        0,
        true,
        &[0, 0, 0, 2, 0, 0, 0, 12],
    ),
    (
        "SFC 37",
        "(PRGFLT_RESET_MASK := DW#16#2, ACCFLT_RESET_MASK := DW#16#0, RET_VAL := MW 10, PRGFLT_MASKED := MD 20, ACCFLT_MASKED := MD 24)",
        1,
        true,
        &[0; 8],
    ),
    (
        "SFC 38",
        "(PRGFLT_QUERY := DW#16#2, ACCFLT_QUERY := DW#16#0, RET_VAL := MW 10, PRGFLT_CLR := MD 20, ACCFLT_CLR := MD 24)",
        1,
        true,
        &[0; 8],
    ),
    ("SFC 39", "(MODE := B#16#2, OB_NR := 35, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 39", "(MODE := B#16#2, OB_NR := 1, RET_VAL := MW 10)", 0x8090, false, &[]),
    ("SFC 40", "(MODE := B#16#0, OB_NR := 0, RET_VAL := MW 10)", 0, true, &[]),
    ("SFC 40", "(MODE := B#16#7, OB_NR := 0, RET_VAL := MW 10)", 0x8091, false, &[]),
    ("SFC 41", "(RET_VAL := MW 10)", 1, true, &[]),
    ("SFC 42", "(RET_VAL := MW 10)", 0x8080, false, &[]),
    ("SFC 43", "", 0, true, &[]),
    ("SFC 44", "(VAL := DW#16#1, RET_VAL := MW 10)", 0x8080, false, &[]),
    ("SFC 47", "(WT := 100)", 0, true, &[]),
    (
        "SFC 51",
        "(REQ := TRUE, SZL_ID := W#16#74, INDEX := W#16#0, RET_VAL := MW 10, BUSY := M 12.0, SZL_HEADER := DB10.head, DR := P#M 20.0 BYTE 8)",
        0x0081,
        true,
        &[0, 1, 0, 0, 0, 4, 1, 0],
    ),
    (
        "SFC 51",
        "(REQ := TRUE, SZL_ID := W#16#9999, INDEX := W#16#0, RET_VAL := MW 10, BUSY := M 12.0, SZL_HEADER := DB10.head, DR := P#M 20.0 BYTE 8)",
        0x8082,
        false,
        &[],
    ),
    (
        "SFC 51",
        "(REQ := TRUE, SZL_ID := W#16#174, INDEX := W#16#99, RET_VAL := MW 10, BUSY := M 12.0, SZL_HEADER := DB10.head, DR := P#M 20.0 BYTE 8)",
        0x8083,
        false,
        &[],
    ),
    ("SFC 52", "(SEND := FALSE, EVENTN := W#16#A123, INFO1 := MW 0, INFO2 := MD 0, RET_VAL := MW 10)", 0, true, &[]),
    (
        "SFC 52",
        "(SEND := TRUE, EVENTN := W#16#A123, INFO1 := MW 0, INFO2 := MD 0, RET_VAL := MW 10)",
        0x8091,
        false,
        &[],
    ),
    (
        "SFC 52",
        "(SEND := FALSE, EVENTN := W#16#1234, INFO1 := MW 0, INFO2 := MD 0, RET_VAL := MW 10)",
        0x8085,
        false,
        &[],
    ),
    (
        "SFC 58",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#5, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10, BUSY := M 12.0)",
        0x80B0,
        false,
        &[],
    ),
    // A record by which handling blocks exchange data with their module is unknown to a program.
    (
        "SFC 58",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#80, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10, BUSY := M 12.0)",
        0x80B0,
        false,
        &[],
    ),
    (
        "SFC 55",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#80, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10, BUSY := M 12.0)",
        0x80B0,
        false,
        &[],
    ),
    (
        "SFC 58",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#90, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10, BUSY := M 12.0)",
        0,
        true,
        &[],
    ),
    (
        "SFC 55",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#90, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10, BUSY := M 12.0)",
        0,
        true,
        &[],
    ),
    (
        "SFC 58",
        "(REQ := FALSE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#5, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10, BUSY := M 12.0)",
        0x7000,
        true,
        &[],
    ),
    (
        "SFC 59",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#1, RET_VAL := MW 10, BUSY := M 12.0, RECORD := P#M 20.0 BYTE 2)",
        1,
        true,
        &[0x42, 0],
    ),
    (
        "SFC 59",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#300, RECNUM := B#16#1, RET_VAL := MW 10, BUSY := M 12.0, RECORD := P#M 20.0 BYTE 2)",
        0x8090,
        false,
        &[],
    ),
    ("SFC 64", "(RET_VAL := MD 20)", 0, true, &[0, 0, 0]),
    (
        "SFC 78",
        "(OB_NR := 0, RET_VAL := MW 10, PRIO := MW 20, LAST_RT := MD 22, LAST_ET := MD 26, CUR_T := MD 30, CUR_RT := MD 34, CUR_ET := MD 38, NEXT_ET := MD 42)",
        1,
        true,
        &[0, 1],
    ),
    (
        "SFC 78",
        "(OB_NR := 35, RET_VAL := MW 10, PRIO := MW 20, LAST_RT := MD 22, LAST_ET := MD 26, CUR_T := MD 30, CUR_RT := MD 34, CUR_ET := MD 38, NEXT_ET := MD 42)",
        35,
        true,
        &[0, 12, 0xFF, 0xFF, 0xFF, 0xFF],
    ),
    (
        "SFC 78",
        "(OB_NR := 121, RET_VAL := MW 10, PRIO := MW 20, LAST_RT := MD 22, LAST_ET := MD 26, CUR_T := MD 30, CUR_RT := MD 34, CUR_ET := MD 38, NEXT_ET := MD 42)",
        0x8080,
        false,
        &[],
    ),
    ("SFC 79", "(N := 16, RET_VAL := MW 10, SA := P#P 256.0)", 0, true, &[]),
    ("SFC 80", "(N := 3, RET_VAL := MW 10, SA := P#A 10.2)", 0x8325, false, &[]),
    ("SFC 81", "(SRCBLK := DB10.four, RET_VAL := MW 10, DSTBLK := P#M 20.0 BYTE 3)", 0, true, &[5, 6, 7]),
    (
        "SFC 82",
        "(REQ := TRUE, LOW_LIMIT := W#16#40, UP_LIMIT := W#16#41, COUNT := W#16#8, ATTRIB := B#16#4, SRCBLK := DB10.four, RET_VAL := MW 10, BUSY := M 12.0, DB_NUM := MW 20)",
        0,
        true,
        &[0, 0x40],
    ),
    (
        "SFC 83",
        "(REQ := TRUE, SRCBLK := DB10.four, RET_VAL := MW 10, BUSY := M 12.0, DSTBLK := P#DB10.DBX 60.0 BYTE 4)",
        0,
        true,
        &[],
    ),
    (
        "SFC 84",
        "(REQ := TRUE, SRCBLK := DB10.four, RET_VAL := MW 10, BUSY := M 12.0, DSTBLK := P#DB10.DBX 60.0 BYTE 4)",
        0,
        true,
        &[],
    ),
    ("SFB 0", ", DB 100 (CU := TRUE, R := FALSE, PV := 5, Q := M 12.0, CV := MW 20)", 0, true, &[0, 1]),
    ("SFB 1", ", DB 101 (CD := TRUE, LOAD := FALSE, PV := 5, Q := M 12.0, CV := MW 20)", 0, true, &[0xFF, 0xFF]),
    (
        "SFB 2",
        ", DB 102 (CU := TRUE, CD := FALSE, R := FALSE, LOAD := FALSE, PV := 5, QU := M 12.0, QD := M 12.1, CV := MW 20)",
        0,
        true,
        &[0, 1],
    ),
    ("SFB 3", ", DB 103 (IN := TRUE, PT := T#1S, Q := M 20.0, ET := MD 22)", 0, true, &[1]),
    ("SFB 4", ", DB 104 (IN := TRUE, PT := T#1S, Q := M 20.0, ET := MD 22)", 0, true, &[0]),
    ("SFB 5", ", DB 105 (IN := TRUE, PT := T#1S, Q := M 20.0, ET := MD 22)", 0, true, &[1]),
    ("SFB 1000", ", DB 106 (CU := TRUE, R := FALSE, PV := 5, Q := M 12.0, CV := MW 20)", 0, true, &[0, 1]),
    ("SFB 1001", ", DB 107 (CD := TRUE, LD := FALSE, PV := 5, Q := M 12.0, CV := MW 20)", 0, true, &[0xFF, 0xFF]),
    ("SFB 1002", ", DB 108 (CU := TRUE, PV := 1, QU := M 20.0, CV := MW 22)", 0, true, &[1, 0, 0, 1]),
    ("SFB 1003", ", DB 109 (IN := TRUE, PT := T#1S, Q := M 20.0, ET := MD 22)", 0, true, &[1]),
    ("SFB 1004", ", DB 110 (IN := TRUE, PT := T#1S, Q := M 20.0, ET := MD 22)", 0, true, &[0]),
    ("SFB 1005", ", DB 111 (IN := TRUE, PT := T#1S, Q := M 20.0, ET := MD 22)", 0, true, &[1]),
    ("SFB 1006", ", DB 112 (CLK := TRUE, Q := M 20.0)", 0, true, &[1]),
    ("SFB 1007", ", DB 113 (CLK := TRUE, Q := M 20.0)", 0, true, &[0]),
    ("SFB 31", ", DB 231 (SIG_1 := TRUE, EV_ID := DW#16#31, STATUS := MW 20)", 0, false, &[0, 1]),
    ("SFB 33", ", DB 233 (SIG := TRUE, EV_ID := DW#16#33, STATUS := MW 20)", 0, false, &[0, 1]),
    ("SFB 34", ", DB 234 (SIG_8 := TRUE, EV_ID := DW#16#34, STATUS := MW 20)", 0, false, &[0, 1]),
    ("SFB 35", ", DB 235 (SIG_1 := TRUE, EV_ID := DW#16#0, STATUS := MW 20)", 0, false, &[0, 4]),
    ("SFB 36", ", DB 236 (SIG := TRUE, EV_ID := DW#16#36, STATUS := MW 20)", 0, false, &[0, 1]),
    ("SFB 37", ", DB 237 (REQ := TRUE, AR_ID := DW#16#5, SD_1 := MD 30, STATUS := MW 20)", 0, false, &[0, 1]),
    ("SFB 32", ", DB 132 (RESET := TRUE, ERR_CODE := MW 20)", 0, false, &[]),
    (
        "SFB 52",
        ", DB 152 (REQ := TRUE, ID := DW#16#100, INDEX := 1, MLEN := 0, VALID := M 20.0, STATUS := MD 22, LEN := MW 26, RECORD := P#M 30.0 BYTE 4)",
        0,
        true,
        &[1, 0, 0, 0, 0, 0, 0, 1],
    ),
    (
        "SFB 53",
        ", DB 153 (REQ := TRUE, ID := DW#16#100, INDEX := 5, LEN := 0, DONE := M 20.0, STATUS := MD 22, RECORD := P#M 30.0 BYTE 4)",
        0,
        false,
        &[0, 0, 0xDF, 0x80, 0xB0, 0],
    ),
    (
        "SFB 54",
        ", DB 154 (MODE := 1, F_ID := DW#16#0, MLEN := 0, NEW := M 20.0, STATUS := MD 22, TINFO := P#M 30.0 BYTE 28, AINFO := P#M 60.0 BYTE 8)",
        0,
        true,
        &[0, 0, 0, 0, 0, 0],
    ),
    (
        "SFC 5",
        "(SUBNETID := B#16#0, RACK := W#16#0, SLOT := W#16#4, SUBSLOT := B#16#0, SUBADDR := W#16#3, RET_VAL := MW 10, IOID := MB 20, LADDR := MW 22)",
        0,
        true,
        &[0x54, 0, 1, 3],
    ),
    (
        "SFC 5",
        "(SUBNETID := B#16#0, RACK := W#16#0, SLOT := W#16#5, SUBSLOT := B#16#0, SUBADDR := W#16#0, RET_VAL := MW 10, IOID := MB 20, LADDR := MW 22)",
        0x8099,
        false,
        &[],
    ),
    (
        "SFC 11",
        "(REQ := TRUE, LADDR := W#16#100, GROUP := B#16#1, MODE := B#16#1, RET_VAL := MW 10, BUSY := M 30.0)",
        0x8090,
        false,
        &[],
    ),
    (
        "SFC 12",
        "(REQ := TRUE, MODE := B#16#0, LADDR := W#16#100, RET_VAL := MW 10, BUSY := M 30.0)",
        0x8090,
        false,
        &[],
    ),
    ("SFC 19", "(EV_ID := DW#16#77, RET_VAL := MW 10, STATE := M 20.0, Q_STATE := M 20.1)", 0x8082, false, &[]),
    (
        "SFC 49",
        "(IOID := B#16#54, LADDR := W#16#102, RET_VAL := MW 10, AREA := MB 20, RACK := MW 22, SLOT := MW 24, SUBADDR := MW 26)",
        0,
        true,
        &[1, 0, 0, 0, 0, 4, 0, 2],
    ),
    (
        "SFC 50",
        "(IOID := B#16#54, LADDR := W#16#100, RET_VAL := MW 10, PEADDR := P#M 30.0 WORD 4, PECOUNT := MW 20, PAADDR := P#M 40.0 WORD 4, PACOUNT := MW 22)",
        0,
        true,
        &[0, 4, 0, 4],
    ),
    (
        "SFC 55",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#200, RECNUM := B#16#5, RECORD := P#M 0.0 BYTE 4, RET_VAL := MW 10, BUSY := M 30.0)",
        0x8090,
        false,
        &[],
    ),
    (
        "SFC 56",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#5, RET_VAL := MW 10, BUSY := M 30.0)",
        0x80D1,
        false,
        &[],
    ),
    (
        "SFC 57",
        "(REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RET_VAL := MW 10, BUSY := M 30.0)",
        0x80D2,
        false,
        &[],
    ),
    (
        "SFC 70",
        "(MASTER := 0, STATION := 0, SLOT := 4, SUBSLOT := 0, RET_VAL := MW 10, LADDR := MW 20)",
        0,
        true,
        &[1, 0],
    ),
    (
        "SFC 71",
        "(LADDR := W#16#8102, RET_VAL := MW 10, AREA := MW 20, MASTER := MW 22, STATION := MW 24, SLOT := MW 26, SUBSLOT := MW 28, OFFSET := MW 30)",
        0,
        true,
        &[0, 1, 0, 0, 0, 0, 0, 4, 0, 0, 0, 2],
    ),
    (
        "SFC 72",
        "(REQ := TRUE, CONT := FALSE, IOID := B#16#54, LADDR := W#16#100, VAR_ADDR := P#M 0.0 BYTE 2, RET_VAL := MW 10, BUSY := M 30.0, RD := P#M 40.0 BYTE 2)",
        0x8090,
        false,
        &[],
    ),
    (
        "SFC 73",
        "(REQ := TRUE, CONT := FALSE, IOID := B#16#54, LADDR := W#16#100, VAR_ADDR := P#M 0.0 BYTE 2, SD := P#M 40.0 BYTE 2, RET_VAL := MW 10, BUSY := M 30.0)",
        0x8090,
        false,
        &[],
    ),
    (
        "SFC 74",
        "(REQ := FALSE, IOID := B#16#54, LADDR := W#16#100, RET_VAL := MW 10, BUSY := M 30.0)",
        0x7000,
        true,
        &[],
    ),
    (
        "SFC 100",
        "(MODE := B#16#3, PDT := DB10.at, CORR := 2, SUMMER := FALSE, ANN_1 := FALSE, RET_VAL := MW 10)",
        0,
        true,
        &[],
    ),
    (
        "SFC 101",
        "(NR := B#16#1, MODE := B#16#4, PV := L#70000, RET_VAL := MW 10, CQ := M 20.0, CV := MD 22)",
        0,
        true,
        &[0, 0, 0, 1, 0x11, 0x70],
    ),
    (
        "SFC 105",
        "(MODE := 1, SI_ID := DW#16#0, RET_VAL := MW 10, N_SI := MW 20, SYS_INST := P#M 30.0 BYTE 24)",
        0,
        true,
        &[0, 0],
    ),
    ("SFC 106", "(MODE := 4, SI_ID := DW#16#0, RET_VAL := MW 10)", 0x8084, false, &[]),
    (
        "SFC 107",
        "(SIG := TRUE, ID := W#16#EEEE, EV_ID := DW#16#3, CMP_ID := DW#16#9, SD := MW 0, RET_VAL := MW 10)",
        0x8085,
        false,
        &[],
    ),
    (
        "SFC 108",
        "(SIG := FALSE, ID := W#16#EEEE, EV_ID := DW#16#4, CMP_ID := DW#16#9, SD := MW 0, RET_VAL := MW 10)",
        0x8087,
        false,
        &[],
    ),
    ("SFB 41", ", DB 141 (MAN_ON := TRUE, MAN := 5.000000e+001, LMN := MD 20)", 0, true, &[0x42, 0x48, 0, 0]),
    ("SFB 42", ", DB 142 (LMNS_ON := TRUE, LMNUP := TRUE, QLMNUP := M 20.0)", 0, true, &[1]),
    ("SFB 43", ", DB 143 (MAN_ON := TRUE, POS_P_ON := TRUE, QPOS_P := M 20.0)", 0, true, &[1]),
];

#[test]
fn every_system_function_answers_a_running_program() {
    on_each_engine(|| {
        let (mut seen, mut wrong) = (BTreeSet::new(), Vec::new());
        for (block, call, result, br, bytes) in CALLS {
            let text = format!("CALL {block} {call}");
            let (_, modules) = module();
            let mut bench = bench_with(&on_demand(&text), &[], CpuConfig::default(), modules);
            bench.clock.per_statement = Span::ZERO;
            bench.run();
            bench.set_m(0, 0, true);
            bench.run();
            assert_eq!(bench.mb(1), 7, "{text}: the program goes on");
            let got = (bench.mw(10), bench.m(0, 1));
            let memory = &bench.cpu.bit_memory()[20..20 + bytes.len()];
            if got != (*result, *br) || memory != *bytes {
                wrong.push(format!("{text}: {:04X} {} {memory:02X?}", got.0, got.1));
            }
            seen.insert(block.replace(' ', ""));
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
        // SFC 46 ends the program: a test of its own.
        let all: BTreeSet<String> = blocks(&[]).iter().map(|block| block.id().to_string().replace(' ', "")).collect();
        let missing: Vec<_> = all.iter().filter(|id| !seen.contains(*id) && *id != "SFC46").collect();
        assert!(missing.is_empty(), "not called: {missing:?}");
        assert!(blocks(&[]).iter().any(|block| block.id() == BlockId::new(BlockKind::Sfc, 46)));
    });
}

#[test]
fn sfc_46_stops_the_cpu_and_says_where() {
    on_each_engine(|| {
        let mut bench =
            bench("ORGANIZATION_BLOCK OB 1 BEGIN NOP 0;\nCALL SFC 46; L 1; T MB 5; END_ORGANIZATION_BLOCK", &[]);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        let entry = *bench.cpu.diagnostics().next().expect("an entry");
        assert_eq!((entry.event, entry.site.map(|s| s.line)), (Event::STOP_PROGRAM, Some(2)));
        assert_eq!(bench.mb(5), 0);
    });
}

#[test]
fn a_substitute_value_for_a_load_that_fails() {
    on_each_engine(|| {
        let source = "
            ORGANIZATION_BLOCK OB 122 VAR_TEMP info : ARRAY[0..19] OF BYTE; END_VAR BEGIN
            CALL SFC 44 (VAL := DW#16#12345678, RET_VAL := MW 10); U BIE; = M 0.1; END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 121 VAR_TEMP info : ARRAY[0..19] OF BYTE; END_VAR BEGIN
            CALL SFC 44 (VAL := DW#16#99, RET_VAL := MW 10); END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN
            L 5; L PEW 300; T MD 20; TAK; T MD 24; L MW 9000; T MD 28; END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &[]);
        bench.run();
        assert_eq!((bench.md(20), bench.md(24), bench.mw(10), bench.m(0, 1)), (0x1234_5678, 5, 0, true));
        assert_eq!(bench.md(28), 0x99, "OB 121 too");
    });
}

#[test]
fn the_process_image_is_updated_by_the_program() {
    on_each_engine(|| {
        let source = "
            ORGANIZATION_BLOCK OB 1 BEGIN
            L W#16#A5C3; T AW 8; CALL SFC 27 (PART := B#16#0, RET_VAL := MW 10, FLADDR := MW 12);
            CALL SFC 26 (PART := B#16#0, RET_VAL := MW 14, FLADDR := MW 16); L EW 8; T MW 20; END_ORGANIZATION_BLOCK";
        let module = TestModule::new(4);
        let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![(ModuleSlot::new("io", 8), Box::new(module.clone()))];
        let mut bench = bench_with(source, &[], CpuConfig::default(), modules);
        bench.run();
        let writes = module.look(|seen| seen.writes.len());
        bench.run();
        module.look(|seen| assert_eq!((seen.writes.len(), &seen.outputs[..2]), (writes + 2, &[0xA5, 0xC3][..])));
        assert_eq!((bench.mw(10), bench.mw(14)), (0, 0));
        module.look(|seen| seen.absent = true);
        bench.run();
        assert_eq!((bench.mw(10), bench.mw(12), bench.mw(14), bench.mw(16)), (0x80A0, 8, 0x80A0, 8));
    });
}

#[test]
fn waiting_lets_time_pass_and_higher_classes_run() {
    on_each_engine(|| {
        let source = "
            ORGANIZATION_BLOCK OB 35 BEGIN L MW 0; + 1; T MW 0; END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN CALL SFC 47 (WT := 30000); L MW 0; T MW 2; END_ORGANIZATION_BLOCK";
        let config = CpuConfig { cyclic: vec![CyclicInterrupt::new(35, 7 * MS)], ..CpuConfig::default() };
        let mut bench = bench_with(source, &[], config.clone(), vec![]);
        bench.run();
        assert_eq!((bench.mw(2), bench.clock.now.millis()), (4, 30), "at 7, 14, 21 and 28 ms");
        let late = bench.ob_figures(35).lateness.max();
        assert!(late < MS / 100, "{late}");
        // The watchdog expires while it waits.
        let mut bench = bench_with(source, &[], CpuConfig { watchdog: 20 * MS, ..config }, vec![]);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!((bench.events()[..2].to_vec(), bench.clock.now.millis()), (vec![0x4568, 0x3501], 20));
    });
}

#[test]
fn the_alarm_of_the_running_ob() {
    on_each_engine(|| {
        let source = "
            FUNCTION FC 1 : VOID BEGIN
            CALL SFB 54 , DB 54 (MODE := 1, F_ID := DW#16#0, MLEN := 0, NEW := M 20.0, STATUS := MD 22, ID := MD 26, LEN := MW 30,
            TINFO := P#M 40.0 BYTE 28, AINFO := P#M 70.0 BYTE 12);
            END_FUNCTION
            ORGANIZATION_BLOCK OB 40 BEGIN CALL FC 1; END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 82 BEGIN CALL FC 1; END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 1 BEGIN NOP 0; END_ORGANIZATION_BLOCK";
        let (module, modules) = module();
        let mut bench = bench_with(source, &[], CpuConfig::default(), modules);
        bench.run();
        bench.cpu.fire_hardware_interrupt(40, 0x100, 0x0102_0304).expect("loaded");
        bench.run();
        assert_eq!((bench.m(20, 0), bench.md(22), bench.md(26), bench.mw(30)), (true, 0, 0x100, 8));
        assert_eq!((bench.md(40), bench.md(70), bench.md(74)), (0x1141_1028, 0x0800_0400, 0x0102_0304));
        let data = {
            let mut data = [0; 16];
            data[..4].copy_from_slice(&[1, 2, 3, 4]);
            data
        };
        let event = ob1_cpu::ModuleEvent { event: Event::CP_ERROR, diagnostic_interrupt: true, data, len: 4 };
        module.look(|seen| seen.events.push(event));
        bench.run();
        assert_eq!((bench.md(40), bench.md(26), bench.md(74)), (0x3942_1A52, 0x100, 0x0102_0304));
    });
}
