//! The access port: served once a scan, a bounded number of items.

use ob1_cpu::{
    Answer, Ask, Cell, CellError, Command, Cpu, CpuConfig, OperatingState, Request, ShortText, TimeOfDay, Width,
};
use ob1_ir::{AccuOp, NumberFormat, Op};
use ob1_model::moment::Moment;
use ob1_model::{Area, Event, Interface};
use ob1_std::services::Period;
use ob1_time::Span;

use crate::common;
use crate::common::*;

fn bench(items: u32, capacity: usize) -> Bench {
    let config = CpuConfig { port_items_per_scan: items, port_capacity: capacity, ..CpuConfig::default() };
    let mut protected = db(8, &[1, 2]);
    protected.read_only = true;
    let program = program(vec![ob1(vec![])], vec![db(7, &[0x12, 0x34]), protected]);
    Bench::with(Cpu::new(config, &program, vec![], vec![], common::engine()).expect("loads"))
}

#[test]
fn at_most_so_many_items_a_scan_in_order() {
    let mut bench = bench(3, 16);
    let mut client = bench.cpu.access_client().expect("the first");
    assert!(bench.cpu.access_client().is_none(), "there is one");
    bench.run();
    for id in 0..8 {
        client.post(Request { id, ask: Ask::State }).expect("room");
    }
    for expected in [vec![0, 1, 2], vec![3, 4, 5], vec![6, 7], vec![]] {
        bench.run();
        let mut got = Vec::new();
        while let Some(response) = client.take() {
            assert_eq!(response.answer, Answer::State(OperatingState::Run));
            got.push(response.id);
        }
        assert_eq!(got, expected);
    }
}

#[test]
fn full_rings_hold_back_and_lose_nothing() {
    let mut bench = bench(64, 4);
    let mut client = bench.cpu.access_client().expect("the first");
    bench.run();
    for id in 0..4 {
        client.post(Request { id, ask: Ask::State }).expect("room");
    }
    assert!(client.post(Request { id: 9, ask: Ask::State }).is_err());
    bench.run();
    // Four answers wait; four more requests find no room for theirs and stay.
    for id in 4..8 {
        client.post(Request { id, ask: Ask::State }).expect("room");
    }
    bench.run();
    let mut ids = Vec::new();
    while let Some(response) = client.take() {
        ids.push(response.id);
    }
    assert_eq!(ids, [0, 1, 2, 3]);
    bench.run();
    assert_eq!(client.take().map(|r| r.id), Some(4));
    drop(bench);
    assert!(client.is_closed());
}

#[test]
fn commands_and_refusals() {
    let mut bench = bench(64, 64);
    let mut client = bench.cpu.access_client().expect("the first");
    bench.run();
    let mut ask = |bench: &mut Bench, ask| {
        client.post(Request { id: 1, ask }).expect("room");
        bench.cycle();
        client.take().expect("an answer").answer
    };
    let refused = Answer::Refused;
    for (question, answer) in [
        (Ask::Module(0), refused(CellError::NoModule)),
        (Ask::Diag(50), refused(CellError::NoEntry)),
        (Ask::State, Answer::State(OperatingState::Run)),
        (Ask::Note(Event::PARTNER, ShortText::new("panel, 10.0.0.5:1")), Answer::Done),
        (Ask::Command(Command::Stop), Answer::Done),
        (Ask::State, Answer::State(OperatingState::Stop)),
    ] {
        assert_eq!(ask(&mut bench, question), answer, "{question:?}");
    }
    let Answer::Diag(entry) = ask(&mut bench, Ask::Diag(0)) else { panic!("no entry") };
    assert_eq!(entry.to_string(), "4304h STOP by operator");
    let Answer::Diag(entry) = ask(&mut bench, Ask::Diag(1)) else { panic!("no entry") };
    assert_eq!(entry.to_string(), "F501h a partner of a link: panel, 10.0.0.5:1");
    let scans = bench.cpu.accounts().scans();
    assert_eq!(scans, 5, "one of `bench`, four questions in RUN; the STOP came before its scan");
}

#[test]
fn cells_and_refusals() {
    let mut bench = bench(64, 64);
    bench.run();
    use Width::{Bit, Byte, DWord, Word};
    let cpu = &mut bench.cpu;
    assert_eq!(cpu.read(Cell::Db(7, 0), Word), Ok(0x1234));
    assert_eq!(cpu.write(Cell::Db(7, 8), Byte, 0xFF), Ok(()));
    assert_eq!(cpu.read(Cell::Db(7, 9), Bit), Ok(1));
    assert_eq!(cpu.write(Cell::Counter(3), Word, 42), Ok(()));
    for (cell, width, error) in [
        (Cell::Db(7, 0), DWord, CellError::Outside),
        (Cell::Db(7, 1), Word, CellError::Outside),
        (Cell::Db(9, 0), Word, CellError::NoDb),
        (Cell::Area(Area::Memory, 256 * 8), Bit, CellError::Outside),
        (Cell::Timer(999), Word, CellError::NoTimer),
        (Cell::Peripheral(0), Byte, CellError::NoModule),
    ] {
        assert_eq!(cpu.read(cell, width), Err(error), "{cell:?}");
    }
    for (cell, width, value, error) in [
        (Cell::Db(8, 0), Byte, 0, CellError::ReadOnly),
        (Cell::Area(Area::Memory, 0), Byte, 256, CellError::Value),
        (Cell::Counter(3), Word, 1000, CellError::Value),
        (Cell::Timer(1), Word, 0x000A, CellError::Value),
    ] {
        assert_eq!(cpu.write(cell, width, value), Err(error), "{cell:?}");
    }
    assert_eq!(cpu.read(Cell::Counter(3), Word), Ok(42));
}

#[test]
fn warm_and_cold_restart_and_memory_reset() {
    let mut bench = bench(64, 64);
    bench.run();
    let set = |bench: &mut Bench| {
        bench.set(0, Width::Byte, 5);
        bench.cpu.write(Cell::Db(7, 0), Width::Word, 0x9999).expect("a word");
        bench.cpu.write(Cell::Counter(1), Width::Word, 5).expect("a counter");
    };
    set(&mut bench);
    bench.cpu.request(Command::Warm);
    bench.run();
    assert_eq!((bench.mb(0), bench.dbw(7, 0)), (0, 0x9999));
    assert_eq!(bench.cpu.read(Cell::Counter(1), Width::Word), Ok(0));
    bench.cpu.request(Command::Cold);
    bench.run();
    assert_eq!(bench.dbw(7, 0), 0x1234);
    set(&mut bench);
    bench.cpu.request(Command::Reset);
    assert_eq!(bench.cycle().state, OperatingState::Stop);
    assert_eq!((bench.mb(0), bench.dbw(7, 0)), (0, 0x1234));
    assert_eq!(bench.events()[0], 0x4307);
}

#[test]
fn a_clock_that_is_set_moves_the_time_of_day_interrupts() {
    let interrupt = TimeOfDay { ob: 10, start: Moment::MIN, period: Period::EveryMinute };
    let config = CpuConfig { watchdog: Span::ZERO, time_of_day: vec![interrupt], ..CpuConfig::default() };
    let count = vec![load(mw(0)), c(1), Op::Arithmetic(NumberFormat::Int, AccuOp::Add), transfer(mw(0))];
    let program = program(vec![ob1(vec![]), block(ob(10), Interface::default(), count)], vec![]);
    let mut bench = Bench::with(Cpu::new(config, &program, vec![], vec![], common::engine()).expect("loads"));
    bench.clock.per_statement = Span::ZERO;
    let mut client = bench.cpu.access_client().expect("the first");
    bench.run();
    // Half a minute is over then. No block of the program looks at the interrupts.
    client.post(Request { id: 1, ask: Ask::SetClock([0x90, 1, 1, 0, 0, 0x30, 0, 2]) }).expect("room");
    bench.run();
    assert_eq!(client.take().map(|response| response.answer), Some(Answer::Done));
    for (seconds, runs) in [(29, 0), (30, 1)] {
        bench.clock.now = at(seconds * 1000 * MS);
        bench.run();
        assert_eq!(bench.mw(0), runs, "after {seconds} s");
    }
}
