//! What there is to say of a project: what was read otherwise than it should be, and why.

use std::fmt;

/// How much a note matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Weight {
    /// Worth knowing: nothing is lost.
    Info,
    /// Read, but not as it should be.
    Warning,
}

/// One thing to say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// How much it matters.
    pub weight: Weight,
    /// A block, a file, a module.
    pub of: String,
    /// What, in one sentence.
    pub what: String,
}

/// All of them, in the order they were found.
pub type Notes = Vec<Note>;

impl Note {
    /// Something read otherwise than it should be.
    pub fn warning(of: impl Into<String>, what: impl Into<String>) -> Self {
        Self { weight: Weight::Warning, of: of.into(), what: what.into() }
    }

    /// A note that something is worth knowing.
    pub fn info(of: impl Into<String>, what: impl Into<String>) -> Self {
        Self { weight: Weight::Info, of: of.into(), what: what.into() }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.of, self.what)
    }
}
