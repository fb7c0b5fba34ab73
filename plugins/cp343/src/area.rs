//! The memory an ANY parameter names.

use ob1_sdk::types::Any;
use ob1_sdk::{Abort, Area, Cx, Formal, Readable, Refused};
use ob1_words::any::{AnyType, BYTES, Fields};

use crate::state::CpState;

/// A piece of memory: whole bytes, or one bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    area: Area,
    at: u32,
    bit: Option<u8>,
    /// Bytes; of a bit one, which is 0 or 1.
    pub(crate) len: u32,
}

impl Span {
    /// Nothing.
    pub(crate) const NONE: Self = Self { area: Area::Memory, at: 0, bit: None, len: 0 };

    /// What a parameter names; `None`: nothing a CP can send or receive.
    pub(crate) fn of<S: Readable>(cx: &mut Cx<'_, CpState>, formal: Formal<Any, S>) -> Result<Option<Self>, Abort> {
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
    pub(crate) fn first(self, len: u32) -> Self {
        Self { len, ..self }
    }

    /// Reads a part that begins `from` bytes behind the first.
    pub(crate) fn read(
        self,
        cx: &mut Cx<'_, CpState>,
        from: u32,
        into: &mut [u8],
    ) -> Result<Result<(), Refused>, Abort> {
        match (self.bit, into) {
            (_, []) => Ok(Ok(())),
            (Some(bit), [first, ..]) => Ok(cx.bit(self.area, self.at, bit)?.map(|on| *first = u8::from(on))),
            (None, into) => cx.read(self.area, self.at + from, into),
        }
    }

    /// Writes a part.
    pub(crate) fn write(self, cx: &mut Cx<'_, CpState>, from: u32, bytes: &[u8]) -> Result<Result<(), Refused>, Abort> {
        match (self.bit, bytes) {
            (_, []) => Ok(Ok(())),
            (Some(bit), [first, ..]) => cx.set_bit(self.area, self.at, bit, first & 1 != 0),
            (None, bytes) => cx.write(self.area, self.at + from, bytes),
        }
    }
}

/// The fields of a parameter.
fn pointer<S: Readable>(cx: &mut Cx<'_, CpState>, formal: Formal<Any, S>) -> Result<Option<Fields>, Abort> {
    let mut bytes = [0; BYTES];
    Ok(match cx.get_bytes(formal, 0, &mut bytes)? {
        Ok(()) => Fields::read(&bytes),
        Err(_) => None,
    })
}

/// A pointer into the partner, as it goes over the wire, and how many bytes it names.
pub(crate) fn remote<S: Readable>(
    cx: &mut Cx<'_, CpState>,
    formal: Formal<Any, S>,
) -> Result<Option<([u8; BYTES], u32)>, Abort> {
    let Some(mut fields) = pointer(cx, formal)? else { return Ok(None) };
    let bits = u32::from(fields.count) * fields.ty.bits();
    // What the wire has no type for, or another code, is its bytes.
    if matches!(fields.ty, AnyType::String | AnyType::DateAndTime) {
        let Ok(count) = u16::try_from(bits / 8) else { return Ok(None) };
        (fields.ty, fields.count) = (AnyType::Byte, count);
    }
    let len = if fields.ty == AnyType::Bool && fields.count == 1 { 1 } else { bits / 8 };
    // Eight bits in a row travel as a byte.
    if fields.ty == AnyType::Bool && fields.count > 1 {
        if !bits.is_multiple_of(8) || fields.start % 8 != 0 {
            return Ok(None);
        }
        (fields.ty, fields.count) = (AnyType::Byte, fields.count / 8);
    }
    Ok((len > 0).then(|| (fields.bytes(), len)))
}
