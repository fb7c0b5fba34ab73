//! The M-Bus library in virtual time: `examples/mbus-meter/library.awl` reads meters into typed records, searches a
//! bus, and handles malformed answers.

use ob1_cpu::{Cell, Width};
use ob1_mbus::records::{Answer, HEADER_BYTES, Header, RECORD_BYTES};
use ob1_model::Area;
use ob1_tests::meters::{Bus, Meter, Trouble, fields, fixtures};
use ob1_tests::sim::{MS, SECOND};

use crate::common::meters::{Reading, station, word};

fn library(meters: Vec<Meter>) -> Reading {
    let mut reading = station("examples/mbus-meter/library.toml", Bus::new(meters));
    assert!(reading.until(5 * SECOND, |station| station.cpu.bit_memory()[3] & 1 == 0), "FC 9 has ended");
    reading
}

fn set(reading: &mut Reading, byte: u32, width: Width, value: u32) {
    reading.station.cpu.write(Cell::Area(Area::Memory, byte * 8), width, value).expect("bit memory");
}

/// Gives an order with bits of MB 10, waits for its end; returns STATUS.
fn order(reading: &mut Reading, bits: u8, status_at: usize) -> u16 {
    set(reading, 10, Width::Byte, bits.into());
    let ended = reading.until(600 * SECOND, |station| station.cpu.bit_memory()[10] & 5 == 0);
    assert!(ended, "no end\n{}", reading.log());
    // The block sees the end of REQ in the scan that follows.
    assert!(reading.until(SECOND, |_| true));
    let memory = reading.station.cpu.bit_memory();
    u16::from_be_bytes([memory[status_at], memory[status_at + 1]])
}

/// Reads the meter with this primary address; returns STATUS.
fn read(reading: &mut Reading, address: u8) -> u16 {
    set(reading, 11, Width::Byte, address.into());
    order(reading, 1, 18)
}

fn block(reading: &Reading, db: u16, len: usize) -> Vec<u8> {
    reading.station.cpu.data_block(db).expect("a data block of the program")[..len].to_vec()
}

/// The expected content of the data block.
fn expected(fields: &[u8]) -> (u16, Vec<u8>) {
    let (mut status, mut code, mut more, mut header) = (0, 0, false, Header::default());
    let mut records = Vec::new();
    match Answer::parse(fields) {
        Ok(answer) => {
            header = answer.header;
            let mut all = answer.records();
            for record in &mut all {
                match record {
                    Ok(record) => records.push(record.to_bytes(1)),
                    Err(_) => status = 0x8108,
                }
            }
            more = all.more_follow();
        }
        Err(ob1_mbus::records::Fault::Application(number)) => (status, code) = (0x8107, number),
        Err(ob1_mbus::records::Fault::UnknownCi(_)) => status = 0x8106,
        Err(ob1_mbus::records::Fault::NoData) => status = 0x8105,
        Err(_) => status = 0x8108,
    }
    let head = header.to_bytes(status, records.len() as u16, more, code);
    (status, head.into_iter().chain(records.into_iter().flatten()).collect())
}

#[test]
fn every_meter_of_the_collection_as_records() {
    let all = fixtures();
    let meters = (1..).zip(&all).map(|(address, fixture)| Meter::new(address, &fixture.bytes)).collect();
    let mut reading = library(meters);
    let (mut done, mut malformed, mut silent) = (0, 0, 0);
    for (address, fixture) in (1..).zip(&all) {
        let status = read(&mut reading, address);
        let answered = fields(&fixture.bytes).filter(|fields| fields.len() > 1 && fields[0] & 0x40 == 0);
        let (wanted, bytes) = answered.map_or((0x8001, Vec::new()), |fields| expected(&fields));
        assert_eq!(status, wanted, "{}", fixture.name);
        assert!(
            bytes.len() <= HEADER_BYTES + 64 * RECORD_BYTES,
            "{}: the example's data block is too small",
            fixture.name
        );
        assert_eq!(block(&reading, 20, bytes.len()), bytes, "{}", fixture.name);
        match status {
            0 => done += 1,
            0x8001 => silent += 1,
            _ => malformed += 1,
        }
    }
    assert_eq!((done, malformed, silent), (74, 21, 5));
    assert_eq!(reading.log().lines().count(), 3, "start-up, RUN, the driver, and nothing else:\n{}", reading.log());
}

/// 1389817 kWh and 504647 m3, as read from the records by the program.
#[test]
fn the_values_that_the_plant_wants() {
    let answer = frame("test-frames/example_data_01");
    let mut reading = library(vec![Meter::new(1, &answer)]);
    assert_eq!(read(&mut reading, 1), 0);
    let values = block(&reading, 30, 10);
    let real = |at: usize| f32::from_be_bytes([values[at], values[at + 1], values[at + 2], values[at + 3]]);
    assert_eq!((real(0), real(4), values[8]), (1_389_817.0, 504_647.0, 3));
    // The same answer by FC 250, into a data block with room for three records.
    set(&mut reading, 10, Width::Byte, 8);
    assert!(reading.until(SECOND, |station| station.cpu.bit_memory()[10] == 0));
    let memory = reading.station.cpu.bit_memory();
    assert_eq!(memory[36..40], [0, 3, 0x81, 0x0A], "three records, then the data block is full");
    assert_eq!(block(&reading, 22, 144)[HEADER_BYTES..], block(&reading, 20, 144)[HEADER_BYTES..]);
}

fn frame(name: &str) -> Vec<u8> {
    fixtures().into_iter().find(|fixture| fixture.name == name).expect("a fixture").bytes
}

/// A meter with this identification and number of litres.
fn meter_of(address: u8, id: u32, litres: u32) -> Meter {
    let ([i0, i1, i2, i3], [v0, v1, v2, v3]) = (id.to_le_bytes(), litres.to_le_bytes());
    let fields = [8, address, 0x72, i0, i1, i2, i3, 0x77, 0x04, 0x14, 0x07, 1, 0, 0, 0, 0x0C, 0x13, v0, v1, v2, v3];
    let sum = fields.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    let length = fields.len() as u8;
    let frame = [&[0x68, length, length, 0x68], &fields[..], &[sum, 0x16]].concat();
    Meter::new(address, &frame)
}

fn meter(address: u8, id: u32) -> Meter {
    // Values whose bits differ clearly, so that overlapping answers are detected.
    meter_of(address, id, id.wrapping_mul(0x9E37_79B1))
}

#[test]
fn by_the_secondary_address() {
    let mut reading = library(vec![meter(0, 0x1234_5678), meter(0, 0x1234_5679), meter(0, 0x8765_4321)]);
    let mut select = |id: u32| {
        set(&mut reading, 12, Width::DWord, id);
        let status = read(&mut reading, 253);
        (status, word(&reading.station, 20, 4) << 16 | word(&reading.station, 20, 6))
    };
    assert_eq!(select(0x1234_5679), (0, 0x1234_5679));
    assert_eq!(select(0x1234_5678), (0, 0x1234_5678));
    assert_eq!(select(0x8FFF_FFFF), (0, 0x8765_4321), "Fh is any digit");
    assert_eq!(select(0x1111_1111).0, 0x8104, "nobody");
    assert_eq!(select(0x1FFF_FFFF).0, 0x8001, "two at once: their answers are none");
    assert_eq!(select(0x8765_4321), (0, 0x8765_4321), "and that harms nobody");
}

#[test]
fn a_meter_with_two_telegrams() {
    let first = frame("test-frames/svm_f22_telegram1");
    let second = frame("unsupported-frames/svm_f22_telegram2");
    let mut reading = library(vec![Meter::new(1, &first).then(&second), meter(2, 0x22)]);
    let more = |reading: &Reading| reading.station.cpu.bit_memory()[16] & 8 != 0;
    assert_eq!(order(&mut reading, 3, 18), 0x810C, "nothing was read yet");
    assert_eq!(read(&mut reading, 1), 0);
    assert!(more(&reading));
    assert_eq!(order(&mut reading, 3, 18), 0);
    let (_, bytes) = expected(&fields(&second).expect("a frame"));
    assert_eq!(block(&reading, 20, bytes.len()), bytes);
    // Read again: SND_NKE makes it the first again.
    assert_eq!(read(&mut reading, 1), 0);
    let (_, bytes) = expected(&fields(&first).expect("a frame"));
    assert_eq!(block(&reading, 20, bytes.len()), bytes);
    assert_eq!(read(&mut reading, 2), 0);
    assert!(!more(&reading));
}

#[test]
fn troubles() {
    let mut reading = library(vec![meter(1, 0x11), meter(2, 0x22)]);
    assert_eq!(read(&mut reading, 9), 0x8001, "nobody there");
    reading.device.bus.meters[0].trouble = Some(Trouble::Silent);
    assert_eq!(read(&mut reading, 1), 0x8001);
    reading.device.shorted = true;
    assert_eq!(read(&mut reading, 2), 0x8003, "short circuit");
    assert_eq!(order(&mut reading, 4, 22), 0x8003, "the search ends");
    reading.device.shorted = false;
    assert_eq!(read(&mut reading, 2), 0);
    // None of our meters answers a data request with the single character. Address 255 is not answered by any meter.
    assert_eq!(read(&mut reading, 255), 0x8001);
}

#[test]
fn the_search_finds_all_meters() {
    let ids = [0x0000_0001, 0x1234_5678, 0x1234_5679, 0x1334_5678, 0x9999_9998, 0x9999_9999];
    let mut reading = library(ids.map(|id| meter(0, id)).to_vec());
    assert_eq!(order(&mut reading, 4, 22), 0);
    let list = block(&reading, 21, 4 + 8 * ids.len());
    assert_eq!(list[..4], [0, ids.len() as u8, 0, 0], "six meters, no collision left");
    let found = ids
        .iter()
        .zip(list[4..].chunks(8))
        .all(|(id, entry)| entry[..4] == id.to_be_bytes() && entry[4..] == [4, 0x77, 0x14, 7]);
    assert!(found, "{list:02X?}");
    assert_eq!(reading.log().lines().count(), 3, "{}", reading.log());
}

/// The search cannot distinguish two meters with the same identification; it reports this and continues.
#[test]
fn twins() {
    let twins = [0x5A, 0xA5].map(|litres| meter_of(0, 0x1234_5678, litres));
    let mut reading = library(twins.into_iter().chain([meter(0, 0x2000_0000)]).collect());
    assert_eq!(order(&mut reading, 4, 22), 0);
    assert_eq!(block(&reading, 21, 8), [0, 1, 0, 1, 0x20, 0, 0, 0]);
}

/// The driver is killed at every time of a reading. The order ends with an error or with the correct records, never
/// with wrong ones, and the next order works.
#[test]
fn the_driver_is_killed_in_the_middle() {
    let answer = frame("test-frames/example_data_01");
    let (_, good) = expected(&fields(&answer).expect("a frame"));
    let mut reading = library(vec![Meter::new(1, &answer)]);
    let mut ends = std::collections::BTreeMap::new();
    for moment in 0..60 {
        set(&mut reading, 11, Width::Byte, 1);
        set(&mut reading, 10, Width::Byte, 1);
        // The reading takes about 540 ms.
        let kill_at = reading.now + moment * 10 * MS;
        reading.until(kill_at - reading.now, |_| false);
        reading.kill_driver();
        let ended = reading.until(100 * SECOND, |station| station.cpu.bit_memory()[10] & 1 == 0);
        assert!(ended, "killed after {moment} x 10 ms: no end\n{}", reading.log());
        let status = word(&reading.station, 20, 0);
        let memory = reading.station.cpu.bit_memory();
        let of_the_block = u16::from_be_bytes([memory[18], memory[19]]);
        if of_the_block == 0 {
            assert_eq!((status, block(&reading, 20, good.len())), (0, good.clone()), "killed after {moment} x 10 ms");
        }
        *ends.entry(of_the_block).or_insert(0) += 1;
        assert!(reading.until(SECOND, |_| true));
        // FC 9 sees the new driver and sets ANL itself; then the blocks work again.
        assert!(reading.until(10 * SECOND, |station| station.cpu.bit_memory()[3] & 1 == 0), "{}", reading.log());
        assert_eq!(read(&mut reading, 1), 0, "after {moment} x 10 ms\n{}", reading.log());
    }
    assert!(ends.keys().all(|status| [0, 0x8101, 0x8103].contains(status)), "{ends:X?}");
    assert!(ends.contains_key(&0x8101), "some were in the middle: {ends:X?}");
}
