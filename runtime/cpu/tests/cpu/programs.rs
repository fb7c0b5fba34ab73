//! Programs that are files, in the form of `ob1_ir::parse`: each runs one cycle on every engine and leaves what its
//! comments say, `; MW 10 = 1234` (hexadecimal).
#![allow(clippy::disallowed_methods, reason = "the programs are files")]

use std::path::Path;

use ob1_cpu::{Cell, Cpu, CpuConfig, Width};
use ob1_model::Area;

use crate::common::{Bench, ENGINES};

#[test]
fn every_program_leaves_what_it_says() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/programs");
    let mut looked_at = 0;
    for entry in std::fs::read_dir(folder).expect("the folder is there") {
        let path = entry.expect("a file").path();
        let text = std::fs::read_to_string(&path).expect("text");
        let program = ob1_ir::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        for (engine, factory) in ENGINES {
            let cpu = Cpu::new(CpuConfig::default(), &program, ob1_cpu::system_blocks(), Vec::new(), *factory);
            let mut bench = Bench::with(cpu.unwrap_or_else(|errors| panic!("{}: {errors:?}", path.display())));
            bench.run();
            for line in text.lines().filter_map(|line| line.strip_prefix("; M")) {
                let Some((place, value)) = line.split_once(" = ") else { continue };
                let (width, byte) = place.split_once(' ').expect("a width and a byte");
                let width = match width {
                    "B" => Width::Byte,
                    "W" => Width::Word,
                    _ => Width::DWord,
                };
                let cell = Cell::Area(Area::Memory, byte.parse::<u32>().expect("a byte") * 8);
                let expected = u32::from_str_radix(value, 16).expect("hexadecimal");
                assert_eq!(bench.cpu.read(cell, width), Ok(expected), "{} on {engine}: M{line}", path.display());
                looked_at += 1;
            }
        }
    }
    assert!(looked_at >= ENGINES.len() * 12, "{looked_at}");
}
