//! The Modbus modes at the registers: ready without FC 9, master, slave short, slave long. `docs/cp240-registers.md`

use ob1_firmware::{Counter, Cp as _, CpInput, Leds, LineInput};
use ob1_protocols::modbus::{FRAME_CHARACTERS, Mode};

use crate::common::{Bench, MS};

const BAUD_38400: u8 = 0x0C;

/// 38400 8N1, address 5, delay time 100 ms.
const fn parameters(protocol: u8) -> [u8; 16] {
    [BAUD_38400, protocol, 0x13, 0, 5, 0, 0, 100, 0, 0, 0, 0, 0, 0, 0, 0]
}

const MASTER_RTU: [u8; 16] = parameters(0x0B);
const SLAVE_SHORT: [u8; 16] = parameters(0x0D);
const SLAVE_LONG: [u8; 16] = parameters(0x1D);

fn frame(telegram: &[u8]) -> Vec<u8> {
    let mut frame = [0; FRAME_CHARACTERS];
    let len = Mode::Rtu.encode(telegram, &mut frame).expect("a telegram");
    frame[..len].to_vec()
}

/// A telegram comes in; returns the CP's answer within 10 ms.
fn ask(bench: &mut Bench, telegram: &[u8]) -> Vec<u8> {
    bench.log.wire.tx.clear();
    bench.line(LineInput::Rx(&frame(telegram)));
    bench.pass(10 * MS);
    let answer = bench.log.wire.tx.clone();
    if !answer.is_empty() {
        bench.line(LineInput::TxDone);
    }
    answer
}

/// Does what FC 0 does.
fn send(bench: &mut Bench, telegram: &[u8], option: u16) {
    let mut rest = telegram;
    while !rest.is_empty() {
        let (block, next) = rest.split_at(rest.len().min(12));
        bench.put_tx(rest.len() as u16 | option, block);
        assert_eq!(bench.tx_echo(), rest.len() as u16);
        rest = next;
    }
    bench.put_tx(0, &[]);
}

/// Does what FC 1 does, as far as possible; returns the bits above the counts, and the telegram.
fn receive(bench: &mut Bench) -> Option<(u16, Vec<u8>)> {
    let bits = bench.rx() & 0xF000;
    let mut telegram = Vec::new();
    let mut left = bench.rx();
    if left == 0 {
        return None;
    }
    while left != 0 {
        assert_eq!(left & 0xF000, bits);
        let block = usize::from(left & 0x07FF).min(12);
        telegram.extend_from_slice(&bench.log.inputs[4..4 + block]);
        bench.put_rx(left);
        assert_ne!(bench.rx(), left, "the CP goes on");
        left = if block == usize::from(left & 0x07FF) { 0 } else { bench.rx() };
    }
    bench.put_rx(0);
    Some((bits, telegram))
}

/// "With valid parameters the LEDs ER, TxD and RxD extinguish. Now the Modbus module is ready for communication."
#[test]
fn ready_without_an_identifier() {
    for protocol in [0x0A, 0x0B, 0x0C, 0x0D, 0x1C, 0x1D] {
        let bench = Bench::starting(&parameters(protocol));
        assert!(bench.cp.is_working(), "{protocol:02X}h");
        assert_eq!((bench.rx(), bench.tx_echo()), (0, 0));
        assert_eq!(bench.log.leds, Leds { power: true, error: false, transmit: false, receive: false });
    }
}

/// "The LEDs ER, TxD and RxD are flashing ... it hasn't received valid parameters from the CPU yet."
#[test]
fn flashes_without_valid_parameters() {
    let mut bad = MASTER_RTU;
    bad[0] = 0x0E; // 115200 baud
    let mut bench = Bench::starting(&bad);
    assert_eq!((bench.rx(), bench.tx_echo()), (0x8003, 0x8000), "no valid parameters: byte 0");
    let flashing = |on| Leds { power: true, error: on, transmit: on, receive: on };
    for n in 0..5 {
        assert_eq!(bench.log.leds, flashing(n % 2 == 0));
        bench.pass(250 * MS);
    }
    bench.step(CpInput::Parameters(&MASTER_RTU));
    bench.pass(1000 * MS);
    assert_eq!(bench.log.leds, Leds { power: true, error: false, transmit: false, receive: false });
}

/// The manual's example, at the registers of the master. [S0 "Send and receive telegram"]
#[test]
fn a_master_sends_and_receives() {
    let mut bench = Bench::starting(&MASTER_RTU);
    let telegram: Vec<u8> = [5, 0x10, 0, 0, 0, 8, 0x10].into_iter().chain(0xA0..=0xAF).collect();
    send(&mut bench, &telegram, 0);
    bench.pass(5 * MS);
    assert_eq!(bench.log.wire.tx, frame(&telegram));
    assert_eq!(bench.tx_echo(), 11, "FRG stays until the answer is there");
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&frame(&[5, 0x10, 0, 0, 0, 8])));
    bench.pass(5 * MS);
    assert_eq!(bench.tx_echo(), 0);
    assert_eq!(receive(&mut bench), Some((0, vec![5, 0x10, 0, 0, 0, 8])));
}

/// "ERROR01 NO DATA" in the receive block, and the order has failed with 07h.
#[test]
fn a_master_without_an_answer() {
    let mut bench = Bench::starting(&MASTER_RTU);
    send(&mut bench, &[5, 3, 0, 0, 0, 1], 0);
    bench.pass(5 * MS);
    bench.line(LineInput::TxDone);
    bench.pass(99 * MS);
    assert_eq!((bench.rx(), bench.tx_echo()), (0, 6));
    bench.pass(MS);
    assert_eq!((bench.rx(), bench.tx_echo()), (16, 0x2007));
    let (_, text) = receive(&mut bench).expect("the plain text");
    assert_eq!(text, b"ERROR\x00\x01 NO DATA\x00");
    bench.put_tx(0x2000, &[]);
    bench.put_tx(0, &[]);
    assert!(!bench.log.leds.error, "for Modbus ER signalizes an internal error");
    send(&mut bench, &[0, 6, 0, 0, 0, 1], 0);
    bench.pass(5 * MS);
    bench.line(LineInput::TxDone);
    assert_eq!(bench.tx_echo(), 0, "a broadcast is done with its last bit");
    assert_eq!(bench.log.counters[&Counter::TelegramsSent], 1);
    assert_eq!(bench.log.counters[&Counter::SendErrors], 1);
}

/// An order on a lost line ends as with a missing slave.
#[test]
fn a_master_on_a_line_that_is_gone() {
    let mut bench = Bench::starting(&MASTER_RTU);
    bench.line(LineInput::Fault(ob1_firmware::LineFault::Gone));
    send(&mut bench, &[5, 3, 0, 0, 0, 1], 0);
    bench.pass(5 * MS);
    bench.line(LineInput::TxDone);
    bench.pass(100 * MS);
    assert_eq!(receive(&mut bench).expect("the plain text").1, b"ERROR\x00\x01 NO DATA\x00");
}

/// No receive buffer free for the answer is an internal error: ER until STOP-RUN. [S0 L2086]
#[test]
fn er_stays_until_stop_run() {
    let mut bench = Bench::starting(&MASTER_RTU);
    let orders = |bench: &mut Bench, n: usize| {
        for _ in 0..n {
            send(bench, &[5, 3, 0, 0, 0, 1], 0);
            bench.pass(5 * MS);
            bench.line(LineInput::TxDone);
            bench.pass(100 * MS);
            bench.put_tx(0x2000, &[]);
            bench.put_tx(0, &[]);
        }
    };
    orders(&mut bench, 64);
    assert!(!bench.log.leds.error, "64 texts of 16 bytes fill the buffer");
    orders(&mut bench, 1);
    bench.pass(10_000 * MS);
    assert!(bench.log.leds.error);
    bench.step(CpInput::CpuRun(true));
    assert!(bench.log.leds.error, "no STOP before it");
    bench.step(CpInput::CpuRun(false));
    bench.step(CpInput::CpuRun(true));
    assert!(!bench.log.leds.error);
}

/// The content of the registers at the restart of a driver comes from its predecessor.
#[test]
fn a_count_of_an_earlier_life_is_no_telegram() {
    let mut bench = Bench::off();
    bench.put(0, 6, &[5, 3, 0, 0, 0, 1]);
    bench.step(CpInput::Parameters(&MASTER_RTU));
    assert!(bench.cp.is_working());
    assert_eq!(bench.tx_echo(), 1, "so that the next job takes the count back first");
    bench.put_tx(6, &[5, 3, 0, 0, 0, 1]);
    assert_eq!(bench.tx_echo(), 1);
    bench.put_tx(0, &[]);
    assert_eq!(bench.tx_echo(), 0);
    send(&mut bench, &[5, 3, 0, 0, 0, 1], 0);
    bench.pass(5 * MS);
    assert_eq!(bench.log.wire.tx, frame(&[5, 3, 0, 0, 0, 1]));
}

/// FC 9 is not for the Modbus modes: its words change nothing.
#[test]
fn a_reset_request_is_not_understood() {
    let mut bench = Bench::starting(&MASTER_RTU);
    bench.put_rx(0x8002);
    assert!(bench.cp.is_working());
    assert_eq!((bench.rx(), bench.tx_echo()), (0, 0));
}

/// The master's delay time is no parameter of a slave: it answers at once, whatever stands there. [S0 L2177] Debug
/// changes nothing. [S0 L2168]
#[test]
fn a_slave_has_no_delay_time_and_no_debug() {
    for (wait, debug) in [(0_u16, 0), (1, 0), (60_000, 0), (0, 1)] {
        let mut parameters = SLAVE_SHORT;
        parameters[5] = debug;
        parameters[6..8].copy_from_slice(&wait.to_be_bytes());
        let mut bench = Bench::starting(&parameters);
        let answer = ask(&mut bench, &[5, 4, 0, 0, 0, 1]);
        assert_eq!(answer, frame(&[5, 4, 2, 0, 0]), "{wait} ms");
    }
}

/// A master asks whom the telegram names: its own address is nobody's. [S0 L2570-L2572]
#[test]
fn a_master_has_no_address() {
    for address in [1, 5, 255] {
        let mut parameters = MASTER_RTU;
        parameters[4] = address;
        let mut bench = Bench::starting(&parameters);
        send(&mut bench, &[5, 3, 0, 0, 0, 1], 0);
        bench.pass(5 * MS);
        assert_eq!(bench.log.wire.tx, frame(&[5, 3, 0, 0, 0, 1]), "address {address}");
        bench.line(LineInput::TxDone);
        bench.line(LineInput::Rx(&frame(&[5, 3, 2, 0x12, 0x34])));
        bench.pass(5 * MS);
        assert_eq!(receive(&mut bench), Some((0, vec![5, 3, 2, 0x12, 0x34])), "address {address}");
    }
}

/// "Slave short": 16 bytes each way in the process image, no program. [S0 "Modbus Slave Short"]
#[test]
fn slave_short_is_the_process_image() {
    let mut bench = Bench::off();
    bench.outputs = *b"0123456789abcdef";
    bench.step(CpInput::Outputs(&bench.outputs.clone()));
    bench.step(CpInput::Parameters(&SLAVE_SHORT));
    assert_eq!(ask(&mut bench, &[5, 4, 0, 0, 0, 2]), frame(&[5, 4, 4, b'0', b'1', b'2', b'3']));
    let write: Vec<u8> = [5, 0x10, 0, 0, 0, 8, 0x10].into_iter().chain(0xA0..=0xAF).collect();
    assert_eq!(ask(&mut bench, &write), frame(&[5, 0x10, 0, 0, 0, 8]));
    assert_eq!(bench.log.inputs.to_vec(), (0xA0..=0xAF).collect::<Vec<u8>>());
    // The bytes are never counts: neither a reset request nor a telegram.
    bench.outputs = [0x80, 0x02, 0, 6, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
    bench.step(CpInput::Outputs(&bench.outputs.clone()));
    assert_eq!(ask(&mut bench, &[5, 4, 0, 0, 0, 2]), frame(&[5, 4, 4, 0x80, 0x02, 0, 6]));
    assert_eq!(ask(&mut bench, &[5, 6, 0, 0, 0x80, 0x03]), frame(&[5, 6, 0, 0, 0x80, 0x03]));
    assert_eq!(bench.log.inputs[..4], [0x80, 0x03, 0xA2, 0xA3]);
    assert_eq!(ask(&mut bench, &[5, 4, 0, 8, 0, 1]), frame(&[5, 0x84, 2]));
}

/// "Slave long": a SEND fills the input area from 0 on, with 4000h the output area. [S0 "Modbus Slave Long"]
#[test]
fn slave_long_stores_what_is_sent() {
    let mut bench = Bench::starting(&SLAVE_LONG);
    let data: Vec<u8> = (0..=255).cycle().take(1024).map(|n: u8| n ^ 0x5A).collect();
    send(&mut bench, &data, 0);
    assert_eq!(bench.tx_echo(), 0, "done when it is stored");
    send(&mut bench, &[1, 2, 3], 0x4000);
    assert_eq!(bench.tx_echo(), 0);
    send(&mut bench, b"0123456789abc", 0x4000);
    assert_eq!(ask(&mut bench, &[5, 4, 0, 0, 0, 1]), frame(&[5, 4, 2, data[0], data[1]]));
    assert_eq!(ask(&mut bench, &[5, 4, 1, 0xFF, 0, 1]), frame(&[5, 4, 2, data[1022], data[1023]]));
    assert_eq!(ask(&mut bench, &[5, 3, 0, 5, 0, 2]), frame(&[5, 3, 4, b'a', b'b', b'c', 0]));
    assert_eq!(receive(&mut bench), None, "the CPU knows what it sent");
    bench.put_tx(0x4401, &[0; 12]);
    assert_eq!(bench.tx_echo(), 0x2017, "1025 bytes");
}

/// Only changed blocks, contiguous ones together; the answer follows when all of them have been fetched. [S0 L2072],
/// [S0 L2082]
#[test]
fn slave_long_hands_out_what_has_changed() {
    let mut bench = Bench::starting(&SLAVE_LONG);
    let write: Vec<u8> = [5, 0x10, 0, 3, 0, 2, 4].into_iter().chain([1, 2, 3, 4]).collect();
    assert_eq!(ask(&mut bench, &write), []);
    assert_eq!(bench.rx(), 0x4000 + 2 + 16);
    bench.log.wire.tx.clear();
    let blocks = vec![0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 0, 0, 0, 0, 0, 0];
    assert_eq!(receive(&mut bench), Some((0x4000, blocks)));
    assert_eq!(bench.log.wire.tx, frame(&[5, 0x10, 0, 3, 0, 2]));
    bench.line(LineInput::TxDone);

    // 250 bytes from byte 0 on: block 0 as far as it differs, up to block 31, in two telegrams.
    let write: Vec<u8> = [5, 0x10, 0, 0, 0, 125, 250].into_iter().chain(0..250).collect();
    assert_eq!(ask(&mut bench, &write), []);
    for (offset, bytes) in [(0, 128), (128, 128)] {
        assert_eq!(bench.log.wire.tx, [], "not before all is fetched");
        let (bits, telegram) = receive(&mut bench).expect("a changed area");
        assert_eq!((bits, telegram.len()), (0x4000, 2 + bytes));
        assert_eq!(telegram[..2], u16::to_be_bytes(offset));
        assert_eq!(telegram[2..8], write[7 + usize::from(offset)..][..6]);
    }
    assert_eq!(bench.log.wire.tx, frame(&[5, 0x10, 0, 0, 0, 125]));
    bench.line(LineInput::TxDone);
    assert_eq!(ask(&mut bench, &write), frame(&[5, 0x10, 0, 0, 0, 125]), "nothing has changed");
    assert_eq!(receive(&mut bench), None);
    assert_eq!(bench.log.counters[&Counter::TelegramsDelivered], 3);
}

/// The CPU's area is too short: exception 02h to the master. [S0 L2074]
#[test]
fn slave_long_outside_of_the_cpus_area() {
    let mut bench = Bench::starting(&SLAVE_LONG);
    assert_eq!(ask(&mut bench, &[5, 6, 1, 0, 0xAB, 0xCD]), []);
    assert_eq!(bench.rx(), 0x4000 + 10);
    bench.put_rx(0x2002);
    assert_eq!(bench.rx(), 0);
    assert_eq!(bench.log.wire.tx, frame(&[5, 0x86, 2]));
    bench.line(LineInput::TxDone);
    bench.put_rx(0);
    assert_eq!(ask(&mut bench, &[5, 6, 0, 0, 0xAB, 0xCD]), []);
    assert!(receive(&mut bench).is_some());
    assert_eq!(bench.log.wire.tx, frame(&[5, 6, 0, 0, 0xAB, 0xCD]));
}
