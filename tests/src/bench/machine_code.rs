//! The native engine: compile time and code size for a large program; what the change of the engine costs the scan; and
//! the execution time of a scan of 10,000 statements on both engines.

use std::hint::black_box;
use std::time::Instant;

use ob1_cpu::engine::{Factory, PLAIN, Plan, REFERENCE};
use ob1_cpu::{Command, Cpu, CpuConfig, OperatingState};
use ob1_native::{AtLoad, Compiler, Target, Tier};
use ob1_station::compiling::EngineSender;
use ob1_stl::{Library, Options, Source};
use ob1_time::Span;

use super::engines::cpu_time;
use super::peer::Failure;
use super::{Figure, bare, compile, median};

/// Statements of the compiled programs; the figures are from the first.
const SIZES: [usize; 2] = [100_000, 500_000];
/// Bytes of machine code a statement may take.
const BYTES: f64 = 60.0;
/// Rounds of the first program, alternating with plain Cranelift.
const ROUNDS: usize = 3;
/// Limit of the compiler's time relative to plain Cranelift with the same statements.
const BARE: f64 = 2.0;
/// Limit of the time ratio for five times the statements.
const LINEAR: f64 = 6.0;
/// Statements of a scan whose time is measured, and scans.
const SCAN: usize = 10_000;
const SCANS: usize = 20_000;
/// A scan of machine code beside one reading of as much memory: share of the scans, what it is, and the aim.
const SHARES: [(f64, &str, (&str, f64)); 3] = [
    (0.5, "median of a scan, 10,000 statements", ("<= 3 x", 3.0)),
    (0.99, "p99 of it", ("<= 4 x", 4.0)),
    (0.999, "p99.9 of it", ("", f64::INFINITY)),
];
/// Changes of the engine.
const CHANGES: usize = 1001;

/// One in this many blocks is hot: its statements are executed a thousand times as often as those of the others.
const HOT: usize = 100;
/// Time until these are optimised, relative to the time for all.
const FIRST: f64 = 0.1;

/// A CPU in STOP with a generated program of this many statements.
fn cpu(statements: usize, factory: &dyn Factory) -> Result<Cpu, Failure> {
    let (text, symbols) = compile::program(statements);
    let options = Options { symbols, ..Options::default() };
    let output = ob1_stl::compile(&[Source::new("generated.awl", text.into_bytes())], &Library::new(), &options);
    if !output.is_good() {
        return Err("the generated program is refused".into());
    }
    let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
    Cpu::new(config, &output.program, Vec::new(), Vec::new(), factory).map_err(|why| format!("{why:?}").into())
}

/// Checks that the CPU is in RUN: a CPU in STOP is fast.
pub(super) fn running(cpu: &Cpu) -> Result<(), Failure> {
    if cpu.state() == OperatingState::Run {
        return Ok(());
    }
    let why: Vec<String> =
        cpu.diagnostics().map(|entry| format!("{:?} {}", entry.event, entry.text.as_str())).collect();
    Err(format!("the CPU is in {:?}: {}", cpu.state(), why.join("; ")).into())
}

/// The compiler of both tiers.
///
/// # Errors
/// If the generated program is refused, or there is no code generator for this processor.
pub fn compiler() -> Result<Vec<Figure>, Failure> {
    let mut figures = Vec::new();
    let cpus = [cpu(SIZES[0], REFERENCE)?, cpu(SIZES[1], REFERENCE)?];
    for (tier, name) in [(Tier::Fast, "fast"), (Tier::Optimised, "optimised")] {
        let compiler = Compiler::new(Target::Host, tier).map_err(|error| error.to_string())?;
        let mut times = [f64::INFINITY; SIZES.len()];
        let mut bare = f64::INFINITY;
        let mut bytes = 0.0;
        for (index, cpu) in cpus.iter().enumerate() {
            let plan = cpu.plan();
            let statements: usize = plan.blocks.iter().map(|block| block.stmts.len()).sum();
            let mut image = ob1_native::Image::default();
            for _ in 0..if index == 0 { ROUNDS } else { 1 } {
                let began = cpu_time();
                image = compiler.image(plan);
                times[index] = times[index].min((cpu_time() - began) / 1e6);
                if index == 0 {
                    let began = cpu_time();
                    bare::compile(&compiler, plan)?;
                    bare = bare.min((cpu_time() - began) / 1e6);
                }
            }
            let of_each = image.len() as f64 / statements as f64;
            bytes = if index == 0 { of_each } else { bytes };
            let (compiled, all) = image.blocks();
            if compiled != all || statements < SIZES[index] {
                return Err(format!("{compiled} of {all} blocks, {statements} of {} statements", SIZES[index]).into());
            }
            println!(
                "machine code, {name} tier: {statements:>7} statements {:>8.1} ms, {of_each:.1} bytes each, \
                 {compiled} of {all} blocks",
                times[index]
            );
        }
        let growth = times[1] / times[0];
        figures.push(Figure {
            what: format!("machine code of 100,000, {name} tier").into(),
            value: times[0],
            unit: "ms",
            floor: Some(("bare Cranelift", bare)),
            aim: ("<= 2 x bare", times[0] <= BARE * bare),
        });
        figures.push(Figure {
            what: "bytes of it for a statement".into(),
            value: bytes,
            unit: "",
            floor: None,
            aim: ("<= 60", bytes <= BYTES),
        });
        figures.push(Figure {
            what: "five times the statements: times as long".into(),
            value: growth,
            unit: "x",
            floor: None,
            aim: ("< 6", growth < LINEAR),
        });
        if tier == Tier::Optimised {
            figures.push(first(&compiler, cpus[0].plan(), times[0])?);
        }
    }
    Ok(figures)
}

/// A program with one hot block in a hundred: the time until the hot ones are optimised, compared with `all`.
fn first(compiler: &Compiler, plan: &Plan, all: f64) -> Result<Figure, Failure> {
    let often = |index: usize| if index.is_multiple_of(HOT) { 1000 } else { 1 };
    let executed: Vec<u64> =
        plan.blocks.iter().enumerate().map(|(index, block)| often(index) * block.stmts.len() as u64).collect();
    let mut time = f64::INFINITY;
    for _ in 0..ROUNDS {
        let mut image = ob1_native::Image::empty(plan);
        let began = cpu_time();
        let hottest = ob1_native::hottest(plan, &executed);
        let wanted = hottest.len();
        compiler.compile(plan, hottest, &mut image);
        time = time.min((cpu_time() - began) / 1e6);
        if !(plan.blocks.len() / HOT..plan.blocks.len() / HOT * 2).contains(&wanted) || image.blocks().0 != wanted {
            return Err(format!("{wanted} blocks are hottest, {} compiled", image.blocks().0).into());
        }
    }
    Ok(Figure {
        what: "its hottest blocks, one in 100".into(),
        value: time,
        unit: "ms",
        floor: Some(("all of them", all)),
        aim: ("< a tenth", time < FIRST * all),
    })
}

/// What the change of the engine costs the scan.
///
/// # Errors
/// If the generated program is refused.
pub fn take_over() -> Result<Figure, Failure> {
    let mut cpu = cpu(1000, &AtLoad(Tier::Fast))?;
    let (mut sender, mut successors) = EngineSender::pair();
    let mut times = Vec::with_capacity(CHANGES);
    for turn in 0..CHANGES {
        let next: &dyn Factory = if turn % 2 == 0 { PLAIN } else { REFERENCE };
        let engine = next.engine(cpu.plan())?;
        sender.give(engine).map_err(|_| "the ring is full")?;
        let began = Instant::now();
        let name = successors.take_over(&mut cpu);
        times.push(began.elapsed().as_nanos() as f64);
        if name.is_none() || sender.take_back().is_none() {
            return Err("no engine has taken over".into());
        }
    }
    let value = median(&mut times);
    Ok(Figure {
        what: "another engine takes over".into(),
        value,
        unit: "ns",
        floor: None,
        aim: ("< 5000 ns", value < 5000.0),
    })
}

/// The execution time of a scan on the native engine, beside one reading of as much memory as its machine code has:
/// each statement is executed once, so a core has to fetch all of it from wherever it lies.
///
/// # Errors
/// If the generated program is refused.
pub fn scan() -> Result<Vec<Figure>, Failure> {
    let mut cpus = [cpu(SCAN, REFERENCE)?, cpu(SCAN, &AtLoad(Tier::Optimised))?];
    let compiler = Compiler::new(Target::Host, Tier::Optimised).map_err(|error| error.to_string())?;
    let code = vec![1_u64; compiler.image(cpus[1].plan()).len().div_ceil(8)];
    let mut clock = ob1_rt::MonotonicClock::start();
    for cpu in &mut cpus {
        cpu.request(Command::Run);
        cpu.cycle(&mut clock);
        running(cpu)?;
    }
    let [reference, native] = &mut cpus;
    // In turns, so that a disturbance of the machine affects all.
    let mut times = [const { Vec::new() }; 3];
    for _ in 0..SCANS {
        times[0].push(timed(|| _ = reference.cycle(&mut clock)));
        times[1].push(timed(|| _ = native.cycle(&mut clock)));
        times[2].push(timed(|| _ = black_box(code.iter().fold(0, |sum: u64, word| sum.wrapping_add(*word)))));
    }
    cpus.iter().try_for_each(running)?;
    for times in &mut times {
        times.sort_by(f64::total_cmp);
    }
    let at = |times: &[f64], share: f64| times[((times.len() - 1) as f64 * share) as usize];
    let [reference, native, fetch] = &times;
    let mut figures = Vec::new();
    for (share, what, (aim, most)) in SHARES {
        let (value, floor) = (at(native, share), at(fetch, share));
        let met = value <= most * floor;
        let floor = Some(("one reading of as much memory", floor));
        figures.push(Figure { what: what.into(), value, unit: "ns", floor, aim: (aim, met) });
    }
    figures.push(Figure {
        what: "the same on the reference engine, median".into(),
        value: at(reference, 0.5),
        unit: "ns",
        floor: Some(("on the native engine", at(native, 0.5))),
        aim: ("", true),
    });
    Ok(figures)
}

fn timed(work: impl FnOnce()) -> f64 {
    let began = Instant::now();
    work();
    began.elapsed().as_nanos() as f64
}
