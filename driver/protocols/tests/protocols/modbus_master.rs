//! The Modbus master: every branch of the manual's text as a message table. One character takes 1 ms, so RTU telegrams
//! are 3.5 ms apart. [S0 "Modbus - Deployment"], [S0 "Modbus - Error messages"]

use ob1_protocols::modbus::master::{Config, automatic_wait};
use ob1_protocols::modbus::{Failure, Master, Mode, frame};
use ob1_protocols::{MS, Span};

use crate::common::check;

/// A delay time of 200 ms.
fn master(mode: Mode) -> Master {
    Master::new(Config::cp240(frame::Config::new(mode, 9600, MS), 9600, 200))
}

fn rtu(table: &str) {
    check(&mut master(Mode::Rtu), table);
}

fn ascii(table: &str) {
    check(&mut master(Mode::Ascii), table);
}

/// The text of a failure in the notation of the tables.
fn text(failure: Failure) -> String {
    failure.telegram().iter().map(|b| format!("{b:02X} ")).collect()
}

/// [S0 "Delay time"]
#[test]
fn the_automatic_delay_time() {
    for (baud, ascii_us, rtu_us) in
        [(2400, 1_269_166, 2_212_500), (9600, 354_791, 590_625), (19_200, 202_395, 320_312), (38_400, 126_197, 185_156)]
    {
        assert_eq!(automatic_wait(Mode::Ascii, baud).micros(), ascii_us, "{baud}");
        assert_eq!(automatic_wait(Mode::Rtu, baud).micros(), rtu_us, "{baud}");
    }
    let config = |wait_ms| Config::cp240(frame::Config::new(Mode::Rtu, 9600, MS), 9600, wait_ms).wait;
    assert_eq!(config(0), automatic_wait(Mode::Rtu, 9600));
    assert_eq!(config(60_000), 60_000 * MS);
}

/// The silences of RTU: 3.5 and 1.5 characters up to 19200 bit/s, 1.75 and 0.75 ms above.
#[test]
fn silences() {
    let config = |baud| frame::Config::new(Mode::Rtu, baud, MS);
    assert_eq!((config(19_200).silence, config(19_200).gap), (Span::from_micros(3_500), Span::from_micros(1_500)));
    assert_eq!((config(38_400).silence, config(38_400).gap), (Span::from_micros(1_750), Span::from_micros(750)));
    let late = config(9600).with_bursts(20 * MS);
    assert_eq!([late.silence, late.gap, late.patience], [3_500, 21_500, 23_500].map(Span::from_micros));
}

/// [S0 "Master-Slave-Communication"]; the answer is delivered without its check, after 3.5 characters of silence.
#[test]
fn a_request_and_its_answer() {
    rtu("0     start
         10    order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         18    done
         30    rx 01
         31    rx 03
         32    rx 02
         33    rx 12
         34    rx 34
         35    rx B5
         37    rx 33
         40.5  timeout               => got 01 03 02 12 34, sent ok");
    ascii(
        "0  start
         10 order 01 03 00 00 00 01 => tx 3A 30 31 30 33 30 30 30 30 30 30 30 31 46 42 0D 0A
         27 done
         30 rx 3A 30 31 30 33 30 32
         900 rx 31 32 33 34 42 34 0D # within a second
         901 rx 0A                   => got 01 03 02 12 34, sent ok",
    );
}

/// The slave's error message is an answer. [S0 "Slave answers with error message"]
#[test]
fn an_exception_is_handed_up() {
    rtu("0    start
         10   order 05 10 00 00 00 01 02 00 00 => tx 05 10 00 00 00 01 02 00 00 94 90
         21   done
         30   rx 05 90 02 8C 00
         33.5 timeout => got 05 90 02, sent ok");
}

/// "No telegram arrived within the specified delay time." It runs from the last bit of the request.
#[test]
fn no_data() {
    rtu(&format!(
        "0   start
         10  order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         18  done
         218 timeout => !Acknowledge: Modbus(NoData), got {}, sent AckDelay",
        text(Failure::NoData)
    ));
    ascii(&format!(
        "0   start
         10  order 01 01 00 00 00 01 => tx 3A 30 31 30 31 30 30 30 30 30 30 30 31 46 44 0D 0A
         27  done
         227 timeout => !Acknowledge: Modbus(NoData), got {}, sent AckDelay",
        text(Failure::NoData)
    ));
}

/// An answer that has begun in time is received to its end.
#[test]
fn an_answer_in_the_last_moment() {
    rtu("0     start
         10    order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         18    done
         217.5 rx 01
         219.5 rx 03 02
         221.5 rx 12 34
         223.5 rx B5 33
         227   timeout => got 01 03 02 12 34, sent ok");
}

/// Every other failure of a telegram, and the texts. [S0 "Master doesn't receive valid data"]
#[test]
fn failures_of_rtu() {
    let table = [
        // A character that cannot be read.
        ("30 rx 01 03\n31 fault Parity => !Receive: Line(Parity)\n34.5 timeout", Failure::DataLost),
        // Longer than its number of bytes says, with a correct check.
        ("30 rx 01 03 02 12 34 00 F2 B7\n33.5 timeout", Failure::Overflow),
        ("30 rx 01 03 02 12\n33.5 timeout", Failure::Incomplete),
        ("30 rx 01\n33.5 timeout", Failure::Incomplete),
        // A correct check, but shorter than the number of bytes says.
        ("30 rx 01 03 02 12 70 B5\n33.5 timeout", Failure::Incomplete),
        // 1.6 characters of silence within the telegram.
        ("30 rx 01 03 02\n32.6 rx 12\n34 rx 34\n35 rx B5\n36 rx 33\n39.5 timeout", Failure::Incomplete),
        ("30 rx 01 03 02 12 34 B5 32\n33.5 timeout", Failure::Fault),
    ];
    for (step, failure) in table {
        rtu(&format!(
            "0  start
             10 order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
             18 done
             {step} => !Acknowledge: Modbus({failure:?}), got {}, sent Frame",
            text(failure)
        ));
    }
}

#[test]
fn failures_of_ascii() {
    let table = [
        ("30 rx 3A 30 31\n31 fault Framing => !Receive: Line(Framing)\n40 rx 30 33 0D 0A", Failure::DataLost),
        // The end is not recognized: no LF after CR, LF without CR.
        ("30 rx 3A 30 31 30 33 30 30 46 43 0D 30 0A", Failure::Overflow),
        ("30 rx 3A 30 31 30 33 30 30 46 43 0A", Failure::Overflow),
        // Longer than permitted.
        ("600 rx 3A 30 31\n1200 rx 600*30 0D 0A", Failure::Overflow),
        // Half a byte; no CR LF within a second.
        ("30 rx 3A 30 31 30 33 30 0D 0A", Failure::Incomplete),
        ("30 rx 3A 30 31 30 33\n1030 timeout", Failure::Incomplete),
        ("30 rx 3A 30 31 30 33 30 32 31 32 33 34 42 35 0D 0A", Failure::Fault),
        ("30 rx 3A 30 31 30 33 30 32 31 32 33 67 42 34 0D 0A", Failure::Fault),
        ("30 rx 30 31 30 33 30 32 31 32 33 34 42 34 0D 0A", Failure::Start),
    ];
    for (step, failure) in table {
        let mut master = master(Mode::Ascii);
        let step = if step.starts_with("600") {
            step.replace("600 rx", "30 rx").replace("1200 rx", "700 rx")
        } else {
            step.into()
        };
        check(
            &mut master,
            &format!(
                "0  start
                 10 order 01 03 00 00 00 01 => tx 3A 30 31 30 33 30 30 30 30 30 30 30 31 46 42 0D 0A
                 27 done
                 {step} => !Acknowledge: Modbus({failure:?}), got {}, sent Frame",
                text(failure)
            ),
        );
    }
}

/// A `:` begins a telegram, whatever came before: noise when the direction is switched does no harm.
#[test]
fn a_start_character_in_the_middle_begins_anew() {
    ascii(
        "0  start
         10 order 01 03 00 00 00 01 => tx 3A 30 31 30 33 30 30 30 30 30 30 30 31 46 42 0D 0A
         27 done
         28 rx FF 3A 30 35
         50 rx 3A 30 31 30 33 30 32 31 32 33 34 42 34 0D 0A => got 01 03 02 12 34, sent ok",
    );
}

/// "After a broadcast the master is not waiting for a respond telegram." "Only write commands may be sent as
/// broadcast."
#[test]
fn broadcast() {
    rtu("0    start
         10   order 00 06 00 00 00 01 => tx 00 06 00 00 00 01 49 DB
         18   done                    => sent ok
         19   order 00 03 00 00 00 01 => sent NoRequest
         19.5 order 00 08 00 00 00 01 => sent NoRequest
         20   order 00 05 00 00 FF 00
         21.5 timeout                 => tx 00 05 00 00 FF 00 8D EB
         30   done                    => sent ok");
}

/// 3.5 characters of silence are kept before a request: after an answer, and after characters of others.
#[test]
fn silence_before_a_request() {
    rtu("0    start
         10   rx 42
         12   order 00 06 00 00 00 01
         13.5 timeout => tx 00 06 00 00 00 01 49 DB
         22   done    => sent ok
         23   order 00 06 00 00 00 01
         24   rx 42
         25   rx 42
         27   rx 42
         30.5 timeout => tx 00 06 00 00 00 01 49 DB
         40   done    => sent ok");
}

/// A line that never falls silent delays an order by the delay time, not for ever.
#[test]
fn a_line_that_is_never_silent() {
    let jam: String = (0..101).map(|n| format!("{} rx 42\n", 10 + 2 * n)).collect();
    rtu(&format!(
        "0    start
         {jam}
         210  order 00 06 00 00 00 01
         {}
         410  rx 42
         410  timeout => tx 00 06 00 00 00 01 49 DB
         420  done    => sent ok",
        (0..100).map(|n| format!("{} rx 42\n", 211 + 2 * n)).collect::<String>(),
    ));
}

/// An answer that never ends does not delay it for ever either.
#[test]
fn an_answer_without_end() {
    // One burst after the other: silence never lasts 3.5 characters.
    let mut table = String::from(
        "0    start
         10   order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         18   done
         ",
    );
    // 200 ms, twice 519 characters with 1.5 characters of pause, 3.5 ms.
    let end = 18.0 + 200.0 + 2.0 * 519.0 * 2.5 + 3.5;
    let mut at = 20.0;
    while at < end {
        table += &format!("{at} rx 42\n");
        at += 2.0;
    }
    table += &format!("{end} timeout => !Acknowledge: Modbus(Overflow), got {}, sent Frame", text(Failure::Overflow));
    rtu(&table);
}

/// Telegrams of others neither end nor prolong the wait.
#[test]
fn what_is_not_the_answer() {
    rtu(&format!(
        "0    start
         10   order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         18   done
         30   rx 02 03 02 12 34 F1 33 # another slave
         33.5 timeout
         50   rx 01 04 02 12 34 B4 47 # another function
         53.5 timeout
         80   rx 01 03 04 00 00 00 00 FA 33 # two words
         83.5 timeout
         218  timeout => !Acknowledge: Modbus(NoData), got {}, sent AckDelay
         230  rx 01 03 02 12 34 B5 33 # too late
         233.5 timeout",
        text(Failure::NoData)
    ));
}

/// On a two-wire line the master receives its own characters.
#[test]
fn the_own_echo_is_no_answer() {
    rtu("0    start
         10   order 01 06 00 00 00 01 => tx 01 06 00 00 00 01 48 0A
         18   rx 01 06 00 00 00 01 48 0A
         18   done
         30   rx 01 06 00 00 00 01 48 0A
         33.5 timeout => got 01 06 00 00 00 01, sent ok");
}

/// "... because either the receive buffer is full ..."
#[test]
fn no_receive_buffer() {
    rtu(&format!(
        "0    start
         1    room 16
         10   order 01 03 00 00 00 08 => tx 01 03 00 00 00 08 44 0C
         18   done
         49   rx 01 03 10 16*00 E4 59
         52.5 timeout => !Acknowledge: Modbus(DataLost), got {}, sent Frame
         53   room 0
         60   order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         68   done
         268  timeout => !Acknowledge: Modbus(NoData), !Acknowledge: NoBuffer, sent AckDelay",
        text(Failure::DataLost)
    ));
}

#[test]
fn orders_that_are_none() {
    rtu("0    start
         10   order 01                => sent NoRequest
         11   order 258*01            => sent TooLong
         12   order 01 06 00 00 00 01 => tx 01 06 00 00 00 01 48 0A
         13   order 01 06 00 00 00 02 => sent Busy
         14   abort                   => back, sent Aborted
         15   order 01 06 00 00 00 01
         17   abort                   => sent Aborted
         30   order 01 06 00 00 00 01 => tx 01 06 00 00 00 01 48 0A
         38   done
         40   abort                   => sent Aborted
         41   abort");
}

/// A function code other than the eight is sent and received unchanged.
#[test]
fn other_function_codes_pass() {
    rtu("0    start
         10   order 01 08 00 00 A5 37 => tx 01 08 00 00 A5 37 DA 8D
         18   done
         30   rx 01 08 00 00 A5 37 DA 8D
         33.5 timeout => got 01 08 00 00 A5 37, sent ok");
}

/// A line that breaks off ends the telegram, not the wait.
#[test]
fn the_line_goes_and_comes() {
    rtu("0   start
         10  order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         18  done
         30  rx 01 03
         31  fault Gone => !Receive: Line(Gone)
         60  rx 01 03 02 12 34 B5 33
         63.5 timeout => got 01 03 02 12 34, sent ok");
}

/// Without silence a telegram ends with its length and its check, and the next request follows at once.
#[test]
fn without_silence() {
    let frame = frame::Config::new(Mode::Rtu, 9600, MS).without_silence();
    check(
        &mut Master::new(Config::cp240(frame, 9600, 200)),
        &format!(
            "0  start
             10 order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
             18 done
             19 rx 01 03 02 12 34 B5 33 => got 01 03 02 12 34, sent ok
             19 order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
             20 done
             21 rx 01 03 02 12 34 B5 34
             74.5 timeout => !Acknowledge: Modbus(Fault), got {}, sent Frame",
            text(Failure::Fault)
        ),
    );
}

/// A device that hands over characters in bursts: a whole telegram is taken after the silence, an incomplete one is
/// waited for.
#[test]
fn bursts() {
    let frame = frame::Config::new(Mode::Rtu, 9600, MS).with_bursts(20 * MS);
    check(
        &mut Master::new(Config::cp240(frame, 9600, 200)),
        "0  start
         10 order 01 03 00 00 00 01 => tx 01 03 00 00 00 01 84 0A
         18 done
         30 rx 01 03 02
         49 rx 12 34 B5 33
         52.5 timeout => got 01 03 02 12 34, sent ok",
    );
}
