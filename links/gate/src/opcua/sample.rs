//! Values from snapshots, and outcomes of questions as status codes.

use crate::shared::Trouble;
use ob1_access::Typed;
use ob1_access::door::Refusal;
use opcua_types::{DataValue, DateTime, NumericRange, StatusCode, TimestampsToReturn, Variant};

use crate::opcua::range::part;
use crate::opcua::value::{Shape, cell_error, variant};

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

/// An attribute that is no value of a cell: it comes from no source at any time.
pub(crate) fn attribute_value(value: Variant) -> DataValue {
    let (status, now) = (Some(StatusCode::Good), Some(DateTime::now()));
    DataValue { value: Some(value), status, server_timestamp: now, ..DataValue::default() }
}

/// A value with the times that the client asks for [OPC 10000-4, 7.40].
pub(crate) fn stamped(mut value: DataValue, wanted: TimestampsToReturn) -> DataValue {
    if !matches!(wanted, TimestampsToReturn::Source | TimestampsToReturn::Both) {
        (value.source_timestamp, value.source_picoseconds) = (None, None);
    }
    if !matches!(wanted, TimestampsToReturn::Server | TimestampsToReturn::Both) {
        (value.server_timestamp, value.server_picoseconds) = (None, None);
    }
    value
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
        Refusal::InRun | Refusal::Block | Refusal::Room | Refusal::Watched => StatusCode::BadInvalidState,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_times_asked_for_come_with_a_value() {
        let times = |value: &DataValue| (value.source_timestamp.is_some(), value.server_timestamp.is_some());
        for (wanted, told) in [
            (TimestampsToReturn::Source, (true, false)),
            (TimestampsToReturn::Server, (false, true)),
            (TimestampsToReturn::Both, (true, true)),
            (TimestampsToReturn::Neither, (false, false)),
        ] {
            let value = stamped(DataValue::new_now(1_i16), wanted);
            assert_eq!(times(&value), told, "{wanted:?}");
            assert_eq!((value.source_picoseconds.is_some(), value.server_picoseconds.is_some()), told, "{wanted:?}");
        }
        assert_eq!(times(&attribute_value(Variant::Int16(1))), (false, true));
    }
}
