//! Reads, writes, questions, documents, changes of the program.

use ob1_access::door::{Answer, Ask, Command, Connection, Document, News, OUTSTANDING, Refusal, Refused, State};
use ob1_access::{Allowed, Cell, CellError, Put, Right, Width};
use ob1_broker::{Change, LinkConfig};
use ob1_model::{Area, BlockId, BlockKind};

use crate::station::{MS, Station, bytes, link, memory, word};

#[test]
fn everything_read_is_of_one_scan_and_a_write_is_seen_by_the_next_read() {
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut door = station.open(0);
    let pieces = [bytes(memory(0), 2), bytes(Cell::Db(7, 0), 2), bytes(memory(100), 2)];
    let mut last = 0;
    for _ in 0..100 {
        let reading = station.read(&mut door, &pieces);
        let count = reading.value(0).expect("there");
        assert_eq!((reading.value(1), reading.value(2)), (Ok(count), Ok(count)), "of one scan");
        assert!(reading.scan > last && reading.state == State::Run);
        last = reading.scan;
        station.cycle();
    }
    for value in 0..50u32 {
        let puts = [word(memory(20), value), Put::Bytes(Cell::Db(7, 80), Box::from([value as u8; 4]))];
        let scan = station.write(&mut door, 1, &puts).expect("allowed");
        let reading = station.read(&mut door, &[bytes(memory(20), 4), bytes(Cell::Db(7, 80), 4)]);
        assert!(reading.scan >= scan);
        assert_eq!(reading.value(0).map(|word| word >> 16), Ok(value));
        assert_eq!(reading.piece(1), Ok(&[value as u8; 4][..]));
    }
    let wrong = [word(memory(20), 9999), word(Cell::Db(99, 0), 1)];
    let refused = Refused { entry: 1, why: Refusal::Cell(CellError::NoDb) };
    assert_eq!(station.write(&mut door, 1, &wrong), Err(refused));
    assert_eq!(station.read(&mut door, &[bytes(memory(20), 2)]).value(0), Ok(49), "nothing of it landed");
    // An input that a module feeds goes there.
    let input = Put::Value(Cell::Area(Area::Input, 0), Width::Bit, 1);
    assert!(station.write(&mut door, 1, std::slice::from_ref(&input)).is_ok());
    // A refusal names the place in the whole group, with what a module has taken.
    let wrong = [input.clone(), word(memory(20), 1), input, word(Cell::Db(99, 0), 1)];
    assert_eq!(station.write(&mut door, 1, &wrong), Err(Refused { entry: 3, ..refused }));
}

/// A document of any length comes whole, whatever else is asked meanwhile.
#[test]
fn documents() {
    let mut station = Station::new(vec![link("page", Right::Read), link("metrics", Right::Read)]);
    let mut door = station.open(0);
    let mut text = |which| match station.ask(&mut door, 3, Ask::Document(which)) {
        Answer::Document { last: true, bytes } => bytes,
        other => panic!("{other:?}"),
    };
    assert!(text(Document::Program).iter().all(|byte| *byte == 7));
    assert_eq!(text(Document::Program).len(), 300_000);
    let status = text(Document::Status);
    let status = String::from_utf8_lossy(&status);
    assert!(status.starts_with("Status Run"), "{status}: the state is the CPU's");
    door.connections(vec![Connection { partner: "10.0.0.1:5".into(), ..Connection::default() }]);
    let links = station.ask(&mut door, 3, Ask::Document(Document::Links));
    let Answer::Document { bytes: links, .. } = links else { panic!("{links:?}") };
    assert_eq!(String::from_utf8_lossy(&links), r#"Links Stop [("page", true, 1), ("metrics", false, 0)]"#);
    // A client that asks for more than it takes gets an answer that says so, and what waits for it is bounded.
    for _ in 0..200 {
        door.ask(4, Ask::Document(Document::Program));
    }
    let last = door.ask(4, Ask::Document(Document::Links));
    door.pump().expect("open");
    (0..5).for_each(|_| station.broker.step(station.time));
    let (mut whole, mut refused, mut answered) = (0, 0, false);
    for _ in 0..2000 {
        door.pump().expect("open");
        while let Some(news) = door.take_news() {
            match news {
                News::Answer { answer: Answer::Document { .. }, .. } => whole += 1,
                News::Answer { ticket, answer: Answer::Refused(Refusal::Full), .. } => {
                    refused += 1;
                    answered |= ticket == last;
                }
                _ => {}
            }
        }
        station.broker.step(station.time);
    }
    assert!(answered && whole >= 85, "{whole} whole, {refused} refused");
    assert_eq!(whole + refused, 201);
}

/// A change of the program takes the right to operate, and for a data block that the link may touch it. What a client
/// puts aside is its own, and bounded.
#[test]
fn changes_of_the_program() {
    let id = |kind, number| BlockId::new(kind, number);
    let stage = |id| Ask::Stage { id, bytes: [1, 2, 3].into() };
    let (fc, db7, db8) = (id(BlockKind::Fc, 1), id(BlockKind::Db, 7), id(BlockKind::Db, 8));
    for right in [Right::Read, Right::Write] {
        let mut station = Station::new(vec![link("panel", right)]);
        let mut door = station.open(0);
        for ask in [stage(fc), stage(db7), Ask::Link, Ask::Delete(vec![fc]), Ask::Delete(Vec::new())] {
            assert_eq!(station.ask(&mut door, 1, ask.clone()), Answer::Refused(Refusal::Right), "{right:?} {ask:?}");
        }
        assert!(station.changes.lock().expect("not poisoned").is_empty());
    }
    let only = LinkConfig {
        allowed: Allowed::of(None, Some(&["DB7".to_owned()])).expect("right").with_program(Some(true)),
        ..link("panel", Right::Operate)
    };
    let mut station = Station::new(vec![only]);
    let mut door = station.open(0);
    assert_eq!(station.ask(&mut door, 1, stage(id(BlockKind::Fb, 9))), Answer::Done, "goes with the refused one");
    assert_eq!(station.ask(&mut door, 1, stage(db8)), Answer::Refused(Refusal::Right));
    assert_eq!(station.ask(&mut door, 1, Ask::Delete(vec![db7, db8])), Answer::Refused(Refusal::Right));
    assert_eq!(station.ask(&mut door, 1, stage(db7)), Answer::Done);
    assert_eq!(station.ask(&mut door, 1, stage(fc)), Answer::Done);
    assert_eq!(station.ask(&mut door, 2, Ask::Link), Answer::Done, "it has put nothing aside");
    assert_eq!(station.ask(&mut door, 1, Ask::Link), Answer::Done);
    assert_eq!(station.ask(&mut door, 1, Ask::Delete(Vec::new())), Answer::Refused(Refusal::InRun));
    let bytes: Box<[u8]> = [1, 2, 3].into();
    let linked = Change::Link(vec![(db7, bytes.clone()), (fc, bytes)]);
    let wanted = [Change::Link(Vec::new()), linked, Change::Delete(Vec::new())];
    assert_eq!(*station.changes.lock().expect("not poisoned"), wanted);
    // As often as wanted: each answer frees its place.
    for _ in 0..3 * OUTSTANDING {
        assert_eq!(station.ask(&mut door, 1, Ask::Link), Answer::Done);
    }
    let large = |number| Ask::Stage { id: id(BlockKind::Fc, number), bytes: vec![0; 130_000].into() };
    let answers: Vec<Answer> = (0..8).map(|number| station.ask(&mut door, 1, large(number))).collect();
    assert!(answers.iter().all(|answer| *answer == Answer::Done), "{answers:?}");
    assert_eq!(station.ask(&mut door, 1, large(3)), Answer::Done, "in place of the one before");
    assert_eq!(station.ask(&mut door, 1, large(8)), Answer::Refused(Refusal::Room));
    assert_eq!(station.ask(&mut door, 1, Ask::Link), Answer::Done);
    let changes = station.changes.lock().expect("not poisoned");
    assert_eq!(changes.last(), Some(&Change::Link(Vec::new())), "the blocks before it have gone with it");
}

#[test]
fn questions() {
    let mut station = Station::new(vec![link("panel", Right::Operate)]);
    let mut door = station.open(0);
    let Answer::Clock(clock) = station.ask(&mut door, 1, Ask::Clock) else { panic!("no clock") };
    assert_eq!(clock[..2], [0x90, 0x01]);
    let set = [0x26, 0x11, 0x22, 0x15, 0x00, 0x00, 0x00, 0x01];
    assert_eq!(station.ask(&mut door, 1, Ask::SetClock(set)), Answer::Done);
    let Answer::Clock(clock) = station.ask(&mut door, 1, Ask::Clock) else { panic!("no clock") };
    assert_eq!(clock[..5], set[..5]);
    let wrong = station.ask(&mut door, 1, Ask::SetClock([0xFF; 8]));
    assert_eq!(wrong, Answer::Refused(Refusal::Cell(CellError::Value)));
    let Answer::Szl { record: 4, bytes: list } = station.ask(&mut door, 1, Ask::Szl { id: 0x0019, index: 0 }) else {
        panic!("no list")
    };
    assert_eq!(list[4..8], [0, 4, 1, 0], "RUN");
    assert_eq!(station.ask(&mut door, 1, Ask::Szl { id: 0xFFFF, index: 0 }), Answer::NoSzl(0x8082));
    let Answer::Diagnostics(entries) = station.ask(&mut door, 1, Ask::Diagnostics(100)) else { panic!("no buffer") };
    assert!(entries.iter().any(|entry| entry.event == 0x4302), "{entries:?}");
    let modules = Answer::Modules { state: State::Run, present: Vec::new() };
    assert_eq!(station.ask(&mut door, 1, Ask::Modules), modules);
    assert!(matches!(station.ask(&mut door, 1, Ask::Blocks), Answer::Blocks(blocks) if blocks.len() == 1));
    let block = |kind, number| Ask::Block(BlockId::new(kind, number));
    assert_eq!(station.ask(&mut door, 1, block(BlockKind::Ob, 1)), Answer::Block(Box::from([1, 2, 3])));
    assert_eq!(station.ask(&mut door, 1, block(BlockKind::Fb, 9)), Answer::Refused(Refusal::NotThere));
    assert_eq!(station.ask(&mut door, 1, Ask::Command(Command::Hot)), Answer::Refused(Refusal::NotThere));
    assert_eq!(station.ask(&mut door, 1, Ask::Command(Command::Stop)), Answer::Done);
    station.cycles(2);
    assert_eq!(station.cpu.state(), ob1_cpu::OperatingState::Stop);
    // In STOP too.
    assert!(station.write(&mut door, 1, &[word(memory(20), 5)]).is_ok());
    let reading = station.read(&mut door, &[bytes(memory(20), 2)]);
    assert_eq!((reading.value(0), reading.state), (Ok(5), State::Stop));
    assert_eq!(station.ask(&mut door, 1, Ask::Command(Command::Warm)), Answer::Done);
    station.cycles(2);
    assert_eq!(station.cpu.state(), ob1_cpu::OperatingState::Run);
}

/// Whoever asks a CPU that hangs is told so, also when it takes no more questions and writes.
#[test]
fn a_silent_cpu_with_full_rings_is_told() {
    let mut station = Station::new(vec![link("panel", Right::Operate)]);
    let mut door = station.open(0);
    let mut later = |station: &mut Station, clients: std::ops::Range<u32>| {
        for client in clients {
            door.ask(client, Ask::Clock);
            door.write(client, vec![word(memory(20), 1)]).expect("a group");
        }
        door.pump().expect("open");
        for _ in 0..33 {
            station.time += 100 * MS;
            station.broker.step(station.time);
        }
        door.pump().expect("open");
        let news = std::iter::from_fn(|| door.take_news());
        news.filter(|news| match news {
            News::Answer { answer, .. } => *answer == Answer::Refused(Refusal::Silent),
            News::Written { outcome, .. } => outcome.is_err_and(|refused| refused.why == Refusal::Silent),
            _ => false,
        })
        .count()
    };
    // More than the rings hold, and again when they are full from the beginning.
    assert_eq!(later(&mut station, 0..50), 100);
    assert_eq!(later(&mut station, 0..50), 100);
    station.cycles(5);
    assert!(matches!(station.ask(&mut door, 1, Ask::Clock), Answer::Clock(_)), "and then it goes on");
}

/// A CPU that hangs: each question is answered nevertheless, and an answer that comes too late belongs to nobody.
#[test]
fn a_silent_cpu_is_told() {
    let mut station = Station::new(vec![link("panel", Right::Operate)]);
    let mut door = station.open(0);
    let write = door.write(1, vec![word(memory(20), 1)]).expect("a group");
    let clock = door.ask(1, Ask::Clock);
    let list = door.ask(2, Ask::Szl { id: 0x19, index: 0 });
    door.pump().expect("open");
    station.broker.step(station.time);
    // The machine stands still: that is no silence of the CPU.
    station.time += 60_000 * MS;
    station.broker.step(station.time);
    door.pump().expect("open");
    assert_eq!(door.take_news(), None);
    for _ in 0..31 {
        station.time += 100 * MS;
        station.broker.step(station.time);
    }
    door.pump().expect("open");
    let news: Vec<News> = std::iter::from_fn(|| door.take_news()).collect();
    let silent = |client, ticket| News::Answer { client, ticket, answer: Answer::Refused(Refusal::Silent) };
    let written = News::Written { client: 1, ticket: write, outcome: Err(Refused { entry: 0, why: Refusal::Silent }) };
    assert_eq!(news.len(), 3);
    assert!(news.contains(&written) && news.contains(&silent(1, clock)) && news.contains(&silent(2, list)));
    station.cycles(5);
    door.pump().expect("open");
    assert_eq!(door.take_news(), None);
    assert!(matches!(station.ask(&mut door, 1, Ask::Clock), Answer::Clock(_)), "and then it goes on");
}
