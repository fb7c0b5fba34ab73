//! The exchange with the links: outputs, writes, snapshot, inputs; groups land whole; nobody waits.

mod common;

use common::*;
use ob1_cpu::{
    Cell, CellError, CellWidth, Command, Cpu, CpuConfig, GROUP_ENTRIES, Group, LINKS, Link, OperatingState, Piece, Put,
    TooMuch, WATCH_BYTES, WRITE_BYTES,
};
use ob1_ir::{NumberFormat, Op};
use ob1_model::Area;

/// OB 1 counts in MW 0 and copies the count to MW 100 and DB7.DBW0; MW 20 goes to MW 22.
fn bench() -> Bench {
    let count = vec![
        load(mw(0)),
        Op::AddConst { format: NumberFormat::Int, value: 1 },
        transfer(mw(0)),
        transfer(mw(100)),
        transfer(in_db(7, ob1_ir::Width::Word, 0, 0)),
        load(mw(20)),
        transfer(mw(22)),
    ];
    let mut protected = db(8, &[1, 2]);
    protected.read_only = true;
    let program = program(vec![ob1(count)], vec![db(7, &[0; 600]), protected]);
    let mut bench =
        Bench::with(Cpu::new(CpuConfig::default(), &program, vec![], vec![], common::engine()).expect("loads"));
    bench.run();
    bench
}

fn memory(byte: u32) -> Cell {
    Cell::Area(Area::Memory, byte * 8)
}

fn bytes(at: Cell, len: u32) -> Piece {
    Piece::Bytes { at, len }
}

fn word(link: &Link, at: usize) -> u16 {
    let bytes = link.newest().expect("a snapshot").bytes();
    u16::from_be_bytes([bytes[at], bytes[at + 1]])
}

fn group(id: u64, puts: &[Put]) -> Group {
    Group::new(id, puts.to_vec()).expect("little")
}

#[test]
fn everything_watched_is_of_one_scan() {
    let mut bench = bench();
    let mut link = bench.cpu.link().expect("the first");
    let generation =
        link.watch(&[bytes(memory(0), 2), bytes(Cell::Db(7, 0), 2), bytes(memory(100), 2)]).expect("little");
    let mut last = 0;
    for _ in 0..200 {
        bench.cycle();
        link.take();
        let snapshot = link.newest().expect("a snapshot");
        assert!(snapshot.scan() > last && snapshot.generation() == generation);
        last = snapshot.scan();
        let count = word(&link, 0);
        assert_eq!((word(&link, 2), word(&link, 4)), (count, count), "of one scan");
        // It is taken before the program runs.
        assert_eq!(bench.mw(0), u32::from(count) + 1);
    }
}

#[test]
fn a_group_lands_whole_and_its_answer_follows_its_snapshot() {
    let mut bench = bench();
    let mut link = bench.cpu.link().expect("the first");
    link.watch(&[bytes(memory(20), 4), bytes(Cell::Db(7, 100 * 8), 4)]).expect("little");
    let puts = [
        Put::Value(memory(20), CellWidth::Word, 0x1234),
        Put::Bytes(Cell::Db(7, 100 * 8), Box::from([1, 2, 3, 4])),
        Put::Value(Cell::Area(Area::Memory, 24 * 8 + 3), CellWidth::Bit, 1),
    ];
    bench.set(24, CellWidth::Byte, 0x80);
    link.write(group(5, &puts)).expect("room");
    bench.cycle();
    link.take();
    let answer = link.answer().expect("landed");
    assert_eq!((answer.id(), answer.outcome()), (5, Ok(())));
    // Before the program: MW 22 is the old one, MW 20 the new one.
    assert_eq!(link.newest().expect("it came first").bytes(), [0x12, 0x34, 0, 0, 1, 2, 3, 4]);
    assert_eq!(bench.mw(22), 0x1234, "the program of the same cycle sees it");
    assert_eq!(bench.mb(24), 0x88, "a bit changes no other");

    for (wrong, error) in [
        (Put::Value(Cell::Db(9, 0), CellWidth::Word, 0), CellError::NoDb),
        (Put::Value(Cell::Db(8, 0), CellWidth::Byte, 0), CellError::ReadOnly),
        (Put::Bytes(Cell::Db(8, 0), Box::from([1])), CellError::ReadOnly),
        (Put::Bytes(Cell::Db(7, 598 * 8), Box::from([1, 2, 3])), CellError::Outside),
        (Put::Value(memory(255), CellWidth::Word, 0), CellError::Outside),
        (Put::Value(memory(30), CellWidth::Byte, 256), CellError::Value),
        (Put::Value(Cell::Counter(1), CellWidth::Word, 1000), CellError::Value),
        (Put::Value(Cell::Timer(1), CellWidth::Word, 0), CellError::ReadOnly),
        (Put::Bytes(Cell::Counter(1), Box::from([1])), CellError::Outside),
    ] {
        link.write(group(6, &[Put::Value(memory(20), CellWidth::Word, 0xFFFF), wrong.clone()])).expect("room");
        bench.cycle();
        link.take();
        assert_eq!(link.answer().expect("an answer").outcome(), Err((1, error)), "{wrong:?}");
        assert_eq!(bench.mw(20), 0x1234, "{wrong:?}: nothing was written");
    }
}

#[test]
fn in_stop_too() {
    let mut bench = bench();
    let mut link = bench.cpu.link().expect("the first");
    bench.cpu.request(Command::Stop);
    bench.cycle();
    link.watch(&[bytes(memory(20), 2)]).expect("little");
    link.write(group(1, &[Put::Value(memory(20), CellWidth::Word, 7)])).expect("room");
    assert_eq!(bench.cycle().state, OperatingState::Stop);
    link.take();
    assert_eq!(link.answer().map(|answer| answer.outcome()), Some(Ok(())));
    assert_eq!((word(&link, 0), link.newest().map(|s| s.state())), (7, Some(OperatingState::Stop)));
}

/// Each link writes in turn, none more than its share, all together no more than the bytes of one scan.
#[test]
fn links_take_turns_within_the_bytes_of_a_scan() {
    let mut bench = bench();
    let mut links: Vec<Link> = (0..LINKS).map(|_| bench.cpu.link().expect("there are so many")).collect();
    assert!(bench.cpu.link().is_none());
    let half = |fill: u8| Put::Bytes(Cell::Db(7, 0), vec![fill; 500].into());
    for (number, link) in links.iter_mut().enumerate() {
        for id in 0..4 {
            let puts: Vec<Put> = (0..3).map(|_| half(number as u8)).collect();
            link.write(group(id, &puts)).expect("room");
        }
    }
    let mut landed = vec![0; LINKS];
    let mut scans = 0;
    while landed.iter().sum::<usize>() < 4 * LINKS {
        bench.cycle();
        scans += 1;
        let mut now = 0;
        for (link, landed) in links.iter_mut().zip(&mut landed) {
            link.take();
            while let Some(answer) = link.answer() {
                assert_eq!((answer.id(), answer.outcome()), (*landed as u64, Ok(())), "in order");
                *landed += 1;
                now += 1;
            }
        }
        assert!(now * 1500 <= WRITE_BYTES && now > 0, "{now} groups in a scan");
        let (least, most) = (landed.iter().min().expect("some"), landed.iter().max().expect("some"));
        assert!(most - least <= 2, "{landed:?}: in turn");
    }
    assert!(scans >= 4 * LINKS * 1500 / WRITE_BYTES, "{scans}");
}

/// It has its snapshot as soon as it reads again; until then the CPU goes on, and the answers wait.
#[test]
fn a_reader_that_sleeps_changes_nothing() {
    let mut bench = bench();
    let mut link = bench.cpu.link().expect("the first");
    link.watch(&[bytes(memory(0), 2)]).expect("little");
    for id in 0..20 {
        link.write(group(id, &[Put::Value(memory(20), CellWidth::Word, id as u32)])).expect("room");
    }
    let before = bench.mw(0);
    for _ in 0..100 {
        bench.cycle();
    }
    assert_eq!(bench.mw(0), before + 100);
    let mut answers = 0;
    for _ in 0..20 {
        link.take();
        while link.answer().is_some() {
            answers += 1;
        }
        bench.cycle();
    }
    assert_eq!((answers, bench.mw(20)), (20, 19));
    bench.cycle();
    link.take();
    assert!(u32::from(word(&link, 0)) >= before + 110, "fresh again");
}

#[test]
fn what_is_missing_is_told_of_its_piece() {
    let mut bench = bench();
    let mut link = bench.cpu.link().expect("the first");
    link.watch(&[
        bytes(Cell::Db(99, 0), 4),
        bytes(Cell::Db(7, 598 * 8), 4),
        Piece::Value(Cell::Counter(3), CellWidth::Word),
        Piece::Value(Cell::Peripheral(0), CellWidth::DWord),
        bytes(memory(300), 2),
    ])
    .expect("little");
    bench.cpu.write(Cell::Counter(3), CellWidth::Word, 42).expect("a counter");
    bench.cpu.write(Cell::Db(7, 598 * 8), CellWidth::Word, 0xABCD).expect("there");
    bench.cycle();
    link.take();
    let snapshot = link.newest().expect("a snapshot");
    let filled: Vec<_> = snapshot.filled().iter().map(|filled| (filled.len, filled.error)).collect();
    assert_eq!(
        filled,
        [
            (0, Some(CellError::NoDb)),
            (2, Some(CellError::Outside)),
            (2, None),
            (0, Some(CellError::NoModule)),
            (0, Some(CellError::Outside)),
        ]
    );
    assert_eq!(snapshot.bytes(), [0, 0, 0, 0, 0xAB, 0xCD, 0, 0, 0, 42, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn bounds() {
    let mut bench = bench();
    let mut link = bench.cpu.link().expect("the first");
    let put = Put::Value(memory(0), CellWidth::Byte, 0);
    assert!(Group::new(1, vec![put.clone(); GROUP_ENTRIES]).is_ok());
    assert_eq!(Group::new(1, vec![put; GROUP_ENTRIES + 1]).err(), Some(TooMuch::Group));
    assert_eq!(Group::new(1, vec![Put::Bytes(memory(0), vec![0; WRITE_BYTES + 1].into())]).err(), Some(TooMuch::Group));
    assert_eq!(link.watch(&[bytes(memory(0), WATCH_BYTES as u32 + 1)]).err(), Some(TooMuch::Watch));
    let scattered: Vec<Piece> = (0..3000).map(|n| bytes(Cell::Db(n, 0), 4)).collect();
    assert_eq!(link.watch(&scattered).err(), Some(TooMuch::Watch));
    // What is watched anew in every cycle leaves nothing behind.
    for round in 1..500u64 {
        assert_eq!(link.watch(&[bytes(memory(0), 1 + (round % 7) as u32)]), Ok(round));
        bench.cycle();
        link.take();
        assert_eq!(link.newest().map(|snapshot| snapshot.generation()), Some(round));
    }
    drop(bench);
    assert!(link.is_closed());
}
