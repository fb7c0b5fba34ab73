//! The areas of a block in this CPU, and pointers to areas in the partner.

use ob1_sdk::types::Any;
use ob1_sdk::{Abort, Cx, Formal, Readable, Refused};
use ob1_siemens::any::{Span, pointer};
use ob1_words::any::{AnyType, BYTES, Fields};
use ob1_words::boxes::ITEMS_MAX;

use crate::state::CpState;

/// Pieces of memory, one after the other: one for blocks of an S7-300, up to four for those of an S7-400.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Spans {
    all: [Span; ITEMS_MAX],
    count: usize,
}

impl Spans {
    /// No memory at all, for blocks without data.
    pub(crate) const NONE: Self = Self { all: [Span::NONE; ITEMS_MAX], count: 0 };

    /// The areas in the parameters of a block, from the first on. `None` if there is no area, a gap between areas, or
    /// an area that a CP cannot send or receive.
    pub(crate) fn of<S: Readable>(cx: &mut Cx<'_, CpState>, formals: &[Formal<Any, S>]) -> Result<Option<Self>, Abort> {
        let mut spans = Self::NONE;
        let mut open = false;
        for formal in formals {
            if is_open(cx, *formal)? {
                open = true;
                continue;
            }
            match Span::of(cx, *formal)? {
                Some(span) if !open => spans.push(span),
                _ => return Ok(None),
            }
        }
        Ok((spans.count > 0).then_some(spans))
    }

    /// Adds a piece, up to [`ITEMS_MAX`].
    pub(crate) fn push(&mut self, span: Span) {
        if let Some(place) = self.all.get_mut(self.count) {
            *place = span;
            self.count += 1;
        }
    }

    /// The pieces in their order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Span> {
        self.all.iter().take(self.count)
    }

    /// Length of all pieces in bytes.
    pub(crate) fn len(&self) -> u32 {
        self.iter().map(|span| span.len).sum()
    }

    /// Reads a part that begins at byte `from`.
    pub(crate) fn read(
        &self,
        cx: &mut Cx<'_, CpState>,
        from: u32,
        into: &mut [u8],
    ) -> Result<Result<(), Refused>, Abort> {
        let (mut from, mut into) = (from, into);
        for span in self.iter() {
            let here = (span.len.saturating_sub(from) as usize).min(into.len());
            let (part, rest) = std::mem::take(&mut into).split_at_mut(here);
            if let Err(refused) = span.read(cx, from, part)? {
                return Ok(Err(refused));
            }
            (from, into) = (from.saturating_sub(span.len), rest);
        }
        Ok(Ok(()))
    }

    /// Writes a part that begins at byte `from`.
    pub(crate) fn write(
        &self,
        cx: &mut Cx<'_, CpState>,
        from: u32,
        bytes: &[u8],
    ) -> Result<Result<(), Refused>, Abort> {
        let (mut from, mut bytes) = (from, bytes);
        for span in self.iter() {
            let here = (span.len.saturating_sub(from) as usize).min(bytes.len());
            let (part, rest) = bytes.split_at(here);
            if let Err(refused) = span.write(cx, from, part)? {
                return Ok(Err(refused));
            }
            (from, bytes) = (from.saturating_sub(span.len), rest);
        }
        Ok(Ok(()))
    }
}

impl From<Span> for Spans {
    fn from(span: Span) -> Self {
        let mut spans = Self::NONE;
        spans.push(span);
        spans
    }
}

/// Whether a parameter has no value, or is a nil pointer.
pub(crate) fn is_open<S: Readable>(cx: &mut Cx<'_, CpState>, formal: Formal<Any, S>) -> Result<bool, Abort> {
    let mut bytes = [0; BYTES];
    Ok(match cx.get_bytes(formal, 0, &mut bytes)? {
        Ok(()) => bytes == [0; BYTES] || Fields::read(&bytes).is_some_and(|fields| fields.ty == AnyType::Nil),
        Err(_) => true,
    })
}

/// A pointer to an area in the partner as it is transmitted, and the length of the area in bytes.
pub(crate) fn remote<S: Readable>(
    cx: &mut Cx<'_, CpState>,
    formal: Formal<Any, S>,
) -> Result<Option<([u8; BYTES], u32)>, Abort> {
    let Some(mut fields) = pointer(cx, formal)? else { return Ok(None) };
    let bits = u32::from(fields.count) * fields.ty.bits();
    // Types that the protocol lacks or codes differently are sent as bytes.
    if matches!(fields.ty, AnyType::String | AnyType::DateAndTime) {
        let Ok(count) = u16::try_from(bits / 8) else { return Ok(None) };
        (fields.ty, fields.count) = (AnyType::Byte, count);
    }
    let len = if fields.ty == AnyType::Bool && fields.count == 1 { 1 } else { bits / 8 };
    // Multiples of eight bits are sent as bytes.
    if fields.ty == AnyType::Bool && fields.count > 1 {
        if !bits.is_multiple_of(8) || fields.start % 8 != 0 {
            return Ok(None);
        }
        (fields.ty, fields.count) = (AnyType::Byte, fields.count / 8);
    }
    Ok((len > 0).then(|| (fields.bytes(), len)))
}
