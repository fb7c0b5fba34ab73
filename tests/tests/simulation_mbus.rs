//! Meters on an M-Bus in virtual time, from the meter's answer to the data block of the program, through FC 9, FC 0 and FC 1.

use std::path::Path;

use ob1_tests::meters::{Bus, Fixture, Meter, Trouble, fields, fixtures};
use ob1_tests::sim::SECOND;
use ob1_tests::sim::meters::Reading;
use ob1_tests::sim::station::SimStation;

fn reading(bus: Bus) -> Reading {
    let station = Path::new(env!("CARGO_MANIFEST_DIR")).join("stations/mbus/station.toml");
    Reading::build(&station, bus, 7).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    })
}

fn word(station: &SimStation, db: u16, byte: usize) -> usize {
    let bytes = station.cpu.data_block(db).expect("a data block of the program");
    usize::from(u16::from_be_bytes([bytes[byte], bytes[byte + 1]]))
}

/// Lets the program read the next meter; what it has in its data block then.
fn next(reading: &mut Reading) -> Vec<u8> {
    let before = word(&reading.station, 20, 0);
    let answered = reading.until(30 * SECOND, |station| word(station, 20, 0) > before);
    assert!(answered, "no answer to order {}\n{}", before + 1, reading.log());
    let station = &reading.station;
    station.cpu.data_block(11).expect("DB 11")[..word(station, 11, 262)].to_vec()
}

/// What the program must see of an answer.
fn seen(answer: &[u8]) -> Vec<u8> {
    match fields(answer) {
        // What comes from a master is no answer.
        Some(fields) if fields.len() < 2 || fields[0] & 0x40 == 0 => [&[0][..], &fields].concat(),
        _ => vec![1],
    }
}

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
    // Each malformed one was asked for three times, all others once.
    assert_eq!(reading.bus.frames, 95 + 3 * 5);
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
    reading.shorted = true;
    assert_eq!(next(&mut reading), [3], "short circuit: bit 1");
    reading.shorted = false;
    assert_eq!(next(&mut reading), good);
}

/// An unchanging FCB asks for the last answer again; SND_NKE makes the next request the first. [S0 "FCB bit"]
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
