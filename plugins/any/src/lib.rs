//! The memory an ANY parameter of a handling block names, for the plugins whose blocks have one.
#![forbid(unsafe_code)]

use ob1_sdk::types::Any;
use ob1_sdk::{Abort, Area, Cx, Formal, Readable, Refused};
use ob1_words::any::{AnyType, BYTES, Fields};

/// A piece of memory: whole bytes, or one bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    area: Area,
    at: u32,
    bit: Option<u8>,
    /// Bytes; of a bit one, which is 0 or 1.
    pub len: u32,
}

impl Span {
    /// Nothing.
    pub const NONE: Self = Self { area: Area::Memory, at: 0, bit: None, len: 0 };

    /// What a parameter names; `None`: nothing a CP can send or receive.
    pub fn of<S: Readable, M>(cx: &mut Cx<'_, M>, formal: Formal<Any, S>) -> Result<Option<Self>, Abort> {
        let Some(fields) = pointer(cx, formal)? else { return Ok(None) };
        let area = match fields.area {
            0x81 => Area::Input,
            0x82 => Area::Output,
            0x83 => Area::Memory,
            // Without a number: the one that is open.
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

    /// The first bytes of it.
    pub fn first(self, len: u32) -> Self {
        Self { len, ..self }
    }

    /// Reads a part that begins `from` bytes behind the first.
    pub fn read<M>(self, cx: &mut Cx<'_, M>, from: u32, into: &mut [u8]) -> Result<Result<(), Refused>, Abort> {
        match (self.bit, into) {
            (_, []) => Ok(Ok(())),
            (Some(bit), [first, ..]) => Ok(cx.bit(self.area, self.at, bit)?.map(|on| *first = u8::from(on))),
            (None, into) => cx.read(self.area, self.at + from, into),
        }
    }

    /// Writes a part.
    pub fn write<M>(self, cx: &mut Cx<'_, M>, from: u32, bytes: &[u8]) -> Result<Result<(), Refused>, Abort> {
        match (self.bit, bytes) {
            (_, []) => Ok(Ok(())),
            (Some(bit), [first, ..]) => cx.set_bit(self.area, self.at, bit, first & 1 != 0),
            (None, bytes) => cx.write(self.area, self.at + from, bytes),
        }
    }
}

/// The fields of a parameter.
pub fn pointer<S: Readable, M>(cx: &mut Cx<'_, M>, formal: Formal<Any, S>) -> Result<Option<Fields>, Abort> {
    let mut bytes = [0; BYTES];
    Ok(match cx.get_bytes(formal, 0, &mut bytes)? {
        Ok(()) => Fields::read(&bytes),
        Err(_) => None,
    })
}

/// STATUS of blocks whose parameter names memory that cannot be read or written, or a module that is not there.
pub mod status {
    use ob1_sdk::Refused;

    /// There is no such module.
    pub const NO_MODULE: u16 = 0x8090;
    /// The area that is read reaches beyond its data block.
    pub const SOURCE: u16 = 0x8F22;
    /// The area that is written reaches beyond its data block.
    pub const TARGET: u16 = 0x8F23;
    /// The data block is write-protected.
    const READ_ONLY: u16 = 0x8F30;
    /// There can be no data block with this number.
    const DB_NUMBER: u16 = 0x8F32;
    /// The data block is not there.
    const NO_DB: u16 = 0x8F3A;

    /// Why memory cannot be read or written; `outside` where it reaches beyond its end.
    #[must_use]
    pub fn of_memory(refused: Refused, outside: u16) -> u16 {
        match refused {
            Refused::NoDb => NO_DB,
            Refused::DbNumber => DB_NUMBER,
            Refused::ReadOnly => READ_ONLY,
            _ => outside,
        }
    }
}
