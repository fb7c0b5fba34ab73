//! Intermediate code made from bytes: the verifier checks it, the text form prints it, and code that the verifier
//! accepts is run.

use ob1_ir::{
    AccuOp, AddressRegister, BitTest, CodeBlock, Compare, Convert, DataBlock, DataKind, DbRegister, Jump, Logic,
    Number, NumberFormat, Op, Operand, Place, Pointer, Program, Shift, Stmt, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, Interface, TimerKind};

/// One OB 1 with a statement for each few bytes, and a data block.
pub fn run(data: &[u8]) {
    let mut bytes = Bytes(data);
    let mut code = Vec::new();
    while !bytes.0.is_empty() && code.len() < 400 {
        code.push(Stmt { op: bytes.op(), network: 1, line: code.len() as u32 + 1 });
    }
    let interface = Interface { temp_bytes: 64, ..Interface::default() };
    let id = BlockId::new(BlockKind::Ob, 1);
    let db = DataBlock {
        number: 7,
        name: None,
        kind: DataKind::Global,
        bytes: vec![0x5A; 64],
        components: Vec::new(),
        read_only: false,
        non_retain: false,
    };
    let block = CodeBlock { id, name: None, interface, code, source: 0 };
    let handler = CodeBlock { id: BlockId::new(BlockKind::Ob, 121), code: Vec::new(), ..block.clone() };
    let program = Program {
        blocks: vec![block, handler],
        data: vec![db],
        sources: vec!["fuzz".to_owned()],
        ..Program::default()
    };
    assert!(ob1_stl::listing(&program).starts_with("source 1: "));
    assert_eq!(ob1_ir::parse(&ob1_ir::write(&program)).as_ref(), Ok(&program));
    let verified = ob1_ir::verify(&program, &|_| None);
    if verified.is_ok() {
        super::exec::both(&program);
    }
}

/// Bytes used as choices; 0 at the end.
struct Bytes<'d>(&'d [u8]);

impl Bytes<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    fn word(&mut self) -> u16 {
        u16::from_be_bytes([self.byte(), self.byte()])
    }

    fn double(&mut self) -> u32 {
        u32::from(self.word()) << 16 | u32::from(self.word())
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[usize::from(self.byte()) % choices.len()]
    }

    fn area(&mut self) -> Area {
        use Area::{Db, Di, Input, Local, Memory, Output, Peripheral, PreviousLocal};
        self.of(&[Memory, Memory, Db, Di, Local, Input, Output, Peripheral, PreviousLocal])
    }

    /// Mostly a low address, sometimes any.
    fn at(&mut self) -> BitAddr {
        match self.byte() {
            255 => BitAddr(self.double()),
            low => BitAddr::new(u32::from(low % 80), 0),
        }
    }

    fn bit_at(&mut self) -> BitAddr {
        BitAddr::new(self.at().byte(), self.byte() % 8)
    }

    fn pointer(&mut self) -> Pointer {
        Pointer { area: self.of(&[Area::Memory, Area::Db, Area::Di, Area::Local, Area::Input]), at: self.at() }
    }

    fn register(&mut self) -> AddressRegister {
        self.of(&[AddressRegister::Ar1, AddressRegister::Ar2])
    }

    fn place(&mut self, bit: bool) -> Place {
        let at = if bit { self.bit_at() } else { self.at() };
        match self.byte() % 12 {
            0 => Place::InDb(self.of(&[7, 7, 8]), at),
            1 => Place::InDi(self.of(&[7, 7, 8]), at),
            2 => Place::Memory(self.area(), self.pointer()),
            3 => Place::Register(None, self.register(), at),
            4 => Place::Register(Some(self.area()), self.register(), at),
            5 => Place::Param { index: u16::from(self.byte()), at },
            6 => Place::Instance(at),
            _ => Place::Fixed(self.area(), at),
        }
    }

    fn operand(&mut self) -> Operand {
        let width = self.of(&[Width::Byte, Width::Word, Width::DWord, Width::Bit]);
        Operand { width, place: self.place(width == Width::Bit) }
    }

    fn number(&mut self) -> Number {
        match self.byte() % 8 {
            0 => Number::Memory(self.pointer()),
            1 => Number::Param(u16::from(self.byte())),
            2 => Number::Instance(self.at()),
            3 => Number::Fixed(self.word()),
            _ => Number::Fixed(u16::from(self.byte() % 10)),
        }
    }

    fn scan(&mut self) -> Op {
        let (logic, negate) = (self.of(&Logic::ALL), self.byte() % 2 == 1);
        let test = match self.byte() % 6 {
            0 => BitTest::Timer(self.number()),
            1 => BitTest::Counter(self.number()),
            2 => BitTest::Status(self.of(&ob1_ir::StatusBit::ALL)),
            _ => BitTest::Bit(self.place(true)),
        };
        Op::Scan { logic, negate, test }
    }

    fn op(&mut self) -> Op {
        let format = |b: &mut Self| b.of(&NumberFormat::ALL);
        match self.byte() % 52 {
            0..=3 => self.scan(),
            4 => Op::Open { logic: self.of(&Logic::ALL), negate: self.byte() % 2 == 1 },
            5 => Op::Close,
            6 => Op::OrBranch,
            7 => Op::Assign(self.place(true)),
            8 => Op::Set(self.place(true)),
            9 => Op::Reset(self.place(true)),
            10 => Op::EdgePositive(self.place(true)),
            11 => Op::EdgeNegative(self.place(true)),
            12 => [Op::SetRlo, Op::ClearRlo, Op::NotRlo, Op::SaveRlo][usize::from(self.byte() % 4)].clone(),
            13..=15 => Op::Load(self.operand()),
            16 => Op::LoadConst(self.double()),
            17..=19 => Op::Transfer(self.operand()),
            20 => Op::LoadStatus,
            21 => Op::TransferStatus,
            22 => Op::LoadTimer(self.number()),
            23 => Op::LoadCounterBcd(self.number()),
            24 => Op::LoadDbLength(self.of(&[DbRegister::Db, DbRegister::Di])),
            25 => {
                let op = self.of(&AccuOp::ALL);
                Op::Arithmetic(format(self), op)
            }
            26 => Op::AddConst { format: format(self), value: self.double() as i32 },
            27 => Op::Compare(format(self), self.of(&[Compare::Equal, Compare::Less, Compare::GreaterEqual])),
            28 => Op::WordLogic(self.of(&[WordLogic::And, WordLogic::Xor]), None),
            29 => Op::DWordLogic(WordLogic::Or, Some(self.double())),
            30 => {
                let shift = self.of(&Shift::ALL);
                let by = self.byte();
                Op::Shift(shift, (by != 0).then_some(by))
            }
            31 => Op::RotateLeftCc1,
            32 => Op::Convert(self.of(&Convert::ALL)),
            33 => Op::Math(self.of(&[ob1_ir::MathFn::Sqrt, ob1_ir::MathFn::Ln, ob1_ir::MathFn::Exp])),
            34 => [Op::ExchangeAccus, Op::Push, Op::Pop, Op::Enter, Op::Leave][usize::from(self.byte() % 5)].clone(),
            35 => Op::Increment(self.byte()),
            36 => Op::LoadAr(self.register()),
            37 => Op::LoadArConst(self.register(), self.of(&[0x8300_0000, 0x8400_0010, 0x8700_0000, 0x8000_0000, 8])),
            38 => Op::LoadArFrom(self.register(), self.operand()),
            39 => Op::TransferArTo(self.register(), self.operand()),
            40 => Op::AddAr(self.register()),
            41 => Op::AddArConst(self.register(), self.bit_at()),
            42 => [Op::CopyAr1ToAr2, Op::CopyAr2ToAr1, Op::ExchangeArs, Op::ExchangeDbs][usize::from(self.byte() % 4)]
                .clone(),
            43 => Op::OpenDb(self.of(&[DbRegister::Db, DbRegister::Di]), self.number()),
            44 => {
                let kind =
                    self.of(&[TimerKind::Pulse, TimerKind::ExtendedPulse, TimerKind::OnDelay, TimerKind::OffDelay]);
                Op::StartTimer(kind, self.number())
            }
            45 => [Op::ResetTimer, Op::EnableTimer, Op::CountUp, Op::CountDown, Op::SetCounter, Op::ResetCounter]
                [usize::from(self.byte() % 6)](self.number()),
            46 | 47 => {
                let on = self.of(&Jump::ALL);
                Op::Jump(on, u32::from(self.byte()))
            }
            48 => Op::Loop(u32::from(self.byte())),
            49 => {
                let count = usize::from(self.byte() % 6);
                let targets = (0..count).map(|_| u32::from(self.byte())).collect();
                Op::JumpList { targets, otherwise: u32::from(self.byte()) }
            }
            50 => [Op::McrActivate, Op::McrDeactivate, Op::McrOpen, Op::McrClose][usize::from(self.byte() % 4)].clone(),
            _ => [Op::End, Op::EndIf, Op::Nop][usize::from(self.byte() % 3)].clone(),
        }
    }
}
