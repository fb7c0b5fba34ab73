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
            let (program, config) = random::program(&mut random::Random(seed));
            Cpu::new(config, &program, system_blocks(), Vec::new(), REFERENCE).ok()
        })
        .collect()
}

#[test]
fn every_block_is_compiled_for_every_processor() {
    let cpus = cpus(5000, 30);
    assert!(cpus.len() > 20, "{}", cpus.len());
    for target in [Target::X86_64, Target::Aarch64] {
        for tier in [Tier::Fast, Tier::Optimised] {
            let compiler = Compiler::new(target, tier).expect("a processor Cranelift knows");
            for cpu in &cpus {
                let image = compiler.image(cpu.plan());
                let (compiled, all) = image.blocks();
                // The fast tier shares no stack between registers: its frame may be too large for the stack.
                let least = if tier == Tier::Fast { all / 2 } else { all };
                assert!((least..=all).contains(&compiled), "{target:?}, {tier:?}: {compiled} of {all}");
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
    let of_statements: u32 = made.statements.iter().sum();
    assert!((1..=made.bytes as u32).contains(&of_statements), "{of_statements} of {}", made.bytes);
}

#[test]
fn sealed_code_cannot_be_changed() {
    let fd = seal(memory_file().expect("a memory file"), &[0xC3; 100]).expect("a memory file");
    // By another way to the same file.
    let path = format!("/proc/self/fd/{}", fd.as_raw_fd());
    let denied = std::fs::OpenOptions::new().write(true).open(path).and_then(|mut file| file.write_all(&[0x90]));
    assert!(denied.is_err(), "{denied:?}");
}
