//! `docs/backplane.md` matches the code: offsets, sizes, names, writers, counters, and the example in Python.

// A test may read files; the product code of this crate does not.
#![allow(clippy::disallowed_methods)]

use std::fs;
use std::process::{Command, Stdio};

use ob1_backplane::layout::{FIELDS, Field, Writer};
use ob1_backplane::{Counter, IoImage, io_layout::IO_FIELDS};

fn document() -> String {
    fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/backplane.md")).unwrap()
}

/// The cells of all rows of tables whose rows have `columns` cells.
fn rows(document: &str, columns: usize) -> Vec<Vec<&str>> {
    let rows = document.lines().filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |"));
    rows.map(|row| row.split(" | ").map(str::trim).collect::<Vec<_>>()).filter(|row| row.len() == columns).collect()
}

fn writer(writer: Writer) -> &'static str {
    match writer {
        Writer::Maker => "maker",
        Writer::Cpu => "CPU",
        Writer::Cp => "CP",
        Writer::Both => "both",
        Writer::Anyone => "anyone",
    }
}

#[test]
fn the_memory_maps_are_those_of_the_code() {
    let document = document();
    let written: Vec<[&str; 4]> = rows(&document, 5)
        .iter()
        .filter(|row| row[0].starts_with("0x"))
        .map(|row| [row[0], row[1], row[2], row[3]])
        .collect();
    let fields: Vec<Field> = FIELDS.iter().chain(IO_FIELDS).copied().collect();
    let meant: Vec<[String; 4]> = fields
        .iter()
        .map(|field| {
            [
                format!("{:#06x}", field.offset),
                field.size.to_string(),
                field.name.to_string(),
                writer(field.writer).to_string(),
            ]
        })
        .collect();
    assert_eq!(written, meant);
}

#[test]
fn the_counters_are_those_of_the_code() {
    let document = document();
    let (_, counters) = document.split_once("## Counters").unwrap();
    let (counters, _) = counters.split_once("# The image").unwrap();
    let written: Vec<(String, &str)> = rows(counters, 3)
        .iter()
        .filter(|row| row[0].parse::<usize>().is_ok())
        .map(|row| (row[0].to_string(), row[1]))
        .collect();
    let meant: Vec<(String, &str)> =
        Counter::ALL.iter().enumerate().map(|(index, counter)| (index.to_string(), counter.name())).collect();
    assert_eq!(written, meant);
}

#[test]
fn the_example_in_python_works_as_printed() {
    let document = document();
    let (_, example) = document.split_once("```python\n").unwrap();
    let (example, _) = example.split_once("```").unwrap();
    let mut image = IoImage::create_shared().unwrap();
    let path = image.path().unwrap();
    for (valve, expected) in [(0, [1, 0, 0, 0]), (1, [2, 0, 0x6c, 0x00])] {
        image.write_outputs(0, &[valve]);
        image.scan_done(40 + u64::from(valve));
        let run = Command::new("python3").args(["-c", example]).env("SEGMENT", &path).stdin(Stdio::null()).output();
        let run = run.expect("this test needs python3");
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        assert_eq!(String::from_utf8_lossy(&run.stdout), format!("scan {}\n", 40 + valve));
        let mut inputs = [0xee; 4];
        image.read_inputs(0, &mut inputs);
        assert_eq!(inputs, expected);
    }
}
