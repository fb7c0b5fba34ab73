//! Meters on an M-Bus in virtual time, from the meter's answer to the data block of the program, through FC 9, FC 0 and
//! FC 1.

use ob1_cpu::{Cell, Width};
use ob1_model::Area;
use ob1_tests::meters::{Bus, Fixture, Meter, Trouble, fixtures};
use ob1_tests::sim::SECOND;

use crate::common::meters::{Reading, next, reading, seen, station};

#[test]
fn every_frame_of_the_collection_arrives_unchanged() {
    let all = fixtures();
    assert_eq!(all.len(), 100);
    let meters = (1..).zip(&all).map(|(address, fixture)| Meter::new(address, &fixture.bytes)).collect();
    let mut reading = reading(Bus::new(meters));
    let (mut good, mut refused) = (0, Vec::new());
    for Fixture { name, bytes } in &all {
        let got = next(&mut reading);
        assert_eq!(got, seen(bytes), "{name}");
        if got == [1] {
            refused.push(name.as_str());
        } else {
            good += 1;
        }
    }
    let bad = ["invalid_length", "manual_frame1", "manual_frame4", "manual_frame5", "manual_frame6"];
    assert_eq!(refused, bad.map(|name| format!("unsupported-frames/{name}")), "malformed, or a master's");
    assert_eq!(good, 95);
    // Each malformed answer was requested three times, all others once.
    assert_eq!(reading.device.bus.frames, 95 + 3 * 5);
    assert_eq!(reading.log().lines().count(), 3, "start-up, RUN, the driver, and nothing else:\n{}", reading.log());
}

#[test]
fn troubles_end_with_the_response_of_the_manual() {
    let answer = &fixtures().into_iter().find(|f| f.name.ends_with("example_data_01")).expect("a fixture").bytes;
    let meter = |address, trouble| Meter::new(address, answer).with(trouble);
    let other = Meter::new(6, &fixtures()[20].bytes);
    let mut reading = reading(Bus::new(vec![
        meter(1, None),
        meter(2, Some(Trouble::Silent)),
        meter(3, Some(Trouble::Check(2))),
        meter(4, Some(Trouble::Cut(2))),
        meter(5, Some(Trouble::Check(3))),
        // Two meters at one address.
        meter(6, None),
        other,
        meter(7, None),
        meter(9, None),
    ]));
    let good = seen(answer);
    assert_eq!(next(&mut reading), good);
    assert_eq!(next(&mut reading), [1], "silent");
    assert_eq!(next(&mut reading), good, "the third attempt");
    assert_eq!(next(&mut reading), good, "the third attempt");
    assert_eq!(next(&mut reading), [1], "wrong check sums");
    assert_eq!(next(&mut reading), [1], "a collision");
    assert_eq!(next(&mut reading), good);
    reading.device.shorted = true;
    assert_eq!(next(&mut reading), [3], "short circuit: bit 1");
    reading.device.shorted = false;
    assert_eq!(next(&mut reading), good);
}

/// An unchanged FCB requests the last answer again; after SND_NKE the next request is the first. [S0 "FCB bit"]
#[test]
fn the_frame_count_bit() {
    let fixtures = fixtures();
    let [one, two] = [&fixtures[20].bytes, &fixtures[21].bytes];
    let mut bus = Bus::new(vec![Meter::new(5, one).then(two)]);
    let request = |c: u8| [0x10, c, 5, c.wrapping_add(5), 0x16];
    for (c, expected) in
        [(0x7B, one), (0x7B, one), (0x5B, two), (0x5B, two), (0x7B, one), (0x40, &vec![0xE5]), (0x5B, one)]
    {
        assert_eq!(&bus.hear(&request(c)), expected, "{c:02X}h");
    }
}

/// The program of `examples/mbus-meter`, which is the manual's: an order in MB 100 to 104, then M 99.0; RET_VAL in MW
/// 106 when it has ended.
fn order(reading: &mut Reading, bytes: [u8; 5]) -> u32 {
    let memory = |byte: u32| Cell::Area(Area::Memory, byte * 8);
    let cpu = &mut reading.station.cpu;
    for (at, byte) in (100..).zip(bytes) {
        cpu.write(memory(at), Width::Byte, byte.into()).expect("bit memory");
    }
    let start = memory(99);
    cpu.write(start, Width::Bit, 1).expect("bit memory");
    let ended = reading.until(30 * SECOND, |station| station.cpu.bit_memory()[99] & 1 == 0);
    assert!(ended, "no end of {bytes:02X?}\n{}", reading.log());
    reading.station.cpu.read(memory(106), Width::Word).expect("bit memory")
}

/// [S0 "PLC program", chapter 6]: the result of FC 100 for an answer, no answer, and a short circuit.
#[test]
fn the_manual_s_program_reads_a_meter() {
    let answer = &fixtures().into_iter().find(|f| f.name.ends_with("/frame2")).expect("a fixture").bytes;
    let mut reading = station("examples/mbus-meter/station.toml", Bus::new(vec![Meter::new(1, answer)]));
    let started = reading.until(5 * SECOND, |station| station.cpu.bit_memory()[3] & 1 == 0);
    assert!(started, "FC 9 has ended");
    let stored = |reading: &Reading| reading.station.cpu.data_block(21).expect("DB 21").to_vec();

    assert_eq!(order(&mut reading, [0xBB, 0x7B, 1, 0, 0]), 0, "OB 1 has taken 2000h");
    let expected = seen(answer);
    assert_eq!(stored(&reading)[..expected.len()], expected[..]);
    // SND_NKE: the acknowledgement, followed by the old content.
    assert_eq!(order(&mut reading, [0xBB, 0x40, 1, 0, 0]), 0);
    assert_eq!(stored(&reading)[..2], [0, 0xE5]);
    // SND_UD as a control frame: reset of the application; as a long frame: the two bytes after the CI field in DB 10.
    assert_eq!(order(&mut reading, [0xBB, 0x53, 1, 0x50, 0]), 0);
    assert_eq!(order(&mut reading, [0xBB, 0x73, 1, 0x51, 2]), 0);
    assert_eq!(reading.device.bus.meters[0].told, [vec![0x50], vec![0x51, 0, 2]]);

    assert_eq!(order(&mut reading, [0xBB, 0x7B, 1, 0, 0]), 0);
    let before = stored(&reading);
    reading.device.bus.meters[0].trouble = Some(Trouble::Silent);
    assert_eq!(order(&mut reading, [0xBB, 0x5B, 1, 0, 0]), 0x8001, "no answer");
    reading.device.shorted = true;
    assert_eq!(order(&mut reading, [0xBB, 0x5B, 1, 0, 0]), 0x80FF, "short circuit: what the program calls undefined");
    assert_eq!(stored(&reading), before, "an order that failed stores nothing");
    reading.device.shorted = false;
    reading.device.bus.meters[0].trouble = None;
    assert_eq!(order(&mut reading, [0xBB, 0x5B, 1, 0, 0]), 0);
}
