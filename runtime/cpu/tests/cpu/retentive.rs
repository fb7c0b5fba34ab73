//! Retentive memory: what the restarts keep, the image for a power cycle, images that are refused.

#![allow(clippy::single_range_in_vec_init, reason = "a list of ranges with one range")]

use ob1_cpu::{Cell, Command, Cpu, CpuConfig, DataRange, OperatingState, Retentive, RetentiveData, Why, Width};
use ob1_ir::{Number, Op, Program};
use ob1_model::TimerKind;
use ob1_time::Span;

use crate::common;
use crate::common::*;

fn config(data: RetentiveData) -> CpuConfig {
    let ranges = Retentive { memory: vec![4..8, 0..2], timers: vec![1..2], counters: vec![2..4], data };
    CpuConfig { retentive: ranges, ..CpuConfig::default() }
}

fn only() -> RetentiveData {
    RetentiveData::Only(vec![DataRange { db: 2, bytes: None }, DataRange { db: 9, bytes: Some(2..4) }])
}

/// Timer 1 and 2 run for 100 s once M 0.0 is set.
fn station() -> Program {
    let start = |n| [u(m(0, 0)), c(0x2100), Op::StartTimer(TimerKind::ExtendedPulse, Number::Fixed(n))];
    program(vec![ob1([start(1), start(2)].concat())], vec![db(2, &[2; 4]), db(9, &[9; 6])])
}

fn fill(bench: &mut Bench) {
    bench.run();
    bench.set(0, Width::DWord, 0x0102_0304);
    bench.set(4, Width::DWord, 0x0506_0708);
    bench.set(8, Width::DWord, 0x090A_0B0C);
    for counter in [1, 2, 3] {
        bench.cpu.write(Cell::Counter(counter), Width::Word, 70 + u32::from(counter)).expect("a counter");
    }
    for (db, at) in [(2, 0), (9, 0), (9, 2), (9, 4)] {
        bench.cpu.write(Cell::Db(db, at * 8), Width::Word, 0x1111).expect("a word");
    }
    bench.run();
    bench.clock.now += 4000 * MS;
    bench.run();
}

/// M 0, 4, 8; timers 1 and 2; counters 1 to 3; DB 2; DB 9.
fn state(bench: &mut Bench) -> ([u32; 3], [u32; 2], [u32; 3], u32, [u32; 3]) {
    let memory = [0, 4, 8].map(|at| bench.md(at));
    let mut cell = |cell| bench.cpu.read(cell, Width::Word).expect("it exists");
    let timers = [1, 2].map(|n| cell(Cell::Timer(n)));
    let counters = [1, 2, 3].map(|n| cell(Cell::Counter(n)));
    let two = cell(Cell::Db(2, 0));
    (memory, timers, counters, two, [0, 16, 32].map(|at| cell(Cell::Db(9, at))))
}

const KEPT: ([u32; 3], [u32; 2], [u32; 3], u32, [u32; 3]) =
    ([0x0102_0000, 0x0506_0708, 0], [0x2096, 0x2100], [0, 72, 73], 0x1111, [0x0909, 0x1111, 0x0909]);
/// A restart that keeps all data blocks.
const DATA_KEPT: ([u32; 3], [u32; 2], [u32; 3], u32, [u32; 3]) = (KEPT.0, KEPT.1, KEPT.2, 0x1111, [0x1111; 3]);
const NOTHING: ([u32; 3], [u32; 2], [u32; 3], u32, [u32; 3]) = ([0; 3], [0; 2], [0; 3], 0x0202, [0x0909; 3]);

fn start(config: CpuConfig, program: &Program) -> Bench {
    let mut bench = Bench::with(Cpu::new(config, program, vec![], vec![], common::engine()).expect("loads"));
    bench.clock.per_statement = Span::ZERO;
    bench
}

#[test]
fn a_warm_restart_keeps_the_ranges_and_a_cold_one_nothing() {
    on_each_engine(|| {
        for (command, expected) in [(Command::Warm, KEPT), (Command::Keep, DATA_KEPT), (Command::Cold, NOTHING)] {
            let mut bench = start(config(only()), &station());
            fill(&mut bench);
            bench.cpu.request(Command::Stop);
            bench.cycle();
            bench.clock.now += 60_000 * MS;
            bench.cycle();
            bench.cpu.request(command);
            bench.run();
            assert_eq!(state(&mut bench), expected, "{command:?}: the timer stood still in STOP");
        }
    });
}

#[test]
fn an_image_survives_a_power_cycle() {
    on_each_engine(|| {
        let mut bench = start(config(only()), &station());
        fill(&mut bench);
        let (mut image, mut again) = (Vec::new(), Vec::new());
        bench.cpu.retentive_image(&mut image);
        assert_eq!(image.len(), bench.cpu.retentive_len());

        let mut other = start(config(only()), &station());
        assert_eq!(other.cpu.restore_retentive(&image), Ok(vec![]));
        other.cpu.retentive_image(&mut again);
        assert_eq!(image, again);
        other.run();
        assert_eq!(state(&mut other), KEPT);
        assert_eq!(other.cpu.restore_retentive(&image), Err(Why::NotInStop));
        other.cpu.request(Command::Reset);
        other.cycle();
        assert_eq!(state(&mut other), NOTHING, "a memory reset keeps nothing");
    });
}

#[test]
fn the_default_keeps_all_data_blocks() {
    on_each_engine(|| {
        let mut bench = start(CpuConfig::default(), &station());
        fill(&mut bench);
        let mut image = Vec::new();
        bench.cpu.retentive_image(&mut image);
        let mut other = start(CpuConfig::default(), &station());
        assert_eq!(other.cpu.restore_retentive(&image), Ok(vec![]));
        other.run();
        assert_eq!(state(&mut other), ([0; 3], [0; 2], [0; 3], 0x1111, [0x1111; 3]));
    });
}

#[test]
fn a_data_block_that_is_not_retentive_begins_anew() {
    on_each_engine(|| {
        for data in [RetentiveData::All, only()] {
            let mut program = station();
            program.data[1].non_retain = true;
            let mut bench = start(config(data.clone()), &program);
            fill(&mut bench);
            let mut image = Vec::new();
            bench.cpu.retentive_image(&mut image);
            assert_eq!(image.len(), bench.cpu.retentive_len());
            bench.cpu.request(Command::Warm);
            bench.run();
            let mut other = start(config(data.clone()), &program);
            assert_eq!(other.cpu.restore_retentive(&image), Ok(vec![]));
            other.run();
            for (bench, after) in [(&mut bench, "a warm restart"), (&mut other, "a power cycle")] {
                let (.., two, nine) = state(bench);
                assert_eq!((two, nine), (0x1111, [0x0909; 3]), "after {after} with {data:?}");
            }
        }
    });
}

#[test]
fn foreign_and_damaged_images_are_refused_and_change_nothing() {
    on_each_engine(|| {
        let mut bench = start(config(only()), &station());
        fill(&mut bench);
        let mut image = Vec::new();
        bench.cpu.retentive_image(&mut image);
        let mut other = start(config(only()), &station());
        for byte in 0..image.len() {
            let mut broken = image.clone();
            broken[byte] ^= 0x10;
            let why = match byte {
                0..8 => Why::NoImage,
                8..12 => Why::Version(u32::from_le_bytes([broken[8], broken[9], broken[10], broken[11]])),
                _ => Why::Damaged,
            };
            assert_eq!(other.cpu.restore_retentive(&broken), Err(why), "byte {byte}");
            let why = if byte < 8 { Why::NoImage } else { Why::Damaged };
            assert_eq!(other.cpu.restore_retentive(&image[..byte]), Err(why), "cut at {byte}");
        }
        assert_eq!(state(&mut other), NOTHING);

        let nothing = Retentive { memory: vec![8..12], data: RetentiveData::All, ..Retentive::default() };
        let nothing = CpuConfig { retentive: nothing, ..CpuConfig::default() };
        let other = program(vec![], vec![db(2, &[2; 6]), db(10, &[9; 6])]);
        assert_eq!(start(nothing, &other).cpu.restore_retentive(&image), Err(Why::OtherProgram));
        let mut statements = station();
        statements.blocks[0].code.pop();
        assert_eq!(
            start(config(only()), &statements).cpu.restore_retentive(&image),
            Ok(vec![]),
            "statements may change"
        );
    });
}

/// A data block that was loaded meanwhile, and other ranges: everything else keeps its values.
#[test]
fn an_image_is_taken_by_what_it_and_the_program_have_in_common() {
    on_each_engine(|| {
        let mut bench = start(config(RetentiveData::All), &station());
        fill(&mut bench);
        let mut image = Vec::new();
        bench.cpu.retentive_image(&mut image);
        let restored = |program: &Program, config: CpuConfig| {
            let mut other = start(config, program);
            let left = other.cpu.restore_retentive(&image);
            other.run();
            (left, other)
        };
        let mut longer = station();
        longer.data[1].bytes.extend([9, 9]);
        longer.data.push(db(5, &[5, 5]));
        let (left, mut other) = restored(&longer, config(RetentiveData::All));
        assert_eq!(left, Ok(vec!["DB 9".to_owned()]));
        let expected = (KEPT.0, KEPT.1, KEPT.2, KEPT.3, [0x0909; 3]);
        assert_eq!((state(&mut other), other.dbw(5, 0)), (expected, 0x0505));

        let mut gone = station();
        gone.data.remove(1);
        let (left, mut other) = restored(&gone, config(RetentiveData::All));
        assert_eq!((left, other.dbw(2, 0)), (Ok(vec!["DB 9".to_owned()]), 0x1111));

        let ranges = Retentive { memory: vec![6..9], timers: vec![2..5], counters: vec![3..9], data: only() };
        let (left, mut other) = restored(&station(), CpuConfig { retentive: ranges, ..CpuConfig::default() });
        let left = left.expect("it has something of all");
        assert_eq!(left, ["MB 0 to 1", "MB 4 to 7", "DB 9", "T 1", "C 2 to 3"]);
        let expected = ([0, 0x0708, 0], [0x2096, 0x2100], [0, 0, 73], 0x1111, [0x0909, 0x1111, 0x0909]);
        assert_eq!(state(&mut other).0, expected.0);
        assert_eq!(
            (state(&mut other).2, state(&mut other).3, state(&mut other).4),
            (expected.2, expected.3, expected.4)
        );
    });
}

#[test]
fn ranges_that_do_not_exist_are_refused() {
    on_each_engine(|| {
        let retentive = Retentive {
            memory: vec![250..300],
            timers: vec![0..257],
            counters: vec![],
            data: RetentiveData::Only(vec![DataRange { db: 3, bytes: None }, DataRange { db: 2, bytes: Some(0..5) }]),
        };
        let config = CpuConfig { retentive, ..CpuConfig::default() };
        let errors = Cpu::new(config, &station(), vec![], vec![], common::engine()).err().unwrap_or_default();
        let messages: Vec<_> = errors.iter().map(ToString::to_string).collect();
        assert_eq!(
            messages,
            [
                "L001: CPU setting retentive.memory = 300: at most 256",
                "L001: CPU setting retentive.timers = 257: at most 256",
                "L012: DB 3 is to be retentive, but is not loaded",
                "L001: CPU setting retentive.data = 5: at most 4",
            ]
        );
    });
}

#[test]
fn the_image_is_taken_in_stop_as_it_was_at_the_stop() {
    on_each_engine(|| {
        let mut bench = start(config(only()), &station());
        fill(&mut bench);
        bench.cpu.request(Command::Stop);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        let (mut before, mut after) = (Vec::new(), Vec::new());
        bench.cpu.retentive_image(&mut before);
        bench.clock.now += 60_000 * MS;
        bench.cycle();
        bench.cpu.retentive_image(&mut after);
        assert_eq!(before, after);
    });
}
