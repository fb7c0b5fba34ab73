//! Engines are exchanged between two scans: the program continues where it was.

use std::sync::Arc;

use ob1_cpu::engine::{ACCOUNTING, Engine, Factory, PLAIN, Plan, REFERENCE};
use ob1_cpu::{Cpu, CpuConfig, LoadError};
use ob1_ir::{Arg, CallMode, NumberFormat, Op, Program, Width};
use ob1_model::{BlockKind, DataType, Interface, Section};

use crate::common::*;

/// OB 1 counts in MW 10 through a function block with an instance.
fn counting() -> Program {
    let own = |width| operand(width, ob1_ir::Place::Instance(ob1_model::BitAddr(0)));
    let body =
        vec![load(own(Width::Word)), Op::AddConst { format: NumberFormat::Int, value: 1 }, transfer(own(Width::Word))];
    let counter = interface(BlockKind::Fb, &[("N", Section::InOut, DataType::Int)], 0);
    let blocks = vec![
        ob1(vec![call_fb(fb(1), 5, vec![Arg::Operand(mw(10))])]),
        block(fb(1), counter, body),
        block(ob(100), Interface::default(), vec![c(0), transfer(mw(10))]),
    ];
    program(blocks, vec![instance_db(5, fb(1), 2)])
}

#[test]
fn an_engine_is_exchanged_between_two_scans() {
    let cpu = Cpu::new(CpuConfig::default(), &counting(), vec![], vec![], &Later(6 * 1024, true)).expect("loads");
    let mut bench = Bench::with(cpu);
    let mut expected = 0;
    for (name, factory) in ENGINES {
        let engine = factory.engine(bench.cpu.plan()).expect("it runs the program");
        let before = bench.cpu.engine();
        let statements = bench.cpu.statistics().statements;
        let old = bench.cpu.exchange_engine(engine).unwrap_or_else(|_| panic!("{name} was made of this plan"));
        assert!(name.starts_with(bench.cpu.engine()), "{name}: {}", bench.cpu.engine());
        assert_eq!(old.name(), before);
        assert_eq!(bench.cpu.statistics().statements, statements);
        for _ in 0..3 {
            bench.run();
            expected += 1;
            assert_eq!(bench.mw(10), expected, "{name}");
        }
    }
}

/// The reference engine, with this many bytes of stack a block for one that takes over, if there is room or in any
/// case.
struct Later(usize, bool);

impl Factory for Later {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        REFERENCE.engine(plan)
    }

    fn stack_per_block(&self) -> usize {
        self.0
    }

    fn stack_is_for_later(&self) -> bool {
        self.1
    }
}

#[test]
fn without_stack_for_it_a_program_runs_and_no_machine_code_takes_over() {
    let load = |factory| Cpu::new(CpuConfig::default(), &counting(), vec![], vec![], factory);
    let native = ENGINES.iter().find(|(name, _)| *name == "native").expect("a row").1;
    // Once it was wanted in any case, once nobody has asked for it.
    assert!(matches!(load(&Later(8 << 20, false)).map(|_| ()), Err(e) if matches!(e[..], [LoadError::Stack { .. }])));
    for factory in [&Later(8 << 20, true) as &dyn Factory, REFERENCE] {
        let mut bench = Bench::with(load(factory).expect("it loads without"));
        assert_eq!(bench.cpu.plan().stack_per_block, 0);
        assert!(native.engine(bench.cpu.plan()).is_err_and(|why| why.contains("stack")));
        bench.run();
        assert_eq!((bench.mw(10), bench.cpu.engine()), (1, "reference"));
    }
    let asked = load(&Later(6 * 1024, true)).expect("it loads");
    assert_eq!(asked.plan().stack_per_block, 6 * 1024);
    assert!(native.engine(asked.plan()).is_ok());
}

#[test]
fn an_engine_of_another_plan_comes_back() {
    let of = |program: &Program| Cpu::new(CpuConfig::default(), program, vec![], vec![], REFERENCE).expect("loads");
    let (mut one, other) = (of(&counting()), of(&counting()));
    let foreign = PLAIN.engine(other.plan()).expect("it runs the program");
    let Err(back) = one.exchange_engine(foreign) else { panic!("it was made of another plan") };
    assert_eq!((back.name(), one.engine()), ("plain", "reference"));
    assert!(Arc::ptr_eq(back.plan(), other.plan()) && !Arc::ptr_eq(back.plan(), one.plan()));
}

/// Loops, calls, a call that is not made, an error that OB 121 answers: each statement counts once, for its own block;
/// those of the start-up do not count.
#[test]
fn each_statement_is_on_the_account_of_its_block() {
    let looped =
        |times: u32| vec![Op::LoadConst(times), transfer(mw(20)), call(fc(2), vec![]), load(mw(20)), Op::Loop(1)];
    let blocks = vec![
        ob1(vec![call(fc(1), vec![]), Op::ClearRlo, uc(CallMode::Conditional, fc(2)), call(fc(2), vec![])]),
        block(fc(1), Interface::default(), looped(3)),
        block(fc(2), Interface::default(), vec![Op::OpenDb(ob1_ir::DbRegister::Db, ob1_ir::Number::Fixed(99))]),
        block(ob(121), Interface::default(), vec![]),
        block(ob(100), Interface::default(), looped(1000)),
    ];
    let program = program(blocks, vec![]);
    let of = |factory| {
        let cpu = Cpu::new(CpuConfig::default(), &program, vec![], vec![], factory).expect("loads");
        let mut bench = Bench::with(cpu);
        bench.cycle();
        bench.cycle();
        assert_eq!(bench.cpu.state(), ob1_cpu::OperatingState::Run);
        bench.cpu.plan().executed.read()
    };
    // Two scans. FC 1: a load, three times the loop of four, the end; FC 2: four calls of an error and the end.
    assert_eq!(of(ACCOUNTING), [2 * 5, 2 * 14, 2 * 8, 2 * 4, 0]);
    assert_eq!(of(REFERENCE), [0; 5]);
}

/// What an engine keeps for blocks that an abort has left is dropped: STOP out of nested blocks, again and again.
#[test]
fn an_abort_leaves_no_frames_behind() {
    on_each_engine(|| {
        let depth = CpuConfig::default().nesting_depth;
        // FC 1 calls FC 2, and so on; the innermost makes a mistake without OB 121.
        let innermost = u16::from(depth) - 1;
        let fault = vec![Op::OpenDb(ob1_ir::DbRegister::Db, ob1_ir::Number::Fixed(99))];
        let mut blocks = vec![ob1(vec![call(fc(1), vec![])]), block(fc(innermost), Interface::default(), fault)];
        blocks.extend((1..innermost).map(|n| block(fc(n), Interface::default(), vec![call(fc(n + 1), vec![])])));
        let mut bench = Bench::new(&program(blocks, vec![]));
        for _ in 0..3 {
            bench.cycle();
            assert_eq!(bench.cpu.state(), ob1_cpu::OperatingState::Stop);
            assert_eq!(
                bench.events().get(1),
                Some(&ob1_model::FaultKind::DbNotLoaded.number()),
                "{:04X?}",
                bench.events()
            );
            bench.cpu.request(ob1_cpu::Command::Run);
        }
    });
}
