//! Why something could not be done.

use ob1_access::door::{Refusal, Refused};
use thiserror::Error;

/// Why something could not be done. Nothing of it was done.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum Trouble {
    /// The station has ended, or has dropped this link.
    #[error("the station has ended")]
    Gone,
    /// More than a link may watch: 64 KiB, or 4096 cache lines. Read it in parts.
    #[error("more than can be read at once: read it in parts")]
    TooMuch,
    /// More than can be written at one cycle control point: 64 entries, or 4096 bytes.
    #[error("at most 64 entries and 4096 bytes can be written at once")]
    Group,
    /// The right of this user does not allow it.
    #[error("not allowed to this user")]
    User,
    /// The broker or the CPU refuses; for a group, its first impossible entry.
    #[error("{why}")]
    Refused {
        /// The entry of the group; 0 if it was not a group.
        entry: u32,
        /// Why.
        why: Refusal,
    },
    /// The action cannot be logged, so it is not carried out.
    #[error("the audit log cannot be written: {0}")]
    Audit(String),
    /// The received program is invalid.
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
