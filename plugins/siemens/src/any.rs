//! The memory that an ANY parameter of a handling block points to, for the plugins that have such blocks.

use ob1_sdk::types::Any;
use ob1_sdk::{Abort, Area, Cx, Formal, Readable, Refused};
use ob1_words::any::{AnyType, BYTES, Fields};

/// A piece of memory: whole bytes, or one bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    area: Area,
    at: u32,
    bit: Option<u8>,
    /// Length in bytes; for a bit 1: the byte is 0 or 1.
    pub len: u32,
}

impl Span {
    /// A piece without bytes: no memory.
    pub const NONE: Self = Self { area: Area::Memory, at: 0, bit: None, len: 0 };

    /// The memory a parameter points to; `None` if a CP cannot send or receive it.
    pub fn of<S: Readable, M>(cx: &mut Cx<'_, M>, formal: Formal<Any, S>) -> Result<Option<Self>, Abort> {
        let Some(fields) = pointer(cx, formal)? else { return Ok(None) };
        let area = match fields.area {
            0x81 => Area::Input,
            0x82 => Area::Output,
            0x83 => Area::Memory,
            // Without a number: the open data block.
            0x84 if fields.db == 0 => Area::Db(cx.registers()?.db),
            0x85 if fields.db == 0 => Area::Db(cx.registers()?.di),
            0x84 | 0x85 => Area::Db(fields.db),
            0x86 | 0x87 => Area::CallerLocal,
            _ => return Ok(None),
        };
        let bits = u32::from(fields.count) * fields.ty.bits();
        let (at, bit) = (fields.start / 8, (fields.start % 8) as u8);
        Ok(match fields.ty {
            AnyType::Nil | AnyType::Counter | AnyType::Timer => None,
            AnyType::Bool if fields.count == 1 => Some(Self { area, at, bit: Some(bit), len: 1 }),
            _ if bits == 0 || !bits.is_multiple_of(8) || bit != 0 => None,
            _ => Some(Self { area, at, bit: None, len: bits / 8 }),
        })
    }

    /// The first `len` bytes of the piece.
    pub fn first(self, len: u32) -> Self {
        Self { len, ..self }
    }

    /// Reads a part that begins at byte `from` of the piece.
    pub fn read<M>(self, cx: &mut Cx<'_, M>, from: u32, into: &mut [u8]) -> Result<Result<(), Refused>, Abort> {
        match (self.bit, into) {
            (_, []) => Ok(Ok(())),
            (Some(bit), [first, ..]) => Ok(cx.bit(self.area, self.at, bit)?.map(|on| *first = u8::from(on))),
            (None, into) => cx.read(self.area, self.at + from, into),
        }
    }

    /// Writes a part that begins at byte `from` of the piece.
    pub fn write<M>(self, cx: &mut Cx<'_, M>, from: u32, bytes: &[u8]) -> Result<Result<(), Refused>, Abort> {
        match (self.bit, bytes) {
            (_, []) => Ok(Ok(())),
            (Some(bit), [first, ..]) => cx.set_bit(self.area, self.at, bit, first & 1 != 0),
            (None, bytes) => cx.write(self.area, self.at + from, bytes),
        }
    }
}

/// The fields of the ANY pointer in a parameter.
pub fn pointer<S: Readable, M>(cx: &mut Cx<'_, M>, formal: Formal<Any, S>) -> Result<Option<Fields>, Abort> {
    let mut bytes = [0; BYTES];
    Ok(match cx.get_bytes(formal, 0, &mut bytes)? {
        Ok(()) => Fields::read(&bytes),
        Err(_) => None,
    })
}

/// STATUS values for memory that cannot be read or written, and for a module that does not exist.
pub mod status {
    use ob1_sdk::Refused;

    /// The module does not exist.
    pub const NO_MODULE: u16 = 0x8090;
    /// The source area exceeds its data block.
    pub const SOURCE: u16 = 0x8F22;
    /// The target area exceeds its data block.
    pub const TARGET: u16 = 0x8F23;
    /// The data block is write-protected.
    const READ_ONLY: u16 = 0x8F30;
    /// The number is not valid for a data block.
    const DB_NUMBER: u16 = 0x8F32;
    /// The data block does not exist.
    const NO_DB: u16 = 0x8F3A;

    /// STATUS for memory that cannot be read or written; `outside` is the STATUS for an area that exceeds it.
    pub fn of_memory(refused: Refused, outside: u16) -> u16 {
        match refused {
            Refused::NoDb => NO_DB,
            Refused::DbNumber => DB_NUMBER,
            Refused::ReadOnly => READ_ONLY,
            _ => outside,
        }
    }
}
