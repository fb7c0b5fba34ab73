//! `cargo xtask programs`: programs drawn at random around the handling blocks of each CP, and a judge written from the
//! manuals.
//!
//! A seed gives a program, a station, a partner and faults ([`run::Case`]). The program records its calls itself
//! ([`text`]). It runs in the whole-station simulation ([`run`]); the [`judge`] sees each call and the partner's
//! ledger. The same seed gives the same log.

pub mod cp240;
pub mod judge;
pub mod partner;
pub mod ptp;
pub mod record;
pub mod run;
pub mod shape;
pub mod text;

use std::path::Path;

pub use run::Outcome;

/// A CP whose programs are drawn.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// Its name on the command line.
    pub name: &'static str,
    /// Package of its plugin.
    pub plugin: &'static str,
    /// Draws and runs the case of a seed; files are written into the folder.
    pub run: fn(seed: u64, folder: &Path, log: bool) -> Result<Outcome, String>,
}

/// All CPs.
pub const SUBJECTS: &[Subject] = &[
    Subject { name: "cp240", plugin: "ob1-cp240", run: cp240::run },
    Subject { name: "cp340", plugin: "ob1-cp340", run: ptp::cp340 },
    Subject { name: "cp341", plugin: "ob1-cp341", run: ptp::cp341 },
    Subject { name: "cp040", plugin: "ob1-cp040", run: ptp::cp040 },
];
