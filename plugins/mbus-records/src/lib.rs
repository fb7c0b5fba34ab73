//! What a meter's M-Bus answer says, as records of a fixed size: the data records of EN 1434-3 with variable (CI 72h)
//! and fixed (CI 73h) structure. Total functions over the bytes that the CP hands to the program, without time and
//! without allocation.
//!
//! What DIF, VIF and their extensions mean says the crate `m-bus-application-layer`, the part of `m-bus-parser`
//! behind the link layer, which our CP has done already. It is given the head of one record at a time, whose extent has
//! been measured here before ([`measure`]); the data are decoded here, exactly (docs/decisions/0005-m-bus-records.md
//! says why).
//!
//! Law of the numbers: `VALUE = RAW * 10^EXPONENT` in `UNIT`. RAW is what the meter counts, to the last digit; a REAL
//! has no more than seven.
#![no_std]

mod answer;
mod fixed;
mod layout;
mod measure;
mod quantity;
mod value;
mod variable;

pub use answer::{Answer, Fault, Header, Record, Value};
pub use layout::{HEADER_BYTES, RECORD_BYTES};
pub use measure::measure;
pub use quantity::{Quantity, Unit};
