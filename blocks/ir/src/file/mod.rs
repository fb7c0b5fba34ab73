//! The file form of a program: everything there is in it, as lines of text. [`write()`] and [`parse`] are each other's
//! inverse, so that a program for an engine's test can be a file.
//!
//! ```text
//! source "pump.awl"
//! symbol "start" "E 0.0" says "button on" BOOL
//! block FC 1 source 0 instance 0 local 4 "MIX"
//!   IN "x" @0.0 INT
//!   1/12 L PAR0W+0
//!   1/13 T MW 4
//! data DB 7 "TANK" of FB 3 read_only non_retain
//!   at "level" @0.0 INT
//!   bytes 00FF
//! ```
//!
//! A statement follows its network and line, in the form of a listing. Blank lines and lines that begin with `;` are
//! left out.

mod cursor;
mod operands;
mod ops;
mod program;
#[cfg(test)]
mod tests;
mod types;
mod write;

pub use program::{ParseError, parse};
pub use write::write;
