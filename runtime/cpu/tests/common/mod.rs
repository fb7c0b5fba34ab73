//! What the tests of the CPU share: a clock in virtual time, and programs written directly as intermediate code.
#![allow(dead_code, unreachable_pub, unused_imports, reason = "each test crate uses its own part")]

pub mod calls;
pub mod engines;
pub mod rack;
pub mod random;
pub mod source;
pub mod window;

pub use engines::{ENGINES, engine, is_reference, on_each_engine};
use ob1_cpu::{Cell, Clock, Command, Cpu, CpuConfig, CycleEnd, ObFigures, OperatingState};
use ob1_ir::{Arg, Call, CallMode, CodeBlock, DataBlock, DataKind, Op, Operand, Place, Program, Stmt, Target, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Layout, Param, Section};
use ob1_time::{Instant, Span};

/// Virtual time: moves when told, and by a charge for each statement.
#[derive(Debug, Default)]
pub struct ManualClock {
    pub now: Instant,
    pub per_statement: Span,
}

impl Clock for ManualClock {
    fn now(&mut self) -> Instant {
        self.now
    }
    fn executed(&mut self, statements: u64) {
        self.now += statements * self.per_statement;
    }
    fn statements_in(&self, time: Span) -> Option<u64> {
        (!self.per_statement.is_zero()).then(|| time.div_ceil(self.per_statement))
    }
    fn wait(&mut self, deadline: Instant) {
        self.now = self.now.max(deadline);
    }
}

pub const MS: Span = Span::MILLISECOND;

/// The instant this long after the clock's start.
pub fn at(time: Span) -> Instant {
    Instant::START + time
}

pub fn fc(number: u16) -> BlockId {
    BlockId::new(BlockKind::Fc, number)
}

pub fn fb(number: u16) -> BlockId {
    BlockId::new(BlockKind::Fb, number)
}

pub fn ob(number: u16) -> BlockId {
    BlockId::new(BlockKind::Ob, number)
}

pub fn place(area: Area, byte: u32, bit: u8) -> Place {
    Place::Fixed(area, BitAddr::new(byte, bit))
}

pub fn m(byte: u32, bit: u8) -> Place {
    place(Area::Memory, byte, bit)
}

pub fn operand(width: Width, place: Place) -> Operand {
    Operand { width, place }
}

pub fn mb(byte: u32) -> Operand {
    operand(Width::Byte, m(byte, 0))
}

pub fn mw(byte: u32) -> Operand {
    operand(Width::Word, m(byte, 0))
}

pub fn md(byte: u32) -> Operand {
    operand(Width::DWord, m(byte, 0))
}

pub fn l(byte: u32, bit: u8) -> Place {
    place(Area::Local, byte, bit)
}

pub fn lw(byte: u32) -> Operand {
    operand(Width::Word, l(byte, 0))
}

pub fn dbw(byte: u32) -> Operand {
    operand(Width::Word, place(Area::Db, byte, 0))
}

pub fn in_db(db: u16, width: Width, byte: u32, bit: u8) -> Operand {
    operand(width, Place::InDb(db, BitAddr::new(byte, bit)))
}

pub fn param(index: u16, width: Width) -> Operand {
    operand(width, Place::Param { index, at: BitAddr(0) })
}

pub fn u(place: Place) -> Op {
    Op::Scan { logic: ob1_ir::Logic::And, negate: false, test: ob1_ir::BitTest::Bit(place) }
}

pub fn un(place: Place) -> Op {
    Op::Scan { logic: ob1_ir::Logic::And, negate: true, test: ob1_ir::BitTest::Bit(place) }
}

pub fn load(operand: Operand) -> Op {
    Op::Load(operand)
}

pub fn transfer(operand: Operand) -> Op {
    Op::Transfer(operand)
}

pub fn c(value: u32) -> Op {
    Op::LoadConst(value)
}

/// `CALL block (args)`.
pub fn call(target: BlockId, args: Vec<Arg>) -> Op {
    Op::Call(Box::new(Call { mode: CallMode::Call, target: Target::Block(target), instance: None, args }))
}

/// `CALL fb, DB n (args)`.
pub fn call_fb(target: BlockId, db: u16, args: Vec<Arg>) -> Op {
    let instance = Some(ob1_ir::Number::Fixed(db));
    Op::Call(Box::new(Call { mode: CallMode::Call, target: Target::Block(target), instance, args }))
}

/// `UC block`, `CC block`.
pub fn uc(mode: CallMode, target: BlockId) -> Op {
    Op::Call(Box::new(Call { mode, target: Target::Block(target), instance: None, args: Vec::new() }))
}

/// A block whose statement n is in line n + 1. Its local data is as long as its operands reach, as the compiler makes
/// it.
pub fn block(id: BlockId, mut interface: Interface, ops: Vec<Op>) -> CodeBlock {
    for op in &ops {
        op.places(&mut |place, width| {
            if let Place::Fixed(Area::Local, at) = place {
                interface.temp_bytes = interface.temp_bytes.max(at.byte() + width.bytes());
            }
        });
    }
    let code = (1..).zip(ops).map(|(line, op)| Stmt { op, network: 1, line }).collect();
    CodeBlock { id, name: None, interface, code, source: 0 }
}

/// An interface of parameters; those of an FB are laid out.
pub fn interface(kind: BlockKind, params: &[(&str, Section, DataType)], temp_bytes: u32) -> Interface {
    let mut layout = Layout::new();
    let mut list: Vec<Param> = Vec::new();
    for (name, section, ty) in params {
        if list.last().is_some_and(|p| p.section != *section) {
            layout.end_section();
        }
        let mut param = Param::new(name, *section, ty.clone());
        if kind.has_instance() {
            param.at = layout.place(ty);
        }
        list.push(param);
    }
    Interface { params: list, instance_bytes: layout.bytes(), temp_bytes }
}

pub fn db(number: u16, bytes: &[u8]) -> DataBlock {
    DataBlock {
        number,
        name: None,
        kind: DataKind::Global,
        bytes: bytes.to_vec(),
        components: Vec::new(),
        read_only: false,
        non_retain: false,
    }
}

pub fn instance_db(number: u16, of: BlockId, bytes: usize) -> DataBlock {
    DataBlock { kind: DataKind::Instance(of), ..db(number, &vec![0; bytes]) }
}

pub fn program(blocks: Vec<CodeBlock>, data: Vec<DataBlock>) -> Program {
    Program { blocks, data, sources: vec!["test".into()], ..Program::default() }
}

/// OB 1 alone.
pub fn ob1(ops: Vec<Op>) -> CodeBlock {
    block(ob(1), Interface { temp_bytes: 20, ..Interface::default() }, ops)
}

/// A CPU with its clock.
pub struct Bench {
    pub cpu: Cpu,
    pub clock: ManualClock,
}

impl Bench {
    pub fn new(program: &Program) -> Self {
        Self::with(
            Cpu::new(CpuConfig::default(), program, Vec::new(), Vec::new(), engine()).expect("the program loads"),
        )
    }

    /// Starts a CPU; the first cycle has not run.
    pub fn with(mut cpu: Cpu) -> Self {
        cpu.request(Command::Run);
        Self { cpu, clock: ManualClock { now: Instant::START, per_statement: Span::from_nanos(100) } }
    }

    pub fn cycle(&mut self) -> CycleEnd {
        self.cpu.cycle(&mut self.clock)
    }

    /// A cycle that must leave the CPU in RUN.
    pub fn run(&mut self) {
        let end = self.cycle();
        let why: Vec<_> = self.cpu.diagnostics().map(ToString::to_string).collect();
        assert_eq!(end.state, OperatingState::Run, "{why:#?}");
    }

    pub fn cell(&mut self, area: Area, byte: u32, width: Width) -> u32 {
        self.cpu.read(Cell::Area(area, byte * 8), width).expect("the cell exists")
    }

    pub fn mb(&mut self, byte: u32) -> u32 {
        self.cell(Area::Memory, byte, Width::Byte)
    }

    pub fn mw(&mut self, byte: u32) -> u32 {
        self.cell(Area::Memory, byte, Width::Word)
    }

    pub fn md(&mut self, byte: u32) -> u32 {
        self.cell(Area::Memory, byte, Width::DWord)
    }

    pub fn m(&mut self, byte: u32, bit: u8) -> bool {
        self.cpu.read(Cell::Area(Area::Memory, BitAddr::new(byte, bit).0), Width::Bit).expect("a bit") == 1
    }

    pub fn set(&mut self, byte: u32, width: Width, value: u32) {
        self.cpu.write(Cell::Area(Area::Memory, byte * 8), width, value).expect("the cell exists");
    }

    pub fn set_m(&mut self, byte: u32, bit: u8, value: bool) {
        let cell = Cell::Area(Area::Memory, BitAddr::new(byte, bit).0);
        self.cpu.write(cell, Width::Bit, u32::from(value)).expect("a bit");
    }

    pub fn dbw(&mut self, db: u16, byte: u32) -> u32 {
        self.cpu.read(Cell::Db(db, byte * 8), Width::Word).expect("the cell exists")
    }

    /// The figures of a loaded organization block, as of the last call of [`Cpu::cycle`].
    pub fn ob_figures(&self, ob: u16) -> ObFigures {
        self.cpu.accounts().figures().obs.into_iter().find(|figures| figures.ob == ob).expect("loaded")
    }

    /// Event numbers in the diagnostic buffer, newest first.
    pub fn events(&self) -> Vec<u16> {
        self.cpu.diagnostics().map(|e| e.event.0).collect()
    }
}
