//! Cycle control: start-up, states, deadlines, watchdog.

mod common;

use common::*;
use ob1_cpu::{Command, Cpu, CpuConfig, OperatingState};
use ob1_ir::{AccuOp, Jump, NumberFormat, Op};
use ob1_model::Interface;

fn count(byte: u32) -> Vec<Op> {
    vec![load(mw(byte)), c(1), Op::Arithmetic(NumberFormat::Int, AccuOp::Add), transfer(mw(byte))]
}

#[test]
fn ob100_once_then_ob1_for_ever() {
    let mut bench =
        Bench::new(&program(vec![ob1(count(10)), block(ob(100), Interface::default(), count(20))], Vec::new()));
    for _ in 0..5 {
        bench.run();
    }
    assert_eq!((bench.mw(10), bench.mw(20)), (5, 1));
    assert_eq!(bench.events(), [0x4302, 0x4301]);
    assert_eq!(bench.cpu.statistics().scans, 5);
    assert_eq!(bench.cpu.statistics().statements, 6 * 5, "four and the block's end");
}

#[test]
fn endless_loop_ends_by_the_watchdog_in_virtual_time() {
    let mut bench = Bench::new(&program(vec![ob1(vec![Op::Jump(Jump::Always, 0)])], Vec::new()));
    assert_eq!(bench.cycle().state, OperatingState::Stop);
    assert_eq!(bench.events(), [0x4568, 0x3501, 0x4302, 0x4301]);
    assert!((150 * MS..152 * MS).contains(&bench.clock.now), "{}", bench.clock.now);
}

#[test]
fn deadlines_are_absolute_and_lateness_is_counted_once() {
    let config = CpuConfig { min_cycle: MS, ..CpuConfig::default() };
    let mut bench = Bench::with(Cpu::new(config, &program(vec![ob1(Vec::new())], Vec::new()), vec![], vec![]).unwrap());
    bench.clock.ns_per_statement = 0;
    assert_eq!(bench.cycle().next_deadline, MS);
    bench.clock.now = MS + 300_000;
    assert_eq!(bench.cycle().next_deadline, 2 * MS, "waking late does not move the schedule");
    bench.clock.now = 5 * MS;
    assert_eq!(bench.cycle().next_deadline, 5 * MS, "missed: at once");
    assert_eq!(bench.cycle().next_deadline, 6 * MS);
    assert_eq!(bench.cpu.statistics().overruns, 1);
}

#[test]
fn commands() {
    let mut bench = Bench::new(&program(vec![ob1(count(10))], Vec::new()));
    bench.run();
    bench.cpu.request(Command::Stop);
    assert_eq!(bench.cycle().state, OperatingState::Stop);
    assert_eq!(bench.mw(10), 1);
    bench.cpu.request(Command::Warm);
    bench.run();
    assert_eq!(bench.mw(10), 1);
}
