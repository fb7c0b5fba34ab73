//! Recordings: a row at every cycle control point, each run of an organization block, losses counted, memory given
//! back.

use ob1_cpu::{Cell, CellError, Cpu, CpuConfig, Frame, ObRun, OperatingState, Piece, RECORDINGS, TooMuch, WATCH_BYTES};
use ob1_ir::{NumberFormat, Op};
use ob1_model::Area;

use crate::common;
use crate::common::*;

/// OB 1 counts in MW 0, and copies the count to DB7.DBW4.
fn bench() -> Bench {
    let count = vec![
        load(mw(0)),
        Op::AddConst { format: NumberFormat::Int, value: 1 },
        transfer(mw(0)),
        transfer(in_db(7, ob1_ir::Width::Word, 4, 0)),
    ];
    let program = program(vec![ob1(count)], vec![db(7, &[0; 8])]);
    let cpu = Cpu::new(CpuConfig::default(), &program, vec![], vec![], common::engine());
    Bench::with(cpu.expect("loads"))
}

fn frame() -> Frame {
    let bytes = |at, len| Piece::Bytes { at, len };
    Frame::of([bytes(Cell::Area(Area::Memory, 0), 2), bytes(Cell::Db(7, 32), 2), bytes(Cell::Db(9, 0), 2)])
}

#[test]
fn every_scan_has_its_row() {
    let mut bench = bench();
    let mut client = bench.cpu.recording_client().expect("the first");
    assert!(bench.cpu.recording_client().is_none(), "there is one");
    // Less room than rows: the ring is used again and again.
    let mut rows = client.record(frame(), 5).expect("little");
    let (mut taken, mut runs, mut bytes) = (0, 0, Vec::new());
    for scan in 1..=400_u64 {
        bench.run();
        if scan % 3 > 0 {
            continue;
        }
        while rows
            .take(|row| {
                taken += 1;
                assert_eq!((row.point, row.state, row.lost), (taken, OperatingState::Run, 0));
                // The row of a scan is taken before the next one.
                assert_eq!(row.scan.scan, taken - 1);
                for piece in [0, 1] {
                    bytes.clear();
                    row.read(piece, &mut bytes).expect("it is there");
                    assert_eq!(bytes, ((taken - 1) as u16).to_be_bytes(), "piece {piece}");
                }
                assert_eq!(row.read(2, &mut bytes), Err(CellError::NoDb));
            })
            .is_some()
        {}
        while let Some(ObRun { ob, began, whole, own }) = rows.take_run() {
            runs += 1;
            assert_eq!((ob, whole), (1, own));
            assert!(began + whole <= bench.clock.now && !whole.is_zero());
        }
    }
    assert_eq!((taken, runs), (399, 399));
}

#[test]
fn what_finds_no_room_is_counted() {
    let mut bench = bench();
    let mut client = bench.cpu.recording_client().expect("the first");
    let mut rows = client.record(frame(), 4).expect("little");
    for _ in 0..10 {
        bench.run();
    }
    let mut seen = Vec::new();
    while rows.take(|row| seen.push((row.point, row.lost))).is_some() {}
    bench.run();
    rows.take(|row| seen.push((row.point, row.lost)));
    assert_eq!(seen, [(1, 0), (2, 0), (3, 0), (4, 0), (11, 6)]);
}

#[test]
fn a_reader_that_goes_makes_room() {
    let mut bench = bench();
    let mut client = bench.cpu.recording_client().expect("the first");
    let too_much = Frame::of([Piece::Bytes { at: Cell::Db(7, 0), len: WATCH_BYTES as u32 + 1 }]);
    assert_eq!(client.record(too_much, 4).map(drop), Err(TooMuch::Watch));
    for _ in 0..20 {
        let all: Vec<_> = (0..RECORDINGS).map(|_| client.record(frame(), 4).expect("room")).collect();
        assert_eq!(client.record(frame(), 4).map(drop), Err(TooMuch::UnderWay));
        bench.run();
        for mut rows in all {
            assert!(!rows.is_over() && rows.take(|row| row.point).is_some());
        }
        bench.run();
    }
    // In STOP too; and the end of a CPU ends its recordings.
    let mut rows = client.record(frame(), 4).expect("room");
    bench.cpu.request(ob1_cpu::Command::Stop);
    bench.cycle();
    bench.cycle();
    let mut states = Vec::new();
    while rows.take(|row| states.push(row.state)).is_some() {}
    assert_eq!(states.last(), Some(&OperatingState::Stop), "{states:?}");
    drop(bench);
    assert!(rows.is_over());
}
