//! A rack of virtual time with a changed program: what the judge finds, and that it finds nothing where nothing is.

use ob1_cpu::{Cell, Command, Width};
use ob1_model::Area;
use ob1_time::{Instant, Span};

use super::judge::{Difference, Judge};
use super::rack::{Look, Rack, Whole};
use super::subject::Subject;
use crate::testing::bench::Bench;

/// A machine with a bit of everything: latches, edges, five kinds of timers, counters, comparisons, a sequence, blocks
/// with parameters, an instance.
const PROGRAM: &str = include_str!("tests/machine.awl");

const STATION: &str = r#"
[station]
name = "machine"
[cpu]
min_cycle = "10ms"
clock_memory = 100
[program]
sources = ["machine.awl"]
[[module]]
type = "di"
name = "inputs"
address = 0
bytes = 2
[[module]]
type = "ai"
name = "level"
address = 2
channels = 1
[[module]]
type = "do"
name = "outputs"
address = 0
bytes = 8
"#;

/// What stands in the machine's program, what the rack has instead.
const CHANGES: [(&str, &str); 20] = [
    ("U     E 0.0;  // guard", "UN    E 0.0;  // guard"),
    ("S     A 0.1;", "=     A 0.1;"),
    ("L     S5T#2S;", "L     S5T#3S;"),
    ("SE    T 1;", "SS    T 1;"),
    ("L     S5T#4S;", "L     S5T#2S;"),
    ("SA    T 2;", "SI    T 2;"),
    ("SV    T 3;", "SI    T 3;"),
    ("=     M 11.0;", "S     M 11.0;"),
    ("FN    M 10.1;", "FP    M 10.1;"),
    ("ZV    Z 1;", "ZR    Z 1;"),
    (">=I   ;  // full", "<=I   ;  // full"),
    ("L     800;", "L     820;"),
    ("+I    ;  // next", "-I    ;  // next"),
    ("L     3;  // steps", "L     2;  // steps"),
    ("SPBN  idle;", "SPB   idle;"),
    ("U     #enable;", "ON    #enable;"),
    ("L     #gain;", "L     2;"),
    ("O     M 100.5;", "U     M 100.5;"),
    ("X     E 1.1;", "O     E 1.1;"),
    ("R     A 1.2;", "S     A 1.2;"),
];

/// A station file with this program.
fn subject(program: &str) -> (tempfile::TempDir, Subject) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("machine.awl"), program).expect("written");
    std::fs::write(folder.path().join("station.toml"), STATION).expect("written");
    let subject = Subject::load(&folder.path().join("station.toml"), &[]).expect("it compiles");
    (folder, subject)
}

/// A rack that plays its program in virtual time, with inputs that change at random and a reader that is never on time.
struct Played<'s> {
    /// Whose cells are read.
    subject: &'s Subject,
    bench: Bench,
    rng: fastrand::Rng,
    now: Instant,
    /// When each input bit changes next.
    next: Vec<Instant>,
    inputs: [u8; 4],
    loss: bool,
}

impl<'s> Played<'s> {
    fn new(subject: &'s Subject, rack: &Subject, seed: u64, loss: bool) -> Self {
        let mut bench = rack.bench(0).expect("a rack");
        bench.start(Command::Warm);
        let rng = fastrand::Rng::with_seed(seed);
        let next = vec![Instant::START; 17];
        Self { subject, bench, rng, now: Instant::START, next, inputs: [0; 4], loss }
    }

    /// Its time goes on; inputs change on the way.
    fn run(&mut self, to: Instant) {
        loop {
            let (index, at) = self.next.iter().copied().enumerate().min_by_key(|(_, at)| *at).expect("inputs");
            if at > to {
                break;
            }
            self.bench.run_until(at);
            match index {
                16 => {
                    let level = i16::from_be_bytes([self.inputs[2], self.inputs[3]]);
                    let level = (level + self.rng.i16(-60..=70)).rem_euclid(1000);
                    self.inputs[2..].copy_from_slice(&level.to_be_bytes());
                }
                bit => self.inputs[bit / 8] ^= 1 << (bit % 8),
            }
            self.bench.write_input(0, &self.inputs);
            let pause = Span::from_millis(self.rng.u64(if index == 16 { 200..600 } else { 400..6000 }));
            self.next[index] = at.saturating_add(pause);
        }
        self.bench.run_until(to);
        self.now = to;
    }

    fn wait(&mut self) {
        let ms = match self.rng.u32(..) % 1000 {
            0 if self.loss => self.rng.u64(700..4000),
            ..50 => self.rng.u64(60..140),
            _ => self.rng.u64(35..65),
        };
        self.run(self.now.saturating_add(Span::from_millis(ms)));
    }

    fn value(&mut self, cell: Cell, width: Width) -> Option<u32> {
        self.bench.cpu.read(cell, width).ok()
    }

    fn bytes(&mut self, cell: impl Fn(u32) -> Cell, count: u32) -> Vec<u8> {
        (0..count).map(|byte| self.value(cell(byte * 8), Width::Byte).unwrap_or_default() as u8).collect()
    }
}

impl Rack for Played<'_> {
    fn look(&mut self, cells: &[usize]) -> Result<Option<Look>, String> {
        self.wait();
        let inputs = self.bytes(|bit| Cell::Area(Area::Input, bit), 4);
        let clock = self.value(Cell::Area(Area::Memory, 800), Width::Byte).map(|byte| byte as u8);
        let items: Vec<_> = cells.iter().map(|cell| self.subject.cells[*cell].item.clone()).collect();
        let values = items.iter().map(|item| self.value(item.cell, item.width)).collect();
        Ok(Some(Look { at: self.now, inputs, clock, values }))
    }

    fn whole(&mut self) -> Result<Whole, String> {
        // It takes its time.
        self.run(self.now.saturating_add(Span::from_millis(30)));
        let cells = self.subject.cells.clone();
        let values = cells.iter().map(|watched| self.value(watched.item.cell, watched.item.width)).collect();
        let blocks: Vec<_> = self.subject.data_blocks().collect();
        let data = blocks.into_iter().map(|(db, len)| (db, self.bytes(|bit| Cell::Db(db, bit), len))).collect();
        let subject = self.subject;
        let mut counted = |timers: bool| {
            let cell = |n| if timers { Cell::Timer(n) } else { Cell::Counter(n) };
            let numbers = subject.counted(timers).into_iter();
            numbers.map(|n| (n, self.value(cell(n), Width::Word).unwrap_or_default() as u16)).collect::<Vec<_>>()
        };
        let (timers, counters) = (counted(true), counted(false));
        let memory = self.bytes(|bit| Cell::Area(Area::Memory, bit), subject.memory_bytes());
        let inputs = self.bytes(|bit| Cell::Area(Area::Input, bit), 4);
        Ok(Whole { at: self.now, inputs, values, memory, data, timers, counters })
    }
}

/// What is found in so much time.
fn found(subject: &Subject, rack: &mut Played<'_>, time: Span) -> (Vec<Difference>, super::judge::Counts) {
    let mut judge = Judge::new(subject, 0).expect("replicas");
    let end = rack.now.saturating_add(time);
    let mut differences = Vec::new();
    while rack.now < end {
        let look = rack.look(&judge.wanted()).expect("it answers").expect("it runs");
        differences.extend(judge.take(look, rack).expect("it answers"));
    }
    (differences, judge.counts())
}

fn minutes(default: u64) -> Span {
    let wanted = std::env::var("OB1_SHADOW_MINUTES").ok().and_then(|text| text.parse().ok());
    Span::from_secs(60 * wanted.unwrap_or(default))
}

/// Nothing is found where both have the same program, however late and rarely it is read.
#[test]
fn the_same_program_has_no_difference() {
    let (_folder, subject) = subject(PROGRAM);
    let mut rack = Played::new(&subject, &subject, 7, true);
    let (differences, counts) = found(&subject, &mut rack, minutes(10));
    let told = differences.iter().map(|found| (&subject.cells[found.cell].item.name, found.since, &found.origins));
    assert!(differences.is_empty(), "{:#?}\n{counts:?}", told.collect::<Vec<_>>());
    assert!(counts.equal * 10 > counts.readings * 8, "most readings are judged: {counts:?}");
}

/// Each change of the program is found, and the network where it begins named.
#[test]
fn each_change_is_found_where_it_is() {
    let (_folder, own) = subject(PROGRAM);
    let (mut wrong, mut missed) = (Vec::new(), Vec::new());
    for (index, (old, new)) in CHANGES.iter().enumerate() {
        assert_eq!(PROGRAM.matches(old).count(), 1, "{old}");
        let line = PROGRAM.lines().position(|line| line.contains(old)).expect("it is there") as u32 + 1;
        let (_folder, other) = subject(&PROGRAM.replace(old, new));
        let mut rack = Played::new(&own, &other, index as u64, true);
        let (differences, counts) = found(&own, &mut rack, Span::from_secs(600));
        let Some(first) = differences.first() else {
            missed.push(format!("{old}: {counts:?}"));
            continue;
        };
        let network = network_of(line);
        if first.origins.first().is_none_or(|origin| network_of(origin.line) != network) {
            wrong.push((*old, first.origins.clone()));
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
    assert!(wrong.len() <= 2, "{wrong:#?}");
}

/// Counts the networks up to a line of the program.
fn network_of(line: u32) -> usize {
    PROGRAM.lines().take(line as usize).filter(|line| line.trim() == "NETWORK").count()
}

/// A program that stops its own CPU is told as such, and not as differences.
#[test]
fn a_program_that_stops_is_told() {
    let (_folder, own) =
        subject(&PROGRAM.replace("=     A 0.0;", "=     A 0.0;\n      SPBN  on;\n      CALL  SFC 46;\non:   NOP   0;"));
    let (_folder, other) = subject(PROGRAM);
    let mut rack = Played::new(&own, &other, 3, false);
    let mut judge = Judge::new(&own, 0).expect("replicas");
    let why = (0..2000).find_map(|_| {
        let look = rack.look(&judge.wanted()).expect("it answers").expect("it runs");
        let _ = judge.take(look, &mut rack).expect("it answers");
        judge.halted()
    });
    assert!(why.as_ref().is_some_and(|why| why.contains("SFC 46")), "{why:?}");
}
