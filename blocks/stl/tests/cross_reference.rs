//! The cross-reference has no holes: whatever a statement of the examples names is found, in both sets of mnemonics and
//! through everything that overlaps it. Somebody disconnects a wire on this answer.

#![allow(clippy::disallowed_methods, reason = "the test reads the examples from the disk")]

mod common;

use std::path::{Path, PathBuf};

use ob1_ir::{Arg, BitTest, CodeBlock, Number, Op, Operand, Place, Program, Width};
use ob1_model::{Area, BlockKind};
use ob1_stl::{CrossReference, Match, Options, Source, compile};

fn sources(folder: &Path, all: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(&path, all);
        } else if path.extension().is_some_and(|e| e == "awl") {
            all.push(path);
        }
    }
}

/// Every operand that a statement names, read from the statement without the cross-reference.
fn operands(op: &Op) -> Vec<Operand> {
    let mut all: Vec<Operand> = op.operand().into_iter().collect();
    if let Op::Call(call) = op {
        all.extend(call.args.iter().filter_map(|arg| if let Arg::Operand(o) = arg { Some(*o) } else { None }));
    }
    all
}

/// A name in German and international mnemonics.
fn names(area: Area, width: Width, byte: u32, bit: u32, writes: bool) -> Option<[String; 2]> {
    let letter = |peripheral: &str, plain: &str| match width {
        Width::Bit => format!("{plain} {byte}.{bit}"),
        Width::Byte => format!("{peripheral}{plain}B {byte}"),
        Width::Word => format!("{peripheral}{plain}W {byte}"),
        Width::DWord => format!("{peripheral}{plain}D {byte}"),
    };
    let [german, international] = match (area, writes) {
        (Area::Input, _) => ["E", "I"],
        (Area::Output, _) => ["A", "Q"],
        (Area::Memory, _) => ["M", "M"],
        (Area::Peripheral, _) if width == Width::Bit => return None,
        (Area::Peripheral, false) => ["E", "I"],
        (Area::Peripheral, true) => ["A", "Q"],
        _ => return None,
    };
    let peripheral = if area == Area::Peripheral { "P" } else { "" };
    Some([letter(peripheral, german), letter(peripheral, international)])
}

/// Everything that shares a bit with an operand, and its bytes by prefix.
fn overlapping(area: Area, operand: Operand, at: u32, writes: bool) -> Vec<String> {
    let (first, last) = (at, at + u32::from(operand.width.bits()) - 1);
    let mut all = Vec::new();
    for byte in first / 8..=last / 8 {
        for bit in (0..8).filter(|bit| (first..=last).contains(&(byte * 8 + bit))) {
            all.extend(names(area, Width::Bit, byte, bit, writes));
        }
    }
    for (width, bytes) in [(Width::Byte, 1), (Width::Word, 2), (Width::DWord, 4)] {
        for byte in (first / 8).saturating_sub(bytes - 1)..=last / 8 {
            all.extend(names(area, width, byte, 0, writes));
        }
    }
    let mut all = all.concat();
    // An input read past the process image is the same wire.
    if area == Area::Peripheral {
        let image = if writes { Area::Output } else { Area::Input };
        all.extend(names(image, Width::Bit, first / 8, first % 8, writes).unwrap());
    }
    all
}

struct Asked<'a> {
    all: &'a CrossReference<&'a ob1_ir::Program>,
    asked: usize,
}

impl Asked<'_> {
    /// The statement is in the answer, not only as one that may be meant.
    fn finds(&mut self, block: &CodeBlock, at: usize, names: impl IntoIterator<Item = String>) {
        let stmt = &block.code[at];
        for name in names {
            self.asked += 1;
            let uses = self.all.find(&name).unwrap_or_else(|unknown| panic!("{unknown}"));
            let here = |(how, r): &(Match, &ob1_stl::Reference)| {
                (r.block, r.line) == (block.id, stmt.line) && *how != Match::Possible
            };
            assert!(uses.found.iter().any(here), "{name}: {} {}: {}", block.id, stmt.line, stmt.op);
        }
    }

    fn statement(&mut self, block: &CodeBlock, at: usize) {
        let op = &block.code[at].op;
        for operand in operands(op) {
            match operand.place {
                Place::Fixed(area @ (Area::Input | Area::Output | Area::Memory | Area::Peripheral), bit) => {
                    self.finds(block, at, overlapping(area, operand, bit.0, op.writes()));
                }
                Place::InDb(db, bit) => {
                    let (byte, low) = (bit.0 / 8, bit.0 % 8);
                    let word = byte.saturating_sub(1);
                    let names = [
                        format!("DB{db}.DBX {byte}.{low}"),
                        format!("db{db}.dbb{byte}"),
                        format!("DB{db}.DBW {word}"),
                        format!("DB{db}.DBD {word}"),
                        format!("DB {db}"),
                        format!("DB{db}"),
                    ];
                    self.finds(block, at, names);
                }
                _ => {}
            }
        }
        if let (Some(Number::Fixed(n)), Op::OpenDb(..)) = (op.number(), op) {
            self.finds(block, at, [format!("DB {n}")]);
        }
        match op {
            Op::Scan { test: BitTest::Timer(Number::Fixed(n)), .. }
            | Op::StartTimer(_, Number::Fixed(n))
            | Op::ResetTimer(Number::Fixed(n))
            | Op::LoadTimer(Number::Fixed(n)) => self.finds(block, at, [format!("T {n}"), format!("t{n}"), "T".into()]),
            Op::CountUp(Number::Fixed(n)) | Op::LoadCounter(Number::Fixed(n)) => {
                self.finds(block, at, [format!("Z {n}"), format!("C {n}"), "C".into()]);
            }
            Op::Call(call) => {
                if let ob1_ir::Target::Block(id) = call.target {
                    self.finds(block, at, [id.to_string(), id.kind.name().to_owned()]);
                }
            }
            _ => {}
        }
    }
}

#[test]
fn every_operand_of_the_examples_is_found_by_whatever_overlaps_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut all = Vec::new();
    sources(&root.join("../../examples"), &mut all);
    sources(&root.join("tests/data"), &mut all);
    sources(&root.join("tests/inspect"), &mut all);
    let (library, mut statements, mut asked) = (common::library(), 0, 0);
    for path in all {
        let source = Source::new(path.display().to_string(), std::fs::read(&path).unwrap());
        let options = Options { mnemonics: ob1_stl::Mnemonics::Auto, ..Options::default() };
        // What could be compiled is enough: the blocks of some plugins are not here.
        let program = compile(std::slice::from_ref(&source), &library, &options).program;
        let mut one = Asked { all: &CrossReference::new(&program, &library), asked: 0 };
        for block in &program.blocks {
            statements += block.code.len();
            (0..block.code.len()).for_each(|at| one.statement(block, at));
        }
        asked += one.asked;
    }
    assert!(statements > 2000 && asked > 10_000, "{statements} statements, {asked} questions");
}

fn program(text: &str, symbols: &[(&str, &str)]) -> Program {
    let symbol = |(name, address): &(&str, &str)| ob1_ir::Symbol {
        name: (*name).into(),
        address: (*address).into(),
        ..ob1_ir::Symbol::default()
    };
    let options = Options { symbols: symbols.iter().map(symbol).collect(), ..Options::default() };
    let output = compile(&[Source::new("x.awl", text)], &common::library(), &options);
    assert!(output.is_good(), "{:?}", output.diagnostics);
    output.program
}

const PLANT: &str = "FUNCTION_BLOCK FB 20\nVAR_INPUT\n on : BOOL;\nEND_VAR\nVAR\n level : INT;\nEND_VAR\nBEGIN\nU #on;\nL #level;\n\
    END_FUNCTION_BLOCK\n\
    FUNCTION_BLOCK FB 30\nVAR\n left : FB 20;\n right : FB 20;\nEND_VAR\nBEGIN\nCALL #right (on := E 8.0);\nEND_FUNCTION_BLOCK\n\
    DATA_BLOCK DB 30 FB 30\nBEGIN\nEND_DATA_BLOCK\n\
    DATA_BLOCK DB 10\nSTRUCT\n speed : INT;\n ramp : INT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\
    ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FB 30, DB 30 ();\nAUF DB 10;\nL DBW 2;\nSPB m;\nAUF DB 30;\nm: L DBW 0;\n\
    LAR1 P#E 8.0;\nU [AR1,P#0.0];\n= A 4.0;\nU E 8.1;\n= A 4.0;\nT AW 6;\nL PEW 8;\nL MW 10;\nEND_ORGANIZATION_BLOCK\n";

fn lines(all: &CrossReference<&ob1_ir::Program>, name: &str, least: Match) -> Vec<(String, u32)> {
    let uses = all.find(name).unwrap_or_else(|unknown| panic!("{unknown}"));
    uses.found.iter().filter(|(how, _)| *how <= least).map(|(_, r)| (r.block.to_string(), r.line)).collect()
}

#[test]
fn instances_open_data_blocks_and_pointers_are_found() {
    let program = program(PLANT, &[("Motor", "E 8.0"), ("Spare", "M 90.0"), ("Part", "MB 11")]);
    let all = CrossReference::new(&program, &common::library());
    let at = |block: &str, text: &str| {
        let line = PLANT.lines().position(|line| line == text).expect(text) as u32 + 1;
        (block.to_owned(), line)
    };
    // The multi-instance lies in DB 30: its names are those of the cells of DB 30.
    let level = lines(&all, "DB30.right.level", Match::Overlap);
    assert!(level.contains(&at("FB 20", "L #level;")), "{level:?}");
    let on = lines(&all, "DB30.right.on", Match::Overlap);
    assert!(on.contains(&at("FB 20", "U #on;")) && on.contains(&at("FB 30", "CALL #right (on := E 8.0);")), "{on:?}");
    // Opened for certain, and perhaps.
    assert_eq!(lines(&all, "DB10.ramp", Match::Overlap), [at("OB 1", "L DBW 2;")]);
    assert!(lines(&all, "DB10.speed", Match::Possible).contains(&at("OB 1", "m: L DBW 0;")));
    assert!(!lines(&all, "DB10.speed", Match::Overlap).contains(&at("OB 1", "m: L DBW 0;")));
    // A pointer to it, a word around it past the process image, and what may point there.
    for name in ["E 8.0", "I 8.0", "i8.0", "\"Motor\"", "motor", "IW 8", "E 8", "EB8", "PEW 8"] {
        let found = lines(&all, name, Match::Overlap);
        for text in ["LAR1 P#E 8.0;", "L PEW 8;"] {
            assert!(found.contains(&at("OB 1", text)), "{name}: {found:?}");
        }
        assert!(found.contains(&at("FB 30", "CALL #right (on := E 8.0);")), "{name}: {found:?}");
        assert!(lines(&all, name, Match::Possible).contains(&at("OB 1", "U [AR1,P#0.0];")), "{name}");
    }
    assert_eq!(lines(&all, "FB20#level", Match::Same), [at("FB 20", "L #level;")]);
    let unused: Vec<&str> = all.unused().iter().map(|symbol| symbol.name.as_str()).collect();
    assert_eq!(unused, ["Spare"]);
    let twice = all.written_twice();
    let twice: Vec<_> = twice.iter().map(|one| (one.outputs.as_slice(), one.writers.len())).collect();
    assert_eq!(twice, [(&["A 4.0".to_owned()][..], 2)]);
}

#[test]
fn what_there_is_not_is_told_with_what_may_be_meant() {
    let program = program(PLANT, &[("Motor", "E 8.0")]);
    let all = CrossReference::new(&program, &common::library());
    for (name, remedy) in
        [("Motr", "Did you mean \"Motor\"?"), ("DB10.rampe", "Did you mean \"DB10.ramp\"?"), ("?", "Write an operand")]
    {
        let unknown = all.find(name).expect_err(name);
        assert!(unknown.remedy.starts_with(remedy), "{unknown:?}");
    }
    assert!(lines(&all, "E 100.0", Match::Overlap).is_empty());
}

#[test]
fn assignment_and_calls_are_lists_a_person_reads() {
    let program = program(PLANT, &[("Motor", "E 8.0")]);
    let all = CrossReference::new(&program, &common::library());
    let list = all.assignment().render(ob1_stl::Mnemonics::International);
    for line in [
        "I 8     o o o o o o x x   BWP",
        "Q 4     . . . . . . . x",
        "free    Q 0 to 3, 4.1 to 4.7, 5",
        "M 10    o o o o o o o o   W",
    ] {
        assert!(list.contains(line), "{line}\n{list}");
    }
    let calls = all.calls();
    let tree = "OB 1\n  FB 30, DB 30  network 1, x.awl:32\n    FB 20 #right  network 1, x.awl:18\n";
    assert!(calls.starts_with(tree), "{calls}");
    assert_eq!(program.blocks.iter().filter(|block| block.id.kind == BlockKind::Fb).count(), 2);
}
