//! The rules of the judge, each with its place in a manual, and the findings.

use ob1_time::Instant;

use crate::programs::judge::Verdict;

/// A rule of the manuals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rule {
    /// DONE (NDR) and ERROR are never on together.
    EndIsOne,
    /// STATUS other than 0 (or "job runs") comes with ERROR, ERROR with a STATUS.
    StatusWithError,
    /// STATUS is a number of the manual's list for this block and protocol.
    KnownStatus,
    /// DONE, NDR and ERROR hold for one call and tell the end of a job (a telegram).
    EndOfAJob,
    /// A job needs a number of calls that depends on its length.
    Portions,
    /// An error has a cause: R, a restart, a wrong parameter, the line, the partner.
    ErrorHasCause,
    /// A job that was started ends.
    JobEnds,
    /// R ends a running job with an error, and is answered with DONE (NDR, LEN 0) when none runs.
    ResetIsAnswered,
    /// Nothing is sent or received while R is 1.
    ResetBlocks,
    /// DONE: what the job names has arrived at the partner.
    DoneArrived,
    /// What was refused because of its parameters was not sent.
    RefusedIsNotSent,
    /// The partner gets nothing that no job has named, and nothing twice.
    SentOnce,
    /// NDR: a whole telegram of the partner, unchanged.
    NdrWhole,
    /// A telegram of the partner is taken once.
    TakenOnce,
    /// Telegrams are taken in the order in which they came.
    InOrder,
    /// What the CP has acknowledged is delivered.
    Delivered,
    /// A reading job is DONE when its data are there: NDR came before.
    NdrBeforeDone,
    /// Nothing is received while `EN_R` is 0.
    EnableBlocks,
    /// XOFF stops the CP.
    Flow,
}

impl Rule {
    /// All of them.
    pub const ALL: [Self; 19] = [
        Self::EndIsOne,
        Self::StatusWithError,
        Self::KnownStatus,
        Self::EndOfAJob,
        Self::Portions,
        Self::ErrorHasCause,
        Self::JobEnds,
        Self::ResetIsAnswered,
        Self::ResetBlocks,
        Self::DoneArrived,
        Self::RefusedIsNotSent,
        Self::SentOnce,
        Self::NdrWhole,
        Self::TakenOnce,
        Self::InOrder,
        Self::Delivered,
        Self::NdrBeforeDone,
        Self::EnableBlocks,
        Self::Flow,
    ];

    /// Its name in a finding.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::EndIsOne => "end-is-one",
            Self::StatusWithError => "status-with-error",
            Self::KnownStatus => "known-status",
            Self::EndOfAJob => "end-of-a-job",
            Self::Portions => "portions",
            Self::ErrorHasCause => "error-has-cause",
            Self::JobEnds => "job-ends",
            Self::ResetIsAnswered => "reset-is-answered",
            Self::ResetBlocks => "reset-blocks",
            Self::DoneArrived => "done-arrived",
            Self::RefusedIsNotSent => "refused-is-not-sent",
            Self::SentOnce => "sent-once",
            Self::NdrWhole => "ndr-whole",
            Self::TakenOnce => "taken-once",
            Self::InOrder => "in-order",
            Self::Delivered => "delivered",
            Self::NdrBeforeDone => "ndr-before-done",
            Self::EnableBlocks => "enable-blocks",
            Self::Flow => "flow",
        }
    }

    /// Where it stands.
    #[must_use]
    pub const fn place(self) -> &'static str {
        match self {
            Self::EndIsOne => "[S4 L1642-L1652] [reference 1.2 3, 1.5 4]",
            Self::StatusWithError => "[S4 L1656] [reference 1.2 4, 8.3]",
            Self::KnownStatus => "[S4 L1734-L2330] [reference 3, 8.4]",
            Self::EndOfAJob => "[S4 L1590, L1642-L1652] [reference 1.2 1, 1.2 4, 8.3]",
            Self::Portions => "[reference 1.0, 7.2, 7.3]",
            Self::ErrorHasCause => "[S4 L1644, L1652] [reference 3]",
            Self::JobEnds => "[S4 L1642-L1652] [reference 1.2 8, 1.7]",
            Self::ResetIsAnswered => "[reference 1.2 7, 1.5 3, 8.3]",
            Self::ResetBlocks => "[reference 1.2 6, 1.5 3]",
            Self::DoneArrived => "[S4 L1642, L1648] [reference 1.2 10]",
            Self::RefusedIsNotSent => "[S4 L1620, L1634-L1636] [reference 3.5, 3.7, 3.14]",
            Self::SentOnce => "[S4 L1584] [reference 1.2 1, 5.3]",
            Self::NdrWhole => "[S4 L1662-L1668] [reference 1.5 4, 7.3]",
            Self::TakenOnce => "[reference 1.5 4, 7.3]",
            Self::InOrder => "[reference 1.6, 6.2]",
            Self::Delivered => "[S4 L1662] [reference 1.7, 6.2, 7.3]",
            Self::NdrBeforeDone => "[S4 L1648-L1650, L1668-L1670]",
            Self::EnableBlocks => "[S4 L1578] [reference 1.5 2]",
            Self::Flow => "[reference 6.4] [S3 L357]",
        }
    }
}

/// Findings by rule.
pub trait Findings {
    /// A rule does not hold.
    fn breaks(&mut self, at: Instant, rule: Rule, text: String);

    /// The rule must hold.
    fn must(&mut self, holds: bool, at: Instant, rule: Rule, text: impl FnOnce() -> String)
    where
        Self: Sized,
    {
        if !holds {
            self.breaks(at, rule, text());
        }
    }
}

impl Findings for Verdict {
    fn breaks(&mut self, at: Instant, rule: Rule, text: String) {
        self.broken(rule.name(), at, format!("{text} {}", rule.place()));
    }
}
