//! The options of a run.

use std::path::PathBuf;

use ob1_time::Span;

/// What the command line asks for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Path of the station file.
    pub station: PathBuf,
    /// End after this time in RUN.
    pub time: Option<Span>,
    /// End after so many scans.
    pub scans: Option<u64>,
    /// Write a report there.
    pub report: Option<PathBuf>,
    /// Only warnings and errors.
    pub quiet: bool,
    /// Raise the system-call fence around the scan thread.
    pub fence: bool,
    /// End with standard input: whoever started this run holds the other end.
    pub lifeline: bool,
    /// More faults on simulated lines, in characters per million.
    pub line_faults: u32,
    /// Gives these faults another course.
    pub line_seed: u64,
}
