//! The clock is set while time-of-day interrupts are active: forward past their time, back before it.
//! ["Characteristics of SFCs 28 to 31", "Time Error Organization Block (OB80)" of the system software reference]

use ob1_cpu::{Ask, Cpu, CpuConfig, Family, OperatingState, TimeOfDay, Width, system_blocks};
use ob1_ir::{AccuOp, Arg, CodeBlock, NumberFormat, Op};
use ob1_model::moment::Moment;
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_std::services::Period;
use ob1_time::Span;

use crate::common;
use crate::common::window::Client;
use crate::common::*;

/// So many minutes after the beginning of 1990.
fn minute(minute: u64) -> Moment {
    Moment::from_ms(minute * 60_000).expect("a moment")
}

/// Adds 1 to the word at `byte` and keeps the 20 bytes of the start information behind `to`.
fn note(number: u16, byte: u32, to: u32) -> CodeBlock {
    let mut ops = vec![load(mw(byte)), c(1), Op::Arithmetic(NumberFormat::Int, AccuOp::Add), transfer(mw(byte))];
    ops.extend((0..5).flat_map(|i| [load(operand(Width::DWord, l(4 * i, 0))), transfer(md(to + 4 * i))]));
    block(ob(number), Interface::default(), ops)
}

/// OB 10 comes at minute 2 and then as `period` says: counted in MW 0, its start information from MB 20.
fn bench(family: Family, period: Period, more: Vec<CodeBlock>) -> Bench {
    let interrupt = TimeOfDay { ob: 10, start: minute(2), period };
    let config = CpuConfig { watchdog: Span::ZERO, time_of_day: vec![interrupt], ..CpuConfig::of(family) };
    let mut blocks = vec![ob1(vec![]), note(10, 0, 20)];
    blocks.extend(more);
    let cpu = Cpu::new(config, &program(blocks, vec![]), system_blocks(), vec![], common::engine());
    let mut bench = Bench::with(cpu.expect("loads"));
    bench.clock.per_statement = Span::ZERO;
    bench
}

/// Sets the clock as a link does; the next cycle does it.
fn set(client: &mut Client, to: Moment) {
    client.ask(1, [Ask::SetClock(to.to_bytes())]);
}

#[test]
fn a_time_that_was_skipped_calls_ob_80_and_then_its_ob_once() {
    on_each_engine(|| {
        for period in [Period::Once, Period::EveryMinute] {
            let mut bench = bench(Family::S7_300, period, vec![note(80, 2, 40)]);
            let mut client = Client::of(&mut bench.cpu);
            bench.run();
            set(&mut client, minute(9));
            bench.run();
            assert_eq!((bench.mw(0), bench.mw(2)), (1, 1), "{period:?}: OB 10, OB 80");
            assert_eq!(bench.events()[0], 0x3505, "{period:?}");
            assert_eq!((bench.md(40), bench.md(44), bench.md(48)), (0x3505_1A50, 1, 0), "{period:?}");
            // OB 80 has the time that was set, OB 10 the first time that was skipped.
            assert_eq!((bench.md(52), bench.md(56)), (0x9001_0100, 0x0900_0002), "{period:?}");
            assert_eq!((bench.md(32), bench.md(36)), (0x9001_0100, 0x0200_0002), "{period:?}");
            bench.clock.now = at(Span::from_secs(60));
            bench.run();
            let (runs, last) = if period == Period::EveryMinute { (2, 0x1000_0002) } else { (1, 0x0200_0002) };
            assert_eq!((bench.mw(0), bench.md(36), bench.mw(2)), (runs, last, 1), "{period:?}: then as ever");
        }
    });
}

#[test]
fn without_ob_80_a_clock_that_skips_is_stop() {
    on_each_engine(|| {
        let mut bench = bench(Family::S7_300, Period::Once, vec![]);
        let mut client = Client::of(&mut bench.cpu);
        bench.run();
        // Up to its time nothing is skipped; at its very time it runs.
        set(&mut client, minute(1));
        bench.run();
        assert_eq!(bench.mw(0), 0);
        set(&mut client, minute(2));
        bench.run();
        assert_eq!(bench.mw(0), 1);
        let mut bench = self::bench(Family::S7_300, Period::Once, vec![]);
        let mut client = Client::of(&mut bench.cpu);
        bench.run();
        set(&mut client, minute(3));
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events()[..2], [0x4568, 0x3505]);
    });
}

#[test]
fn ob_80_cancels_what_was_skipped() {
    on_each_engine(|| {
        let sfc = BlockId::new(BlockKind::Sfc, 29);
        let cancel = call(sfc, vec![Arg::Const(10), Arg::Operand(mw(200))]);
        let handler = block(ob(80), Interface::default(), vec![cancel]);
        let mut bench = bench(Family::S7_300, Period::EveryMinute, vec![handler]);
        let mut client = Client::of(&mut bench.cpu);
        bench.run();
        set(&mut client, minute(9));
        bench.run();
        assert_eq!((bench.events()[0], bench.mw(0), bench.mw(200)), (0x3505, 0, 0));
        bench.clock.now = at(Span::from_secs(600));
        bench.run();
        assert_eq!(bench.mw(0), 0, "cancelled for good");
    });
}

#[test]
fn a_clock_that_was_set_back_repeats_the_ob_on_an_s7_300_only() {
    on_each_engine(|| {
        for (family, runs) in [(Family::S7_300, 4), (Family::S7_400, 3)] {
            let mut bench = bench(family, Period::EveryMinute, vec![]);
            let mut client = Client::of(&mut bench.cpu);
            bench.run();
            for minutes in [2, 3] {
                bench.clock.now = at(Span::from_secs(60 * minutes));
                bench.run();
            }
            assert_eq!(bench.mw(0), 2, "{family:?}: minutes 2 and 3");
            // Half a minute before minute 3: it comes once more, then minute 4 for the first time.
            bench.clock.now = at(Span::from_secs(190));
            set(&mut client, Moment::from_ms(150_000).expect("a moment"));
            bench.run();
            for seconds in [220, 280] {
                bench.clock.now = at(Span::from_secs(seconds));
                bench.run();
            }
            assert_eq!(bench.mw(0), runs, "{family:?}");
            assert!(!bench.events().contains(&0x3505), "{family:?}");
        }
    });
}
