//! The CP 341 beside its telegrams: entries of its diagnostic buffer, diagnostic interrupts, accompanying signals, jobs without
//! parameters. [reference 1.6, 1.9, 2]

mod common;

use common::{Log, MS};
use ob1_firmware::cp341::{Channel, ChannelBlock, Cp341, Input341};
use ob1_firmware::{LineFault, LineInput, ModemLines};
use ob1_params::{Cp341 as Parameters, Value};

fn parameters(baud: i64) -> Parameters {
    Parameters::from_keys([("protocol", Value::from("3964r")), ("baud", Value::Int(baud))]).expect("they are good")
}

/// Entries of the diagnostic buffer, oldest first.
fn entries(log: &Log) -> Vec<&str> {
    log.events.iter().filter_map(|event| event.strip_prefix("Entry(")?.strip_suffix(')')).collect()
}

fn interrupts(log: &Log) -> Vec<&String> {
    log.events.iter().filter(|event| event.starts_with("Diagnosis")).collect()
}

#[test]
fn start_stop_and_parameters_are_entered() {
    let (mut cp, mut log) = (Cp341::new(), Log::default());
    cp.step(0, Input341::Parameters(Ok(&parameters(9600))), &mut log);
    cp.step(0, Input341::CpuRun(true), &mut log);
    cp.step(MS, Input341::CpuRun(false), &mut log);
    // STOP -> RUN sends the same ones again.
    cp.step(MS, Input341::Parameters(Ok(&parameters(9600))), &mut log);
    cp.step(MS, Input341::CpuRun(true), &mut log);
    cp.step(MS, Input341::Parameters(Ok(&parameters(19_200))), &mut log);
    assert_eq!(entries(&log), ["3", "8", "7", "4", "8", "3"]);
    assert_eq!(log.settings.iter().map(|line| line.baud).collect::<Vec<_>>(), [9600, 19_200]);
}

#[test]
fn without_parameters_a_job_ends_with_0502() {
    let (mut cp, mut log) = (Cp341::new(), Log::default());
    let wrong = Parameters::from_keys([]).expect_err("nothing is no parameters");
    cp.step(0, Input341::Parameters(Err(&wrong)), &mut log);
    cp.step(0, Input341::CpuRun(true), &mut log);
    let mut block: ChannelBlock = [0; 64];
    (block[0], block[3]) = (1, 7);
    cp.step(0, Input341::Channel(Channel::Send, &block), &mut log);
    // A job of one byte.
    (block[0], block[5], block[8], block[11]) = (4, 1, b'S', 1);
    cp.step(0, Input341::Channel(Channel::Send, &block), &mut log);
    assert_eq!(entries(&log), [0x020F.to_string(), "8".into(), 0x0502.to_string()]);
    assert!(!cp.is_working());
}

#[test]
fn wire_break_and_wrong_parameters_raise_a_diagnostic_interrupt() {
    let (mut cp, mut log) = (Cp341::new(), Log::default());
    cp.enable_diagnostics(true);
    cp.step(0, Input341::Parameters(Ok(&parameters(9600))), &mut log);
    for _ in 0..2 {
        cp.step(0, Input341::Line(LineInput::Fault(LineFault::Gone)), &mut log);
    }
    assert_eq!(interrupts(&log), ["Diagnosis { incoming: true, data: [37, 12, 2, 0, 0, 0] }"], "25 0C 02 00, once");
    cp.step(MS, Input341::Line(LineInput::Fault(LineFault::Back)), &mut log);
    let wrong = Parameters::from_keys([]).expect_err("nothing is no parameters");
    cp.step(MS, Input341::Parameters(Err(&wrong)), &mut log);
    cp.step(MS, Input341::Parameters(Ok(&parameters(9600))), &mut log);
    let gone = "Diagnosis { incoming: false, data: [0, 12, 0, 0, 0, 0] }";
    assert_eq!(interrupts(&log)[1..], [gone, "Diagnosis { incoming: true, data: [131, 12, 0, 0, 2, 15] }", gone]);
    let (mut cp, mut log) = (Cp341::new(), Log::default());
    cp.step(0, Input341::Line(LineInput::Fault(LineFault::Gone)), &mut log);
    assert_eq!(interrupts(&log), Vec::<&String>::new(), "not unless enabled");
}

#[test]
fn outputs_are_off_at_power_on_and_the_programs_afterwards() {
    let (mut cp, mut log) = (Cp341::new(), Log::default());
    cp.step(0, Input341::Parameters(Ok(&parameters(9600))), &mut log);
    assert_eq!((log.rts, log.dtr, log.inputs[0]), (Some(false), Some(false), 0));
    let mut outputs = [0; 16];
    outputs[0] = 0x85;
    let due = cp.step(MS, Input341::Outputs(&outputs), &mut log);
    assert_eq!((log.rts, log.dtr), (Some(true), Some(true)));
    let lines = ModemLines { cts: true, dsr: true, ri: true, cd: true };
    cp.step(2 * MS, Input341::Line(LineInput::Modem(lines)), &mut log);
    assert_eq!(log.inputs[0], 0, "the image is refreshed every 20 ms");
    assert!(due.is_some_and(|due| due <= 20 * MS));
    cp.step(20 * MS, Input341::Tick, &mut log);
    assert_eq!(log.inputs[0], 0b11_1111);
    outputs[0] = 0x80;
    cp.step(21 * MS, Input341::Outputs(&outputs), &mut log);
    assert_eq!((log.rts, log.dtr), (Some(false), Some(false)));
    cp.step(40 * MS, Input341::Tick, &mut log);
    assert_eq!(log.inputs[0], 0b11_1010);
}
