//! `ob1 soak`: a station runs for hours, and the result is a verdict (docs/soak.md).
//!
//! The station is a process of its own, asked through its socket like any other; the soak reads its accounts, draws up
//! the report, and judges it. Everything from the readings on is pure: [`measure`] collects, [`judge`] decides,
//! [`text`] and [`html`] show.

mod budget;
mod compare;
mod drive;
mod files;
pub mod html;
mod judge;
mod load;
mod measure;
pub mod report;
mod station;
pub mod text;
pub mod verdict;

use std::path::PathBuf;
use std::time::Duration;

pub use budget::Budget;
pub use compare::compare;
pub use load::Load;
pub use report::Report;

use crate::exit::SoakExit;

/// What the command line asks for.
#[derive(Clone, Debug)]
pub struct Options {
    /// The station file.
    pub station: PathBuf,
    /// How long to measure.
    pub time: Duration,
    /// Time in RUN before that; none: a tenth of it, at most ten seconds.
    pub warm_up: Option<Duration>,
    /// What has to be kept.
    pub budget: Vec<Budget>,
    /// Cells of the program to follow.
    pub cells: Vec<String>,
    /// The cell that counts telegrams that arrived twice.
    pub doubled: Option<String>,
    /// The cell that counts telegrams that arrived with another content.
    pub wrong: Option<String>,
    /// What to put the station under.
    pub load: Load,
    /// The seed of the load.
    pub seed: u64,
    /// The reports' path without its ending.
    pub report: Option<PathBuf>,
    /// Print the verdict only.
    pub quiet: bool,
}

/// Runs a soak to its verdict; prints what there is to print.
#[must_use]
pub fn soak(options: &Options) -> SoakExit {
    match drive::drive(options) {
        Ok(report) => {
            if options.quiet {
                say!("{}", report.verdict.line());
            } else {
                says!("{}", text::report(&report));
            }
            report.verdict.exit()
        }
        Err(why) => {
            errs!("{why}");
            SoakExit::Inconclusive
        }
    }
}
