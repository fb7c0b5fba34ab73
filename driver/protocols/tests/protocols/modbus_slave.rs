//! The Modbus slave, short and long: every branch of the manual's text as a message table. One character takes 1 ms.
//! [S0 "Modbus - Deployment"], [S0 "Modbus - Function codes"]

use ob1_protocols::MS;
use ob1_protocols::modbus::area::{Areas, Change};
use ob1_protocols::modbus::pdu::{Exception, Request};
use ob1_protocols::modbus::slave::Config;
use ob1_protocols::modbus::{Mode, Slave, frame, rtu};

use crate::common::check;

fn frame(mode: Mode) -> frame::Config {
    frame::Config::new(mode, 9600, MS)
}

/// Address 5, 16 bytes each way: the CPU's are F0 F1 .. FF.
fn short() -> Slave {
    let mut slave = Slave::new(Config::short(frame(Mode::Rtu), 5));
    let data: Vec<u8> = (0xF0..=0xFF).collect();
    assert!(slave.set_input(&data));
    slave
}

fn long() -> Slave {
    Slave::new(Config::long(frame(Mode::Rtu), 5))
}

/// The manual's example: 16 bytes with 10h. [S0 "Send block DB10"], [S0 "Receive block DB11"]
#[test]
fn the_example() {
    let mut slave = short();
    check(
        &mut slave,
        "0    start
         23   rx 05 10 00 00 00 08 10 A0 A1 A2 A3 A4 A5 A6 A7 A8 A9 AA AB AC AD AE AF CE FF
         26.5 timeout => tx 05 10 00 00 00 08 C0 4B
         35   done",
    );
    assert_eq!(slave.areas().output(), (0xA0..=0xAF).collect::<Vec<u8>>());
}

/// Every function code: bits and words of either area. [S0 "Range definitions"]
#[test]
fn every_function_code() {
    let mut slave = short();
    check(
        &mut slave,
        "0     start
         10    rx 05 06 00 01 12 34 D4 F9       # word 1 = bytes 2, 3
         13.5  timeout => tx 05 06 00 01 12 34 D4 F9
         20    done
         30    rx 05 05 00 07 FF 00 3C 7F       # bit 7 of byte 0
         33.5  timeout => tx 05 05 00 07 FF 00 3C 7F
         40    done
         50    rx 05 0F 00 18 00 0A 02 55 FF AB 30 # ten bits from bit 0 of byte 3
         53.5  timeout => tx 05 0F 00 18 00 0A 54 4F
         60    done
         70    rx 05 01 00 00 00 10 3C 42
         73.5  timeout => tx 05 01 02 80 00 29 FC
         80    done
         90    rx 05 01 00 17 00 0C 8D 8F       # 23..34: bit 7 of byte 2, byte 3, three bits of byte 4
         93.5  timeout => tx 05 01 02 AA 06 B6 9E
         100   done
         110   rx 05 02 00 04 00 08 39 89       # the CPU's F0 F1: bits 4..11
         113.5 timeout => tx 05 02 01 1F E1 70
         120   done
         130   rx 05 03 00 00 00 03 04 4F
         133.5 timeout => tx 05 03 06 80 00 12 55 03 00 19 ED
         140   done
         150   rx 05 04 00 07 00 01 81 8F
         153.5 timeout => tx 05 04 02 FE FF 48 D0
         160   done
         170   rx 05 05 00 07 00 00 7D 8F
         173.5 timeout => tx 05 05 00 07 00 00 7D 8F
         180   done",
    );
    assert_eq!(slave.areas().output(), [0, 0, 0x12, 0x55, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
}

/// On a bus a slave also receives the answers of the others; none is taken for an incomplete request.
#[test]
fn answers_of_other_slaves() {
    check(
        &mut short(),
        "0     start
         10    rx 07 10 00 00 00 08 C1 A9       # slave 7: eight words written
         13.5  timeout
         30    rx 05 03 00 00 00 03 04 4F
         33.5  timeout => tx 05 03 06 00 00 00 00 00 00 13 B5
         40    done
         50    rx 07 03 02 00 11 F0 48          # slave 7: one word read
         53.5  timeout
         70    rx 05 03 00 00 00 03 04 4F
         73.5  timeout => tx 05 03 06 00 00 00 00 00 00 13 B5
         80    done",
    );
}

/// "Function code OR 80h": unknown function, outside the area, wrong number.
#[test]
fn exceptions() {
    check(
        &mut short(),
        "0     start
         10    rx 05 07 43 22
         13.5  timeout => tx 05 87 01 C3 F1
         20    done
         30    rx 05 03 00 08 00 01 04 4C
         33.5  timeout => tx 05 83 02 81 30
         40    done
         50    rx 05 01 00 80 00 01 FD A6
         53.5  timeout => tx 05 81 02 80 50
         60    done
         70    rx 05 10 00 07 00 02 04 00 00 00 00 A7 79
         73.5  timeout => tx 05 90 02 8C 00
         80    done
         90    rx 05 05 00 80 FF 00 8C 56
         93.5  timeout => tx 05 85 02 82 90
         100   done
         110   rx 05 0F 00 7F 00 02 01 00 CA AE
         113.5 timeout => tx 05 8F 02 84 30
         120   done
         130   rx 05 04 00 00 00 7E 71 AE
         133.5 timeout => tx 05 84 03 42 C0
         140   done
         150   rx 05 06 FF FF 00 00 88 6A
         153.5 timeout => tx 05 86 02 82 60
         160   done",
    );
}

/// A telegram for another slave, or an unreadable one, is not answered; the next one is.
#[test]
fn silence_is_an_answer_too() {
    check(
        &mut short(),
        "0     start
         10    rx 06 03 00 00 00 01 85 BD
         13.5  timeout
         30    rx 05 03 00 00 00 01 00 00
         33.5  timeout => !Receive: Modbus(Fault)
         50    rx 05 03 00
         53.5  timeout => !Receive: Modbus(Incomplete)
         70    rx 05 03
         71    fault Parity => !Receive: Line(Parity)
         74.5  timeout => !Receive: Modbus(DataLost)
         80    rx 300*00
         83.5  timeout => !Receive: Modbus(Overflow)
         90    rx 05
         92.6  rx 03
         96.1  timeout => !Receive: Modbus(Incomplete)
         100   rx 05
         101   fault Gone => !Receive: Line(Gone)
         110   rx 05 03 00 00 00 01 85 8E
         113.5 timeout => tx 05 03 02 00 00 49 84
         114   rx 05 03    # our own echo
         120   done
         130   rx 05 03 00 00 00 01 85 8E
         133.5 timeout => tx 05 03 02 00 00 49 84
         140   done",
    );
}

/// "Only write commands may be sent as broadcast": they are carried out, never answered.
#[test]
fn broadcast() {
    let mut slave = short();
    check(
        &mut slave,
        "0    start
         10   rx 00 06 00 00 12 34 85 6C
         13.5 timeout
         30   rx 00 03 00 00 00 01 85 DB
         33.5 timeout
         50   rx 00 06 00 08 12 34 04 AE
         53.5 timeout
         70   rx 00 10 00 01 00 01 02 56 78 95 93
         73.5 timeout",
    );
    assert_eq!(slave.areas().output()[..4], [0x12, 0x34, 0x56, 0x78]);
}

#[test]
fn ascii() {
    let mut slave = Slave::new(Config::short(frame(Mode::Ascii), 0x11));
    check(
        &mut slave,
        "0  start
         10 rx 3A 31 31 30 36 30 30 30 30 31 32 33 34 41 33 0D 0A => tx 3A 31 31 30 36 30 30 30 30 31 32 33 34 41 33 0D 0A
         30 done
         40 rx 3A 31 31 30 36
         50 rx 0D 0A => !Receive: Modbus(Incomplete)
         60 rx 31 0D 0A => !Receive: Modbus(Start)
         70 rx 3A 31 31
         1070 timeout => !Receive: Modbus(Incomplete)",
    );
    assert_eq!(slave.areas().output()[..2], [0x12, 0x34]);
}

/// Two requests in one burst: the second came while the first was answered, however the line splits them. (Found by
/// fuzzing.)
#[test]
fn a_request_behind_a_request() {
    let frame = frame(Mode::Ascii).without_silence();
    check(
        &mut Slave::new(Config::short(frame, 5)),
        "0   start
         34  rx 3A 30 35 30 33 30 30 30 30 30 30 30 31 46 37 0D 0A 3A 30 35 30 33 30 30 30 30 30 30 30 31 46 37 0D 0A => \
             tx 3A 30 35 30 33 30 32 30 30 30 30 46 36 0D 0A
         50  done
         90  rx 3A 30 35 30 33 30 30 30 30 30 30 30 31 46 37 0D 0A => tx 3A 30 35 30 33 30 32 30 30 30 30 46 36 0D 0A",
    );
}

/// "The CP 240 only reports a respond telegram to the master after all data has been received." [S0 L2082]
#[test]
fn a_write_is_answered_when_the_cpu_has_all() {
    let mut slave = long();
    // Words 3 and 4 are in blocks 0 and 1; word 12 in block 3 comes with them.
    check(
        &mut slave,
        "0    start
         10   rx 05 10 00 03 00 02 04 11 22 33 44 17 7F
         13.5 timeout",
    );
    assert_eq!(slave.take_change(), Some(Change { first: 0, bytes: 16 }));
    assert_eq!(slave.take_change(), None, "one at a time");
    check(&mut slave, "20 start");
    slave.change_taken(true);
    check(&mut slave, "21 start => tx 05 10 00 03 00 02 B0 4C\n 30 done");
    assert_eq!(slave.take_change(), None);
    // The same again changes nothing, and a read does not wait.
    check(
        &mut slave,
        "40   rx 05 10 00 03 00 02 04 11 22 33 44 17 7F
         43.5 timeout => tx 05 10 00 03 00 02 B0 4C
         50   done
         60   rx 05 06 00 00 00 01 49 8E
         63.5 timeout
         70   rx 05 03 00 03 00 01 75 8E
         73.5 timeout => tx 05 03 02 11 22 C5 CD
         80   done",
    );
    assert_eq!(slave.take_change(), Some(Change { first: 0, bytes: 8 }));
}

/// Somebody sends while the answer waits: the master has given up, so the answer is dropped, but not the data.
#[test]
fn an_answer_that_is_no_longer_wanted() {
    let mut slave = long();
    check(
        &mut slave,
        "0    start
         10   rx 05 06 00 00 00 01 49 8E
         13.5 timeout
         300  rx 06 03 00 00 00 01 85 BD
         303.5 timeout",
    );
    assert!(slave.take_change().is_some());
    slave.change_taken(true);
    check(&mut slave, "310 start");
    check(
        &mut slave,
        "320   rx 05 06 00 00 00 02 09 8F
         323.5 timeout
         330   fault Break => !Idle: Line(Break)
         333.5 timeout => !Receive: Modbus(DataLost)",
    );
    assert!(slave.take_change().is_some());
    slave.change_taken(true);
    check(&mut slave, "340 start");
}

/// "Writing master accesses must not lie outside of the reception area!" [S0 L2074]: data that the CPU cannot store are
/// refused.
#[test]
fn outside_of_the_reception_area() {
    let mut slave = long();
    check(
        &mut slave,
        "0    start
         10   rx 05 06 01 FF 00 01 78 42
         13.5 timeout
         20   abort",
    );
    assert_eq!(slave.take_change(), Some(Change { first: 1016, bytes: 8 }));
    slave.change_taken(false);
    check(&mut slave, "25 start");
    check(&mut slave, "30 rx 05 06 01 FE 00 01 29 82\n 33.5 timeout");
    assert_eq!(slave.take_change(), Some(Change { first: 1016, bytes: 8 }));
    slave.change_taken(false);
    check(
        &mut slave,
        "40 start => tx 05 86 02 82 60\n 50 done\n 60 rx 05 06 02 00 00 01 48 36\n 63.5 timeout => tx 05 86 02 82 60\n 70 done",
    );
}

/// A broadcast that the CPU cannot store is nobody's answer: the write after it is stored, and answered so.
#[test]
fn a_refused_broadcast_refuses_nothing_else() {
    let mut slave = long();
    let framed = |telegram: &[u8]| {
        let frame = [telegram, &rtu::crc(telegram).to_le_bytes()].concat();
        frame.iter().map(|byte| format!(" {byte:02X}")).collect::<String>()
    };
    let (broadcast, write) = (framed(&[0, 6, 0x01, 0xFF, 0, 1]), framed(&[5, 6, 0, 0, 0, 1]));
    check(&mut slave, &format!("0 start\n 10 rx{broadcast}\n 13.5 timeout"));
    assert_eq!(slave.take_change(), Some(Change { first: 1016, bytes: 8 }));
    check(&mut slave, &format!("20 start\n 30 rx{write}\n 33.5 timeout"));
    slave.change_taken(false);
    check(&mut slave, "40 start");
    assert_eq!(slave.take_change(), Some(Change { first: 0, bytes: 8 }));
    slave.change_taken(true);
    check(&mut slave, &format!("50 start => tx{write}\n 60 done"));
}

/// Refused data are removed, and the same write is refused again; stored data stay.
#[test]
fn a_refused_write_is_taken_back() {
    let mut slave = long();
    for (write, stored, left) in [
        ("05 06 00 04 11 11 05 D3", true, [0x11, 0x11]),
        ("05 06 00 04 22 22 51 36", false, [0x11, 0x11]),
        ("05 06 00 04 22 22 51 36", false, [0x11, 0x11]),
        ("05 06 00 04 22 22 51 36", true, [0x22, 0x22]),
    ] {
        check(&mut slave, &format!("0 start\n 10 rx {write}\n 13.5 timeout\n 20 abort"));
        assert_eq!(slave.take_change(), Some(Change { first: 8, bytes: 8 }), "{write}");
        slave.change_taken(stored);
        assert_eq!(slave.areas().output()[8..10], left, "{write}");
    }
}

/// SEND stores from 0 on; `ANZ OR 4000h` in the output area, without a change for the CPU.
/// [S0 "Write to master output area"]
#[test]
fn what_the_cpu_sends() {
    let mut slave = long();
    check(
        &mut slave,
        "0    start
         1    order 01 02 03 04 => sent ok
         2    order 1024*07     => sent ok
         3    order 1025*07     => sent TooLong
         4    order 01 02 03 04 => sent ok",
    );
    assert!(slave.set_output(&[9, 8]) && !slave.set_output(&[0; 1025]));
    check(
        &mut slave,
        "10    rx 05 04 00 01 00 02 21 8F
         13.5  timeout => tx 05 04 04 03 04 07 07 BC 33
         20    done
         30    rx 05 03 00 00 00 01 85 8E
         33.5  timeout => tx 05 03 02 09 08 4E 12
         40    done",
    );
    assert_eq!(slave.take_change(), None);
}

/// [S0 L2072]: 128 blocks of 8 bytes, at most 16 contiguous ones together, every other one by itself.
#[test]
fn changed_blocks() {
    let mut areas = Areas::new(1024);
    let write = |areas: &mut Areas, word: u16, data: &[u8]| {
        areas.serve(&Request::WriteWords { first: word, data }, &mut []).expect("inside")
    };
    for block in [0, 2, 3, 127] {
        write(&mut areas, 4 * block + 3, &[1, 1]);
    }
    let changes: Vec<_> = std::iter::from_fn(|| areas.take_change()).map(|c| (c.first, c.bytes)).collect();
    assert_eq!(changes, [(0, 8), (16, 16), (1016, 8)]);
    assert!(!areas.has_changes());
    for word in (0..512).step_by(125) {
        let words = 125.min(512 - word);
        write(&mut areas, word, &vec![0x55; 2 * usize::from(words)]);
    }
    let changes: Vec<_> = std::iter::from_fn(|| areas.take_change()).map(|c| (c.first, c.bytes)).collect();
    assert_eq!(changes, (0..8).map(|n| (128 * n, 128)).collect::<Vec<_>>());
    // One bit is a change, the same bit again is not.
    for expected in [Some(Change { first: 8, bytes: 8 }), None] {
        areas.serve(&Request::WriteBit { at: 64, on: false }, &mut []).expect("inside");
        assert_eq!(areas.take_change(), expected);
    }
    let outside = Request::WriteWords { first: 511, data: &[1, 1, 1, 1] };
    assert_eq!(areas.serve(&outside, &mut []), Err(Exception::Address));
    assert_eq!(areas.take_change(), None, "nothing of it is carried out");
}
