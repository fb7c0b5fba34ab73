//! Values from snapshots, and outcomes of questions as status codes.

use ob1_access::Typed;
use ob1_access::door::Refusal;
use ob1_gate_core::Trouble;
use opcua_types::{DataValue, DateTime, NumericRange, StatusCode};

use crate::range::part;
use crate::value::{Shape, cell_error, variant};

/// The bytes of a snapshot as the value of a node.
pub(crate) fn sample(typed: &Typed, bytes: Result<&[u8], Refusal>) -> DataValue {
    let bytes = match bytes {
        Ok(bytes) => bytes,
        Err(refusal) => return bad(refused(refusal)),
    };
    let now = DateTime::now();
    let value = typed.value(bytes).zip(Shape::of(&typed.ty)).map(|(value, shape)| variant(value, &shape));
    DataValue {
        // The bytes are not a date or time: the status tells the client that the connection is not the cause.
        status: Some(if value.is_some() { StatusCode::Good } else { StatusCode::BadDataEncodingInvalid }),
        value,
        source_timestamp: Some(now),
        server_timestamp: Some(now),
        ..DataValue::default()
    }
}

/// The requested part of a value, if it is a part.
pub(crate) fn in_part(mut value: DataValue, range: &NumericRange) -> DataValue {
    if range.has_range()
        && let Some(whole) = value.value.take()
    {
        return part(&whole, range).map_or_else(bad, |part| DataValue { value: Some(part), ..value });
    }
    value
}

/// No value, and why.
pub(crate) fn bad(status: StatusCode) -> DataValue {
    DataValue { status: Some(status), server_timestamp: Some(DateTime::now()), ..DataValue::default() }
}

/// A refusal of the broker as a status code.
pub(crate) fn refused(refusal: Refusal) -> StatusCode {
    match refusal {
        Refusal::Cell(error) => cell_error(error),
        Refusal::Right | Refusal::Password => StatusCode::BadUserAccessDenied,
        Refusal::NotThere => StatusCode::BadNotFound,
        Refusal::Full => StatusCode::BadTooManyOperations,
        Refusal::InRun | Refusal::Block | Refusal::Room => StatusCode::BadInvalidState,
        Refusal::Silent => StatusCode::BadTimeout,
    }
}

/// An error as a status code.
pub(crate) fn status(trouble: &Trouble) -> StatusCode {
    match trouble {
        Trouble::Refused { why, .. } => refused(*why),
        Trouble::User => StatusCode::BadUserAccessDenied,
        Trouble::TooMuch | Trouble::Group => StatusCode::BadEncodingLimitsExceeded,
        Trouble::Gone => StatusCode::BadNoCommunication,
        Trouble::Audit(_) | Trouble::Program(_) => StatusCode::BadInternalError,
    }
}
