//! The ways a verb ends badly.

use std::fmt;

/// Why a verb did not succeed.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The command line was wrong: exit code 2.
    Usage(String),
    /// A step failed: exit code 1.
    Step(String),
    /// The verb is a program of its own, and ended with this exit code, which says how.
    Program(String, u8),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(what) | Self::Step(what) | Self::Program(what, _) => f.write_str(what),
        }
    }
}

/// What a verb returns.
pub(crate) type Outcome<T = ()> = Result<T, Failure>;

/// A failed step, from anything that can be printed.
pub(crate) fn step(what: impl Into<String>) -> Failure {
    Failure::Step(what.into())
}
