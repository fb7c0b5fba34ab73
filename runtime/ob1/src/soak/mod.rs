//! `ob1 soak`: a station runs for hours, and the result is a verdict (docs/soak.md).
//!
//! The station is a process of its own, asked through its socket like any other; the soak reads its accounts, draws up
//! the report, and judges it. Everything from the readings on is pure: [`measure`] collects, [`judge`] decides,
//! [`text`] and [`html`] show.

mod args;
mod budget;
mod compare;
mod drive;
mod files;
pub mod html;
mod judge;
mod load;
mod measure;
mod merge;
pub mod report;
mod station;
pub mod text;
pub mod verdict;

pub use args::SoakArgs;
pub use budget::Budget;
pub use load::Load;
pub use report::Report;

use crate::exit::{SoakExit, told};

/// Runs a soak to its verdict, or compares two reports; prints what there is to print.
pub fn soak(args: &SoakArgs) -> SoakExit {
    if let Some([a, b]) = args.compare.as_deref() {
        return told(compare::compare(a, b, f64::from(args.margin) / 100.0), |_| SoakExit::Inconclusive);
    }
    if let Some(reports) = &args.merge {
        return shown(merge::merge(reports, args), args);
    }
    // clap has seen to it that both are there.
    let (Some(station), Some(time)) = (&args.station, args.time) else { return SoakExit::Inconclusive };
    shown(drive::drive(station, time.into(), args), args)
}

fn shown(report: Result<Report, String>, args: &SoakArgs) -> SoakExit {
    match report {
        Ok(report) => {
            if args.quiet {
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
