//! Test functions as programming devices use them: each rule one test. Telegrams are made up.

mod common;

use common::{Desk, test_data, test_words};
use ob1_model::{BlockId, BlockKind, CodeAddress, Pass, PassEnd, PassLine, Point};
use ob1_s7::Rights;
use ob1_s7::server::{Ask, CodePlaces};

/// `MW 100`; its result has 8 bytes behind the count.
const MW_100: [u8; 6] = [0x02, 1, 0, 0, 0, 100];

fn desk() -> Desk {
    let mut desk = Desk::with(Rights::Operate);
    desk.cpu.memory[100..102].copy_from_slice(&[0x12, 0x34]);
    desk
}

/// Variable status of one word.
fn monitor(begin: u16, end: u16, trigger: u16) -> Vec<u8> {
    test_data(test_words(begin, end, 8, trigger), &[], &[&[0, 1][..], &MW_100].concat())
}

/// Modifies it.
fn modify(begin: u16, end: u16, trigger: u16, value: [u8; 2]) -> Vec<u8> {
    let data = [&[0, 1][..], &MW_100, &[0, 9, 0, 2], &value].concat();
    test_data(test_words(begin, end, 4, trigger), &[], &data)
}

/// A service about a job.
fn about(service: u8, function: u8, number: u8) -> Vec<u8> {
    let front: &[u8] = if service == 0x0F { &[0, 1] } else { &[] };
    test_data(test_words(0, 1, 0, 0), &[], &[front, &[function, number]].concat())
}

/// An answer or a message in short: its kind and group, service, number, code, data.
#[derive(Debug, PartialEq, Eq)]
struct Told {
    kind: u8,
    service: u8,
    number: u8,
    code: u16,
    data: Vec<u8>,
}

fn told(telegrams: &[Vec<u8>]) -> Vec<Told> {
    let one = |telegram: &Vec<u8>| {
        assert_eq!(telegram[10..14], [0, 1, 0x12, 8], "{telegram:02X?}");
        if telegram[15] == 0x01 {
            assert_eq!(telegram[4..6], [0, 0], "a message has no reference");
        }
        let code = u16::from_be_bytes([telegram[20], telegram[21]]);
        Told { kind: telegram[15], service: telegram[16], number: telegram[17], code, data: telegram[26..].to_vec() }
    };
    telegrams.iter().map(one).collect()
}

fn answer(service: u8, number: u8) -> Told {
    Told { kind: 0x81, service, number, code: 0, data: vec![] }
}

fn refused(service: u8, number: u8, code: u16) -> Told {
    Told { code, ..answer(service, number) }
}

/// A message with a result.
fn push(service: u8, number: u8, class: u8, data: &[u8]) -> Told {
    let data = [&[0, 4, 0, data.len() as u8, 1, 0, 0, class][..], data].concat();
    Told { kind: 0x01, service, number, code: 0, data }
}

const SEEN: [u8; 8] = [0, 1, 0xFF, 9, 0, 2, 0x12, 0x34];

#[test]
fn a_job_waits_for_its_enable_and_its_trigger_and_pushes_once() {
    let mut desk = desk();
    assert_eq!(told(&desk.test(2, &monitor(1, 0, 0x0200))), [answer(2, 1)], "set up: no value yet");
    desk.point(Point::Start);
    assert_eq!(told(&desk.answers()), []);
    for _ in 0..3 {
        assert_eq!(told(&desk.test(0x0E, &about(0x0E, 2, 1))), [answer(0x0E, 2)], "a number of its own");
        desk.point(Point::End);
        assert_eq!(told(&desk.answers()), [], "another trigger");
        desk.point(Point::Start);
        assert_eq!(told(&desk.answers()), [push(2, 1, 2, &SEEN)]);
        desk.point(Point::Start);
        assert_eq!(told(&desk.answers()), [], "once for each enable");
    }
    // Enabled twice before the trigger: one result.
    desk.test(0x0E, &about(0x0E, 2, 1));
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 2, 1))), [answer(0x0E, 2)]);
    desk.point(Point::Start);
    assert_eq!(told(&desk.answers()).len(), 1);
}

#[test]
fn each_trigger_has_its_point_and_its_class() {
    for (trigger, point, class) in [(0x0200, Point::Start, 2), (0x0300, Point::End, 2), (0x0400, Point::Stop, 2)] {
        let mut desk = desk();
        assert_eq!(told(&desk.test(2, &monitor(0, 1, trigger))), [answer(2, 1)], "run at once, but at its trigger");
        desk.point(point);
        assert_eq!(told(&desk.answers()), [push(2, 1, class, &SEEN)]);
    }
    assert_eq!(told(&desk().test(2, &monitor(0, 1, 0))), [answer(2, 1), push(2, 1, 1, &SEEN)]);
}

#[test]
fn a_job_that_runs_once_is_gone_and_its_number_is_free() {
    let mut desk = desk();
    for _ in 0..20 {
        assert_eq!(told(&desk.test(2, &monitor(0, 1, 0))), [answer(2, 1), push(2, 1, 1, &SEEN)]);
    }
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 2, 1))), [refused(0x0E, 1, 0xD0A5)]);
    // One that stays keeps it; the lowest free one is given.
    assert_eq!(told(&desk.test(2, &monitor(1, 0, 0)))[0].number, 1);
    assert_eq!(told(&desk.test(2, &monitor(1, 0, 0)))[0].number, 2);
    assert_eq!(told(&desk.test(0x0F, &about(0x0F, 2, 1))), [answer(0x0F, 1)]);
    assert_eq!(told(&desk.test(2, &monitor(1, 0, 0)))[0].number, 1);
}

#[test]
fn disable_is_refused_when_the_trigger_has_come() {
    let mut desk = desk();
    desk.test(2, &monitor(1, 0, 0x0200));
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 2, 1))), [refused(0x0D, 2, 0xD0A5)]);
    // Enabled, and the trigger comes soon: its result comes first, and the answer says so.
    desk.test(0x0E, &about(0x0E, 2, 1));
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 2, 1))), []);
    desk.point(Point::Start);
    assert_eq!(told(&desk.answers()), [push(2, 1, 2, &SEEN), refused(0x0D, 2, 0xD0A5)]);
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 2, 1))), [refused(0x0D, 2, 0xD0A5)]);
    // It does not come.
    desk.test(0x0E, &about(0x0E, 2, 1));
    desk.test(0x0D, &about(0x0D, 2, 1));
    desk.patience_ends();
    assert_eq!(told(&desk.answers()), [answer(0x0D, 2)]);
    desk.point(Point::Start);
    assert_eq!(told(&desk.answers()), [], "it was disabled");
    // Nobody knows when a STOP comes.
    desk.test(2, &monitor(1, 0, 0x0400));
    desk.test(0x0E, &about(0x0E, 2, 2));
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 2, 2))), [answer(0x0D, 3)]);
}

#[test]
fn a_result_under_way_comes_before_the_answer_of_the_delete() {
    let mut desk = desk();
    desk.test(2, &monitor(1, 0, 0x0200));
    desk.test(0x0E, &about(0x0E, 2, 1));
    assert_eq!(told(&desk.test(0x0F, &about(0x0F, 2, 1))), []);
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 2, 1))), [], "behind the answer to the delete");
    desk.point(Point::Start);
    let all = told(&desk.answers());
    assert_eq!(all, [push(2, 1, 2, &SEEN), answer(0x0F, 1), refused(0x0E, 2, 0xD0A5)]);
    assert_eq!(told(&desk.test(0x0F, &about(0x0F, 2, 1))), [refused(0x0F, 1, 0xD0A5)]);
    // One whose trigger does not come goes without a result.
    desk.test(2, &monitor(1, 0, 0x0200));
    desk.test(0x0E, &about(0x0E, 2, 1));
    desk.test(0x0F, &about(0x0F, 2, 1));
    desk.patience_ends();
    assert_eq!(told(&desk.answers()), [answer(0x0F, 1)]);
    assert!(desk.armed.is_empty(), "nor does the CPU know of it");
}

#[test]
fn a_result_comes_behind_answers_that_wait() {
    let mut desk = desk();
    desk.test(2, &monitor(1, 0, 0x0200));
    // A read whose values have not come yet.
    desk.send_only(&common::job(7, &common::items(4, &[common::item(2, 1, 0, 0x83, 0)]), &[]));
    let read = desk.connection.next_ask().expect("a read");
    desk.send_only(&common::test_service(0x0E, &about(0x0E, 2, 1)));
    desk.serve();
    desk.point(Point::Start);
    assert_eq!(desk.answers().len(), 0);
    let reply = desk.cpu.serve(read.ask);
    desk.connection.reply(read.id, reply);
    let all = desk.answers();
    assert_eq!(all[0][1], 3);
    assert_eq!(told(&all[1..]), [answer(0x0E, 2), push(2, 1, 2, &SEEN)]);
}

#[test]
fn the_list_has_the_service_that_asks_for_it() {
    let mut desk = desk();
    let list = test_data([0, 0, 1, 0, 1, 1, 1, 1, 1, 0], &[], &[0; 4]);
    let data = |jobs: &[[u8; 4]]| [&[0, 4, 0, 4 * jobs.len() as u8, 1, 0, 0, 1][..], &jobs.concat()].concat();
    let told_list = |number, jobs: &[[u8; 4]]| Told { data: data(jobs), ..answer(0x10, number) };
    assert_eq!(told(&desk.test(0x10, &list)), [told_list(1, &[[0x10, 1, 0, 0]])]);
    desk.test(2, &monitor(1, 0, 0x0200));
    desk.test(8, &modify(1, 0, 0x0300, [1, 2]));
    desk.test(0x0E, &about(0x0E, 8, 2));
    assert_eq!(told(&desk.test(0x10, &list)), [told_list(3, &[[2, 1, 0, 0], [8, 2, 0, 1], [0x10, 3, 0, 0]])]);
}

#[test]
fn a_job_is_read_and_replaced() {
    let mut desk = desk();
    let first = monitor(1, 0, 0x0200);
    desk.test(2, &first);
    assert_eq!(told(&desk.test(0x11, &about(0x11, 2, 1))), [Told { data: first, ..answer(0x11, 2) }]);
    assert_eq!(told(&desk.test(0x11, &about(0x11, 8, 1))), [refused(0x11, 2, 0xD043)]);
    desk.test(0x0E, &about(0x0E, 2, 1));
    let other = monitor(1, 0, 0x0300);
    let replace = test_data(test_words(0, 1, 0, 0), &[], &[&[0, 0, 2, 1][..], &other].concat());
    assert_eq!(told(&desk.test(0x12, &replace)), [answer(0x12, 2)]);
    desk.point(Point::Start);
    assert_eq!(told(&desk.answers()), [], "the old one was armed");
    desk.test(0x0E, &about(0x0E, 2, 1));
    desk.point(Point::End);
    assert_eq!(told(&desk.answers()), [push(2, 1, 2, &SEEN)]);
    let nothing = test_data(test_words(0, 1, 0, 0), &[], &[&[0, 0, 2, 7][..], &other].concat());
    assert_eq!(told(&desk.test(0x12, &nothing)), [refused(0x12, 2, 0xD043)]);
}

#[test]
fn values_are_modified_at_their_trigger() {
    let mut desk = desk();
    assert_eq!(told(&desk.test(8, &modify(0, 1, 0, [7, 8]))), [answer(8, 1), push(8, 1, 1, &[0, 1, 0xFF, 0])]);
    assert_eq!(desk.cpu.memory[100..102], [7, 8]);
    // With a trigger: not before, and the job is known to its enable.
    assert_eq!(told(&desk.test(8, &modify(1, 1, 0x0200, [1, 2]))), [answer(8, 1)]);
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 8, 1))), [answer(0x0E, 2)]);
    assert_eq!(desk.cpu.memory[100..102], [7, 8]);
    desk.point(Point::Start);
    assert_eq!(told(&desk.answers()), [push(8, 1, 2, &[0, 1, 0xFF, 0])]);
    assert_eq!(desk.cpu.memory[100..102], [1, 2]);
    // Again and again, until it is deleted.
    assert_eq!(told(&desk.test(8, &modify(2, 0, 0x0300, [9, 9]))), [answer(8, 1)]);
    for round in 0..3 {
        desk.cpu.memory[100] = 0;
        desk.point(Point::End);
        let expected = if round == 0 { vec![push(8, 1, 2, &[0, 1, 0xFF, 0])] } else { vec![] };
        assert_eq!((told(&desk.answers()), desk.cpu.memory[100]), (expected, 9));
    }
    // Disabled, enabled.
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 8, 1))), [answer(0x0D, 2)]);
    assert!(desk.armed.is_empty());
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 8, 1))), [refused(0x0D, 2, 0xD0A5)]);
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 8, 1))), [answer(0x0E, 2)]);
    assert_eq!(desk.armed.len(), 2, "the writes, and a result");
    desk.test(0x0F, &about(0x0F, 8, 1));
    desk.patience_ends();
    assert_eq!(told(&desk.answers()), [answer(0x0F, 1)]);
    assert!(desk.armed.is_empty());
}

#[test]
fn many_variables_each_with_its_code() {
    let mut desk = desk();
    // MB 4 three times, M 7.2, DB9.DBW 0, T 3, DB8.DBB 0, local data.
    let addresses = [
        [0x01, 3, 0, 0, 0, 4],
        [0x00, 2, 0, 0, 0, 7],
        [0x72, 1, 0, 9, 0, 0],
        [0x54, 1, 0, 0, 0, 3],
        [0x71, 1, 0, 8, 0, 0],
        [0xC1, 1, 0, 0, 0, 0],
    ]
    .concat();
    let length = 2 + 8 + 6 + 6 + 6 + 6 + 6;
    let request = test_data(test_words(0, 1, length, 0), &[], &[&[0, 6][..], &addresses].concat());
    let values = [
        &[0, 6, 0xFF, 9, 0, 3, 4, 5, 6, 0, 0xFF, 9, 0, 1, 1, 0, 0xFF, 9, 0, 2, 0x90, 0x91][..],
        &[0xFF, 9, 0, 2, 0x20, 3, 0x0A, 0, 0, 0, 0x0A, 0, 0, 0],
    ]
    .concat();
    assert_eq!(told(&desk.test(2, &request))[1], push(2, 1, 1, &values));
    let data = [0, 2, 0x01, 1, 0, 0, 0, 4, 0x71, 1, 0, 8, 0, 0, 0, 9, 0, 1, 0x77, 0, 0, 9, 0, 1, 0x77, 0];
    let request = test_data(test_words(0, 1, 4, 0), &[], &data);
    assert_eq!(told(&desk.test(8, &request))[1], push(8, 1, 1, &[0, 2, 0xFF, 0x0A]));
    assert_eq!(desk.cpu.memory[4], 0x77);
}

#[test]
fn what_changes_needs_its_right_and_the_rest_does_not() {
    for rights in [Rights::Read, Rights::Write] {
        let mut reader = Desk::with(rights);
        assert_eq!(told(&reader.test(8, &modify(0, 1, 0, [7, 8]))), [refused(8, 1, 0xD0A1)]);
        assert_eq!(reader.cpu.changes, 0);
        assert_eq!(told(&reader.test(2, &monitor(0, 1, 0))).len(), 2);
        assert_eq!(told(&reader.test(0x16, &test_data(test_words(0, 1, 0, 0), &[], &[]))), [answer(0x16, 1)]);
        // Nor by another name.
        reader.test(2, &monitor(1, 0, 0));
        let replace = test_data(test_words(0, 1, 0, 0), &[], &[&[0, 0, 8, 1][..], &modify(0, 1, 0, [7, 8])].concat());
        assert_eq!(told(&reader.test(0x12, &replace)), [refused(0x12, 2, 0xD043)]);
    }
}

#[test]
fn what_is_wrong_with_a_set_up_is_told() {
    let with = |at: usize, value: u16| {
        let mut words = test_words(1, 0, 8, 0x0200);
        words[at] = value;
        test_data(words, &[], &[&[0, 1][..], &MW_100].concat())
    };
    let mut cases: Vec<(Vec<u8>, u16)> = [
        (0, 1, 0xD002),
        (1, 2, 0xD004),
        (1, 0x0100, 0xD004),
        (2, 2, 0xD005),
        (3, 6, 0xD032),
        (3, 10, 0xD032),
        (4, 0, 0xD007),
        (5, 0, 0xD006),
        (6, 2, 0xD008),
        (7, 2, 0xD009),
        (8, 0, 0xD017),
        (9, 0x0100, 0xD00A),
        (9, 0x0600, 0xD00A),
    ]
    .map(|(at, value, code)| (with(at, value), code))
    .into();
    let good = with(0, 0);
    cases.push((good[..3].to_vec(), 0xD031));
    cases.push((good[..good.len() - 1].to_vec(), 0xD033));
    cases.push(([&good[..], &[0]].concat(), 0xD033));
    cases.push((test_data(test_words(1, 0, 8, 0x0200), &[0, 0], &good[24..]), 0xD03F));
    cases.push(([&[0, 10, 0, 8][..], &good[14..]].concat(), 0xD03F));
    cases.push((test_data(test_words(1, 0, 8, 0x0200), &[], &[0, 2, 1, 1, 0, 0, 0, 0]), 0xD05F));
    for (request, code) in cases {
        assert_eq!(told(&desk().test(2, &request)), [refused(2, 1, code)], "{request:02X?}");
    }
    let mut desk = desk();
    for number in 1..=8 {
        assert_eq!(told(&desk.test(2, &good)), [answer(2, number)]);
    }
    assert_eq!(told(&desk.test(2, &good)), [refused(2, 9, 0xD062)], "none is dropped");
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 2, 0))), [refused(0x0E, 9, 0xD001)]);
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 8, 3))), [refused(0x0E, 9, 0xD0A5)]);
    assert_eq!(told(&desk.test(0x06, &good)), [refused(0x06, 9, 0xD003)]);
}

// Block status.

fn fc(number: u16) -> BlockId {
    BlockId::new(BlockKind::Fc, number)
}

/// FC 7: `U M 0.0; L 100; L DB5.DBW 0; BE`, the third with its `AUF DB 5`.
fn watched() -> Desk {
    let mut desk = desk();
    let at = |at, statement, opens| Some(CodeAddress { at, statement, opens });
    let found = vec![at(0, 0, false), at(4, 1, false), at(8, 2, true), at(10, 2, false), at(14, 3, false)];
    desk.cpu.code.insert(fc(7), CodePlaces { code: 99, statements: 4, found });
    desk
}

/// Status of FC 7: registers of the head, lines.
fn status(result: u16, head: u8, lines: &[(u16, u8)]) -> Vec<u8> {
    let mut data = vec![0, lines.len() as u8, 0, head];
    lines.iter().for_each(|(at, registers)| data.extend_from_slice(&[(at >> 8) as u8, *at as u8, 0, *registers]));
    test_data(test_words(1, 0, result, 0x0600), &[0, 0x0C, 0, 7, 0, 0, 0, 16], &data)
}

/// A pass: for each statement that ran, its ACCU1 behind it; before it, one less.
fn pass(accus: &[Option<u32>]) -> Pass {
    let line = |accu: Option<u32>, db: u16| {
        accu.map_or_else(PassLine::default, |accu| PassLine {
            times: 1,
            status: 0x107,
            accus: [accu, accu + 0x10],
            addresses: [0x8300_0008, 0x8400_0010],
            blocks: [db, 0],
        })
    };
    Pass {
        end: PassEnd::Whole,
        statements: accus.len() as u32,
        lines: accus.iter().map(|accu| line(*accu, 5)).collect(),
        before: accus.iter().map(|accu| line(accu.map(|accu| accu - 1), 4)).collect(),
        ..Pass::default()
    }
}

#[test]
fn each_enable_asks_for_one_pass_and_pushes_its_lines() {
    let mut desk = watched();
    let request = status(2 + 6 + 4 + 12 + 8 + 6, 0x03, &[(0, 0x01), (4, 0x06), (8, 0x20), (14, 0x02)]);
    assert_eq!(told(&desk.test(0x13, &request)), [answer(0x13, 1)]);
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 0x13, 1))), [answer(0x0E, 2)]);
    let Ask::Pass(order) = &desk.armed[0].ask else { panic!("no pass is asked for") };
    assert_eq!((order.block, order.first, order.count, order.before), (fc(7), 0, 4, true));
    desk.pass(pass(&[Some(1), Some(100), Some(7), Some(8)]));
    let head = [0x01, 0x07, 0, 0, 0, 0];
    let expected = [
        &[0, 0][..],
        &head,
        &[0, 0, 0x01, 0x07],
        &[0, 4, 0, 0, 0, 100, 0, 0, 0, 116],
        // `AUF DB 5` alone: the data block is another one already.
        &[0, 8, 0x0A, 0, 0, 5, 0, 0],
        &[0, 14, 0, 0, 0, 8],
    ]
    .concat();
    assert_eq!(told(&desk.answers()), [push(0x13, 1, 1, &expected)]);
    // What did not run has no line.
    desk.test(0x0E, &about(0x0E, 0x13, 1));
    desk.pass(pass(&[Some(1), None, None, Some(8)]));
    let expected = [&[0, 0][..], &head, &[0, 0, 0x01, 0x07], &[0, 14, 0, 0, 0, 8]].concat();
    assert_eq!(told(&desk.answers()), [push(0x13, 1, 1, &expected)]);
}

#[test]
fn a_line_that_only_opens_the_data_block_shows_the_rest_as_before() {
    let mut desk = watched();
    desk.test(0x13, &status(2 + 2 * (2 + 4 + 6), 0, &[(8, 0x22), (10, 0x22)]));
    desk.test(0x0E, &about(0x0E, 0x13, 1));
    desk.pass(pass(&[Some(1), Some(100), Some(7), Some(8)]));
    let expected =
        [&[0, 0][..], &[0, 8, 0, 0, 0, 6, 0x0A, 0, 0, 5, 0, 0], &[0, 10, 0, 0, 0, 7, 0x0A, 0, 0, 5, 0, 0]].concat();
    assert_eq!(told(&desk.answers()), [push(0x13, 1, 1, &expected)]);
}

#[test]
fn the_old_form_has_a_pair_for_each_word() {
    let mut desk = watched();
    let data = [
        [0x80, 0x00],
        [0x80, 0x01],
        [0x00, 0x00],
        [0x80, 0x80],
        [0x00, 0x00],
        [0x80, 0x08],
        [0x80, 0x06],
        [0x00, 0x00],
        [0x80, 0x80],
    ]
    .concat();
    let length = 2 + 2 + (2 + 2 + 8) + (2 + 2 + 6) + (2 + 2 + 8);
    let request = test_data(test_words(1, 0, length, 0x0600), &[0, 0x0C, 0, 7, 0, 0, 0, 16], &data);
    assert_eq!(told(&desk.test(1, &request)), [answer(1, 1)]);
    desk.test(0x0E, &about(0x0E, 1, 1));
    desk.pass(pass(&[Some(1), Some(100), Some(7), Some(8)]));
    let expected = [
        &[0, 0, 1, 7][..],
        &[0, 0, 1, 7, 0, 0, 0, 1, 0, 0, 0, 17],
        &[0, 8, 1, 7, 0x0A, 0, 0, 5, 0, 0],
        &[0, 10, 1, 7, 0x83, 0, 0, 8, 0x84, 0, 0, 16],
    ]
    .concat();
    assert_eq!(told(&desk.answers()), [push(1, 1, 1, &expected)]);
}

#[test]
fn a_block_that_is_not_called_is_waited_for() {
    let mut desk = watched();
    desk.test(0x13, &status(6, 0, &[(4, 0x01)]));
    desk.test(0x0E, &about(0x0E, 0x13, 1));
    for _ in 0..3 {
        desk.pass(Pass::default());
        assert_eq!(told(&desk.answers()), []);
    }
    // No room: not at once, but soon.
    desk.pass(Pass { end: PassEnd::Full, ..Pass::default() });
    assert!(desk.armed.is_empty());
    desk.connection.tick(1000);
    let due = desk.connection.next_tick().expect("again");
    desk.connection.tick(due - 1);
    desk.serve();
    assert!(desk.armed.is_empty());
    desk.connection.tick(due);
    desk.serve();
    desk.pass(pass(&[Some(1), Some(100), Some(7), Some(8)]));
    assert_eq!(told(&desk.answers()), [push(0x13, 1, 1, &[0, 0, 0, 4, 1, 7])]);
    // Deleted while it waits: a pass that comes soon is still told.
    desk.test(0x0E, &about(0x0E, 0x13, 1));
    assert_eq!(told(&desk.test(0x0F, &about(0x0F, 0x13, 1))), []);
    desk.pass(pass(&[Some(1), Some(100), Some(7), Some(8)]));
    assert_eq!(told(&desk.answers()), [push(0x13, 1, 1, &[0, 0, 0, 4, 1, 7]), answer(0x0F, 1)]);
    desk.test(0x13, &status(6, 0, &[(4, 0x01)]));
    desk.test(0x0E, &about(0x0E, 0x13, 1));
    desk.test(0x0F, &about(0x0F, 0x13, 1));
    desk.patience_ends();
    assert_eq!(told(&desk.answers()), [answer(0x0F, 1)]);
    assert!(desk.armed.is_empty());
}

#[test]
fn a_call_environment_narrows_the_passes() {
    let with = |environment: &[u16]| {
        let environment: Vec<u8> = environment.iter().flat_map(|word| word.to_be_bytes()).collect();
        let more = [&[0, 0x0C, 0, 7, 0, 0, 0, 16][..], &environment].concat();
        test_data(test_words(1, 0, 6, 0x0601), &more, &[0, 1, 0, 0, 0, 4, 0, 1])
    };
    for (environment, from, db) in
        [(&[0, 1, 0x0E, 20][..], Some(BlockId::new(BlockKind::Fb, 20)), 0), (&[2, 0x0A00, 21, 0], None, 21)]
    {
        let mut desk = watched();
        assert_eq!(told(&desk.test(0x13, &with(environment))), [answer(0x13, 1)]);
        desk.test(0x0E, &about(0x0E, 0x13, 1));
        let Ask::Pass(order) = &desk.armed[0].ask else { panic!("no pass is asked for") };
        assert_eq!((order.from, order.db), (from, db));
    }
    for environment in [&[0, 0x0101, 8, 1, 0][..], &[1, 1, 8, 1], &[2, 0x000A, 0, 21]] {
        assert_eq!(told(&watched().test(0x13, &with(environment))), [refused(0x13, 1, 0xD025)]);
    }
    assert_eq!(told(&watched().test(0x13, &with(&[]))), [refused(0x13, 1, 0xD03F)]);
}

#[test]
fn what_cannot_be_watched_is_refused() {
    let good = status(6, 0, &[(4, 0x01)]);
    let changed = |at: usize, value: u8| {
        let mut request = good.clone();
        request[at] = value;
        request
    };
    for (request, code) in [
        (changed(25, 0x0A), 0xD011),
        (changed(27, 8), 0xD011),
        (status(6, 0, &[(2, 0x01)]), 0xD012),
        (status(6, 0, &[(16, 0x01)]), 0xD012),
        (status(5, 0, &[(4, 0x01)]), 0xD032),
        (status(6, 0, &[(4, 0x80)]), 0xD05F),
    ] {
        assert_eq!(told(&watched().test(0x13, &request)), [refused(0x13, 1, code)], "{request:02X?}");
    }
    let mut desk = watched();
    assert_eq!(told(&desk.test(0x13, &changed(27, 8)))[0].code, 0xD011);
    assert_eq!(told(&desk.test(0x13, &good)), [answer(0x13, 1)], "nothing of it is left");
}

#[test]
fn what_cuts_a_pass_and_what_ends_it_is_told() {
    let mut desk = watched();
    let enabled = |desk: &mut Desk| {
        assert_eq!(told(&desk.test(0x0E, &about(0x0E, 0x13, 1))), [answer(0x0E, 2)]);
    };
    desk.test(0x13, &status(6, 0, &[(4, 0x01)]));
    let line = [0, 0, 0, 4, 0x01, 0x07];
    for (change, code, data) in [
        (Pass { cut: 3, ..pass(&[Some(1); 4]) }, 0xD0CC, &line[..]),
        (Pass { end: PassEnd::Stopped, ..pass(&[Some(1); 4]) }, 0xD0C2, &line),
        (Pass { end: PassEnd::TooLong, ..Pass::default() }, 0xD0CC, &[]),
    ] {
        enabled(&mut desk);
        desk.pass(change);
        let data = if data.is_empty() { Vec::new() } else { push(0x13, 1, 1, data).data };
        assert_eq!(told(&desk.answers()), [Told { kind: 0x01, service: 0x13, number: 1, code, data }]);
    }
    // The block is another one: the job has ended.
    let ended = Told { kind: 0x01, service: 0x13, number: 1, code: 0xD0C8, data: vec![] };
    enabled(&mut desk);
    desk.pass(Pass { statements: 5, ..pass(&[Some(1); 4]) });
    assert_eq!(told(&desk.answers()), [ended]);
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 0x13, 1))), [refused(0x0E, 1, 0xD0A5)]);
    desk.test(0x13, &status(6, 0, &[(4, 0x01)]));
    desk.cpu.code.get_mut(&fc(7)).expect("there").code = 100;
    enabled(&mut desk);
    desk.pass(pass(&[Some(1); 4]));
    let ended = Told { kind: 0x01, service: 0x13, number: 1, code: 0xD0C8, data: vec![] };
    assert_eq!(told(&desk.answers()), [ended], "as many statements, but others");
}
