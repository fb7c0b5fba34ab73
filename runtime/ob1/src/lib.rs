//! The `ob1` command as a library: the command line and the tools that look at a station. The station itself is in
//! `ob1-station`. The binary is thin.

// Everything goes through one place that neither panics nor waits forever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[macro_use(say, says, err, errs, note)]
extern crate ob1_station;

pub mod alarms;
pub mod bus;
pub mod check;
pub mod cli;
pub mod ctl;
pub mod debug;
pub mod diag;
pub mod diff;
pub mod driver;
pub mod exec;
pub mod exit;
pub mod force;
pub mod import;
pub mod language;
pub mod list;
mod live_text;
pub mod load;
pub mod new;
pub mod print;
pub mod record;
pub mod remote;
pub mod restart;
pub mod roll;
pub mod shadow;
pub mod show;
pub mod soak;
pub mod statistics;
pub mod status;
pub mod testing;
pub mod top;
pub mod trace;
mod units;
pub mod virtual_clock;
pub mod why;
pub mod xref;
