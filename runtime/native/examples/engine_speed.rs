//! How fast the engines run STL programs: `cargo run --release -p ob1-native --example engine_speed -- FILE.awl...`
//!
//! Each program's OB 1 runs again and again on the reference engine and on the native one in turns; the best round
//! counts. A time counts only if both have left the same memory. `--listing FILE.awl` shows the code of its blocks.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a measuring tool reads the clock and files")]
#![allow(clippy::print_stdout, reason = "its output")]

use ob1_cpu::engine::{Factory, REFERENCE};
use ob1_cpu::{Clock, Command, Cpu, CpuConfig, OperatingState, system_blocks};
use ob1_native::{AtLoad, Compiler, Target, Tier};
use ob1_stl::{Library, Options, Source, compile};
use ob1_time::{Instant, Span};
use rustix::time::{ClockId, clock_gettime};

/// Time that stands still, so that every engine sees the same.
struct Still(Instant);

impl Clock for Still {
    fn now(&mut self) -> Instant {
        self.0
    }
    fn executed(&mut self, _statements: u64) {}
}

const ROUNDS: usize = 7;

fn program(path: &str) -> Result<ob1_ir::Program, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{path}: {e}"))?;
    let mut library = Library::new();
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    let output = compile(&[Source { name: path.to_owned(), bytes }], &library, &Options::default());
    if output.is_good() { Ok(output.program) } else { Err(format!("{path}: {:#?}", output.diagnostics)) }
}

fn cpu(path: &str, program: &ob1_ir::Program, factory: &dyn Factory) -> Result<Cpu, String> {
    let config = CpuConfig { memory_bytes: 2048, ..CpuConfig::default() };
    let mut cpu =
        Cpu::new(config, program, system_blocks(), Vec::new(), factory).map_err(|e| format!("{path}: {e:?}"))?;
    cpu.request(Command::Warm);
    Ok(cpu)
}

fn cycle(cpu: &mut Cpu, clock: &mut Still) -> Result<(), String> {
    clock.0 += 7 * Span::MILLISECOND;
    if cpu.cycle(clock).state == OperatingState::Run {
        return Ok(());
    }
    let why: Vec<_> = cpu.diagnostics().map(ToString::to_string).collect();
    Err(format!("{why:#?}"))
}

/// Seconds of CPU time of this process.
fn cpu_time() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}

/// Statements per second of processor time, over about 60 ms.
fn round(cpu: &mut Cpu, clock: &mut Still) -> Result<f64, String> {
    let (begin, before) = (cpu_time(), cpu.statistics().statements);
    while cpu_time() - begin < 0.06 {
        for _ in 0..20 {
            cycle(cpu, clock)?;
        }
    }
    Ok((cpu.statistics().statements - before) as f64 / (cpu_time() - begin))
}

/// Statements per second of both engines.
fn measure(path: &str) -> Result<(f64, f64), String> {
    let program = program(path)?;
    let (mut one, mut other) = (cpu(path, &program, REFERENCE)?, cpu(path, &program, &AtLoad(Tier::Optimised))?);
    let (mut clock, mut other_clock) = (Still(Instant::START), Still(Instant::START));
    for scan in 0..50 {
        cycle(&mut one, &mut clock)?;
        cycle(&mut other, &mut other_clock)?;
        let same = one.bit_memory() == other.bit_memory()
            && one.statistics().statements == other.statistics().statements
            && program.data.iter().all(|db| one.data_block(db.number) == other.data_block(db.number));
        if !same {
            return Err(format!("{path}: the engines differ in scan {scan}"));
        }
    }
    let (mut reference, mut native) = (0f64, 0f64);
    for _ in 0..ROUNDS {
        reference = reference.max(round(&mut one, &mut clock)?);
        native = native.max(round(&mut other, &mut other_clock)?);
    }
    Ok((reference, native))
}

fn listing(path: &str) -> Result<(), String> {
    let program = program(path)?;
    let cpu = cpu(path, &program, REFERENCE)?;
    let compiler = Compiler::new(Target::Host, Tier::Optimised).map_err(|e| e.to_string())?;
    for block in 0..cpu.plan().blocks.len() {
        let made = compiler.listing(cpu.plan(), block as u32).map_err(|e| e.to_string())?;
        println!("{}\n{}\n{}", cpu.plan().blocks[block].id, made.form, made.code);
    }
    Ok(())
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, path] = &args[..]
        && flag == "--listing"
    {
        if let Err(why) = listing(path) {
            println!("{why}");
        }
        return;
    }
    let (mut product, mut programs) = (1.0, 0);
    for path in &args {
        match measure(path) {
            Ok((reference, native)) => {
                println!("{:7.1} M/s  {:8.1} M/s  {:5.2} x  {path}", reference / 1e6, native / 1e6, native / reference);
                product *= native / reference;
                programs += 1;
            }
            Err(why) => println!("{why}"),
        }
    }
    if programs > 0 {
        println!("{:5.2} x  geometric mean", f64::powf(product, 1.0 / f64::from(programs)));
    }
}
