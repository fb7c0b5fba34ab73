//! Why a bit has its value: what is named is true on the CPU. Random programs of bit logic run once with everything as
//! it was, and once for each named bit with that bit the other way.

use ob1_cpu::{Cell, Job, PassJob, Width};
use ob1_ir::why::{Observed, Skipped, Why};
use ob1_ir::{BitTest, Op, Place, Program};
use ob1_model::{Area, BitAddr, PassEnd, PassLine, PassOrder};
use ob1_stl::{Library, Options, Source};
use ob1_time::Span;

use crate::common;
use crate::common::Bench;
use crate::common::window::Looker;

/// Bits that nothing writes: M 0.0 to M 1.7. Flags are M 4.0 to M 4.7, edges M 5.x, outputs M 6.0 to M 6.3.
const MEMORY: u32 = 8;
const PROGRAMS: u32 = 250;
const OUTPUTS: u32 = 4;

struct Draw<'r> {
    random: &'r mut fastrand::Rng,
    edges: u32,
}

impl Draw<'_> {
    fn operand(&mut self) -> String {
        match self.random.u32(..10) {
            0 | 1 => format!("M 4.{}", self.random.u32(..8)),
            2 => format!("M 6.{}", self.random.u32(..OUTPUTS)),
            _ => format!("M {}.{}", self.random.u32(..2), self.random.u32(..8)),
        }
    }

    fn logic(&mut self) -> &'static str {
        ["U", "U", "U", "UN", "O", "ON", "X", "XN"][self.random.usize(..8)]
    }

    fn chain(&mut self, depth: u32, out: &mut String) {
        for _ in 0..self.random.u32(1..5) {
            match self.random.u32(..12) {
                0 | 1 if depth < 3 => {
                    let opens = ["U(", "O(", "UN(", "X(", "ON("][self.random.usize(..5)];
                    out.push_str(&format!("{opens};\n"));
                    self.chain(depth + 1, out);
                    out.push_str(");\n");
                }
                2 => {
                    let operand = self.operand();
                    out.push_str(&format!("O;\nU {operand};\n"));
                }
                3 => out.push_str("NOT;\n"),
                4 if depth == 0 && self.edges < 8 => {
                    let edge = if self.random.bool() { "FP" } else { "FN" };
                    out.push_str(&format!("{edge} M 5.{};\n", self.edges));
                    self.edges += 1;
                }
                _ => {
                    let (logic, operand) = (self.logic(), self.operand());
                    out.push_str(&format!("{logic} {operand};\n"));
                }
            }
        }
    }

    fn network(&mut self, number: u32, out: &mut String) {
        self.chain(0, out);
        let jump = self.random.u32(..8) == 0;
        if jump {
            out.push_str(&format!("SPBN j{number};\n"));
            self.chain(0, out);
        }
        let target = if self.random.bool() {
            format!("M 4.{}", self.random.u32(..8))
        } else {
            format!("M 6.{}", self.random.u32(..OUTPUTS))
        };
        let ends = ["=", "=", "=", "S", "R"][self.random.usize(..5)];
        out.push_str(&format!("{ends} {target};\n"));
        if self.random.u32(..8) == 0 {
            // The same bits as a word.
            out.push_str("L MB 4;\nL B#16#7;\n>I;\n= M 6.0;\n");
        }
        if jump {
            out.push_str(&format!("j{number}: NOP 0;\n"));
        }
    }

    fn program(&mut self) -> String {
        let mut body = String::new();
        for number in 0..self.random.u32(1..6) {
            self.network(number, &mut body);
        }
        format!("ORGANIZATION_BLOCK OB 1\nBEGIN\n{body}END_ORGANIZATION_BLOCK\n")
    }
}

fn compiled(source: &str) -> Program {
    let output = ob1_stl::compile(&[Source::new("why.awl", source)], &Library::new(), &Options::default());
    assert!(output.is_good(), "{source}\n{:?}", output.diagnostics);
    output.program
}

struct Plant {
    bench: Bench,
    looker: Looker,
}

impl Plant {
    fn of(source: &str) -> Self {
        let mut bench = common::source::bench(source, &[]);
        let looker = Looker::of(&mut bench.cpu).expect("the first");
        bench.run();
        Self { bench, looker }
    }

    /// One cycle that begins with these bytes.
    fn cycle(&mut self, memory: &[u8]) {
        for (byte, value) in (0..).zip(memory) {
            let cell = Cell::Area(Area::Memory, byte * 8);
            self.bench.cpu.write(cell, Width::Byte, u32::from(*value)).expect("a flag");
        }
        self.bench.clock.now += Span::from_millis(100);
        self.bench.cycle();
    }

    fn pass(&mut self, memory: &[u8]) -> Vec<PassLine> {
        let wait = Span::from_secs(10).nanos();
        let order = PassOrder { block: common::ob(1), from: None, db: 0, first: 0, count: 512, wait, before: false };
        self.looker.link.hand(PassJob::new(1, order)).expect("room");
        for _ in 0..30 {
            self.cycle(memory);
            if let Some(Job::Pass(job)) = self.looker.link.take() {
                let pass = job.into_pass();
                assert_eq!(pass.end, PassEnd::Whole);
                return pass.lines;
            }
        }
        panic!("it does not come back");
    }

    fn bit(&mut self, place: Place) -> bool {
        let Place::Fixed(area, at) = place else { panic!("{place:?}") };
        self.bench.cpu.read(Cell::Area(area, at.0), Width::Bit).expect("a bit") == 1
    }
}

fn flipped(memory: &[u8], at: BitAddr) -> Vec<u8> {
    let mut memory = memory.to_vec();
    memory[at.byte() as usize] ^= 1 << at.bit();
    memory
}

fn scanned(program: &Program, statement: usize) -> BitAddr {
    match program.blocks[0].code[statement].op {
        Op::Scan { test: BitTest::Bit(Place::Fixed(Area::Memory, at)), .. } => at,
        ref op => panic!("{op}"),
    }
}

/// What is told of one output, against the CPU.
fn judge(program: &Program, plant: &mut Plant, memory: &[u8], place: Place, why: &Why, source: &str) -> [u32; 2] {
    plant.cycle(memory);
    let now = plant.bit(place);
    let mut told = [0, 0];
    for term in &why.decisive {
        plant.cycle(&flipped(memory, scanned(program, term.statement)));
        assert_ne!(plant.bit(place), now, "{place:?} by statement {} of\n{source}{memory:02X?}", term.statement);
        told[0] += 1;
    }
    if why.decisive.is_empty() && !why.is_open {
        // More than one must: none of those scanned does it.
        for (at, stmt) in program.blocks[0].code.iter().enumerate() {
            if let Op::Scan { test: BitTest::Bit(Place::Fixed(Area::Memory, bit)), .. } = stmt.op
                && bit.byte() < 2
            {
                plant.cycle(&flipped(memory, bit));
                assert_eq!(plant.bit(place), now, "{place:?} by statement {at} of\n{source}{memory:02X?}");
            }
        }
        told[1] += 1;
    }
    told
}

/// `WHY_PROGRAMS` draws so many.
#[expect(clippy::disallowed_methods, reason = "how many programs a campaign has")]
#[test]
fn a_named_bit_the_other_way_changes_the_output() {
    let count = std::env::var("WHY_PROGRAMS").ok().and_then(|count| count.parse().ok()).unwrap_or(PROGRAMS);
    let mut random = fastrand::Rng::with_seed(35);
    let (mut named, mut more, mut open, mut asked) = (0, 0, 0, 0);
    for _ in 0..count {
        let source = Draw { random: &mut random, edges: 0 }.program();
        let program = compiled(&source);
        let mut plant = Plant::of(&source);
        let memory: Vec<u8> = (0..MEMORY).map(|_| random.u8(..)).collect();
        let lines = plant.pass(&memory);
        let observed = Observed { code: &program.blocks[0].code, lines: &lines, disturbs: &|_, _| true };
        for bit in 0..OUTPUTS {
            let place = Place::Fixed(Area::Memory, BitAddr::new(6, bit as u8));
            let now = plant.bit(place);
            let Some(why) = observed.why(place, now) else { continue };
            asked += 1;
            open += u32::from(why.is_open && why.decisive.is_empty());
            let told = judge(&program, &mut plant, &memory, place, &why, &source);
            (named, more) = (named + told[0], more + told[1]);
            // Another pass of the same scan for the next one.
            plant.cycle(&memory);
        }
    }
    eprintln!(
        "{count} programs, {asked} questions: {named} bits named, {more} times more than one, {open} times not known"
    );
    assert!(
        named > count / 2 && more > count / 20 && open < asked / 2,
        "{named} named, {more} more, {open} of {asked} open"
    );
}

#[test]
fn what_was_jumped_over_names_the_jump() {
    let source = "ORGANIZATION_BLOCK OB 1\nBEGIN\nU M 0.0;\nSPBN j;\nU M 0.1;\n= M 6.0;\nj: U M 0.2;\nU M 0.3;\n= M 6.1;\n\
        END_ORGANIZATION_BLOCK\n";
    let program = compiled(source);
    let lines = Plant::of(source).pass(&[0b0100, 0, 0, 0, 0, 0, 0, 0]);
    let observed = Observed { code: &program.blocks[0].code, lines: &lines, disturbs: &|_, _| true };
    let output = |bit| Place::Fixed(Area::Memory, BitAddr::new(6, bit));
    assert_eq!(observed.why(output(0), false), None);
    assert_eq!(observed.skipped(3), Skipped::By(1));
    let jump = observed.terms(1);
    assert_eq!((jump.len(), jump[0].turns, jump[0].bit), (1, true, false));
    let why = observed.why(output(1), false).expect("it ran");
    let named: Vec<usize> = why.decisive.iter().map(|term| term.statement).collect();
    assert_eq!((why.writer, why.terms.len(), named), (Some(6), 2, vec![5]), "{why:?}");
}
