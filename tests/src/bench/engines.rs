//! Compares the engines with each other and with C: `cargo xtask bench stl` shows this table first.
//!
//! The six programs run on the reference engine, on the native engine, and as the same logic in C
//! (`tests/native/bench`), which `cc -O2` compiles. First a check makes sure that all three produce the same bit memory
//! and data block. Times are CPU time of this process, measured in turns; the best round counts. The C code has no
//! cycle around its OB 1: the time of a cycle with an empty OB 1, measured in the same run, is subtracted before the
//! comparison.

use std::path::Path;
use std::process::Command;

use ob1_cpu::engine::{Factory, REFERENCE};
use ob1_cpu::{Clock, Command as Wish, Cpu, CpuConfig, OperatingState, system_blocks};
use ob1_native::{AtLoad, Tier};
use ob1_stl::{Library, Options, Source};
use ob1_time::{Instant, Span};
use rustix::time::{ClockId, clock_gettime};

use crate::awlsim::{Failure, Scratch};

/// Programs and their data block.
const PROGRAMS: [(&str, Option<u16>); 6] =
    [("bits", None), ("int", None), ("real", None), ("dbind", Some(10)), ("calls", Some(1)), ("timers", None)];
/// Calls of OB 1 before memory is compared.
const CALLS: u32 = 50;
/// Calls of OB 1 in one round.
const ROUND: u32 = 2000;
const ROUNDS: usize = 7;
/// Speed of the native engine relative to the reference engine: for each program, and the geometric mean.
const EACH: f64 = 3.0;
const MEAN: f64 = 4.0;
/// Its time relative to that of the C: for each program, and the geometric mean.
const EACH_BY_C: f64 = 1.3;
const MEAN_BY_C: f64 = 1.0;

/// Time that advances by 7 ms for each OB 1 and is constant within it.
struct Steps(Instant);

impl Clock for Steps {
    fn now(&mut self) -> Instant {
        self.0
    }
    fn executed(&mut self, _statements: u64) {}
}

/// A CPU with its clock.
struct Bench {
    cpu: Cpu,
    clock: Steps,
}

impl Bench {
    fn new(program: &ob1_ir::Program, factory: &dyn Factory) -> Result<Self, Failure> {
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let cpu = Cpu::new(config, program, system_blocks(), Vec::new(), factory);
        let mut cpu = cpu.map_err(|why| format!("{why:?}"))?;
        cpu.request(Wish::Run);
        Ok(Self { cpu, clock: Steps(Instant::START) })
    }

    fn run(&mut self, calls: u32) -> Result<(), Failure> {
        for _ in 0..calls {
            self.clock.0 += 7 * Span::MILLISECOND;
            if self.cpu.cycle(&mut self.clock).state != OperatingState::Run {
                let why: Vec<_> = self.cpu.diagnostics().map(ToString::to_string).collect();
                return Err(format!("{why:#?}").into());
            }
        }
        Ok(())
    }

    /// Nanoseconds of one OB 1 including the cycle around it.
    fn round(&mut self) -> Result<f64, Failure> {
        let from = cpu_time();
        self.run(ROUND)?;
        Ok((cpu_time() - from) / f64::from(ROUND))
    }

    fn memory(&self, data: Option<u16>) -> (Vec<u8>, Vec<u8>) {
        let data = data.and_then(|number| self.cpu.data_block(number)).unwrap_or_default();
        (self.cpu.bit_memory().to_vec(), data.to_vec())
    }
}

/// Nanoseconds of CPU time of this process.
pub(super) fn cpu_time() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e9 + time.tv_nsec as f64
}

/// The output of a program in C.
struct InC {
    memory: Vec<u8>,
    data: Vec<u8>,
    ns: f64,
}

/// Compiles and runs the C version of a program.
fn in_c(name: &str, scratch: &Scratch) -> Result<InC, Failure> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("native/bench/{name}.c"));
    let program = scratch.path(name);
    let mut compiler = Command::new(std::env::var_os("CC").unwrap_or_else(|| "cc".into()));
    compiler.args(["-O2", "-fno-math-errno", "-o"]).arg(&program).arg(&source).arg("-lm");
    if !compiler.status()?.success() {
        return Err(format!("{} does not compile", source.display()).into());
    }
    let run = |calls: u32, rounds: usize| -> Result<String, Failure> {
        let output = Command::new(&program).args([calls.to_string(), rounds.to_string()]).output()?;
        Ok(String::from_utf8(output.stdout)?)
    };
    let (shown, timed) = (run(CALLS, 0)?, run(ROUND, ROUNDS)?);
    let line = |text: &str, key: &str| -> Result<String, Failure> {
        let found = text.lines().find_map(|line| line.strip_prefix(key).map(|rest| rest.trim().to_owned()));
        Ok(found.ok_or_else(|| format!("{name}.c prints no {key}"))?)
    };
    let bytes = |text: String| -> Result<Vec<u8>, Failure> {
        let pairs = (0..text.len() / 2).map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16));
        Ok(pairs.collect::<Result<_, _>>()?)
    };
    Ok(InC {
        memory: bytes(line(&shown, "M ")?)?,
        data: bytes(line(&shown, "DB ")?)?,
        ns: line(&timed, "ns ")?.parse()?,
    })
}

/// Nanoseconds of a cycle with an empty OB 1.
fn empty_cycle() -> Result<f64, Failure> {
    let bytes = b"ORGANIZATION_BLOCK OB 1\nBEGIN\nBE;\nEND_ORGANIZATION_BLOCK\n".to_vec();
    let source = Source { name: "empty.awl".into(), bytes };
    let output = ob1_stl::compile(&[source], &Library::new(), &Options::default());
    let mut bench = Bench::new(&output.program, &AtLoad(Tier::Optimised))?;
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        best = best.min(bench.round()?);
    }
    Ok(best)
}

/// Prints the table; true if memory is the same and every aim is met.
///
/// # Errors
/// If a program does not compile or run.
pub fn measure() -> Result<bool, Failure> {
    let scratch = Scratch::new("bench-engines")?;
    println!("million statements a second of CPU time, best of {ROUNDS}; memory compared first");
    let empty = empty_cycle()?;
    println!("a cycle with an empty OB 1: {empty:.0} ns, taken off the native engine before it is compared with C");
    println!(
        "{:<8} {:>10} {:>10} {:>10} {:>8} {:>10} {:>12}  aim",
        "program", "statements", "reference", "native", "x", "cc -O2", "time / C"
    );
    let (mut met, mut product, mut product_by_c) = (true, 1.0, 1.0);
    for (name, data) in PROGRAMS {
        let path = format!("blocks/stl/tests/data/bench_{name}.awl");
        let bytes = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(&path))?;
        let output = ob1_stl::compile(&[Source { name: path, bytes }], &Library::new(), &Options::default());
        if !output.is_good() {
            return Err(format!("{name}: {:#?}", output.diagnostics).into());
        }
        let mut one = Bench::new(&output.program, REFERENCE)?;
        let mut two = Bench::new(&output.program, &AtLoad(Tier::Optimised))?;
        let c = in_c(name, &scratch)?;
        one.run(CALLS)?;
        two.run(CALLS)?;
        let (memory, db) = one.memory(data);
        let same_engines = (memory.clone(), db.clone()) == two.memory(data)
            && one.cpu.statistics().statements == two.cpu.statistics().statements;
        let same_c = memory == c.memory && c.data.starts_with(&db);
        if !same_engines || !same_c {
            let who = if same_engines { "the C" } else { "the native engine" };
            println!("{name:<8} {who} leaves other memory: its time is not measured");
            met = false;
            continue;
        }
        let per_call = one.cpu.statistics().statements as f64 / f64::from(CALLS);
        let (mut reference, mut native) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..ROUNDS {
            reference = reference.min(one.round()?);
            native = native.min(two.round()?);
        }
        let (times, by_c) = (reference / native, (native - empty) / c.ns);
        let good = times >= EACH && by_c <= EACH_BY_C;
        println!(
            "{name:<8} {per_call:>10.0} {:>10.1} {:>10.1} {times:>8.2} {:>10.1} {by_c:>12.2}  >= {EACH} x, <= {EACH_BY_C} {}",
            per_call / reference * 1e3,
            per_call / native * 1e3,
            per_call / c.ns * 1e3,
            if good { "met" } else { "MISSED" }
        );
        met &= good;
        product *= times;
        product_by_c *= by_c;
    }
    let [mean, mean_by_c] = [product, product_by_c].map(|product| f64::powf(product, 1.0 / PROGRAMS.len() as f64));
    let good = mean >= MEAN && mean_by_c <= MEAN_BY_C;
    println!(
        "geometric mean {mean:.2} x the reference engine, {mean_by_c:.2} x the time of the C, >= {MEAN}, <= {MEAN_BY_C} {}",
        if good { "met" } else { "MISSED" }
    );
    Ok(met && good)
}
