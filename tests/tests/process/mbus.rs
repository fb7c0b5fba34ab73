//! M-Bus with real processes and foreign software: the program of the manual reads a meter simulated by a script, and
//! pyMeterBus decodes the answers read by our master.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

use ob1_tests::meters::{Bus, Fixture, Meter, fixtures, values};
use serde_json::Value;

use crate::common::meters::{next, reading, seen};
use crate::common::site::{Site, replaced};
use crate::common::station::Running;
use crate::common::{checkout, python};

/// The meters of `examples/mbus-meter/meter.py`.
struct Meters {
    script: Child,
    words: Option<ChildStdin>,
    said: BufReader<ChildStdout>,
}

impl Meters {
    fn start(site: &Site, meters: &[(u8, &Fixture)]) -> Self {
        let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02X}")).collect::<String>();
        let args = meters.iter().map(|(address, fixture)| format!("{address}={}", hex(&fixture.bytes)));
        let mut command = site.command(python());
        command.args(["meter.py", "mbus.pty"]).args(args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut script = command.spawn().expect("Python starts");
        let said = BufReader::new(script.stdout.take().expect("a pipe"));
        Self { words: script.stdin.take(), said, script }
    }

    /// Changes the state of the meters.
    fn tell(&mut self, word: &str) {
        writeln!(self.words.as_mut().expect("open until the end"), "{word}").expect("it reads");
        let mut line = String::new();
        self.said.read_line(&mut line).expect("it answers");
        assert_eq!(line, "ok\n");
    }

    fn end(mut self) {
        drop(self.words.take());
        assert!(self.script.wait().expect("a child").success());
    }
}

/// An order of the manual's program: baud rate, C, A, CI field, number of further bytes; returns RET_VAL, 0 if OB 1 has
/// taken 2000h.
fn order(station: &Running, bytes: [u8; 5]) -> i64 {
    for (at, byte) in (100..).zip(bytes) {
        station.set(&format!("MB{at}"), byte.into());
    }
    station.set("M99.0", 1);
    station.until("the end of the order", |s| (s.cell("M99.0") == 0).then(|| s.cell("MW106")))
}

/// The first bytes of a data block.
fn stored(station: &Running, db: u8, len: usize) -> Vec<u8> {
    let names: Vec<String> = (0..len).map(|at| format!("DB{db}.DBB{at}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    names.chunks(32).flat_map(|some| station.cells(some)).map(|byte| byte as u8).collect()
}

/// `examples/mbus-meter` with this station and program, and one meter at address 1; also returns its answer.
fn example(station: &str, program: &str) -> (Site, Running, Meters, Vec<u8>) {
    let site = Site::new();
    for file in [station, program, "meter.py"] {
        let text = fs::read_to_string(checkout("examples/mbus-meter").join(file)).expect("a file of the example");
        site.write(file, &if file == station { replaced(&text, "\"150ms\"", "\"500ms\"") } else { text });
    }
    let station = site.run(station).until_run();
    station.until("the pty", |_| site.path("mbus.pty").exists().then_some(()));
    station.until("FC 9", |s| (s.cell("M3.0") == 0).then_some(()));
    let all = fixtures();
    let meter = all.iter().find(|fixture| fixture.name.ends_with("/frame2")).expect("a fixture");
    let mut meters = Meters::start(&site, &[(1, meter)]);
    meters.tell("loud 1");
    (site, station, meters, meter.bytes.clone())
}

#[test]
fn the_manual_s_program_reads_a_meter() {
    let (site, station, mut meters, bytes) = example("station.toml", "mbus.awl");
    let expected = seen(&bytes);

    assert_eq!(order(&station, [0xBB, 0x40, 1, 0, 0]), 0, "SND_NKE");
    assert_eq!(stored(&station, 21, 2), [0, 0xE5]);
    assert_eq!(order(&station, [0xBB, 0x7B, 1, 0, 0]), 0, "REQ_UD2");
    assert_eq!(stored(&station, 21, expected.len()), expected);
    meters.tell("silent 1");
    assert_eq!(order(&station, [0xBD, 0x5B, 1, 0, 0]), 0x8001, "no answer");
    meters.tell("loud 1");
    meters.tell("check 1");
    assert_eq!(order(&station, [0xBD, 0x5B, 1, 0, 0]), 0, "a wrong check sum, then a right one");
    meters.tell("echo on");
    assert_eq!(order(&station, [0xBB, 0x7B, 1, 0, 0]), 0, "a converter that echoes");
    assert_eq!(stored(&station, 21, expected.len()), expected);
    meters.end();
    assert_eq!(station.interrupt().code(), Some(0));
    site.wait_until_empty();
}

/// The frame for these fields.
fn framed(fields: &[u8]) -> String {
    let sum = fields.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    let fields_in_hex: String = fields.iter().map(|byte| format!("{byte:02X}")).collect();
    format!("68{0:02X}{0:02X}68{fields_in_hex}{sum:02X}16", fields.len())
}

#[test]
fn py_meter_bus_decodes_what_our_master_has_read() {
    let all = fixtures();
    let meters = (1..).zip(&all).map(|(address, fixture)| Meter::new(address, &fixture.bytes)).collect();
    let mut reading = reading(Bus::new(meters));
    let read: Vec<(&str, Vec<u8>)> = all.iter().map(|fixture| (&*fixture.name, next(&mut reading))).collect();

    let script = checkout("tests/peers/meterbus_decode.py");
    let site = Site::new();
    let mut decoder = site.command(python());
    let mut decoder = decoder.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("Python starts");
    let mut frames = decoder.stdin.take().expect("a pipe");
    let mut decoded = BufReader::new(decoder.stdout.take().expect("a pipe")).lines();

    let (mut refused, mut different, mut equal) = (Vec::new(), Vec::new(), 0);
    for said in values() {
        let (_, answer) =
            read.iter().find(|(name, _)| *name == said.name).expect("a frame for each that says something");
        assert_eq!(answer[0], 0, "{}", said.name);
        writeln!(frames, "{}", framed(&answer[1..])).expect("it reads");
        let line = decoded.next().expect("it answers").expect("text");
        let found: Value = serde_json::from_str(&line).expect("JSON");
        let Some(found) = found["values"].as_array() else {
            refused.push(said.name);
            continue;
        };
        assert_eq!(found.len(), said.records.len(), "{}: {line}", said.name);
        for (found, [.., expected]) in found.iter().zip(&said.records) {
            let (Some(found), Ok(expected)) = (found.as_f64(), expected.parse::<f64>()) else { continue };
            // pyMeterBus prints six decimals.
            if (found - expected).abs() <= 5e-7 + 1e-6 * expected.abs() {
                equal += 1;
            } else {
                different.push(format!("{}: {found}, not {expected}", said.name));
            }
        }
    }
    drop(frames);
    assert!(decoder.wait().expect("a child").success());
    assert_eq!(different, Vec::<String>::new());
    // Two with a fixed data structure and one with a unit that pyMeterBus does not support.
    let unknown = ["manual_frame2", "sen_pollusonic_2", "sen_pollutherm"];
    assert_eq!(refused, unknown.map(|name| format!("test-frames/{name}")));
    assert_eq!(equal, 724, "numbers of 70 meters");
}

/// FB 250 and FB 251 as in `examples/mbus-meter/library.awl`, whose UDTs name the output of the blocks.
#[test]
fn the_library_reads_and_searches() {
    let (site, station, mut meters, _) = example("library.toml", "library.awl");

    station.set("MB11", 1);
    station.set("M10.0", 1);
    station.until("the reading", |s| (s.cell("M10.0") == 0).then_some(()));
    let head = ["MW18", "DB20.HEAD.STATUS", "DB20.HEAD.COUNT", "DB20.HEAD.ID", "DB20.HEAD.MED", "DB20.HEAD.MORE"];
    assert_eq!(station.cells(&head), [0, 0, 3, 0x1234_5678, 7, 0]);
    // 12565 l; at most 113 l/h, storage number 5; 218.37 kWh, tariff 2, subunit 1 (EN 1434-3).
    for (record, expected) in
        [(1, [0, 0, 0, 0, 2, 3, -3, 12_565]), (2, [1, 5, 0, 0, 7, 13, -3, 113]), (3, [0, 0, 2, 1, 1, 1, 1, 21_837])]
    {
        let names = ["FUNC", "STORAGE", "TARIFF", "DEVICE", "QUANTITY", "UNIT", "EXPONENT", "RAW"];
        let names = names.map(|name| format!("DB20.RECORD[{record}].{name}"));
        assert_eq!(station.cells(&names.each_ref().map(String::as_str)), expected, "record {record}");
    }
    station.set("M10.2", 1);
    station.until("the search", |s| (s.cell("M10.2") == 0).then_some(()));
    let list = ["MW22", "DB21.COUNT", "DB21.COLLISIONS", "DB21.METER[1].ID", "DB21.METER[1].MED"];
    assert_eq!(station.cells(&list), [0, 1, 0, 0x1234_5678, 7]);
    meters.tell("silent 1");
    station.set("M10.0", 1);
    station.until("the reading", |s| (s.cell("M10.0") == 0).then_some(()));
    assert_eq!(station.cells(&["MW18", "M16.0", "M16.2"]), [0x8001, 0, 1]);
    meters.end();
    assert_eq!(station.interrupt().code(), Some(0));
    site.wait_until_empty();
}
