//! Interrupts by time and by modules: due times, priority classes, start information, requests that come too soon.

use ob1_cpu::{
    Answer, Ask, Cell, Cpu, CpuConfig, CyclicInterrupt, InterruptError, Missed, Module, ModuleEvent, ModuleSlot,
    OperatingState,
};
use ob1_ir::{AccuOp, CodeBlock, NumberFormat, Op, Width};
use ob1_model::{Event, Interface};
use ob1_time::Span;

use crate::common;
use crate::common::rack::TestModule;
use crate::common::window::Client;
use crate::common::*;

fn count(byte: u32) -> Vec<Op> {
    vec![load(mw(byte)), c(1), Op::Arithmetic(NumberFormat::Int, AccuOp::Add), transfer(mw(byte))]
}

/// Copies the start information to bit memory.
fn keep(to: u32) -> Vec<Op> {
    (0..5).flat_map(|i| [load(operand(Width::DWord, l(4 * i, 0))), transfer(md(to + 4 * i))]).collect()
}

/// A loop of `rounds` statements, 100 ns each; `at` is its first statement's place in the block.
fn busy(at: u32, rounds: u16) -> Vec<Op> {
    vec![c(u32::from(rounds)), Op::Loop(at + 1)]
}

fn organization(number: u16, ops: Vec<Op>) -> CodeBlock {
    block(ob(number), Interface::default(), ops)
}

fn start(config: CpuConfig, blocks: Vec<CodeBlock>) -> Bench {
    Bench::with(Cpu::new(config, &program(blocks, vec![]), vec![], vec![], common::engine()).expect("loads"))
}

fn every(ob: u16, ms: u64) -> CyclicInterrupt {
    CyclicInterrupt::new(ob, ms * MS)
}

/// Sleeps from deadline to deadline until the time is over.
fn run_until(bench: &mut Bench, ms: u64) {
    loop {
        let end = bench.cycle();
        let why: Vec<_> = bench.cpu.diagnostics().map(ToString::to_string).collect();
        assert_eq!(end.state, OperatingState::Run, "{why:#?}");
        if end.next_deadline >= at(ms * MS) {
            bench.clock.now = at(ms * MS);
            return;
        }
        bench.clock.now = bench.clock.now.max(end.next_deadline);
    }
}

#[test]
fn cyclic_interrupts_keep_their_intervals_while_the_cycle_is_waited_for() {
    on_each_engine(|| {
        let phased = CyclicInterrupt { phase: 3 * MS, ..every(34, 40) };
        let config = CpuConfig { min_cycle: 25 * MS, cyclic: vec![phased], ..CpuConfig::default() };
        let blocks = vec![
            ob1(count(0)),
            organization(35, [count(2), keep(20)].concat()),
            organization(34, [count(4), keep(40)].concat()),
        ];
        let mut bench = start(config, blocks);
        run_until(&mut bench, 1000);
        // OB 35 every 100 ms by default; OB 34 at 43, 83, ..., 963 ms... the end excluded.
        assert_eq!((bench.mw(0), bench.mw(2), bench.mw(4)), (40, 9, 24));
        assert_eq!((bench.md(20), bench.md(24), bench.md(28)), (0x1136_0C23, 0, 100));
        assert_eq!((bench.md(40), bench.md(44), bench.md(48)), (0x1135_0B22, 3, 40));
        assert_eq!(bench.md(36) >> 16, 0x0000, "hundredths of a second");
        let late = bench.ob_figures(35);
        assert_eq!((late.runs, late.overruns, late.priority, late.lateness.count()), (9, 0, 12, 9));
        assert!(late.lateness.max() < MS / 10, "{}", late.lateness.max());
        assert_eq!(bench.cpu.statistics().overruns, 0, "the cycle keeps its own schedule");
    });
}

#[test]
fn a_call_before_the_cycle_is_due_serves_only_the_interrupt() {
    on_each_engine(|| {
        let config = CpuConfig { min_cycle: 50 * MS, cyclic: vec![every(35, 20)], ..CpuConfig::default() };
        let mut bench = start(config, vec![ob1(count(0)), organization(35, count(2))]);
        let end = bench.cycle();
        assert_eq!((end.next_deadline, end.whole), (at(20 * MS), true));
        bench.clock.now = at(20 * MS);
        let end = bench.cycle();
        assert_eq!((end.next_deadline, end.whole, bench.mw(0), bench.mw(2)), (at(40 * MS), false, 1, 1));
        bench.clock.now = at(40 * MS);
        assert_eq!(bench.cycle().next_deadline, at(50 * MS));
        bench.clock.now = at(50 * MS);
        assert!(bench.cycle().whole);
        assert_eq!((bench.mw(0), bench.mw(2), bench.cpu.statistics().scans), (2, 2, 2));
    });
}

#[test]
fn a_long_cycle_is_pre_empted_at_safe_points_and_goes_on_where_it_was() {
    on_each_engine(|| {
        // OB 1 takes 20 ms; OB 38 comes every 10 ms by default, OB 37 every 20 ms, here 4 ms.
        let mut code = vec![load(mw(2)), transfer(mw(30)), c(7)];
        let at = code.len() as u32;
        code.extend([c(50_000), Op::Loop(at + 1), c(50_000), Op::Loop(at + 3), c(50_000), Op::Loop(at + 5)]);
        code.extend([c(50_000), Op::Loop(at + 7), transfer(mw(34)), load(mw(2)), transfer(mw(32))]);
        let disturbs = [count(2), vec![c(0xFFFF), Op::LoadArConst(ob1_ir::AddressRegister::Ar1, 5)]].concat();
        let config = CpuConfig { cyclic: vec![every(37, 4)], ..CpuConfig::default() };
        let mut bench = start(config, vec![ob1(code), organization(37, disturbs)]);
        bench.run();
        assert_eq!((bench.mw(30), bench.mw(32)), (0, 5));
        assert_eq!(bench.mw(34), 0, "the loop counter of OB 1 is its own");
        let ob1 = bench.ob_figures(1);
        assert_eq!(ob1.runs, 1);
        let longest = ob1.execution.max();
        assert!((20 * MS..20 * MS + MS / 10).contains(&longest), "without OB 37: {longest}");
    });
}

#[test]
fn the_higher_class_goes_first_and_pre_empts_the_lower() {
    on_each_engine(|| {
        // Each notes its turn: the last to begin is the last in MW 10, 12, 14.
        let turn = |byte| [count(0), vec![load(mw(0)), transfer(mw(byte))]].concat();
        let mut slow = turn(10);
        let behind = slow.len() as u32;
        slow.extend(busy(behind, 60_000));
        slow.extend([load(mw(0)), transfer(mw(16))]);
        let config = CpuConfig {
            min_cycle: 40 * MS,
            watchdog: Span::ZERO,
            cyclic: vec![every(32, 10), every(35, 10), every(36, 14)],
            ..CpuConfig::default()
        };
        let blocks = vec![ob1(vec![]), organization(32, slow), organization(35, turn(12)), organization(36, turn(14))];
        let mut bench = start(config, blocks);
        bench.run();
        bench.clock.now = at(10 * MS);
        assert!(!bench.cycle().whole);
        // OB 35, OB 32, and OB 36 in the middle of that.
        assert_eq!((bench.mw(12), bench.mw(10), bench.mw(14), bench.mw(16)), (1, 2, 3, 3));
    });
}

#[test]
fn a_request_while_the_ob_runs_calls_ob_80_and_runs_later_or_is_skipped() {
    on_each_engine(|| {
        // The first run of OB 38 takes 12 ms of its 10: MW 50 and MW 52 rounds.
        let slow = |n| {
            let mut code =
                vec![load(mw(50)), Op::Loop(1), load(mw(52)), Op::Loop(3), c(1), transfer(mw(50)), transfer(mw(52))];
            code.extend(count(n));
            code
        };
        let first_slow = |bench: &mut Bench| {
            bench.run();
            bench.set(50, Width::Word, 60_000);
            bench.set(52, Width::Word, 60_000);
            bench.clock.now = at(10 * MS);
        };
        for (missed, runs) in [(Missed::CatchUp, 2), (Missed::Skip, 1)] {
            let ob38 = CyclicInterrupt { missed, ..every(38, 10) };
            let config =
                CpuConfig { min_cycle: 15 * MS, cyclic: vec![ob38], watchdog: Span::ZERO, ..CpuConfig::default() };
            let handler = organization(80, [count(4), keep(20)].concat());
            let mut bench = start(config.clone(), vec![ob1(vec![]), organization(38, slow(2)), handler]);
            first_slow(&mut bench);
            bench.run();
            assert_eq!(bench.mw(4), 1, "{missed:?}: OB 80");
            assert_eq!(bench.mw(2), runs, "{missed:?}");
            assert_eq!((bench.md(20), bench.md(28)), (0x3502_1A50, 0x1139_0F26), "{missed:?}");
            assert_eq!(bench.ob_figures(38).overruns, bench.mw(4).into(), "{missed:?}");
            let mut bench = start(config, vec![ob1(vec![]), organization(38, slow(2))]);
            first_slow(&mut bench);
            assert_eq!(bench.cycle().state, OperatingState::Stop, "no OB 80");
            assert_eq!(bench.events()[..2], [0x4568, 0x3502]);
        }
    });
}

#[test]
fn periods_slept_through_are_counted_but_no_error() {
    on_each_engine(|| {
        let config = CpuConfig { min_cycle: 5 * MS, cyclic: vec![every(35, 10)], ..CpuConfig::default() };
        let mut bench = start(config, vec![ob1(vec![]), organization(35, count(2))]);
        bench.run();
        bench.clock.now = at(47 * MS);
        bench.run();
        let figures = bench.ob_figures(35);
        assert_eq!((bench.mw(2), figures.overruns, figures.lateness.max()), (1, 3, 37 * MS));
        bench.clock.now = at(50 * MS);
        bench.run();
        assert_eq!(bench.mw(2), 2, "and the next one is on time");
    });
}

#[test]
fn no_interrupt_in_start_up_and_none_in_stop() {
    on_each_engine(|| {
        let config = CpuConfig { cyclic: vec![every(35, 1)], ..CpuConfig::default() };
        let blocks = vec![ob1(vec![]), organization(35, count(2)), organization(100, busy(0, 60_000))];
        let mut bench = start(config, blocks);
        bench.run();
        assert_eq!(bench.mw(2), 0);
        bench.cpu.request(ob1_cpu::Command::Stop);
        bench.cycle();
        bench.clock.now += 100 * MS;
        bench.cycle();
        assert_eq!(bench.mw(2), 0);
        bench.cpu.request(ob1_cpu::Command::Run);
        bench.run();
        bench.clock.now += MS;
        bench.run();
        assert_eq!(bench.mw(2), 1, "intervals begin anew");
    });
}

#[test]
fn hardware_interrupts_by_call_and_port() {
    on_each_engine(|| {
        let config = CpuConfig { min_cycle: 10 * MS, ..CpuConfig::default() };
        let mut bench = start(config, vec![ob1(count(0)), organization(40, [count(2), keep(20)].concat())]);
        assert_eq!(bench.cpu.fire_hardware_interrupt(40, 256, 1), Err(InterruptError::NotRunning));
        bench.run();
        for ob in [39, 41, 48, 35] {
            assert_eq!(bench.cpu.fire_hardware_interrupt(ob, 256, 1), Err(InterruptError::NoOb), "OB {ob}");
        }
        assert_eq!(bench.cpu.fire_hardware_interrupt(40, 256, 0x8000_0001), Ok(()));
        assert!(!bench.cycle().whole, "the cycle is not due yet");
        assert_eq!((bench.mw(0), bench.mw(2)), (1, 1));
        assert_eq!((bench.md(20), bench.md(24), bench.md(28)), (0x1141_1028, 0x0054_0100, 0x8000_0001));
        let mut client = Client::of(&mut bench.cpu);
        let ask = Ask::HardwareInterrupt { ob: 40, address: 0, point: 5 };
        client.ask(1, [ask]);
        bench.cycle();
        assert_eq!(client.answer(), Some(Answer::Interrupt(Ok(()))));
        let figures = bench.ob_figures(40);
        assert_eq!((figures.priority, figures.runs), (16, 2));
        assert_eq!((bench.mw(2), bench.md(28)), (2, 5));
        for _ in 0..16 {
            assert_eq!(bench.cpu.fire_hardware_interrupt(40, 0, 0), Ok(()));
        }
        assert_eq!(bench.cpu.fire_hardware_interrupt(40, 0, 0), Err(InterruptError::Full));
        bench.cycle();
        assert_eq!(bench.mw(2), 18, "all that waited");
    });
}

fn with_module(config: CpuConfig, blocks: Vec<CodeBlock>) -> (Bench, TestModule) {
    let module = TestModule::new(4);
    let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![(ModuleSlot::new("io", 8), Box::new(module.clone()))];
    (Bench::with(Cpu::new(config, &program(blocks, vec![]), vec![], modules, common::engine()).expect("loads")), module)
}

fn event(number: u16) -> ModuleEvent {
    ModuleEvent { event: Event(number), diagnostic_interrupt: false, data: [7; 16], len: 4 }
}

#[test]
fn hardware_interrupts_of_modules_and_ob_85_where_their_ob_is_missing() {
    on_each_engine(|| {
        let blocks = vec![ob1(vec![]), organization(41, keep(20))];
        let (mut bench, module) = with_module(CpuConfig::default(), blocks.clone());
        bench.run();
        module.look(|s| s.events.push(event(0x1142)));
        bench.run();
        assert_eq!((bench.md(20), bench.md(24), bench.md(28)), (0x1142_1129, 0x0054_0008, 0x0707_0707));
        module.look(|s| s.events.push(event(0x1141)));
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events()[..2], [0x456D, 0x35A1]);

        let (mut bench, module) =
            with_module(CpuConfig::default(), [blocks, vec![organization(85, keep(40))]].concat());
        bench.run();
        module.look(|s| s.events.push(event(0x1141)));
        bench.run();
        assert_eq!((bench.md(40), bench.md(44), bench.md(48)), (0x35A1_1A55, 0x0000_0008, 0x1141_0000));
    });
}

#[test]
fn a_lost_driver_calls_ob_86_and_so_does_its_return() {
    on_each_engine(|| {
        let (mut bench, module) =
            with_module(CpuConfig::default(), vec![ob1(vec![]), organization(86, [count(0), keep(20)].concat())]);
        bench.run();
        module.look(|s| s.events.push(event(Event::DRIVER_UP.0)));
        bench.run();
        assert_eq!(bench.mw(0), 0, "the first start is no return");
        for (number, calls, first) in [(Event::DRIVER_LOST, 1, 0x39C4_1A56), (Event::DRIVER_UP, 2, 0x38C4_1A56)] {
            module.look(|s| s.events.push(event(number.0)));
            bench.run();
            assert_eq!((bench.mw(0), bench.md(20), bench.md(24), bench.md(28)), (calls, first, 8, 0x0008_0001));
        }
    });
}

#[test]
fn image_errors_call_ob_85_on_an_s7_400_only() {
    on_each_engine(|| {
        let blocks = vec![ob1(vec![]), organization(85, [count(0), keep(20)].concat())];
        for (family, calls) in [(ob1_cpu::Family::S7_300, 0), (ob1_cpu::Family::S7_400, 4)] {
            let (mut bench, module) = with_module(CpuConfig::of(family), blocks.clone());
            bench.run();
            module.look(|s| s.absent = true);
            bench.run();
            bench.run();
            assert_eq!(bench.mw(0), calls, "inputs and outputs, each scan");
            if calls > 0 {
                assert_eq!((bench.md(20), bench.md(24), bench.md(28)), (0x39B2_1A55, 0x1000_0008, 8));
                assert_eq!(bench.events()[..3], [0x39B2, 0x39B1, 0x4302], "one entry each");
            }
        }
        let (mut bench, module) = with_module(CpuConfig::of(ob1_cpu::Family::S7_400), blocks[..1].to_vec());
        bench.run();
        module.look(|s| s.absent = true);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events()[..2], [0x456D, 0x39B1]);
    });
}

#[test]
fn image_errors_that_are_told_when_they_begin_and_end() {
    on_each_engine(|| {
        let config = CpuConfig { image_errors: ob1_cpu::ImageErrors::Changes, ..CpuConfig::default() };
        let blocks = vec![ob1(vec![]), organization(85, [count(0), keep(20)].concat())];
        let (mut bench, module) = with_module(config, blocks);
        bench.run();
        module.look(|s| s.absent = true);
        bench.run();
        bench.run();
        assert_eq!((bench.mw(0), bench.md(20)), (2, 0x39B4_1A55), "inputs and outputs, once");
        module.look(|s| s.absent = false);
        bench.run();
        bench.run();
        assert_eq!((bench.mw(0), bench.md(20), bench.md(24), bench.md(28)), (4, 0x38B4_1A55, 0x1000_0008, 8));
        assert_eq!(bench.events()[..4], [0x38B4, 0x38B3, 0x39B4, 0x39B3]);
    });
}

/// A station of a bus: diagnostic addresses 2046 and 2047, bus 1, station 5.
fn station(event: Event, missing: bool) -> ModuleEvent {
    let mut data = [0; 16];
    data[..7].copy_from_slice(&[0x07, 0xFE, 0x07, 0xFF, 1, 5, u8::from(missing)]);
    ModuleEvent { event, diagnostic_interrupt: false, data, len: 0 }
}

#[test]
fn a_station_of_a_bus_calls_ob_86_and_is_stop_without_it() {
    on_each_engine(|| {
        let blocks = vec![ob1(vec![]), organization(86, [count(0), keep(20)].concat())];
        let (mut bench, module) = with_module(CpuConfig::default(), blocks.clone());
        bench.run();
        for (calls, event, first, last) in [
            (1, Event::STATION_FAILED, 0x39C4_1A56, 0x07FE_0105),
            (2, Event::STATION_BACK, 0x38C4_1A56, 0x07FE_0105),
            (3, Event::BUS_FAILED, 0x39C3_1A56, 0x0000_0100),
        ] {
            module.look(|s| s.events.push(station(event, false)));
            bench.run();
            let told = (bench.mw(0), bench.md(20), bench.md(24) & 0xFFFF, bench.md(28));
            assert_eq!(told, (calls, first, 0x07FF, last));
        }
        for (event, missing, stops) in [
            (Event::STATION_BACK, false, false),
            (Event::STATION_FAILED, true, false),
            (Event::STATION_FAILED, false, true),
            (Event::BUS_FAILED, false, true),
        ] {
            let (mut bench, module) = with_module(CpuConfig::default(), blocks[..1].to_vec());
            bench.run();
            module.look(|s| s.events.push(station(event, missing)));
            let state = bench.cycle().state;
            assert_eq!(state == OperatingState::Stop, stops, "{event:?}, missing at the start-up: {missing}");
            assert_eq!(bench.events()[0], if stops { 0x456F } else { event.0 });
        }
    });
}

#[test]
fn a_loop_in_an_interrupt_between_cycles_ends_by_the_watchdog() {
    on_each_engine(|| {
        let config = CpuConfig { min_cycle: 500 * MS, cyclic: vec![every(35, 200)], ..CpuConfig::default() };
        let endless = vec![Op::Jump(ob1_ir::Jump::Always, 0)];
        let mut bench = start(config, vec![ob1(vec![]), organization(35, endless)]);
        bench.run();
        bench.clock.now = at(200 * MS);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert!(bench.events().contains(&0x3501), "{:?}", bench.events());
    });
}

#[test]
fn obs_without_an_event_of_their_own_load() {
    on_each_engine(|| {
        let blocks: Vec<_> =
            [1, 10, 17, 20, 23, 30, 38, 47, 80, 81, 82, 83, 84, 85, 86, 87, 88, 100, 101, 102, 121, 122]
                .map(|number| organization(number, vec![Op::Nop]))
                .into();
        let mut bench = start(CpuConfig::default(), blocks);
        bench.run();
        assert_eq!(bench.cpu.accounts().figures().obs.len(), 22);
    });
}

#[test]
fn wrong_settings_are_refused_by_name() {
    on_each_engine(|| {
        let errors = |cyclic: Vec<CyclicInterrupt>| {
            let config = CpuConfig { cyclic, ..CpuConfig::default() };
            let errors =
                Cpu::new(config, &program(vec![], vec![]), vec![], vec![], common::engine()).err().unwrap_or_default();
            errors.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(errors(vec![every(35, 10), every(30, 60_000)]), [""; 0]);
        assert_eq!(errors(vec![every(40, 10)]), ["L001: CPU setting cyclic.ob = 40: at most 38"]);
        assert_eq!(
            errors(vec![every(35, 60_001)]),
            ["L001: CPU setting cyclic.period = 60001000000: at most 60000000000"]
        );
        assert_eq!(errors(vec![every(35, 1), every(35, 2)]).len(), 1);
        assert_eq!(errors(vec![every(29, 0)]).len(), 2);
    });
}

#[test]
fn the_process_image_is_not_touched_by_an_interrupt_between_cycles() {
    on_each_engine(|| {
        let (mut bench, module) = with_module(
            CpuConfig { min_cycle: 50 * MS, cyclic: vec![every(35, 20)], ..CpuConfig::default() },
            vec![ob1(vec![]), organization(35, count(2))],
        );
        bench.run();
        module.look(|s| s.inputs[0] = 9);
        bench.clock.now = at(20 * MS);
        bench.run();
        let input = Cell::Area(ob1_model::Area::Input, 64);
        assert_eq!((bench.mw(2), bench.cpu.read(input, Width::Byte)), (1, Ok(0)));
        bench.clock.now = at(50 * MS);
        bench.run();
        assert_eq!(bench.cpu.read(input, Width::Byte), Ok(9));
    });
}

#[test]
fn a_due_time_is_seen_at_the_first_safe_point_behind_it() {
    on_each_engine(|| {
        // A loop of two statements, 200 ns a round: OB 35 at 3.1 us, and every 3.1 us, begins within 200 ns of its
        // time.
        let interval = Span::from_nanos(3_100);
        let code = vec![c(500), Op::Nop, Op::Loop(1)];
        let ob35 = CyclicInterrupt::new(35, interval);
        let config = CpuConfig { cyclic: vec![ob35], watchdog: Span::ZERO, ..CpuConfig::default() };
        let mut bench = start(config, vec![ob1(code), organization(35, count(2))]);
        for _ in 0..10 {
            bench.run();
        }
        let figures = bench.ob_figures(35);
        assert_eq!((figures.runs, figures.overruns), (u64::from(bench.mw(2)), 0));
        assert!(figures.runs > 300, "{}", figures.runs);
        assert!(figures.lateness.max() <= Span::from_nanos(200), "{}", figures.lateness.max());
        // The watchdog likewise: OB 80 with the cycle's time.
        let watchdog = 5 * MS + Span::from_nanos(50);
        let config = CpuConfig { watchdog, ..CpuConfig::default() };
        let endless = vec![Op::Nop, Op::Jump(ob1_ir::Jump::Always, 0)];
        let mut bench = start(config, vec![ob1(endless)]);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        let excess = bench.cpu.diagnostics().find(|e| e.event.0 == 0x3501).expect("exceeded").time;
        assert!((at(watchdog)..=at(watchdog) + Span::from_nanos(200)).contains(&excess), "{excess}");
    });
}

#[test]
fn calls_of_short_blocks_hold_up_no_interrupt_for_long() {
    on_each_engine(|| {
        // 1,000 calls of a block of 9 statements, 100 ns each: there is a safe point every 256 statements at least.
        let interval = Span::from_micros(40);
        let calls = (0..1000).map(|_| call(fc(1), vec![])).collect();
        let config = CpuConfig {
            cyclic: vec![CyclicInterrupt::new(35, interval)],
            watchdog: Span::ZERO,
            ..CpuConfig::default()
        };
        let short = block(fc(1), Interface::default(), vec![Op::Nop; 8]);
        let mut bench = start(config, vec![ob1(calls), short, organization(35, count(2))]);
        for _ in 0..3 {
            bench.run();
        }
        let figures = bench.ob_figures(35);
        assert!(figures.runs > 60, "{}", figures.runs);
        assert!(figures.lateness.max() <= Span::from_nanos(25_700), "{}", figures.lateness.max());
    });
}
