//! Sending and receiving over the registers, line events in between, failures.

use ob1_firmware::{Counter, CpInput, LineFault, LineInput};

use crate::common::{Bench, MS, ascii, s3964r};

fn text(length: usize) -> Vec<u8> {
    (0..length).map(|i| (i % 251) as u8).collect()
}

#[test]
fn the_manuals_example_send() {
    // [S0 "Example SEND data"]: 30, 18, 6, 0.
    let mut bench = Bench::working(&ascii(1));
    let telegram = text(30);
    bench.put_tx(30, &telegram[..12]);
    bench.put_tx(18, &telegram[12..24]);
    bench.put_tx(6, &telegram[24..]);
    assert!(bench.log.wire.tx.is_empty(), "nothing leaves before the telegram is complete");
    assert_eq!(bench.log.shown, [(0, 30), (0, 18), (0, 6)]);
    bench.put_tx(0, &[]);
    assert_eq!(bench.log.wire.tx, telegram);
    assert!(bench.log.leds.transmit);
    bench.pass(1_000 * MS);
    assert_eq!(bench.tx_echo(), 6, "until the last bit is out");
    bench.line(LineInput::TxDone);
    assert_eq!(bench.log.shown, [(0, 30), (0, 18), (0, 6), (0, 0)]);
    assert!(!bench.log.leds.transmit);
    assert_eq!(bench.count(Counter::TelegramsSent), 1);
}

#[test]
fn the_manuals_example_receive() {
    // [S0 "Example RECEIVE data"]: 18, 6, 0.
    let mut bench = Bench::working(&ascii(1));
    let telegram = text(18);
    bench.line(LineInput::Rx(&telegram));
    bench.pass(40 * MS);
    assert_eq!(bench.log.inputs[..4], [0, 18, 0, 0]);
    assert_eq!(bench.log.inputs[4..], telegram[..12]);
    bench.put_rx(18);
    assert_eq!(bench.log.inputs, *b"\x00\x06\x00\x00\x0c\x0d\x0e\x0f\x10\x11\x00\x00\x00\x00\x00\x00");
    assert_eq!(bench.count(Counter::TelegramsDelivered), 0);
    bench.put_rx(6);
    assert_eq!(bench.log.shown, [(18, 0), (6, 0), (0, 0)]);
    assert_eq!(bench.count(Counter::TelegramsDelivered), 1);
    bench.put_rx(0);
    assert_eq!(bench.rx(), 0);
}

#[test]
fn both_directions_at_once() {
    let mut bench = Bench::working(&ascii(5));
    bench.line(LineInput::Rx(b"in"));
    bench.pass(40 * MS);
    bench.hand_over(b"out");
    assert_eq!(bench.fetch(), b"in");
    assert_eq!(bench.log.wire.tx, b"out");
    bench.line(LineInput::TxDone);
    assert_eq!((bench.rx(), bench.tx_echo()), (0, 0));
}

#[test]
fn a_first_count_is_left_waiting_while_the_cp_transmits() {
    let mut bench = Bench::working(&ascii(1));
    bench.hand_over(b"one");
    bench.put_tx(4, b"next");
    assert_eq!(bench.tx_echo(), 3);
    bench.log.shown.clear();
    bench.line(LineInput::TxDone);
    assert_eq!(bench.log.shown, [(0, 0), (0, 4)], "the end is shown first, then the count that waited");
    bench.put_tx(0, &[]);
    assert_eq!(bench.log.wire.tx, b"onenext");
}

#[test]
fn a_cpu_in_stop_leaves_no_half_telegram() {
    for stop in [true, false] {
        let mut bench = Bench::working(&ascii(1));
        bench.put_tx(30, &[1; 12]);
        if stop {
            bench.step(CpInput::CpuRun(false));
        } else {
            bench.put_tx(0, &[]);
        }
        assert_eq!(bench.tx_echo(), 0);
        bench.put_tx(0, &[]);
        bench.pass(1_000 * MS);
        assert!(bench.log.wire.tx.is_empty());
        bench.hand_over(b"x");
        assert_eq!(bench.log.wire.tx, b"x");
    }
}

#[test]
fn too_long_is_17h() {
    let mut bench = Bench::working(&ascii(1));
    bench.put_tx(1025, &[0; 12]);
    assert_eq!(bench.tx_echo(), 0x2017);
    bench.put_tx(0x2000, &[]);
    assert_eq!(bench.tx_echo(), 0);
    bench.put_tx(0, &[]);
    bench.hand_over(&text(1024));
    assert_eq!(bench.log.wire.tx, text(1024));
}

#[test]
fn a_partner_that_does_not_answer_is_07h() {
    let mut bench = Bench::working(&s3964r(false));
    bench.hand_over(b"hello");
    // The line reports the end of each output at once; six STX, 500 ms apart, then NAK.
    for _ in 0..6 {
        bench.line(LineInput::TxDone);
        bench.pass(500 * MS);
    }
    assert_eq!(bench.log.wire.tx, [2, 2, 2, 2, 2, 2, 0x15]);
    assert_eq!(bench.tx_echo(), 0x2007);
    assert_eq!((bench.count(Counter::SendErrors), bench.count(Counter::TelegramsSent)), (1, 0));
    bench.put_tx(0x2000, &[]);
    bench.put_tx(0, &[]);
    bench.hand_over(b"again");
    assert_eq!(bench.log.wire.tx.last(), Some(&2));
}

#[test]
fn nothing_is_done_on_a_line_that_is_gone() {
    // ASCII has no acknowledgement: only the CP knows that the order failed.
    let mut bench = Bench::working(&ascii(1));
    bench.hand_over(b"one");
    bench.line(LineInput::Fault(LineFault::Gone));
    assert_eq!(bench.tx_echo(), 0x200C, "broken off");
    bench.put_tx(0x2000, &[]);
    bench.put_tx(0, &[]);
    bench.hand_over(b"two");
    assert_eq!(bench.tx_echo(), 0x200C);
    assert_eq!(bench.log.wire.tx, b"one");
    bench.put_tx(0x2000, &[]);
    bench.put_tx(0, &[]);
    assert!(bench.log.leds.error);
    bench.line(LineInput::Fault(LineFault::Back));
    bench.pass(4_000 * MS);
    assert!(!bench.log.leds.error, "4 s after it came back");
    bench.hand_over(b"three");
    bench.line(LineInput::TxDone);
    assert_eq!(bench.tx_echo(), 0);
    assert_eq!((bench.count(Counter::TelegramsSent), bench.count(Counter::SendErrors)), (1, 2));
}

#[test]
fn telegrams_are_rejected_when_the_buffer_is_full() {
    let mut bench = Bench::working(&ascii(3));
    for n in 0..5u8 {
        bench.line(LineInput::Rx(&[n; 7]));
        bench.pass(50 * MS);
    }
    assert_eq!(bench.count(Counter::TelegramsReceived), 3);
    assert_eq!(bench.count(Counter::RejectedFull), 2);
    assert!(bench.log.leds.error);
    for n in 0..3u8 {
        assert_eq!(bench.fetch(), [n; 7]);
    }
    bench.line(LineInput::Rx(b"free"));
    bench.pass(50 * MS);
    assert_eq!(bench.fetch(), b"free");

    let mut bench = Bench::working(&ascii(250));
    for _ in 0..2 {
        bench.line(LineInput::Rx(&text(600)));
        bench.pass(50 * MS);
    }
    assert_eq!(
        (bench.count(Counter::TelegramsReceived), bench.count(Counter::RejectedFull)),
        (1, 1),
        "1024 bytes in all"
    );
    assert_eq!(bench.fetch(), text(600));
}

#[test]
fn a_3964r_partner_is_refused_while_the_buffer_is_full() {
    let mut bench = Bench::working(&s3964r(false));
    let block: Vec<u8> = [&[0x55; 1024][..], &[0x10, 0x03, 0x13]].concat();
    bench.line(LineInput::Rx(&[0x02]));
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&block));
    assert_eq!(bench.log.wire.tx, [0x10, 0x10], "connected and acknowledged");
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&[0x02]));
    assert_eq!(bench.log.wire.tx, [0x10, 0x10, 0x15], "the next one meets a full buffer: NAK");
    assert_eq!(bench.count(Counter::RejectedFull), 1);
    assert_eq!(bench.fetch(), [0x55; 1024]);
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&[0x02]));
    assert_eq!(bench.log.wire.tx, [0x10, 0x10, 0x15, 0x10]);
}

/// A partner that repeats at once into a full buffer: each attempt gets its NAK, is counted, and lights ER. When there
/// is room again the CP takes the next one.
#[test]
fn repetitions_at_once_into_a_full_buffer_are_counted() {
    let mut bench = Bench::working(&s3964r(false));
    let block: Vec<u8> = [&[0x55; 1024][..], &[0x10, 0x03, 0x13]].concat();
    bench.line(LineInput::Rx(&[0x02]));
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&block));
    bench.line(LineInput::TxDone);
    assert!(!bench.log.leds.error);
    for attempt in 1..=6 {
        bench.line(LineInput::Rx(&[0x02]));
        bench.line(LineInput::TxDone);
        assert_eq!(bench.log.wire.tx.last(), Some(&0x15), "attempt {attempt}");
        assert_eq!(bench.count(Counter::RejectedFull), attempt);
    }
    assert!(bench.log.leds.error, "overflow");
    assert_eq!(bench.fetch(), [0x55; 1024]);
    bench.line(LineInput::Rx(&[0x02]));
    assert_eq!(bench.log.wire.tx.last(), Some(&0x10));
}

#[test]
fn fragmented_ascii_hands_over_blocks_as_they_come() {
    let mut parameters = ascii(250);
    parameters[1] = 0x11;
    let mut bench = Bench::working(&parameters);
    bench.line(LineInput::Rx(&text(30)));
    assert_eq!(bench.fetch(), text(30)[..12]);
    assert_eq!(bench.fetch(), text(30)[12..24]);
    assert_eq!(bench.rx(), 0);
    bench.pass(40 * MS);
    assert_eq!(bench.fetch(), text(30)[24..]);
}

#[test]
fn a_character_that_could_not_be_read_lights_er_for_4_s() {
    let mut bench = Bench::working(&ascii(5));
    bench.line(LineInput::Rx(b"ab"));
    bench.line(LineInput::Fault(LineFault::Parity));
    bench.line(LineInput::Rx(b"c"));
    bench.pass(100 * MS);
    assert!(bench.log.leds.error);
    assert_eq!(bench.rx(), 0, "no telegram with a hole in it");
    assert_eq!(bench.count(Counter::ReceiveErrors), 1);
    bench.pass(3_900 * MS);
    assert!(!bench.log.leds.error);
    assert_eq!(bench.due, None, "and then it rests");
}

/// [S0 "Communication with ASCII-fragmented"]: blocks of 12 bytes go to the CPU before the telegram has ended.
#[test]
fn fragments_are_offered_as_they_come() {
    let mut parameters = ascii(1);
    parameters[1] = 0x11;
    let mut bench = Bench::working(&parameters);
    bench.line(LineInput::Rx(b"0123456789AB"));
    assert_eq!(bench.fetch(), b"0123456789AB");
    // A slow CPU does not lose blocks, because the number of receive buffers counts telegrams.
    bench.line(LineInput::Rx(b"CDEFGHIJKLMNOPQRSTUVWXYZ...........end"));
    bench.pass(40 * MS);
    for block in [b"CDEFGHIJKLMN".as_slice(), b"OPQRSTUVWXYZ", b"...........e", b"nd"] {
        assert_eq!(bench.fetch(), block);
    }
}

/// QVZ = 0 has no meaning in the manual [S0 L2022]: it is two character times, as ZVZ = 0 [S0 L2014]. At once would let
/// every connection fail.
#[test]
fn a_qvz_of_0_is_two_characters() {
    let mut bench = Bench::working(&{
        let mut bytes = s3964r(false);
        bytes[6] = 0;
        bytes
    });
    bench.hand_over(b"a");
    bench.line(LineInput::TxDone);
    // 10 bits at 9600: the partner's DLE takes 1.042 ms.
    bench.pass(2 * MS);
    assert_eq!(bench.log.wire.tx, [0x02]);
    bench.line(LineInput::Rx(&[0x10]));
    assert_eq!(bench.log.wire.tx, [0x02, b'a', 0x10, 0x03, b'a' ^ 0x13], "it was heard in time");
}
