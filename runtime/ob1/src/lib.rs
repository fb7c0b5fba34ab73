//! The `ob1` command as a library: the station file, the build of a station, and what the subcommands do. The binary is
//! thin, and the whole-station simulation reads the same station files through this crate.

// Everything goes through one place that neither panics nor waits for ever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[macro_use]
mod out;

pub mod access;
pub mod assembly;
pub mod check;
pub mod cli;
pub mod diag;
pub mod exec;
pub mod exit;
pub mod fence;
pub mod finding;
mod folder;
pub mod guardian;
mod handling;
pub mod import;
pub mod io;
pub mod janitor;
pub mod library;
mod numbers;
mod offer;
pub mod posture;
pub mod program;
pub mod remote;
pub mod retentive;
pub mod run;
pub mod rundir;
pub mod simulated;
pub mod soak;
pub mod station;
pub mod testing;
pub mod timing;
pub mod top;
pub mod trace;
pub mod view;
pub mod virtual_clock;
pub mod watched;
pub mod xref;
