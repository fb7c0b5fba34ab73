//! A line read by an observer: characters in, text out.

use ob1_protocols::modbus::Mode;
use ob1_protocols::profibus::Diagnosis;
use ob1_protocols::trace::{Dialect, Reader, Unit, Way};
use ob1_protocols::{Instant, LineFault, MS, Span, stx_etx};
use ob1_serial::tap_record::{HEAD, Kind, Record};
use proptest::prelude::*;

const R: Dialect = Dialect::S3964 { bcc: true, rk512: false, pause: Span::from_millis(200) };
const RK: Dialect = Dialect::S3964 { bcc: true, rk512: true, pause: Span::from_millis(200) };
const RTU: Dialect = Dialect::ModbusRtu { master: true, pause: Span::from_millis(50) };

/// Reads a script: `MS > HEX` (from the CP), `MS < HEX` (to it), `MS ! parity`, `MS .` (nothing, time passes); returns
/// a line for each unit.
fn read(dialect: Dialect, script: &str) -> Vec<String> {
    let mut reader = Reader::new(dialect);
    let mut lines = Vec::new();
    let mut out = |unit: Unit<'_>| {
        let arrow = if unit.way == Way::Out { '>' } else { '<' };
        lines.push(format!("{} {arrow} {}", unit.begin.millis(), unit.meaning));
    };
    for line in script.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let mut words = line.split_whitespace();
        let now = words.next().and_then(|at| at.parse().ok()).map(Instant::from_millis).expect("a time");
        let what = words.next().expect("a direction");
        let bytes: Vec<u8> = words.filter_map(|word| u8::from_str_radix(word, 16).ok()).collect();
        match what {
            ">" => reader.characters(now, Way::Out, &bytes, &mut out),
            "<" => reader.characters(now, Way::In, &bytes, &mut out),
            "!" => reader.fault(now, LineFault::Parity, &mut out),
            "done" => reader.done(now, &mut out),
            _ => reader.silence(now, &mut out),
        }
    }
    reader.finish(&mut out);
    lines
}

#[track_caller]
fn check(dialect: Dialect, script: &str, expected: &[&str]) {
    assert_eq!(read(dialect, script), expected, "{script}");
}

#[test]
fn a_block_of_3964r_with_its_handshake() {
    // Reference 5.1: payload 02 10 03 15.
    check(
        R,
        "0 > 02\n 1 < 10\n 1 > 02 10 10 03 15 10 03 07\n 9 < 10",
        &[
            "0 > STX: connection request",
            "1 < DLE: ready to receive",
            "1 > block, 4 bytes, BCC 07",
            "9 < DLE: block received",
        ],
    );
}

#[test]
fn what_goes_wrong_with_3964r() {
    check(
        R,
        "0 < 02\n 1 > 10\n 2 < 31\n 3 < 10\n 4 < 03\n 5 < 23\n 6 > 15",
        &[
            "0 < STX: connection request",
            "1 > DLE: ready to receive",
            "2 < block, 1 byte, BCC 23 WRONG, computed 22",
            "6 > NAK: block refused",
        ],
    );
    check(
        R,
        "0 > 02\n 600 > 02\n 1200 < 15\n 1300 < 41 42\n 2000 .\n 2001 < 15",
        &[
            "0 > STX: connection request",
            "600 > STX: connection request",
            "1200 < NAK: connection refused",
            "1300 < characters without a meaning here",
            "2001 < NAK: no connection",
        ],
    );
    check(
        R,
        "0 > 02\n 0 < 02\n 1 > 10\n 2 < 31 32\n 3 > 15\n 4 < 02\n 5 > 10\n 6 < 10 41",
        &[
            "0 > STX: connection request",
            "0 < STX: connection request, conflict: both want to send",
            "1 > DLE: ready to receive",
            "2 < block broken off",
            "3 > NAK: block broken off by the receiver",
            "4 < STX: connection request",
            "5 > DLE: ready to receive",
            "6 < DLE without DLE or ETX after it",
        ],
    );
    check(
        R,
        "0 < 02\n 1 > 10\n 2 < 31\n 3 !\n 4 < 10 03 22\n 5 > 15\n 6 < 02\n 7 > 10\n 8 < 31 10 03\n 9 !\n 10 > 15",
        &[
            "0 < STX: connection request",
            "1 > DLE: ready to receive",
            "3 < parity error",
            "2 < block with an unreadable character",
            "5 > NAK: block refused",
            "6 < STX: connection request",
            "7 > DLE: ready to receive",
            "9 < parity error",
            "8 < block with an unreadable check character",
            "10 > NAK: block refused",
        ],
    );
    // A connection that was given up, and a block whose acknowledgement never came: the partner's STX is no conflict.
    check(
        R,
        "0 > 02\n 550 > 02\n 1100 > 15\n 1600 < 02\n 1601 > 10\n 2000 .\n 9000 > 02\n 9001 < 10\n \
         9002 > 31 10 03 22\n 9600 > 15\n 9700 < 02",
        &[
            "0 > STX: connection request",
            "550 > STX: connection request",
            "1100 > NAK: connection given up",
            "1600 < STX: connection request",
            "1601 > DLE: ready to receive",
            "9000 > STX: connection request",
            "9001 < DLE: ready to receive",
            "9002 > block, 1 byte, BCC 22",
            "9600 > NAK: block given up",
            "9700 < STX: connection request",
        ],
    );
    // A block that stops, and a request that is never answered: not a conflict hours later.
    check(
        R,
        "0 < 02\n 1 > 10\n 2 < 31\n 500 .\n 600 > 02\n 9000 < 02",
        &[
            "0 < STX: connection request",
            "1 > DLE: ready to receive",
            "2 < block broken off",
            "600 > STX: connection request",
            "9000 < STX: connection request",
        ],
    );
}

#[test]
fn the_headers_of_rk512() {
    let block = |payload: &[u8]| {
        let block: Vec<u8> = ob1_protocols::s3964::codec::block(payload, true).collect();
        block.iter().map(|byte| format!("{byte:02X} ")).collect::<String>()
    };
    for (payload, text) in [
        (&b"\0\0AD\x0A\x05\0\x02\xFF\xFF\x01\x02\x03\x04"[..], "SEND DB10 from word 5, 4 bytes, 4 bytes with it"),
        (b"\0\0ED\x0A\x05\0\x02\x06\x24", "FETCH DB10 from word 5, 4 bytes, flag M 6.4, CPU 2"),
        (b"\0\0EM\0\x05\0\x02\xFF\xFF", "FETCH M from 5, 2 bytes"),
        (b"\xFF\0AD\x07", "follow-on telegram of SEND, 1 byte"),
        (b"\0\0\0\0\x01\x02", "reaction, good, 2 bytes"),
        (b"\xFF\0\0\x0C", "reaction to a follow-on telegram, error 0Ch"),
        (b"\0\0QD\x0A\x05\0\x02\xFF\xFF", "telegram with a wrong command letter"),
    ] {
        let lines = read(RK, &format!("0 > 02\n 1 < 10\n 2 > {}", block(payload)));
        assert!(lines[2].ends_with(&format!("; RK512 {text}")), "{lines:?}");
    }
}

#[test]
fn telegrams_of_ascii_end_with_a_pause() {
    check(
        Dialect::Ascii { pause: 200 * MS },
        "0 < 41\n 100 < 42\n 400 < 43\n 450 > 31 32\n 460 done\n 1000 .",
        &["0 < telegram, 2 bytes", "450 > telegram, 2 bytes", "400 < telegram, 1 byte"],
    );
}

#[test]
fn telegrams_between_start_and_end_characters() {
    let dialect =
        Dialect::StxEtx { start: stx_etx::Flags::new([2, 0], 1), end: stx_etx::Flags::new([3, 0], 1), pause: 200 * MS };
    check(
        dialect,
        "0 < 02 41 42 03\n 5 < 31 32\n 500 < 02 41\n 1000 . ",
        &["0 < telegram, 2 bytes", "5 < outside a telegram", "500 < telegram without its end"],
    );
}

#[test]
fn frames_of_modbus() {
    // Reference of the Modbus specification: 01 03 00 00 00 02 C4 0B.
    check(
        RTU,
        "0 > 01 03 00 00 00 02 C4 0B\n 10 < 01 03 04\n 11 < 00 06 00 05 DA 31\n 20 < 01 83 02 C0 F1\n 30 < 01 03 99",
        &[
            "0 > slave 1, request: read output words (03h), 2 from 0",
            "10 < slave 1, answer: read output words (03h), 4 bytes",
            "20 < slave 1, answer: exception 02h, illegal address, to function 03h",
            "30 < frame too short",
        ],
    );
    let mut frame = [0; ob1_protocols::modbus::FRAME_CHARACTERS];
    let length = Mode::Ascii.encode(&[17, 6, 0, 1, 0, 3], &mut frame).expect("short");
    let text: String = frame[..length].iter().map(|byte| format!("{byte:02X} ")).collect();
    check(
        Dialect::ModbusAscii { master: false, loadable: false, pause: 1000 * MS },
        &format!("0 < {text}\n 5 < 3A 31 31 0D 0A\n 9 < 3A 31"),
        &[
            "0 < slave 17, request: write word (06h), 1 := 0003h",
            "5 < frame with a wrong LRC, or none",
            "9 < frame without its end",
        ],
    );
    check(
        Dialect::ModbusRtu { master: false, pause: 50 * MS },
        "0 < 00 05 00 07 FF 00 3C 2A\n 5 < 01 03 00\n 100 .",
        &["0 < to all slaves, request: write bit (05h), 7 := 1", "5 < frame too short"],
    );
}

/// Additional functions of the CP 341's loadable driver. [S4 "5 Function Codes"]
#[test]
fn modbus_functions_of_the_cp341_and_32_bit_registers() {
    let mut script = String::new();
    let table: [(&str, &[u8], &str); 18] = [
        (">", &[5, 7], "slave 5, request: Read Exception Status (07h)"),
        ("<", &[5, 7, 0x3E], "slave 5, answer: Read Exception Status (07h), 3Eh"),
        (">", &[5, 8, 0, 0, 0xA5, 0xC3], "slave 5, request: Diagnostics (08h), code 0, value A5C3h"),
        ("<", &[5, 8, 0, 0, 0xA5, 0xC3], "slave 5, answer: Diagnostics (08h), code 0, value A5C3h"),
        (">", &[5, 11], "slave 5, request: Get Comm Event Counter (0Bh)"),
        ("<", &[5, 11, 0xFE, 0xDC, 1, 8], "slave 5, answer: Get Comm Event Counter (0Bh), status FEDCh, 264 events"),
        (">", &[5, 12], "slave 5, request: Get Comm Event Log (0Ch)"),
        (
            "<",
            &[5, 12, 8, 0x87, 0x65, 1, 8, 2, 0x20, 1, 0x12],
            "slave 5, answer: Get Comm Event Log (0Ch), status 8765h, 264 events, 544 messages, log of 2 bytes",
        ),
        (
            ">",
            &[5, 6, 1, 0x80, 0x11, 0x22, 0x33, 0x44],
            "slave 5, request: Write Single 32-Bit Register (06h), 384 := 11223344h",
        ),
        ("<", &[5, 6, 1, 0x80, 0x11, 0x22], "slave 5, answer: Write Single Register (06h), 384 := 1122h"),
        (
            ">",
            &[5, 16, 1, 0x20, 0, 2, 8, 0x51, 0xA1, 0x52, 0xA2, 0x53, 0xA3, 0x54, 0xA4],
            "slave 5, request: Write Multiple 32-Bit Registers (10h), 2 from 288",
        ),
        ("<", &[5, 16, 1, 0x20, 0, 2], "slave 5, answer: Write Multiple 32-Bit Registers (10h), 2 from 288"),
        (">", &[5, 3, 0, 0x40, 0, 2], "slave 5, request: Read Holding Registers (03h), 2 from 64"),
        ("<", &[5, 3, 8, 1, 2, 3, 4, 5, 6, 7, 8], "slave 5, answer: Read 32-Bit Holding Registers (03h), 8 bytes"),
        (">", &[5, 3, 0, 0x40, 0, 2], "slave 5, request: Read Holding Registers (03h), 2 from 64"),
        ("<", &[5, 3, 4, 1, 2, 3, 4], "slave 5, answer: Read Holding Registers (03h), 4 bytes"),
        (">", &[5, 1, 0, 0x40, 0, 2], "slave 5, request: Read Coils (01h), 2 from 64"),
        ("<", &[5, 0x11, 0], "slave 5, answer: function 11h"),
    ];
    let mut expected = Vec::new();
    for (n, (arrow, telegram, words)) in table.iter().enumerate() {
        let mut frame = [0; ob1_protocols::modbus::FRAME_CHARACTERS];
        let length = Mode::Ascii.encode(telegram, &mut frame).expect("short");
        let text: String = frame[..length].iter().map(|byte| format!("{byte:02X} ")).collect();
        script += &format!("{n} {arrow} {text}\n");
        expected.push(format!("{n} {arrow} {words}"));
    }
    let expected: Vec<&str> = expected.iter().map(String::as_str).collect();
    check(Dialect::ModbusAscii { master: true, loadable: true, pause: 1000 * MS }, &script, &expected);
}

const MBUS: Dialect = Dialect::MBus { pause: Span::from_millis(110) };

#[test]
fn mbus_in_words() {
    check(
        MBUS,
        "0 > 10 40 05 45 16\n 20 < E5\n 30 > 10 7B FD 78 16\n 60 < 68 06 06 68 08 02 72 01 02 03 82 16\n \
         80 > 68 03 03 68 53 FE BD 0E 16\n 90 > 68 04 04 68 73 FF 50 10 D2 16\n 100 < 68 03 03 68 38 01 70 00 16\n \
         101 > 10 5A 00 5A 16\n 120 < 41 42\n 300 < 68 05 05 68 08\n 500 .",
        &[
            "0 > to 5: SND_NKE, initialise (40h)",
            "20 < acknowledged (E5h)",
            "30 > to the selected slave: REQ_UD2, request data class 2 (7Bh)",
            "60 < from 2: RSP_UD, data (08h), CI 72h, variable data, 3 bytes",
            "80 > to any slave: SND_UD, send data (53h), CI BDh, set baud rate 9600",
            "90 > to all slaves: SND_UD, send data (73h), CI 50h, reset application, 1 byte",
            "100 < frame with a wrong check sum",
            "101 > to 0: REQ_UD1, request data class 1 (5Ah)",
            "120 < no frame",
            "300 < frame without its end",
        ],
    );
}

const TCP: Dialect = Dialect::ModbusTcp { pause: Span::from_millis(1000) };

#[test]
fn modbus_tcp_in_words() {
    check(
        TCP,
        "0 > 00 01 00 00 00 06 FF 04 00 00 00 01\n 1 < 00 01 00 00\n 2 < 00 05 FF 04 02 12 34\n \
         10 > 00 02 00 00 00 06 01 06 10 08 55 AA\n 11 < 00 02 00 00 00 03 01 86 04\n 20 < 47 45 54 20\n 2000 .",
        &[
            "0 > slave 255, request: read input words (04h), 1 from 0",
            "1 < slave 255, answer: read input words (04h), 2 bytes",
            "10 > slave 1, request: write word (06h), 4104 := 55AAh",
            "11 < slave 1, answer: exception 04h, device failure, to function 06h",
            "20 < frame of Modbus TCP without its end",
        ],
    );
}

const PROFIBUS: Dialect = Dialect::Profibus { pause: Span::from_millis(50) };

#[test]
fn profibus_in_words() {
    let refuses = Diagnosis::new(&[2, 5, 0, 0xFF, 0x7F, 1]).expect("long enough");
    check(
        PROFIBUS,
        "0 > DC 02 02\n 1 > 10 08 02 49 53 16\n 2 < 10 02 08 00 0A 16\n \
         10 > 68 0D 0D 68 88 82 5D 3D 3E B8 01 14 0B 7F 01 00 AA E4 16\n 11 < E5\n \
         20 > 68 07 07 68 88 82 7D 3E 3E 51 61 B5 16\n \
         30 < 68 0B 0B 68 82 88 08 3E 3C 02 05 00 FF 7F 01 12 16\n \
         40 > 68 05 05 68 08 02 7D 01 02 8A 16\n 41 < 68 05 05 68 02 08 08 AA BB 77 16\n \
         50 < 68 05 05 68 02 08 08 AA BB 00 16",
        &[
            "0 > token from 2 to 2",
            "1 > 2 to 8, FDL status",
            "2 < 8 to 2, ok",
            "10 > 2 to 8, SRD high, Set_Prm: ident 7F01h, watchdog 200 ms, 1 byte of its own",
            "11 < short confirmation",
            "20 > 2 to 8, SRD high, Chk_Cfg, 2 bytes",
            &format!("30 < 8 to 2, data, Slave_Diag: {refuses}"),
            "40 > 2 to 8, SRD high, Data_Exchange, 2 bytes",
            "41 < 8 to 2, data, Data_Exchange, 2 bytes",
            "50 < characters that are no telegram",
        ],
    );
}

#[test]
fn records_go_there_and_back() {
    let mut bytes = Record::head(Instant::from_nanos(0x0102_0304_0506), Kind::Lost).to_vec();
    assert_eq!(bytes.len(), HEAD);
    bytes.extend(7u64.to_le_bytes());
    let record = Record::read(&bytes).expect("a record");
    assert_eq!(
        (record.time, record.kind, record.data),
        (Instant::from_nanos(0x0102_0304_0506), Kind::Lost, &7u64.to_le_bytes()[..])
    );
    assert_eq!(Record::read(&bytes[..8]), None);
    bytes[8] = 200;
    assert_eq!(Record::read(&bytes), None);
}

proptest! {
    #[test]
    fn every_character_is_told_once_whatever_comes(
        which in 0..9usize,
        steps in proptest::collection::vec((0..400u64, 0..5u8, proptest::collection::vec(prop_oneof![
            Just(2u8), Just(3), Just(0x10), Just(0x16), Just(0x68), Just(0xE5), Just(0x15), Just(b':'), Just(10), any::<u8>()], 0..30)), 0..60),
    ) {
        let dialects = [
            R,
            RK,
            RTU,
            Dialect::Ascii { pause: 100 * MS },
            Dialect::ModbusAscii { master: false, loadable: false, pause: 100 * MS },
            Dialect::EnOcean { pause: 100 * MS },
            MBUS,
            TCP,
            PROFIBUS,
            Dialect::StxEtx { start: stx_etx::Flags::new([2, 0x10], 2), end: stx_etx::Flags::new([3, 0], 1), pause: 100 * MS },
        ];
        let mut reader = Reader::new(dialects[which]);
        let (mut told, mut given) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
        let mut out = |unit: Unit<'_>| {
            told[unit.way as usize].extend_from_slice(unit.raw);
            assert!(unit.begin <= unit.end);
            assert!(!unit.meaning.to_string().is_empty());
        };
        let mut now = Instant::START;
        for (wait, what, bytes) in steps {
            now += wait * MS;
            match what {
                0 | 1 => {
                    given[0].extend_from_slice(&bytes);
                    reader.characters(now, Way::Out, &bytes, &mut out);
                }
                2 | 3 => {
                    given[1].extend_from_slice(&bytes);
                    reader.characters(now, Way::In, &bytes, &mut out);
                }
                _ => reader.fault(now, LineFault::Framing, &mut out),
            }
        }
        reader.finish(&mut out);
        prop_assert_eq!(told, given);
    }
}

#[test]
fn enocean_both_ways_at_once() {
    check(
        Dialect::EnOcean { pause: 250 * MS },
        "0 > AA A5 5A AB 58 00 00 00 00 00 00 00 00 00 03
         20 < 55 A5 5A 0B 05 70 00 00 00
         21 > A5 5A 6B 05 10 00 00 00 FF 80 00 05 30 34
         22 < 00 12 34 C8 32 C0
         40 > AA
         50 < A5 5A 0B 05 70 00 00 00 00 12 34 C8 01 00
         400 .",
        &[
            "0 > WAKE: the module is to wake up",
            "0 > RD_IDBASE",
            "21 > send RPS FF800005 AI pressed",
            "20 < outside a frame",
            "20 < received RPS 001234C8 BO pressed, repeated 2",
            "40 > WAKE: the module is to wake up",
            "50 < frame with a wrong check sum",
        ],
    );
}
