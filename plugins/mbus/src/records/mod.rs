//! Decodes the M-Bus answer of a meter into records of fixed size: the data records of EN 1434-3 with variable (CI 72h)
//! and fixed (CI 73h) structure. Total functions of the bytes that the CP passes to the program, without time and
//! without allocation: the crate is `no_std`.
//!
//! The crate `m-bus-application-layer` interprets DIF, VIF and their extensions. It is the part of `m-bus-parser` above
//! the link layer, which the CP has already handled. It gets the header of one record at a time, whose length is
//! measured here first ([`measure`]); the data are decoded here, without rounding (reasons:
//! docs/decisions/0005-m-bus-records.md).
//!
//! For numbers: `VALUE = RAW * 10^EXPONENT` in `UNIT`. RAW is the exact count of the meter; a REAL has only seven
//! digits.

mod answer;
mod fixed;
mod layout;
mod measure;
mod quantity;
mod record;
mod value;
mod variable;

pub use answer::Answer;
pub use layout::{HEADER_BYTES, RECORD_BYTES};
pub use measure::measure;
pub use quantity::{Quantity, Unit};
pub use record::{Fault, Header, Record, Value};
