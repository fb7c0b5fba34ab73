//! A CPU, its broker, and doors to it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use ob1_access::door::{
    Answer, Ask, BlockFact, Diagnosis, Document, Door, Event, News, NotYet, Reading, Refusal, Refused, State,
};
use ob1_access::{Cell, Piece, Put, Right, Width};
use ob1_broker::{Broker, Change, Changed, DriverState, Facts, Feed, LinkConfig, LinkState, feed};
use ob1_cpu::{Clock, Cpu, CpuConfig, DiagEntry, system_blocks};
use ob1_model::{AlarmEvent, Area, BlockId, BlockKind};
use ob1_socket::handover;
use ob1_stl::{Library, Options, Source, compile};
use ob1_time::{Instant, Span};

pub(crate) const MS: Span = Span::MILLISECOND;

/// The count in MW 0, in MW 100 and in DB7.DBW0 is the same after each scan.
pub(crate) const PROGRAM: &str = "
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
DATA_BLOCK DB 35 SFB 35
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
NETWORK
      L MW 0; + 1; T MW 0; T MW 100; T DB7.DBW 0;
      L MW 20; T MW 22;
      CALL SFC 17 (SIG := M 50.0, ID := W#16#EEEE, EV_ID := DW#16#11, SD := MW 52, RET_VAL := MW 54);
      CALL SFB 35, DB 35 (EN_R := TRUE, SIG_1 := M 50.1, SIG_2 := M 50.2, EV_ID := DW#16#23, SD_1 := MW 52,
        STATUS := MW 56, ACK_STATE := MW 58);
END_ORGANIZATION_BLOCK
";

struct Plant {
    up: Arc<AtomicBool>,
    /// Changes of the program that reached it.
    changes: Arc<Mutex<Vec<Change>>>,
    changed: Vec<Changed>,
    /// What partners have done.
    records: Arc<Mutex<Vec<String>>>,
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
    fn record(&mut self, link: &str, partner: &str, what: &str, outcome: &str) {
        self.records.lock().expect("not poisoned").push(format!("{link}, {partner}: {what}: {outcome}"));
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
pub(crate) struct Station {
    pub(crate) cpu: Cpu,
    pub(crate) broker: Broker,
    pub(crate) feed: Feed,
    pub(crate) time: Instant,
    pub(crate) driver_up: Arc<AtomicBool>,
    pub(crate) changes: Arc<Mutex<Vec<Change>>>,
    pub(crate) records: Arc<Mutex<Vec<String>>>,
    /// Events that came while others were waited for.
    pub(crate) seen: Vec<Event>,
    /// The same of changes of alarms, with the client.
    pub(crate) changed: Vec<(u32, AlarmEvent)>,
}

pub(crate) fn link(name: &str, rights: Right) -> LinkConfig {
    LinkConfig { name: name.into(), rights, config: "{}".into(), ..LinkConfig::default() }
}

impl Station {
    pub(crate) fn new(links: Vec<LinkConfig>) -> Self {
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
        let (changes, records): (Arc<_>, Arc<Mutex<Vec<String>>>) = Default::default();
        let (up, log) = (Arc::clone(&driver_up), Arc::clone(&changes));
        let facts = Box::new(Plant { up, changes: log, changed: Vec::new(), records: Arc::clone(&records) });
        let broker = Broker::new(&mut cpu, links, end, facts).expect("a broker");
        cpu.request(ob1_cpu::Command::Warm);
        let mut station = Self {
            cpu,
            broker,
            feed: scan,
            time: Instant::START,
            driver_up,
            changes,
            records,
            seen: Vec::new(),
            changed: Vec::new(),
        };
        station.cycles(2);
        station
    }

    pub(crate) fn open(&mut self, link: usize) -> Door {
        let (ours, theirs) = handover::pair().expect("a socket");
        self.broker.connect(link, ours, self.time);
        let mut door = Door::new(theirs).expect("a door");
        door.pump().expect("open");
        assert!(door.welcome().is_some());
        door
    }

    pub(crate) fn cycle(&mut self) {
        self.time += MS;
        self.cpu.cycle(&mut Time(self.time));
        self.feed.follow(self.cpu.diagnostic_buffer());
        self.broker.step(self.time);
    }

    pub(crate) fn cycles(&mut self, count: usize) {
        (0..count).for_each(|_| self.cycle());
    }

    /// The texts of the entries with this event in the diagnostic buffer, newest first.
    pub(crate) fn entries(&mut self, event: u16) -> Vec<String> {
        self.cycles(2);
        let entries = self.cpu.diagnostics().filter(|entry| entry.event.0 == event);
        entries.map(|entry| entry.text.as_str().to_owned()).collect()
    }

    /// Asks until the answer is there.
    pub(crate) fn ask(&mut self, door: &mut Door, client: u32, ask: Ask) -> Answer {
        let asked = door.ask(client, ask);
        match self.until(door, |news| matches!(news, News::Answer { ticket, .. } if *ticket == asked)) {
            News::Answer { answer, .. } => answer,
            other => panic!("{other:?}"),
        }
    }

    pub(crate) fn write(&mut self, door: &mut Door, client: u32, puts: &[Put]) -> Result<u64, Refused> {
        let written = door.write(client, puts.to_vec()).expect("a group");
        match self.until(door, |news| matches!(news, News::Written { ticket, .. } if *ticket == written)) {
            News::Written { outcome, .. } => outcome,
            other => panic!("{other:?}"),
        }
    }

    pub(crate) fn until(&mut self, door: &mut Door, wanted: impl Fn(&News) -> bool) -> News {
        for _ in 0..300 {
            door.pump().expect("open");
            while let Some(news) = door.take_news() {
                if wanted(&news) {
                    return news;
                }
                match news {
                    News::Event(event) => self.seen.push(event),
                    News::Alarm { client, event } => self.changed.push((client, *event)),
                    _ => {}
                }
            }
            self.broker.step(self.time);
            self.cycle();
        }
        panic!("no answer in three hundred cycles");
    }

    pub(crate) fn read(&mut self, door: &mut Door, pieces: &[Piece]) -> Reading {
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

pub(crate) fn memory(byte: u32) -> Cell {
    Cell::Area(Area::Memory, byte * 8)
}

pub(crate) fn bytes(at: Cell, len: u32) -> Piece {
    Piece::Bytes { at, len }
}

pub(crate) fn word(at: Cell, value: u32) -> Put {
    Put::Value(at, Width::Word, value)
}
