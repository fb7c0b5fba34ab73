//! The loadable driver's procedure: times, faults, operating modes, signals, parameters, and how each job ends.
//! [S4 "4 Transmission Protocol"]

#[allow(dead_code)] // Helpers of the examples.
use ob1_protocols::Span;
use ob1_protocols::modbus_master_32::{Parameters, Parity, Signals, Wiring};

use crate::modbus_master_32_table::check;

fn normal() -> Parameters {
    Parameters::default()
}

fn suppressed() -> Parameters {
    Parameters { operating_mode: Parameters::INTERFERENCE_SUPPRESSION, ..normal() }
}

fn two_wire() -> Parameters {
    Parameters { wiring: Wiring::TWO_WIRE, ..normal() }
}

fn with_signals(rts_off_ms: u32, output_wait_ms: u32) -> Parameters {
    Parameters { signals: Some(Signals { rts_off_ms, output_wait_ms }), ..normal() }
}

/// A reading job up to the end of its request, for tables that begin with the reply.
const ASKED: &str = "
    0 start
    1 job 05 03 0040 0001 => ask 05 03 0040 0001
    20 done
";

fn after_request(parameters: Parameters, table: &str) {
    check(parameters, &format!("{ASKED}{table}"));
}

// ---- jobs ----

/// "... completed after the reply message is received without error and complete transfer of the received data to the
/// CPU" [S4 L1648]
#[test]
fn a_reading_job_ends_when_the_cpu_has_the_data() {
    after_request(
        normal(),
        "
        50 say 05 03 02 1234 => got 1234
        9000 taken => ok
        9001 taken => !0E30     # nobody waits for it [S4 L1784]
        ",
    );
}

/// [S4 L1785], [S4 L1786]
#[test]
fn a_cpu_that_does_not_take_the_data() {
    after_request(normal(), "50 say 05 03 02 1234 => got 1234\n 10050 timeout => fail 0E31\n 10051 taken => !0E30");
    after_request(normal(), "50 say 05 03 02 1234 => got 1234\n 60 refused => fail 0E32");
}

/// "... after a reply message is received without error" [S4 L1642]
#[test]
fn a_writing_job_ends_with_its_reply() {
    check(normal(), "0 start\n 1 job 05 06 0180 3E7F => ask 05 06 0180 3E7F\n 20 done\n 50 say 05 06 0180 3E7F => ok");
}

/// "After the CP has sent the last character of a broadcast message it waits the turnaround delay." [S4 L530]
#[test]
fn a_broadcast_ends_with_the_turnaround_delay() {
    let table = "0 start\n 1 job 00 06 0180 3E7F => ask 00 06 0180 3E7F\n";
    let waits = Parameters { turnaround_ms: 250, ..normal() };
    check(waits, &format!("{table} 20 done\n 30 say 05 06 0180 3E7F\n 270 timeout => ok"));
    let at_once = Parameters { turnaround_ms: 0, ..normal() };
    check(at_once, &format!("{table} 20 done => ok"));
}

/// "An error number corresponding to the received error code is entered in STATUS. No entry is made in a destination
/// data block." [S4 L757]
#[test]
fn an_exception_ends_the_job_without_data() {
    for code in 1..=7 {
        after_request(normal(), &format!("50 say 05 83 {code:02} => fail 0E6{code}"));
    }
}

/// A refused job never reaches the line. [S4 L1620], [S4 L1636]
#[test]
fn a_refused_job_is_not_sent() {
    check(normal(), "0 start\n 1 job 05 => fail 0E40\n 2 job 05 09 => fail 0E42\n 3 typ D 05 07 => fail 0E4F");
    check(normal(), "0 start\n 1 job 4097*05 => fail 0518\n 2 job => fail 0518\n 3 typ x 05 07 => ask 05 07");
}

/// (docs/cp341-events.md)
#[test]
fn a_second_job_and_an_abort() {
    after_request(normal(), "25 job 05 07 => fail 0522\n 50 say 05 03 02 1234 => got 1234\n 60 taken => ok");
    after_request(normal(), "30 abort => fail 0501\n 31 abort\n 40 say 05 03 02 1234");
    // Characters still being sent are finished first.
    check(
        normal(),
        "
        0 start
        1 job 05 07 => ask 05 07
        2 abort => back, fail 0501
        3 job 05 0B
        4 job 05 0B => fail 0522
        9 done => ask 05 0B
        30 done
        40 say 05 0B FEDC 0108 => got FEDC 0108
        41 taken => ok
        ",
    );
}

// ---- times ----

/// "If the start character is not received within the response timeout" [S4 L524]
#[test]
fn response_timeout() {
    after_request(normal(), "2020 timeout => fail 0830");
    after_request(Parameters { response_timeout_ms: 5, ..normal() }, "25 timeout => fail 0830\n 30 say 05 03 02 1234");
    // It monitors only the first character; from then on the character delay applies.
    after_request(normal(), "2019 rx :05\n 3000 rx 0302\n 3900 rx 1234B0\\r\\n => got 1234\n 3901 taken => ok");
    // A line that hands over its characters late is waited for.
    after_request(Parameters { late: Span::from_nanos(20_000_000), ..normal() }, "2040 timeout => fail 0830");
}

/// "If the quiet time exceeds the character delay time, the message is ignored and an error is reported." [S4 L520]
#[test]
fn character_delay_time() {
    // A character lasts 10 bits, 1.0417 ms at 9600 bit/s, and counts from its end.
    let table = "50 rx :0503\n 1051.041666 timeout => fail 0806\n 1060 rx 021234\\r\\n";
    after_request(normal(), table);
    after_request(Parameters { character_delay_ms: 1, ..normal() }, "50 rx :\n 52.041666 timeout => fail 0806");
    after_request(normal(), "50 rx :0503\n 1051 rx 021234B0\\r\\n => got 1234\n 1052 taken => ok");
}

// ---- characters ----

/// [S4 L731-L738]
#[test]
fn what_is_wrong_with_a_reply() {
    after_request(normal(), "50 rx :0503021234B1\\r\\n => fail 0E57"); // LRC [S4 L1814]
    after_request(normal(), "50 rx :05030212g4B0\\r\\n => fail 0E58"); // no digit [S4 L1815]
    after_request(normal(), "50 rx :0503021b34A7\\r\\n => fail 0E58"); // a small letter is none either
    after_request(normal(), "50 rx :0503021234B0\\n => fail 0E58"); // LF without CR
    after_request(normal(), "50 rx :0503021234B0\\r0\\r\\n => fail 0E58"); // CR that ends nothing
    after_request(normal(), "50 rx :0503021234B\\r\\n => fail 0E52"); // half a byte
    after_request(normal(), "50 rx :05FB\\r\\n => fail 0E52"); // no function code
    after_request(normal(), "50 rx :\\r\\n => fail 0E52");
    after_request(normal(), "50 say 06 03 02 1234 => fail 0E50");
}

/// "Overflow of receive buffer in CP during reception of the reply message" [S4 L1755]
#[test]
fn a_reply_longer_than_the_buffer() {
    // The buffer holds 254 bytes and LRC: 252 bytes of data. [S4 "Message Structure"]
    after_request(normal(), "50 say 05 03 FC 251*11 => fail 0E52");
    after_request(normal(), "50 say 05 03 FC 252*11 => fail 0832");
    // The longest reply.
    check(
        normal(),
        "
        0 start
        1 job 05 01 0000 07D8 => ask 05 01 0000 07D8
        20 done
        600 say 05 01 FB 251*11 => got 250*11 0011
        601 taken => ok
        ",
    );
}

/// A partner that never ends does not prolong the job (ours).
#[test]
fn a_partner_that_never_ends() {
    let mut table = String::new();
    for step in 0..10 {
        table += &format!("{} rx {}\n", 50 + step, "0".repeat(100));
    }
    // 1026 characters are twice the longest frame.
    after_request(normal(), &format!("50 rx :\n{table} 61 rx {} => fail 0832", "0".repeat(26)));
}

/// "A start character was received within a telegram. The first part of the telegram is discarded and reception starts
/// again." [S4 L1757]
#[test]
fn a_colon_within_a_reply() {
    after_request(normal(), "50 rx :0503\n 60 say 05 03 02 1234 => !0834, got 1234\n 61 taken => ok");
    after_request(normal(), "50 rx :05zz:: => !0834, !0834\n 60 rx 0503021234B0\\r\\n => got 1234\n 61 taken => ok");
}

/// [S4 L1756]
#[test]
fn a_wrong_start_character() {
    after_request(normal(), "50 rx 0503021234B0\\r\\n => fail 0833");
    after_request(normal(), "50 rx x\n 60 say 05 03 02 1234 => fail 0833");
    after_request(normal(), "50 rx x\n 1051.041666 timeout => fail 0833");
}

// ---- operating modes ----

/// "All recognized transmission errors and/or BREAK before and after receive messages from the slave result in an
/// appropriate error message." [S4 L538], [S4 L1749], [S4 L1750]
#[test]
fn normal_operation_reports_what_lies_before_and_behind_a_reply() {
    for fault in ["Parity", "Framing", "Overrun"] {
        after_request(normal(), &format!("30 fault {fault}\n 50 say 05 03 02 1234 => fail 080C"));
        after_request(normal(), &format!("30 fault {fault}\n 1031.041666 timeout => fail 080C"));
        after_request(
            normal(),
            &format!("50 say 05 03 02 1234 => got 1234\n 51 fault {fault} => !080C\n 52 taken => ok"),
        );
    }
    after_request(normal(), "30 fault Break => fail 080D\n 50 say 05 03 02 1234");
    after_request(normal(), "50 say 05 03 02 1234 => got 1234\n 51 fault Break => !080D\n 52 taken => ok");
    check(
        normal(),
        "0 start\n 1 fault Break => !080D\n 2 fault Parity => !080C\n 3 fault Gone => !080D\n 4 fault Back",
    );
}

/// "... no error is reported. The start of the receive message is recognized by means of the correctly-received start
/// character." [S4 L539-L540]
#[test]
fn interference_suppression_reports_nothing_outside_a_reply() {
    for parameters in [suppressed(), two_wire()] {
        after_request(
            parameters.clone(),
            "
            30 fault Break
            31 fault Parity
            32 rx xyz
            50 say 05 03 02 1234 => got 1234
            51 fault Break
            52 fault Framing
            53 taken => ok
            54 fault Break
            55 fault Parity
            ",
        );
        after_request(parameters, "30 fault Break\n 31 fault Parity\n 32 rx xyz\n 2020 timeout => fail 0830");
    }
}

/// Inside a reply every fault counts in every mode. [S4 L731-L738]
#[test]
fn a_fault_inside_a_reply() {
    for parameters in [normal(), suppressed(), two_wire()] {
        let table = "50 rx :0503\n 51 fault Parity\n 52 rx 021234B0\\r\\n => fail 080C";
        after_request(parameters.clone(), table);
        after_request(parameters, "50 rx :0503\n 51 fault Overrun\n 1052.041666 timeout => fail 080C");
    }
    after_request(normal(), "50 rx :0503\n 51 fault Break => fail 080D\n 60 rx 021234B0\\r\\n");
    after_request(suppressed(), "50 rx :0503\n 51 fault Break => fail 080D\n 60 rx 021234B0\\r\\n");
    // With the presetting "High" there is no BREAK: it is a character without stop bit. [S4 L576]
    after_request(two_wire(), "50 rx :0503\n 51 fault Break\n 52 rx 021234B0\\r\\n => fail 080C");
    // A colon restarts reception; in normal operation the fault before it still counts.
    after_request(
        suppressed(),
        "50 rx :05\n 51 fault Parity\n 52 say 05 03 02 1234 => !0834, got 1234\n 53 taken => ok",
    );
    after_request(normal(), "50 rx :05\n 51 fault Parity\n 52 say 05 03 02 1234 => !0834, fail 080C");
}

/// "If BREAK is recognized on the receiving line by the CP during output of a message, the triggered P_SND_RK job is
/// completed with error. Reception during transmission is ignored." [S4 L727]
#[test]
fn while_the_request_leaves() {
    let table = "0 start\n 1 job 05 07 => ask 05 07\n";
    for parameters in [normal(), suppressed()] {
        check(parameters.clone(), &format!("{table} 5 fault Break => back, fail 080D\n 9 done"));
        check(parameters.clone(), &format!("{table} 5 fault Gone => back, fail 080D\n 9 done"));
        let heard = "5 rx :0507\\r\\n\n 6 fault Parity\n 9 done\n 20 say 05 07 3E => got 3E\n 21 taken => ok";
        check(parameters, &format!("{table}{heard}"));
    }
    // In two-wire operation the receiving line is switched to sending. [S4 L554]
    check(two_wire(), &format!("{table} 5 fault Break\n 9 done\n 20 say 05 07 3E => got 3E\n 21 taken => ok"));
}

/// A line that is known to be interrupted accepts no job. [S4 L1750]
#[test]
fn an_interrupted_line() {
    check(
        normal(),
        "
        0 start
        1 fault Gone => !080D
        2 job 05 07 => fail 080D
        3 fault Back
        4 job 05 07 => ask 05 07
        20 done
        21 fault Gone => fail 080D
        ",
    );
    // With the presetting "High" this cannot be detected. [S4 L576]
    check(two_wire(), "0 start\n 1 fault Gone\n 2 job 05 07 => ask 05 07\n 20 done\n 2020 timeout => fail 0830");
}

// ---- RS 232C secondary signals ----

/// Figure 4-1: RTS ON, waiting time, data, time to RTS OFF. [S4 L811-L815]
#[test]
fn signals_around_a_job() {
    check(
        with_signals(30, 50),
        "
        0 start => rts off, dtr on
        1 lines dsr cts
        10 job 05 07 => rts on
        60 timeout => ask 05 07
        70 done
        75 say 05 07 3E => got 3E
        76 taken => ok
        100 timeout => rts off
        # The next job takes RTS over from the one before.
        200 job 05 07 => rts on
        250 timeout => ask 05 07
        260 done
        270 say 05 07 3E => got 3E
        271 taken => ok
        272 job 05 07 => rts on
        322 timeout => ask 05 07
        330 done
        340 say 05 07 3E => got 3E
        341 taken => ok
        360 timeout => rts off
        ",
    );
}

/// [S4 L814], [S4 L1751]
#[test]
fn cts_off() {
    check(
        with_signals(30, 50),
        "
        0 start => rts off, dtr on
        1 lines dsr
        10 job 05 07 => rts on
        60 timeout => rts off, fail 0818
        70 job 05 07 => rts on
        80 lines dsr cts
        120 timeout => ask 05 07
        121 lines dsr => back, rts off, fail 0818
        122 done
        ",
    );
    // After the data CTS does not count. [S4 L815]
    let table = "0 start => rts off, dtr on\n 1 job 05 07 => rts on, ask 05 07\n 9 done => rts off\n 10 lines dsr\n";
    check(with_signals(0, 0), &format!("{table} 20 say 05 07 3E => got 3E\n 21 taken => ok"));
}

/// "A send request or data receipt is aborted with an error message if DSR changes from ON to OFF." [S4 L817]
#[test]
fn dsr_off() {
    let start = "0 start => rts off, dtr on\n 1 lines dsr cts\n";
    let p = || with_signals(30, 50);
    check(p(), &format!("{start} 2 lines cts\n 10 job 05 07 => fail 0818"));
    check(p(), &format!("{start} 10 job 05 07 => rts on\n 20 lines cts => rts off, fail 0818"));
    let out = format!("{start} 10 job 05 07 => rts on\n 60 timeout => ask 05 07\n");
    check(p(), &format!("{out} 65 lines cts => back, rts off, fail 0818"));
    check(p(), &format!("{out} 70 done\n 80 lines cts => fail 0818\n 100 timeout => rts off"));
}

/// "If no secondary signals are parameterized, the CP neither sets nor checks these signals."
/// [S4 "Automatic Use of RS232 Signals"]
#[test]
fn without_signals_nobody_looks() {
    let table =
        "0 start\n 1 lines\n 2 job 05 07 => ask 05 07\n 3 lines dsr\n 9 done\n 10 lines\n 20 say 05 07 3E => got 3E\n";
    check(normal(), &format!("{table} 21 taken => ok"));
}

// ---- parameters ----

/// A driver that is not ready ends each job with 0502h.
fn refused(parameters: Parameters, numbers: &str) {
    check(parameters, &format!("0 start => {numbers}\n 1 job 05 07 => fail 0502\n 2 rx :\n 3 fault Break\n 4 abort"));
}

/// [S4 "3.6.1 Modbus ASCII Protocol"], [S4 L1776-L1779]
#[test]
fn parameters_that_stop_the_driver() {
    refused(Parameters { data_bits: 8, ..normal() }, "!0E20");
    refused(Parameters { operating_mode: 2, ..normal() }, "!0E22");
    // "With even or odd parity 1 stop bit is pre-defined. None parity effects two stop bits." [S4 L500]
    refused(Parameters { stop_bits: 2, ..normal() }, "!020F");
    refused(Parameters { parity: Parity::Odd, stop_bits: 2, ..normal() }, "!020F");
    refused(Parameters { parity: Parity::None, ..normal() }, "!020F");
    for baud in [0, 150, 57_600, 115_200] {
        refused(Parameters { baud, ..normal() }, "!020F");
    }
    refused(with_signals(655_351, 0), "!020F");
    refused(with_signals(0, 655_351), "!020F");
    refused(Parameters { data_bits: 5, baud: 1, operating_mode: 9, ..normal() }, "!0E20, !0E22, !020F");
}

#[test]
fn parameters_at_their_limits() {
    for baud in [300, 600, 1200, 2400, 4800, 9600, 19_200, 38_400, 76_800] {
        check(Parameters { baud, ..normal() }, "0 start\n 1 job 05 07 => ask 05 07");
    }
    let none = Parameters { parity: Parity::None, stop_bits: 2, ..normal() };
    let odd = Parameters { parity: Parity::Odd, ..normal() };
    let longest = Parameters { character_delay_ms: 6500, response_timeout_ms: 65_500, ..normal() };
    for parameters in [none, odd, longest, with_signals(655_350, 0), with_signals(0, 655_350)] {
        let signals = if parameters.signals.is_some() { " => rts off, dtr on" } else { "" };
        check(parameters, &format!("0 start{signals}"));
    }
}

/// "The driver is operating with a default value of 1000 / 2000 milliseconds." [S4 L1777], [S4 L1779]
#[test]
fn times_out_of_range_are_replaced() {
    for character_delay_ms in [0, 6501] {
        let table =
            "0 start => !0E21\n 1 job 05 07 => ask 05 07\n 20 done\n 50 rx :\n 1051.041666 timeout => fail 0806";
        check(Parameters { character_delay_ms, ..normal() }, table);
    }
    for response_timeout_ms in [4, 65_501] {
        let table = "0 start => !0E23\n 1 job 05 07 => ask 05 07\n 20 done\n 2020 timeout => fail 0830";
        check(Parameters { response_timeout_ms, ..normal() }, table);
    }
}
