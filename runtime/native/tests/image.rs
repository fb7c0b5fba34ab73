//! What is compiled: every block of a program of all kinds of statements, for each processor; and memory for code.

#![allow(clippy::disallowed_methods, reason = "it tries to open memory for code once more")]

mod random;

use std::io::Write;
use std::os::fd::AsRawFd;

use ob1_cpu::engine::REFERENCE;
use ob1_cpu::{Cpu, system_blocks};
use ob1_native::{Compiler, Target, Tier, memory_file, seal};

/// The plans of random programs, which use every kind of statement.
fn cpus(first: u64, count: u64) -> Vec<Cpu> {
    (first..first + count)
        .filter_map(|seed| {
            let (program, config) = random::program(&mut random::Random::new(seed));
            Cpu::new(config, &program, system_blocks(), Vec::new(), REFERENCE).ok()
        })
        .collect()
}

#[test]
fn every_block_is_compiled_for_every_processor() {
    let cpus = cpus(5000, 30);
    assert!(cpus.len() > 20, "{}", cpus.len());
    // Which instructions another x86-64 has is not known here, and without those for rounding not everything is
    // compiled.
    for target in [Target::Host, Target::Aarch64] {
        for tier in [Tier::Fast, Tier::Optimised] {
            let compiler = Compiler::new(target, tier).expect("a processor Cranelift knows");
            for cpu in &cpus {
                let image = compiler.image(cpu.plan());
                let (compiled, all) = image.blocks();
                assert_eq!(compiled, all, "{target:?}, {tier:?}");
                assert!(!image.is_empty() && (1..=3 * 1024).contains(&image.stack_bytes()));
            }
        }
    }
}

#[test]
fn a_listing_shows_form_and_code() {
    let cpus = cpus(5000, 5);
    let compiler = Compiler::new(Target::Aarch64, Tier::Optimised).expect("a processor Cranelift knows");
    let made = compiler.listing(cpus[0].plan(), 0).expect("compiles");
    assert!(made.form.contains("function") && made.code.contains("ret"), "{made:?}");
    let of_statements: u32 = made.statements.iter().map(|code| code.bytes).sum();
    assert!((1..=made.bytes as u32).contains(&of_statements), "{of_statements} of {}", made.bytes);
}

/// A program of functions with parameters, local data, data blocks, timers, jumps, and an organization block that calls
/// each of them: bits, words, brackets, comparisons.
fn large(functions: usize) -> Cpu {
    use std::fmt::Write as _;
    let mut text = String::new();
    for n in 1..=functions {
        let (db, byte) = (n - n % 4 + 1, n % 200);
        if n % 4 == 0 || n == 1 {
            let _ = write!(text, "DATA_BLOCK DB {db}\nSTRUCT\n a, b : INT := 7;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n");
        }
        let _ = write!(
            text,
            "FUNCTION FC {n} : VOID\nVAR_INPUT\n on : BOOL;\n amount : INT;\nEND_VAR\nVAR_OUTPUT\n done : BOOL;\nEND_VAR\n\
             VAR_TEMP\n t : INT;\nEND_VAR\nBEGIN\nNETWORK\n U #on;\n UN M {byte}.4;\n U(;\n O E {byte}.0;\n O M {byte}.1;\n );\n \
             FP M {byte}.2;\n = #done;\n SPBN a1;\n L #amount;\n L DB{db}.b;\n +I;\n T #t;\n L #t;\n L W#16#FF;\n UW;\n \
             T MW {byte};\na1: NOP 0;\n L DB{db}.a;\n L L#5;\n >D;\n = A {byte}.3;\n U T 5;\n L S5T#2S;\n SE T 6;\n\
             END_FUNCTION\n"
        );
    }
    text.push_str("ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n");
    for n in 1..=functions {
        let _ = writeln!(text, " CALL FC {n} (on := M 0.0, amount := MW 2, done := M 1.0);");
    }
    text.push_str("END_ORGANIZATION_BLOCK\n");
    let source = ob1_stl::Source { name: "large.awl".into(), bytes: text.into_bytes() };
    let output = ob1_stl::compile(&[source], &ob1_stl::Library::new(), &ob1_stl::Options::default());
    assert!(output.is_good(), "{:?}", output.diagnostics);
    Cpu::new(ob1_cpu::CpuConfig::default(), &output.program, system_blocks(), Vec::new(), REFERENCE).expect("it loads")
}

#[test]
fn a_statement_takes_few_bytes_and_a_large_block_is_compiled() {
    let cpu = large(400);
    let statements: usize = cpu.plan().blocks.iter().map(|block| block.stmts.len()).sum();
    for tier in [Tier::Fast, Tier::Optimised] {
        let image = Compiler::new(Target::X86_64, tier).expect("a processor Cranelift knows").image(cpu.plan());
        assert_eq!(image.blocks(), (401, 401), "{tier:?}");
        assert!(image.len() <= 60 * statements, "{tier:?}: {} bytes for {statements} statements", image.len());
    }
}

#[test]
fn code_stands_with_its_statement() {
    let cpu = large(1);
    let plan = cpu.plan();
    for (target, load) in [(Target::X86_64, "mov"), (Target::Aarch64, "ldr")] {
        let compiler = Compiler::new(target, Tier::Optimised).expect("a processor Cranelift knows");
        let block = plan.blocks.iter().position(|block| block.id.number == 1 && block.stmts.len() > 3).expect("FC 1");
        let made = compiler.listing(plan, block as u32).expect("compiles");
        let told = made.statements.iter().flat_map(|code| &code.lines).chain(&made.rest);
        let mut told: Vec<_> = told.filter(|line| line.starts_with(' ')).cloned().collect();
        let mut all: Vec<_> = made.code.lines().filter(|line| line.starts_with(' ')).map(str::to_owned).collect();
        told.sort();
        all.sort();
        assert_eq!(told, all, "each instruction once");
        let of = |op: &str| {
            let place = plan.blocks[block].stmts.iter().position(|stmt| stmt.op.to_string().contains(op));
            &made.statements[place.unwrap_or_else(|| panic!("{op} is in the block"))]
        };
        for (op, part) in [("DB", load), ("T 5", load)] {
            let code = of(op);
            assert!(code.bytes > 0 && code.lines.iter().any(|line| line.contains(part)), "{op}: {code:?}");
        }
    }
}

#[test]
fn sealed_code_cannot_be_changed() {
    let fd = seal(memory_file().expect("a memory file"), &[0xC3; 100]).expect("a memory file");
    // By another way to the same file.
    let path = format!("/proc/self/fd/{}", fd.as_raw_fd());
    let denied = std::fs::OpenOptions::new().write(true).open(path).and_then(|mut file| file.write_all(&[0x90]));
    assert!(denied.is_err(), "{denied:?}");
}
