//! The EnOcean examples in virtual time with a TCM 120: the manual's program as printed, the filter for repeated
//! telegrams, the ID base, a killed CP; from the radio telegram to the output and back.

use std::path::Path;

use ob1_cpu::{Cell, Command, Width};
use ob1_line::sim::FaultRates;
use ob1_model::Area;
use ob1_protocols::MS;
use ob1_protocols::esp2::{Button, Radio, Switch, Telegram};
use ob1_tests::sim::SECOND;
use ob1_tests::sim::device::{Bench, Device};
use ob1_tests::sim::station::SimStation;
use ob1_tests::tcm120::{Eeprom, Input, Output, Tcm120, script};
use ob1_time::{Instant, Span};

const ID_BASE: u32 = 0xFF80_0080;

/// The module and the telegrams it has sent by radio.
struct Air {
    module: Tcm120,
    sent: Vec<(Instant, Radio)>,
}

impl Air {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut Vec<u8>) -> Option<Instant> {
        let mut output = Output::default();
        let due = self.module.step(now, input, &mut output);
        out.extend(output.serial);
        self.sent.extend(output.air.into_iter().map(|radio| (now, radio)));
        due
    }
}

impl Device for Air {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        self.step(now, if bytes.is_empty() { Input::Tick } else { Input::Rx(bytes) }, out)
    }
}

/// A station of the example, its program past FC 9.
fn example(file: &str) -> Bench<Air> {
    example_on(file, FaultRates::NONE)
}

/// The same on a bad line.
fn example_on(file: &str, faults: FaultRates) -> Bench<Air> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/enocean-switch").join(file);
    let air = Air { module: Tcm120::new(Eeprom::new(ID_BASE)), sent: Vec::new() };
    let mut bench = Bench::build_on(&path, air, faults, 5).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    });
    assert!(bench.until(5 * SECOND, |s| s.cpu.bit_memory()[3] & 1 == 0), "FC 9 has synchronised\n{}", bench.log());
    bench.pass(SECOND);
    bench
}

/// Executes a line of the script on the radio side; then `time` passes.
fn air(bench: &mut Bench<Air>, line: &str, time: Span) {
    let input = script::line(line).expect("understood").expect("something");
    bench.meanwhile(|air, now, out| air.step(now, input, out));
    bench.pass(time);
}

fn light(bench: &mut Bench<Air>) -> bool {
    bench.station.cpu.read(Cell::Area(Area::Output, 0), Width::Bit).expect("A 0.0") == 1
}

const MEMORY_3: Cell = Cell::Area(Area::Memory, 24);

fn set(bench: &mut Bench<Air>, cell: Cell, byte: u8) {
    bench.station.cpu.write(cell, Width::Byte, byte.into()).expect("a byte of the program");
}

/// Calls FC 101 once: its FRG is the last bit of DBB 15.
fn send(bench: &mut Bench<Air>) {
    set(bench, Cell::Db(10, 8 * 15), 0x80);
    assert!(bench.until(SECOND, |s| db(s, 10)[15] == 0), "FRG is taken back\n{}", bench.log());
    bench.pass(200 * MS);
}

/// Calls FC 102 with this telegram; returns the last telegram received afterwards.
fn command(bench: &mut Bench<Air>, telegram: &str) -> String {
    let bytes = telegram.split(' ').map(|byte| u8::from_str_radix(byte, 16).expect("a byte"));
    for (at, byte) in (0..).zip(bytes.chain(std::iter::repeat(0)).take(11)) {
        set(bench, Cell::Db(12, 8 * at), byte);
    }
    set(bench, Cell::Db(12, 8 * 14), 1);
    assert!(bench.until(SECOND, |s| db(s, 12)[14] & 1 == 0), "{telegram}\n{}", bench.log());
    assert_eq!(db(&bench.station, 12)[14] & 0x10, 0, "FEHLER_KOM: {telegram}");
    bench.pass(SECOND);
    received(bench)
}

fn received(bench: &Bench<Air>) -> String {
    let bytes = db(&bench.station, 11)[..11].try_into().expect("eleven bytes");
    Telegram::parse(&bytes).to_string()
}

fn db(station: &SimStation, number: u16) -> &[u8] {
    station.cpu.data_block(number).expect("a data block of the program")
}

/// FC 100 as printed: 5 in the upper half of data byte 3 switches on, 7 off; the switch is identified by the lower half
/// of its ID.
#[test]
fn the_manual_s_switch() {
    let mut bench = example("station.toml");
    assert!(!light(&mut bench));
    air(&mut bench, "press 00121c7a BI", 200 * MS);
    assert!(light(&mut bench), "{}", bench.log());
    assert_eq!(db(&bench.station, 11)[..11], [0x0B, 5, 0x50, 0, 0, 0, 0x00, 0x12, 0x1C, 0x7A, 0x30]);
    air(&mut bench, "release 00121c7a", 200 * MS);
    assert!(light(&mut bench), "released");
    air(&mut bench, "press 00121c7b BO", 200 * MS);
    assert!(light(&mut bench), "another switch");
    air(&mut bench, "press 00121c7a BO", 200 * MS);
    assert!(!light(&mut bench));
}

/// FC 101 as printed: "Only the last 7 bits are relevant and are ORed in the CP 240 with the ID base stored there."
/// [S1 L1640]
#[test]
fn the_manual_s_telegram() {
    let mut bench = example("station.toml");
    for round in 1..=3 {
        send(&mut bench);
        assert_eq!(bench.device.sent.len(), round);
    }
    // 02h and U-message as printed; the TCM 120 sends only type 2.
    let switch = Switch::U { buttons: 0, pressed: false };
    assert_eq!(db(&bench.station, 10)[..11], [0x6B, 5, 2, 0, 0, 0, 0, 0, 0x32, 0x67, 6]);
    let radio = Radio::Rps { switch, type_2: true, id: ID_BASE | 0x67, repeater: 6 };
    assert_eq!(bench.device.sent[0].1, radio);
    assert_eq!(bench.log().lines().count(), 3, "start-up, RUN, the driver:\n{}", bench.log());
}

/// "After a successful transfer the CPU is to be restarted or a reset via FC 9 to be executed."
/// [S1 "Modul ersetzen und IDBase übernehmen"]
#[test]
fn a_module_is_replaced() {
    let mut bench = example("station.toml");
    assert_eq!(command(&mut bench, "AB 58"), "INF_IDBASE FF800080");
    assert_eq!(command(&mut bench, "AB 18 FF 7F FF FF"), "ERR_IDRANGE");
    assert_eq!(command(&mut bench, "AB 18 FF AB CD FF"), "OK");
    assert_eq!(*bench.device.module.eeprom(), Eeprom { changes: 1, ..Eeprom::new(0xFFAB_CD80) });
    send(&mut bench);
    assert_eq!(bench.device.sent, [], "the CP ORs with the old base, which is not the module's any more");
    assert_eq!(received(&bench), "ERR_TX_IDRANGE");
    set(&mut bench, MEMORY_3, 4);
    bench.pass(20 * MS);
    assert!(bench.until(5 * SECOND, |s| s.cpu.bit_memory()[3] & 5 == 0), "RESET of FC 9\n{}", bench.log());
    bench.pass(SECOND);
    send(&mut bench);
    let ids: Vec<_> = bench.device.sent.iter().map(|(_, radio)| radio.id()).collect();
    assert_eq!(ids, [Some(0xFFAB_CDE7)]);
    // Nine changes are left. "Otherwise the new ID base is there after a CPU restart."
    for n in 1..=9 {
        assert_eq!(command(&mut bench, &format!("AB 18 FF 80 0{n} 00")), "OK");
    }
    bench.station.cpu.request(Command::Warm);
    bench.pass(SECOND);
    assert_eq!(bench.station.cpu.bit_memory()[3] & 1, 0, "FC 9 has synchronised\n{}", bench.log());
    send(&mut bench);
    assert_eq!(bench.device.sent.last().and_then(|(_, radio)| radio.id()), Some(0xFF80_0967));
    assert_eq!(command(&mut bench, "AB 18 FF 80 10 00"), "ERR");
    assert_eq!(command(&mut bench, "AB 58"), "INF_IDBASE FF800900");
}

/// Every command of the program and the answer in its data block.
#[test]
fn the_module_s_commands() {
    let mut bench = example("station.toml");
    let table = [
        ("AB 48", "INF_RX_SENSITIVITY high"),
        ("AB 08 00", "OK"),
        ("AB 48", "INF_RX_SENSITIVITY low"),
        ("AB 28 12 34", "OK"),
        ("AB 68", "INF_MODEM_STATUS on, ID 1234"),
        ("AB 2A", "OK"),
        ("AB 4B", "INF_SW_VER 1.0.1.16"),
        // A modem that does not answer within 100 ms.
        ("6B 0A 01 02 03 04 05 06 00 07", "ERR_MODEM_NOTACK"),
        ("AB 59", "ERR_SYNTAX in ORG"),
        // The last of fifteen.
        ("AB 0A", "INF_INIT \"OK\""),
    ];
    for (telegram, answer) in table {
        assert_eq!(command(&mut bench, telegram), answer, "{telegram}");
    }
    assert_eq!(command(&mut bench, "AB 09"), "INF_INIT \"OK\"", "SLEEP: no answer");
    assert!(bench.device.module.is_asleep());
    // WAKE is one byte, without a frame.
    set(&mut bench, Cell::Db(12, 8 * 13), 1);
    command(&mut bench, "AA");
    assert!(!bench.device.module.is_asleep());
    set(&mut bench, Cell::Db(12, 8 * 13), 11);
    assert_eq!(command(&mut bench, "AB 58"), "INF_IDBASE FF800080");
}

/// A button that switches on and off, received directly and through two repeaters.
#[test]
fn repeated_telegrams_do_not_toggle_the_light() {
    let mut bench = example("toggle.toml");
    let heard: [&[(&str, u64)]; 5] = [
        &[("", 0)],
        &[("", 20), (" repeat 1", 0)],
        &[("", 20), (" repeat 1", 40), (" repeat 2", 0)],
        // The original is lost; two repeaters are received, and one that repeats them.
        &[(" repeat 1", 20), (" repeat 1", 40), (" repeat 2", 0)],
        // As fast as the line permits.
        &[("", 15), (" repeat 1", 15), (" repeat 2", 15), (" repeat 2", 0)],
    ];
    let (mut presses, mut telegrams) = (0, 0);
    for _ in 0..6 {
        for copies in heard {
            for (suffix, then) in copies {
                air(&mut bench, &format!("press 00121c7a AI{suffix}"), *then * MS);
                telegrams += 1;
            }
            bench.pass(150 * MS);
            presses += 1;
            assert_eq!(light(&mut bench), presses % 2 == 1, "press {presses}\n{}", bench.log());
            air(&mut bench, "release 00121c7a", 150 * MS);
            telegrams += 1;
        }
    }
    assert_eq!((bench.station.ledger(20, 0), bench.station.ledger(20, 4)), (telegrams, presses));
}

/// A sleeping module sends nothing; the request for the ID base from a restarted CP wakes it up.
#[test]
fn a_cp_that_is_killed_wakes_the_module_up() {
    let mut bench = example("station.toml");
    bench.meanwhile(|air, now, out| air.step(now, Input::Rx(&SLEEP), out));
    assert!(bench.device.module.is_asleep());
    air(&mut bench, "press 00121c7a BI", 200 * MS);
    assert!(!light(&mut bench), "not heard");
    bench.kill_driver();
    bench.pass(3 * SECOND);
    assert!(!bench.device.module.is_asleep(), "{}", bench.log());
    air(&mut bench, "press 00121c7a BI", 200 * MS);
    assert!(light(&mut bench), "{}", bench.log());
}

/// On a bad line, and with a CP that is killed sometimes, telegrams are lost, but none is invented, doubled or out of
/// order. Only detectable faults: the 8-bit checksum misses one in 256 of the others.
#[test]
fn a_bad_line_loses_telegrams_and_nothing_else() {
    let faults =
        FaultRates { delay: 500, parity: 1000, framing: 1000, break_: 500, delay_max: 30 * MS, ..FaultRates::NONE };
    let mut bench = example_on("toggle.toml", faults);
    let (mut seen, mut got) = (bench.station.ledger(20, 0), Vec::new());
    for number in 0..1_500_u32 {
        let [high, low] = [number >> 8, number & 0xFF];
        let input =
            script::line(&format!("4bs 01020304 {high:x} {low:x} 0 8")).expect("understood").expect("something");
        bench.meanwhile(|air, now, out| air.step(now, input, out));
        if number % 400 == 399 {
            bench.kill_driver();
        }
        let end = bench.now + 40 * MS;
        while bench.now < end {
            let more = bench.until(end - bench.now, |station| station.ledger(20, 0) > seen);
            if more {
                seen += 1;
                assert_eq!(bench.station.ledger(20, 0), seen, "one in a scan");
                got.push(<[u8; 11]>::try_from(&db(&bench.station, 11)[..11]).expect("eleven bytes"));
            }
        }
    }
    let expected = |number: u32| [0x0B, 7, (number >> 8) as u8, number as u8, 0, 8, 1, 2, 3, 4, 0];
    let mut numbers = 0..1_500;
    for telegram in &got {
        assert!(
            numbers.any(|number| expected(number) == *telegram),
            "{telegram:02X?} was not sent, or not after the one before"
        );
    }
    assert!((1_200..1_480).contains(&got.len()), "{} of 1500\n{}", got.len(), bench.log());
}

const SLEEP: [u8; 14] = [0xA5, 0x5A, 0xAB, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xB4];

/// The text for the button.
#[test]
fn the_script_s_switch_is_the_manual_s() {
    let Some(Input::Radio { radio, .. }) = script::line("press 121c7a BI").expect("understood") else {
        panic!("a switch")
    };
    let button = Button { rocker: 1, o: false };
    let second = Button { rocker: 0, o: false };
    let switch = Switch::N { button, pressed: true, second, second_action: false };
    assert_eq!(radio, Radio::Rps { switch, type_2: true, id: 0x0012_1C7A, repeater: 0 });
}
