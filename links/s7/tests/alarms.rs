//! Alarms on the wire: log-on, indications, queries, acknowledging, locking, byte by byte.

mod common;

use common::Desk;
use ob1_model::{
    AlarmAck, AlarmChange, AlarmEvent, AlarmKind, AlarmNow, AlarmOrder, AlarmState, AlarmTime, AlarmTurn, AlarmValues,
    Displays,
};
use ob1_s7::Rights;
use ob1_s7::server::{CpuEvent, Settings};

/// 2026-11-27 19:30:00.250, a Friday (6).
const TIME: [u8; 8] = [0x26, 0x11, 0x27, 0x19, 0x30, 0x00, 0x25, 0x06];

fn values(list: &[(u8, &[u8])]) -> AlarmValues {
    let mut values = AlarmValues::default();
    list.iter().for_each(|(ty, bytes)| assert!(values.push(*ty, bytes)));
    values
}

fn state(kind: AlarmKind, id: u32, [signals, going, coming]: [u8; 3]) -> AlarmState {
    AlarmState { kind, id, component: 0, signals, coming, going, locked: false }
}

fn event(change: AlarmChange, state: AlarmState, values: AlarmValues) -> CpuEvent {
    let time = AlarmTime { nanos: 0, wall: TIME };
    CpuEvent::Alarm(Box::new(AlarmEvent { number: 1, time, change, state, values }))
}

fn came(lost: bool) -> AlarmChange {
    AlarmChange::Message { changed: 1, lost }
}

/// Data of a log-on: events, name, kind of alarms.
fn logon(events: u8, kind: Option<u8>) -> Vec<u8> {
    [&[events, 0][..], b"HmiRtm  ", &kind.map_or(vec![], |kind| vec![kind, 0])].concat()
}

fn logged_on(pdu: u16) -> Desk {
    let mut desk = Desk::open(Settings { rights: Rights::Write, ..Settings::default() }, pdu);
    for kind in [5, 9] {
        let answer = desk.service(4, 2, &logon(0x81, Some(kind)));
        assert_eq!(answer[0][17..], [1, 0, 0, 0, 0, 0xFF, 9, 0, 5, 2, 0, kind, 1, 0]);
    }
    desk
}

/// The sub-function and the data of a telegram in the short form of group 4, without an error.
fn told(telegram: &[u8]) -> (u8, Vec<u8>) {
    let len = u16::from_be_bytes([telegram[8], telegram[9]]);
    assert_eq!(telegram[..8], [0x32, 7, 0, 0, 0, 0, 0, 8], "reference 0, eight bytes of parameters");
    assert_eq!(telegram[10..16], [0, 1, 0x12, 4, 0x11, 4], "the short form");
    assert_eq!((telegram[17], &telegram[18..20]), (0, &[0xFF, 9][..]));
    let data = &telegram[22..];
    assert_eq!(
        (usize::from(len), u16::from_be_bytes([telegram[20], telegram[21]])),
        (data.len() + 4, data.len() as u16)
    );
    (telegram[16], data.to_vec())
}

/// Each kind with its sub-function and syntax; values as items of a read.
#[test]
fn indications() {
    let head = [&TIME[..], &[0x40, 1]].concat();
    let word: &[(u8, &[u8])] = &[(4, &[0, 0x2A])];
    for (kind, bytes, values_, change, sub, object) in [
        // The example of the fact sheet.
        (
            AlarmKind::Alarm8p,
            [1, 0xFF, 0xFE],
            word,
            came(false),
            0x05,
            "12 0A 16 01 00000123 01 00 FF FE FF 04 0010 002A",
        ),
        (AlarmKind::Alarm8, [0, 0xFE, 0xFF], &[], came(false), 0x05, "12 0A 16 00 00000123 00 00 FE FF"),
        (AlarmKind::Alarm, [1, 1, 0], &[], came(true), 0x05, "12 0A 16 00 00000123 01 01 01 00"),
        (AlarmKind::Notify, [1, 1, 1], word, came(false), 0x06, "12 0A 16 01 00000123 01 00 01 01 FF 04 0010 002A"),
        (
            AlarmKind::Notify8p,
            [0b101, 0xFF, 0xFF],
            word,
            AlarmChange::Message { changed: 0b110, lost: false },
            0x16,
            "12 0E 1C 01 00000123 05 00 FF FF 02 04 06 00 FF 04 0010 002A",
        ),
        (AlarmKind::AlarmSq, [1, 1, 0], word, came(false), 0x11, "12 0A 16 01 00000123 01 00 01 00 FF 04 0010 002A"),
        (AlarmKind::AlarmDq, [0, 1, 0], &[], came(false), 0x11, "12 0A 16 00 00000123 00 00 01 00"),
        (AlarmKind::AlarmS, [1, 1, 1], &[], came(false), 0x12, "12 0A 16 00 00000123 01 00 01 01"),
        (AlarmKind::AlarmD, [1, 1, 1], &[], came(false), 0x12, "12 0A 16 00 00000123 01 00 01 01"),
        // A fill byte between odd items, none behind the last.
        (
            AlarmKind::Alarm8p,
            [1, 0xFF, 0xFE],
            &[(1, &[1]), (5, &[0xFF, 0xFE]), (8, &[0x3F, 0x80, 0, 0]), (2, &[7, 8, 9])],
            came(false),
            0x05,
            "12 0A 16 04 00000123 01 00 FF FE FF 03 0001 01 00 FF 05 0010 FFFE FF 07 0004 3F800000 FF 04 0018 070809",
        ),
        (AlarmKind::AlarmSq, [0, 1, 1], &[], AlarmChange::Acknowledged, 0x0C, "12 08 19 00 00000123 01 01"),
    ] {
        let mut desk = logged_on(480);
        desk.connection.event(&event(change, state(kind, 0x123, bytes), values(values_)));
        let (told_sub, data) = told(&desk.answers()[0]);
        assert_eq!((told_sub, &data[..10], &data[10..]), (sub, &head[..], &hex(object)[..]), "{kind:?}");
    }
    // Without a time.
    for (change, sub) in [(AlarmChange::Locked, 0x0D), (AlarmChange::Unlocked, 0x0E)] {
        let mut desk = logged_on(480);
        desk.connection.event(&event(change, state(AlarmKind::Alarm, 0x123, [0; 3]), AlarmValues::default()));
        assert_eq!(told(&desk.answers()[0]), (sub, hex("40 01 12 06 15 00 00000123")));
    }
    // No indication is known for these.
    for change in [AlarmChange::Released, AlarmChange::Deleted] {
        let mut desk = logged_on(480);
        desk.connection.event(&event(change, state(AlarmKind::AlarmD, 0x123, [0; 3]), AlarmValues::default()));
        assert!(desk.answers().is_empty());
    }
}

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u32> = text.chars().filter_map(|digit| digit.to_digit(16)).collect();
    digits.chunks(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect()
}

/// What was lost is told by the mark of the next message of that partner, and once.
#[test]
fn what_was_lost_is_told_with_the_next_message() {
    let mut desk = logged_on(240);
    let alarm = state(AlarmKind::AlarmS, 7, [1, 1, 1]);
    desk.connection.event(&event(AlarmChange::Lost(5), AlarmState::default(), AlarmValues::default()));
    assert!(desk.answers().is_empty());
    for mark in [1, 0] {
        desk.connection.event(&event(came(false), alarm, AlarmValues::default()));
        assert_eq!(told(&desk.answers()[0]).1[19], mark);
    }
}

/// As many values as the PDU has room for.
#[test]
fn a_message_fits_the_pdu() {
    let list: Vec<(u8, &[u8])> = (0..5).map(|_| (2, &[7; 32][..])).collect();
    for (pdu, count) in [(480, 5), (240, 5), (112, 1), (90, 1)] {
        let mut desk = logged_on(pdu);
        desk.connection.event(&event(came(false), state(AlarmKind::Alarm8p, 7, [1, 0xFF, 0xFE]), values(&list)));
        let telegram = desk.answers().remove(0);
        assert!(telegram.len() <= usize::from(pdu), "{} of {pdu}", telegram.len());
        assert_eq!(told(&telegram).1[13], count, "PDU {pdu}");
    }
}

/// The order of a S7-300 panel and of WinCC: the mask replaces, kinds of alarms come and go one by one.
#[test]
fn log_on_and_off() {
    let mut desk = Desk::with(Rights::Write);
    let mut expected = Vec::new();
    let name = || "HmiRtm".to_owned();
    for (events, kind, displays) in [
        (0x01, None, None),
        (0x81, Some(9), Some(2)),
        (0x81, Some(5), Some(3)),
        (0x85, Some(4), Some(6)),
        (0x00, None, Some(0)),
        // WinCC's end: what is off may be logged off.
        (0x80, Some(8), None),
        (0x80, Some(0), None),
    ] {
        let answer = desk.service(4, 2, &logon(events, kind)).remove(0);
        let data = kind.map_or(vec![2, 0], |kind| vec![2, 0, kind, 1, 0]);
        assert_eq!((&answer[20..22], &answer[26..]), (&[0, 0][..], &data[..]), "{events:02X} {kind:?}");
        expected.extend(displays.map(|displays| (Displays(displays), name())));
        assert_eq!(desk.cpu.logons, expected, "{events:02X} {kind:?}");
    }
    for (events, kind, code) in [(0x80, 1, 0xD405), (0x80, 2, 0xD405), (0x80, 9, 0), (0x80, 9, 0xD403)] {
        let answer = desk.service(4, 2, &logon(events, Some(kind))).remove(0);
        assert_eq!(answer[20..22], u16::to_be_bytes(code), "{kind}");
    }
    desk.cpu.is_full = true;
    let answer = desk.service(4, 2, &logon(0x80, Some(5))).remove(0);
    assert_eq!(answer[20..22], [0xD4, 0x04]);
    // Only what was logged on for comes.
    for (kind, count) in [(AlarmKind::AlarmS, 1), (AlarmKind::Alarm, 0)] {
        desk.connection.event(&event(came(false), state(kind, 7, [1, 1, 1]), AlarmValues::default()));
        assert_eq!(desk.answers().len(), count, "{kind:?}");
    }
}

/// `by` is the number of the query: of all of a type, or of one message number.
fn query(by: u8, value: u32) -> Vec<u8> {
    [&[0, 1, 0x12, 8, 0x1A, 0, by, 0x34][..], &value.to_be_bytes()].concat()
}

#[test]
fn queries() {
    let mut desk = Desk::with(Rights::Read);
    for (by, value) in [(1, 2), (8, 2), (9, 2), (1, 4), (1, 1), (3, 7)] {
        let answer = desk.service(4, 0x13, &query(by, value)).remove(0);
        assert_eq!(answer[22..], [0xFF, 9, 0, 6, 0, 1, 0x0A, 0, 0, 0], "{by} {value}");
    }
    assert_eq!(desk.service(4, 0x13, &query(2, 2))[0][20..22], [0xD4, 0x05]);
    assert_eq!(desk.service(4, 0x13, &[0, 1, 0x12])[0][20..22], [0xD4, 0x05]);
    let time = AlarmTime { nanos: 0, wall: TIME };
    let later = AlarmTime { nanos: 0, wall: [0x26, 0x11, 0x27, 0x19, 0x31, 0, 0, 0x06] };
    let value = values(&[(5, &[1, 2])]);
    desk.cpu.alarms = vec![
        AlarmNow { state: state(AlarmKind::Alarm8p, 7, [1, 0xFF, 0xFE]), ..AlarmNow::default() },
        AlarmNow { state: state(AlarmKind::Alarm, 8, [0, 0, 0]), ..AlarmNow::default() },
        AlarmNow {
            state: state(AlarmKind::AlarmSq, 9, [1, 1, 0]),
            came: Some(AlarmTurn { time, values: value }),
            went: None,
        },
        AlarmNow {
            state: state(AlarmKind::AlarmDq, 10, [0, 1, 0]),
            came: Some(AlarmTurn { time, values: value }),
            went: Some(AlarmTurn { time: later, values: AlarmValues::default() }),
        },
    ];
    let blocks = hex("0A 0000 02 00000007 00 01 FF FE 0A 0000 02 00000008 00 00 00 00");
    for by in [1, 8, 9] {
        let answer = desk.service(4, 0x13, &query(by, 2)).remove(0);
        assert_eq!(answer[26..], [&hex("00 01 FF 09 0018")[..], &blocks].concat());
    }
    let first = "2611271930002506 FF 05 0010 0102 0000000000000000 0A 00 0000";
    let second = "2611271930002506 FF 05 0010 0102 2611271931000006 0A 00 0000";
    let functions = format!("24 0000 04 00000009 00 01 01 00 {first} 24 0000 04 0000000A 00 00 01 00 {second} 00");
    let answer = desk.service(4, 0x13, &query(1, 4)).remove(0);
    assert_eq!(answer[26..], [&hex("00 01 FF 09 FFFF")[..], &hex(&functions)].concat());
    // By number, in the form of its kind.
    let answer = desk.service(4, 0x13, &query(3, 8)).remove(0);
    assert_eq!(answer[26..], hex("00 01 FF 09 000C 0A 0000 02 00000008 00 00 00 00"));
    let answer = desk.service(4, 0x13, &query(3, 9)).remove(0);
    assert_eq!(answer[26..], hex(&format!("00 01 FF 09 FFFF 24 0000 04 00000009 00 01 01 00 {first} 00")));
}

/// A long answer goes in parts, which the partner asks for by the number of the answer.
#[test]
fn a_long_answer_comes_in_parts() {
    let mut desk = Desk::open(Settings { rights: Rights::Read, ..Settings::default() }, 240);
    let alarm = |id| AlarmNow { state: state(AlarmKind::Alarm8, id, [1, 0xFF, 0xFE]), ..AlarmNow::default() };
    desk.cpu.alarms = (1..=100).map(alarm).collect();
    let first = desk.service(4, 0x13, &query(9, 2)).remove(0);
    let number = first[17];
    let mut data = first[26..].to_vec();
    let mut more = first[19];
    let mut parts = 1;
    while more == 1 {
        let next = desk.next_part(4, 0x13, number);
        data.extend_from_slice(&next[26..]);
        (more, parts) = (next[19], parts + 1);
        assert!(next.len() <= 240);
    }
    assert_eq!((parts, data.len(), &data[..6]), (6, 6 + 1200, &hex("00 01 FF 09 04B0")[..]));
    for (index, entry) in data[6..].chunks(12).enumerate() {
        assert_eq!(entry, [&[0x0A, 0, 0, 2][..], &(index as u32 + 1).to_be_bytes(), &[0, 1, 0xFF, 0xFE]].concat());
    }
}

#[test]
fn acknowledge_lock_unlock() {
    let mut desk = Desk::with(Rights::Write);
    desk.cpu.alarms = vec![AlarmNow { state: state(AlarmKind::Alarm8p, 7, [1, 0xFF, 0xFE]), ..AlarmNow::default() }];
    let ack = hex("09 02 12 08 19 00 00000007 01 01 12 08 19 00 00000063 FF 00");
    assert_eq!(desk.service(4, 0x0B, &ack)[0][26..], [9, 2, 0xFF, 0x0A]);
    let acks = vec![AlarmAck { id: 7, going: 1, coming: 1 }, AlarmAck { id: 0x63, going: 0xFF, coming: 0 }];
    let mut orders = vec![AlarmOrder::Acknowledge(acks)];
    for (sub, locked) in [(0x07, true), (0x08, false)] {
        let answer = desk.service(4, sub, &hex("00 01 12 06 15 00 00000007")).remove(0);
        assert_eq!(answer[26..], [0, 1, 0xFF]);
        orders.push(AlarmOrder::Lock { ids: vec![7], locked });
    }
    assert_eq!(desk.cpu.alarm_orders, orders);
    for wrong in ["09 02 12 08 19 00 00000007 01 01", "09 01 12 08 15 00 00000007 01 01", "09", ""] {
        assert_eq!(desk.service(4, 0x0B, &hex(wrong))[0][20..22], [0xD4, 0x05], "{wrong}");
    }
    assert_eq!(desk.cpu.alarm_orders.len(), 3);
    // Without the right to write.
    let mut desk = Desk::with(Rights::Read);
    assert_eq!(desk.service(4, 0x0B, &ack)[0][20..22], [0xD2, 0x41]);
    assert!(desk.cpu.alarm_orders.is_empty());
}
