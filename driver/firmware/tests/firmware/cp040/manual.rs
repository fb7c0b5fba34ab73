//! What the CP 040's manual requires of its protocols, LEDs and diagnosis.

use ob1_firmware::{CpInput, Instant, LineFault, LineInput, Span};

use super::{Bench, parameters, pattern, rtu};

const MS: Span = Span::MILLISECOND;

/// A block of 3964R as it lies on the line.
fn block(data: &[u8]) -> Vec<u8> {
    ob1_protocols::s3964::codec::block(data, true).collect()
}

/// [S3 L293]: MF at 2 Hz while the configuration is wrong.
#[test]
fn mf_flashes_at_2_hz() {
    let mut bench = Bench::new(16, &[("protocol", "ascii")]);
    let mut bytes = parameters(&[("protocol", "ascii")]);
    bytes[0] = 0x77;
    bench.step(CpInput::Parameters(&bytes));
    let mut seen = Vec::new();
    for _ in 0..6 {
        seen.push((bench.log.leds.power, bench.log.leds.error));
        bench.pass(250 * MS);
    }
    assert_eq!(seen, [(false, true), (false, false), (false, true), (false, false), (false, true), (false, false)]);
    bench.step(CpInput::Parameters(&parameters(&[("protocol", "ascii")])));
    bench.pass(1000 * MS);
    assert_eq!((bench.log.leds.power, bench.log.leds.error), (true, false));
}

#[test]
fn txd_and_rxd_show_traffic() {
    let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", "full"), ("zvz_ms", "3")]);
    assert!(!bench.log.leds.transmit && !bench.log.leds.receive);
    let mut area = vec![0x8A, 0, 0, 2, b'h', b'i'];
    area.resize(16, 0);
    bench.put(&area);
    assert!(bench.log.leds.transmit);
    bench.line(LineInput::TxDone);
    assert!(!bench.log.leds.transmit);
    bench.line(LineInput::Rx(b"x"));
    assert!(bench.log.leds.receive);
    bench.pass(1000 * MS);
    assert!(!bench.log.leds.receive);
}

/// [S3 L293]: IF tells an overflow as well.
#[test]
fn if_tells_a_full_buffer() {
    let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", "full"), ("zvz_ms", "3")]);
    bench.line(LineInput::Rx(b"one"));
    bench.pass(10 * MS);
    assert!(!bench.log.leds.error);
    bench.line(LineInput::Rx(b"two"));
    bench.pass(10 * MS);
    assert!(bench.log.leds.error, "there is one receive buffer");
}

/// [S3 L337]
#[test]
fn the_ticker_begins_anew_after_2_32_us() {
    let keys = [("protocol", "ascii"), ("duplex", "full"), ("preset", "break")];
    for (ms, ticks) in [(4_294_967, 4_294_967_000_u32), (4_294_968, 704), (2 * 4_294_968, 1408)] {
        let mut bench = Bench::new(16, &keys);
        bench.now = Instant::from_millis(ms);
        bench.line(LineInput::Fault(LineFault::Break));
        assert_eq!(bench.log.records.last().expect("a record")[16..], ticks.to_be_bytes(), "{ms} ms");
    }
}

/// [S3 L345]: XOFF 13h stops the CP, XON 11h lets it go on; neither is data.
#[test]
fn xoff_stops_a_cp_040() {
    let keys = [("protocol", "ascii"), ("duplex", "full"), ("flow", "xon-xoff"), ("zvz_ms", "20")];
    let mut bench = Bench::new(60, &keys);
    bench.line(LineInput::TxDone);
    bench.log.wire.tx.clear();
    bench.line(LineInput::Rx(&[0x13]));
    let mut area = vec![0x8A, 0, 0, 2, b'h', b'i'];
    area.resize(60, 0);
    bench.put(&area);
    bench.pass(1000 * MS);
    assert_eq!((bench.log.wire.tx.as_slice(), bench.log.inputs[0]), (&b""[..], 0x88), "stopped");
    bench.line(LineInput::Rx(&[0x11]));
    assert_eq!(bench.log.wire.tx, b"hi");
    bench.line(LineInput::TxDone);
    assert_eq!(bench.log.inputs[0], 0xA8);
    bench.put(&[0x88]);
    bench.line(LineInput::Rx(&[b'a', 0x13, b'b', 0x11]));
    bench.pass(20 * MS);
    assert_eq!(bench.fetch(), Some((0, b"ab".to_vec(), 0)));
}

/// [S3 L347]: four wires carry both directions at the same time.
#[test]
fn in_full_duplex_a_cp_hears_while_it_sends() {
    let mut bench = Bench::new(60, &[("protocol", "ascii"), ("duplex", "full"), ("zvz_ms", "3")]);
    let mut area = vec![0x8A, 0, 0, 2, b'h', b'i'];
    area.resize(60, 0);
    bench.put(&area);
    bench.line(LineInput::Rx(b"meanwhile"));
    bench.pass(10 * MS);
    assert_eq!(bench.cp.received_waiting(), 1);
    bench.line(LineInput::TxDone);
    assert_eq!(bench.log.inputs[0] >> 4, 0xA);
    bench.put(&[0x88]);
    assert_eq!(bench.fetch(), Some((0, b"meanwhile".to_vec(), 0)));
}

/// [S3 L357]: none, one or two start and end characters.
#[test]
fn telegrams_between_flags_go_both_ways() {
    for (starts, ends, line) in [
        ("1", "1", [&[0x02][..], &pattern(40), &[0x03]].concat()),
        ("2", "2", [&[0x02, 0x40][..], &pattern(40), &[0x03, 0x41]].concat()),
        ("0", "1", [&pattern(40)[..], &[0x03]].concat()),
    ] {
        let keys = [
            ("protocol", "stx-etx"),
            ("duplex", "full"),
            ("start_flags", starts),
            ("start_flag_2", "64"),
            ("end_flags", ends),
            ("end_flag_2", "65"),
        ];
        let mut bench = Bench::new(16, &keys);
        assert_eq!(bench.send(&pattern(40)), Some(Ok(())), "{starts} {ends}");
        assert_eq!(bench.log.wire.tx, line, "{starts} {ends}");
        bench.line(LineInput::Rx(&line));
        assert_eq!(bench.fetch(), Some((0, pattern(40), 0)), "{starts} {ends}");
    }
}

/// [S3 L305], [S3 L361]: STX, DLE, the block with its check character, DLE; 1024 bytes.
#[test]
fn a_telegram_of_3964r_goes_both_ways() {
    let mut bench = Bench::new(60, &[("protocol", "3964r"), ("duplex", "full")]);
    for length in [1, 250, 1024] {
        bench.log.wire.tx.clear();
        assert_eq!(bench.send(&pattern(length)), None, "the partner has not acknowledged");
        assert_eq!(bench.log.wire.tx, [0x02]);
        bench.line(LineInput::Rx(&[0x10]));
        assert_eq!(bench.log.wire.tx[1..], block(&pattern(length)));
        bench.line(LineInput::TxDone);
        assert_ne!(bench.log.inputs[0] >> 4, 0xA, "not yet");
        bench.line(LineInput::Rx(&[0x10]));
        assert_eq!(bench.log.inputs[0] >> 4, 0xA);
        bench.put(&[0x88]);
        bench.log.wire.tx.clear();
        bench.line(LineInput::Rx(&[0x02]));
        bench.line(LineInput::TxDone);
        bench.line(LineInput::Rx(&block(&pattern(length))));
        assert_eq!(bench.log.wire.tx, [0x10, 0x10]);
        bench.line(LineInput::TxDone);
        assert_eq!(bench.fetch(), Some((0, pattern(length), 0)));
    }
}

/// [S3 L361]: STX, five repetitions after QVZ, then NAK; the host is told E.
#[test]
fn a_partner_that_is_silent_gets_six_stx() {
    let mut bench = Bench::new(60, &[("protocol", "3964r"), ("duplex", "full")]);
    assert_eq!(bench.send(b"hello"), None);
    for n in 1..=6 {
        assert_eq!(bench.log.wire.tx, vec![0x02; n]);
        bench.line(LineInput::TxDone);
        bench.pass(200 * MS);
    }
    assert_eq!((bench.log.wire.tx.last(), bench.log.inputs[0]), (Some(&0x15), 0xE8));
    bench.put(&[0x88]);
    assert_eq!(bench.send(b"again"), None);
    assert_eq!(bench.log.wire.tx.last(), Some(&0x02));
}

/// [S3 L305]: "triple character time"; page 71 says "about double" [S3 L367].
#[test]
fn a_zvz_of_0_is_three_characters_for_3964r() {
    let mut bench = Bench::new(16, &[("protocol", "3964r"), ("duplex", "full"), ("zvz_ms", "0"), ("baud", "9600")]);
    bench.line(LineInput::Rx(&[0x02]));
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(b"a"));
    // 10 bits at 9600: 1.042 ms.
    bench.pass(3 * MS);
    assert_eq!(bench.log.wire.tx, [0x10]);
    bench.pass(MS / 5);
    assert_eq!(bench.log.wire.tx, [0x10, 0x15], "NAK");
}

const MASTER: [(&str, &str); 4] =
    [("protocol", "modbus-master-rtu"), ("duplex", "full"), ("baud", "38400"), ("wait_ms", "100")];

/// Hands the master a request and lets it go out.
fn ask(request: &[u8]) -> Bench {
    let mut bench = Bench::new(60, &MASTER);
    assert_eq!(bench.send(request), None);
    bench.pass(10 * MS);
    assert_eq!(bench.log.wire.tx, rtu(request));
    bench.line(LineInput::TxDone);
    bench
}

/// [S3 L397], [S3 L399]: what the master does not get it says in the receive block.
#[test]
fn a_master_tells_in_plain_text() {
    let mut wrong_check = rtu(&[5, 3, 2, 0x12, 0x34]);
    wrong_check[6] ^= 1;
    for (answer, number, text) in
        [(vec![], 1, &b" NO DATA\0"[..]), (wrong_check, 5, b" F FAULT\0"), (vec![5, 3, 2], 4, b" F INCOM\0")]
    {
        let mut bench = ask(&[5, 3, 0, 0, 0, 1]);
        if !answer.is_empty() {
            bench.line(LineInput::Rx(&answer));
        }
        bench.pass(101 * MS);
        assert_eq!(bench.log.inputs[0] >> 4, 0xE, "the order has failed");
        assert_eq!(bench.fetch(), Some((0, [b"ERROR\0", &[number][..], text].concat(), 0)));
    }
}

/// [S3 L399]: the slave's error is its answer.
#[test]
fn a_master_hands_up_an_exception() {
    let mut bench = ask(&[5, 0x10, 0, 0, 0, 1, 2, 0, 0]);
    bench.line(LineInput::Rx(&rtu(&[5, 0x90, 2])));
    bench.pass(10 * MS);
    assert_eq!(bench.log.inputs[0] >> 4, 0xA);
    assert_eq!(bench.fetch(), Some((0, vec![5, 0x90, 2], 0)));
}

/// [S3 L387]: nobody answers a broadcast, and only writing is one.
#[test]
fn a_broadcast_is_done_without_an_answer() {
    let bench = ask(&[0, 6, 0, 0, 0, 1]);
    assert_eq!((bench.log.inputs[0] >> 4, bench.cp.received_waiting()), (0xA, 0));
    let mut bench = Bench::new(60, &MASTER);
    assert!(matches!(bench.send(&[0, 3, 0, 0, 0, 1]), Some(Err(_))));
    bench.pass(1000 * MS);
    assert!(bench.log.wire.tx.is_empty());
}
