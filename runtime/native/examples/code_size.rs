//! Where the bytes of machine code go: `cargo run --release -p ob1-native --example code_size -- FILE.awl [BLOCK]`
//!
//! For each tier: how much CPU time the compiler takes, bytes for a statement of all blocks, and how many bytes the
//! statements of each kind take. With the index of a block: its machine code.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a measuring tool reads the clock and files")]
#![allow(clippy::print_stdout, reason = "its output")]

use std::collections::BTreeMap;

use ob1_cpu::engine::{Plan, REFERENCE};
use ob1_cpu::{Cpu, CpuConfig, system_blocks};
use ob1_native::{Compiler, Target, Tier};
use ob1_stl::{Library, Options, Source, compile};
use rustix::time::{ClockId, clock_gettime};

fn cpu(path: &str) -> Result<Cpu, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{path}: {e}"))?;
    let mut library = Library::new();
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    let output = compile(&[Source { name: path.to_owned(), bytes }], &library, &Options::default());
    if !output.is_good() {
        return Err(format!("{path}: {:#?}", output.diagnostics.first()));
    }
    Cpu::new(CpuConfig::default(), &output.program, system_blocks(), Vec::new(), REFERENCE)
        .map_err(|e| format!("{path}: {e:?}"))
}

/// Seconds of CPU time of this process.
fn cpu_time() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}

/// The kind of a statement: its operation without operands.
fn kind(stmt: &ob1_ir::Stmt) -> String {
    let text = format!("{:?}", stmt.op);
    text.split(['(', ' ', '{']).next().unwrap_or_default().to_owned()
}

fn kinds(compiler: &Compiler, plan: &Plan) -> Result<(), String> {
    let mut kinds: BTreeMap<String, (usize, u64)> = BTreeMap::new();
    for index in 0..plan.blocks.len() {
        let made = compiler.listing(plan, index as u32).map_err(|e| e.to_string())?;
        let mut rest = made.bytes as u64;
        for (stmt, bytes) in plan.blocks[index].stmts.iter().zip(made.statements.iter().map(|code| code.bytes)) {
            let entry = kinds.entry(kind(stmt)).or_default();
            entry.0 += 1;
            entry.1 += u64::from(bytes);
            rest -= u64::from(bytes);
        }
        let entry = kinds.entry("beside the statements, a block".into()).or_default();
        entry.0 += 1;
        entry.1 += rest;
    }
    let mut kinds: Vec<_> = kinds.into_iter().collect();
    kinds.sort_by_key(|(_, (_, bytes))| std::cmp::Reverse(*bytes));
    for (kind, (count, bytes)) in kinds {
        println!("  {bytes:>9} bytes  {count:>7} x {:>7.1}  {kind}", bytes as f64 / count as f64);
    }
    Ok(())
}

fn main() -> Result<(), String> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let path = args.first().ok_or("code_size FILE.awl [BLOCK]")?;
    let cpu = cpu(path)?;
    let plan = cpu.plan();
    let statements: usize = plan.blocks.iter().map(|block| block.stmts.len()).sum();
    for tier in [Tier::Fast, Tier::Optimised] {
        let compiler = Compiler::new(Target::Host, tier).map_err(|e| e.to_string())?;
        let began = cpu_time();
        let image = compiler.image(plan);
        let ms = (cpu_time() - began) * 1e3;
        let (made, all) = image.blocks();
        println!(
            "{tier:?}: {statements} statements, {made} of {all} blocks, {ms:.0} ms, {} bytes, {:.1} a statement",
            image.len(),
            image.len() as f64 / statements as f64
        );
        match args.get(1).and_then(|index| index.parse::<u32>().ok()) {
            None => kinds(&compiler, plan)?,
            Some(block) => {
                let made = compiler.listing(plan, block).map_err(|e| e.to_string())?;
                println!("{}\n{}", made.form, made.code);
            }
        }
    }
    Ok(())
}
