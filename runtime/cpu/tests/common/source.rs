//! Programs written as source text.

use ob1_cpu::{Cpu, CpuConfig, Module, ModuleSlot, NativeBlock, system_blocks};
use ob1_stl::{Library, Options, Source, compile};

use super::Bench;

/// The system functions, and library blocks under their own numbers.
pub fn blocks(keys: &[&str]) -> Vec<Box<dyn NativeBlock>> {
    let mut natives: Vec<Box<dyn NativeBlock>> = system_blocks();
    for key in keys {
        let block = ob1_std::standard_block(key).expect("a standard block");
        natives.push(ob1_cpu::standard_block(block.id, block));
    }
    natives
}

/// A CPU with the program of `source`, the system functions and these library blocks.
pub fn bench(source: &str, keys: &[&str]) -> Bench {
    bench_with(source, keys, CpuConfig::default(), vec![])
}

/// The same with settings and modules.
pub fn bench_with(
    source: &str,
    keys: &[&str],
    config: CpuConfig,
    modules: Vec<(ModuleSlot, Box<dyn Module>)>,
) -> Bench {
    let natives = blocks(keys);
    let mut library = Library::new();
    for block in &natives {
        library.insert(block.id(), block.name(), block.interface().clone());
    }
    let source = Source { name: "test.awl".into(), bytes: source.as_bytes().to_vec() };
    let output = compile(&[source], &library, &Options::default());
    assert!(output.is_good(), "{:#?}", output.diagnostics);
    Bench::with(Cpu::new(config, &output.program, natives, modules, super::engine()).expect("the program loads"))
}
