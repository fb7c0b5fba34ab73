//! A CP with EnOcean: from the registers to the module inside it and back.

use ob1_firmware::{Counter, Cp as _, CpInput, LineFault, LineInput};
use ob1_params::Cp240;
use ob1_protocols::esp2::frame::{Bytes, encode};
use ob1_protocols::esp2::{Button, Command, Message, Radio, Switch, Telegram};

use crate::common::{Bench, MS};

/// "Here only E0h is to be given in byte 1 as protocol for EnOcean. The other parameters are reserved and not
/// evaluated." [S1 L937]
const PARAMETERS: [u8; 16] = [0, 0xE0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// The telegram of the manual's FC 101, up to the ID base. [S1 L1640]
const FC_101: Bytes = [0x6B, 5, 2, 0, 0, 0, 0, 0, 0x32, 0x67, 6];

fn frame(telegram: Telegram) -> [u8; 14] {
    encode(&telegram.emit())
}

fn switch(repeater: u8) -> Telegram {
    let button = Button { rocker: 1, o: true };
    let second = Button { rocker: 0, o: false };
    let switch = Switch::N { button, pressed: true, second, second_action: false };
    Telegram::Received(Radio::Rps { switch, type_2: true, id: 0x0012_1C7A, repeater })
}

/// The module answers the CP's question.
fn tell(bench: &mut Bench, base: u32) {
    assert_eq!(std::mem::take(&mut bench.log.wire.tx), frame(Telegram::Command(Command::RdIdBase)));
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&frame(Telegram::Message(Message::InfIdBase(base)))));
    assert_eq!(bench.rx(), 0, "it goes to the CP, not to the program");
}

fn working(base: u32) -> Bench {
    let mut bench = Bench::working(&PARAMETERS);
    assert_eq!(bench.log.settings.last().map(ToString::to_string).as_deref(), Some("9600 8N1"));
    tell(&mut bench, base);
    bench
}

#[test]
fn the_send_example_of_the_manual() {
    let mut bench = working(0xFF80_0080);
    // "To acknowledge the telegram the CP writes 11 back", "0", "0".
    // [S1 "Beispiel Daten senden ohne Hantierungsbaustein"]
    bench.hand_over(&FC_101);
    assert_eq!(bench.log.wire.tx, [0xA5, 0x5A, 0x6B, 5, 2, 0, 0, 0, 0xFF, 0x80, 0, 0xE7, 6, 0xDE]);
    assert_eq!(bench.tx_echo(), 0, "in the send buffer: done");
    assert!(bench.log.leds.transmit);
    bench.line(LineInput::TxDone);
    assert!(!bench.log.leds.transmit);
    bench.log.wire.tx.clear();
    bench.hand_over(&[0xAA]);
    assert_eq!(bench.log.wire.tx, [0xAA], "WAKE");
    assert_eq!(bench.count(Counter::TelegramsSent), 2);
}

#[test]
fn the_receive_example_of_the_manual() {
    let mut bench = working(0xFF80_0080);
    bench.line(LineInput::Rx(&frame(switch(0))));
    assert!(bench.log.leds.receive);
    assert_eq!(bench.rx(), 11);
    assert_eq!(bench.fetch(), switch(0).emit());
}

/// "After a successful transfer the CPU is to be restarted or a reset via FC 9 to be executed." Until then the CP ORs
/// with the old base. [S1 "Modul ersetzen und IDBase übernehmen"]
#[test]
fn a_new_id_base_counts_after_a_reset() {
    let mut bench = working(0xFF80_0080);
    bench.hand_over(&Telegram::Command(Command::SetIdBase(0xFFAB_CDFF)).emit());
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&frame(Telegram::Message(Message::Ok))));
    assert_eq!(bench.fetch(), Telegram::Message(Message::Ok).emit());
    bench.log.wire.tx.clear();
    bench.hand_over(&FC_101);
    assert_eq!(bench.log.wire.tx[8..12], [0xFF, 0x80, 0, 0xE7], "the old one");
    bench.line(LineInput::TxDone);
    bench.log.wire.tx.clear();
    bench.step(CpInput::Parameters(&PARAMETERS));
    bench.synchronise();
    tell(&mut bench, 0xFFAB_CDFF);
    bench.hand_over(&FC_101);
    assert_eq!(bench.log.wire.tx[8..12], [0xFF, 0xAB, 0xCD, 0xE7], "the new one");
}

/// "... which may handle up to 150 telegrams"; "at full buffer new telegrams are ignored"; ER shows this, and nothing
/// else. [S1 L941]
#[test]
fn a_full_buffer_is_all_that_er_shows() {
    let mut bench = working(0xFF80_0080);
    bench.cp.enable_diagnostics(true);
    bench.line(LineInput::Fault(LineFault::Framing));
    bench.line(LineInput::Fault(LineFault::Gone));
    bench.line(LineInput::Fault(LineFault::Back));
    assert!(!bench.log.leds.error);
    for n in 0..150_u8 {
        bench.line(LineInput::Rx(&frame(switch(n % 16))));
    }
    assert_eq!((bench.cp.received_waiting(), bench.log.leds.error), (150, false));
    bench.line(LineInput::Rx(&frame(switch(0))));
    assert_eq!((bench.cp.received_waiting(), bench.count(Counter::RejectedFull)), (150, 1));
    assert!(bench.log.leds.error);
    bench.pass(4000 * MS);
    assert!(!bench.log.leds.error);
    assert!(!bench.log.events.iter().any(|event| event.contains("Diagnosis")), "no diagnostic interrupt");
    for n in 0..150_u8 {
        assert_eq!(bench.fetch(), switch(n % 16).emit());
    }
}

/// The CPU hands over telegrams faster than 9600 baud: 146 fit into the buffer, one more waits, and all are sent in
/// order.
#[test]
fn the_send_buffer_takes_2048_bytes() {
    let mut bench = working(0xFF80_0080);
    let telegram = |n: u8| [0x6B, 6, n, 0, 0, 0, 0, 0, 0, 1, 0];
    for n in 0..147 {
        bench.hand_over(&telegram(n));
        assert_eq!(bench.tx_echo(), 0, "{n}");
    }
    bench.hand_over(&telegram(147));
    assert_eq!(bench.tx_echo(), 11, "no place");
    bench.line(LineInput::TxDone);
    assert_eq!(bench.tx_echo(), 0);
    for _ in 0..147 {
        bench.line(LineInput::TxDone);
    }
    let sent: Vec<u8> = bench.log.wire.tx.chunks(14).map(|frame| frame[4]).collect();
    assert_eq!(sent, (0..148).collect::<Vec<u8>>());
}

#[test]
fn other_lengths_and_a_line_that_is_gone() {
    let mut bench = working(0xFF80_0080);
    bench.hand_over(&[0x6B; 10]);
    assert_eq!(bench.tx_echo(), 0x200C);
    let mut bench = working(0xFF80_0080);
    bench.hand_over(&[0x6B; 12]);
    assert_eq!(bench.tx_echo(), 0x2017);
    let mut bench = working(0xFF80_0080);
    bench.line(LineInput::Fault(LineFault::Gone));
    bench.hand_over(&FC_101);
    assert_eq!(bench.tx_echo(), 0x200C);
}

#[test]
fn reserved_bytes_are_not_evaluated() {
    let mut bytes = [0xFF; 16];
    bytes[1] = 0xE0;
    let cp = Cp240::decode(&bytes).expect("valid");
    assert_eq!((cp.protocol_name(), cp.encode()), ("enocean", PARAMETERS));
    tell(&mut Bench::working(&bytes), 0xFF80_0000);
}
