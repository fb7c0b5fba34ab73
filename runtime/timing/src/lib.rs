//! Scan timing, outside the scan: an observer explains every late scan, and everyone else reads snapshots.
//!
//! The scan writes its accounts ([`ob1_cpu::Accounts`]) and hands over a record of each late scan; it is never asked
//! anything. The observer thread reads what the kernel says about the scan thread, gives each late scan a class with
//! its evidence, and keeps the flights the recorder froze. `docs/timing.md` says what it all means.

mod cause;
mod kernel;
mod kernel_counters;
mod ledger;
mod merge;
mod observer;
pub mod snapshot;
pub mod text;
mod timings;

pub use cause::{Cause, Class, Evidence, Measured, explain};
pub use observer::{LateSender, Observer, Unobserved};
pub use snapshot::{Recorder, TIMING_SCHEMA, Timing};
pub use timings::Timings;
