//! The failures of a verb.

use std::fmt;

/// The reason why a verb failed.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The command line was wrong: exit code 2.
    Usage(String),
    /// A step failed: exit code 1.
    Step(String),
    /// The program of the verb ended with this exit code, which tells the result.
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
