//! What a programming device does with a CPU that holds or has stopped, and forcing. Telegrams are made up.

mod common;

use common::{Desk, test_data, test_words};
use ob1_model::{BlockId, BlockKind, Breakpoint, CodeAddress, DebugEnd, DebugOrder, Held, HeldBlock, Resume};
use ob1_s7::Rights;
use ob1_s7::server::{CodePlaces, Settings};

const FC_7: BlockId = BlockId::new(BlockKind::Fc, 7);
const OB_1: BlockId = BlockId::new(BlockKind::Ob, 1);

/// FC 7 has a statement at each even address.
fn desk() -> Desk {
    let mut desk = Desk::with(Rights::Operate);
    let found = (0..8).map(|n| Some(CodeAddress { at: n * 2, statement: n, opens: false })).collect();
    desk.cpu.code.insert(FC_7, CodePlaces { code: 1, statements: 8, found });
    desk
}

fn held(statement: u32) -> Held {
    let block = |block, statement, blocks, address| HeldBlock {
        block,
        statement,
        blocks,
        ob: 1,
        priority: 1,
        began: [0x26, 0x11, 0x29, 4, 5, 6, 7, 8],
        address,
    };
    Held {
        stack: vec![block(FC_7, statement, [10, 0], Some(statement as u16 * 2)), block(OB_1, 3, [0, 0], Some(12))],
        status: 0x0086,
        accus: [1, 2, 3, 4],
        addresses: [5, 6],
        local: vec![9, 8, 7],
        start: std::array::from_fn(|n| n as u8 + 0xA0),
    }
}

/// Kind, service, number, code, data of each telegram.
fn told(telegrams: &[Vec<u8>]) -> Vec<(u8, u8, u8, u16, Vec<u8>)> {
    let one = |t: &Vec<u8>| (t[15], t[16], t[17], u16::from_be_bytes([t[20], t[21]]), t[26..].to_vec());
    telegrams.iter().map(one).collect()
}

fn done(service: u8, number: u8) -> (u8, u8, u8, u16, Vec<u8>) {
    (0x81, service, number, 0, Vec::new())
}

fn refused(service: u8, number: u8, code: u16) -> (u8, u8, u8, u16, Vec<u8>) {
    (0x81, service, number, code, Vec::new())
}

fn about(service: u8, function: u8, number: u8) -> Vec<u8> {
    let front: &[u8] = if service == 0x0F { &[0, 1] } else { &[] };
    test_data(test_words(0, 1, 0, 0), &[], &[front, &[function, number]].concat())
}

/// A breakpoint in FC 7.
fn breakpoint(begin: u16, address: u8) -> Vec<u8> {
    test_data(test_words(begin, 0, 38, 0x0500), &[0, 0x0C, 0, 7, 0, address, 0, 0], &[0, 0])
}

fn stack(data: &[u8]) -> Vec<u8> {
    test_data(test_words(0, 0, 0, 0), &[], data)
}

fn leave(mode: u8) -> Vec<u8> {
    test_data(test_words(0, 1, 38, 0), &[], &[mode, 0])
}

fn breakpoints(statements: &[u32]) -> DebugOrder {
    DebugOrder::Breakpoints(statements.iter().map(|s| Breakpoint { block: FC_7, statement: *s }).collect())
}

/// What a breakpoint tells: both places, the status word, accumulators, address registers, data blocks.
const HELD_AT_2: [u8; 38] = [
    0, 0x0C, 0, 7, 0, 4, 0, 0x0C, 0, 7, 0, 4, 0, 0, 0, 0x86, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 5, 0, 0, 0, 6, 0x0A, 0,
    0, 10, 0, 0,
];

fn result(data: &[u8]) -> Vec<u8> {
    [&[0, 4, 0, data.len() as u8, 1, 0, 0, 1][..], data].concat()
}

#[test]
fn a_breakpoint_is_a_job_that_tells_where_the_cpu_holds() {
    let mut desk = desk();
    assert_eq!(told(&desk.test(0x0A, &breakpoint(0, 4))), [done(0x0A, 1)]);
    assert_eq!(told(&desk.test(0x0A, &breakpoint(1, 8))), [done(0x0A, 2)], "waits to be enabled");
    assert_eq!(desk.cpu.orders, [breakpoints(&[2])]);
    assert_eq!(told(&desk.test(0x0E, &about(0x0E, 0x0A, 2))), [done(0x0E, 3)]);
    assert_eq!(desk.cpu.orders[1..], [breakpoints(&[2, 4])]);
    desk.cpu.held = Some(held(2));
    desk.hold(DebugEnd::Held);
    assert_eq!(told(&desk.answers()), [(1, 0x0A, 1, 0, result(&HELD_AT_2))]);

    // One statement: there is no breakpoint, and the service has the result.
    assert_eq!(told(&desk.test(0x0B, &leave(1))), [done(0x0B, 3)]);
    assert_eq!(desk.resume(), Some(Resume::Over));
    desk.cpu.held = Some(held(3));
    desk.hold(DebugEnd::Held);
    let [pushed] = &told(&desk.answers())[..] else { panic!("one") };
    assert_eq!((pushed.0, pushed.1, pushed.2, pushed.4[13]), (1, 0x0B, 3, 6));
    // To the next breakpoint: that one tells it.
    assert_eq!(told(&desk.test(0x0B, &leave(0))), [done(0x0B, 3)]);
    assert_eq!(desk.resume(), Some(Resume::Run));
    desk.hold(DebugEnd::Runs);
    desk.cpu.held = Some(held(4));
    desk.hold(DebugEnd::Held);
    assert_eq!(told(&desk.answers())[0].1, 0x0A);

    let replacing = test_data(test_words(0, 1, 0, 0), &[], &[&[0, 0, 0x0A, 2][..], &breakpoint(0, 6)].concat());
    assert_eq!(told(&desk.test(0x12, &replacing)), [refused(0x12, 3, 0xD0A8)]);
    // One that is not set: there is nothing to take back.
    assert_eq!(told(&desk.test(0x0A, &breakpoint(1, 10))), [done(0x0A, 3)]);
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 0x0A, 3))), [refused(0x0D, 4, 0xD0A5)]);
    assert_eq!(told(&desk.test(0x0F, &about(0x0F, 0x0A, 3))), [done(0x0F, 3)]);
    assert_eq!(desk.cpu.orders.len(), 2);

    // Without breakpoints, and out of HOLD, others may set theirs.
    assert_eq!(told(&desk.test(0x0D, &about(0x0D, 0x0A, 1))), [done(0x0D, 3)]);
    assert_eq!(told(&desk.test(0x0F, &about(0x0F, 0x0A, 2))), [done(0x0F, 2)]);
    assert_eq!(desk.cpu.orders[2..], [breakpoints(&[4]), breakpoints(&[])], "it holds: no end");
    assert_eq!(told(&desk.test(0x0B, &leave(0))), [done(0x0B, 2)]);
    desk.cpu.held = None;
    desk.hold(DebugEnd::Runs);
    assert_eq!(desk.cpu.orders.last(), Some(&DebugOrder::End));
    assert!(desk.armed.is_empty(), "{:?}", desk.armed);
}

#[test]
fn breakpoints_are_refused_where_there_can_be_none() {
    let mut desk = desk();
    assert_eq!(told(&desk.test(0x0A, &breakpoint(0, 3))), [refused(0x0A, 1, 0xD012)], "no statement there");
    let missing = test_data(test_words(0, 0, 38, 0x0500), &[0, 0x0C, 0, 8, 0, 0, 0, 0], &[0, 0]);
    assert_eq!(told(&desk.test(0x0A, &missing)), [refused(0x0A, 1, 0xD011)]);
    for n in 0..4 {
        assert_eq!(told(&desk.test(0x0A, &breakpoint(0, n * 2))), [done(0x0A, n + 1)]);
    }
    assert_eq!(told(&desk.test(0x0A, &breakpoint(0, 8))), [refused(0x0A, 5, 0xD063)], "four");
    assert_eq!(told(&desk.test(0x0B, &leave(0))), [refused(0x0B, 5, 0xD081)], "it does not hold");
    let short = test_data(test_words(0, 0, 38, 0x0500), &[0, 0x0C, 0, 7], &[0, 0]);
    assert_eq!(told(&desk.test(0x0A, &short)), [refused(0x0A, 5, 0xD03F)]);

    for rights in [Rights::Read, Rights::Write] {
        let mut desk = Desk::with(rights);
        for (function, request) in [
            (0x0A, breakpoint(0, 4)),
            (0x0B, leave(0)),
            (0x0C, stack(&[])),
            (7, force(2, &[0x10, 1])),
            (9, force(2, &[0x10, 1])),
        ] {
            assert_eq!(told(&desk.test(function, &request)), [refused(function, 1, 0xD0A1)], "{function:02X}");
        }
        assert_eq!(desk.cpu.changes, 0);
    }
}

#[test]
fn the_stacks_of_a_cpu_that_has_stopped() {
    let mut desk = desk();
    for service in [3, 4, 5] {
        assert_eq!(told(&desk.test(service, &stack(&[1, 0]))), [refused(service, 1, 0xD081)], "it runs");
    }
    (desk.cpu.runs, desk.cpu.held) = (false, Some(held(2)));
    let data = |telegrams: &[Vec<u8>]| told(telegrams)[0].4[8..].to_vec();

    let interrupt = data(&desk.test(3, &stack(&[0, 0])));
    assert_eq!(interrupt.len(), 76);
    assert_eq!(interrupt[..12], [0, 0x0C, 0, 7, 0, 4, 0x0A, 0, 0, 10, 0, 0]);
    assert_eq!(interrupt[16..42], [0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0, 5, 0, 0, 0, 6, 0, 0]);
    assert_eq!(interrupt[42..50], [0, 0x86, 0, 0x0C, 0, 7, 0, 4]);
    assert_eq!((interrupt[56], interrupt[75]), (0xA0, 0xB3), "start information, date and time");

    let blocks = data(&desk.test(4, &stack(&[0, 0])));
    assert_eq!(blocks.len(), 16 + 28, "an organization block has 12 bytes more");
    assert_eq!(blocks[16..22], [0, 0x08, 0, 1, 0, 12]);
    assert_eq!(blocks[32..], [1, 0, 0, 0, 0x26, 0x11, 0x29, 4, 5, 6, 7, 8]);

    // Depth 1 is the organization block, 2 what it has called.
    let local = data(&desk.test(5, &stack(&[1, 2])));
    assert_eq!(local[..12], [0, 0x0C, 0, 7, 0, 4, 0, 4, 0, 0, 0, 0]);
    let local = data(&desk.test(5, &stack(&[1, 1])));
    assert_eq!(local[..16], [0, 8, 0, 1, 0, 12, 0, 4, 1, 1, 1, 1, 1, 0, 0, 0], "its local data, asked for by level");
    assert_eq!(told(&desk.test(5, &stack(&[1, 3])))[0].3, 0xD05F, "not so deep");
    assert_eq!(told(&desk.test(5, &stack(&[9, 0])))[0].3, 0xD05F, "no such class");
}

#[test]
fn memory_is_reset_in_stop_only() {
    let mut desk = desk();
    assert_eq!(told(&desk.test(0x0C, &stack(&[]))), [refused(0x0C, 1, 0xD081)]);
    desk.cpu.runs = false;
    assert_eq!(told(&desk.test(0x0C, &stack(&[]))), [done(0x0C, 1)]);
}

/// Forces bytes: area and byte of each.
fn force(end: u16, bytes: &[u8]) -> Vec<u8> {
    force_with(0x0100, end, bytes)
}

fn force_with(begin: u16, end: u16, bytes: &[u8]) -> Vec<u8> {
    let cells = bytes.as_chunks::<2>().0;
    let mut data = vec![0, cells.len() as u8];
    data.extend(cells.iter().flat_map(|[area, byte]| [area | 1, 1, 0, 0, 0, *byte]));
    data.extend(cells.iter().flat_map(|[_, byte]| [0, 9, 0, 1, 0x50 + byte, 0]));
    let result = (2 + cells.len() as u16).next_multiple_of(2);
    test_data(test_words(begin, end, result, 0), &[], &data)
}

#[test]
fn one_job_forces_for_everybody_until_somebody_ends_it() {
    let mut desk = desk();
    let pushed = (1, 7, 0x80, 0, result(&[0, 2, 0xFF, 0xFF]));
    assert_eq!(told(&desk.test(7, &force(2, &[0x10, 1, 0x20, 4]))), [done(7, 0x80), pushed]);
    assert_eq!(desk.cpu.forced.len(), 2);
    assert_eq!(told(&desk.test(9, &force(2, &[0x10, 1]))), [refused(9, 1, 0xD0A4)]);
    // Another connection sees the job, reads, replaces and ends it.
    let mut other = self::desk();
    other.cpu = desk.cpu.clone();
    let list = told(&other.test(0x10, &test_data(test_words(0, 1, 0, 0), &[], &[0, 0])));
    assert_eq!(list[0].4[8..], [7, 0x80, 0, 1, 0x10, 1, 0, 0]);
    let read = told(&other.test(0x11, &about(0x11, 7, 0x80)));
    assert_eq!(read[0].4, force(2, &[0x10, 1, 0x20, 4]), "as it was set up");
    let replacing = [&[0, 0, 7, 0x80][..], &force(2, &[0x20, 6])].concat();
    let replaced = told(&other.test(0x12, &test_data(test_words(0, 1, 0, 0), &[], &replacing)));
    assert_eq!((replaced[0].1, replaced[0].3, replaced[1].1, replaced[1].2), (0x12, 0, 7, 0x80));
    assert_eq!((other.cpu.forced.len(), other.cpu.forced[0].bit), (1, 48));
    for service in [0x0D, 0x0E] {
        assert_eq!(told(&other.test(service, &about(service, 7, 0x80)))[0].3, 0xD0A6);
    }
    assert_eq!(told(&other.test(0x0F, &about(0x0F, 7, 0x80))), [done(0x0F, 1)]);
    assert_eq!(other.cpu.forced, []);
    assert_eq!(told(&other.test(0x11, &about(0x11, 7, 0x80)))[0].3, 0xD043);
}

#[test]
fn what_cannot_be_forced_is_refused() {
    let mut desk = desk();
    assert_eq!(told(&desk.test(7, &force(2, &[0x40, 1])))[0].3, 0xD015, "no such area");
    assert_eq!(told(&desk.test(7, &force_with(1, 2, &[0x10, 1])))[0].3, 0xD004, "it begins at once");
    assert_eq!(told(&desk.test(7, &force_with(0x0100, 1, &[0x10, 1])))[0].3, 0, "an end is not refused");
    let replacing = [&[0, 0, 7, 0x80][..], &force(2, &[0x20, 6])].concat();
    let mut other = self::desk();
    assert_eq!(told(&other.test(0x12, &test_data(test_words(0, 1, 0, 0), &[], &replacing)))[0].3, 0xD043);
}

#[test]
fn an_s7_400_forces_by_another_function() {
    let settings = Settings { rights: Rights::Operate, is_400: true, ..Settings::default() };
    let mut desk = Desk::open(settings, 480);
    desk.test(9, &force(2, &[0x10, 1]));
    let list = told(&desk.test(0x10, &test_data(test_words(0, 1, 0, 0), &[], &[0, 0])));
    assert_eq!(list[0].4[8..12], [9, 0x80, 0, 1]);
}
