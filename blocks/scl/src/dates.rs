//! Times and dates of TIA Portal: T_ADD, T_SUB, T_DIFF, and the clock as DATE_AND_TIME or DTL.

use ob1_ir::{AccuOp, Arg as IrArg, Compare, Convert, Logic, Op, Operand, Place, Shift, Width};
use ob1_model::{Area, BitAddr, BlockId, DataType, Section};
use ob1_stl::front::{Span, dtl, same_layout, with_article};

use crate::check::Checker;
use crate::code::Code;
use crate::convert::by;
use crate::emit_copy::in_local;
use crate::messages;
use crate::syntax::{Arg, Operator};
use crate::tree::{Check, Kind, Typed, Var};
use crate::types::{BOOL, BYTE, DINT, DWORD, INT, WORD, short};

/// The clock of the CPU into a variable: the block that reads it, and whether it is a DTL.
#[derive(Clone, Debug)]
pub(crate) struct ClockRead<'w> {
    block: BlockId,
    sections: Vec<Section>,
    target: Var<'w>,
    ty: &'w DataType,
}

impl<'c> Checker<'c> {
    /// T_ADD, T_SUB and T_DIFF are + and -; RD_SYS_T and RD_LOC_T read the clock. The outer `None`: another name.
    pub(crate) fn dated(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Option<Typed<'c>>> {
        let op = match name {
            "T_ADD" => AccuOp::Add,
            "T_SUB" | "T_DIFF" => AccuOp::Sub,
            "RD_SYS_T" | "RD_LOC_T" => return Some(self.clock(name, args, span)),
            _ => return None,
        };
        let [left, right] = self.values(name, ["IN1", "IN2"], args, span)?;
        let both = left.good().zip(right.good());
        Some(both.and_then(|(left, right)| self.binary(Operator::Arithmetic(op), left, right, span).good()))
    }

    fn clock(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Typed<'c>> {
        let [out] = self.arguments(name, ["OUT"], args, span)?;
        let target = self.expr(out).good()?;
        self.mark_written(&target);
        let Typed { kind: Kind::Var(target), ty, .. } = target else {
            self.report(target.span, &messages::ACTUAL, format!("OUT of {name} is written: it takes a variable"));
            return None;
        };
        if *ty != DataType::DateAndTime && !same_layout(ty, &dtl()) {
            let message = format!("{name} gives a DTL or DATE_AND_TIME, this is {}", with_article(short(ty)));
            self.report(out.span, &messages::ACTUAL, message);
            return None;
        }
        let Some(block) = self.block_called("READ_CLK") else {
            self.lacks("READ_CLK", span);
            return None;
        };
        let sections = self.world.blocks.get(&block)?.interface.formals().map(|p| p.section).collect();
        let read = ClockRead { block, sections, target, ty };
        Some(Typed::new(Kind::Clock(Box::new(read)), &INT, span))
    }
}

impl Code {
    /// Reads the clock; the result of READ_CLK lies in ACCU1.
    pub(crate) fn read_clock(&mut self, read: &ClockRead<'_>, span: Span) {
        let (result, at) = (self.temp(Width::Word), self.take(8));
        let moment = Operand { width: Width::Byte, place: Place::Fixed(Area::Local, at) };
        let arg = |section: &Section| IrArg::Operand(if *section == Section::Return { result } else { moment });
        self.native(read.block, read.sections.iter().map(arg).collect());
        if *read.ty == DataType::DateAndTime {
            let value = Typed::new(Kind::Var(in_local(at)), read.ty, span);
            self.assign(&read.target, read.ty, &value);
        } else {
            for (byte, ty, value) in parts(at, span) {
                let field = Var { at: BitAddr(read.target.at.0 + byte * 8), ..read.target.clone() };
                self.assign(&field, ty, &value);
            }
        }
        self.op(Op::Load(result));
    }
}

/// The components of a DTL out of a DATE_AND_TIME here in the local data, with their bytes and types.
fn parts(at: BitAddr, span: Span) -> Vec<(u32, &'static DataType, Typed<'static>)> {
    let here = |byte: u32, ty: &'static DataType| Typed::new(Kind::Var(in_local(BitAddr(at.0 + byte * 8))), ty, span);
    let constant = |value: u32, ty: &'static DataType| Box::new(Typed::new(Kind::Constant(value), ty, span));
    let decimal = |value: Typed<'static>, ops: Vec<Op>, ty: &'static DataType| by(ops, Check::Never, value, ty);
    let bcd = |byte: u32, ty: &'static DataType| decimal(here(byte, &BYTE), vec![Op::Convert(Convert::Bti)], ty);
    let old = Typed::new(Kind::Compare(Compare::GreaterEqual, Box::new(bcd(0, &INT)), constant(90, &INT)), &BOOL, span);
    let century = Kind::Select(Box::new([old, *constant(2000, &INT), *constant(1900, &INT)]));
    let century = Box::new(Typed::new(century, &INT, span));
    let year = Typed::new(Kind::Arithmetic(AccuOp::Add, Box::new(bcd(0, &INT)), century), &WORD, span);
    let mut out = vec![(0, &WORD, year)];
    // Month, day, hour, minute, second.
    out.extend([(2, 1), (3, 2), (5, 3), (6, 4), (7, 5)].map(|(to, from)| (to, &BYTE, bcd(from, &BYTE))));
    let weekday = Kind::Bits(Logic::And, Box::new(here(7, &BYTE)), constant(0x0F, &BYTE));
    out.push((4, &BYTE, Typed::new(weekday, &BYTE, span)));
    let ops = vec![Op::Shift(Shift::RightWord, Some(4)), Op::Convert(Convert::Bti), Op::Convert(Convert::Itd)];
    let milliseconds = Box::new(decimal(here(6, &WORD), ops, &DINT));
    let nanoseconds = Kind::Arithmetic(AccuOp::Mul, milliseconds, constant(1_000_000, &DINT));
    out.push((8, &DWORD, Typed::new(nanoseconds, &DWORD, span)));
    out
}
