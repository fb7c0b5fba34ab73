//! Thousands of changes of a running program: random blocks and layouts of data blocks. Values stay, no cycle is lost,
//! the scan allocates nothing for it, and memory does not grow.

#![expect(clippy::disallowed_types, clippy::disallowed_methods, reason = "how long a change takes is measured")]

mod common;

use std::alloc::System;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

use common::random::Random;
use common::{Bench, ENGINES, MS};
use ob1_cpu::engine::Factory;
use ob1_cpu::{Cpu, CpuConfig, Natives, OperatingState, Surroundings, lost_values, system_blocks};
use ob1_ir::{DataBlock, Program};
use ob1_model::{DataType, Layout};
use ob1_stl::{Library, Options, Source, compile};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const TYPES: &[&str] = &[
    "BOOL",
    "BOOL",
    "BYTE",
    "INT",
    "DINT",
    "REAL",
    "STRING[9]",
    "ARRAY[1..5] OF INT",
    "ARRAY[0..11] OF BOOL",
    "STRUCT\n x : BOOL;\n y : REAL;\nEND_STRUCT",
    "STRUCT\n y : REAL;\n z : INT;\n x : BOOL;\nEND_STRUCT",
];

/// Declarations of members with some of these names.
fn members(random: &mut Random) -> String {
    let mut names: Vec<char> = ('a'..='h').filter(|_| random.next(3) > 0).collect();
    // No structure is empty.
    names.push('k');
    for at in (1..names.len()).rev() {
        names.swap(at, random.next(at as u32 + 1) as usize);
    }
    let mut text = String::new();
    for name in names {
        // The same name seldom has another type.
        let usual = name as usize % TYPES.len();
        let ty = if random.next(6) == 0 { random.of(TYPES) } else { TYPES[usual] };
        let _ = writeln!(text, "  {name} : {ty};");
    }
    text
}

/// A program that counts its cycles in MW 10, whatever else is in it: data blocks, an instance, functions.
fn source(random: &mut Random) -> String {
    let mut text = String::new();
    for number in 1..=6 {
        if random.next(5) == 0 {
            continue;
        }
        let _ = write!(text, "DATA_BLOCK DB {number}\nSTRUCT\n{}END_STRUCT\nBEGIN\nEND_DATA_BLOCK\n", members(random));
    }
    let _ = write!(
        text,
        "FUNCTION_BLOCK FB 1\nVAR_INPUT\n  go : BOOL;\nEND_VAR\nVAR\n{}  runs : DINT;\nEND_VAR\nBEGIN\nL #runs;\nL L#1;\n+D;\n\
         T #runs;\nT MD 20;\nEND_FUNCTION_BLOCK\nDATA_BLOCK DB 10\nFB 1\nBEGIN\nEND_DATA_BLOCK\n",
        members(random)
    );
    let functions: Vec<u32> = (1..=4).filter(|_| random.next(3) > 0).collect();
    for number in &functions {
        let _ = write!(
            text,
            "FUNCTION FC {number} : VOID\nBEGIN\nL {};\nT MW {};\nEND_FUNCTION\n",
            random.next(30_000),
            40 + 2 * number
        );
    }
    let calls: String = functions.iter().map(|number| format!("CALL FC {number};\n")).collect();
    let _ = write!(
        text,
        "ORGANIZATION_BLOCK OB 1\nBEGIN\nL MW 10;\n+ 1;\nT MW 10;\n{calls}CALL FB 1, DB 10 (go := TRUE);\n\
         END_ORGANIZATION_BLOCK\n"
    );
    text
}

fn program(text: &str) -> Program {
    let output = compile(&[Source::new("p.awl", text)], &Library::new(), &Options::default());
    assert!(output.is_good(), "{text}\n{:#?}", output.diagnostics);
    output.program
}

/// The bits of each elementary component: `a`, `s.x`, `t[3]`; with the whole type of its declaration, which decides
/// unless it is a structure.
fn values(db: &DataBlock, bytes: &[u8]) -> BTreeMap<String, (String, Vec<bool>)> {
    let mut values = BTreeMap::new();
    for component in &db.components {
        let mut parts = Vec::new();
        Layout::components(&component.path, &component.ty, component.at, &mut parts);
        for part in parts.iter().filter(|part| !part.path.is_empty()) {
            let bits = (part.at.0..part.at.0 + Layout::bits(&part.ty))
                .map(|bit| bytes[bit as usize / 8] >> (bit % 8) & 1 == 1)
                .collect();
            let decides = if matches!(component.ty, DataType::Struct(_)) { &part.ty } else { &component.ty };
            values.insert(part.path.clone(), (format!("{decides:?}"), bits));
        }
    }
    values
}

fn changes(engine: &'static dyn Factory, count: u32, seed: u64) {
    let mut random = Random::new(seed);
    let natives = || Natives::from(system_blocks());
    let config = CpuConfig { min_cycle: MS, ..CpuConfig::default() };
    let around = Surroundings::new(&config, &natives());
    let mut now = program(&source(&mut random));
    let cpu = Cpu::new(config, &now, natives(), Vec::new(), engine).expect("it loads");
    let mut bench = Bench::with(cpu);
    bench.run();
    let (mut kept, mut noisy, mut took) = (0_u64, 0, Vec::with_capacity(count as usize));
    let mut flat = Vec::new();
    let allocated = Region::new(ALLOCATOR);
    for round in 0..count {
        for db in &now.data {
            for byte in 0..db.bytes.len() as u32 {
                // The counter of the instance counts on.
                if db.number != 10 {
                    let cell = ob1_cpu::Cell::Db(db.number, byte * 8);
                    bench.cpu.write(cell, ob1_cpu::Width::Byte, random.next(256)).expect("it is there");
                }
            }
        }
        let next = program(&source(&mut random));
        let before: BTreeMap<u16, Vec<u8>> = now
            .data
            .iter()
            .map(|db| (db.number, bench.cpu.data_block(db.number).expect("it is there").to_vec()))
            .collect();
        let (runs, cycles) = (bench.md(20), bench.mw(10));
        let stack = bench.cpu.stack_bytes();
        let mut successor = around.successor((&now, &next), Vec::new(), engine, stack).expect("it loads");
        let region = Region::new(ALLOCATOR);
        let began = Instant::now();
        let outcome = bench.cpu.succeed(&mut successor);
        let elapsed = began.elapsed();
        let change = region.change();
        took.push(elapsed);
        noisy += u32::from((change.allocations, change.reallocations, change.deallocations) != (0, 0, 0));
        assert_eq!(outcome, Ok(()));
        drop(successor);

        let lost = lost_values(&now, &next);
        for db in &next.data {
            let fresh = values(db, &db.bytes);
            let old = now.data.iter().find(|old| old.number == db.number);
            let old = old.map(|old| values(old, &before[&db.number])).unwrap_or_default();
            for (path, (ty, bits)) in values(db, bench.cpu.data_block(db.number).expect("it is there")) {
                match old.get(&path) {
                    Some((was, before)) if *was == ty => {
                        assert_eq!(&bits, before, "round {round}: DB {}.{path}", db.number);
                        kept += 1;
                    }
                    was => {
                        assert_eq!(bits, fresh[&path].1, "round {round}: DB {}.{path} is new", db.number);
                        let told = lost.iter().any(|lost| lost.starts_with(&format!("DB {}.", db.number)));
                        assert!(was.is_none() || told, "round {round}: DB {}.{path}: {lost:?}", db.number);
                    }
                }
            }
        }
        now = next;
        for _ in 0..2 {
            bench.cycle();
        }
        assert_eq!((bench.md(20), bench.mw(10)), (runs + 2, (cycles + 2) & 0xFFFF), "round {round}: each cycle ran");
        if round % (count / 4) == count / 8 {
            let change = allocated.change();
            flat.push(change.bytes_allocated as i64 - change.bytes_deallocated as i64);
        }
    }
    let figures = bench.cpu.statistics();
    assert_eq!((bench.cpu.state(), figures.overruns), (OperatingState::Run, 0));
    took.sort_unstable();
    let (middle, longest) = (took[took.len() / 2], took[took.len() - 1]);
    println!("{count} changes, {kept} values kept; a change takes {middle:?}, at most {longest:?}; memory {flat:?}");
    assert!(middle < Duration::from_micros(500), "half of a cycle is far more than it takes");
    // The counter sees the test harness's own thread, too.
    assert!(noisy * 100 < count, "{noisy} of {count} changes have allocated");
    let grown = flat.last().unwrap_or(&0) - flat.first().unwrap_or(&0);
    assert!(grown < 200_000, "memory grows: {flat:?}");
}

/// `OB1_CHANGES=10000`: so many of them.
#[test]
fn thousands_of_changes_keep_their_values() {
    let count = std::env::var("OB1_CHANGES").map_or(2_000, |text| text.parse().expect("a number"));
    changes(ENGINES[0].1, count, 1);
}

#[test]
fn machine_code_follows() {
    for (at, (name, engine)) in ENGINES.iter().enumerate().filter(|(_, (name, _))| name.starts_with("native")) {
        println!("{name}");
        changes(*engine, 200, 7 + at as u64);
    }
}
