//! The words of a verdict: how a soak ended, what was judged, and how severe that is.

use serde::{Deserialize, Serialize};

use crate::exit::SoakExit;

/// How a soak ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// It is under way: a checkpoint, and all that is left of a soak that was killed.
    #[default]
    UnderWay,
    /// The time is over.
    Time,
    /// Ended early, by Ctrl-C or SIGTERM.
    Interrupted,
    /// The CPU went to STOP.
    CpuStopped,
    /// The station's process ended or did not answer any more.
    ProcessGone,
}

impl Ended {
    /// The end in words, as the report says it.
    pub const fn text(self) -> &'static str {
        match self {
            Self::UnderWay => "checkpoint of a soak under way, or of one that was killed",
            Self::Time => "after the requested time",
            Self::Interrupted => "interrupted",
            Self::CpuStopped => "because the CPU went to STOP",
            Self::ProcessGone => "because the station's process ended",
        }
    }
}

/// A verdict. The order is that of severity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The limit was kept.
    Pass,
    /// Too little has been seen to tell.
    #[default]
    Inconclusive,
    /// The limit was broken.
    Broken,
}

impl Verdict {
    /// The verdict in a word, as it is printed.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Inconclusive => "inconclusive",
            Self::Broken => "broken",
        }
    }

    /// As the last line of a report.
    pub const fn line(self) -> &'static str {
        match self {
            Self::Pass => "PASS",
            Self::Inconclusive => "INCONCLUSIVE",
            Self::Broken => "BUDGET BROKEN",
        }
    }

    /// The exit code that belongs to the verdict.
    pub const fn exit(self) -> SoakExit {
        match self {
            Self::Pass => SoakExit::Pass,
            Self::Inconclusive => SoakExit::Inconclusive,
            Self::Broken => SoakExit::Broken,
        }
    }
}

/// One thing that was judged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// The limit, as on the command line.
    pub budget: String,
    /// The measured value, with its unit.
    pub measured: String,
    /// What became of this limit.
    pub verdict: Verdict,
    /// Why, and what to look at.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub why: String,
}
