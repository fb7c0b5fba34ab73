//! POINTER and ANY that are put together at run time, in local data that no source names: the operations, where they
//! put it, and how to recognise them.

use ob1_model::{Area, BitAddr, DataType, Layout};

use crate::{AddressRegister, Arg, DbRegister, NumberFormat, Op, Operand, Place, Stmt, Width, WordLogic};

/// The type codes of an ANY [STL reference, "Format of the Parameter Type ANY"].
pub const ANY_TYPES: [(&str, u8); 20] = [
    ("BOOL", 0x01),
    ("BYTE", 0x02),
    ("CHAR", 0x03),
    ("WORD", 0x04),
    ("INT", 0x05),
    ("DWORD", 0x06),
    ("DINT", 0x07),
    ("REAL", 0x08),
    ("DATE", 0x09),
    ("TIME_OF_DAY", 0x0A),
    ("TOD", 0x0A),
    ("TIME", 0x0B),
    ("S5TIME", 0x0C),
    ("DATE_AND_TIME", 0x0E),
    ("DT", 0x0E),
    ("STRING", 0x13),
    ("COUNTER", 0x1C),
    ("TIMER", 0x1D),
    ("NIL", 0x00),
    ("VOID", 0x00),
];

/// Type code and number of elements of an ANY to an operand; composed variables count in bytes.
pub fn any_length(operand: Operand, actual: Option<&DataType>) -> (u8, u16) {
    if let Some(code) = actual
        .filter(|ty| ty.elementary_bits().is_some())
        .and_then(|ty| ANY_TYPES.iter().find(|(name, _)| *name == ty.name()))
    {
        return (code.1, 1);
    }
    if let Some(ty) = actual {
        return (2, (Layout::bits(ty) / 8).min(u32::from(u16::MAX)) as u16);
    }
    match operand.width {
        Width::Bit => (1, 1),
        Width::Byte => (2, 1),
        Width::Word => (4, 1),
        Width::DWord => (6, 1),
    }
}

/// Where hidden local data lies until it is known how much the block itself uses: beyond every address a source can
/// write.
pub const KEPT: u32 = 0x1_0000;
/// The same for what one statement uses alone.
pub const SHARED: u32 = 0x2_0000;

fn instance(width: Width, at: BitAddr) -> Operand {
    Operand { width, place: Place::Instance(at) }
}

/// An operand in the local data.
pub fn local(width: Width, byte: u32) -> Operand {
    Operand { width, place: Place::Fixed(Area::Local, BitAddr::byte_addr(byte)) }
}

/// Where a POINTER or ANY that is composed at run time points.
#[derive(Clone, Copy, Debug)]
pub enum Pointee {
    /// An address in the instance.
    Instance(BitAddr),
    /// An offset beyond what the POINTER at the first address names.
    Through(BitAddr, BitAddr),
}

/// Puts a POINTER (6 bytes) together at a place; with a type and count an ANY (10 bytes). `place` gives the operand of
/// a width so many bytes into it.
pub fn pointer(place: &dyn Fn(Width, u32) -> Operand, to: Pointee, any: Option<(u8, u16)>, before: &mut Vec<Op>) {
    let mut at = 0;
    if let Some((code, count)) = any {
        before.push(Op::LoadConst(0x1000_0000 | (u32::from(code) << 16) | u32::from(count)));
        before.push(Op::Transfer(place(Width::DWord, at)));
        at += 4;
    }
    match to {
        Pointee::Instance(offset) => {
            before.push(Op::LoadDbNumber(DbRegister::Di));
            before.push(Op::Transfer(place(Width::Word, at)));
            // AR2 holds where the instance begins, with the area DI; a pointer that is passed on names the data block
            // itself.
            before.push(Op::TransferAr(AddressRegister::Ar2));
            before.push(Op::DWordLogic(WordLogic::And, Some(0x00FF_FFFF)));
            before.push(Op::AddConst { format: NumberFormat::DInt, value: offset.0 as i32 });
            before.push(Op::DWordLogic(WordLogic::Or, Some(u32::from(Area::Db.pointer_code()) << 24)));
        }
        Pointee::Through(pointer, offset) => {
            before.push(Op::Load(instance(Width::Word, pointer)));
            before.push(Op::Transfer(place(Width::Word, at)));
            before.push(Op::Load(instance(Width::DWord, BitAddr(pointer.0 + 16))));
            if offset.0 > 0 {
                before.push(Op::AddConst { format: NumberFormat::DInt, value: offset.0 as i32 });
            }
        }
    }
    before.push(Op::Transfer(place(Width::DWord, at + 2)));
}

/// A POINTER or ANY to a variable of the own instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handed {
    /// Byte of the local data where it is put together.
    pub byte: u32,
    /// Type code and count of an ANY.
    pub any: Option<(u8, u16)>,
    /// Where the variable lies in the instance.
    pub to: BitAddr,
}

impl Handed {
    /// The operations that put it together.
    pub fn ops(&self) -> Vec<Op> {
        let mut ops = Vec::new();
        pointer(&|width, byte| local(width, self.byte + byte), Pointee::Instance(self.to), self.any, &mut ops);
        ops
    }

    /// What hands it over.
    pub fn arg(&self) -> Arg {
        Arg::Operand(local(Width::Byte, self.byte))
    }

    /// The one that is put together where this code begins.
    pub fn at(code: &[Stmt]) -> Option<Self> {
        let op = |at: usize| code.get(at).map(|stmt| &stmt.op);
        let (any, rest) = match op(0)? {
            Op::LoadConst(head) if head >> 24 == 0x10 => (Some(((head >> 16) as u8, *head as u16)), 2),
            _ => (None, 0),
        };
        let Op::Transfer(Operand { place: Place::Fixed(Area::Local, first), .. }) = op(1)? else { return None };
        let Op::AddConst { value, .. } = op(rest + 4)? else { return None };
        let found = Self { byte: first.byte(), any, to: BitAddr(u32::try_from(*value).ok()?) };
        let ops = found.ops();
        let same = code.len() >= ops.len() && code.iter().zip(&ops).all(|(stmt, op)| stmt.op == *op);
        same.then_some(found)
    }

    /// Whether something of this type can be its variable.
    pub fn fits(&self, ty: &DataType) -> bool {
        !matches!(ty, DataType::Any | DataType::Pointer)
            && self.any.is_none_or(|any| any == any_length(instance(Width::Byte, self.to), Some(ty)))
    }
}

/// The final places of the two parts of the hidden local data.
#[derive(Clone, Copy, Debug)]
pub struct Placing {
    /// Byte at which begins what is kept for the whole block.
    pub kept: u32,
    /// Byte at which begins what one statement uses alone.
    pub shared: u32,
}

impl Placing {
    fn byte(&self, byte: u32) -> u32 {
        match byte {
            SHARED.. => byte - SHARED + self.shared,
            KEPT.. => byte - KEPT + self.kept,
            _ => byte,
        }
    }

    fn operand(&self, operand: Operand) -> Operand {
        match operand.place {
            Place::Fixed(Area::Local, at) => {
                let at = BitAddr::new(self.byte(at.byte()), at.bit());
                Operand { place: Place::Fixed(Area::Local, at), ..operand }
            }
            _ => operand,
        }
    }

    /// The operation with its places; `points`: its own constant is a pointer into the hidden local data.
    pub fn op(&self, op: Op, points: bool) -> Op {
        let bits = |v: u32| (v & 0xFF00_0000) | (self.byte((v & 0x00FF_FFFF) / 8) * 8);
        match op {
            Op::Load(o) => Op::Load(self.operand(o)),
            Op::Transfer(o) => Op::Transfer(self.operand(o)),
            Op::LoadArFrom(r, o) => Op::LoadArFrom(r, self.operand(o)),
            Op::TransferArTo(r, o) => Op::TransferArTo(r, self.operand(o)),
            Op::LoadParamPointer { index, at: Some(at) } => {
                Op::LoadParamPointer { index, at: Some(BitAddr::byte_addr(self.byte(at.byte()))) }
            }
            Op::LoadParamCopy { index, bytes, at } => {
                Op::LoadParamCopy { index, bytes, at: BitAddr::byte_addr(self.byte(at.byte())) }
            }
            Op::LoadConst(v) if points => Op::LoadConst(bits(v)),
            Op::LoadArConst(r, v) if points => Op::LoadArConst(r, bits(v)),
            Op::Call(mut call) => {
                for arg in &mut call.args {
                    if let Arg::Operand(o) = arg {
                        *o = self.operand(*o);
                    }
                }
                Op::Call(call)
            }
            other => other,
        }
    }
}
