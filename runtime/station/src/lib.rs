//! What a running station is: its build from the station file, the run, what it keeps and what it tells.
//!
//! The tools that look at one (`runtime/ob1`), a service, a link and the simulation hold a station through this crate.

// Everything goes through one place that neither panics nor waits forever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[macro_use]
pub mod out;

pub mod access;
mod area_check;
pub mod assembly;
pub mod bus_view;
pub mod compiling;
pub mod confinement;
pub mod download;
pub mod drivers;
pub mod engine;
pub mod exit;
pub mod forced;
pub mod guardian;
mod handling_check;
pub mod io;
mod kept_process;
pub mod links;
pub mod look;
pub mod missing_blocks;
pub mod numbers;
pub mod plugins;
pub mod posture;
pub mod program;
pub mod program_facts;
mod reason_texts;
mod recording;
pub mod retentive;
pub mod run;
pub mod rundir;
pub mod simulated;
pub mod source_view;
pub mod view;
pub mod wall_clock;
mod whole_library;
