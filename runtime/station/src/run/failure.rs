//! Why a run could not begin, or ended badly.

use crate::exit::Exit;
use crate::program::LoadFailure;
use ob1_station_file::finding::Finding;

/// A run that could not begin or end: exit code and what to print.
#[derive(Debug)]
pub(super) struct Failure(pub(super) Exit, pub(super) String);

impl Failure {
    pub(super) fn of_findings(exit: Exit, findings: &[Finding]) -> Self {
        Self(exit, findings.iter().map(|f| format!("{f}\n")).collect())
    }

    pub(super) fn of_load(failure: &LoadFailure) -> Self {
        match failure {
            LoadFailure::Plugin(findings) => Self::of_findings(Exit::Plugin, findings),
            LoadFailure::Rejected(findings) => Self::of_findings(Exit::Rejected, findings),
        }
    }

    pub(super) fn system(what: &str, error: &std::io::Error) -> Self {
        Self(Exit::System, format!("ob1: {what}: {error}{}\n", ob1_rt::remedy(error)))
    }
}
