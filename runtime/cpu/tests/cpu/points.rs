//! Cells read and written at a point of the cycle.

use ob1_cpu::{Cell, CellError, Command, Job, Piece, PointJob, Put, Width};
use ob1_model::{Area, POINT_JOBS, Point, PointItem, PointOrder};

use crate::common::window::Looker;
use crate::common::*;

fn memory(byte: u32) -> Cell {
    Cell::Area(Area::Memory, byte * 8)
}

fn order(point: Point, items: &[PointItem]) -> PointOrder {
    PointOrder { point, stays: false, items: items.to_vec() }
}

fn word(byte: u32) -> PointItem {
    PointItem::Read(Piece::Bytes { at: memory(byte), len: 2 })
}

fn put(byte: u32, value: u32) -> PointItem {
    PointItem::Write(Put::Value(memory(byte), Width::Word, value))
}

/// OB 1 copies MW 0 to MW 2.
fn bench() -> (Bench, Looker) {
    let copy = vec![load(mw(0)), transfer(mw(2))];
    let mut bench = Bench::new(&program(vec![ob1(copy)], vec![]));
    let looker = Looker::of(&mut bench.cpu).expect("the first");
    bench.run();
    (bench, looker)
}

type Outcomes = Vec<Result<Vec<u8>, CellError>>;

fn back(looker: &mut Looker) -> Option<(u64, Outcomes)> {
    match looker.link.take()? {
        Job::Point(job) => Some((job.id(), job.outcomes().map(|one| one.map(<[u8]>::to_vec)).collect())),
        other => panic!("{other:?}"),
    }
}

#[test]
fn each_point_sees_its_part_of_the_cycle() {
    let (mut bench, mut looker) = bench();
    // Modified at the begin: the program of the cycle has it, and the end sees what the program made of it.
    looker.link.hand(PointJob::new(1, order(Point::End, &[word(0), word(2), put(0, 9)]))).expect("room");
    looker.link.hand(PointJob::new(2, order(Point::Start, &[put(0, 0x1234), word(2)]))).expect("room");
    looker.link.hand(PointJob::new(3, order(Point::Now, &[word(0)]))).expect("room");
    bench.cycle();
    assert_eq!(back(&mut looker), Some((3, vec![Ok(vec![0, 0])])));
    assert_eq!(back(&mut looker), Some((2, vec![Ok(vec![]), Ok(vec![0, 0])])));
    assert_eq!(back(&mut looker), Some((1, vec![Ok(vec![0x12, 0x34]), Ok(vec![0x12, 0x34]), Ok(vec![])])));
    assert_eq!((bench.mw(0), bench.mw(2)), (9, 0x1234), "written behind the program");
    bench.cycle();
    assert_eq!(back(&mut looker), None, "once");
}

#[test]
fn each_item_has_its_outcome() {
    let (mut bench, mut looker) = bench();
    let outside = PointItem::Read(Piece::Bytes { at: Cell::Db(5, 0), len: 4 });
    let items = [put(0, 7), outside, word(0), PointItem::Write(Put::Value(Cell::Timer(999), Width::Word, 0)), word(2)];
    looker.link.hand(PointJob::new(1, order(Point::Now, &items))).expect("room");
    bench.cycle();
    let outcomes = vec![Ok(vec![]), Err(CellError::NoDb), Ok(vec![0, 7]), Err(CellError::NoTimer), Ok(vec![0, 0])];
    assert_eq!(back(&mut looker), Some((1, outcomes)));
}

#[test]
fn what_stays_is_done_in_each_cycle_until_it_is_forgotten() {
    let (mut bench, mut looker) = bench();
    let stays = PointOrder { stays: true, ..order(Point::Start, &[put(0, 5)]) };
    looker.link.hand(PointJob::new(1, stays)).expect("room");
    for _ in 0..5 {
        bench.set(0, Width::Word, 1);
        bench.cycle();
        assert_eq!((bench.mw(2), back(&mut looker)), (5, None));
    }
    looker.link.forget(1).expect("room");
    bench.cycle();
    assert_eq!(back(&mut looker), Some((1, vec![])), "without an outcome");
    bench.set(0, Width::Word, 1);
    bench.cycle();
    assert_eq!(bench.mw(2), 1);
}

#[test]
fn a_stop_is_a_point_and_in_stop_the_cycle_goes_on() {
    let (mut bench, mut looker) = bench();
    bench.set(0, Width::Word, 3);
    looker.link.hand(PointJob::new(1, order(Point::Stop, &[word(2)]))).expect("room");
    bench.cycle();
    bench.cycle();
    assert_eq!(back(&mut looker), None);
    bench.cpu.request(Command::Stop);
    bench.cycle();
    assert_eq!(back(&mut looker), Some((1, vec![Ok(vec![0, 3])])));
    looker.link.hand(PointJob::new(2, order(Point::Start, &[put(0, 8), word(0)]))).expect("room");
    bench.cycle();
    assert_eq!(back(&mut looker), Some((2, vec![Ok(vec![]), Ok(vec![0, 8])])));
}

#[test]
fn there_are_so_many_places() {
    let (mut bench, mut looker) = bench();
    for id in 0..=POINT_JOBS as u64 {
        looker.link.hand(PointJob::new(id, order(Point::Stop, &[]))).expect("room");
        bench.cycle();
    }
    let Some(Job::Point(job)) = looker.link.take() else { panic!("nothing came back") };
    assert_eq!((job.id(), job.is_full()), (POINT_JOBS as u64, true));
    for id in 0..POINT_JOBS as u64 {
        looker.link.forget(id).expect("room");
    }
    bench.cycle();
    assert_eq!(std::iter::from_fn(|| back(&mut looker)).count(), POINT_JOBS);
    looker.link.hand(PointJob::new(99, order(Point::Now, &[]))).expect("room");
    bench.cycle();
    assert_eq!(back(&mut looker), Some((99, vec![])));
}
