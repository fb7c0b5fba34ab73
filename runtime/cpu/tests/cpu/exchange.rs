//! The exchange with the links: outputs, writes, snapshot, inputs; groups land whole; nobody waits.

use ob1_cpu::{
    Cell, CellError, Command, Cpu, CpuConfig, GROUP_ENTRIES, Group, LINKS, Listing, Module, ModuleSlot, OperatingState,
    Piece, Put, StatusError, TooMuch, WATCH_BYTES, WRITE_BYTES, Width,
};
use ob1_ir::{NumberFormat, Op};
use ob1_model::Area;

use crate::common;
use crate::common::rack::TestModule;
use crate::common::window::Looker;
use crate::common::*;

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

fn group(id: u64, puts: &[Put]) -> Group {
    Group::new(id, puts.to_vec()).expect("little")
}

#[test]
fn everything_watched_is_of_one_scan() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    let generation =
        link.watch(&[bytes(memory(0), 2), bytes(Cell::Db(7, 0), 2), bytes(memory(100), 2)]).expect("little");
    let mut last = 0;
    for _ in 0..200 {
        bench.cycle();
        let mark = link.mark().expect("a snapshot");
        assert!(mark.scan > last && mark.generation == generation);
        last = mark.scan;
        let count = link.word(0);
        assert_eq!((link.word(1), link.word(2)), (count, count), "of one scan");
        // It is taken before the program runs.
        assert_eq!(bench.mw(0), u32::from(count) + 1);
    }
}

#[test]
fn a_group_lands_whole_and_its_answer_follows_its_snapshot() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    link.watch(&[bytes(memory(20), 4), bytes(Cell::Db(7, 100 * 8), 4)]).expect("little");
    let puts = [
        Put::Value(memory(20), Width::Word, 0x1234),
        Put::Bytes(Cell::Db(7, 100 * 8), Box::from([1, 2, 3, 4])),
        Put::Value(Cell::Area(Area::Memory, 24 * 8 + 3), Width::Bit, 1),
    ];
    bench.set(24, Width::Byte, 0x80);
    link.link.hand(group(5, &puts)).expect("room");
    bench.cycle();
    let answer = link.answer().expect("landed");
    assert_eq!((answer.id(), answer.outcome()), (5, Ok(())));
    assert_eq!(link.mark().map(|mark| mark.scan), Some(answer.scan()), "the snapshot that contains it");
    // Before the program: MW 22 is the old one, MW 20 the new one.
    assert_eq!((link.piece(0), link.piece(1)), (Ok(vec![0x12, 0x34, 0, 0]), Ok(vec![1, 2, 3, 4])));
    assert_eq!(bench.mw(22), 0x1234, "the program of the same cycle sees it");
    assert_eq!(bench.mb(24), 0x88, "a bit changes no other");

    for (wrong, error) in [
        (Put::Value(Cell::Db(9, 0), Width::Word, 0), CellError::NoDb),
        (Put::Value(Cell::Db(8, 0), Width::Byte, 0), CellError::ReadOnly),
        (Put::Bytes(Cell::Db(8, 0), Box::from([1])), CellError::ReadOnly),
        (Put::Bytes(Cell::Db(7, 598 * 8), Box::from([1, 2, 3])), CellError::Outside),
        (Put::Value(memory(255), Width::Word, 0), CellError::Outside),
        (Put::Value(memory(30), Width::Byte, 256), CellError::Value),
        (Put::Value(Cell::Counter(1), Width::Word, 1000), CellError::Value),
        (Put::Value(Cell::Timer(1), Width::Word, 0x0A00), CellError::Value),
        (Put::Value(Cell::Timer(999), Width::Word, 0), CellError::NoTimer),
        (Put::Value(Cell::Timer(1), Width::Bit, 1), CellError::ReadOnly),
        (Put::Bytes(Cell::Counter(1), Box::from([1])), CellError::Outside),
        (Put::Value(Cell::Peripheral(0), Width::Byte, 1), CellError::NoModule),
    ] {
        link.link.hand(group(6, &[Put::Value(memory(20), Width::Word, 0xFFFF), wrong.clone()])).expect("room");
        bench.cycle();
        assert_eq!(link.answer().expect("an answer").outcome(), Err((1, error)), "{wrong:?}");
        assert_eq!(bench.mw(20), 0x1234, "{wrong:?}: nothing was written");
    }
}

/// Whether a module takes a value shows only at the write: nothing else has been written then, so that the rest of the
/// group can be sent again.
#[test]
fn a_module_that_does_not_answer_leaves_memory_as_it_was() {
    let module = TestModule::new(4);
    let plugged = (ModuleSlot::new("m256", 256), Box::new(module.clone()) as Box<dyn Module>);
    let program = program(vec![ob1(vec![load(mw(0))])], vec![]);
    let cpu = Cpu::new(CpuConfig::default(), &program, vec![], vec![plugged], common::engine());
    let mut bench = Bench::with(cpu.expect("loads"));
    bench.run();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    let puts = [Put::Value(memory(20), Width::Word, 7), Put::Value(Cell::Peripheral(256 * 8), Width::Byte, 9)];
    for (absent, outcome, word) in [(true, Err((1, CellError::NoModule)), 0), (false, Ok(()), 7)] {
        module.look(|seen| seen.absent = absent);
        link.link.hand(group(1, &puts)).expect("room");
        bench.cycle();
        assert_eq!((link.answer().expect("an answer").outcome(), bench.mw(20)), (outcome, word));
    }
    assert_eq!(module.look(|seen| seen.outputs[0]), 9);
}

/// The order of a cycle control point: the outputs have gone out, writes land, the snapshot is taken, the inputs are
/// read.
#[test]
fn outputs_writes_snapshot_inputs() {
    let byte = |area| operand(ob1_ir::Width::Byte, place(area, 0, 0));
    let program = program(vec![ob1(vec![load(byte(Area::Input)), transfer(byte(Area::Output))])], vec![]);
    let module = TestModule::new(16);
    let plugged = vec![(ModuleSlot::new("m0", 0), Box::new(module.clone()) as Box<dyn Module>)];
    let cpu = Cpu::new(CpuConfig::default(), &program, vec![], plugged, common::engine()).expect("loads");
    let mut bench = Bench::with(cpu);
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    bench.run();
    let (input, output) = (Cell::Area(Area::Input, 0), Cell::Area(Area::Output, 0));
    link.watch(&[bytes(input, 1), bytes(output, 1)]).expect("little");
    module.look(|seen| seen.inputs[0] = 1);
    bench.cycle();
    assert_eq!((link.piece(0), link.piece(1)), (Ok(vec![0]), Ok(vec![0])), "the inputs are read after it");
    assert_eq!(module.look(|seen| seen.outputs[0]), 1, "and the program of the same cycle sees them");
    module.look(|seen| seen.inputs[0] = 2);
    let puts = [Put::Value(input, Width::Byte, 8), Put::Value(output, Width::Byte, 9)];
    link.link.hand(group(1, &puts)).expect("room");
    bench.cycle();
    assert_eq!((link.piece(0), link.piece(1)), (Ok(vec![8]), Ok(vec![9])), "the writes are in it");
    assert_eq!(bench.cpu.read(input, Width::Byte), Ok(2), "the module's input has been read since");
    let sent: Vec<u8> = module.look(|seen| seen.writes.iter().map(|(_, bytes)| bytes[0]).collect());
    assert!(!sent.contains(&9) && sent.ends_with(&[1, 2]), "the outputs had gone out before: {sent:?}");
}

/// A timer takes a time, whether it runs or not; a counter its count.
#[test]
fn timers_and_counters_are_written() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    let values = [Cell::Timer(1), Cell::Counter(1)].map(|cell| Piece::Value(cell, Width::Word));
    link.watch(&values).expect("little");
    // 25 s in steps of 100 ms; it stands.
    let puts = [(Cell::Timer(1), 0x1250), (Cell::Counter(1), 999)].map(|(cell, v)| Put::Value(cell, Width::Word, v));
    link.link.hand(group(1, &puts)).expect("room");
    for _ in 0..3 {
        bench.cycle();
    }
    assert_eq!(link.answer().map(|answer| answer.outcome()), Some(Ok(())));
    assert_eq!((link.word(0), link.word(1)), (0x1250, 999));
}

#[test]
fn in_stop_too() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    bench.cpu.request(Command::Stop);
    bench.cycle();
    link.watch(&[bytes(memory(20), 2)]).expect("little");
    link.link.hand(group(1, &[Put::Value(memory(20), Width::Word, 7)])).expect("room");
    assert_eq!(bench.cycle().state, OperatingState::Stop);
    assert_eq!(link.answer().map(|answer| answer.outcome()), Some(Ok(())));
    assert_eq!((link.word(0), link.mark().map(|mark| mark.state)), (7, Some(OperatingState::Stop)));
}

/// Each link writes in turn, none more than its share, all together no more than the bytes of one scan.
#[test]
fn links_take_turns_within_the_bytes_of_a_scan() {
    let mut bench = bench();
    let mut links: Vec<Looker> = (0..LINKS).map(|_| Looker::of(&mut bench.cpu).expect("there are so many")).collect();
    assert!(Looker::of(&mut bench.cpu).is_none());
    let half = |fill: u8| Put::Bytes(Cell::Db(7, 0), vec![fill; 500].into());
    for (number, link) in links.iter_mut().enumerate() {
        for id in 0..4 {
            let puts: Vec<Put> = (0..3).map(|_| half(number as u8)).collect();
            link.link.hand(group(id, &puts)).expect("room");
        }
    }
    let mut landed = vec![0; LINKS];
    let mut scans = 0;
    while landed.iter().sum::<usize>() < 4 * LINKS {
        bench.cycle();
        scans += 1;
        let mut now = 0;
        for (link, landed) in links.iter_mut().zip(&mut landed) {
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

/// It has the newest snapshot when it looks again; until then the CPU continues, and what finds no room on its way back
/// waits.
#[test]
fn a_reader_that_sleeps_changes_nothing() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    link.watch(&[bytes(memory(0), 2)]).expect("little");
    for id in 0..20 {
        link.link.hand(group(id, &[Put::Value(memory(20), Width::Word, id as u32)])).expect("room");
    }
    let before = bench.mw(0);
    for _ in 0..100 {
        bench.cycle();
    }
    assert_eq!(bench.mw(0), before + 100);
    let mut answers = 0;
    for _ in 0..20 {
        while link.answer().is_some() {
            answers += 1;
        }
        bench.cycle();
    }
    assert_eq!((answers, bench.mw(20)), (20, 19));
    assert_eq!(u32::from(link.word(0)), bench.mw(0) - 1, "fresh");
}

#[test]
fn what_is_missing_is_told_of_its_piece() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    link.watch(&[
        bytes(Cell::Db(99, 0), 4),
        bytes(Cell::Db(7, 598 * 8), 4),
        Piece::Value(Cell::Counter(3), Width::Word),
        Piece::Value(Cell::Peripheral(0), Width::DWord),
        bytes(memory(300), 2),
        bytes(Cell::Db(7, 598 * 8), 2),
    ])
    .expect("little");
    bench.cpu.write(Cell::Counter(3), Width::Word, 42).expect("a counter");
    bench.cpu.write(Cell::Db(7, 598 * 8), Width::Word, 0xABCD).expect("there");
    bench.cycle();
    assert_eq!(link.piece(0), Err(CellError::NoDb));
    assert_eq!(link.piece(1), Err(CellError::Outside));
    assert_eq!(link.piece(2), Ok(vec![0, 42]));
    assert_eq!(link.piece(3), Err(CellError::NoModule));
    assert_eq!(link.piece(4), Err(CellError::Outside));
    assert_eq!(link.piece(5), Ok(vec![0xAB, 0xCD]));
}

#[test]
fn bounds() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    let put = Put::Value(memory(0), Width::Byte, 0);
    assert!(Group::new(1, vec![put.clone(); GROUP_ENTRIES]).is_ok());
    assert_eq!(Group::new(1, vec![put; GROUP_ENTRIES + 1]).err(), Some(TooMuch::Group));
    assert_eq!(Group::new(1, vec![Put::Bytes(memory(0), vec![0; WRITE_BYTES + 1].into())]).err(), Some(TooMuch::Group));
    assert_eq!(link.watch(&[bytes(memory(0), WATCH_BYTES as u32 + 1)]).err(), Some(TooMuch::Watch));
    let scattered: Vec<Piece> = (0..3000).map(|n| bytes(Cell::Db(n, 0), 4)).collect();
    assert_eq!(link.watch(&scattered).err(), Some(TooMuch::Watch));
    // What is watched newly in every cycle leaves no trace.
    for round in 1..500u64 {
        assert_eq!(link.watch(&[bytes(memory(0), 1 + (round % 7) as u32)]), Ok(round));
        bench.cycle();
        assert_eq!(link.mark().map(|mark| mark.generation), Some(round));
        assert!(link.answer().is_none());
    }
    drop(bench);
    assert!(link.link.is_closed());
}

/// The lists SFC 51 reads; from outside they show STOP too.
#[test]
fn lists() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    let mut list = |bench: &mut Bench, list, index| {
        link.link.hand(Listing::new(7, list, index)).expect("room");
        bench.cycle();
        let listing = link.listing().expect("it comes back");
        assert!(listing.id() == 7 && listing.is_whole());
        listing.found().map(|(record, bytes)| (record, bytes.to_vec()))
    };
    let leds = |run: u8, stop: u8| {
        let led = |(number, on)| [0, number, on, 0];
        let all = [(1, 0), (4, run), (5, stop), (6, 0), (0x0B, 0), (0x0C, 0), (0x15, 0)];
        Ok((4, all.map(led).concat()))
    };
    assert_eq!(list(&mut bench, 0x0019, 0), leds(1, 0));
    assert_eq!([0x0424, 0x0124].map(|id| list(&mut bench, id, 0).map(|(_, bytes)| bytes[3])), [Ok(0x08), Ok(0x68)]);
    assert_eq!(list(&mut bench, 0x0999, 0), Err(StatusError::Id));
    bench.cpu.request(Command::Stop);
    bench.cycle();
    assert_eq!(list(&mut bench, 0x0019, 0), leds(0, 1));
    assert_eq!([0x0424, 0x0124].map(|id| list(&mut bench, id, 0).map(|(_, bytes)| bytes[3])), [Ok(0x03), Ok(0x83)]);
}

/// The copy is accounted for while a link watches something, and not before.
#[test]
fn the_exchange_has_an_account_of_its_own() {
    let mut bench = bench();
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    let accounts = bench.cpu.accounts();
    for _ in 0..10 {
        bench.cycle();
    }
    assert_eq!(accounts.figures().links.distribution().count, 0);
    link.watch(&[bytes(memory(0), 2)]).expect("little");
    for _ in 0..10 {
        bench.cycle();
    }
    let figures = accounts.figures();
    assert_eq!((figures.links.distribution().count, figures.execution.distribution().count), (10, figures.scans));
}
