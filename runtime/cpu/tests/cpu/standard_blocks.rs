//! Standard blocks called from STL: parameters, instances, pointers and BR on their way between program and block.

use crate::common::source::bench;
use crate::common::{MS, on_each_engine};

#[test]
fn an_iec_timer_and_a_counter_in_virtual_time() {
    on_each_engine(|| {
        let source = "
            DATA_BLOCK DB 4
            SFB 4
            BEGIN
            END_DATA_BLOCK
            DATA_BLOCK DB 5
            SFB 0
            BEGIN
            END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1
            BEGIN
            CALL SFB 4 , DB 4 (IN := M 0.0, PT := T#100MS, Q := M 0.1, ET := MD 4);
            CALL SFB 0 , DB 5 (CU := M 0.1, R := FALSE, PV := 1, Q := M 0.2, CV := MW 8);
            END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &[]);
        bench.run();
        bench.set_m(0, 0, true);
        for (step, q, et, count) in
            [(0, false, 0, 0), (60, false, 60, 0), (39, false, 99, 0), (1, true, 100, 1), (500, true, 100, 1)]
        {
            bench.clock.now += step * MS;
            bench.cycle();
            assert_eq!((bench.m(0, 1), bench.md(4), bench.mw(8)), (q, et, count));
        }
    });
}

#[test]
fn strings_and_dates_of_library_functions() {
    on_each_engine(|| {
        let source = "
            DATA_BLOCK DB 10
            STRUCT
              one : STRING[10] := 'ab';
              sum : STRING[3];
              at : DATE_AND_TIME := DT#99-12-31-23:59:59.999;
              next : DATE_AND_TIME;
            END_STRUCT
            BEGIN
            END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1
            BEGIN
            CALL FC 2 (IN1 := DB10.one, IN2 := DB10.one, RET_VAL := DB10.sum);
            U BIE;
            = M 0.0;
            CALL FC 1 (T := DB10.at, D := T#1MS, RET_VAL := DB10.next);
            U BIE;
            = M 0.1;
            CALL FC 105 (IN := 13824, HI_LIM := 100.0, LO_LIM := 0.0, BIPOLAR := FALSE, RET_VAL := MW 2, OUT := MD 4);
            END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &["IEC:CONCAT", "IEC:AD_DT_TM", "TI-S7:SCALE"]);
        bench.run();
        assert_eq!((bench.dbw(10, 12), bench.dbw(10, 14)), (0x0303, u32::from(u16::from_be_bytes(*b"ab"))));
        assert_eq!((bench.m(0, 0), bench.m(0, 1)), (false, true), "cut off; inside");
        assert_eq!((bench.dbw(10, 26), bench.dbw(10, 28)), (0x0001, 0x0100), "2000-01-01");
        assert_eq!(bench.md(4), 50f32.to_bits());
    });
}

#[test]
fn any_pointers_of_operands() {
    on_each_engine(|| {
        let source = "
            ORGANIZATION_BLOCK OB 1
            VAR_TEMP
              info : ARRAY[1..20] OF BYTE;
              low : INT;
              input : INT;
              high : INT;
              result : INT;
            END_VAR
            BEGIN
            L -5;
            T #low;
            L 7;
            T #input;
            L 3;
            T #high;
            CALL FC 22 (MN := #low, IN := #input, MX := #high, RET_VAL := #result);
            U BIE;
            = M 0.0;
            L #result;
            T MW 4;
            CALL SFC 20 (SRCBLK := #low, RET_VAL := MW 6, DSTBLK := MW 8);
            CALL FC 22 (MN := #low, IN := MW 4, MX := #high, RET_VAL := #result);
            U BIE;
            = M 0.1;
            END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &["IEC:LIMIT"]);
        bench.run();
        assert_eq!((bench.mw(4), bench.mw(6), bench.mw(8)), (3, 0, 0xFFFB));
        assert_eq!((bench.m(0, 0), bench.m(0, 1)), (true, false), "MW 4 is a WORD, not an INT");
    });
}

#[test]
fn an_any_in_out_of_a_system_function_block() {
    on_each_engine(|| {
        let source = "
            DATA_BLOCK DB 52
            SFB 52
            BEGIN
            END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 1
            BEGIN
            CALL SFB 52 , DB 52 (REQ := TRUE, ID := DW#16#100, INDEX := 5, MLEN := 0, VALID := M 0.0, BUSY := M 0.1,
                ERROR := M 0.2, STATUS := MD 4, LEN := MW 8, RECORD := P#M 20.0 BYTE 10);
            CALL SFB 52 , DB 52 (REQ := TRUE, STATUS := MD 12, RECORD := P#M 20.0 WORD 5);
            END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &[]);
        bench.run();
        // The pointer arrives: of bytes, so that the missing module is what is wrong; then of words.
        assert_eq!((bench.md(4), bench.md(12), bench.m(0, 2)), (0xC080_9000, 0xC080_9200, true));
    });
}
