//! Messages, headers of lists and refusals in the form that real CPUs give them.

mod common;

use common::{Desk, job};
use ob1_s7::Rights;
use ob1_s7::server::{CpuEvent, Settings};
use ob1_s7::wire::encode_password;

fn desk() -> Desk {
    Desk::with(Rights::Operate)
}

#[test]
fn messages_go_to_those_who_want_them() {
    let mut desk = desk();
    let entry = [0x43, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20];
    desk.connection.event(&CpuEvent::Diagnosis(entry));
    assert!(desk.answers().is_empty());
    let name = [&[0x03, 0][..], b"PANEL_01"].concat();
    assert_eq!(desk.service(4, 2, &name)[0][22..], [0xFF, 9, 0, 2, 2, 0]);
    desk.connection.event(&CpuEvent::Diagnosis(entry));
    desk.connection.event(&CpuEvent::Mode(2));
    let messages = desk.answers();
    // The short form, and one without data: nobody reads others.
    assert_eq!(messages[0][4..22], [0, 0, 0, 8, 0, 24, 0, 1, 0x12, 4, 0x11, 4, 3, 0, 0xFF, 9, 0, 20]);
    assert_eq!(messages[0][22..], entry);
    assert_eq!(messages[1][4..], [0, 0, 0, 8, 0, 0, 1, 0, 0x10, 0x10, 0, 0, 2, 0]);
    desk.connection.event(&CpuEvent::Mode(1));
    assert!(desk.answers().is_empty(), "only that RUN is reached");
    // Entries of the user are a kind of their own.
    desk.connection.event(&CpuEvent::Diagnosis([0xA1; 20]));
    assert!(desk.answers().is_empty());
    desk.connection.event(&CpuEvent::Diagnosis([0xF5; 20]));
    assert!(desk.answers().is_empty(), "only ours");
    // With alarms, and off again: the kind comes back. There are none.
    for (events, kind) in [(0x81, 9), (0x80, 8)] {
        let name = [&[events, 0][..], b"HmiRtm  ", &[kind, 0]].concat();
        assert_eq!(desk.service(4, 2, &name)[0][17..], [1, 0, 0, 0, 0, 0xFF, 9, 0, 5, 2, 0, kind, 1, 0]);
        assert_eq!(desk.connection.wants_events(), events == 0x81);
    }
    let query = [0, 1, 0x12, 8, 0x1A, 0, 1, 0x34, 0, 0, 0, 4];
    assert_eq!(desk.service(4, 0x13, &query)[0][22..], [0xFF, 9, 0, 6, 0, 1, 0x0A, 0, 0, 0]);
}

/// A restart is answered before anything of it is told.
#[test]
fn messages_wait_for_the_answer_of_what_they_are_about() {
    let mut desk = Desk::with(Rights::Operate);
    desk.service(4, 2, &[0x03, 0]);
    let stop = job(7, b"\x29\0\0\0\0\0\x09P_PROGRAM", &[]);
    let frame = [&[3, 0, 0, stop.len() as u8 + 7, 2, 0xF0, 0x80][..], &stop].concat();
    desk.connection.receive(&frame);
    desk.connection.event(&CpuEvent::Mode(0));
    assert!(desk.answers().is_empty(), "the CPU has not answered");
    desk.serve();
    let answers = desk.answers();
    assert_eq!(answers.iter().map(|telegram| telegram[1]).collect::<Vec<u8>>(), [3, 7]);
}

/// Of a list with 0F only the header comes, with the records that there are.
#[test]
fn a_list_can_be_asked_for_its_header_only() {
    let mut desk = desk();
    let whole = desk.service(4, 1, &[0, 0x11, 0, 0]).remove(0);
    let head = desk.service(4, 1, &[0x0F, 0x11, 0, 0]).remove(0);
    assert_eq!((&head[26..28], head.len()), (&[0x0F, 0x11][..], 34));
    assert_eq!(head[28..34], whole[28..34]);
}

#[test]
fn an_upload_of_what_is_not_there_is_refused_as_a_whole() {
    let mut desk = desk();
    for (name, code) in [(b"_0800000A", [0xD2, 0x0C]), (b"_0800035A", [0xD2, 0x09]), (b"_0A00777A", [0xD2, 0x09])] {
        let start = [&[0x1D, 0, 0, 0, 0, 0, 0, 0, 9][..], name].concat();
        let answer = desk.job(&start, &[]);
        assert_eq!((answer[1], &answer[6..]), (2, &[0, 0, 0, 0, code[0], code[1]][..]));
    }
}

/// The level that a password lifts, and that in force for this connection.
#[test]
fn the_levels_of_protection_are_those_of_the_connection() {
    let levels = |desk: &mut Desk| desk.service(4, 1, &[2, 0x32, 0, 4]).remove(0)[38..42].to_vec();
    for (rights, expected) in [(Rights::Read, [0, 0, 0, 2]), (Rights::Operate, [0, 0, 0, 1])] {
        assert_eq!(levels(&mut Desk::with(rights)), expected);
    }
    let mut desk = Desk::open(Settings { has_password: true, ..Settings::default() }, 480);
    desk.cpu.password = Some("secret".into());
    assert_eq!(levels(&mut desk), [0, 2, 0, 2]);
    desk.service(5, 1, &encode_password("secret").expect("short"));
    assert_eq!(levels(&mut desk), [0, 2, 0, 1]);
}
