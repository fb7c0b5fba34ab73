//! What SCL means: statements, and each line of the reference sheet (`scl.md`, sections 4, 5, 7 and 8) as rows that are
//! run on the reference engine. A row begins with its section and line there; docs/scl.md says what was decided where
//! the sheet has no certain source.
#![allow(missing_docs, unreachable_pub, reason = "a test")]

mod common;
mod files;
mod functions;
mod nothing_is_lost;
mod order;
mod statements;
mod status;
mod texts;
mod types;
