//! Code of both tiers in one image: as it comes while a station runs.

use std::fmt::Write as _;
use std::os::fd::AsFd;
use std::sync::Arc;

use ob1_cpu::engine::{ACCOUNTING, Engine, Factory, Plan, REFERENCE};
use ob1_cpu::{Command, Cpu, CpuConfig, Still, system_blocks};
use ob1_native::{
    Compiler, Image, NAME, NAME_FAST, NAME_HOTTEST, Native, Order, Target, Tier, fingerprint, hottest, memory_file,
    seal,
};
use ob1_time::Span;

/// FC 1 to FC 1000 are called once in a scan, FC 2000 has a loop. Each counts in its own words.
fn program() -> ob1_ir::Program {
    let mut text = String::new();
    for n in 1..=1000 {
        let word = 2 * (n % 400);
        let count = format!("L MW {word};\nL {n};\n+I;\nT MW {word};\n");
        let _ = write!(text, "FUNCTION FC {n} : VOID\nBEGIN\n{}END_FUNCTION\n", count.repeat(5));
    }
    text.push_str(
        "FUNCTION FC 2000 : VOID\nVAR_TEMP\n n : INT;\nEND_VAR\nBEGIN\nL 30000;\nm: T #n;\nL MD 1000;\nL #n;\n+D;\n\
         T MD 1000;\nL #n;\nLOOP m;\nEND_FUNCTION\nORGANIZATION_BLOCK OB 1\nBEGIN\n",
    );
    for n in 1..=1000 {
        let _ = writeln!(text, "UC FC {n};");
    }
    text.push_str("CALL FC 2000;\nEND_ORGANIZATION_BLOCK\n");
    let output = ob1_stl::compile(
        &[ob1_stl::Source::new("p.awl", text)],
        &ob1_stl::Library::new(),
        &ob1_stl::Options::default(),
    );
    assert!(output.is_good(), "{:?}", output.diagnostics.first());
    output.program
}

#[test]
fn the_hottest_block_is_optimised_in_the_first_file_and_nobody_sees_a_difference() {
    let program = program();
    let config = CpuConfig { memory_bytes: 2048, watchdog: Span::ZERO, ..CpuConfig::default() };
    let load =
        |engine: &dyn Factory| Cpu::new(config.clone(), &program, Vec::new(), Vec::new(), engine).expect("it loads");
    let (mut reference, mut cpu) = (load(REFERENCE), load(&Room));
    for cpu in [&mut reference, &mut cpu] {
        cpu.request(Command::Run);
    }
    let mut run = |cpu: &mut Cpu| {
        for _ in 0..2 {
            reference.cycle(&mut Still);
            cpu.cycle(&mut Still);
            assert!(reference.bit_memory() == cpu.bit_memory(), "{}", cpu.engine());
            assert_eq!(reference.statistics().statements, cpu.statistics().statements, "{}", cpu.engine());
        }
    };
    run(&mut cpu);
    let plan = Arc::clone(cpu.plan());
    let first = hottest(&plan, &plan.executed.read());
    let names: Vec<String> = first.iter().map(|block| plan.blocks[*block as usize].id.to_string()).collect();
    assert_eq!(names, ["FC 2000"]);

    let compiler = |tier| Compiler::new(Target::Host, tier).expect("this processor");
    let [fast, optimised] = [Tier::Fast, Tier::Optimised].map(|tier| compiler(tier).image(&plan));
    let mut mixed = fast.clone();
    compiler(Tier::Optimised).compile(&plan, first.iter().copied(), &mut mixed);
    for block in 0..plan.blocks.len() as u32 {
        let like = if first.contains(&block) { &optimised } else { &fast };
        assert_eq!(mixed.code(block), like.code(block), "{}", plan.blocks[block as usize].id);
    }
    assert_ne!(mixed.code(first[0]), fast.code(first[0]), "the tiers differ");
    assert_eq!(mixed.unoptimised().len(), plan.blocks.len() - 1);

    let order = Order { fingerprint: fingerprint(&plan), secret: [3; 16] };
    let mut take_over = |image: &Image, name: &str, cpu: &mut Cpu| {
        let file = seal(memory_file().expect("memory"), &image.file(&order)).expect("memory");
        let engine = Native::of_file(&plan, &order, file.as_fd()).expect("a good file");
        assert_eq!(engine.is_optimised(), name == NAME);
        assert!(cpu.exchange_engine(Box::new(engine)).is_ok());
        assert_eq!(cpu.engine(), name);
        run(cpu);
    };
    take_over(&fast, NAME_FAST, &mut cpu);
    take_over(&mixed, NAME_HOTTEST, &mut cpu);
    let rest = mixed.unoptimised();
    compiler(Tier::Optimised).compile(&plan, rest, &mut mixed);
    assert_eq!(mixed.file(&order), optimised.file(&order), "in the end it is the same");
    take_over(&mixed, NAME, &mut cpu);
}

/// The accounting engine, with room on the stack for machine code.
struct Room;

impl Factory for Room {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        ACCOUNTING.engine(plan)
    }

    fn stack_per_block(&self) -> usize {
        ob1_native::AtLoad(Tier::Fast).stack_per_block()
    }
}

/// A loop may begin with a call: its head, and the place where the call is made, are entries then.
#[test]
fn a_loop_that_begins_with_a_call_comes_as_a_file() {
    let text = "FUNCTION FC 1 : VOID\nBEGIN\nL MW 30;\n+ 1;\nT MW 30;\nS M 0.0;\nR M 0.0;\nCALL SFC 43;\nEND_FUNCTION\n\
        ORGANIZATION_BLOCK OB 1\nBEGIN\nL 0;\nT MW 30;\nT MW 32;\nn: UC FC 1;\nL MW 30;\nL 9;\n<I;\nSPB n;\n\
        SET;\no: CC FC 1;\nL MW 30;\nL 20;\n<I;\nSPB o;\n\
        p: CALL SFC 43;\nL MW 32;\n+ 1;\nT MW 32;\nL 5;\n<I;\nSPB p;\nEND_ORGANIZATION_BLOCK\n";
    let sources = [ob1_stl::Source::new("p.awl", text)];
    let mut library = ob1_stl::Library::new();
    for block in system_blocks() {
        library.insert(block.id(), block.name(), block.interface().clone());
    }
    let output = ob1_stl::compile(&sources, &library, &ob1_stl::Options::default());
    assert!(output.is_good(), "{:?}", output.diagnostics.first());
    for tier in [Tier::Fast, Tier::Optimised] {
        let config = CpuConfig::default();
        let mut cpu = Cpu::new(config, &output.program, system_blocks(), Vec::new(), &Room).expect("it loads");
        let order = Order { fingerprint: fingerprint(cpu.plan()), secret: [5; 16] };
        let image = Compiler::new(Target::Host, tier).expect("this processor").image(cpu.plan());
        let file = seal(memory_file().expect("memory"), &image.file(&order)).expect("memory");
        let engine = Native::of_file(cpu.plan(), &order, file.as_fd()).expect("a good file");
        assert_eq!(engine.refused(), [""; 0]);
        assert!(cpu.exchange_engine(Box::new(engine)).is_ok());
        cpu.request(Command::Run);
        cpu.cycle(&mut Still);
        assert_eq!(cpu.bit_memory()[30..34], [0, 20, 0, 5], "{tier:?}");
    }
}
