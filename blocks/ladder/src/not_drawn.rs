//! Why a network is shown as statements.

use std::fmt;

/// The first statement that does not fit, and what is the matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reason {
    /// Its index in the network, from 0.
    pub statement: u32,
    /// What does not fit.
    pub what: &'static str,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "statement {}: {}", self.statement + 1, self.what)
    }
}

impl Reason {
    /// The one that came further.
    pub(crate) fn later(self, other: Self) -> Self {
        if other.statement > self.statement { other } else { self }
    }
}
