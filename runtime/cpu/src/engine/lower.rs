//! From the intermediate code to the pre-decoded form, at load.

use ob1_ir::{BitTest, CodeBlock, Logic, Number, NumberFormat, Op as Ir, Operand, Place, Program, Verified};
use ob1_model::{Area, BlockId, BlockKind, DataType, Interface, Section};

use super::Callee;
use super::code::{AREA_IN_POINTER, Base, Block, CallTarget, InstanceOf, Op, Scan, arithmetic};
use super::lower_call::lower_call;
use super::resolve::width_bits;
use crate::memory::Memory;
use crate::{CpuConfig, LoadError};

/// Bytes of start information at the beginning of an organization block's local data.
const START_INFO: u32 = 20;

/// A formal parameter, as calls need it.
#[derive(Clone, Debug)]
pub(crate) struct Formal {
    pub(crate) section: Section,
    /// Size in bits; numbers of timers, counters and blocks are 16.
    pub(crate) bits: u32,
    /// Up to 32 bits and copied by value.
    pub(crate) elementary: bool,
    /// TIMER, COUNTER, BLOCK_xx: the reference is the number itself.
    pub(crate) number: bool,
    /// The callee writes it, or passes it on.
    pub(crate) written: bool,
    /// Bit in the instance of an FB.
    pub(crate) at: u32,
    /// A STRING: its operand may be shorter than declared here, as its length bytes tell.
    pub(crate) string: bool,
    /// Composed, and neither POINTER nor ANY: a list of pointers names the POINTER to it.
    pub(crate) by_pointer: bool,
    /// Its place in a list of pointers.
    pub(crate) listed: u16,
}

impl Formal {
    /// Bits an operand passed by reference must have.
    pub(crate) const fn least_bits(&self) -> u32 {
        if self.string { 16 } else { self.bits }
    }
}

/// What a caller must know of a block.
#[derive(Clone, Debug)]
pub(crate) struct Signature {
    pub(crate) id: BlockId,
    pub(crate) callee: Callee,
    pub(crate) formals: Vec<Formal>,
    pub(crate) instance_bytes: u32,
}

impl Signature {
    /// The signature of an interface; `written` tells which formals the callee may write.
    pub(crate) fn new(id: BlockId, callee: Callee, interface: &Interface, written: &dyn Fn(usize) -> bool) -> Self {
        let places = interface.list_places();
        let formals = interface
            .formals()
            .enumerate()
            .map(|(i, p)| {
                let bits = p.passed_bits(id.kind.has_instance());
                let number = p.ty.is_parameter_type();
                Formal {
                    section: p.section,
                    bits,
                    elementary: p.ty.elementary_bits().is_some(),
                    number,
                    written: p.section != Section::Input || written(i),
                    at: p.at.0,
                    string: matches!(p.ty, DataType::String(_)),
                    by_pointer: p.ty.is_composed() && !matches!(p.ty, DataType::Pointer | DataType::Any),
                    listed: places.get(i).copied().unwrap_or(u16::MAX),
                }
            })
            .collect();
        Self { id, callee, formals, instance_bytes: interface.instance_bytes }
    }
}

/// Every loaded block's signature, sorted by id.
#[derive(Clone, Debug, Default)]
pub(crate) struct Signatures(pub(crate) Vec<Signature>);

impl Signatures {
    pub(crate) fn find(&self, id: BlockId) -> Option<&Signature> {
        self.0.binary_search_by_key(&id, |s| s.id).ok().map(|i| &self.0[i])
    }

    pub(crate) fn index(&self, id: BlockId) -> Option<u32> {
        self.0.binary_search_by_key(&id, |s| s.id).ok().and_then(|i| u32::try_from(i).ok())
    }
}

/// Everything lowering reads.
pub(crate) struct Lowering<'a> {
    pub(crate) config: &'a CpuConfig,
    pub(crate) memory: &'a Memory,
    pub(crate) program: Verified<&'a Program>,
    pub(crate) signatures: &'a Signatures,
    /// Constants of calls: their bytes, at `memory.constants`.
    pub(crate) constants: &'a Constants,
    /// No short forms: everything but jumps and calls straight from the intermediate code. For tests.
    pub(crate) plain: bool,
}

/// Constants of calls, collected before the memory is laid out.
#[derive(Clone, Debug, Default)]
pub(crate) struct Constants {
    pub(crate) bytes: Vec<u8>,
}

impl Constants {
    /// The offset of these bytes, which are appended when they are not there yet.
    pub(crate) fn add(&mut self, bytes: &[u8]) {
        if self.find(bytes).is_none() {
            self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
            self.bytes.extend_from_slice(bytes);
        }
    }

    /// Offset of these bytes, on a multiple of four.
    pub(crate) fn find(&self, bytes: &[u8]) -> Option<u32> {
        let mut at = 0;
        while at + bytes.len() <= self.bytes.len() {
            if &self.bytes[at..at + bytes.len()] == bytes {
                return u32::try_from(at).ok();
            }
            at += 4;
        }
        None
    }
}

/// Lowers one block.
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
            op => control(op).unwrap_or_else(|| if l.plain { Op::Slow } else { short(op, mcr, l).unwrap_or(Op::Slow) }),
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
        lists: lists.into_boxed_slice(),
    }
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
        Ir::Nop => Op::Nop,
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
    let bits = width_bits(operand.width);
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
    let bits = width_bits(operand.width);
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

/// The arena byte and bit mask of a place in E, A or M that lies inside its area.
pub(crate) fn fixed(place: Place, bits: u32, l: &Lowering<'_>) -> Option<(u32, u8)> {
    let Place::Fixed(area, at) = place else { return None };
    let range = match area {
        Area::Input => l.memory.inputs,
        Area::Output => l.memory.outputs,
        Area::Memory => l.memory.memory,
        _ => return None,
    };
    range.locate(at.byte(), bits.div_ceil(8)).map(|byte| (byte, 1 << at.bit()))
}

/// A fully qualified operand of a data block that is loaded, long enough and, for writes, not protected.
fn in_db(place: Place, bits: u8, write: bool, l: &Lowering<'_>) -> Option<(u16, u32)> {
    let Place::InDb(number, at) = place else { return None };
    let db = l.memory.db(number)?;
    let end = u64::from(at.byte()) + u64::from(bits / 8);
    let room = if write { db.writable } else { db.len };
    (bits > 1 && end <= u64::from(room)).then_some((number, db.at + at.byte()))
}

fn based(place: Place, l: &Lowering<'_>) -> Option<(Base, u32)> {
    use ob1_ir::AddressRegister::{Ar1, Ar2};
    Some(match place {
        Place::Fixed(Area::Local, at) => (Base::Local, at.0),
        Place::Fixed(Area::Db, at) => (Base::Db, at.0),
        Place::Instance(at) => (Base::Instance, at.0),
        Place::Param { index, at } => (Base::Param(index), at.0),
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
                at.0,
            )
        }
        Place::Memory(area, pointer) if pointer.area == Area::Memory && area != Area::Peripheral => {
            let at = l.memory.memory.locate(pointer.at.byte(), 4)?;
            (Base::Pointer(area.pointer_code()), at)
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
