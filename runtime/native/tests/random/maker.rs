//! Statements of every kind, for one block.

use ob1_ir::{
    AccuOp, AddressRegister, Arg, BitTest, Call, CallMode, Compare, Convert, DbRegister, Jump, Logic, MathFn, Number,
    NumberFormat, Op, Operand, Place, Pointer, Shift, StatusBit, Target, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Section, TimerKind};

use super::{FB, FC, Random, SUB_INSTANCE, edges};

/// Makes statements of one block.
pub(super) struct Maker<'a> {
    pub(super) r: &'a mut Random,
    pub(super) kind: BlockKind,
    pub(super) params: &'a [(&'a str, Section, DataType)],
    pub(super) interface: Interface,
    /// Blocks it may call.
    pub(super) callable: &'a [(BlockKind, u16)],
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
                // At and beyond the end of bit memory.
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
            0 => {
                let area = self.r.of(&[Area::Memory, Area::Memory, Area::Local, Area::Db, Area::Di]);
                Number::Memory(Pointer { area, at: BitAddr::byte_addr(if area == Area::Memory { 48 } else { 24 }) })
            }
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
        if self.r.one_in(6) {
            return edges::pointer(self.r);
        }
        let area = self.r.of(&[0x80u32, 0x81, 0x82, 0x83, 0x83, 0x84, 0x84, 0x85, 0x86, 0x87, 0x00, 0x88]);
        let bit = if self.r.one_in(3) { self.r.next(8) } else { 0 };
        (area << 24) | (self.r.next(64) * 8 + bit)
    }

    fn statement(&mut self, index: u32, count: u32) -> Op {
        let r = &mut *self.r;
        let logic = r.of(&Logic::ALL);
        let negate = r.one_in(2);
        let format = r.of(&NumberFormat::ALL);
        let width = r.of(&[Width::Byte, Width::Word, Width::Word, Width::DWord]);
        let register = r.of(&[AddressRegister::Ar1, AddressRegister::Ar2]);
        let compare = r.of(&Compare::ALL);
        match r.next(80) {
            0..=9 => Op::Scan { logic, negate, test: BitTest::Bit(self.place(true, Width::Bit)) },
            10 => Op::Scan { logic, negate, test: BitTest::Timer(self.number(true)) },
            11 => Op::Scan { logic, negate, test: BitTest::Counter(self.number(false)) },
            12 => {
                let bit = r.of(&StatusBit::ALL);
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
                    NumberFormat::DInt => r.of(&AccuOp::ALL),
                    _ => r.of(&[AccuOp::Add, AccuOp::Sub, AccuOp::Mul, AccuOp::Div]),
                };
                Op::Arithmetic(format, op)
            }
            39 | 40 => Op::Compare(format, compare),
            41 => {
                Op::AddConst { format: r.of(&[NumberFormat::Int, NumberFormat::DInt]), value: r.next(999) as i32 - 500 }
            }
            42 | 43 => Op::Convert(r.of(&Convert::ALL)),
            44 => Op::Math(r.of(&[MathFn::Sqr, MathFn::Sqrt, MathFn::Ln, MathFn::Exp, MathFn::Sin, MathFn::Atan])),
            45 | 46 => {
                let kind = r.of(&Shift::ALL);
                let most = if r.one_in(3) { 40 } else { 17 };
                let count = r.next(most) as u8;
                Op::Shift(kind, (!r.one_in(6)).then_some(count))
            }
            47 => [Op::RotateLeftCc1, Op::RotateRightCc1][r.next(2) as usize].clone(),
            48 | 49 => {
                let op = r.of(&WordLogic::ALL);
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
            62 => {
                let which = r.of(&[DbRegister::Db, DbRegister::Di]);
                if r.one_in(2) { Op::LoadDbLength(which) } else { Op::LoadDbNumber(which) }
            }
            63 => {
                let kind = r.of(&TimerKind::ALL);
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
                let on = r.of(&Jump::ALL);
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

    /// Puts a pair of statements around others, within or around the pairs there are.
    fn pair(&mut self, code: &mut [Op], open: Op, close: Op) {
        let last = code.len() as u32 - 2;
        let first = 1 + self.r.next(last - 4) as usize;
        let reach = if self.r.one_in(3) { last - first as u32 } else { 6 };
        let last = (first + 1 + self.r.next(reach) as usize).min(last as usize);
        if plain(&code[first]) && plain(&code[last]) {
            code[first] = open;
            code[last] = close;
        }
    }

    /// Statements of a block. Brackets and the master control relay come in pairs.
    pub(super) fn code(&mut self, count: u32) -> Vec<Op> {
        let mut code: Vec<Op> = (0..count).map(|i| self.statement(i, count)).collect();
        for _ in 0..count / 12 {
            let first = self.r.next(count) as usize;
            let targets = [self.target(first as u32, count), self.target(first as u32, count)];
            let edge = edges::edge(self.r, targets);
            for (to, op) in code[first..].iter_mut().zip(edge) {
                *to = op;
            }
        }
        if count >= 12 {
            for _ in 0..1 + self.r.next(2) {
                let (logic, negate) = (self.r.of(&Logic::ALL), self.r.one_in(2));
                self.pair(&mut code, Op::Open { logic, negate }, Op::Close);
            }
            if self.r.one_in(6) {
                for _ in 0..1 + self.r.next(3) {
                    self.pair(&mut code, Op::McrOpen, Op::McrClose);
                }
                code[0] = Op::McrActivate;
                if self.r.one_in(4) {
                    let at = self.r.next(count) as usize;
                    if plain(&code[at]) {
                        code[at] = self.r.of(&[&Op::McrActivate, &Op::McrDeactivate]).clone();
                    }
                }
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

/// It is not one of a pair.
fn plain(op: &Op) -> bool {
    !matches!(op, Op::Open { .. } | Op::Close | Op::McrOpen | Op::McrClose)
}
