//! A CP with STX/ETX: from the registers to the line and back.

use ob1_firmware::{Counter, LineFault, LineInput};

use crate::common::{Bench, MS};

/// STX/ETX at 9600 8N1, ZNA 40 ms, TMO 200 ms, `{(` and `)` around each telegram.
const PARAMETERS: [u8; 16] = [0, 0x02, 0x13, 0, 2, 10, 2, b'{', b'(', 1, b')', 0, 0, 0, 0, 0];

#[test]
fn telegrams_are_enclosed_and_taken_out_again() {
    let mut bench = Bench::working(&PARAMETERS);
    bench.hand_over(b"a telegram of 2 blocks");
    assert_eq!(bench.log.wire.tx, b"{(a telegram of 2 blocks)");
    bench.line(LineInput::TxDone);
    assert_ne!(bench.tx_echo(), 0, "ZNA runs");
    bench.pass(40 * MS);
    assert_eq!(bench.tx_echo(), 0);
    assert_eq!(bench.count(Counter::TelegramsSent), 1);

    bench.line(LineInput::Rx(b"xx{(one)yy{(a second)"));
    assert_eq!(bench.fetch(), b"one");
    assert_eq!(bench.fetch(), b"a second");
}

#[test]
fn what_is_lost_is_counted_and_lights_er() {
    let mut bench = Bench::working(&PARAMETERS);
    bench.line(LineInput::Rx(b"{(no end"));
    bench.pass(200 * MS);
    assert_eq!(bench.count(Counter::ReceiveErrors), 1);
    assert!(!bench.log.leds.error, "TMO is no error of the line");
    bench.line(LineInput::Rx(b"{(bad"));
    bench.line(LineInput::Fault(LineFault::Parity));
    assert!(bench.log.leds.error);
    bench.line(LineInput::Rx(b")"));
    assert_eq!((bench.rx(), bench.count(Counter::TelegramsReceived)), (0, 0));
    bench.line(LineInput::Rx(b"{(good)"));
    assert_eq!(bench.fetch(), b"good");
}

/// [S0 "Properties"]: up to 250 telegrams, together up to 1024 bytes; then new ones are rejected.
#[test]
fn the_receive_buffer_is_that_of_the_cp() {
    let mut bench = Bench::working(&PARAMETERS);
    for _ in 0..251 {
        bench.line(LineInput::Rx(b"{(t)"));
    }
    assert_eq!((bench.cp.received_waiting(), bench.count(Counter::RejectedFull)), (250, 1));
    let mut bench = Bench::working(&PARAMETERS);
    let long = [b"{(".as_slice(), &[b'l'; 1000], b")"].concat();
    bench.line(LineInput::Rx(&long));
    bench.line(LineInput::Rx(b"{(0123456789012345678901234)"));
    bench.line(LineInput::Rx(b"{(012345678901234567890123)"));
    assert_eq!((bench.cp.received_waiting(), bench.count(Counter::RejectedFull)), (2, 1));
}
