//! Random programs of every kind of statement, and two CPUs that must not differ by anything a user can see.

#![allow(dead_code, reason = "each test uses its own part")]

use ob1_cpu::engine::{Factory, REFERENCE};
use ob1_cpu::{
    Cell, CellWidth, Clock, Command, Cpu, CpuConfig, CyclicInterrupt, Family, Nanos, OperatingState, system_blocks,
};
use ob1_ir::{
    AccuOp, AddressRegister, Arg, BitTest, Call, CallMode, CodeBlock, Compare, Convert, DataBlock, DataKind,
    DbRegister, Jump, Logic, MathFn, Number, NumberFormat, Op, Operand, Place, Pointer, Program, Shift, StatusBit,
    Stmt, Target, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Layout, Param, Section, TimerKind};

const MS: Nanos = 1_000_000;

/// Time that statements take.
struct Charged(Nanos);

impl Clock for Charged {
    fn now(&mut self) -> Nanos {
        self.0
    }
    fn executed(&mut self, statements: u64) {
        self.0 += statements * 100;
    }
    fn statements_in(&self, time: Nanos) -> Option<u64> {
        Some(time.div_ceil(100))
    }
    fn wait(&mut self, deadline: Nanos) {
        self.0 = self.0.max(deadline);
    }
}

/// Random numbers (SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    fn next(&mut self, below: u32) -> u32 {
        (self.bits() >> 33) as u32 % below
    }

    fn one_in(&mut self, n: u32) -> bool {
        self.next(n) == 0
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.next(choices.len() as u32) as usize]
    }
}

/// Formals of the blocks that are called: name, section, type.
const FC: &[(&str, Section, DataType)] = &[
    ("b", Section::Input, DataType::Bool),
    ("i", Section::Input, DataType::Int),
    ("d", Section::Input, DataType::DInt),
    ("p", Section::Output, DataType::Bool),
    ("q", Section::Output, DataType::Int),
    ("x", Section::InOut, DataType::Word),
    ("t", Section::Input, DataType::Timer),
];
const FB: &[(&str, Section, DataType)] = &[
    ("b", Section::Input, DataType::Bool),
    ("i", Section::Input, DataType::Int),
    ("q", Section::Output, DataType::Int),
    ("x", Section::InOut, DataType::DWord),
    ("s", Section::Static, DataType::DInt),
    ("e", Section::Static, DataType::Bool),
];
/// FC 1, 2 and FB 1, 2 have parameters; FC 3 has none. Blocks call those before them only, so that calls end.
const BLOCKS: &[(BlockKind, u16)] =
    &[(BlockKind::Fc, 3), (BlockKind::Fc, 1), (BlockKind::Fb, 1), (BlockKind::Fc, 2), (BlockKind::Fb, 2)];
/// Where FB 2 has an instance of FB 1 within its own.
const SUB_INSTANCE: u32 = 16;
const TEMP: u32 = 44;

fn interface(kind: BlockKind, params: &[(&str, Section, DataType)]) -> Interface {
    let mut layout = Layout::new();
    let mut list: Vec<Param> = Vec::new();
    for (name, section, ty) in params {
        if list.last().is_some_and(|p| p.section != *section) {
            layout.end_section();
        }
        let mut param = Param::new(name, *section, ty.clone());
        if kind == BlockKind::Fb {
            param.at = layout.place(ty);
        }
        list.push(param);
    }
    let bytes = if kind == BlockKind::Fb { layout.bytes() } else { 0 };
    Interface { params: list, instance_bytes: bytes, temp_bytes: TEMP }
}

/// Makes statements of one block.
struct Maker<'a> {
    r: &'a mut Random,
    kind: BlockKind,
    params: &'a [(&'a str, Section, DataType)],
    interface: Interface,
    /// Blocks it may call.
    callable: &'a [(BlockKind, u16)],
}

impl Maker<'_> {
    fn param(&mut self, bit: bool) -> Option<Place> {
        let wanted = |ty: &DataType| match ty {
            DataType::Bool => bit,
            DataType::Timer => false,
            _ => !bit,
        };
        let places: Vec<Place> = self
            .interface
            .params
            .iter()
            .enumerate()
            .filter(|(_, p)| wanted(&p.ty))
            .map(|(i, p)| {
                if self.kind == BlockKind::Fb {
                    Place::Instance(p.at)
                } else {
                    Place::Param { index: i as u16, at: BitAddr(0) }
                }
            })
            .collect();
        (!places.is_empty()).then(|| places[self.r.next(places.len() as u32) as usize])
    }

    fn place(&mut self, bit: bool, width: Width) -> Place {
        let mut at = BitAddr::new(self.r.next(28), if bit { self.r.next(8) as u8 } else { 0 });
        match self.r.next(24) {
            0 => Place::Register(None, AddressRegister::Ar1, at),
            1 => Place::Register(None, AddressRegister::Ar2, at),
            2 => {
                let area = self.r.of(&[Area::Memory, Area::Db, Area::Di, Area::Local, Area::Output, Area::Peripheral]);
                let register = self.r.of(&[AddressRegister::Ar1, AddressRegister::Ar2]);
                Place::Register(Some(area), register, at)
            }
            3 => {
                let area = self.r.of(&[Area::Memory, Area::Db, Area::Output, Area::Local, Area::Input, Area::Di]);
                let pointer = self.r.of(&[(Area::Memory, 40), (Area::Memory, 44), (Area::Local, 24), (Area::Db, 4)]);
                Place::Memory(area, Pointer { area: pointer.0, at: BitAddr::byte_addr(pointer.1) })
            }
            4 => Place::InDb(self.r.of(&[7, 7, 8, 9, 50]), at),
            5 => Place::InDi(self.r.of(&[7, 8]), at),
            6 => Place::Fixed(self.r.of(&[Area::Di, Area::Di, Area::PreviousLocal, Area::Peripheral]), at),
            7..=9 => {
                let local = BitAddr(at.0 % 160 + 20 * 8);
                Place::Fixed(Area::Local, if bit { local } else { BitAddr(local.0 & !7) })
            }
            10..=13 => {
                self.param(bit).filter(|_| bit || width != Width::DWord).unwrap_or(Place::Fixed(Area::Memory, at))
            }
            14 | 15 => Place::Fixed(Area::Db, at),
            16 => {
                // At and behind the end of bit memory.
                at = BitAddr(at.0 + 236 * 8);
                Place::Fixed(Area::Memory, at)
            }
            17 | 18 => Place::Fixed(self.r.of(&[Area::Input, Area::Output]), at),
            _ => Place::Fixed(Area::Memory, at),
        }
    }

    fn operand(&mut self, width: Width) -> Operand {
        let place = self.place(false, width);
        // A variable is as wide as it is declared.
        let width = match place {
            Place::Param { index, .. } => match self.params[usize::from(index)].2 {
                DataType::DInt | DataType::DWord => Width::DWord,
                _ => Width::Word,
            },
            Place::Instance(at) => match self.interface.params.iter().find(|p| p.at == at).map(|p| &p.ty) {
                Some(DataType::DInt | DataType::DWord) => Width::DWord,
                _ => Width::Word,
            },
            _ => width,
        };
        Operand { width, place }
    }

    fn number(&mut self, timer: bool) -> Number {
        match self.r.next(12) {
            0 => Number::Memory(Pointer { area: Area::Memory, at: BitAddr::byte_addr(48) }),
            1 if timer && self.kind == BlockKind::Fc && !self.params.is_empty() => Number::Param(6),
            2 => Number::Fixed(self.r.of(&[255, 256, 2047])),
            _ => Number::Fixed(self.r.next(4) as u16),
        }
    }

    fn argument(&mut self, ty: &DataType, output: bool) -> Arg {
        let width = match ty {
            DataType::Bool => Width::Bit,
            DataType::Timer => return Arg::Number(Number::Fixed(self.r.next(4) as u16)),
            DataType::DInt | DataType::DWord => Width::DWord,
            _ => Width::Word,
        };
        if !output && self.r.one_in(4) {
            return Arg::Const(self.r.next(if width == Width::Bit { 2 } else { 0x10000 }));
        }
        for _ in 0..20 {
            let place = match self.r.next(4) {
                0 => Place::Fixed(
                    Area::Memory,
                    BitAddr(self.r.next(200) * if width == Width::Bit { 1 } else { 8 } % 800),
                ),
                1 => Place::Fixed(Area::Local, BitAddr::byte_addr(20 + self.r.next(10) * 2)),
                _ => self.place(width == Width::Bit, width),
            };
            let fits = match place {
                Place::Param { index, .. } => {
                    let bits = match self.params[usize::from(index)].2 {
                        DataType::Bool => Width::Bit,
                        DataType::DInt | DataType::DWord => Width::DWord,
                        _ => Width::Word,
                    };
                    bits == width
                }
                Place::Instance(_) => width == Width::Word || width == Width::Bit,
                _ => true,
            };
            if fits {
                return Arg::Operand(Operand { width, place });
            }
        }
        Arg::Operand(Operand { width, place: Place::Fixed(Area::Memory, BitAddr(0)) })
    }

    fn call(&mut self) -> Op {
        let r = self.r.next(10);
        if self.callable.is_empty() || r == 0 {
            let kind = self.r.of(&[BlockKind::Fc, BlockKind::Fb]);
            let number = Number::Memory(Pointer { area: Area::Memory, at: BitAddr::byte_addr(50) });
            let mode = self.r.of(&[CallMode::Unconditional, CallMode::Conditional]);
            return Op::Call(Box::new(Call {
                mode,
                target: Target::Indirect(kind, number),
                instance: None,
                args: vec![],
            }));
        }
        let (kind, number) = self.r.of(self.callable);
        let id = BlockId::new(kind, number);
        if r == 1 {
            let mode = self.r.of(&[CallMode::Unconditional, CallMode::Conditional]);
            let args = if kind == BlockKind::Fc && self.r.one_in(2) {
                (0..self.r.next(8)).map(|_| Arg::Raw(self.pointer())).collect()
            } else {
                vec![]
            };
            return Op::Call(Box::new(Call { mode, target: Target::Block(id), instance: None, args }));
        }
        let params = match (kind, number) {
            (BlockKind::Fb, _) => FB,
            (_, 3) => &[],
            _ => FC,
        };
        let mut args = Vec::new();
        for (_, section, ty) in params.iter().filter(|(_, section, _)| *section != Section::Static) {
            args.push(if kind == BlockKind::Fb && self.r.one_in(5) {
                Arg::Open
            } else {
                self.argument(ty, *section != Section::Input)
            });
        }
        let (target, instance) = match kind {
            BlockKind::Fb if self.kind == BlockKind::Fb && number == 1 && self.r.one_in(2) => {
                (Target::Local(id, BitAddr::byte_addr(SUB_INSTANCE)), None)
            }
            BlockKind::Fb => (Target::Block(id), Some(Number::Fixed(self.r.of(&[20 + number, 20 + number, 22, 23])))),
            _ => (Target::Block(id), None),
        };
        Op::Call(Box::new(Call { mode: CallMode::Call, target, instance, args }))
    }

    fn pointer(&mut self) -> u32 {
        let area = self.r.of(&[0x80u32, 0x81, 0x82, 0x83, 0x83, 0x84, 0x84, 0x85, 0x86, 0x87, 0x00, 0x88]);
        let bit = if self.r.one_in(3) { self.r.next(8) } else { 0 };
        (area << 24) | (self.r.next(64) * 8 + bit)
    }

    fn statement(&mut self, index: u32, count: u32) -> Op {
        let r = &mut *self.r;
        let logic = r.of(&[Logic::And, Logic::Or, Logic::Xor]);
        let negate = r.one_in(2);
        let format = r.of(&[NumberFormat::Int, NumberFormat::DInt, NumberFormat::Real]);
        let width = r.of(&[Width::Byte, Width::Word, Width::Word, Width::DWord]);
        let register = r.of(&[AddressRegister::Ar1, AddressRegister::Ar2]);
        let compare = r.of(&[
            Compare::Equal,
            Compare::NotEqual,
            Compare::Greater,
            Compare::Less,
            Compare::GreaterEqual,
            Compare::LessEqual,
        ]);
        match r.next(80) {
            0..=9 => Op::Scan { logic, negate, test: BitTest::Bit(self.place(true, Width::Bit)) },
            10 => Op::Scan { logic, negate, test: BitTest::Timer(self.number(true)) },
            11 => Op::Scan { logic, negate, test: BitTest::Counter(self.number(false)) },
            12 => {
                let bit = r.of(&[
                    StatusBit::Zero,
                    StatusBit::Positive,
                    StatusBit::Negative,
                    StatusBit::NotZero,
                    StatusBit::NotNegative,
                    StatusBit::NotPositive,
                    StatusBit::Unordered,
                    StatusBit::Overflow,
                    StatusBit::StoredOverflow,
                    StatusBit::BinaryResult,
                ]);
                Op::Scan { logic, negate, test: BitTest::Status(bit) }
            }
            13 => Op::OrBranch,
            14..=16 => Op::Assign(self.place(true, Width::Bit)),
            17 => Op::Set(self.place(true, Width::Bit)),
            18 => Op::Reset(self.place(true, Width::Bit)),
            19 => Op::EdgePositive(self.place(true, Width::Bit)),
            20 => Op::EdgeNegative(self.place(true, Width::Bit)),
            21 => [Op::SetRlo, Op::ClearRlo, Op::NotRlo, Op::SaveRlo][r.next(4) as usize].clone(),
            22..=27 => Op::Load(self.operand(width)),
            28..=32 => Op::Transfer(self.operand(width)),
            33 => Op::LoadConst(r.next(u32::MAX)),
            34 => Op::LoadConst(r.of(&[
                0,
                1,
                7,
                0xFFFF,
                0x7FFF,
                0x8000,
                0x8000_0000,
                0x3F80_0000,
                0x7FC0_0000,
                0x0080_0000,
            ])),
            35..=38 => {
                let op = match format {
                    NumberFormat::DInt => r.of(&[AccuOp::Add, AccuOp::Sub, AccuOp::Mul, AccuOp::Div, AccuOp::Mod]),
                    _ => r.of(&[AccuOp::Add, AccuOp::Sub, AccuOp::Mul, AccuOp::Div]),
                };
                Op::Arithmetic(format, op)
            }
            39 | 40 => Op::Compare(format, compare),
            41 => {
                Op::AddConst { format: r.of(&[NumberFormat::Int, NumberFormat::DInt]), value: r.next(999) as i32 - 500 }
            }
            42 | 43 => Op::Convert(r.of(&[
                Convert::Bti,
                Convert::Itb,
                Convert::Btd,
                Convert::Dtb,
                Convert::Itd,
                Convert::Dtr,
                Convert::Rnd,
                Convert::RndPlus,
                Convert::RndMinus,
                Convert::Trunc,
                Convert::Invi,
                Convert::Invd,
                Convert::Negi,
                Convert::Negd,
                Convert::Negr,
                Convert::Abs,
                Convert::Taw,
                Convert::Tad,
            ])),
            44 => Op::Math(r.of(&[MathFn::Sqr, MathFn::Sqrt, MathFn::Ln, MathFn::Exp, MathFn::Sin, MathFn::Atan])),
            45 | 46 => {
                let kind = r.of(&[
                    Shift::LeftWord,
                    Shift::RightWord,
                    Shift::RightInt,
                    Shift::LeftDWord,
                    Shift::RightDWord,
                    Shift::RightDInt,
                    Shift::RotateLeft,
                    Shift::RotateRight,
                ]);
                let most = if r.one_in(3) { 40 } else { 17 };
                let count = r.next(most) as u8;
                Op::Shift(kind, (!r.one_in(6)).then_some(count))
            }
            47 => [Op::RotateLeftCc1, Op::RotateRightCc1][r.next(2) as usize].clone(),
            48 | 49 => {
                let op = r.of(&[WordLogic::And, WordLogic::Or, WordLogic::Xor]);
                let with = r.one_in(2).then(|| r.next(u32::MAX));
                if r.one_in(2) { Op::WordLogic(op, with.map(|v| v as u16)) } else { Op::DWordLogic(op, with) }
            }
            50 => [Op::ExchangeAccus, Op::Push, Op::Pop, Op::Enter, Op::Leave][r.next(5) as usize].clone(),
            51 => [Op::LoadStatus, Op::TransferStatus][r.next(2) as usize].clone(),
            52 => [Op::Increment(r.next(256) as u8), Op::Decrement(r.next(256) as u8)][r.next(2) as usize].clone(),
            53 | 54 => Op::LoadArConst(register, self.pointer()),
            55 => match r.next(6) {
                0 => Op::LoadAr(register),
                1 => Op::CopyAr1ToAr2,
                2 => Op::CopyAr2ToAr1,
                3 => Op::ExchangeArs,
                4 => Op::TransferAr(register),
                _ => Op::AddAr(register),
            },
            56 => Op::AddArConst(register, BitAddr(r.next(64) * 8 + r.next(2) * r.next(8))),
            57 => {
                let operand = self.operand(Width::DWord);
                if operand.width == Width::DWord { Op::LoadArFrom(register, operand) } else { Op::Nop }
            }
            58 => {
                let operand = self.operand(Width::DWord);
                if operand.width == Width::DWord { Op::TransferArTo(register, operand) } else { Op::Nop }
            }
            59 | 60 => {
                let which = r.of(&[DbRegister::Db, DbRegister::Db, DbRegister::Di]);
                let number = match r.next(6) {
                    0 => Number::Memory(Pointer { area: Area::Memory, at: BitAddr::byte_addr(52) }),
                    1 => Number::Fixed(r.of(&[0, 50])),
                    _ => Number::Fixed(r.of(&[7, 8, 9, 21, 22])),
                };
                Op::OpenDb(which, number)
            }
            61 => Op::ExchangeDbs,
            62 => [Op::LoadDbLength(DbRegister::Db), Op::LoadDbNumber(DbRegister::Di)][r.next(2) as usize].clone(),
            63 => {
                let kind = r.of(&[
                    TimerKind::Pulse,
                    TimerKind::ExtendedPulse,
                    TimerKind::OnDelay,
                    TimerKind::RetentiveOnDelay,
                    TimerKind::OffDelay,
                ]);
                Op::StartTimer(kind, self.number(true))
            }
            64 => {
                let n = self.number(true);
                [Op::ResetTimer(n), Op::EnableTimer(n), Op::LoadTimer(n), Op::LoadTimerBcd(n)][self.r.next(4) as usize]
                    .clone()
            }
            65 => {
                let n = self.number(false);
                [Op::CountUp(n), Op::CountDown(n), Op::SetCounter(n), Op::ResetCounter(n), Op::EnableCounter(n)]
                    [self.r.next(5) as usize]
                    .clone()
            }
            66 => {
                let n = self.number(false);
                [Op::LoadCounter(n), Op::LoadCounterBcd(n)][self.r.next(2) as usize].clone()
            }
            67..=70 => {
                let on = r.of(&[
                    Jump::Always,
                    Jump::IfRlo,
                    Jump::IfNotRlo,
                    Jump::IfRloSaveBr,
                    Jump::IfNotRloSaveBr,
                    Jump::IfBr,
                    Jump::IfNotBr,
                    Jump::IfOverflow,
                    Jump::IfStoredOverflow,
                    Jump::IfZero,
                    Jump::IfNotZero,
                    Jump::IfPositive,
                    Jump::IfNegative,
                    Jump::IfNotNegative,
                    Jump::IfNotPositive,
                    Jump::IfUnordered,
                ]);
                Op::Jump(on, self.target(index, count))
            }
            71 => Op::Loop(self.target(index, count)),
            72 => {
                let targets = (0..1 + self.r.next(4)).map(|_| self.target(index, count)).collect();
                Op::JumpList { targets, otherwise: self.target(index, count) }
            }
            73 if r.one_in(3) => [Op::End, Op::EndIf, Op::EndIf][r.next(3) as usize].clone(),
            74..=77 => self.call(),
            _ => Op::Nop,
        }
    }

    /// Mostly forward; loops end by the cycle monitoring at the latest.
    fn target(&mut self, index: u32, count: u32) -> u32 {
        if self.r.one_in(6) { self.r.next(index + 1) } else { (index + 1 + self.r.next(5)).min(count) }
    }

    /// Statements of a block. Brackets and the master control relay come in pairs.
    fn code(&mut self, count: u32) -> Vec<Op> {
        let mut code: Vec<Op> = (0..count).map(|i| self.statement(i, count)).collect();
        let mcr = self.r.one_in(8);
        for (open, close, brackets) in [(true, false, true), (false, true, true), (true, true, mcr)] {
            let _ = (open, close);
            if !brackets || count < 12 {
                continue;
            }
            let first = self.r.next(count - 8) as usize;
            let last = first + 2 + self.r.next(5) as usize;
            let logic = self.r.of(&[Logic::And, Logic::Or, Logic::Xor]);
            let negate = self.r.one_in(2);
            let plain = |op: &Op| !matches!(op, Op::Open { .. } | Op::Close | Op::McrOpen | Op::McrClose);
            if !code[first..=last].iter().all(plain) {
                continue;
            }
            if open && close {
                code[first] = Op::McrOpen;
                code[last] = Op::McrClose;
                code[first.saturating_sub(1)] = Op::McrActivate;
            } else {
                code[first] = Op::Open { logic, negate };
                code[last] = Op::Close;
            }
        }
        // What the registers hold at the end.
        let md = |byte| Operand { width: Width::DWord, place: Place::Fixed(Area::Memory, BitAddr::byte_addr(byte)) };
        let at = 128 + self.r.next(8) * 12;
        let word = Operand { width: Width::Word, ..md(at + 8) };
        code.extend([
            Op::Transfer(md(at)),
            Op::ExchangeAccus,
            Op::Transfer(md(at + 4)),
            Op::LoadStatus,
            Op::Transfer(word),
        ]);
        code
    }
}

fn block(id: BlockId, interface: Interface, ops: Vec<Op>) -> CodeBlock {
    let code = (1..).zip(ops).map(|(line, op)| Stmt { op, network: 1, line }).collect();
    CodeBlock { id, name: None, interface, code, source: 0 }
}

/// A program and the settings it runs with.
pub(crate) fn program(r: &mut Random) -> (Program, CpuConfig) {
    let mut blocks = Vec::new();
    for (i, (kind, number)) in BLOCKS.iter().enumerate() {
        let params: &[_] = match (kind, number) {
            (BlockKind::Fb, _) => FB,
            (_, 3) => &[],
            _ => FC,
        };
        let mut interface = interface(*kind, params);
        if (*kind, *number) == (BlockKind::Fb, 2) {
            interface.instance_bytes = 40;
        }
        let small = r.one_in(2);
        let count = if small { 2 + r.next(8) } else { 8 + r.next(40) };
        let mut maker = Maker { kind: *kind, params, interface: interface.clone(), callable: &BLOCKS[..i], r };
        let code = maker.code(count);
        blocks.push(block(BlockId::new(*kind, *number), interface, code));
    }
    for number in [1, 35, 80, 121, 122] {
        if number == 80 && r.one_in(2) || number == 122 && r.one_in(3) || number == 121 && r.one_in(10) {
            continue;
        }
        let plain = Interface { temp_bytes: TEMP, ..Interface::default() };
        let callable = if number == 121 { &BLOCKS[..1] } else { BLOCKS };
        let count = if number == 1 { 30 + r.next(90) } else { 4 + r.next(12) };
        let mut maker = Maker { kind: BlockKind::Ob, params: &[], interface: plain.clone(), callable, r };
        let code = match number {
            // An error in the block for errors is STOP: most have none.
            121 | 122 if !maker.r.one_in(6) => {
                let mb = |byte, width| Operand { width, place: Place::Fixed(Area::Memory, BitAddr::byte_addr(byte)) };
                let local = Operand { width: Width::DWord, place: Place::Fixed(Area::Local, BitAddr::byte_addr(8)) };
                vec![
                    Op::Transfer(mb(112, Width::DWord)),
                    Op::ExchangeAccus,
                    Op::Transfer(mb(116, Width::DWord)),
                    Op::TransferArTo(AddressRegister::Ar1, mb(120, Width::DWord)),
                    Op::Load(local),
                    Op::Transfer(mb(124, Width::DWord)),
                    Op::Load(mb(110, Width::Byte)),
                    Op::Increment(1),
                    Op::Transfer(mb(110, Width::Byte)),
                ]
            }
            _ => maker.code(count),
        };
        blocks.push(block(BlockId::new(BlockKind::Ob, number), plain, code));
    }
    let db = |number, bytes: Vec<u8>, kind, read_only| DataBlock {
        number,
        name: None,
        kind,
        bytes,
        components: Vec::new(),
        read_only,
    };
    let mut bytes = |n: usize| (0..n).map(|_| r.next(256) as u8).collect::<Vec<u8>>();
    let fb = |n| DataKind::Instance(BlockId::new(BlockKind::Fb, n));
    let data = vec![
        db(7, bytes(64), DataKind::Global, false),
        db(8, bytes(32), DataKind::Global, true),
        db(9, bytes(6), DataKind::Global, false),
        db(21, bytes(16), fb(1), false),
        db(22, bytes(40), fb(2), false),
        db(23, bytes(40), fb(2), true),
    ];
    let family = r.of(&[Family::S7_300, Family::S7_300, Family::S7_400]);
    let config = CpuConfig {
        accumulators: r.of(&[2, 2, 4]),
        family,
        watchdog: 2 * MS,
        nesting_depth: r.of(&[2, 3, 8, 24]),
        local_bytes: r.of(&[1024, 1024, 32 * 1024]),
        cyclic: vec![CyclicInterrupt::new(35, r.of(&[MS, 3 * MS, 100 * MS]))],
        peripheral_from_image: r.one_in(2),
        ..CpuConfig::default()
    };
    (Program { blocks, data, sources: vec!["random".into()], ..Program::default() }, config)
}

/// What a user can see of a CPU.
fn seen(cpu: &mut Cpu, program: &Program, now: Nanos) -> Vec<String> {
    let mut list = vec![
        format!("{:?} at {now}", cpu.state()),
        format!("{} statements", cpu.statistics().statements),
        format!("{:02X?}", cpu.bit_memory()),
    ];
    list.extend(program.data.iter().map(|db| format!("DB {}: {:02X?}", db.number, cpu.data_block(db.number))));
    for n in 0..4 {
        list.push(format!("T {n}: {:?}", cpu.read(Cell::Timer(n), CellWidth::Word)));
        list.push(format!("Z {n}: {:?}", cpu.read(Cell::Counter(n), CellWidth::Word)));
    }
    for area in [Area::Input, Area::Output] {
        let words = (0..16).map(|i| cpu.read(Cell::Area(area, i * 32), CellWidth::DWord)).collect::<Vec<_>>();
        list.push(format!("{area:?}: {words:X?}"));
    }
    list.extend(cpu.diagnostics().map(|entry| format!("{entry:?}")));
    list.extend(cpu.ob_statistics().map(|ob| format!("{ob:?}")));
    list
}

/// Runs the program of a seed on the reference engine and on another: `Ok(false)` when it does not load.
///
/// # Errors
/// The first difference, with the program.
pub(crate) fn compare(seed: u64, scans: u32, other: &dyn Factory) -> Result<bool, String> {
    let mut random = Random(seed);
    let (program, config) = program(&mut random);
    let load = |factory| Cpu::new(config.clone(), &program, system_blocks(), Vec::new(), factory);
    let Ok(mut one) = load(REFERENCE) else { return Ok(false) };
    let mut two = load(other).map_err(|why| format!("seed {seed}: does not load: {why:?}"))?;
    let mut clocks = [Charged(0), Charged(0)];
    one.request(Command::Run);
    two.request(Command::Run);
    for scan in 0..scans {
        let (end, other_end) = (one.cycle(&mut clocks[0]), two.cycle(&mut clocks[1]));
        let (left, right) = (seen(&mut one, &program, clocks[0].0), seen(&mut two, &program, clocks[1].0));
        if left != right || end.next_deadline != other_end.next_deadline {
            let short = |line: &String| line.chars().take(400).collect::<String>();
            let differ = left.iter().zip(&right).filter(|(a, b)| a != b);
            let mut lines: Vec<_> = differ.map(|(a, b)| (short(a), short(b))).collect();
            // The oldest entries of the diagnostic buffer tell where it began.
            let last = lines.split_off(lines.len().saturating_sub(3));
            lines.truncate(4);
            lines.extend(last);
            let blocks: Vec<_> = program.blocks.iter().map(|b| format!("{}\n{}", b.id, listing(b))).collect();
            return Err(format!(
                "seed {seed}, scan {scan}: reference, then the other:\n{lines:#?}\n{config:?}\n{}",
                blocks.join("\n")
            ));
        }
        if end.state != OperatingState::Run {
            break;
        }
        for clock in &mut clocks {
            clock.0 += 7 * MS;
        }
    }
    Ok(true)
}

fn listing(block: &CodeBlock) -> String {
    let line = |(i, stmt): (usize, &Stmt)| format!("{i:4}  {:?}", stmt.op);
    block.code.iter().enumerate().map(line).collect::<Vec<_>>().join("\n")
}
