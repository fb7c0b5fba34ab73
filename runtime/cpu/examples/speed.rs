//! How fast the reference engine runs STL programs: `cargo run --release -p ob1-cpu --example speed -- FILE.awl...`
//!
//! Each program's OB 1 runs again and again for about a second, the best of five rounds counts; the last line is all
//! statements over all time.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a measuring tool reads the clock and files")]
#![allow(clippy::print_stdout, reason = "its output")]

use std::time;

use ob1_cpu::{Clock, Command, Cpu, CpuConfig, OperatingState, system_blocks};
use ob1_stl::{Library, Options, Source, compile};
use ob1_time::{Instant, Span};

struct Real(time::Instant);

impl Clock for Real {
    fn now(&mut self) -> Instant {
        Instant::START + Span::from(self.0.elapsed())
    }
    fn executed(&mut self, _statements: u64) {}
}

/// Statements per second and statements per OB 1 of the best of five rounds; an error as text.
fn measure(path: &str) -> Result<(f64, f64), String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{path}: {e}"))?;
    let mut library = Library::new();
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    let source = Source { name: path.to_owned(), bytes };
    let output = compile(&[source], &library, &Options::default());
    if !output.is_good() {
        return Err(format!("{path}: {:#?}", output.diagnostics));
    }
    let config = CpuConfig { memory_bytes: 2048, ..CpuConfig::default() };
    let mut cpu = Cpu::new(config, &output.program, system_blocks(), Vec::new(), ob1_cpu::engine::REFERENCE)
        .map_err(|e| format!("{path}: {e:?}"))?;
    let mut clock = Real(time::Instant::now());
    cpu.request(Command::Warm);
    let (mut best, mut per_scan) = (0f64, 0f64);
    for _ in 0..5 {
        let (begin, before) = (time::Instant::now(), cpu.statistics());
        while begin.elapsed().as_millis() < 200 {
            for _ in 0..20 {
                if cpu.cycle(&mut clock).state != OperatingState::Run {
                    let why: Vec<_> = cpu.diagnostics().map(ToString::to_string).collect();
                    return Err(format!("{path}: {why:#?}"));
                }
            }
        }
        let after = cpu.statistics();
        let statements = (after.statements - before.statements) as f64;
        best = best.max(statements / begin.elapsed().as_secs_f64());
        per_scan = statements / (after.scans - before.scans) as f64;
    }
    Ok((best, per_scan))
}

fn main() {
    let (mut statements, mut seconds) = (0.0, 0.0);
    for path in std::env::args().skip(1) {
        match measure(&path) {
            Ok((speed, per_scan)) => {
                println!("{:7.1} M/s  {per_scan:9.0} statements  {path}", speed / 1e6);
                statements += per_scan;
                seconds += per_scan / speed;
            }
            Err(why) => println!("{why}"),
        }
    }
    if seconds > 0.0 {
        println!("{:7.1} M/s  over all", statements / seconds / 1e6);
    }
}
