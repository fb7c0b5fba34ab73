//! Why something could not be done.

use ob1_access::door::{Refusal, Refused};
use thiserror::Error;

/// Why something could not be done. Nothing of it was done.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Trouble {
    /// The station has ended, or has let go of this link.
    #[error("the station has ended")]
    Gone,
    /// More than a link may watch: 64 KiB, or 4096 cache lines. Read it in parts.
    #[error("more than can be read at once: read it in parts")]
    TooMuch,
    /// More than lands at one cycle control point: 64 entries, or 4096 bytes.
    #[error("at most 64 entries and 4096 bytes can be written at once")]
    Group,
    /// The right of this user does not allow it.
    #[error("not allowed to this user")]
    User,
    /// The broker or the CPU says no; of a group, its first entry that cannot be.
    #[error("{why}")]
    Refused {
        /// The entry of the group; 0 where it was none.
        entry: u32,
        /// Why.
        why: Refusal,
    },
    /// What is done cannot be written down, so it is not done.
    #[error("the audit log cannot be written: {0}")]
    Audit(String),
    /// The program that came is none.
    #[error("the program of the station: {0}")]
    Program(String),
}

impl From<Refused> for Trouble {
    fn from(refused: Refused) -> Self {
        Self::Refused { entry: refused.entry, why: refused.why }
    }
}

impl From<Refusal> for Trouble {
    fn from(why: Refusal) -> Self {
        Self::Refused { entry: 0, why }
    }
}
