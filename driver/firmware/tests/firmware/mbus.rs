//! A CP with M-Bus: from the registers to the line and back.

use ob1_firmware::{Counter, Cp as _, LineFault, LineInput};
use ob1_params::Cp240;

use crate::common::{Bench, MS};

/// "You have only to set F0h in Byte 1 ... The other parameters are reserved and not evaluated." [S0 L4129]
const PARAMETERS: [u8; 16] = [0, 0xF0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// An answer with this user data after C, A and CI field, as on the line.
fn answer(data: &[u8]) -> Vec<u8> {
    let l = 3 + data.len() as u8;
    let body = [&[0x08, 0x02, 0x72][..], data].concat();
    let sum = body.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    [&[0x68, l, l, 0x68][..], &body, &[sum, 0x16]].concat()
}

#[test]
fn the_example_of_the_manual() {
    let mut bench = Bench::working(&PARAMETERS);
    assert_eq!(bench.log.settings.last().map(ToString::to_string).as_deref(), Some("2400 8E1"));
    bench.hand_over(&[0xBB, 0x7B, 0xFE]);
    assert_eq!(bench.log.wire.tx, [0x10, 0x7B, 0xFE, 0x79, 0x16]);
    assert!(bench.log.leds.transmit && bench.log.leds.power && !bench.log.leds.error);
    bench.pass(23 * MS);
    bench.line(LineInput::TxDone);
    assert!(!bench.log.leds.transmit);
    bench.pass(20 * MS);
    bench.line(LineInput::Rx(&answer(&[1, 2, 3])));
    assert!(bench.log.leds.receive);
    assert_eq!(bench.tx_echo(), 0);
    assert_eq!(bench.fetch(), [0, 8, 2, 0x72, 1, 2, 3]);
    assert_eq!((bench.count(Counter::TelegramsSent), bench.count(Counter::TelegramsReceived)), (1, 1));
}

/// [S0 "Example RECEIVE data"]: of 18 bytes of user data and the response byte first 12, then the rest. (The manual
/// counts the response byte among the 18 of the first word, and not among the 7 of the second.)
#[test]
fn an_answer_comes_in_blocks_of_12() {
    let mut bench = Bench::working(&PARAMETERS);
    bench.hand_over(&[0xBD, 0x5B, 2]);
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&answer(&[7; 14])));
    let counts: Vec<u16> = std::iter::from_fn(|| {
        let rest = bench.rx();
        bench.put_rx(rest);
        (rest != 0).then_some(rest)
    })
    .collect();
    assert_eq!(counts, [18, 6]);
}

#[test]
fn each_telegram_sets_its_baud_rate() {
    let mut bench = Bench::working(&PARAMETERS);
    for (code, settings) in [(0xB8, "300 8E1"), (0xB8, "300 8E1"), (0xBD, "9600 8E1"), (0x00, "2400 8E1")] {
        bench.hand_over(&[code, 0x40, 1]);
        assert_eq!(bench.log.settings.last().map(ToString::to_string).as_deref(), Some(settings));
        bench.line(LineInput::TxDone);
        bench.line(LineInput::Rx(&[0xE5]));
        assert_eq!(bench.fetch(), [0, 0xE5]);
    }
    assert_eq!(bench.log.settings.len(), 4, "set where it changes: {:?}", bench.log.settings);
    // New parameters, and a reset: a telegram keeps its own rate.
    bench.step(ob1_firmware::CpInput::Parameters(&PARAMETERS));
    bench.synchronise();
    assert_eq!(bench.log.settings.len(), 5);
}

#[test]
fn no_answer_and_short_circuit() {
    let mut bench = Bench::working(&PARAMETERS);
    bench.hand_over(&[0xBD, 0x5B, 2]);
    for _ in 0..3 {
        assert_ne!(bench.tx_echo(), 0);
        bench.line(LineInput::TxDone);
        bench.pass(90 * MS);
    }
    assert_eq!((bench.tx_echo(), bench.log.wire.tx.len()), (0, 15));
    assert_eq!(bench.fetch(), [1]);
    assert!(!bench.log.leds.error, "a meter that is silent is no error of the line");
    bench.hand_over(&[0xBD, 0x5B, 2]);
    bench.line(LineInput::Fault(LineFault::Break));
    assert_eq!(bench.tx_echo(), 0);
    assert_eq!(bench.fetch(), [3]);
    assert!(bench.log.leds.error);
}

/// "Diagnosis data -" [S0 L4717]: an error lights ER and raises no diagnostic interrupt.
#[test]
fn there_is_no_diagnostic_interrupt() {
    let mut bench = Bench::working(&PARAMETERS);
    bench.cp.enable_diagnostics(true);
    bench.line(LineInput::Fault(LineFault::Gone));
    assert!(bench.log.leds.error);
    bench.line(LineInput::Fault(LineFault::Back));
    bench.pass(5000 * MS);
    assert!(!bench.log.leds.error);
    assert!(!bench.log.events.iter().any(|event| event.contains("Diagnosis")), "{:?}", bench.log.events);
}

#[test]
fn what_is_no_frame_ends_with_its_code() {
    for (telegram, echo) in [(vec![0xBB], 0x200C), (vec![0xBB, 0x10], 0x200C), (vec![0xBB; 257], 0x2017)] {
        let mut bench = Bench::working(&PARAMETERS);
        bench.hand_over(&telegram);
        assert_eq!((bench.tx_echo(), bench.log.wire.tx.len(), bench.rx()), (echo, 0, 0));
    }
}

/// A lost line is like a meter that does not answer: the program gets its response, and the CP continues.
#[test]
fn a_line_that_is_gone_answers_nothing() {
    let mut bench = Bench::working(&PARAMETERS);
    bench.line(LineInput::Fault(LineFault::Gone));
    bench.hand_over(&[0xBD, 0x5B, 2]);
    for _ in 0..3 {
        bench.line(LineInput::TxDone);
        bench.pass(90 * MS);
    }
    assert_eq!(bench.fetch(), [1]);
    assert!(bench.log.leds.error);
}

#[test]
fn reserved_bytes_are_not_evaluated() {
    let mut bytes = [0xFF; 16];
    bytes[1] = 0xF0;
    let cp = Cp240::decode(&bytes).expect("valid");
    assert_eq!((cp.protocol_name(), cp.encode()), ("mbus", PARAMETERS));
    let mut bench = Bench::working(&bytes);
    bench.hand_over(&[0xBD, 0x40, 0xFF]);
    bench.line(LineInput::TxDone);
    assert_eq!(bench.fetch(), [1]);
}

/// "send and receive data have each a reserved 2048Byte buffer" [S0 L4133]: eight of the longest answers; the next
/// order waits until one is taken.
#[test]
fn the_receive_buffer_has_2048_bytes() {
    let mut bench = Bench::working(&PARAMETERS);
    for n in 0..8 {
        bench.hand_over(&[0xBD, 0x5B, 2]);
        bench.line(LineInput::TxDone);
        bench.line(LineInput::Rx(&answer(&[n; 252])));
    }
    assert_eq!((bench.cp.received_waiting(), bench.count(Counter::RejectedFull)), (8, 0));
    let sent = bench.log.wire.tx.len();
    bench.hand_over(&[0xBD, 0x40, 2]);
    bench.pass(1000 * MS);
    assert_eq!((bench.log.wire.tx.len(), bench.tx_echo()), (sent, 3), "it waits");
    assert_eq!(bench.fetch()[4..], [0; 252]);
    bench.pass(20 * MS);
    assert_eq!(bench.log.wire.tx.len(), sent + 5);
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&[0xE5]));
    for n in 1..8 {
        assert_eq!(bench.fetch()[4..], [n; 252]);
    }
    assert_eq!(bench.fetch(), [0, 0xE5]);
}

/// [S0 L4184]: a missing stop bit, which a wrong baud rate makes as well, lights ER for 4 s.
#[test]
fn a_wrong_stop_bit_lights_er() {
    let mut bench = Bench::working(&PARAMETERS);
    bench.hand_over(&[0xBD, 0x5B, 2]);
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&answer(&[1])[..5]));
    assert!(!bench.log.leds.error);
    bench.line(LineInput::Fault(LineFault::Framing));
    assert!(bench.log.leds.error);
    bench.pass(10 * MS);
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&answer(&[1])));
    assert_eq!(bench.fetch(), [0, 8, 2, 0x72, 1], "asked again, and answered");
    bench.pass(4_000 * MS);
    assert!(!bench.log.leds.error);
}
