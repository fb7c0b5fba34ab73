//! System functions that change what the CPU does: interrupts by time, locks, masked errors, data blocks made by the
//! program.

use ob1_cpu::{Cell, CellError, Command, Cpu, CpuConfig, CyclicInterrupt, OperatingState, TimeOfDay, system_blocks};
use ob1_ir::{AccuOp, Arg, CodeBlock, Jump, NumberFormat, Op, Width};
use ob1_model::moment::Moment;
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_std::services::Period;
use ob1_time::Span;

use crate::common;
use crate::common::source::bench_with;
use crate::common::*;

fn sfc(number: u16, args: Vec<Arg>) -> Op {
    call(BlockId::new(BlockKind::Sfc, number), args)
}

fn organization(number: u16, ops: Vec<Op>) -> CodeBlock {
    block(ob(number), Interface::default(), ops)
}

fn count(byte: u32) -> Vec<Op> {
    vec![load(mw(byte)), c(1), Op::Arithmetic(NumberFormat::Int, AccuOp::Add), transfer(mw(byte))]
}

fn keep(to: u32) -> Vec<Op> {
    (0..3).flat_map(|i| [load(operand(Width::DWord, l(4 * i, 0))), transfer(md(to + 4 * i))]).collect()
}

/// A result in MW 200.
fn result() -> Arg {
    Arg::Operand(mw(200))
}

/// OB 1 carries out the statements in scans where M 100.0 is set, then clears it.
fn on_demand(ops: Vec<Op>) -> CodeBlock {
    let end = ops.len() as u32 + 4;
    let mut code = vec![u(m(100, 0)), Op::Jump(Jump::IfNotRlo, end), Op::SetRlo, Op::Reset(m(100, 0))];
    code.extend(ops);
    code.push(Op::Nop);
    ob1(code)
}

fn start(config: CpuConfig, blocks: Vec<CodeBlock>) -> Bench {
    let mut bench = Bench::with(
        Cpu::new(config, &program(blocks, vec![]), system_blocks(), vec![], common::engine()).expect("loads"),
    );
    bench.clock.per_statement = Span::ZERO;
    bench.run();
    bench
}

fn demand(bench: &mut Bench) {
    bench.set_m(100, 0, true);
    bench.run();
    assert_eq!(bench.mw(200), 0, "RET_VAL");
}

#[test]
fn a_time_delay_interrupt_comes_once() {
    on_each_engine(|| {
        let config = CpuConfig { min_cycle: 10 * MS, ..CpuConfig::default() };
        let srt_dint = sfc(32, vec![Arg::Const(20), Arg::Const(25), Arg::Const(0x1234), result()]);
        let mut bench = start(config, vec![on_demand(vec![srt_dint]), organization(20, [count(0), keep(20)].concat())]);
        demand(&mut bench);
        bench.clock.now = at(20 * MS);
        bench.run();
        let end = bench.cycle();
        assert_eq!((end.next_deadline, bench.mw(0)), (at(25 * MS), 0));
        for (ms, runs) in [(25, 1), (30, 1), (60, 1)] {
            bench.clock.now = at(ms * MS);
            bench.run();
            assert_eq!(bench.mw(0), runs, "at {ms} ms");
        }
        assert_eq!((bench.md(20), bench.md(24), bench.md(28)), (0x1121_0314, 0x0000_1234, 25));
    });
}

#[test]
fn a_time_of_day_interrupt_comes_every_minute_until_the_restart() {
    on_each_engine(|| {
        let sdt: Box<[u8]> = Box::from([0x90, 1, 1, 0, 2, 0, 0, 0x02]);
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let set = sfc(28, vec![Arg::Const(10), Arg::Bytes(sdt), Arg::Const(0x0201), result()]);
        let activate = sfc(30, vec![Arg::Const(10), result()]);
        let blocks = vec![on_demand(vec![set, activate]), organization(10, [count(0), keep(20)].concat())];
        let mut bench = start(config, blocks);
        demand(&mut bench);
        for (seconds, runs) in [(119, 0), (120, 1), (150, 1), (180, 2), (245, 3)] {
            bench.clock.now = at(seconds * 1000 * MS);
            bench.run();
            assert_eq!(bench.mw(0), runs, "after {seconds} s");
        }
        assert_eq!((bench.md(20), bench.md(24)), (0x1111_020A, 0x0000_0201));
        bench.cpu.request(Command::Warm);
        bench.clock.now += 300_000 * MS;
        bench.run();
        bench.clock.now += 300_000 * MS;
        bench.run();
        assert_eq!(bench.mw(0), 0, "a restart forgets it");
    });
}

#[test]
fn a_time_of_day_interrupt_of_the_configuration_comes_after_each_start() {
    on_each_engine(|| {
        let start_at = Moment::from_ms(90_000).expect("a moment");
        let interrupt = TimeOfDay { ob: 10, start: start_at, period: Period::EveryMinute };
        let config = CpuConfig { watchdog: Span::ZERO, time_of_day: vec![interrupt], ..CpuConfig::default() };
        let mut bench = start(config, vec![ob1(vec![Op::Nop]), organization(10, [count(0), keep(20)].concat())]);
        for (seconds, runs) in [(89, 0), (90, 1), (149, 1), (150, 2)] {
            bench.clock.now = at(seconds * 1000 * MS);
            bench.run();
            assert_eq!(bench.mw(0), runs, "after {seconds} s");
        }
        assert_eq!((bench.md(20), bench.md(24)), (0x1111_020A, 0x0000_0201));
        bench.cpu.request(Command::Warm);
        bench.run();
        bench.clock.now = at(211_000 * MS);
        bench.run();
        assert_eq!(bench.mw(0), 1, "set again by the restart");
        // Without its OB it has no effect; a number that is not an OB is refused.
        let of = |ob| CpuConfig { time_of_day: vec![TimeOfDay { ob, ..interrupt }], ..CpuConfig::default() };
        let blocks = || program(vec![ob1(vec![Op::Nop])], vec![]);
        assert!(Cpu::new(of(11), &blocks(), vec![], vec![], common::engine()).is_ok());
        assert!(Cpu::new(of(18), &blocks(), vec![], vec![], common::engine()).is_err());
    });
}

#[test]
fn delayed_interrupts_wait_for_the_release_or_the_end_of_the_ob() {
    on_each_engine(|| {
        let busy = |at: u32| [c(50_000), Op::Loop(at + 1)];
        let note = |to| [load(mw(0)), transfer(mw(to))];
        for release in [true, false] {
            let mut code = vec![sfc(41, vec![result()])];
            code.extend(busy(1));
            code.extend(note(10));
            code.push(if release { sfc(42, vec![result()]) } else { Op::Nop });
            let at = code.len() as u32;
            code.extend(busy(at));
            code.extend(note(12));
            let config = CpuConfig { cyclic: vec![CyclicInterrupt::new(35, 4 * MS)], ..CpuConfig::default() };
            let program = program(vec![ob1(code), organization(35, count(0))], vec![]);
            let mut bench =
                Bench::with(Cpu::new(config, &program, system_blocks(), vec![], common::engine()).expect("loads"));
            // Each loop takes 5 ms; OB 35 is due after 4 and 8.
            bench.clock.per_statement = Span::from_nanos(100);
            if !release {
                assert_eq!(bench.cycle().state, OperatingState::Stop, "two wait, and there is no OB 80");
                assert_eq!(bench.events()[..2], [0x4568, 0x3507]);
                continue;
            }
            bench.run();
            assert_eq!((bench.mw(10), bench.mw(12)), (0, 2));
        }
    });
}

#[test]
fn a_locked_ob_is_lost() {
    on_each_engine(|| {
        let config = CpuConfig { cyclic: vec![CyclicInterrupt::new(35, 4 * MS)], ..CpuConfig::default() };
        let lock = sfc(39, vec![Arg::Const(2), Arg::Const(35), result()]);
        let mut bench = start(config, vec![on_demand(vec![lock]), organization(35, count(0))]);
        bench.clock.now = at(4 * MS);
        bench.run();
        demand(&mut bench);
        for ms in [8, 12, 16] {
            bench.clock.now = at(ms * MS);
            bench.run();
        }
        assert_eq!(bench.mw(0), 1);
    });
}

#[test]
fn masked_errors_call_no_ob_and_are_remembered() {
    on_each_engine(|| {
        let mask = Arg::Const(1 << 2);
        let zero = || Arg::Const(0);
        let code = vec![
            sfc(36, vec![mask.clone(), zero(), result(), Arg::Operand(md(20)), Arg::Operand(md(24))]),
            load(mw(9000)),
            sfc(38, vec![mask, zero(), result(), Arg::Operand(md(28)), Arg::Operand(md(32))]),
        ];
        let mut bench = start(CpuConfig::default(), vec![ob1(code)]);
        assert_eq!((bench.md(20), bench.md(28)), (4, 4), "masked, and it has occurred");
        assert_eq!(bench.events(), [0x4302, 0x4301]);
        let mut bench = Bench::new(&program(vec![ob1(vec![load(mw(9000))])], vec![]));
        assert_eq!(bench.cycle().state, OperatingState::Stop, "the mask ends with its OB");
    });
}

#[test]
fn the_program_makes_and_deletes_data_blocks() {
    on_each_engine(|| {
        let number = || Arg::Operand(mw(10));
        let create = sfc(22, vec![Arg::Const(100), Arg::Const(110), Arg::Const(8), result(), number()]);
        let delete = sfc(23, vec![number(), result()]);
        let write = vec![Op::OpenDb(ob1_ir::DbRegister::Db, ob1_ir::Number::Fixed(100)), c(0x4711), transfer(dbw(6))];
        let config = CpuConfig { db_pool_bytes: 8, ..CpuConfig::default() };
        let mut bench = start(config.clone(), vec![on_demand([vec![create], write].concat())]);
        demand(&mut bench);
        assert_eq!((bench.mw(10), bench.dbw(100, 6)), (100, 0x4711));
        let mut image = Vec::new();
        bench.cpu.retentive_image(&mut image);
        bench.cpu.request(Command::Warm);
        bench.run();
        assert_eq!(bench.dbw(100, 6), 0x4711, "a warm restart keeps it");
        bench.cpu.request(Command::Cold);
        bench.run();
        assert_eq!(bench.cpu.read(Cell::Db(100, 0), Width::Word), Err(CellError::NoDb));

        let mut bench = start(config, vec![on_demand(vec![delete])]);
        bench.cpu.request(Command::Stop);
        bench.cycle();
        assert_eq!(bench.cpu.restore_retentive(&image), Ok(vec![]));
        bench.cpu.request(Command::Run);
        bench.run();
        assert_eq!(bench.dbw(100, 6), 0x4711, "and so does the image");
        bench.set(10, Width::Word, 100);
        demand(&mut bench);
        assert_eq!(bench.cpu.read(Cell::Db(100, 0), Width::Word), Err(CellError::NoDb));
    });
}

#[test]
fn a_data_block_made_as_not_retentive_begins_anew() {
    on_each_engine(|| {
        let source = "
            ORGANIZATION_BLOCK OB 1
            BEGIN
            U M 100.0;
            R M 100.0;
            SPBN done;
            CALL SFC 82 (REQ := TRUE, LOW_LIMIT := W#16#64, UP_LIMIT := W#16#64, COUNT := W#16#4, ATTRIB := B#16#4,
              SRCBLK := P#M 20.0 BYTE 4, RET_VAL := MW 200, BUSY := M 12.0, DB_NUM := MW 10);
      done: NOP 0;
            END_ORGANIZATION_BLOCK";
        // Its bytes and its load values.
        let config = CpuConfig { db_pool_bytes: 16, ..CpuConfig::default() };
        let mut bench = bench_with(source, &[], config.clone(), vec![]);
        bench.run();
        bench.set(20, Width::DWord, 0x0102_0304);
        demand(&mut bench);
        assert_eq!((bench.mw(10), bench.dbw(100, 0)), (100, 0x0102));
        let change = |bench: &mut Bench| {
            bench.cpu.write(Cell::Db(100, 0), Width::Word, 0x4711).expect("a word");
            assert_eq!(bench.dbw(100, 0), 0x4711);
        };
        change(&mut bench);
        let mut image = Vec::new();
        bench.cpu.retentive_image(&mut image);
        assert_eq!(image.len(), bench.cpu.retentive_len());
        bench.cpu.request(Command::Warm);
        bench.run();
        assert_eq!((bench.dbw(100, 0), bench.dbw(100, 2)), (0x0102, 0x0304), "after a warm restart");

        let mut bench = bench_with(source, &[], config, vec![]);
        assert_eq!(bench.cpu.restore_retentive(&image), Ok(vec![]));
        bench.run();
        assert_eq!((bench.dbw(100, 0), bench.dbw(100, 2)), (0x0102, 0x0304), "after a power cycle");
        change(&mut bench);
        bench.cpu.request(Command::Warm);
        bench.run();
        assert_eq!(bench.dbw(100, 0), 0x0102, "and it is not retentive there either");
    });
}

#[test]
fn a_run_time_meter_stands_still_in_stop_and_waits_for_the_program() {
    on_each_engine(|| {
        let source = "
            ORGANIZATION_BLOCK OB 1
            BEGIN
            CALL SFC 4 (NR := B#16#1, RET_VAL := MW 10, CQ := M 0.1, CV := MW 12);
            CALL SFC 3 (NR := B#16#1, S := M 0.0, RET_VAL := MW 14);
            END_ORGANIZATION_BLOCK";
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let mut bench = bench_with(source, &[], config, vec![]);
        bench.clock.per_statement = Span::ZERO;
        bench.run();
        for (hour, on, running, hours) in [
            (0u64, true, false, 0u32),
            (2, true, true, 2),
            // In STOP from the second hour to the seventh; the restart clears M 0.0.
            (7, false, false, 2),
            (9, true, false, 2),
            (10, true, true, 3),
        ] {
            bench.clock.now = at(hour * 3_600_000 * MS);
            if hour == 7 {
                bench.cpu.request(Command::Run);
            } else {
                bench.set_m(0, 0, on);
            }
            bench.run();
            assert_eq!((bench.m(0, 1), bench.mw(12)), (running, hours), "after {hour} h");
            if hour == 2 {
                bench.cpu.request(Command::Stop);
                assert_eq!(bench.cycle().state, OperatingState::Stop);
            }
        }
    });
}
