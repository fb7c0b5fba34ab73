//! Cycle control: start-up, states, deadlines, watchdog.

use ob1_cpu::{Answer, Ask, Clock as _, Command, Cpu, CpuConfig, OperatingState};
use ob1_ir::{AccuOp, Jump, NumberFormat, Op};
use ob1_model::Interface;
use ob1_time::{Instant, Span};

use crate::common;
use crate::common::source::bench_with;
use crate::common::window::Client;
use crate::common::*;

fn count(byte: u32) -> Vec<Op> {
    vec![load(mw(byte)), c(1), Op::Arithmetic(NumberFormat::Int, AccuOp::Add), transfer(mw(byte))]
}

#[test]
fn ob100_once_then_ob1_for_ever() {
    on_each_engine(|| {
        let mut bench =
            Bench::new(&program(vec![ob1(count(10)), block(ob(100), Interface::default(), count(20))], Vec::new()));
        for _ in 0..5 {
            bench.run();
        }
        assert_eq!((bench.mw(10), bench.mw(20)), (5, 1));
        assert_eq!(bench.events(), [0x4302, 0x4301]);
        assert_eq!(bench.cpu.statistics().scans, 5);
        assert_eq!(bench.cpu.statistics().statements, 6 * 5, "four and the block's end");
    });
}

#[test]
fn endless_loop_ends_by_the_watchdog_in_virtual_time() {
    on_each_engine(|| {
        let mut bench = Bench::new(&program(vec![ob1(vec![Op::Jump(Jump::Always, 0)])], Vec::new()));
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events(), [0x4568, 0x3501, 0x4302, 0x4301]);
        assert!((150 * MS..152 * MS).contains(&bench.clock.now.since_start()), "{}", bench.clock.now);
    });
}

#[test]
fn deadlines_are_absolute_and_lateness_is_counted_once() {
    on_each_engine(|| {
        let config = CpuConfig { min_cycle: MS, ..CpuConfig::default() };
        let mut bench = Bench::with(
            Cpu::new(config, &program(vec![ob1(Vec::new())], Vec::new()), vec![], vec![], common::engine()).unwrap(),
        );
        bench.clock.per_statement = Span::ZERO;
        assert_eq!(bench.cycle().next_deadline, at(MS));
        bench.clock.now = at(MS + 3 * MS / 10);
        assert_eq!(bench.cycle().next_deadline, at(2 * MS), "waking late does not move the schedule");
        bench.clock.now = at(5 * MS);
        assert_eq!(bench.cycle().next_deadline, at(5 * MS), "missed: at once");
        assert_eq!(bench.cycle().next_deadline, at(6 * MS));
        assert_eq!(bench.cpu.statistics().overruns, 1);
    });
}

#[test]
fn commands() {
    on_each_engine(|| {
        let mut bench = Bench::new(&program(vec![ob1(count(10))], Vec::new()));
        bench.run();
        bench.cpu.request(Command::Stop);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.mw(10), 1);
        bench.cpu.request(Command::Warm);
        bench.run();
        assert_eq!(bench.mw(10), 1);
    });
}

#[test]
fn the_first_excess_calls_ob_80_and_the_second_in_a_cycle_stops() {
    on_each_engine(|| {
        let loops = |rounds: u32| {
            let mut code = vec![c(rounds), transfer(mw(2))];
            code.extend([c(50_000), Op::Loop(3), load(mw(2)), Op::Loop(1)]);
            code
        };
        let handler = block(
            ob(80),
            Interface::default(),
            [count(10), vec![load(operand(ob1_ir::Width::DWord, l(0, 0))), transfer(md(12))]].concat(),
        );
        let config = CpuConfig { watchdog: 8 * MS, ..CpuConfig::default() };
        // A round of 50,000 statements is 5 ms: two rounds exceed 8 ms once, four twice.
        for (rounds, state, calls) in
            [(1, OperatingState::Run, 0), (2, OperatingState::Run, 1), (4, OperatingState::Stop, 1)]
        {
            let program = program(vec![ob1(loops(rounds)), handler.clone()], Vec::new());
            let mut bench =
                Bench::with(Cpu::new(config.clone(), &program, vec![], vec![], common::engine()).expect("loads"));
            assert_eq!((bench.cycle().state, bench.mw(10)), (state, calls), "{rounds} rounds");
            if calls > 0 {
                assert_eq!(bench.md(12), 0x3501_1A50, "event class, identifier, priority, number");
            }
        }
    });
}

#[test]
fn an_operators_halt_ends_an_endless_loop() {
    on_each_engine(|| {
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let endless = program(vec![ob1(vec![Op::Jump(Jump::Always, 0)])], Vec::new());
        let mut bench = Bench::with(Cpu::new(config, &endless, vec![], vec![], common::engine()).expect("loads"));
        let attention = bench.cpu.attention();
        bench.cpu.request(Command::Stop);
        bench.cycle();
        bench.cpu.request(Command::Run);
        // Set before the start: taken at the cycle control point.
        attention.halt();
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        // Set by the clock in the middle of the loop, as a monitor would.
        struct Halting(ob1_cpu::Attention, Instant);
        impl ob1_cpu::Clock for Halting {
            fn now(&mut self) -> Instant {
                self.1
            }
            fn executed(&mut self, statements: u64) {
                self.1 += statements * Span::from_nanos(1);
                if self.1 > Instant::from_micros(100) {
                    self.0.halt();
                }
            }
        }
        bench.cpu.request(Command::Run);
        let end = bench.cpu.cycle(&mut Halting(attention, Instant::START));
        assert_eq!((end.state, bench.events()[0]), (OperatingState::Stop, 0x4304));
    });
}

/// A loop that triggers the cycle monitoring for ever, in OB 1 and in a start-up: the port is served within it, the
/// diagnostic buffer has an entry, STOP and restarts are obeyed.
#[test]
fn an_endless_loop_with_sfc_43_is_stopped_through_the_port() {
    on_each_engine(|| {
        struct Asking {
            now: Instant,
            client: Client,
            asks: Vec<(u64, Ask)>,
            answers: Vec<Answer>,
        }
        impl ob1_cpu::Clock for Asking {
            fn now(&mut self) -> Instant {
                self.now
            }
            fn executed(&mut self, statements: u64) {
                self.now += statements * Span::MILLISECOND;
                while let Some((at, ask)) =
                    self.asks.first().copied().filter(|(at, _)| self.now >= Instant::from_micros(at * 1000))
                {
                    self.client.ask(at, [ask]);
                    self.asks.remove(0);
                }
                self.answers.extend(std::iter::from_fn(|| self.client.answer()));
            }
        }
        for (ob, state) in [(1, OperatingState::Run), (100, OperatingState::Startup)] {
            let source = format!(
                "ORGANIZATION_BLOCK OB {ob}\nBEGIN\nm: CALL SFC 43;\nSPA m;\nEND_ORGANIZATION_BLOCK\n\
                 ORGANIZATION_BLOCK OB 35\nBEGIN\nL MW 20;\n+ 1;\nT MW 20;\nEND_ORGANIZATION_BLOCK\n"
            );
            let mut bench = bench_with(&source, &[], CpuConfig::default(), vec![]);
            let client = Client::of(&mut bench.cpu);
            let asks = vec![(1500, Ask::State), (4000, Ask::Diag(0)), (5000, Ask::Command(Command::Stop))];
            let mut clock = Asking { now: Instant::START, client, asks, answers: Vec::new() };
            bench.cpu.request(Command::Run);
            let end = bench.cpu.cycle(&mut clock);
            assert_eq!((end.state, bench.events()[0]), (OperatingState::Stop, 0x4304), "OB {ob}");
            clock.executed(0);
            let [Answer::State(answered), Answer::Diag(entry), Answer::Done] = clock.answers[..] else {
                panic!("OB {ob}: {:?}", clock.answers)
            };
            assert_eq!((answered, entry.event.0, entry.data), (state, 0xF104, 3), "OB {ob}");
            assert!(clock.now < Instant::from_micros(5_400_000), "OB {ob}: {:?}", clock.now);
            assert_eq!(bench.mw(20) > 40, ob == 1, "OB {ob}: {} cyclic interrupts", bench.mw(20));
            // A restart begins again where it was.
            clock.asks = vec![(8000, Ask::Command(Command::Warm)), (9000, Ask::Command(Command::Stop))];
            bench.cpu.request(Command::Run);
            for _ in 0..2 {
                assert_eq!(bench.cpu.cycle(&mut clock).state, OperatingState::Stop, "OB {ob}");
            }
            let restarted = bench.events().iter().filter(|event| **event == 0x4301).count();
            assert_eq!((bench.events()[0], restarted), (0x4304, 3), "OB {ob}");
        }
    });
}

#[test]
fn start_information_of_ob_1_and_ob_100() {
    on_each_engine(|| {
        let keep = |to: u32| -> Vec<Op> {
            (0..5)
                .flat_map(|i| {
                    let from = operand(ob1_ir::Width::DWord, l(4 * i, 0));
                    [load(from), transfer(md(to + 4 * i))]
                })
                .collect()
        };
        let blocks = vec![ob1(keep(100)), block(ob(100), Interface::default(), keep(120))];
        let mut bench = Bench::new(&program(blocks, Vec::new()));
        bench.clock.now = at(86_400_000 * MS + 3_600_000 * MS);
        bench.run();
        assert_eq!((bench.md(100), bench.md(120)), (0x1101_0101, 0x1381_1B64));
        assert_eq!((bench.md(112), bench.md(116)), (0x9001_0201, 3), "1990-01-02, one o'clock, a Tuesday");
        bench.clock.now += 7 * MS;
        bench.run();
        bench.clock.now += 3 * MS;
        bench.run();
        assert_eq!((bench.mw(100), bench.md(106)), (0x1103, 0x0003_0003), "the last and the shortest cycle");
        assert_eq!(bench.mw(110), 7, "the longest");
    });
}

#[test]
fn clock_memory_pulses() {
    on_each_engine(|| {
        let config = CpuConfig { clock_memory: Some(5), ..CpuConfig::default() };
        let mut bench = Bench::with(
            Cpu::new(config, &program(vec![ob1(vec![])], vec![]), vec![], vec![], common::engine()).expect("loads"),
        );
        // Bit n is 1 in the second half of its period: 100, 200, 400, 500, 800, 1000, 1600 and 2000 ms.
        for (ms, bits) in [
            (0, 0),
            (50, 0b1),
            (100, 0b10),
            (249, 0b100),
            (250, 0b1101),
            (450, 0b1_1001),
            (1000, 0b1100_0100),
            (1900, 0b1010_1110),
        ] {
            bench.clock.now = at(ms * MS);
            bench.run();
            assert_eq!(bench.mb(5), bits, "at {ms} ms");
        }
    });
}

#[test]
fn a_long_start_up_is_no_long_cycle() {
    on_each_engine(|| {
        // OB 100 takes 200 ms, the watchdog allows a cycle 150.
        let start_up = vec![c(0), Op::Loop(1), c(0), Op::Loop(3), c(0), Op::Loop(5), c(0), Op::Loop(7)];
        let mut bench = Bench::new(&program(vec![ob1(vec![]), block(ob(100), Interface::default(), start_up)], vec![]));
        bench.clock.per_statement = Span::from_nanos(800);
        bench.run();
        assert!(bench.clock.now > at(200 * MS));
        assert_eq!(bench.cpu.statistics().watchdogs, 0);
    });
}

#[test]
fn warm_hot_and_cold_restart() {
    on_each_engine(|| {
        let keep = |to: u32| -> Vec<Op> {
            (0..3).flat_map(|i| [load(operand(ob1_ir::Width::DWord, l(4 * i, 0))), transfer(md(to + 4 * i))]).collect()
        };
        let start_up = |number| block(ob(number), Interface::default(), keep(20));
        let first = vec![load(operand(ob1_ir::Width::Byte, l(1, 0))), transfer(mb(0))];
        let blocks = || vec![ob1([first.clone(), count(10)].concat()), start_up(100), start_up(101), start_up(102)];
        let hot = |family| {
            let config = CpuConfig::of(family);
            let mut bench = Bench::with(
                Cpu::new(config, &program(blocks(), vec![]), vec![], vec![], common::engine()).expect("loads"),
            );
            bench.cpu.request(Command::Hot);
            assert_eq!(bench.cycle().state, OperatingState::Stop, "there was no RUN");
            bench.cpu.request(Command::Warm);
            bench.run();
            assert_eq!((bench.mb(0), bench.md(20), bench.md(24), bench.md(28)), (1, 0x1381_1B64, 0, 0x0004_7704));
            bench.run();
            bench.cpu.request(Command::Stop);
            bench.cycle();
            bench.cpu.request(Command::Hot);
            bench.cycle();
            bench
        };
        let mut bench = hot(ob1_cpu::Family::S7_300);
        assert_eq!(bench.cpu.state(), OperatingState::Stop, "refused");
        bench.cpu.request(Command::Cold);
        bench.run();
        assert_eq!((bench.mb(0), bench.mw(10)), (4, 1));
        assert_eq!((bench.md(20), bench.md(24), bench.md(28)), (0x1385_1B66, 0x4304, 0x0008_7708), "STOP by operator");
        let mut bench = hot(ob1_cpu::Family::S7_400);
        assert_eq!((bench.cpu.state(), bench.mb(0), bench.mw(10)), (OperatingState::Run, 2, 3), "memory is as it was");
        assert_eq!(bench.md(20), 0x1383_1B65);
    });
}

#[test]
fn a_cpu_without_ob_1_says_so() {
    on_each_engine(|| {
        let other = block(ob(35), Interface::default(), vec![]);
        let mut bench = Bench::new(&program(vec![other], vec![]));
        bench.run();
        assert_eq!(bench.events(), [0x4302, 0x35A1, 0x4301]);
        let entry = *bench.cpu.diagnostics().nth(1).expect("an entry");
        assert_eq!((entry.data, entry.text.as_str()), (1, "OB 1: no program runs in the cycle"));
        let mut bench = Bench::new(&program(vec![ob1(vec![])], vec![]));
        bench.run();
        assert_eq!(bench.events(), [0x4302, 0x4301]);
    });
}

/// A module that floods the buffer does not wash out why the CPU went to STOP.
#[test]
fn what_led_to_stop_outlives_a_flood() {
    on_each_engine(|| {
        let mut bench = Bench::new(&program(vec![ob1(vec![load(mw(9000))])], vec![]));
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        for _ in 0..30_000 {
            bench.cpu.diagnose(ob1_model::Event::SEGMENT_GARBAGE, 0, "flood");
        }
        let left: Vec<_> = bench.events().into_iter().filter(|event| *event != 0xF203).collect();
        assert_eq!(left, [0x4562, 0x2522]);
        let kept = *bench.cpu.diagnostics().last().expect("an entry");
        assert_eq!((kept.number, kept.site.map(|site| site.line)), (3, Some(1)));
    });
}
