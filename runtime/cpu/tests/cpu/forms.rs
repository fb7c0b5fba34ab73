//! Every engine means what the intermediate code says: random straight-line programs run on each and leave the same
//! memory.

use ob1_cpu::{Cpu, CpuConfig};
use ob1_ir::{
    AccuOp, AddressRegister, BitTest, Compare, Convert, DbRegister, Jump, Logic, Number, NumberFormat, Op, Place,
    Pointer, Shift, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, Interface, TimerKind};
use ob1_time::Span;

use crate::common::random::Random;
use crate::common::*;

/// Random statements.
trait Statements {
    fn place(&mut self, bit: bool) -> Place;
    fn statement(&mut self, index: u32, count: u32) -> Op;
}

impl Statements for Random {
    fn place(&mut self, bit: bool) -> Place {
        let area = self.of(&[Area::Memory, Area::Memory, Area::Input, Area::Output, Area::Local, Area::Db]);
        let byte = self.next(if area == Area::Local { 16 } else { 28 }) + if area == Area::Local { 20 } else { 0 };
        let at = BitAddr::new(byte, if bit { self.next(8) as u8 } else { 0 });
        let pointer = Pointer { area: Area::Memory, at: BitAddr::byte_addr(40) };
        match self.next(10) {
            0 => Place::Register(None, AddressRegister::Ar1, at),
            1 => Place::Register(Some(Area::Memory), AddressRegister::Ar2, at),
            2 => Place::Memory(self.of(&[Area::Memory, Area::Db, Area::Output]), pointer),
            3 => Place::InDb(7, at),
            _ => Place::Fixed(area, at),
        }
    }

    fn statement(&mut self, index: u32, count: u32) -> Op {
        let logic = self.of(&Logic::ALL);
        let negate = self.next(2) == 1;
        let format = self.of(&NumberFormat::ALL);
        let width = self.of(&[Width::Byte, Width::Word, Width::DWord]);
        match self.next(34) {
            0..=5 => Op::Scan { logic, negate, test: BitTest::Bit(self.place(true)) },
            6 => Op::Scan { logic, negate, test: BitTest::Timer(Number::Fixed(self.next(4) as u16)) },
            7 => Op::Scan { logic, negate, test: BitTest::Counter(Number::Fixed(self.next(4) as u16)) },
            8 => Op::OrBranch,
            9 => Op::Assign(self.place(true)),
            10 => Op::Set(self.place(true)),
            11 => Op::Reset(self.place(true)),
            12 => Op::EdgePositive(self.place(true)),
            13 => Op::EdgeNegative(self.place(true)),
            14 => self.of(&[0, 1, 2, 3]).pipe(|n| [Op::SetRlo, Op::ClearRlo, Op::NotRlo, Op::SaveRlo][n].clone()),
            15..=18 => Op::Load(operand(width, self.place(false))),
            19..=21 => Op::Transfer(operand(width, self.place(false))),
            22 => Op::LoadConst(self.next(u32::MAX)),
            23 => Op::Arithmetic(format, self.of(&[AccuOp::Add, AccuOp::Sub, AccuOp::Mul])),
            24 => Op::Compare(format, self.of(&[Compare::Equal, Compare::Less, Compare::GreaterEqual])),
            25 => Op::AddConst {
                format: self.of(&[NumberFormat::Int, NumberFormat::DInt]),
                value: self.next(999) as i32 - 500,
            },
            26 => Op::Convert(self.of(&[Convert::Itd, Convert::Negi, Convert::Taw, Convert::Dtr, Convert::Itb])),
            27 => {
                Op::Shift(self.of(&[Shift::LeftWord, Shift::RightDInt, Shift::RotateLeft]), Some(self.next(40) as u8))
            }
            28 => Op::WordLogic(self.of(&[WordLogic::And, WordLogic::Xor]), None),
            29 => self.of(&[0, 1, 2]).pipe(|n| [Op::ExchangeAccus, Op::LoadStatus, Op::TransferStatus][n].clone()),
            30 => Op::LoadArConst(
                self.of(&[AddressRegister::Ar1, AddressRegister::Ar2]),
                self.of(&[0x8300_0000, 0x8400_0000, 0x8200_0000, 0x8600_00A0, 0x8500_0000]),
            ),
            31 => {
                let on = self.of(&[Jump::IfRlo, Jump::IfNotRlo, Jump::IfZero, Jump::IfStoredOverflow, Jump::Always]);
                Op::Jump(on, (index + 1 + self.next(4)).min(count))
            }
            32 => Op::CountUp(Number::Fixed(self.next(4) as u16)),
            _ => Op::StartTimer(TimerKind::ExtendedPulse, Number::Fixed(self.next(4) as u16)),
        }
    }
}

trait Pipe: Sized {
    fn pipe<T>(self, f: impl FnOnce(Self) -> T) -> T {
        f(self)
    }
}

impl Pipe for usize {}

#[test]
fn every_engine_leaves_the_same_memory() {
    let mut random = Random::new(0x1234_5678_9ABC_DEF1);
    for seed in 0..300 {
        let count = 120;
        let mut code = vec![Op::OpenDb(DbRegister::Db, Number::Fixed(7)), Op::OpenDb(DbRegister::Di, Number::Fixed(7))];
        code.extend((2..count).map(|i| random.statement(i, count)));
        // What the registers hold at the end.
        code.extend([transfer(md(200)), Op::ExchangeAccus, transfer(md(204)), Op::LoadStatus, transfer(mw(208))]);
        let handler = block(ob(121), Interface::default(), vec![Op::Nop]);
        let program = program(vec![ob1(code.clone()), handler], vec![db(7, &[0x5A; 64])]);
        for accumulators in [2, 4] {
            let config = CpuConfig { accumulators, watchdog: Span::ZERO, ..CpuConfig::default() };
            let bench =
                |factory| Bench::with(Cpu::new(config.clone(), &program, vec![], vec![], factory).expect("loads"));
            let mut benches: Vec<_> = ENGINES.iter().map(|(name, factory)| (name, bench(*factory))).collect();
            let (first, others) = benches.split_first_mut().expect("an engine");
            for scan in 0..4 {
                first.1.run();
                for (name, other) in &mut *others {
                    other.run();
                    let how = format!("{name}, program {seed}, scan {scan}, {accumulators} accumulators: {code:#?}");
                    assert_eq!(first.1.cpu.bit_memory(), other.cpu.bit_memory(), "{how}");
                    assert_eq!(first.1.cpu.data_block(7), other.cpu.data_block(7), "{how}");
                    assert_eq!(first.1.clock.now, other.clock.now, "{how}");
                    other.clock.now += 20 * MS;
                }
                first.1.clock.now += 20 * MS;
            }
        }
    }
}
