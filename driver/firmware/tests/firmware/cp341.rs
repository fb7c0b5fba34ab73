//! The CP 341 apart from its telegrams: entries of its diagnostic buffer, diagnostic interrupts, accompanying signals,
//! jobs without parameters. (docs/cp341.md)

use ob1_firmware::cp341::{Channel, ChannelBlock, Cp341};
use ob1_firmware::{Cp as _, CpInput, Instant, LineFault, LineInput, ModemLines, Span};
use ob1_params::{Cp341 as Parameters, Value};

use ob1_fakes::cp_port::CpLog;

use crate::common::MS;

const SECOND: Span = Span::from_millis(1000);

fn parameters(baud: i64) -> Parameters {
    Parameters::from_keys([("protocol", Value::from("3964r")), ("baud", Value::Int(baud))]).expect("they are good")
}

/// Entries of the diagnostic buffer, oldest first.
fn entries(log: &CpLog) -> Vec<&str> {
    log.events.iter().filter_map(|event| event.strip_prefix("Entry(")?.strip_suffix(')')).collect()
}

/// States that have gone, by entries of the diagnostic buffer.
fn gone(log: &CpLog) -> Vec<&str> {
    log.events.iter().filter_map(|event| event.strip_prefix("EntryGone(")?.strip_suffix(')')).collect()
}

fn interrupts(log: &CpLog) -> Vec<&String> {
    log.events.iter().filter(|event| event.starts_with("Diagnosis")).collect()
}

#[test]
fn start_stop_and_parameters_are_entered() {
    let (mut cp, mut log) = (Cp341::new(), CpLog::default());
    cp.step(Instant::START, CpInput::Keys(Ok(&parameters(9600))), &mut log);
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    cp.step(Instant::from_millis(1), CpInput::CpuRun(false), &mut log);
    // STOP -> RUN sends the same parameters again.
    cp.step(Instant::from_millis(1), CpInput::Keys(Ok(&parameters(9600))), &mut log);
    cp.step(Instant::from_millis(1), CpInput::CpuRun(true), &mut log);
    cp.step(Instant::from_millis(1), CpInput::Keys(Ok(&parameters(19_200))), &mut log);
    assert_eq!(entries(&log), ["3", "8", "7", "4", "8", "3"]);
    assert_eq!(log.settings.iter().map(|line| line.baud).collect::<Vec<_>>(), [9600, 19_200]);
}

#[test]
fn without_parameters_a_job_ends_with_0502() {
    let (mut cp, mut log) = (Cp341::new(), CpLog::default());
    let wrong = Parameters::from_keys([]).expect_err("nothing is no parameters");
    cp.step(Instant::START, CpInput::Keys(Err(&wrong)), &mut log);
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    let mut block: ChannelBlock = [0; 64];
    (block[0], block[3]) = (1, 7);
    cp.step(Instant::START, CpInput::Channel(Channel::Send, &block), &mut log);
    // A job of one byte.
    (block[0], block[5], block[8], block[11]) = (4, 1, b'S', 1);
    cp.step(Instant::START, CpInput::Channel(Channel::Send, &block), &mut log);
    assert_eq!(entries(&log), [0x020F.to_string(), "8".into(), 0x0502.to_string()]);
    assert!(!cp.is_working());
}

/// A diagnostic interrupt with its data.
fn told(incoming: bool, data: [u8; 6]) -> String {
    format!("Diagnosis {{ incoming: {incoming}, data: {data:?} }}")
}

const NONE: [u8; 6] = [0, 0x0C, 0, 0, 0, 0];
const WIRE_BREAK: [u8; 6] = [0x25, 0x0C, 0x02, 0, 0, 0];
const PARAMETERS: [u8; 6] = [0x83, 0x0C, 0, 0, 0x02, 0x0F];

/// A working CP, its CPU in RUN, diagnostic interrupts enabled.
fn running() -> (Cp341, CpLog) {
    let (mut cp, mut log) = (Cp341::new(), CpLog::default());
    cp.enable_diagnostics(true);
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    cp.step(Instant::START, CpInput::Keys(Ok(&parameters(9600))), &mut log);
    (cp, log)
}

fn wrong() -> ob1_params::ParamError {
    Parameters::from_keys([]).expect_err("nothing is no parameters")
}

#[test]
fn wire_break_and_wrong_parameters_raise_a_diagnostic_interrupt() {
    let (mut cp, mut log) = running();
    assert_eq!(interrupts(&log), Vec::<&String>::new());
    for _ in 0..2 {
        cp.step(Instant::START, CpInput::Line(LineInput::Fault(LineFault::Gone)), &mut log);
    }
    cp.step(Instant::from_millis(1), CpInput::Line(LineInput::Fault(LineFault::Back)), &mut log);
    cp.step(Instant::from_millis(1), CpInput::Keys(Err(&wrong())), &mut log);
    cp.step(Instant::from_millis(1), CpInput::Line(LineInput::Fault(LineFault::Gone)), &mut log);
    cp.step(Instant::from_millis(1), CpInput::Keys(Ok(&parameters(9600))), &mut log);
    let expected = [
        told(true, WIRE_BREAK),
        told(false, NONE),
        told(true, PARAMETERS),
        told(true, [0xA7, 0x0C, 0x02, 0, 0x02, 0x0F]),
        told(false, WIRE_BREAK),
    ];
    assert_eq!(interrupts(&log), expected.iter().collect::<Vec<_>>());
    let records: Vec<[u8; 4]> = log.records.iter().map(|record| [record[0], record[1], record[2], record[3]]).collect();
    let shown = [0x25_0C_02_00_u32, 0x00_0C_00_00, 0x83_0C_00_00, 0xA7_0C_02_00, 0x25_0C_02_00].map(u32::to_be_bytes);
    assert_eq!((records[0], &records[1..]), ([0, 0x0C, 0, 0], &shown[..]));
    assert!(log.records.iter().all(|record| record.len() == 16 && record[4..] == [0; 12]), "no channel information");
    assert_eq!(entries(&log)[2..], [0x080D.to_string(), 0x020F.to_string(), 0x080D.to_string(), "3".into()]);
    assert_eq!(gone(&log), [0x080D.to_string(), 0x020F.to_string()]);
}

#[test]
fn a_line_that_comes_later_is_no_wire_break_and_one_that_never_comes_is() {
    let (mut cp, mut log) = running();
    let before = entries(&log).len();
    cp.step(Instant::START, CpInput::NoLine, &mut log);
    cp.step(Instant::from_millis(1), CpInput::Line(LineInput::TxDone), &mut log);
    cp.step(Instant::from_secs(1), CpInput::Tick, &mut log);
    assert_eq!((interrupts(&log).len(), entries(&log).len(), log.leds.error), (0, before, false));
    cp.step(Instant::from_secs(1), CpInput::Line(LineInput::Fault(LineFault::Back)), &mut log);
    assert_eq!((interrupts(&log).len(), entries(&log).len()), (0, before));
    cp.step(Instant::from_secs(2), CpInput::Line(LineInput::Fault(LineFault::Gone)), &mut log);
    assert_eq!(interrupts(&log), [&told(true, WIRE_BREAK)]);

    let (mut cp, mut log) = running();
    cp.step(Instant::START, CpInput::NoLine, &mut log);
    cp.step(Instant::from_secs(5), CpInput::Line(LineInput::Fault(LineFault::Gone)), &mut log);
    assert_eq!(interrupts(&log), [&told(true, WIRE_BREAK)]);
}

/// As on a pty: nothing holds the program back. [TIA help "PtP data link CP 341"]
#[test]
fn a_line_without_modem_lines_shows_them_on() {
    let mut log = running().1;
    let mut cp = Cp341::new();
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    cp.step(Instant::START, CpInput::Keys(Ok(&parameters(9600))), &mut log);
    cp.step(Instant::from_millis(40), CpInput::Tick, &mut log);
    let image = log.inputs.first().copied().unwrap_or_default();
    assert_eq!(image & 0b01_1010, 0b01_1010, "DSR, CTS, DCD: {image:06b}");
}

#[test]
fn nothing_is_told_unless_enabled_and_the_record_is_there_all_the_same() {
    let (mut cp, mut log) = (Cp341::new(), CpLog::default());
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    cp.step(Instant::START, CpInput::Line(LineInput::Fault(LineFault::Gone)), &mut log);
    assert_eq!(interrupts(&log), Vec::<&String>::new());
    assert_eq!(log.records.last().map(|record| record[0]), Some(0x25));
}

/// [CP 341 manual 09/2008, p. 204]
#[test]
fn what_comes_and_goes_in_stop_is_not_told_and_what_is_there_in_run_is() {
    let (mut cp, mut log) = running();
    let line = |fault| CpInput::Line(LineInput::Fault(fault));
    cp.step(Instant::START, CpInput::CpuRun(false), &mut log);
    cp.step(Instant::START, line(LineFault::Gone), &mut log);
    cp.step(Instant::START, line(LineFault::Back), &mut log);
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    assert_eq!(interrupts(&log), Vec::<&String>::new(), "it came and went in STOP");
    cp.step(Instant::START, line(LineFault::Gone), &mut log);
    cp.step(Instant::START, CpInput::CpuRun(false), &mut log);
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    assert_eq!(interrupts(&log), [&told(true, WIRE_BREAK), &told(true, WIRE_BREAK)], "it is still there");
    cp.step(Instant::START, CpInput::CpuRun(false), &mut log);
    cp.step(Instant::START, line(LineFault::Back), &mut log);
    cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    assert_eq!(interrupts(&log).len(), 2, "it went in STOP");
}

#[test]
fn a_break_lasts_until_characters_come_again() {
    let (mut cp, mut log) = running();
    cp.step(Instant::from_secs(1), CpInput::Line(LineInput::Fault(LineFault::Break)), &mut log);
    assert_eq!((interrupts(&log), log.leds.error), (vec![&told(true, WIRE_BREAK)], true));
    cp.step(Instant::from_secs(100), CpInput::Tick, &mut log);
    assert!(log.leds.error);
    cp.step(Instant::from_secs(100), CpInput::Line(LineInput::Rx(b"x")), &mut log);
    assert_eq!((interrupts(&log).len(), log.leds.error), (2, false));
    assert_eq!(
        (entries(&log)[2..].to_vec(), gone(&log)),
        (vec!["2061", "2050"], vec!["2061"]),
        "080D, 0802, 080D gone"
    );
}

/// [S4 "Diagnostics via Display Elements (LEDs)"]
#[test]
fn sf_is_lit_until_initialised_with_new_and_with_wrong_parameters() {
    let (mut cp, mut log) = (Cp341::new(), CpLog::default());
    let due = cp.step(Instant::START, CpInput::CpuRun(true), &mut log);
    assert_eq!((log.leds.error, due), (true, Some(Instant::from_millis(20))), "switched on; V24_STAT is due");
    cp.step(Instant::from_secs(10), CpInput::Tick, &mut log);
    assert!(log.leds.error, "for as long as there are no parameters");
    let lit_for = |cp: &mut Cp341, log: &mut CpLog, from: Instant, baud| {
        cp.step(from, CpInput::Keys(Ok(&parameters(baud))), log);
        let lit = log.leds.error;
        cp.step(from + 500 * MS - Span::from_nanos(1), CpInput::Tick, log);
        let still = log.leds.error;
        cp.step(from + 500 * MS, CpInput::Tick, log);
        (lit, still, log.leds.error)
    };
    assert_eq!(lit_for(&mut cp, &mut log, Instant::from_secs(11), 9600), (true, true, false));
    assert_eq!(
        lit_for(&mut cp, &mut log, Instant::from_secs(12), 19_200),
        (true, true, false),
        "new ones: again, briefly"
    );
    cp.step(Instant::from_secs(20), CpInput::Keys(Ok(&parameters(19_200))), &mut log);
    assert!(!log.leds.error, "the same ones");
    cp.step(Instant::from_secs(21), CpInput::Keys(Err(&wrong())), &mut log);
    cp.step(Instant::from_secs(99), CpInput::Tick, &mut log);
    assert!(log.leds.error);
    cp.step(Instant::from_secs(99), CpInput::Keys(Ok(&parameters(9600))), &mut log);
    cp.step(Instant::from_secs(100), CpInput::Tick, &mut log);
    assert!(!log.leds.error);
}

#[test]
fn sf_shows_a_line_that_is_gone_and_no_telegram_that_fails() {
    let (mut cp, mut log) = running();
    cp.step(Instant::from_secs(1), CpInput::Tick, &mut log);
    let mut lit_after = |cp: &mut Cp341, fault| {
        cp.step(Instant::from_secs(2), CpInput::Line(LineInput::Fault(fault)), &mut log);
        log.leds.error
    };
    let faults = [LineFault::Parity, LineFault::Framing, LineFault::Overrun, LineFault::Gone, LineFault::Back];
    assert_eq!(faults.map(|fault| lit_after(&mut cp, fault)), [false, false, false, true, false]);
}

/// "... or CTS or DSR signals not asserted at the connector" [S4 L1703], for the driver that uses them.
#[test]
fn sf_shows_signals_that_broke_a_transmission_off() {
    let (mut cp, mut log) = running();
    let keys = [("protocol", Value::from("modbus-ascii-master-32")), ("rs232_signals", Value::from("yes"))];
    let master = Parameters::from_keys(keys).expect("they are good");
    cp.step(Instant::from_secs(1), CpInput::Keys(Ok(&master)), &mut log);
    let lines = |on| CpInput::Line(LineInput::Modem(ModemLines { cts: on, dsr: true, ri: false, cd: false }));
    cp.step(Instant::from_secs(1), lines(true), &mut log);
    let mut block: ChannelBlock = [0; 64];
    (block[0], block[3]) = (1, 7);
    cp.step(Instant::from_secs(2), CpInput::Channel(Channel::Send, &block), &mut log);
    // A job of 6 bytes: registers 0 and 1 of slave 1.
    (block[0], block[5], block[8], block[9], block[11]) = (4, 1, b'S', b'X', 6);
    block[32..38].copy_from_slice(&[1, 3, 0, 0, 0, 2]);
    cp.step(Instant::from_secs(2), CpInput::Channel(Channel::Send, &block), &mut log);
    cp.step(Instant::from_secs(3), CpInput::Tick, &mut log);
    assert!(log.leds.transmit && !log.leds.error, "after the data output waiting time: {:?}", log.events);
    cp.step(Instant::from_secs(3), lines(false), &mut log);
    assert_eq!((entries(&log).last(), log.leds.error), (Some(&"2072"), true), "0818h");
    cp.step(Instant::from_secs(4), lines(true), &mut log);
    assert!(!log.leds.error);
}

#[test]
fn txd_and_rxd_are_lit_while_characters_go() {
    let (mut cp, mut log) = running();
    // A NAK at the start.
    cp.step(Instant::from_secs(1), CpInput::Line(LineInput::TxDone), &mut log);
    assert_eq!((log.leds.transmit, log.leds.receive), (false, false));
    log.wire.tx.clear();
    // STX of the partner: the CP answers DLE.
    cp.step(Instant::from_secs(1), CpInput::Line(LineInput::Rx(&[0x02])), &mut log);
    assert_eq!((log.leds.transmit, log.leds.receive, &log.wire.tx[..]), (true, true, &[0x10][..]));
    cp.step(Instant::START + SECOND + MS, CpInput::Line(LineInput::TxDone), &mut log);
    assert_eq!((log.leds.transmit, log.leds.receive), (false, true));
    cp.step(Instant::START + SECOND + 50 * MS, CpInput::Tick, &mut log);
    assert!(!log.leds.receive);
}

#[test]
fn outputs_are_off_at_power_on_and_the_programs_afterwards() {
    let (mut cp, mut log) = (Cp341::new(), CpLog::default());
    cp.step(Instant::START, CpInput::Keys(Ok(&parameters(9600))), &mut log);
    assert_eq!((log.wire.rts, log.wire.dtr, log.inputs.len()), (Some(false), Some(false), 0));
    let mut outputs = [0; 16];
    outputs[0] = 0x85;
    let due = cp.step(Instant::from_millis(1), CpInput::Outputs(&outputs), &mut log);
    assert_eq!((log.wire.rts, log.wire.dtr), (Some(true), Some(true)));
    let lines = ModemLines { cts: true, dsr: true, ri: true, cd: true };
    cp.step(Instant::from_millis(2), CpInput::Line(LineInput::Modem(lines)), &mut log);
    assert!(log.inputs.is_empty(), "the image is refreshed every 20 ms");
    assert!(due.is_some_and(|due| due <= Instant::from_millis(20)));
    cp.step(Instant::from_millis(20), CpInput::Tick, &mut log);
    assert_eq!(log.inputs[0], 0b11_1111);
    outputs[0] = 0x80;
    cp.step(Instant::from_millis(21), CpInput::Outputs(&outputs), &mut log);
    assert_eq!((log.wire.rts, log.wire.dtr), (Some(false), Some(false)));
    cp.step(Instant::from_millis(40), CpInput::Tick, &mut log);
    assert_eq!(log.inputs[0], 0b11_1010);
}

#[test]
fn a_job_from_before_a_stop_does_not_end_the_first_one_after_it() {
    let (mut cp, mut log) = running();
    // The blocks begin with the same numbers after each STOP: start 1, job 1.
    let give = |cp: &mut Cp341, log: &mut CpLog, at: Span, data: u8| {
        let mut block: ChannelBlock = [0; 64];
        (block[0], block[3]) = (1, 1);
        cp.step(Instant::START + at, CpInput::Channel(Channel::Send, &block), log);
        (block[0], block[5], block[8], block[9], block[11], block[32]) = (4, 1, b'S', b'X', 1, data);
        cp.step(Instant::START + at, CpInput::Channel(Channel::Send, &block), log);
    };
    let hears = |cp: &mut Cp341, log: &mut CpLog, at: Span, byte: u8| {
        cp.step(Instant::START + at, CpInput::Line(LineInput::TxDone), log);
        cp.step(Instant::START + at, CpInput::Line(LineInput::Rx(&[byte])), log);
    };
    const DLE: u8 = 0x10;
    const RUNNING: u8 = 3;
    const DONE: u8 = 5;
    give(&mut cp, &mut log, SECOND, 0xAA);
    hears(&mut cp, &mut log, SECOND + MS, DLE);
    cp.step(Instant::START + SECOND + 2 * MS, CpInput::CpuRun(false), &mut log);
    cp.step(Instant::START + SECOND + 3 * MS, CpInput::CpuRun(true), &mut log);
    give(&mut cp, &mut log, SECOND + 4 * MS, 0xBB);
    log.wire.tx.clear();
    hears(&mut cp, &mut log, SECOND + 10 * MS, DLE);
    assert_eq!(log.events.iter().filter(|event| *event == "Sent").count(), 1, "{:?}", log.events);
    assert_eq!(log.channel_block(Channel::Send)[0], RUNNING, "the partner does not have the second job");
    assert_eq!(log.wire.tx, [0x02], "now it is its turn");
    hears(&mut cp, &mut log, SECOND + 11 * MS, DLE);
    hears(&mut cp, &mut log, SECOND + 20 * MS, DLE);
    assert_eq!(log.channel_block(Channel::Send)[0], DONE);
}
