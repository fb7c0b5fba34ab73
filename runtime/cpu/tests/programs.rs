//! Programs that are files, in the form of `ob1_ir::parse`: each runs one cycle on every engine and leaves what its
//! comments say, `; MW 10 = 1234` (hexadecimal).
#![allow(clippy::disallowed_methods, reason = "the programs are files")]

mod common;

use std::path::Path;

use common::Bench;
use ob1_cpu::{Cell, CellWidth, Cpu, CpuConfig};
use ob1_model::Area;

/// Every engine: its name, and how a CPU gets it.
const ENGINES: [(&str, NewCpu); 2] = [("reference", Cpu::new), ("plain", Cpu::new_plain)];

type NewCpu = fn(
    CpuConfig,
    &ob1_ir::Program,
    Vec<Box<dyn ob1_cpu::NativeBlock>>,
    Vec<(ob1_cpu::ModuleSlot, Box<dyn ob1_cpu::Module>)>,
) -> Result<Cpu, Vec<ob1_cpu::LoadError>>;

#[test]
fn every_program_leaves_what_it_says() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/programs");
    let mut looked_at = 0;
    for entry in std::fs::read_dir(folder).expect("the folder is there") {
        let path = entry.expect("a file").path();
        let text = std::fs::read_to_string(&path).expect("text");
        let program = ob1_ir::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        for (engine, new) in ENGINES {
            let cpu = new(CpuConfig::default(), &program, ob1_cpu::system_blocks(), Vec::new());
            let mut bench = Bench::with(cpu.unwrap_or_else(|errors| panic!("{}: {errors:?}", path.display())));
            bench.run();
            for line in text.lines().filter_map(|line| line.strip_prefix("; M")) {
                let Some((place, value)) = line.split_once(" = ") else { continue };
                let (width, byte) = place.split_once(' ').expect("a width and a byte");
                let width = match width {
                    "B" => CellWidth::Byte,
                    "W" => CellWidth::Word,
                    _ => CellWidth::DWord,
                };
                let cell = Cell::Area(Area::Memory, byte.parse::<u32>().expect("a byte") * 8);
                let expected = u32::from_str_radix(value, 16).expect("hexadecimal");
                assert_eq!(bench.cpu.read(cell, width), Ok(expected), "{} on {engine}: M{line}", path.display());
                looked_at += 1;
            }
        }
    }
    assert!(looked_at >= 2 * 12, "{looked_at}");
}
