//! An image as the first version of this software wrote it.

#![allow(clippy::single_range_in_vec_init, reason = "a list of ranges with one range")]

use ob1_cpu::{Cell, CpuConfig, DataRange, Retentive, RetentiveData, Why, Width};

use crate::common::source::bench_with;
use crate::common::*;

/// An instance, a data block with a gap behind it, a timer, and a data block that the program makes.
const SOURCE: &str = "
FUNCTION_BLOCK FB 5
VAR_INPUT
  go : BOOL;
END_VAR
VAR
  sum : INT := 7;
END_VAR
VAR_TEMP
  x : INT;
END_VAR
BEGIN
      L #sum;
      T #x;
END_FUNCTION_BLOCK
DATA_BLOCK DB 10
STRUCT
  a : INT := 1;
  b : ARRAY [0..2] OF BYTE;
END_STRUCT;
BEGIN
END_DATA_BLOCK
DATA_BLOCK DB 11
FB 5
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
      U M 0.0;
      L S5T#100S;
      SV T 1;
      CALL FB 5, DB 11 (go := M 0.0);
      U M 0.1;
      R M 0.1;
      SPBN done;
      CALL SFC 22 (LOW_LIMIT := W#16#64, UP_LIMIT := W#16#6E, COUNT := W#16#8, RET_VAL := MW 20, DB_NUMBER := MW 22);
done: NOP 0;
END_ORGANIZATION_BLOCK
";

fn config() -> CpuConfig {
    let retentive =
        Retentive { memory: vec![0..8], timers: vec![1..2], counters: vec![2..4], data: RetentiveData::All };
    CpuConfig { retentive, db_pool_bytes: 16, ..CpuConfig::default() }
}

/// Written by the last commit with that version: M 0.0 set, timer 1 at 96 s of 100 s, counters 2 and 3, values in
/// DB 10, in the instance DB 11, and in DB 100, which the program had made.
const IMAGE: &str = "\
6F6231206B656570010000009800000001000000E0E5735AE5D06AAF010000000000000008000000010000000000000010000000\
01000000010000000100000001000000020000000200000064000000080000000000000001000000050607081111000022000000\
0100333300000000010302006400000000C00B5A1600000048000000490000000000000000004444A33197690502D3ED";

fn image() -> Vec<u8> {
    let byte = |at: usize| u8::from_str_radix(&IMAGE[at..at + 2], 16).expect("hexadecimal");
    (0..IMAGE.len()).step_by(2).map(byte).collect()
}

fn words(bench: &mut Bench) -> [u32; 9] {
    let cells =
        [Cell::Timer(1), Cell::Counter(2), Cell::Counter(3), Cell::Db(10, 0), Cell::Db(10, 32), Cell::Db(11, 16)];
    let [timer, two, three, first, array, sum] =
        cells.map(|cell| bench.cpu.read(cell, Width::Word).expect("it exists"));
    let made = bench.cpu.read(Cell::Db(100, 48), Width::Word).unwrap_or(0);
    [bench.md(0), bench.md(4), timer, two, three, first, array, sum, made]
}

#[test]
fn an_image_of_version_1_is_read() {
    on_each_engine(|| {
        let mut bench = bench_with(SOURCE, &[], config(), vec![]);
        bench.clock.per_statement = ob1_time::Span::ZERO;
        assert_eq!(bench.cpu.restore_retentive(&image()), Ok(vec![]));
        bench.run();
        let kept = [0x0100_0000, 0x0506_0708, 0x2096, 72, 73, 0x1111, 0x2200, 0x3333, 0x4444];
        assert_eq!(words(&mut bench).map(|word| format!("{word:X}")), kept.map(|word: u32| format!("{word:X}")));
        let mut again = Vec::new();
        bench.cpu.retentive_image(&mut again);
        assert_eq!(again[8..12], [2, 0, 0, 0], "and written in this version");
    });
}

#[test]
fn an_image_of_version_1_is_for_its_program_only_and_damage_changes_nothing() {
    on_each_engine(|| {
        let other = SOURCE.replace("sum : INT := 7;", "sum : WORD;");
        assert_eq!(bench_with(&other, &[], config(), vec![]).cpu.restore_retentive(&image()), Err(Why::OtherProgram));
        let mut bench = bench_with(SOURCE, &[], config(), vec![]);
        for byte in 12..image().len() {
            let mut broken = image();
            broken[byte] ^= 0x10;
            assert_eq!(bench.cpu.restore_retentive(&broken), Err(Why::Damaged), "byte {byte}");
        }
        bench.run();
        assert_eq!(words(&mut bench)[3..7], [0, 0, 1, 0]);
    });
}

/// Other ranges are retentive now: what both have is taken.
#[test]
fn an_image_of_version_1_is_taken_by_ranges_both_have() {
    on_each_engine(|| {
        let mut config = config();
        config.retentive.memory = vec![4..6];
        config.retentive.data = RetentiveData::Only(vec![DataRange { db: 11, bytes: None }]);
        let mut bench = bench_with(SOURCE, &[], config, vec![]);
        let left = bench.cpu.restore_retentive(&image()).expect("it has something");
        assert_eq!(left, ["MB 0 to 7", "DB 10", "DB 100"]);
        bench.run();
        let [bits, more, .., first, array, sum, made] = words(&mut bench);
        assert_eq!([bits, more, first, array, sum, made], [0, 0x0506_0000, 1, 0, 0x3333, 0]);
    });
}
