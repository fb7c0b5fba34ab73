//! The RS 232 secondary signals of a whole CP 341 on a line that has them: automatic use by the ASCII driver and by the
//! loadable Modbus driver, V24_SET and V24_STAT beside it, BREAK. [S4 "4.3 RS 232C Secondary Signals"],
//! [TIA help "PtP data link CP 341"], [TIA help "Configuration for point-to-point links"]

use ob1_firmware::{Reason, Span, Why};
use ob1_params::Value;

use crate::cp341_bench::{Bench, Got, MS};

const OUTPUT_WAIT: Span = Span::from_millis(50);
const RTS_OFF: Span = Span::from_millis(30);

/// Bits of V24_STAT.
const DTR: u8 = 1 << 0;
const DSR: u8 = 1 << 1;
const RTS: u8 = 1 << 2;
const CTS: u8 = 1 << 3;
const DCD: u8 = 1 << 4;

fn bench(keys: &[(&'static str, Value)]) -> Bench {
    Bench::new(keys)
}

/// Both times with the keys of a protocol.
fn automatic(protocol: &str) -> Bench {
    bench(&[
        ("protocol", protocol.into()),
        ("rs232_signals", "yes".into()),
        ("output_wait_ms", Value::Int(50)),
        ("rts_off_ms", Value::Int(30)),
    ])
}

const ASCII: &str = "ascii";
const MODBUS: &str = "modbus-ascii-master-32";

/// A job and its characters on the line.
fn job_of(protocol: &str) -> (&'static [u8], &'static [u8]) {
    match protocol {
        ASCII => (b"Hello", b"Hello"),
        // Function 05 to all slaves: no answer.
        _ => (&[0, 5, 0, 0x19, 0xFF, 0], b":00050019FF00E3\r\n"),
    }
}

/// "As soon as the CP is switched to automatic use, it switches RTS to OFF and DTR to ON"; V24_SET has no effect,
/// V24_STAT has. [S4 L803], [S4 L811]
#[test]
fn v24_set_is_without_effect_and_v24_stat_is_not() {
    for protocol in [ASCII, MODBUS] {
        let mut bench = automatic(protocol);
        assert_eq!(bench.outputs(), (false, true));
        bench.v24_set(true, false);
        assert_eq!(bench.outputs(), (false, true));
        assert_eq!(bench.v24_stat(), DTR | DSR | CTS | DCD);
        bench.switches(false, false);
        assert_eq!(bench.v24_stat(), DTR);
    }
    // With RTS/CTS flow control the program does not control RTS, but it controls DTR.
    // [TIA help "PtP data link CP 341"]
    let mut bench = bench(&[("protocol", ASCII.into()), ("flow", "rts-cts".into())]);
    bench.v24_set(false, true);
    assert_eq!((bench.outputs(), bench.v24_stat() & (RTS | DTR)), ((true, true), RTS | DTR));
}

/// Without automatic use the program controls them, and CTS and DSR are not checked. [S4 L590]
#[test]
fn without_automatic_use_they_are_the_programs() {
    for protocol in [ASCII, MODBUS] {
        let mut bench = bench(&[("protocol", protocol.into())]);
        assert_eq!(bench.outputs(), (false, false));
        bench.switches(false, false);
        let (job, frame) = job_of(protocol);
        assert_eq!((bench.job(job), bench.heard()), (Ok(()), frame.to_vec()));
        bench.v24_set(true, true);
        assert_eq!(bench.outputs(), (true, true));
    }
}

/// RTS ON, waiting time, the characters, time to RTS OFF: figure 4-1 on the line. [S4 L813], [S4 L815]
#[test]
fn both_times_on_the_line() {
    for protocol in [ASCII, MODBUS] {
        let mut bench = automatic(protocol);
        let (job, frame) = job_of(protocol);
        let begin = bench.now;
        bench.send(job);
        assert_eq!(bench.outputs(), (true, true), "{protocol}");
        let out = frame.len() as u64 * bench.char_time();
        bench.pass(OUTPUT_WAIT + out);
        assert_eq!(bench.heard[0].0, begin + OUTPUT_WAIT + bench.char_time(), "{protocol}");
        assert_eq!(bench.heard(), frame, "{protocol}");
        bench.pass(RTS_OFF - Span::from_nanos(1));
        assert!(bench.outputs().0, "{protocol}: RTS is ON still");
        bench.pass(Span::from_nanos(1));
        assert!(!bench.outputs().0, "{protocol}: and OFF now");
        bench.pass(100 * MS);
        assert_eq!((bench.sent(), bench.entries()), (Some(Ok(())), vec![]), "{protocol}");
    }
}

/// 0818h at P_SND_RK and in the diagnostic buffer, RTS OFF at once. [S4 L814], [S4 L817], [S4 L1751]
#[test]
fn cts_or_dsr_off_ends_a_job_with_0818h() {
    for protocol in [ASCII, MODBUS] {
        let (job, frame) = job_of(protocol);
        let off = |bench: &mut Bench, when: &str| {
            assert_eq!((bench.sent(), bench.outputs().0), (Some(Err(0x0818)), false), "{protocol}, {when}");
            assert_eq!(bench.entries(), [0x0818], "{protocol}, {when}");
            bench.switches(true, true);
            bench.pass(100 * MS);
            bench.heard();
        };
        let mut bench = automatic(protocol);
        bench.switches(false, true);
        bench.send(job);
        bench.pass(OUTPUT_WAIT - Span::from_nanos(1));
        assert_eq!(bench.sent(), None);
        bench.pass(Span::from_nanos(1));
        off(&mut bench, "CTS not ON in time");
        bench.switches(true, false);
        bench.send(job);
        off(&mut bench, "DSR OFF before");
        bench.send(job);
        bench.pass(OUTPUT_WAIT / 2);
        bench.switches(true, false);
        off(&mut bench, "DSR OFF while waiting for CTS");
        for (rts, dtr) in [(false, true), (true, false)] {
            bench.send(job);
            bench.pass(OUTPUT_WAIT + 3 * bench.char_time() / 2);
            bench.switches(rts, dtr);
            off(&mut bench, "OFF while sending");
        }
        // Only characters already begun were sent: two of each. And the CP still works.
        assert_eq!((bench.job(job), bench.heard()), (Ok(()), frame.to_vec()), "{protocol}");
    }
}

#[test]
fn what_is_leaving_is_taken_back() {
    let mut bench = automatic(ASCII);
    bench.send(b"Hello");
    bench.pass(OUTPUT_WAIT + 3 * bench.char_time() / 2);
    bench.switches(false, true);
    bench.pass(100 * MS);
    assert_eq!(bench.heard(), b"He");
}

/// "Data receipt is aborted with an error message if DSR changes from ON to OFF." [S4 L817] Before that nothing is
/// received. [S4 L816]
#[test]
fn dsr_off_ends_what_is_received() {
    let mut bench = automatic(ASCII);
    bench.has_said(b"one");
    bench.pass(10 * MS);
    assert_eq!(bench.all(), [Got::Telegram(b"one".to_vec())]);
    bench.has_said(b"tw");
    bench.switches(true, false);
    bench.has_said(b"o");
    bench.pass(10 * MS);
    assert_eq!((bench.all(), bench.entries()), (vec![Got::Error(0x0818)], vec![0x0818]));
    bench.has_said(b"not heard");
    bench.pass(10 * MS);
    bench.switches(true, true);
    bench.has_said(b"three");
    bench.pass(10 * MS);
    assert_eq!((bench.all(), bench.entries()), (vec![Got::Telegram(b"three".to_vec())], vec![]));

    let mut bench = automatic(MODBUS);
    bench.send(&[5, 7]);
    bench.pass(OUTPUT_WAIT + 20 * MS);
    bench.says(b":05073E");
    bench.pass(3 * bench.char_time());
    bench.switches(true, false);
    assert_eq!((bench.sent(), bench.entries()), (Some(Err(0x0818)), vec![0x0818]));
    assert_eq!(bench.all(), []);
}

/// [S4 L727], [S4 L538]: BREAK while the request is sent, while the reply is awaited, and outside a job.
#[test]
fn break_ends_a_job_of_the_loadable_driver() {
    let mut bench = bench(&[("protocol", MODBUS.into())]);
    bench.send(&[5, 7]);
    bench.pass(2 * bench.char_time());
    bench.breaks();
    bench.pass(10 * MS);
    assert_eq!((bench.sent(), bench.entries()), (Some(Err(0x080D)), vec![0x080D]));
    assert!(bench.heard().len() < 13, "the rest was taken back");
    bench.send(&[5, 7]);
    bench.pass(100 * MS);
    bench.breaks();
    bench.pass(10 * MS);
    assert_eq!((bench.sent(), bench.entries()), (Some(Err(0x080D)), vec![0x080D]));
    bench.breaks();
    bench.pass(10 * MS);
    assert_eq!((bench.sent(), bench.entries()), (None, vec![0x080D]), "normal operation tells of it in idle, too");
    assert!(bench.sf(), "BREAK lights SF [S4 L1703]");
    assert_eq!(bench.reason(), Some(Reason::state(Why::Interrupted, 0)));
    let quiet = ("operating_mode", Value::from("interference-suppression"));
    let mut bench = Bench::new(&[("protocol", MODBUS.into()), quiet]);
    bench.send(&[5, 7]);
    bench.pass(100 * MS);
    bench.pass(500 * MS);
    bench.breaks();
    bench.pass(100 * MS);
    // "no error is reported" [S4 L539], by the LED neither.
    assert_eq!((bench.sf(), bench.reason()), (false, None));
    bench.has_said(b":05073EB6\r\n");
    assert_eq!(bench.all(), [Got::Telegram(vec![0x3E])]);
    assert_eq!((bench.sent(), bench.entries()), (Some(Ok(())), vec![]), "a reply begins with its colon");
}
