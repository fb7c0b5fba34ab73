//! Statements that need more than one operation: what STEP 7 puts before and after a statement to reach what has no
//! address of its own, and the hidden local data it does that with.
//!
//! A composed in/out of a function block lies in the instance as a POINTER. To reach a component, STEP 7 opens the data
//! block the POINTER names and loads AR1 from it, so that the DB register and AR1 are changed by such a statement; so
//! do we. An ANY or POINTER to instance data is composed at run time from DINO and AR2, in the local data; ACCU1
//! and ACCU2 are changed by such a call, as by any CALL of STEP 7. A POINTER for a composed in/out is written into the
//! instance itself before the call, which changes the DB register if that is a data block of its own.

use std::collections::BTreeMap;

use ob1_ir::compose::{KEPT, Placing, SHARED, local};
use ob1_ir::{AccuOp, AddressRegister, Convert, DbRegister, Number, NumberFormat, Op, Operand, Place, Stmt, Width};
use ob1_model::{Area, BitAddr};

use crate::constant::ToParam;
use crate::value::Term;

/// The operations that one statement becomes: those before, itself, those after.
#[derive(Debug, Default)]
pub(crate) struct Around {
    pub(crate) before: Vec<Op>,
    pub(crate) after: Vec<Op>,
    /// The statement's own constant is a pointer into the hidden local data.
    pub(crate) points: bool,
    /// The POINTER that AR1 and the DB register must come from when the statement itself begins.
    pub(crate) reached: Option<BitAddr>,
    /// The instance that is called, when it is a function block's.
    pub(crate) callee: Option<Callee>,
}

impl Around {
    /// True when what comes before the statement changes the DB register.
    pub(crate) fn opens_db(&self) -> bool {
        let opens = |op: &Op| {
            matches!(op, Op::OpenDb(DbRegister::Db, _) | Op::Transfer(Operand { place: Place::InDb(..), .. }))
        };
        self.reached.is_some() || self.before.iter().any(opens)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.before.is_empty() && self.after.is_empty() && self.reached.is_none() && !self.points
    }
}

/// The hidden local data of a block.
#[derive(Debug, Default)]
pub(crate) struct Hidden {
    /// Bytes kept for the whole block.
    kept: u32,
    /// Bytes the present statement uses, and the most that one used.
    used: u32,
    most: u32,
    /// The copies of POINTER and ANY parameters.
    copies: BTreeMap<u16, u32>,
}

impl Hidden {
    /// A new statement begins: what the last one used is free.
    pub(crate) fn next_statement(&mut self) {
        self.used = 0;
    }

    /// Bytes for this statement, even.
    pub(crate) fn take(&mut self, bytes: u32) -> u32 {
        let at = SHARED + self.used;
        self.used += bytes.next_multiple_of(2);
        self.most = self.most.max(self.used);
        at
    }

    /// Local data in all.
    pub(crate) fn bytes(&self) -> u32 {
        self.kept + self.most
    }
}

fn instance(width: Width, at: BitAddr, byte: u32) -> Operand {
    Operand { width, place: Place::Instance(BitAddr(at.0 + byte * 8)) }
}

/// Opens what the POINTER at `pointer` of the instance names: data block into the DB register, address into AR1.
pub(crate) fn open(pointer: BitAddr) -> [Op; 2] {
    [
        Op::OpenDb(DbRegister::Db, Number::Instance(pointer)),
        Op::LoadArFrom(AddressRegister::Ar1, instance(Width::DWord, pointer, 2)),
    ]
}

/// The instance of a function block that is called.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Callee {
    /// An instance data block.
    Data(u16),
    /// Within the caller's own instance.
    Own(BitAddr),
}

impl Callee {
    /// An operand in the instance.
    pub(crate) fn operand(self, width: Width, at: BitAddr) -> Operand {
        let place = match self {
            Callee::Data(db) => Place::InDb(db, at),
            Callee::Own(start) => Place::Instance(BitAddr(start.0 + at.0)),
        };
        Operand { width, place }
    }
}

/// Loads AR1 for an element whose index is known at run time only. Everything else is kept, except the DB register if
/// the array lies in a data block. Gives the operand of the element, relative to AR1.
pub(crate) fn index(
    hidden: &mut Hidden,
    operand: Operand,
    through: Option<BitAddr>,
    terms: &[Term],
    ops: &mut Vec<Op>,
) -> Indexed {
    use NumberFormat::DInt;
    let at = hidden.take(20);
    let [accu1, accu2, status, ar1, sum] = [0, 4, 8, 12, 16].map(|byte| local(Width::DWord, at + byte));
    let status = Operand { width: Width::Word, ..status };
    ops.extend([Op::Transfer(accu1), Op::ExchangeAccus, Op::Transfer(accu2)]);
    ops.extend([Op::LoadStatus, Op::Transfer(status), Op::TransferArTo(AddressRegister::Ar1, ar1)]);
    for (count, term) in terms.iter().enumerate() {
        ops.push(Op::Load(term.index));
        if term.int {
            ops.push(Op::Convert(Convert::Itd));
        }
        ops.push(Op::AddConst { format: DInt, value: term.low.saturating_neg() });
        ops.extend([Op::LoadConst(term.stride), Op::Arithmetic(DInt, AccuOp::Mul)]);
        if count > 0 {
            ops.extend([Op::Load(sum), Op::Arithmetic(DInt, AccuOp::Add)]);
        }
        ops.push(Op::Transfer(sum));
    }
    // Where AR1 counts from: an address that is known at run time only is added.
    let (area, first, base) = match (operand.place, through) {
        (Place::Register(_, _, first), Some(pointer)) => {
            ops.push(Op::OpenDb(DbRegister::Db, Number::Instance(pointer)));
            (None, first, Some(Op::Load(instance(Width::DWord, pointer, 2))))
        }
        // AR2 says where in the data block of the DI register the instance begins.
        (Place::Instance(first), _) => (Some(Area::Di), first, Some(Op::TransferAr(AddressRegister::Ar2))),
        (Place::InDb(db, first), _) => {
            ops.push(Op::OpenDb(DbRegister::Db, Number::Fixed(db)));
            (Some(Area::Db), first, None)
        }
        (Place::InDi(db, first), _) => {
            ops.push(Op::OpenDb(DbRegister::Di, Number::Fixed(db)));
            (Some(Area::Di), first, None)
        }
        (Place::Fixed(area, first), _) => (Some(area), first, None),
        (other, _) => return Indexed { operand: Operand { place: other, ..operand }, restore: None },
    };
    if let Some(base) = base {
        ops.extend([base, Op::Load(sum), Op::Arithmetic(DInt, AccuOp::Add), Op::Transfer(sum)]);
    }
    ops.push(Op::LoadArFrom(AddressRegister::Ar1, sum));
    ops.extend([Op::Load(status), Op::TransferStatus, Op::Load(accu2), Op::Load(accu1)]);
    let place = Place::Register(area, AddressRegister::Ar1, first);
    let restore = Some(Op::LoadArFrom(AddressRegister::Ar1, ar1));
    Indexed { operand: Operand { place, ..operand }, restore }
}

/// An element whose address AR1 has.
#[derive(Debug)]
pub(crate) struct Indexed {
    pub(crate) operand: Operand,
    /// The operation that restores AR1; `None`: nothing uses it.
    pub(crate) restore: Option<Op>,
}

/// Moves a value between the place a POINTER leads to and the hidden local data; `out` from there to the place. Bits
/// move with their byte, inwards only.
pub(crate) fn move_through(pointer: BitAddr, operand: Operand, byte: u32, out: bool, ops: &mut Vec<Op>) {
    ops.extend(open(pointer));
    let width = if operand.width == Width::Bit { Width::Byte } else { operand.width };
    let place = match operand.place {
        Place::Register(area, register, at) => Place::Register(area, register, BitAddr::byte_addr(at.byte())),
        other => other,
    };
    let (there, here) = (Operand { width, place }, local(width, byte));
    ops.push(Op::Load(if out { here } else { there }));
    ops.push(Op::Transfer(if out { there } else { here }));
}

/// The pointer to a function's parameter into ACCU1, or into an address register with the accumulators kept. That to a
/// composed one leads to its POINTER in the hidden local data, that to a POINTER or ANY to a copy of it there.
pub(crate) fn param_pointer(
    hidden: &mut Hidden,
    index: u16,
    kind: ToParam,
    register: Option<AddressRegister>,
    around: &mut Around,
) -> Op {
    let Hidden { kept, copies, .. } = hidden;
    let mut place = |bytes: u8| {
        let byte = *copies.entry(index).or_insert_with(|| {
            let at = KEPT + *kept;
            *kept += u32::from(bytes);
            at
        });
        BitAddr::byte_addr(byte)
    };
    let load = match kind {
        ToParam::Actual => Op::LoadParamPointer { index, at: None },
        ToParam::Pointer => Op::LoadParamPointer { index, at: Some(place(6)) },
        ToParam::Copy(bytes) => Op::LoadParamCopy { index, bytes, at: place(bytes) },
    };
    let Some(register) = register else { return load };
    let saved = hidden.take(8);
    let (accu1, accu2) = (local(Width::DWord, saved), local(Width::DWord, saved + 4));
    around.before.extend([Op::Transfer(accu1), Op::ExchangeAccus, Op::Transfer(accu2), load]);
    around.after.extend([Op::Load(accu2), Op::Load(accu1)]);
    Op::LoadAr(register)
}

/// Puts the operations around the statements into the code, and the hidden local data after the `temp_bytes` of the
/// block's own. Jump targets follow.
pub(crate) fn expand(code: Vec<Stmt>, around: BTreeMap<u32, Around>, hidden: &Hidden, temp_bytes: u32) -> Vec<Stmt> {
    if around.is_empty() {
        return code;
    }
    let mut around = around;
    for one in around.values_mut() {
        one.before.extend(one.reached.take().into_iter().flat_map(open));
    }
    let mut starts = Vec::with_capacity(code.len());
    let mut next = 0u32;
    for index in 0..code.len() as u32 {
        starts.push(next);
        next += 1 + around.get(&index).map_or(0, |a| (a.before.len() + a.after.len()) as u32);
    }
    let place = Placing { kept: temp_bytes, shared: temp_bytes + hidden.kept };
    let start = |to: u32| starts.get(to as usize).copied().unwrap_or(to);
    let mut out = Vec::with_capacity(next as usize);
    for (index, mut stmt) in (0u32..).zip(code) {
        aim(&mut stmt.op, start);
        let Around { before, after, points, .. } = around.remove(&index).unwrap_or_default();
        let (network, line) = (stmt.network, stmt.line);
        let with = |op| Stmt { op: place.op(op, false), network, line };
        out.extend(before.into_iter().map(with));
        out.push(Stmt { op: place.op(stmt.op, points), network, line });
        out.extend(after.into_iter().map(with));
    }
    out
}

/// Puts operations before all others. No jump leads to them.
pub(crate) fn begin_with(first: Vec<Op>, code: Vec<Stmt>) -> Vec<Stmt> {
    let Some((network, line)) = code.first().map(|stmt| (stmt.network, stmt.line)) else { return code };
    let shift = first.len() as u32;
    let mut out: Vec<Stmt> = first.into_iter().map(|op| Stmt { op, network, line }).collect();
    for mut stmt in code {
        aim(&mut stmt.op, |to| to + shift);
        out.push(stmt);
    }
    out
}

/// Gives the targets of a jump their new places.
fn aim(op: &mut Op, place: impl Fn(u32) -> u32) {
    match op {
        Op::Jump(_, to) | Op::Loop(to) => *to = place(*to),
        Op::JumpList { targets, otherwise } => {
            targets.iter_mut().for_each(|to| *to = place(*to));
            *otherwise = place(*otherwise);
        }
        _ => {}
    }
}
