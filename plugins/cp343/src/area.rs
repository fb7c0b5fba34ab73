//! A pointer into the partner.

use ob1_any::pointer;
use ob1_sdk::types::Any;
use ob1_sdk::{Abort, Cx, Formal, Readable};
use ob1_words::any::{AnyType, BYTES};

use crate::state::CpState;

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
