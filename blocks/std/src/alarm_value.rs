//! Associated values of alarms, as an ANY parameter names them.

use ob1_model::{AlarmValues, Area};

use crate::call::Call;
use crate::declare::Params;
use crate::{AnyPointer, AnyType};

/// What became of an associated value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Value {
    /// The parameter names none.
    None,
    Taken,
    /// It cannot be read, or is not of a permitted type or length; or it is local data. The message is sent.
    Bad,
    /// It is no ANY pointer.
    NoPointer,
}

/// Adds the value that `p` names, if it has at most so many bytes.
pub(crate) fn take(call: &mut Call<'_>, p: impl Params, most: usize, values: &mut AlarmValues) -> Value {
    let mut pointer = [0; 10];
    if call.cx.read(p.index(), 0, &mut pointer).is_err() || pointer == [0; 10] {
        return Value::None;
    }
    let Some(any) = AnyPointer::parse(&pointer) else { return Value::NoPointer };
    let len = match (any.ty, any.count) {
        (AnyType::Nil, _) | (_, 0) => return Value::None,
        (AnyType::Bool, 1) => 1,
        // Not permitted: bit fields, and strings.
        (AnyType::Bool | AnyType::String, _) => return Value::Bad,
        _ => any.bytes().map_or(usize::MAX, |bytes| bytes as usize),
    };
    let mut bytes = [0; u8::MAX as usize];
    let Some(bytes) = bytes.get_mut(..len).filter(|_| len <= most) else { return Value::Bad };
    if call.read_at(&any, 0, bytes).is_err() {
        return Value::Bad;
    }
    if any.ty == AnyType::Bool
        && let [byte] = bytes
    {
        *byte = *byte >> any.at.bit() & 1;
    }
    let is_local = matches!(any.area, Area::Local | Area::PreviousLocal);
    if values.push(any.ty as u8, bytes) && !is_local { Value::Taken } else { Value::Bad }
}
