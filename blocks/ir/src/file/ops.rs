//! Statements: the inverse of their text in the alternate form.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use ob1_model::TimerKind;

use super::cursor::{Cursor, Expected};
use crate::{
    AccuOp, AddressRegister, Arg, BitTest, Call, CallMode, Compare, Convert, DbRegister, Jump, Logic, MathFn, Number,
    NumberFormat, Op, Shift, StatusBit, Target, WordLogic,
};

/// Every operation without an operand, and scans of status bits. Their texts are with the operations, not here.
pub(super) fn plain() -> Vec<Op> {
    let mut all = vec![
        Op::Close,
        Op::OrBranch,
        Op::SetRlo,
        Op::ClearRlo,
        Op::NotRlo,
        Op::SaveRlo,
        Op::LoadStatus,
        Op::TransferStatus,
        Op::RotateLeftCc1,
        Op::RotateRightCc1,
        Op::ExchangeAccus,
        Op::Push,
        Op::Pop,
        Op::Enter,
        Op::Leave,
        Op::CopyAr2ToAr1,
        Op::CopyAr1ToAr2,
        Op::ExchangeArs,
        Op::ExchangeDbs,
        Op::End,
        Op::EndIf,
        Op::McrActivate,
        Op::McrDeactivate,
        Op::McrOpen,
        Op::McrClose,
        Op::Nop,
    ];
    for (logic, negate) in Logic::ALL.into_iter().flat_map(|logic| [(logic, false), (logic, true)]) {
        all.push(Op::Open { logic, negate });
        all.extend(StatusBit::ALL.map(|bit| Op::Scan { logic, negate, test: BitTest::Status(bit) }));
    }
    for register in [AddressRegister::Ar1, AddressRegister::Ar2] {
        all.extend([Op::LoadAr(register), Op::TransferAr(register), Op::AddAr(register)]);
    }
    for register in [DbRegister::Db, DbRegister::Di] {
        all.extend([Op::LoadDbLength(register), Op::LoadDbNumber(register)]);
    }
    for format in NumberFormat::ALL {
        all.extend(AccuOp::ALL.map(|op| Op::Arithmetic(format, op)));
        all.extend(Compare::ALL.map(|how| Op::Compare(format, how)));
    }
    for logic in WordLogic::ALL {
        all.extend([Op::WordLogic(logic, None), Op::DWordLogic(logic, None)]);
    }
    all.extend(Shift::ALL.map(|shift| Op::Shift(shift, None)));
    all.extend(Convert::ALL.map(Op::Convert));
    all.extend(MathFn::ALL.map(Op::Math));
    all.extend(Op::BUILDS.map(Op::Build));
    all
}

/// The operation of a statement, from its text.
pub(super) fn op(text: &str) -> Expected<Op> {
    static PLAIN: LazyLock<BTreeMap<String, Op>> =
        LazyLock::new(|| plain().into_iter().map(|op| (op.to_string(), op)).collect());
    let text = text.trim();
    if let Some(op) = PLAIN.get(text) {
        return Ok(op.clone());
    }
    let mut line = Cursor(text);
    let op = with_operand(&mut line)?;
    if line.is_empty() { Ok(op) } else { Err("the end of the statement") }
}

fn with_operand(line: &mut Cursor<'_>) -> Expected<Op> {
    const WHAT: &str = "a statement";
    let word = line.word();
    if let Some(jump) = Jump::ALL.into_iter().find(|jump| jump.name() == word) {
        return Ok(Op::Jump(jump, target(line)?));
    }
    if let Some(shift) = Shift::ALL.into_iter().find(|shift| shift.name() == word) {
        return Ok(Op::Shift(shift, Some(line.number()?)));
    }
    if let Some(kind) = TimerKind::ALL.into_iter().find(|kind| kind.name() == word) {
        return Ok(Op::StartTimer(kind, numbered(line, "T")?));
    }
    for logic in Logic::ALL {
        for negate in [false, true] {
            if crate::text::logic(logic, negate) == word {
                return Ok(Op::Scan { logic, negate, test: test(line)? });
            }
        }
    }
    for logic in WordLogic::ALL {
        if let Some(width) = word.strip_prefix(logic.name()) {
            match width {
                "W" if line.eat("W#16#") => {
                    let value = u16::try_from(line.hex()?).map_err(|_| "a word")?;
                    return Ok(Op::WordLogic(logic, Some(value)));
                }
                "D" if line.eat("DW#16#") => return Ok(Op::DWordLogic(logic, Some(line.hex()?))),
                _ => {}
            }
        }
    }
    let register = |last: &str| if last == "1" { AddressRegister::Ar1 } else { AddressRegister::Ar2 };
    Ok(match word {
        "=" => Op::Assign(line.bit()?),
        "S" if counts(line) => Op::SetCounter(numbered(line, "Z")?),
        "S" => Op::Set(line.bit()?),
        "R" if times(line) => Op::ResetTimer(numbered(line, "T")?),
        "R" if counts(line) => Op::ResetCounter(numbered(line, "Z")?),
        "R" => Op::Reset(line.bit()?),
        "FP" => Op::EdgePositive(line.bit()?),
        "FN" => Op::EdgeNegative(line.bit()?),
        "FR" if times(line) => Op::EnableTimer(numbered(line, "T")?),
        "FR" => Op::EnableCounter(numbered(line, "Z")?),
        "ZV" => Op::CountUp(numbered(line, "Z")?),
        "ZR" => Op::CountDown(numbered(line, "Z")?),
        "LC" if times(line) => Op::LoadTimerBcd(numbered(line, "T")?),
        "LC" => Op::LoadCounterBcd(numbered(line, "Z")?),
        "L" if times(line) => Op::LoadTimer(numbered(line, "T")?),
        "L" if counts(line) => Op::LoadCounter(numbered(line, "Z")?),
        "L" if line.eat("DW#16#") => Op::LoadConst(line.hex()?),
        "L" if line.eat("P##PAR") => parameter(line)?,
        "L" => Op::Load(line.operand()?),
        "T" => Op::Transfer(line.operand()?),
        "LAR1" | "LAR2" => match line.pointer_bits() {
            Ok(bits) => Op::LoadArConst(register(&word[3..]), bits),
            Err(_) => Op::LoadArFrom(register(&word[3..]), line.operand()?),
        },
        "TAR1" | "TAR2" => Op::TransferArTo(register(&word[3..]), line.operand()?),
        "+AR1" | "+AR2" => {
            line.need("P#")?;
            Op::AddArConst(register(&word[3..]), line.address()?)
        }
        "+" if line.eat("L#") => Op::AddConst { format: NumberFormat::DInt, value: line.number()? },
        "+" if line.eat("R#") => Op::AddConst { format: NumberFormat::Real, value: line.number()? },
        "+" => Op::AddConst { format: NumberFormat::Int, value: line.number()? },
        "INC" => Op::Increment(line.number()?),
        "DEC" => Op::Decrement(line.number()?),
        "AUF" => {
            let register = line.choice([DbRegister::Db, DbRegister::Di], |r| r.to_string(), "DB or DI")?;
            Op::OpenDb(register, line.block_number()?)
        }
        "LOOP" => Op::Loop(target(line)?),
        "SPL" => {
            let mut targets = Vec::new();
            while !line.eat("else") {
                targets.push(target(line)?);
            }
            Op::JumpList { targets: targets.into(), otherwise: target(line)? }
        }
        "CALL" => call(CallMode::Call, line)?,
        "UC" => call(CallMode::Unconditional, line)?,
        "CC" => call(CallMode::Conditional, line)?,
        _ => return Err(WHAT),
    })
}

fn times(line: &Cursor<'_>) -> bool {
    line.0.trim_start().starts_with("T ")
}

fn counts(line: &Cursor<'_>) -> bool {
    line.0.trim_start().starts_with("Z ")
}

fn numbered(line: &mut Cursor<'_>, letter: &'static str) -> Expected<Number> {
    line.need(letter)?;
    line.block_number()
}

fn target(line: &mut Cursor<'_>) -> Expected<u32> {
    line.need("@")?;
    line.number()
}

fn test(line: &mut Cursor<'_>) -> Expected<BitTest> {
    if times(line) {
        return Ok(BitTest::Timer(numbered(line, "T")?));
    }
    if counts(line) {
        return Ok(BitTest::Counter(numbered(line, "Z")?));
    }
    Ok(BitTest::Bit(line.bit()?))
}

/// `L P##PAR` has been read.
fn parameter(line: &mut Cursor<'_>) -> Expected<Op> {
    let index = line.number()?;
    if !line.eat("by") {
        return Ok(Op::LoadParamPointer { index, at: None });
    }
    if line.eat("P#L") {
        return Ok(Op::LoadParamPointer { index, at: Some(line.address()?) });
    }
    let bytes = line.number()?;
    line.need("bytes at P#L")?;
    Ok(Op::LoadParamCopy { index, bytes, at: line.address()? })
}

fn call(mode: CallMode, line: &mut Cursor<'_>) -> Expected<Op> {
    let mut block = *line;
    let target = match block.block() {
        Ok(id) => {
            *line = block;
            if line.eat("INST+") { Target::Local(id, line.address()?) } else { Target::Block(id) }
        }
        Err(_) => {
            let kind = line.kind()?;
            line.eat("#");
            Target::Indirect(kind, line.block_number()?)
        }
    };
    let instance = if line.eat(", DB") { Some(line.block_number()?) } else { None };
    let mut args = Vec::new();
    let close = match (line.eat("("), line.eat("{")) {
        (true, _) => Some(")"),
        (_, true) => Some("}"),
        _ => None,
    };
    if let Some(close) = close {
        loop {
            args.push(arg(line)?);
            if !line.eat(",") {
                break;
            }
        }
        line.need(close)?;
    }
    Ok(Op::Call(Box::new(Call { mode, target, instance, args })))
}

fn arg(line: &mut Cursor<'_>) -> Expected<Arg> {
    if line.eat("B#16#") {
        return Ok(Arg::Bytes(line.bytes()?.into()));
    }
    if line.eat("16#") {
        return Ok(Arg::Const(line.hex()?));
    }
    if line.eat("-") {
        return Ok(Arg::Open);
    }
    if line.eat("N#") {
        return Ok(Arg::Raw(line.number::<u32>()? << 16));
    }
    if line.eat("#") {
        return Ok(Arg::Number(line.block_number()?));
    }
    let here = line.0.trim_start();
    if here.starts_with("P#") || here.starts_with("DW#16#") {
        return Ok(Arg::Raw(line.pointer_bits()?));
    }
    Ok(Arg::Operand(line.operand()?))
}
