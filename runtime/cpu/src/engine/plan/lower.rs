//! From the intermediate code to the pre-decoded form, at load.

use ob1_ir::{AccuOp, BitTest, CodeBlock, Logic, Number, NumberFormat, Op as Ir, Operand, Place, Stmt};
use ob1_model::{Area, BitAddr, BlockKind};

use super::lower_call::lower_call;
use super::lowering::{Lowering, fixed};
use super::{AREA_IN_POINTER, Base, Block, CallTarget, Callee, InstanceOf, Op, Scan};
use crate::LoadError;
use crate::arena::ArenaByte;

/// Bytes of start information at the beginning of an organization block's local data.
const START_INFO: u32 = 20;

/// Lowers one block; what it cannot lower goes to `errors`.
pub(crate) fn lower(block: &CodeBlock, l: &Lowering<'_>, errors: &mut Vec<LoadError>) -> Block {
    let mcr = block.code.iter().any(|s| matches!(s.op, Ir::McrActivate));
    let mut calls = Vec::new();
    let mut lists = Vec::new();
    let mut ops = Vec::with_capacity(block.code.len() + 1);
    for (index, stmt) in block.code.iter().enumerate() {
        let op = match &stmt.op {
            Ir::Call(call) => match lower_call(block, index, call, l) {
                Ok(lowered) => {
                    let call = index_u32(calls.len());
                    let op = match (lowered.target, lowered.instance) {
                        (CallTarget::Known(Callee::Native(native)), InstanceOf::None) if lowered.list.is_none() => {
                            Op::CallNative { call, native }
                        }
                        _ => Op::Call { call },
                    };
                    calls.push(lowered);
                    op
                }
                Err(error) => {
                    errors.push(error);
                    Op::Nop
                }
            },
            Ir::JumpList { targets, otherwise } => {
                lists.push(targets.iter().copied().chain([*otherwise]).collect::<Box<[u32]>>());
                Op::JumpList { list: index_u32(lists.len() - 1) }
            }
            op => control(op).or_else(|| short(op, mcr, l)).unwrap_or(Op::Slow),
        };
        ops.push(op);
    }
    ops.push(Op::End);
    Block {
        id: block.id,
        ops: ops.into_boxed_slice(),
        stmts: block.code.clone().into_boxed_slice(),
        local_len: local_bytes(block),
        calls: calls.into_boxed_slice(),
        loops: loops(&block.code),
        lists: lists.into_boxed_slice(),
    }
}

/// Whether a jump leads back.
fn loops(stmts: &[Stmt]) -> bool {
    (0u32..).zip(stmts).any(|(at, stmt)| match &stmt.op {
        Ir::Jump(_, to) | Ir::Loop(to) => *to <= at,
        Ir::JumpList { targets, otherwise } => *otherwise <= at || targets.iter().any(|to| *to <= at),
        _ => false,
    })
}

/// Indices fit: a block has at most 2^32 statements because jump targets are that wide (verified).
fn index_u32(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}

/// Jumps and ends, which every form needs.
fn control(op: &Ir) -> Option<Op> {
    use ob1_ir::Jump;
    Some(match *op {
        Ir::Jump(Jump::Always, target) => Op::Jump { target },
        Ir::Jump(Jump::IfRlo, target) => Op::JumpIf { target },
        Ir::Jump(Jump::IfNotRlo, target) => Op::JumpIfNot { target },
        Ir::Jump(on, target) => Op::JumpOn { on, target },
        Ir::Loop(target) => Op::Loop { target },
        Ir::End => Op::End,
        Ir::EndIf => Op::EndIf,
        Ir::Nop | Ir::Build(_) => Op::Nop,
        _ => return None,
    })
}

/// The short form of a statement, when it has one here.
fn short(op: &Ir, mcr: bool, l: &Lowering<'_>) -> Option<Op> {
    Some(match op {
        Ir::Scan { logic, negate, test } => {
            let scan = Scan { logic: *logic, negate: *negate };
            match test {
                BitTest::Bit(place) => scan_bit(scan, *place, l)?,
                BitTest::Timer(Number::Fixed(n)) if *n < l.config.timers => Op::ScanTimer { scan, number: *n },
                BitTest::Counter(Number::Fixed(n)) if *n < l.config.counters => Op::ScanCounter { scan, number: *n },
                _ => return None,
            }
        }
        Ir::Open { logic, negate } => Op::Open { scan: Scan { logic: *logic, negate: *negate } },
        Ir::Close => Op::Close,
        Ir::OrBranch => Op::OrBranch,
        Ir::SetRlo => Op::SetRlo,
        Ir::ClearRlo => Op::ClearRlo,
        Ir::NotRlo => Op::NotRlo,
        Ir::Assign(place) if !mcr => match fixed(*place, 1, l) {
            Some((at, mask)) => Op::Assign { at, mask },
            None => based(*place, l).map(|(base, at)| Op::AssignAt { base, at })?,
        },
        Ir::Set(place) if !mcr => match fixed(*place, 1, l) {
            Some((at, mask)) => Op::Set { at, mask },
            None => based(*place, l).map(|(base, at)| Op::SetAt { base, at })?,
        },
        Ir::Reset(place) if !mcr => match fixed(*place, 1, l) {
            Some((at, mask)) => Op::Reset { at, mask },
            None => based(*place, l).map(|(base, at)| Op::ResetAt { base, at })?,
        },
        Ir::EdgePositive(place) => fixed(*place, 1, l).map(|(at, mask)| Op::EdgePositive { at, mask })?,
        Ir::EdgeNegative(place) => fixed(*place, 1, l).map(|(at, mask)| Op::EdgeNegative { at, mask })?,
        Ir::Load(operand) => load(*operand, l)?,
        Ir::Transfer(operand) if !mcr => transfer(*operand, l)?,
        Ir::LoadConst(value) => Op::LoadConst { value: *value },
        Ir::Arithmetic(format, op) if l.config.accumulators == 2 => arithmetic(*format, *op),
        Ir::Arithmetic(format, op) => Op::Four(*format, *op),
        Ir::Compare(NumberFormat::Int, compare) => Op::CompareInt(*compare),
        Ir::Compare(NumberFormat::DInt, compare) => Op::CompareDInt(*compare),
        Ir::Compare(NumberFormat::Real, compare) => Op::CompareReal(*compare),
        Ir::AddConst { format: NumberFormat::Int, value } => Op::AddInt { value: *value as u16 },
        Ir::AddConst { value, .. } => Op::AddDInt { value: *value as u32 },
        _ => return None,
    })
}

fn scan_bit(scan: Scan, place: Place, l: &Lowering<'_>) -> Option<Op> {
    let Some((at, mask)) = fixed(place, 1, l) else {
        return based(place, l).map(|(base, at)| Op::ScanAt { scan, base, at });
    };
    Some(match (scan.logic, scan.negate) {
        (Logic::And, false) => Op::And { at, mask },
        (Logic::And, true) => Op::AndNot { at, mask },
        (Logic::Or, false) => Op::Or { at, mask },
        (Logic::Or, true) => Op::OrNot { at, mask },
        (Logic::Xor, false) => Op::Xor { at, mask },
        (Logic::Xor, true) => Op::XorNot { at, mask },
    })
}

fn load(operand: Operand, l: &Lowering<'_>) -> Option<Op> {
    let bits = operand.width.bits();
    if let Some((at, _)) = fixed(operand.place, u32::from(bits), l) {
        return Some(match bits {
            8 => Op::LoadByte { at },
            16 => Op::LoadWord { at },
            32 => Op::LoadDWord { at },
            _ => return None,
        });
    }
    if let Some((db, at)) = in_db(operand.place, bits, false, l) {
        return Some(Op::LoadInDb { bits, db, at });
    }
    based(operand.place, l).filter(|_| bits > 1).map(|(base, at)| Op::LoadAt { bits, base, at })
}

fn transfer(operand: Operand, l: &Lowering<'_>) -> Option<Op> {
    let bits = operand.width.bits();
    if let Some((at, _)) = fixed(operand.place, u32::from(bits), l) {
        return Some(match bits {
            8 => Op::StoreByte { at },
            16 => Op::StoreWord { at },
            32 => Op::StoreDWord { at },
            _ => return None,
        });
    }
    if let Some((db, at)) = in_db(operand.place, bits, true, l) {
        return Some(Op::StoreInDb { bits, db, at });
    }
    based(operand.place, l).filter(|_| bits > 1).map(|(base, at)| Op::StoreAt { bits, base, at })
}

/// A fully qualified operand of a data block that is loaded, long enough and, for writes, not protected.
fn in_db(place: Place, bits: u8, write: bool, l: &Lowering<'_>) -> Option<(u16, ArenaByte)> {
    let Place::InDb(number, at) = place else { return None };
    let db = l.memory.db(number)?;
    let end = u64::from(at.byte()) + u64::from(bits / 8);
    let room = if write { db.writable } else { db.len };
    (bits > 1 && end <= u64::from(room)).then_some((number, db.at.plus(at.byte())))
}

fn based(place: Place, l: &Lowering<'_>) -> Option<(Base, BitAddr)> {
    use ob1_ir::AddressRegister::{Ar1, Ar2};
    Some(match place {
        Place::Fixed(Area::Local, at) => (Base::Local, at),
        Place::Fixed(Area::Db, at) => (Base::Db, at),
        Place::Instance(at) => (Base::Instance, at),
        Place::Param { index, at } => (Base::Param(index), at),
        Place::Register(area, register, at) => {
            let code = area.map_or(AREA_IN_POINTER, Area::pointer_code);
            if area == Some(Area::Peripheral) {
                return None;
            }
            (
                if register == Ar1 {
                    Base::Ar1(code)
                } else {
                    debug_assert!(register == Ar2);
                    Base::Ar2(code)
                },
                at,
            )
        }
        Place::Memory(area, pointer) if pointer.area == Area::Memory && area != Area::Peripheral => {
            l.memory.memory.locate(pointer.at.byte(), 4)?;
            (Base::Pointer { code: area.pointer_code(), md: pointer.at.byte() as u16 }, BitAddr(0))
        }
        _ => return None,
    })
}

/// Bytes of local data: what the interface says, and the start information of an organization block.
fn local_bytes(block: &CodeBlock) -> u32 {
    let bytes = block.interface.temp_bytes;
    let least = if block.id.kind == BlockKind::Ob { START_INFO } else { 0 };
    bytes.max(least).next_multiple_of(2)
}

/// True when the block may write its formal `index`.
pub(crate) fn writes_param(block: &CodeBlock, index: usize) -> bool {
    let mut found = false;
    for stmt in block.code.iter().filter(|stmt| may_write(&stmt.op)) {
        stmt.op.places(&mut |place, _| {
            found |= matches!(place, Place::Param { index: i, .. } if usize::from(i) == index);
        });
    }
    found
}

/// A statement that writes an operand, passes one on to a block that may write it, or gives a pointer to it away.
const fn may_write(op: &Ir) -> bool {
    matches!(
        op,
        Ir::Assign(_)
            | Ir::Set(_)
            | Ir::Reset(_)
            | Ir::EdgePositive(_)
            | Ir::EdgeNegative(_)
            | Ir::Transfer(_)
            | Ir::TransferArTo(..)
            | Ir::LoadParamPointer { .. }
            | Ir::Call(_)
    )
}

/// The operation of a format on a CPU with two accumulators.
const fn arithmetic(format: NumberFormat, op: AccuOp) -> Op {
    match format {
        NumberFormat::Int => Op::Int(op),
        NumberFormat::DInt => Op::DInt(op),
        NumberFormat::Real => Op::Real(op),
    }
}
