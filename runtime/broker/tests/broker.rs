//! The broker between doors and a CPU, all in one thread and in virtual time.

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use ob1_access::door::{
    Answer, Ask, BlockFact, Command, Connection, Diagnosis, Document, Door, Event, News, NotYet, OUTSTANDING, Reading,
    Refusal, Refused, State, Ticket, What,
};
use ob1_access::{Allowed, Cell, CellError, Piece, Put, Right, Width};
use ob1_backplane::handover;
use ob1_broker::{Broker, Change, Changed, DriverState, Facts, Feed, LinkConfig, LinkState, feed};
use ob1_cpu::{Clock, Cpu, CpuConfig, DiagEntry, system_blocks};
use ob1_model::{Area, BlockId, BlockKind};
use ob1_stl::{Library, Options, Source, compile};
use ob1_time::{Instant, Span};

const MS: Span = Span::MILLISECOND;

/// The count in MW 0, in MW 100 and in DB7.DBW0 is the same after each scan.
const PROGRAM: &str = "
DATA_BLOCK DB 7
STRUCT
  a : ARRAY[0..299] OF WORD;
END_STRUCT
BEGIN
END_DATA_BLOCK
DATA_BLOCK DB 8
STRUCT
  a : WORD;
END_STRUCT
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
NETWORK
      L MW 0; + 1; T MW 0; T MW 100; T DB7.DBW 0;
      L MW 20; T MW 22;
END_ORGANIZATION_BLOCK
";

struct Plant {
    up: Arc<AtomicBool>,
    /// Changes of the program that reached it.
    changes: Arc<Mutex<Vec<Change>>>,
    changed: Vec<Changed>,
}

impl Facts for Plant {
    fn name(&self) -> &str {
        "press"
    }
    fn family(&self) -> u16 {
        300
    }
    fn areas(&self) -> [u32; 3] {
        [128, 128, 256]
    }
    fn timers_and_counters(&self) -> [u16; 2] {
        [256, 256]
    }
    fn min_cycle(&self) -> Span {
        MS
    }
    fn modules(&self) -> u32 {
        0
    }
    fn drivers(&self) -> Vec<DriverState> {
        vec![DriverState { name: "cp".into(), up: self.up.load(Ordering::Relaxed) }]
    }
    fn diagnosis(&self, entry: &DiagEntry) -> Diagnosis {
        Diagnosis { number: entry.number, time: entry.time.nanos(), event: entry.event.0, ..Diagnosis::default() }
    }
    fn blocks(&self) -> Vec<BlockFact> {
        vec![BlockFact { id: BlockId::new(BlockKind::Ob, 1), bytes: 0, language: 1, name: String::new() }]
    }
    fn block(&self, id: BlockId) -> Option<Box<[u8]>> {
        (id.number == 1).then(|| Box::from([1, 2, 3]))
    }
    fn document(&self, which: Document, state: State, _: &[bool], links: &[LinkState]) -> Box<[u8]> {
        match which {
            // More than one message.
            Document::Program => vec![7; 300_000].into(),
            _ => {
                let links: Vec<_> = links.iter().map(|link| (&link.name, link.up, link.connections.len())).collect();
                format!("{which:?} {state:?} {links:?}").into_bytes().into()
            }
        }
    }
    fn change(&mut self, number: u64, change: Change) -> bool {
        let outcome = if change == Change::Delete(Vec::new()) { Err(Refusal::InRun) } else { Ok(()) };
        self.changes.lock().expect("not poisoned").push(change);
        self.changed.push((number, outcome));
        true
    }
    fn changed(&mut self) -> Option<Changed> {
        self.changed.pop()
    }
    fn take_input(&self, put: &Put) -> bool {
        put.cell() == Cell::Area(Area::Input, 0)
    }
}

struct Time(Instant);

impl Clock for Time {
    fn now(&mut self) -> Instant {
        self.0
    }
    fn executed(&mut self, _: u64) {}
}

/// A CPU, its broker, and doors to it.
struct Station {
    cpu: Cpu,
    broker: Broker,
    feed: Feed,
    time: Instant,
    driver_up: Arc<AtomicBool>,
    changes: Arc<Mutex<Vec<Change>>>,
    /// Events that came while others were waited for.
    seen: Vec<Event>,
}

fn link(name: &str, rights: Right) -> LinkConfig {
    LinkConfig { name: name.into(), rights, config: "{}".into(), ..LinkConfig::default() }
}

impl Station {
    fn new(links: Vec<LinkConfig>) -> Self {
        let source = Source { name: "test.awl".into(), bytes: PROGRAM.as_bytes().to_vec() };
        let natives = system_blocks();
        let mut library = Library::new();
        for block in &natives {
            library.insert(block.id(), block.name(), block.interface().clone());
        }
        let output = compile(&[source], &library, &Options::default());
        assert!(output.is_good(), "{:#?}", output.diagnostics);
        let mut cpu = Cpu::new(CpuConfig::default(), &output.program, natives, vec![], ob1_cpu::engine::REFERENCE)
            .expect("loads");
        let (scan, end) = feed();
        let driver_up = Arc::new(AtomicBool::new(false));
        let changes = Arc::default();
        let (up, log) = (Arc::clone(&driver_up), Arc::clone(&changes));
        let facts = Box::new(Plant { up, changes: log, changed: Vec::new() });
        let broker = Broker::new(&mut cpu, links, end, facts).expect("a broker");
        cpu.request(ob1_cpu::Command::Warm);
        let mut station = Self { cpu, broker, feed: scan, time: Instant::START, driver_up, changes, seen: Vec::new() };
        station.cycles(2);
        station
    }

    fn open(&mut self, link: usize) -> Door {
        let (ours, theirs) = handover::pair().expect("a socket");
        self.broker.connect(link, ours, self.time);
        let mut door = Door::new(theirs).expect("a door");
        door.pump().expect("open");
        assert!(door.welcome().is_some());
        door
    }

    fn cycle(&mut self) {
        self.time += MS;
        self.cpu.cycle(&mut Time(self.time));
        self.feed.follow(&self.cpu);
        self.broker.step(self.time);
    }

    fn cycles(&mut self, count: usize) {
        (0..count).for_each(|_| self.cycle());
    }

    /// Asks until the answer is there.
    fn ask(&mut self, door: &mut Door, client: u32, ask: Ask) -> Answer {
        let asked = door.ask(client, ask);
        match self.until(door, |news| matches!(news, News::Answer { ticket, .. } if *ticket == asked)) {
            News::Answer { answer, .. } => answer,
            other => panic!("{other:?}"),
        }
    }

    fn write(&mut self, door: &mut Door, client: u32, puts: &[Put]) -> Result<u64, Refused> {
        let written = door.write(client, puts.to_vec()).expect("a group");
        match self.until(door, |news| matches!(news, News::Written { ticket, .. } if *ticket == written)) {
            News::Written { outcome, .. } => outcome,
            other => panic!("{other:?}"),
        }
    }

    fn until(&mut self, door: &mut Door, wanted: impl Fn(&News) -> bool) -> News {
        for _ in 0..20 {
            door.pump().expect("open");
            while let Some(news) = door.take_news() {
                if wanted(&news) {
                    return news;
                }
                if let News::Event(event) = news {
                    self.seen.push(event);
                }
            }
            self.broker.step(self.time);
            self.cycle();
        }
        panic!("no answer in twenty cycles");
    }

    fn read(&mut self, door: &mut Door, pieces: &[Piece]) -> Reading {
        let mut reading = Reading::new();
        for _ in 0..20 {
            door.pump().expect("open");
            match door.read(pieces, &mut reading) {
                Ok(()) => return reading,
                Err(NotYet::Coming) => {
                    door.pump().expect("open");
                    self.broker.step(self.time);
                    self.cycle();
                }
                Err(other) => panic!("{other}"),
            }
        }
        panic!("nothing to read in twenty cycles");
    }
}

fn memory(byte: u32) -> Cell {
    Cell::Area(Area::Memory, byte * 8)
}

fn bytes(at: Cell, len: u32) -> Piece {
    Piece::Bytes { at, len }
}

fn word(at: Cell, value: u32) -> Put {
    Put::Value(at, Width::Word, value)
}

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
    assert!(station.write(&mut door, 1, &[Put::Value(Cell::Area(Area::Input, 0), Width::Bit, 1)]).is_ok());
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
    // A client that asks for more than it takes is told so, and what waits for it is bounded.
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
        allowed: Allowed::of(None, Some(&["DB7".to_owned()])).expect("right"),
        ..link("panel", Right::Operate)
    };
    let mut station = Station::new(vec![only]);
    let mut door = station.open(0);
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
    let answers: Vec<Answer> = (0..9).map(|number| station.ask(&mut door, 1, large(number))).collect();
    assert_eq!(answers.iter().filter(|answer| **answer == Answer::Done).count(), 8);
    assert_eq!(answers.last(), Some(&Answer::Refused(Refusal::Room)));
    assert_eq!(station.ask(&mut door, 1, large(3)), Answer::Done, "in place of the one before");
}

/// Each right, and each limit of it: what is not allowed is refused and changes nothing.
#[test]
fn rights() {
    let operates =
        [Ask::Command(Command::Stop), Ask::Command(Command::Cold), Ask::Command(Command::Reset), Ask::SetClock([0; 8])];
    for right in [Right::Read, Right::Write, Right::Operate] {
        let mut station = Station::new(vec![link("panel", right)]);
        let mut door = station.open(0);
        assert!(station.read(&mut door, &[bytes(memory(0), 2)]).value(0).is_ok(), "{right:?}");
        let written = station.write(&mut door, 1, &[word(memory(20), 7)]);
        let refused = Err(Refused { entry: 0, why: Refusal::Right });
        if right == Right::Read {
            assert_eq!((written, station.write(&mut door, 1, &[])), (refused, refused));
            assert_eq!(station.cpu.read(memory(20), Width::Word), Ok(0));
        } else {
            assert!(written.is_ok());
            assert_eq!(station.cpu.read(memory(20), Width::Word), Ok(7));
        }
        for ask in operates.clone() {
            let answer = station.ask(&mut door, 1, ask.clone());
            if right < Right::Operate {
                assert_eq!(answer, Answer::Refused(Refusal::Right), "{right:?} {ask:?}");
                assert_eq!(station.cpu.state(), ob1_cpu::OperatingState::Run, "{right:?} {ask:?}");
            } else {
                assert_ne!(answer, Answer::Refused(Refusal::Right), "{ask:?}");
            }
        }
    }
}

#[test]
fn areas_and_blocks() {
    let texts = |list: &[&str]| list.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>();
    let allowed = Allowed::of(Some(&texts(&["M", "DB"])), Some(&texts(&["DB8"]))).expect("right");
    let mut station = Station::new(vec![LinkConfig { allowed, ..link("panel", Right::Operate) }]);
    let mut door = station.open(0);
    let pieces = [
        bytes(memory(0), 2),
        bytes(Cell::Db(7, 0), 2),
        bytes(Cell::Db(8, 0), 2),
        bytes(Cell::Area(Area::Output, 0), 1),
        Piece::Value(Cell::Timer(1), Width::Word),
    ];
    let reading = station.read(&mut door, &pieces);
    let seen: Vec<bool> = (0..pieces.len()).map(|at| reading.piece(at).is_ok()).collect();
    assert_eq!(seen, [true, false, true, false, false]);
    assert_eq!((reading.piece(1), reading.piece(4)), (Err(Refusal::Right), Err(Refusal::Right)));
    for (put, good) in [
        (word(memory(20), 1), true),
        (word(Cell::Db(8, 0), 1), true),
        (word(Cell::Db(7, 16), 1), false),
        (Put::Bytes(Cell::Db(7, 16), Box::from([1])), false),
        (word(Cell::Area(Area::Output, 0), 1), false),
        (word(Cell::Peripheral(0), 1), false),
        (word(Cell::Counter(0), 1), false),
    ] {
        let outcome = station.write(&mut door, 1, &[word(memory(30), 5), put.clone()]);
        let refused = outcome == Err(Refused { entry: 1, why: Refusal::Right });
        assert_eq!((outcome.is_ok(), refused), (good, !good), "{put:?}");
    }
}

#[test]
fn a_password_gives_one_client_more() {
    let config =
        LinkConfig { password: Some("secret".into()), password_rights: Right::Write, ..link("panel", Right::Read) };
    let mut station = Station::new(vec![config]);
    let mut door = station.open(0);
    assert_eq!(station.ask(&mut door, 1, Ask::Login("guess".into())), Answer::Refused(Refusal::Password));
    station.time += 1000 * MS;
    assert_eq!(station.ask(&mut door, 1, Ask::Login("secret".into())), Answer::Done);
    assert!(station.write(&mut door, 1, &[word(memory(20), 1)]).is_ok());
    assert!(station.write(&mut door, 2, &[word(memory(20), 2)]).is_err(), "another client");
    assert_eq!(station.ask(&mut door, 1, Ask::Command(Command::Stop)), Answer::Refused(Refusal::Right));
    assert_eq!(station.ask(&mut door, 1, Ask::Logout), Answer::Done);
    assert!(station.write(&mut door, 1, &[word(memory(20), 3)]).is_err());
    assert_eq!(station.ask(&mut door, 1, Ask::Login("secret".into())), Answer::Done);
    door.client_gone(1);
    assert!(station.write(&mut door, 1, &[word(memory(20), 4)]).is_err(), "its rights went with it");
    assert_eq!(station.cpu.read(memory(20), Width::Word), Ok(1));
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

#[test]
fn events_are_one_stream_that_can_be_resumed() {
    let mut station = Station::new(vec![link("panel", Right::Operate), link("gate", Right::Read)]);
    let mut door = station.open(0);
    assert_eq!(station.ask(&mut door, 0, Ask::Events { after: 0 }), Answer::Done);
    station.driver_up.store(true, Ordering::Relaxed);
    assert_eq!(station.ask(&mut door, 0, Ask::Command(Command::Stop)), Answer::Done);
    let mut other = station.open(1);
    other.beat();
    other.pump().expect("open");
    station.cycles(3);
    drop(other);
    station.cycles(3);
    let events = |door: &mut Door| -> Vec<Event> {
        door.pump().expect("open");
        let news = std::iter::from_fn(|| door.take_news());
        news.filter_map(|news| if let News::Event(event) = news { Some(event) } else { None }).collect()
    };
    let mut seen = std::mem::take(&mut station.seen);
    seen.extend(events(&mut door));
    let numbers: Vec<u64> = seen.iter().map(|event| event.number).collect();
    let last = *numbers.last().expect("some");
    assert_eq!(numbers, (last + 1 - numbers.len() as u64..=last).collect::<Vec<_>>(), "no gap");
    let has = |what: &What| seen.iter().any(|event| event.what == *what);
    assert!(has(&What::Driver { name: "cp".into(), up: true }));
    assert!(has(&What::State(State::Stop)));
    assert!(has(&What::Link { name: "gate".into(), up: true }) && has(&What::Link { name: "gate".into(), up: false }));
    assert!(
        seen.iter().any(|event| matches!(&event.what, What::Diagnosis(entry) if entry.event == 0x4304)),
        "{seen:?}"
    );
    // The process dies and comes back: it goes on where it was.
    drop(door);
    assert!(station.ask_again_after(last).is_empty());
}

impl Station {
    fn ask_again_after(&mut self, last: u64) -> Vec<Event> {
        let mut door = self.open(0);
        assert_eq!(self.ask(&mut door, 0, Ask::Events { after: last }), Answer::Done);
        self.cycles(2);
        door.pump().expect("open");
        let news = std::iter::from_fn(|| door.take_news());
        let events = news.filter_map(|news| if let News::Event(event) = news { Some(event) } else { None });
        events.filter(|event| !matches!(event.what, What::Link { .. })).collect()
    }
}

/// One that asks for everything at once gets what is its share; the others do not wait for it.
#[test]
fn clients_take_turns_and_none_takes_the_turn_of_another() {
    let mut station = Station::new(vec![link("panel", Right::Write), link("gate", Right::Write)]);
    let (mut greedy, mut modest) = (station.open(0), station.open(1));
    let big: Vec<Put> = vec![Put::Bytes(Cell::Db(7, 0), vec![1; 590].into()); 6];
    let mut refused = 0;
    for client in 0..40 {
        for _ in 0..OUTSTANDING + 2 {
            let _ = greedy.write(client, big.clone()).expect("a group");
        }
    }
    greedy.pump().expect("open");
    (0..20).for_each(|_| station.broker.step(station.time));
    let before = station.time;
    assert!(station.write(&mut modest, 1, &[word(memory(20), 3)]).is_ok());
    assert!(station.time - before <= 5 * MS, "it waited {} cycles", (station.time - before) / MS);
    let mut landed: Vec<(u32, Ticket)> = Vec::new();
    for _ in 0..600 {
        station.cycle();
        greedy.pump().expect("open");
        while let Some(news) = greedy.take_news() {
            match news {
                News::Written { outcome: Err(Refused { why: Refusal::Full, .. }), .. } => refused += 1,
                News::Written { client, ticket, outcome: Ok(_) } => landed.push((client, ticket)),
                _ => {}
            }
        }
    }
    assert_eq!((landed.len(), refused), (40 * OUTSTANDING, 40 * 2));
    for client in 0..40 {
        let tickets: Vec<Ticket> = landed.iter().filter(|(c, _)| *c == client).map(|(_, ticket)| *ticket).collect();
        assert!(tickets.len() == OUTSTANDING && tickets.is_sorted(), "{client}: {tickets:?}");
    }
}

/// A CPU that hangs: each question is answered all the same, and an answer that comes too late belongs to nobody.
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

/// What comes through the socket of a link gone mad closes that door, and nothing else.
#[test]
fn noise_closes_one_door() {
    let mut station = Station::new(vec![link("mad", Right::Operate), link("panel", Right::Write)]);
    let mut panel = station.open(1);
    let mut random = fastrand::Rng::with_seed(0x1234_5678_9ABC_DEF0);
    for round in 0..300 {
        let (ours, theirs): (OwnedFd, OwnedFd) = handover::pair().expect("a socket");
        station.broker.connect(0, ours, station.time);
        let mut packet = ob1_access::door::ToBroker::Watch {
            generation: u64::from(round % 3 == 0) << 40 | round,
            pieces: vec![bytes(memory(0), 2), Piece::Value(Cell::Timer(9), Width::Bit)],
        }
        .encode();
        for _ in 0..round % 5 {
            let at = random.usize(..packet.len());
            packet[at] = random.u8(..);
        }
        handover::send(&theirs, &packet, &[]).expect("room");
        station.cycle();
    }
    assert!(station.write(&mut panel, 1, &[word(memory(20), 77)]).is_ok());
    assert_eq!(station.read(&mut panel, &[bytes(memory(20), 2)]).value(0), Ok(77));
}

/// A link that asks and takes none of its answers is dropped, and nobody else waits for it.
#[test]
fn a_link_that_takes_nothing_is_let_go() {
    let mut station = Station::new(vec![link("stuck", Right::Read), link("panel", Right::Write)]);
    let mut panel = station.open(1);
    let (ours, theirs) = handover::pair().expect("a socket");
    station.broker.connect(0, ours, station.time);
    let ask = |ticket| ob1_access::door::ToBroker::Ask { client: 1, ticket, ask: Ask::Blocks }.encode();
    let mut sent = 0;
    // Until the way back is full and the broker holds some.
    for _ in 0..600 {
        sent += u64::from(handover::send(&theirs, &ask(sent), &[]).is_ok());
        station.broker.step(station.time);
    }
    assert!(station.write(&mut panel, 1, &[word(memory(20), 1)]).is_ok());
    station.time += 5_000 * MS;
    station.cycles(2);
    assert!(handover::send(&theirs, &ask(0), &[]).is_err(), "its door is closed after {sent} questions");
    assert!(station.write(&mut panel, 1, &[word(memory(20), 2)]).is_ok());
    let mut again = station.open(0);
    assert!(station.read(&mut again, &[bytes(memory(20), 2)]).value(0).is_ok(), "and it may come back");
}
