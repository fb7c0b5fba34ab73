//! Two engines compared: equal runs are not reported, and the first difference stops the CPU with its place.

use std::sync::Arc;

use ob1_cpu::engine::{Both, Engine, Factory, Op as Short, PLAIN, Plan};
use ob1_cpu::{Abort, Cpu, CpuConfig, Module, ModuleSlot, OperatingState};
use ob1_ir::{Number, NumberFormat, Op, Program, Width};
use ob1_model::{Area, Event, FaultKind, Interface, TimerKind};

use crate::common::rack::TestModule;
use crate::common::*;

/// An engine whose program is not quite the one it was given: each changed statement is an error of the engine.
struct Wrong(fn(&mut Plan));

impl Factory for Wrong {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        let mut other = Plan {
            blocks: plan.blocks.clone(),
            signatures: plan.signatures.clone(),
            data: plan.data.clone(),
            executed: ob1_cpu::engine::Executed::default(),
            ..**plan
        };
        self.0(&mut other);
        let inner = PLAIN.engine(&Arc::new(other))?;
        Ok(Box::new(WrongEngine(inner, Arc::clone(plan))))
    }
}

struct WrongEngine(Box<dyn Engine>, Arc<Plan>);

impl Engine for WrongEngine {
    fn name(&self) -> &'static str {
        "wrong"
    }

    fn plan(&self) -> &Arc<Plan> {
        &self.1
    }

    fn call(
        &self,
        block: u32,
        entry: &ob1_cpu::engine::Entry,
        cx: &mut ob1_cpu::engine::Context<'_>,
    ) -> Result<(), Abort> {
        self.0.call(block, entry, cx)
    }
}

/// Puts another statement in the place of one of OB 1.
fn replace(plan: &mut Plan, statement: usize, op: Op) {
    plan.blocks[0].stmts[statement].op = op;
}

fn with(program: &Program, engine: &dyn Factory) -> Bench {
    let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![(ModuleSlot::new("io", 256), Box::new(TestModule::new(8)))];
    Bench::with(Cpu::new(CpuConfig::default(), program, ob1_cpu::system_blocks(), modules, engine).expect("loads"))
}

/// Something of everything: memory, a timer, a counter, a peripheral byte, a system function, an error, a long loop.
fn program_of_all() -> Program {
    let peripheral = |byte| operand(Width::Byte, place(Area::Peripheral, byte, 0));
    let ops = vec![
        c(7),                                                                 // 0
        transfer(mw(10)),                                                     // 1
        Op::SetRlo,                                                           // 2
        c(0x0010),                                                            // 3
        Op::StartTimer(TimerKind::Pulse, Number::Fixed(3)),                   // 4
        Op::SetRlo,                                                           // 5
        Op::CountUp(Number::Fixed(2)),                                        // 6
        load(peripheral(256)),                                                // 7
        Op::AddConst { format: NumberFormat::Int, value: 1 },                 // 8
        transfer(peripheral(256)),                                            // 9
        call(ob1_model::BlockId::new(ob1_model::BlockKind::Sfc, 43), vec![]), // 10
        Op::OpenDb(ob1_ir::DbRegister::Db, Number::Fixed(99)),                // 11: not loaded
        c(3000),                                                              // 12
        transfer(mw(20)),                                                     // 13
        load(mw(20)),                                                         // 14
        Op::Loop(13),                                                         // 15
        c(1),                                                                 // 16
        transfer(mw(30)),                                                     // 17
    ];
    program(vec![ob1(ops), block(ob(121), Interface::default(), vec![load(mw(40)), transfer(mw(42))])], vec![])
}

#[test]
fn engines_that_do_the_same_are_not_told_apart() {
    let mut alone = with(&program_of_all(), PLAIN);
    let mut both = with(&program_of_all(), &Both(PLAIN));
    assert_eq!(both.cpu.engine(), "both");
    for _ in 0..5 {
        alone.run();
        both.run();
        assert_eq!(alone.cpu.bit_memory(), both.cpu.bit_memory());
        assert_eq!(alone.cpu.statistics().statements, both.cpu.statistics().statements);
        assert_eq!(alone.clock.now, both.clock.now, "the clock is told of each statement once");
        assert_eq!(alone.events(), both.events(), "the outside is asked once");
    }
}

/// The log of a run with a wrong engine.
fn told(wrong: &'static Wrong) -> (Bench, String) {
    let mut bench = with(&program_of_all(), &Both(wrong));
    let mut log = bench.cpu.log_reader().expect("the first");
    let end = bench.cycle();
    let first = log.take().map_or_else(String::new, |line| line.text().to_owned());
    assert_eq!(end.state, OperatingState::Stop, "{first}");
    assert_eq!(bench.events()[0], Event::ENGINES_DIFFER.0, "{first}");
    (bench, first)
}

#[test]
fn the_first_difference_stops_with_its_place() {
    static CONSTANT: Wrong = Wrong(|plan| replace(plan, 0, c(8)));
    let (mut bench, log) = told(&CONSTANT);
    assert!(log.contains("MB 11 is 08h instead of 07h"), "{log}");
    let site = bench.cpu.diagnostic(0).and_then(|entry| entry.site);
    assert_eq!(
        site.map(|site| (site.block, site.line)),
        Some((ob(1), 11)),
        "the next question whose statement is known"
    );
    assert_eq!(bench.mw(10), 7, "memory is as the reference engine left it");
}

#[test]
fn each_kind_of_difference_is_told() {
    static STATEMENTS: Wrong = Wrong(|plan| plan.blocks[0].ops[16] = Short::End);
    static PERIPHERAL: Wrong = Wrong(|plan| replace(plan, 8, Op::AddConst { format: NumberFormat::Int, value: 2 }));
    static TIMER: Wrong = Wrong(|plan| replace(plan, 4, Op::StartTimer(TimerKind::OnDelay, Number::Fixed(3))));
    static COUNTER: Wrong = Wrong(|plan| replace(plan, 6, Op::CountUp(Number::Fixed(5))));
    static FAULT: Wrong = Wrong(|plan| replace(plan, 11, Op::OpenDb(ob1_ir::DbRegister::Db, Number::Fixed(98))));
    static NO_FAULT: Wrong = Wrong(|plan| replace(plan, 11, Op::Nop));
    static ENDLESS: Wrong = Wrong(|plan| plan.blocks[0].ops[15] = Short::Jump { target: 13 });
    let not_loaded = format!("fault {:04X}h of 98", FaultKind::DbNotLoaded.number());
    for (wrong, expected) in [
        (&STATEMENTS, "statements instead of"),
        (&PERIPHERAL, "peripheral bytes [02] to 256"),
        (&TIMER, "T 3"),
        (&COUNTER, "Z "),
        (&FAULT, not_loaded.as_str()),
        (&NO_FAULT, "instead of fault"),
        (&ENDLESS, "MB 2"),
    ] {
        let (_, log) = told(wrong);
        assert!(log.contains(expected), "{expected}: {log}");
    }
}
