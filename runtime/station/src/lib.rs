//! What a running station is: the station file, the build of a station from it, the run, what it keeps
//! and what it tells.
//!
//! The tools that look at one (`runtime/ob1`), a service, a link and the simulation hold a station through this crate.

// Everything goes through one place that neither panics nor waits for ever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[macro_use]
pub mod out;

pub mod access;
pub mod assembly;
mod bus;
pub mod buses;
pub mod compiling;
pub mod download;
pub mod engine;
pub mod exit;
pub mod fence;
pub mod files;
pub mod finding;
pub mod folder;
pub mod guardian;
mod handling;
pub mod io;
pub mod janitor;
mod kept;
pub mod library;
pub mod links;
pub mod numbers;
pub mod offer;
pub mod posture;
pub mod program;
pub mod retentive;
pub mod run;
pub mod rundir;
pub mod simulated;
pub mod station_file;
pub mod timing;
pub mod view;
mod whole_library;
