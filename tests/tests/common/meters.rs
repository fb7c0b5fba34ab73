//! Meters read by the program `stations/mbus/read.awl` in virtual time: one after the other, with the answers in DB 11.

use std::path::Path;

use ob1_tests::meters::{Bus, fields};
use ob1_tests::sim::SECOND;
use ob1_tests::sim::device::Bench;
use ob1_tests::sim::meters::Meters;
use ob1_tests::sim::station::SimStation;

/// A station with meters on its line.
pub(crate) type Reading = Bench<Meters>;

/// The station in this file below `tests/` or `examples/`, with these meters.
pub(crate) fn station(file: &str, bus: Bus) -> Reading {
    let station = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file);
    Bench::build(&station, Meters::new(bus), 7).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    })
}

/// The station that reads them all.
pub(crate) fn reading(bus: Bus) -> Reading {
    station("tests/stations/mbus/station.toml", bus)
}

/// A word of a data block.
pub(crate) fn word(station: &SimStation, db: u16, byte: usize) -> usize {
    let bytes = station.cpu.data_block(db).expect("a data block of the program");
    usize::from(u16::from_be_bytes([bytes[byte], bytes[byte + 1]]))
}

/// Lets the program read the next meter; returns the content of its data block.
pub(crate) fn next(reading: &mut Reading) -> Vec<u8> {
    let before = word(&reading.station, 20, 0);
    let answered = reading.until(30 * SECOND, |station| word(station, 20, 0) > before);
    assert!(answered, "no answer to order {}\n{}", before + 1, reading.log());
    let station = &reading.station;
    station.cpu.data_block(11).expect("DB 11")[..word(station, 11, 262)].to_vec()
}

/// The bytes that the program must get for an answer.
pub(crate) fn seen(answer: &[u8]) -> Vec<u8> {
    match fields(answer) {
        // A frame of a master is not an answer.
        Some(fields) if fields.len() < 2 || fields[0] & 0x40 == 0 => [&[0][..], &fields].concat(),
        _ => vec![1],
    }
}
