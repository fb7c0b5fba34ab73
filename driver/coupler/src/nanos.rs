//! A span in a text: nanoseconds. For `#[serde(with)]`.

use ob1_protocols::Span;
use serde::{Deserialize as _, Deserializer, Serializer};

/// Writes a span as a whole number of nanoseconds.
///
/// # Errors
/// The serializer cannot write a number.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
pub fn serialize<S: Serializer>(span: &Span, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_u64(span.nanos())
}

/// Reads a whole number of nanoseconds.
///
/// # Errors
/// It is not a number.
pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Span, D::Error> {
    u64::deserialize(from).map(Span::from_nanos)
}
