//! Random blocks in the form the decoder gives: every operation the machine has, every form of its operands, calls of
//! every kind with actual parameters of every kind.

#![allow(dead_code, reason = "each test file uses its part")]

mod calls;
mod operands;

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{
    AccuOp, AddressRegister, CodeBlock, Compare, Convert, DbRegister, Jump, Logic, MathFn, Number, NumberFormat, Op,
    Operand, Place, Shift, StatusBit, Stmt, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Dimension, Field, Interface, Param, Section, TimerKind};

/// Bytes as choices; 0 when there are no more.
pub(crate) struct Bytes<'d>(pub(crate) &'d [u8]);

impl Bytes<'_> {
    pub(crate) fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    pub(crate) fn word(&mut self) -> u16 {
        u16::from_be_bytes([self.byte(), self.byte()])
    }

    pub(crate) fn double(&mut self) -> u32 {
        u32::from(self.word()) << 16 | u32::from(self.word())
    }

    pub(crate) fn flag(&mut self) -> bool {
        self.byte() % 2 == 1
    }

    pub(crate) fn below(&mut self, end: usize) -> usize {
        usize::from(self.word()) % end.max(1)
    }

    pub(crate) fn of<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())].clone()
    }
}

use DataType::{
    Any, Array, BlockDb, BlockFc, Bool, Byte, Char, Counter, DInt, DWord, Date, DateAndTime, Int, Pointer, Real,
    S5Time, Struct, Time, TimeOfDay, Timer, Word,
};

/// A structure with components of every width, and an array of structures.
fn structure() -> DataType {
    let field = |name: &str, ty| Field { name: name.into(), ty, initial: None };
    let inner = Struct(vec![field("on", Bool), field("value", Int)]);
    let dims = vec![Dimension { low: 1, high: 2 }, Dimension { low: -1, high: 1 }];
    Struct(vec![
        field("x", Bool),
        field("b", Byte),
        field("w", Word),
        field("d", Real),
        field("grid", Array(dims, Box::new(inner))),
    ])
}

fn interface(has_instance: bool, params: &[(&str, Section, DataType)]) -> Interface {
    let params = params.iter().map(|(name, section, ty)| Param::new(name, *section, ty.clone())).collect();
    let mut interface = Interface { params, ..Interface::default() };
    interface.lay_out(has_instance);
    interface
}

const fn id(kind: BlockKind, number: u16) -> BlockId {
    BlockId::new(kind, number)
}

pub(crate) const FC: BlockId = id(BlockKind::Fc, 300);
pub(crate) const FC_NONE: BlockId = id(BlockKind::Fc, 2);
pub(crate) const SFC: BlockId = id(BlockKind::Sfc, 20);
pub(crate) const FB: BlockId = id(BlockKind::Fb, 7);
pub(crate) const SFB: BlockId = id(BlockKind::Sfb, 4);

/// The blocks that are called.
pub(crate) fn callees() -> BTreeMap<BlockId, Interface> {
    use Section::{InOut, Input, Output, Return, Static};
    let all = [
        ("i_x", Input, Bool),
        ("i_b", Input, Byte),
        ("i_c", Input, Char),
        ("i_w", Input, Word),
        ("i_i", Input, Int),
        ("i_d", Input, DWord),
        ("i_l", Input, DInt),
        ("i_r", Input, Real),
        ("i_s5", Input, S5Time),
        ("i_t", Input, Time),
        ("i_date", Input, Date),
        ("i_tod", Input, TimeOfDay),
        ("o_x", Output, Bool),
        ("o_w", Output, Word),
        ("o_r", Output, Real),
        ("io_x", InOut, Bool),
        ("io_b", InOut, Byte),
        ("io_d", InOut, DInt),
    ];
    let by_reference = [
        ("t", Input, Timer),
        ("z", Input, Counter),
        ("db", Input, BlockDb),
        ("any", Input, Any),
        ("ptr", Input, Pointer),
        ("s", Input, structure()),
        ("dt", Output, DateAndTime),
        ("io_s", InOut, structure()),
        ("RET_VAL", Return, Int),
    ];
    let blkmov = [("SRCBLK", Input, Any), ("RET_VAL", Return, Int), ("DSTBLK", Output, Any)];
    let held = [("t", Input, Timer), ("any", Input, Any), ("io_s", InOut, structure()), ("kept", Static, Int)];
    let mut fb: Vec<_> = all.iter().chain(&held).cloned().collect();
    fb.sort_by_key(|(_, section, _)| [Input, Output, InOut, Static].iter().position(|s| s == section));
    let mut fc: Vec<_> = all.iter().chain(&by_reference).cloned().collect();
    fc.sort_by_key(|(_, section, _)| [Input, Output, InOut, Return].iter().position(|s| s == section));
    let timer = [("IN", Input, Bool), ("PT", Input, Time), ("Q", Output, Bool), ("ET", Output, Time)];
    [
        (FC, interface(false, &fc)),
        (FC_NONE, interface(false, &[])),
        (SFC, interface(false, &blkmov)),
        (FB, interface(true, &fb)),
        (SFB, interface(true, &timer)),
    ]
    .into()
}

/// A block on its way.
pub(crate) struct Made<'m> {
    pub(crate) bytes: Bytes<'m>,
    pub(crate) id: BlockId,
    pub(crate) interface: Interface,
    pub(crate) callees: BTreeMap<BlockId, Interface>,
    code: Vec<Stmt>,
    network: u16,
    /// Statements that no jump may lead to.
    closed: BTreeSet<usize>,
}

/// Which declarations of a block are instances; the declarations alone do not say it.
pub(crate) type Instances = BTreeMap<usize, BlockId>;

/// A block of the choices: an OB, an FC or an FB, and which of its variables are instances.
pub(crate) fn block(choices: &[u8]) -> (CodeBlock, Instances, BTreeMap<BlockId, Interface>) {
    use Section::{InOut, Input, Output, Return, Static, Temp};
    let callees = callees();
    let mut bytes = Bytes(choices);
    let temps = [("n", Temp, Int), ("s", Temp, structure()), ("any", Temp, Any), ("x", Temp, Bool)];
    let inputs = [
        ("in_x", Input, Bool),
        ("in_b", Input, Byte),
        ("in_w", Input, Int),
        ("in_d", Input, Real),
        ("in_t", Input, Timer),
        ("in_z", Input, Counter),
        ("in_db", Input, BlockDb),
        ("out_w", Output, Word),
    ];
    let composed = [("io_s", InOut, structure()), ("io_d", InOut, DWord)];
    let references =
        [("in_fc", Input, BlockFc), ("in_any", Input, Any), ("in_ptr", Input, Pointer), ("in_s", Input, structure())];
    let mut params: Vec<(&str, Section, DataType)> = Vec::new();
    let id = match bytes.byte() % 3 {
        0 => id(BlockKind::Ob, 1),
        1 => {
            params.extend(references.into_iter().chain(inputs).chain(composed));
            params.push(("RET_VAL", Return, Int));
            id(BlockKind::Fc, 50)
        }
        _ => {
            params.extend(inputs.into_iter().chain(composed));
            params.push(("pump", Static, callees[&FB].instance_type()));
            params.push(("delay", Static, callees[&SFB].instance_type()));
            params.push(("kept", Static, structure()));
            id(BlockKind::Fb, 50)
        }
    };
    params.extend(temps);
    let interface = interface(id.kind.has_instance(), &params);
    let index = |name: &str| interface.params.iter().position(|p| p.name == name);
    let instances =
        [("pump", FB), ("delay", SFB)].into_iter().filter_map(|(name, id)| Some((index(name)?, id))).collect();
    let mut made = Made { bytes, id, interface, callees, code: Vec::new(), network: 1, closed: BTreeSet::new() };
    while !made.bytes.0.is_empty() && made.code.len() < 200 {
        made.statement();
    }
    made.finish(instances)
}

impl Made<'_> {
    pub(crate) fn push(&mut self, op: Op) {
        let stmt = Stmt { op, network: self.network, line: 0 };
        self.code.push(stmt);
    }

    fn format(&mut self) -> NumberFormat {
        self.bytes.of(&NumberFormat::ALL)
    }

    fn register(&mut self) -> AddressRegister {
        self.bytes.of(&[AddressRegister::Ar1, AddressRegister::Ar2])
    }

    fn logic(&mut self) -> (Logic, bool) {
        (self.bytes.of(&Logic::ALL), self.bytes.flag())
    }

    fn statement(&mut self) {
        if self.bytes.byte().is_multiple_of(16) {
            self.network += u16::from(self.bytes.byte() % 3);
        }
        let op = match self.bytes.byte() % 40 {
            0..=3 => self.scan(),
            4 => {
                let (logic, negate) = self.logic();
                let inner = self.scan();
                self.push(Op::Open { logic, negate });
                self.push(inner);
                Op::Close
            }
            5 => Op::OrBranch,
            6 => Op::Assign(self.place(Width::Bit)),
            7 => Op::Set(self.place(Width::Bit)),
            8 => Op::Reset(self.place(Width::Bit)),
            9 => Op::EdgePositive(self.place(Width::Bit)),
            10 => Op::EdgeNegative(self.place(Width::Bit)),
            11 => {
                self.bytes.of(&[Op::SetRlo, Op::ClearRlo, Op::NotRlo, Op::SaveRlo, Op::LoadStatus, Op::TransferStatus])
            }
            12..=14 => Op::Load(self.operand()),
            15 => Op::LoadConst(self.value()),
            16 | 17 => Op::Transfer(self.operand()),
            18 => self.timed(),
            19 => {
                let register = self.bytes.of(&[DbRegister::Db, DbRegister::Di]);
                if self.bytes.flag() { Op::LoadDbLength(register) } else { Op::LoadDbNumber(register) }
            }
            20 => self.arithmetic(),
            21 => Op::Compare(self.format(), self.bytes.of(&Compare::ALL)),
            22 => self.shift(),
            23 => Op::Convert(self.bytes.of(&Convert::ALL)),
            24 => self.bytes.of(&PLAIN),
            25 => {
                if self.bytes.flag() {
                    Op::Increment(self.bytes.byte())
                } else {
                    Op::Decrement(self.bytes.byte())
                }
            }
            26..=28 => self.registers(),
            29 => {
                let number = self.number(&BlockDb);
                Op::OpenDb(self.bytes.of(&[DbRegister::Db, DbRegister::Di]), number)
            }
            30 | 31 => {
                let to = u32::from(self.bytes.word());
                if self.bytes.byte().is_multiple_of(8) { Op::Loop(to) } else { Op::Jump(self.bytes.of(&Jump::ALL), to) }
            }
            32 => return self.jump_list(),
            33 => {
                self.push(Op::McrOpen);
                Op::McrClose
            }
            34 => return self.parameter(),
            35 => self.bytes.of(&[Op::End, Op::EndIf, Op::Nop, Op::Build(102), Op::McrActivate, Op::McrDeactivate]),
            _ => self.call(),
        };
        self.push(op);
    }

    /// A constant that any notation could stand for.
    pub(crate) fn value(&mut self) -> u32 {
        match self.bytes.byte() % 4 {
            0 => u32::from(self.bytes.byte()),
            1 => u32::from(self.bytes.word()),
            2 => 0x8300_0000 | u32::from(self.bytes.word()),
            _ => self.bytes.double(),
        }
    }

    fn scan(&mut self) -> Op {
        let (logic, negate) = self.logic();
        let test = match self.bytes.byte() % 6 {
            0 => ob1_ir::BitTest::Timer(self.number(&Timer)),
            1 => ob1_ir::BitTest::Counter(self.number(&Counter)),
            2 => ob1_ir::BitTest::Status(self.bytes.of(&StatusBit::ALL)),
            _ => ob1_ir::BitTest::Bit(self.place(Width::Bit)),
        };
        Op::Scan { logic, negate, test }
    }

    fn timed(&mut self) -> Op {
        let kind = self.bytes.of(&TimerKind::ALL);
        if self.bytes.flag() {
            let n = self.number(&Timer);
            return match self.bytes.byte() % 5 {
                0 => Op::StartTimer(kind, n),
                1 => Op::ResetTimer(n),
                2 => Op::EnableTimer(n),
                3 => Op::LoadTimer(n),
                _ => Op::LoadTimerBcd(n),
            };
        }
        let n = self.number(&Counter);
        match self.bytes.byte() % 7 {
            0 => Op::CountUp(n),
            1 => Op::CountDown(n),
            2 => Op::SetCounter(n),
            3 => Op::ResetCounter(n),
            4 => Op::EnableCounter(n),
            5 => Op::LoadCounter(n),
            _ => Op::LoadCounterBcd(n),
        }
    }

    fn arithmetic(&mut self) -> Op {
        match self.bytes.byte() % 4 {
            0 => Op::AddConst { format: NumberFormat::Int, value: i32::from(self.bytes.word() as i16) },
            1 => Op::AddConst { format: NumberFormat::DInt, value: self.bytes.double() as i32 },
            2 => Op::Arithmetic(NumberFormat::DInt, AccuOp::Mod),
            _ => {
                let op = self.bytes.of(&[AccuOp::Add, AccuOp::Sub, AccuOp::Mul, AccuOp::Div]);
                Op::Arithmetic(self.format(), op)
            }
        }
    }

    fn shift(&mut self) -> Op {
        let logic = self.bytes.of(&WordLogic::ALL);
        let by = self.bytes.flag();
        match self.bytes.byte() % 4 {
            0 => Op::WordLogic(logic, by.then(|| self.bytes.word())),
            1 => Op::DWordLogic(logic, by.then(|| self.bytes.double())),
            _ => {
                let (shift, most) = self.bytes.of(&SHIFTS);
                Op::Shift(shift, by.then(|| self.bytes.byte() % (most + 1)))
            }
        }
    }

    fn registers(&mut self) -> Op {
        let register = self.register();
        match self.bytes.byte() % 11 {
            0 => Op::LoadAr(register),
            1 => {
                let code = self.bytes.of(&[0u32, 0x80, 0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87]);
                Op::LoadArConst(register, code << 24 | self.bytes.double() & 0x7_FFFF)
            }
            2 => Op::LoadArFrom(register, self.double_word()),
            3 => Op::CopyAr2ToAr1,
            4 => Op::TransferAr(register),
            5 => Op::TransferArTo(register, self.double_word()),
            6 => Op::CopyAr1ToAr2,
            7 => Op::ExchangeArs,
            8 => Op::AddAr(register),
            9 => Op::AddArConst(register, BitAddr(u32::from(self.bytes.word()))),
            _ => Op::ExchangeDbs,
        }
    }

    fn double_word(&mut self) -> Operand {
        let area = self.bytes.of(&[Area::Memory, Area::Local, Area::Db, Area::Di]);
        Operand { width: Width::DWord, place: self.fixed(area, Width::DWord) }
    }

    /// `SPL`, its list, and the statement for a number beyond.
    fn jump_list(&mut self) {
        let targets: Vec<u32> = (0..1 + self.bytes.byte() % 5).map(|_| u32::from(self.bytes.word())).collect();
        let otherwise = (self.code.len() + 1 + targets.len()) as u32;
        let list: Vec<Op> = targets.iter().map(|to| Op::Jump(Jump::Always, *to)).collect();
        self.push(Op::JumpList { targets: targets.into(), otherwise });
        list.into_iter().for_each(|op| self.push(op));
        // What follows is not another jump of the list.
        self.push(Op::Nop);
    }

    /// `L P##name`, or a component of a composed parameter.
    fn parameter(&mut self) {
        const LATER: BitAddr = BitAddr::byte_addr(0x1_0000);
        match self.id.kind {
            BlockKind::Fc => {
                let formals: Vec<Param> = self.interface.formals().cloned().collect();
                let index = self.bytes.below(formals.len());
                let op = match &formals[index].ty {
                    Any => Op::LoadParamCopy { index: index as u16, bytes: 10, at: LATER },
                    Pointer => Op::LoadParamCopy { index: index as u16, bytes: 6, at: LATER },
                    ty if ty.is_parameter_type() => Op::Nop,
                    ty => {
                        let at = ty.is_composed().then_some(LATER);
                        Op::LoadParamPointer { index: index as u16, at }
                    }
                };
                self.push(op);
            }
            BlockKind::Fb => {
                let pointer = self.interface.params.iter().find(|p| p.is_pointer()).map_or(BitAddr(0), |p| p.at);
                let width = self.width();
                let Some(offset) = self.component(&structure(), width) else { return };
                let place = Place::Register(None, AddressRegister::Ar1, offset);
                let from = Operand { width: Width::DWord, place: Place::Instance(BitAddr(pointer.0 + 16)) };
                self.closed.extend([self.code.len() + 1, self.code.len() + 2]);
                self.push(Op::OpenDb(DbRegister::Db, Number::Instance(pointer)));
                self.push(Op::LoadArFrom(AddressRegister::Ar1, from));
                self.push(match width {
                    Width::Bit => Op::Set(place),
                    width => Op::Load(Operand { width, place }),
                });
            }
            _ => {}
        }
    }

    /// Targets within the block, what follows `AUF DB n` in the form that is read back, copies in their places.
    fn finish(mut self, instances: Instances) -> (CodeBlock, Instances, BTreeMap<BlockId, Interface>) {
        if self.code.is_empty() {
            self.push(Op::Nop);
        }
        let open: Vec<u32> = (0..self.code.len()).filter(|at| !self.closed.contains(at)).map(|at| at as u32).collect();
        let to = |at: u32| open[at as usize % open.len()];
        let mut lists: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        for (at, stmt) in self.code.iter_mut().enumerate() {
            match &mut stmt.op {
                Op::Jump(_, target) | Op::Loop(target) => *target = to(*target),
                Op::JumpList { targets, .. } => {
                    targets.iter_mut().for_each(|t| *t = to(*t));
                    lists.insert(at, targets.to_vec());
                }
                _ => {}
            }
        }
        for (at, targets) in lists {
            for (stmt, target) in self.code[at + 1..].iter_mut().zip(targets) {
                stmt.op = Op::Jump(Jump::Always, target);
            }
        }
        for at in 1..self.code.len() {
            let mut reads_db = false;
            self.code[at].op.places(&mut |place, _| reads_db |= matches!(place, Place::Fixed(Area::Db, _)));
            let before = &mut self.code[at - 1];
            if reads_db && matches!(before.op, Op::OpenDb(DbRegister::Db, Number::Fixed(_))) {
                before.op = Op::Nop;
            }
        }
        let mut interface = self.interface;
        let own = interface.temp_bytes.max(CodeBlock::local_bytes(&self.code));
        let (mut copies, mut next) = (BTreeMap::new(), own);
        for stmt in &mut self.code {
            let (index, bytes, at) = match &mut stmt.op {
                Op::LoadParamPointer { index, at: Some(at) } => (*index, 6, at),
                Op::LoadParamCopy { index, bytes, at } => (*index, u32::from(*bytes), at),
                _ => continue,
            };
            *at = *copies.entry(index).or_insert_with(|| {
                next += bytes;
                BitAddr::byte_addr(next - bytes)
            });
        }
        interface.temp_bytes = interface.temp_bytes.max(CodeBlock::local_bytes(&self.code));
        let block = CodeBlock { id: self.id, name: None, interface, code: self.code, source: 0 };
        (block, instances, self.callees)
    }
}

const SHIFTS: [(Shift, u8); 8] = [
    (Shift::LeftWord, 15),
    (Shift::RightWord, 15),
    (Shift::RightInt, 15),
    (Shift::LeftDWord, 32),
    (Shift::RightDWord, 32),
    (Shift::RightDInt, 32),
    (Shift::RotateLeft, 32),
    (Shift::RotateRight, 32),
];

const PLAIN: [Op; 17] = [
    Op::Math(MathFn::Sqr),
    Op::Math(MathFn::Sqrt),
    Op::Math(MathFn::Ln),
    Op::Math(MathFn::Exp),
    Op::Math(MathFn::Sin),
    Op::Math(MathFn::Cos),
    Op::Math(MathFn::Tan),
    Op::Math(MathFn::Asin),
    Op::Math(MathFn::Acos),
    Op::Math(MathFn::Atan),
    Op::ExchangeAccus,
    Op::Push,
    Op::Pop,
    Op::Enter,
    Op::Leave,
    Op::RotateLeftCc1,
    Op::RotateRightCc1,
];
