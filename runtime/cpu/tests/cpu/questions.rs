//! Commands and questions of links: answered once a scan, a bounded number of them.

use ob1_cpu::{
    Answer, Ask, Cell, CellError, Command, Cpu, CpuConfig, Group, OperatingState, Put, Question, ShortText, TimeOfDay,
    TooMuch, Width,
};
use ob1_ir::{AccuOp, NumberFormat, Op};
use ob1_model::moment::Moment;
use ob1_model::{Area, Event, Interface};
use ob1_std::services::Period;
use ob1_time::Span;

use crate::common;
use crate::common::window::Client;
use crate::common::*;

fn bench(items: u32) -> Bench {
    let config = CpuConfig { questions_per_scan: items, ..CpuConfig::default() };
    let mut protected = db(8, &[1, 2]);
    protected.read_only = true;
    let program = program(vec![ob1(vec![])], vec![db(7, &[0x12, 0x34]), protected]);
    Bench::with(Cpu::new(config, &program, vec![], vec![], common::engine()).expect("loads"))
}

/// The numbers of the questions that have come back.
fn answered(client: &mut Client) -> Vec<u64> {
    std::iter::from_fn(|| client.take()).map(|question| question.id()).collect()
}

#[test]
fn at_most_so_many_items_a_scan_in_order() {
    let mut bench = bench(3);
    let mut client = Client::of(&mut bench.cpu);
    bench.run();
    for id in 0..8 {
        client.ask(id, [Ask::State]);
    }
    for expected in [vec![0, 1, 2], vec![3, 4, 5], vec![6, 7], vec![]] {
        bench.run();
        assert_eq!(answered(&mut client), expected);
    }
    // What is asked together comes together, however long it takes; a second link is heard meanwhile.
    let mut other = Client::of(&mut bench.cpu);
    client.ask(8, vec![Ask::State; 7]);
    other.ask(1, [Ask::Clock]);
    for (expected, others) in [(vec![], vec![]), (vec![], vec![1]), (vec![8], vec![])] {
        bench.run();
        assert_eq!((answered(&mut client), answered(&mut other)), (expected, others));
    }
    client.ask(9, vec![Ask::State; 7]);
    (0..3).for_each(|_| bench.run());
    assert_eq!(client.take().expect("whole").answers(), [Answer::State(OperatingState::Run); 7]);
}

#[test]
fn full_rings_hold_back_and_lose_nothing() {
    let mut bench = bench(64);
    let mut client = Client::of(&mut bench.cpu);
    bench.run();
    let mut asked = 0;
    // Whoever does not take its answers is asked to wait, in the end.
    for _ in 0..32 {
        while client.0.hand(Question::new(asked, vec![Ask::State])) != Err(TooMuch::UnderWay) {
            asked += 1;
        }
        bench.run();
    }
    assert!((64..32 * 32).contains(&asked), "{asked}");
    let mut ids = answered(&mut client);
    bench.run();
    ids.extend(answered(&mut client));
    assert_eq!(ids, (0..asked).collect::<Vec<_>>());
    drop(bench);
    assert!(client.0.is_closed());
}

/// A write waits for the cycle control point, a command that was given after it does not.
#[test]
fn a_command_overtakes_what_is_written() {
    let mut bench = bench(64);
    let mut client = Client::of(&mut bench.cpu);
    bench.run();
    let put = Put::Value(Cell::Area(Area::Memory, 0), Width::Byte, 7);
    client.0.hand(Group::new(1, vec![put]).expect("little")).expect("room");
    client.ask(2, [Ask::Command(Command::Stop), Ask::State]);
    bench.cycle();
    assert_eq!(client.take().expect("answered").answers(), [Answer::Done, Answer::State(OperatingState::Run)]);
    assert_eq!((bench.cpu.state(), bench.mb(0)), (OperatingState::Stop, 7));
}

#[test]
fn commands_and_refusals() {
    let mut bench = bench(64);
    let mut client = Client::of(&mut bench.cpu);
    bench.run();
    let mut ask = |bench: &mut Bench, ask| {
        client.ask(1, [ask]);
        bench.cycle();
        client.answer().expect("an answer")
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
    let mut bench = bench(64);
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
    let mut bench = bench(64);
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
    let mut client = Client::of(&mut bench.cpu);
    bench.run();
    // Half a minute is over then. No block of the program looks at the interrupts.
    client.ask(1, [Ask::SetClock([0x90, 1, 1, 0, 0, 0x30, 0, 2])]);
    bench.run();
    assert_eq!(client.answer(), Some(Answer::Done));
    for (seconds, runs) in [(29, 0), (30, 1)] {
        bench.clock.now = at(seconds * 1000 * MS);
        bench.run();
        assert_eq!(bench.mw(0), runs, "after {seconds} s");
    }
}
