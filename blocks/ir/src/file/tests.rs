//! Random programs read back as they were written; a text that is not a program is refused with its place.

use ob1_model::{
    Area, BitAddr, BlockId, BlockKind, Component, DataType, Dimension, Field, Interface, Param, Section, TimerKind,
};

use super::operands::WIDTHS;
use super::{ops, parse, write};
use crate::{
    AddressRegister, Arg, BitTest, Call, CallMode, CodeBlock, DataBlock, DataKind, DbRegister, Jump, Logic, Number,
    NumberFormat, Op, Operand, Place, Pointer, Program, Shift, StatusBit, Stmt, Symbol, Target, WordLogic,
};

/// The same programs in every run.
struct Random(fastrand::Rng);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0.u64(..)
    }

    fn below(&mut self, below: usize) -> usize {
        self.0.usize(..below)
    }

    /// Small numbers and edges more often than others.
    fn number(&mut self) -> u32 {
        match self.below(4) {
            0 => self.below(16) as u32,
            1 => [0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7_FFFF, 0x80_0000, 0x7FFF_FFFF, u32::MAX][self.below(10)],
            2 => 0x8000_0000 | (self.below(8) as u32) << 24 | self.below(0x8_0000) as u32,
            _ => self.bits() as u32,
        }
    }

    fn of<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())].clone()
    }

    fn bytes(&mut self) -> Vec<u8> {
        (0..self.below(70)).map(|_| self.bits() as u8).collect()
    }

    fn text(&mut self) -> String {
        const PIECES: [&str; 12] = ["a", "B", "_1", " ", "\"", "\\", "ü", "\n", "\t", "{", ";", "\u{7f}"];
        (0..self.below(6)).map(|_| self.of(&PIECES)).collect()
    }

    fn at(&mut self) -> BitAddr {
        BitAddr(self.number())
    }

    fn area(&mut self) -> Area {
        let areas = [Area::Input, Area::Output, Area::Memory, Area::Db, Area::Di, Area::Local, Area::PreviousLocal];
        if self.below(8) == 0 { Area::Peripheral } else { self.of(&areas) }
    }

    fn place(&mut self) -> Place {
        let at = self.at();
        let pointer = Pointer { area: self.area(), at: self.at() };
        let register = self.of(&[AddressRegister::Ar1, AddressRegister::Ar2]);
        match self.below(9) {
            0 => Place::InDb(self.bits() as u16, at),
            1 => Place::InDi(self.bits() as u16, at),
            2 => Place::Param { index: self.bits() as u16, at },
            3 => Place::Instance(at),
            4 => Place::Memory(self.area(), pointer),
            5 => Place::Register(Some(self.area()), register, at),
            6 => Place::Register(None, register, at),
            _ => Place::Fixed(self.area(), at),
        }
    }

    fn operand(&mut self) -> Operand {
        Operand { width: self.of(&WIDTHS), place: self.place() }
    }

    fn block_number(&mut self) -> Number {
        match self.below(4) {
            0 => Number::Memory(Pointer { area: self.area(), at: self.at() }),
            1 => Number::Param(self.bits() as u16),
            2 => Number::Instance(self.at()),
            _ => Number::Fixed(self.bits() as u16),
        }
    }

    fn id(&mut self) -> BlockId {
        let kinds = [BlockKind::Ob, BlockKind::Fb, BlockKind::Fc, BlockKind::Sfb, BlockKind::Sfc];
        BlockId::new(self.of(&kinds), self.bits() as u16)
    }

    fn call(&mut self) -> Op {
        let target = match self.below(3) {
            0 => Target::Block(self.id()),
            1 => Target::Indirect(self.id().kind, self.block_number()),
            _ => Target::Local(self.id(), self.at()),
        };
        let arg = |random: &mut Self| match random.below(6) {
            0 => Arg::Open,
            1 => Arg::Const(random.number()),
            2 => Arg::Bytes(random.bytes().into()),
            3 => Arg::Operand(random.operand()),
            4 => Arg::Number(random.block_number()),
            _ => Arg::Raw(random.number()),
        };
        let args = (0..self.below(5)).map(|_| arg(self)).collect();
        let mode = self.of(&[CallMode::Call, CallMode::Unconditional, CallMode::Conditional]);
        let instance = if self.below(2) == 0 { Some(self.block_number()) } else { None };
        Op::Call(Box::new(Call { mode, target, instance, args }))
    }

    fn op(&mut self) -> Op {
        let (number, operand, value) = (self.block_number(), self.operand(), self.number());
        let register = self.of(&[AddressRegister::Ar1, AddressRegister::Ar2]);
        let (logic, negate) = (self.of(&Logic::ALL), self.below(2) == 1);
        let word_logic = self.of(&WordLogic::ALL);
        match self.below(32) {
            0 => Op::Scan { logic, negate, test: BitTest::Bit(operand.place) },
            1 => Op::Scan { logic, negate, test: BitTest::Timer(number) },
            2 => Op::Scan { logic, negate, test: BitTest::Counter(number) },
            3 => Op::Scan { logic, negate, test: BitTest::Status(self.of(&StatusBit::ALL)) },
            4 => self.of(&[Op::Assign, Op::Set, Op::Reset, Op::EdgePositive, Op::EdgeNegative])(operand.place),
            5 => self.of(&[Op::Load, Op::Transfer])(operand),
            6 => Op::LoadConst(value),
            7 => Op::LoadParamPointer { index: value as u16, at: if negate { Some(self.at()) } else { None } },
            8 => Op::LoadParamCopy { index: value as u16, bytes: 10, at: self.at() },
            9 => self.of(&[Op::LoadTimer, Op::LoadTimerBcd, Op::LoadCounter, Op::LoadCounterBcd])(number),
            10 => {
                let format = self.of(&NumberFormat::ALL);
                Op::AddConst { format, value: value as i32 }
            }
            11 => Op::WordLogic(word_logic, Some(value as u16)),
            12 => Op::DWordLogic(word_logic, Some(value)),
            13 => Op::Shift(self.of(&[Shift::LeftWord, Shift::RotateRight]), Some(value as u8)),
            14 => self.of(&[Op::Increment, Op::Decrement])(value as u8),
            15 => Op::LoadArConst(register, value),
            16 => Op::LoadArFrom(register, operand),
            17 => Op::TransferArTo(register, operand),
            18 => Op::AddArConst(register, self.at()),
            19 => Op::OpenDb(self.of(&[DbRegister::Db, DbRegister::Di]), number),
            20 => Op::StartTimer(self.of(&[TimerKind::Pulse, TimerKind::OffDelay]), number),
            21 => self.of(&[Op::ResetTimer, Op::EnableTimer, Op::CountUp, Op::CountDown])(number),
            22 => self.of(&[Op::SetCounter, Op::ResetCounter, Op::EnableCounter])(number),
            23 => Op::Jump(self.of(&[Jump::Always, Jump::IfNotRloSaveBr, Jump::IfUnordered]), value),
            24 => Op::Loop(value),
            25 => Op::JumpList { targets: (0..self.below(4)).map(|_| self.number()).collect(), otherwise: value },
            26..=28 => self.call(),
            _ => self.of(&ops::plain()),
        }
    }

    fn ty(&mut self, depth: u32) -> DataType {
        match self.below(if depth == 0 { 1 } else { 5 }) {
            1 => DataType::String(self.bits() as u8),
            2 => {
                let low = self.number() as i32;
                let dimensions = vec![Dimension { low, high: low.saturating_add(3) }; 1 + self.below(3)];
                DataType::Array(dimensions, Box::new(self.ty(depth - 1)))
            }
            3 => {
                let field = |random: &mut Self| Field {
                    name: random.text(),
                    ty: random.ty(depth - 1),
                    initial: random.initial(),
                };
                DataType::Struct((0..self.below(4)).map(|_| field(self)).collect())
            }
            _ if self.below(20) == 0 => DataType::TimerOrWord,
            _ => self.of(DataType::WORDS),
        }
    }

    fn initial(&mut self) -> Option<Vec<u8>> {
        (self.below(3) == 0).then(|| self.bytes())
    }

    fn name(&mut self) -> Option<String> {
        (self.below(2) == 0).then(|| self.text())
    }

    fn block(&mut self) -> CodeBlock {
        let param = |random: &mut Self| Param {
            name: random.text(),
            aliases: (0..random.below(3)).map(|_| random.text()).collect(),
            section: random.of(&Section::ALL),
            ty: random.ty(3),
            at: random.at(),
            initial: random.initial(),
        };
        let params = (0..self.below(4)).map(|_| param(self)).collect();
        let stmt = |random: &mut Self| Stmt { op: random.op(), network: random.bits() as u16, line: random.number() };
        CodeBlock {
            id: self.id(),
            name: self.name(),
            interface: Interface { params, instance_bytes: self.number(), temp_bytes: self.number() },
            code: (0..self.below(40)).map(|_| stmt(self)).collect(),
            source: self.number(),
        }
    }

    fn data(&mut self) -> DataBlock {
        let component = |random: &mut Self| Component { path: random.text(), at: random.at(), ty: random.ty(2) };
        DataBlock {
            number: self.bits() as u16,
            name: self.name(),
            kind: if self.below(2) == 0 { DataKind::Global } else { DataKind::Instance(self.id()) },
            bytes: self.bytes(),
            components: (0..self.below(4)).map(|_| component(self)).collect(),
            read_only: self.below(2) == 0,
            non_retain: self.below(2) == 0,
        }
    }
}

#[test]
fn what_is_written_reads_as_it_was() {
    let mut random = Random(fastrand::Rng::with_seed(0x0B1F_11E5));
    for _ in 0..2000 {
        let symbol = |random: &mut Random| Symbol {
            name: random.text(),
            address: random.text(),
            ty: if random.below(2) == 0 { Some(random.ty(1)) } else { None },
            comment: if random.below(2) == 0 { random.text() } else { String::new() },
        };
        let program = Program {
            symbols: (0..random.below(3)).map(|_| symbol(&mut random)).collect(),
            sources: (0..random.below(3)).map(|_| random.text()).collect(),
            blocks: (0..random.below(3)).map(|_| random.block()).collect(),
            data: (0..random.below(3)).map(|_| random.data()).collect(),
        };
        let text = write(&program);
        let read = parse(&text).unwrap_or_else(|error| panic!("{error} in\n{text}"));
        for (one, other) in read.blocks.iter().flat_map(|b| &b.code).zip(program.blocks.iter().flat_map(|b| &b.code)) {
            assert_eq!(one, other, "{:#}", other.op);
        }
        assert_eq!(read, program, "{text}");
    }
}

#[test]
fn every_plain_operation_has_a_text_of_its_own() {
    let all = ops::plain();
    for (index, op) in all.iter().enumerate() {
        assert!(all[..index].iter().all(|other| other.to_string() != op.to_string()), "{op}");
        assert_eq!(ops::op(&op.to_string()).as_ref(), Ok(op));
    }
}

#[test]
fn what_is_no_program_says_where() {
    let head = "block FC 1 source 0 instance 0 local 0\n";
    for (text, line, expected) in [
        ("nonsense".to_owned(), 1, "source, symbol, block or data"),
        ("; a comment\n\nsource x".to_owned(), 3, "a text in quotes"),
        (format!("{head}  1/1 L MW"), 2, "an operand"),
        (format!("{head}  1/1 L MW 4 4"), 2, "the end of the statement"),
        (format!("{head}  1/1 SPA 4"), 2, "@"),
        (format!("{head}  1/1 XYZ 4"), 2, "a statement"),
        (format!("{head}  1/1 U MW 4"), 2, "a bit"),
        (format!("{head}  VAR \"x\" @0.0 INT"), 2, "a section or a statement"),
        (format!("{head}  IN \"x\" @0.0 FLOAT"), 2, "a type"),
        ("data DB 7\n  bytes 0".to_owned(), 2, "pairs of hexadecimal digits"),
    ] {
        let error = parse(&text).expect_err(&text);
        assert_eq!((error.line, error.expected), (line, expected), "{text}");
    }
}

#[test]
fn any_text_is_read_or_refused() {
    let mut random = Random(fastrand::Rng::with_seed(77));
    let good = write(&Program { blocks: vec![random.block()], data: vec![random.data()], ..Program::default() });
    for _ in 0..5000 {
        let mut bytes = good.clone().into_bytes();
        for _ in 0..1 + random.below(4) {
            let at = random.below(bytes.len());
            bytes[at] = random.of(b" \"#@[]().,-+0123456789ABDLMPTWXZ\n\\{};:");
        }
        if let Ok(text) = String::from_utf8(bytes) {
            let _ = parse(&text);
        }
    }
}
