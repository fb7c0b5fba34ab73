//! Why nothing happens: what a CP 240 and a CP 341 wait for, and what has failed.

use ob1_firmware::{CpInput, LineFault, LineInput, ModemLines, Reason, Why};
use ob1_params::Value;

use crate::common::{Bench, MS, ascii, s3964r};
use crate::cp341_bench::{self, Got};

/// STX/ETX at 9600 8N1, ZNA 0, TMO 200 ms, 02h and 03h around each telegram, with this flow control.
fn stx_etx(flow: u8) -> [u8; 16] {
    [0, 0x02, 0x13 | flow << 6, 0, 0, 10, 1, 2, 0, 1, 3, 0, 0, 0, 0, 0]
}

fn why(why: Why, number: u16, count: u32) -> Option<Reason> {
    Some(Reason { why, number, count })
}

#[test]
fn it_waits_for_fc_9() {
    let mut bench = Bench::starting(&ascii(1));
    let waits = why(Why::StartUp, 0x8001, 0);
    assert_eq!(bench.reason(), waits);
    bench.step(CpInput::CpuRun(false));
    assert_eq!(bench.reason(), None, "a CPU in STOP calls nothing");
    bench.step(CpInput::CpuRun(true));
    bench.put(0x8001, bench.tx_echo(), &[]);
    assert_eq!(bench.reason(), waits, "half of it");
    bench.put(0, 0, &[]);
    assert_eq!(bench.reason(), None);
    bench.put(0x8002, 0, &[]);
    assert_eq!(bench.reason(), waits, "a RESET");
    let mut wrong = ascii(1);
    wrong[2] = 0xFF;
    bench.step(CpInput::Parameters(&wrong));
    assert_eq!(bench.reason(), None, "the driver's state says it");
}

#[test]
fn orders_that_end_alike_are_counted_until_one_succeeds() {
    let mut bench = Bench::working(&s3964r(true));
    let fail = |bench: &mut Bench| {
        bench.hand_over(b"a");
        bench.pass(20_000 * MS);
        assert_eq!(bench.tx_echo(), 0x2007);
        bench.put_tx(0x2000, &[]);
        bench.put_tx(0, &[]);
    };
    for count in 1..=3 {
        fail(&mut bench);
        assert_eq!(bench.reason(), why(Why::OrderFailed, 0x07, count));
    }
    bench.put_tx(1025, &[]);
    assert_eq!(bench.reason(), why(Why::OrderFailed, 0x17, 1), "another end");
    bench.put_tx(0x2000, &[]);
    bench.put_tx(0, &[]);
    fail(&mut bench);
    assert_eq!(bench.reason(), why(Why::OrderFailed, 0x07, 1));
    bench.log.wire.tx.clear();
    bench.hand_over(b"b");
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&[0x10]));
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&[0x10]));
    assert_eq!((bench.tx_echo(), bench.reason()), (0, None));
}

#[test]
fn a_full_buffer_is_told_until_it_is_empty_and_what_lies_in_it_after_a_second() {
    let mut bench = Bench::working(&ascii(1));
    bench.step(CpInput::CpuRun(true));
    let receive = |bench: &mut Bench, telegram: &[u8]| {
        bench.line(LineInput::Rx(telegram));
        bench.pass(40 * MS);
    };
    receive(&mut bench, b"first");
    assert_eq!(bench.reason(), None);
    bench.pass(999 * MS);
    assert_eq!(bench.reason(), None);
    bench.pass(MS);
    assert_eq!(bench.reason(), why(Why::NotFetched, 1, 1));
    for count in 1..=2 {
        receive(&mut bench, b"more");
        assert_eq!(bench.reason(), why(Why::Full, 0, count));
    }
    assert!(bench.log.leds.error, "ER: overflow [S0 L1458]");
    assert_eq!(bench.fetch(), b"first");
    assert_eq!(bench.reason(), None);
}

#[test]
fn a_telegram_that_is_fetched_slowly_is_not_left_lying() {
    let mut bench = Bench::working(&stx_etx(0));
    bench.step(CpInput::CpuRun(true));
    bench.line(LineInput::Rx(b"\x02a telegram of many blocks, one each 900 ms\x03"));
    while bench.rx() != 0 {
        assert_eq!(bench.reason(), None);
        bench.pass(900 * MS);
        assert_eq!(bench.reason(), None);
        bench.put_rx(bench.rx());
    }
    bench.put_rx(0);
    bench.line(LineInput::Rx(b"\x02x\x03"));
    bench.reason();
    bench.step(CpInput::CpuRun(false));
    bench.pass(9_000 * MS);
    assert_eq!(bench.reason(), None, "a CPU in STOP fetches nothing");
}

/// TMO does not light ER (decision 20): the reason says it, with its number.
#[test]
fn what_cannot_be_read_is_told_for_a_minute_or_until_a_good_telegram() {
    let mut bench = Bench::working(&stx_etx(0));
    bench.line(LineInput::Rx(b"\x02no end"));
    bench.pass(200 * MS);
    assert_eq!((bench.reason(), bench.log.leds.error), (why(Why::ReceiveError, 0x0806, 1), false));
    bench.line(LineInput::Rx(b"\x02b"));
    bench.line(LineInput::Fault(LineFault::Framing));
    assert_eq!((bench.reason(), bench.log.leds.error), (why(Why::ReceiveError, 0x080C, 2), true));
    bench.line(LineInput::Rx(b"\x03\x02good\x03"));
    assert_eq!(bench.reason(), None);
    bench.line(LineInput::Rx(b"\x02no end"));
    bench.pass(200 * MS);
    bench.fetch();
    bench.pass(59_999 * MS);
    assert_eq!(bench.reason(), why(Why::ReceiveError, 0x0806, 1));
    bench.pass(MS);
    assert_eq!(bench.reason(), None);
}

#[test]
fn a_partner_that_stops_the_output_is_named() {
    let mut bench = Bench::working(&stx_etx(2));
    bench.line(LineInput::Rx(&[0x13]));
    assert_eq!(bench.reason(), None, "there is nothing to send");
    bench.hand_over(b"a");
    assert_eq!(bench.reason(), why(Why::Stopped, 0, 0));
    bench.line(LineInput::Rx(&[0x11]));
    assert_eq!(bench.reason(), None);
    let mut bench = Bench::working(&stx_etx(1));
    bench.line(LineInput::Modem(ModemLines { cts: false, dsr: true, ..ModemLines::default() }));
    bench.hand_over(b"a");
    assert_eq!(bench.reason(), why(Why::Signals, 0b10, 0));
    bench.pass(20_000 * MS);
    assert_eq!(bench.reason(), why(Why::OrderFailed, 0x07, 1), "[S0 L2007]; given up after 20 s");
}

#[test]
fn a_cp_341_says_it_too() {
    let end = [("protocol", "ascii".into()), ("zvz_ms", Value::Int(10))];
    let mut bench = cp341_bench::Bench::new(&end);
    assert_eq!(bench.reason(), None);
    bench.pauses();
    bench.has_said(b"abc");
    bench.pass(20 * MS);
    assert_eq!(bench.reason(), None);
    bench.pass(1_001 * MS);
    assert_eq!(bench.reason(), why(Why::NotFetched, 0, 1));
    let mut bench = cp341_bench::Bench::new(&[("protocol", "3964r".into())]);
    for count in 1..=2 {
        assert_eq!(bench.job(b"a"), Err(0x0703));
        assert_eq!(bench.reason(), why(Why::OrderFailed, 0x0703, count));
    }
    let keys = [("protocol", "modbus-ascii-master-32".into()), ("rs232_signals", Value::from("yes"))];
    let mut bench = cp341_bench::Bench::new(&keys);
    bench.switches(false, true);
    bench.pass(MS);
    assert_eq!(bench.job(&[5, 7]), Err(0x0818));
    assert_eq!((bench.reason(), bench.sf()), (why(Why::Signals, 0b10, 0), true));
    bench.switches(true, true);
    bench.pass(MS);
    assert_eq!((bench.reason(), bench.sf()), (why(Why::OrderFailed, 0x0818, 1), false));
    assert_eq!(bench.all(), [] as [Got; 0]);
}
