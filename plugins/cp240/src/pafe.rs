//! PAFE, the output of the handling blocks for errors of a data block.

use ob1_sdk::{Abort, Refused, Reply};

/// PAFE: the error of the data block [S0 "Standard handling blocks for CPU 21x"].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Pafe {
    /// No error of the data block.
    Ok = 0,
    /// Data block not present.
    Missing = 1,
    /// Data block too short.
    Short = 2,
    /// Data block number outside the valid range.
    Number = 3,
}

impl Pafe {
    /// PAFE for a refusal of the host; `None` for a write-protected data block, which PAFE does not report.
    pub(crate) fn of(refused: Refused) -> Option<Self> {
        Some(match refused {
            Refused::NoDb => Pafe::Missing,
            Refused::DbNumber => Pafe::Number,
            Refused::ReadOnly => return None,
            _ => Pafe::Short,
        })
    }

    /// Checks whether an area is inside its data block.
    pub(crate) fn check(db_len: Reply<u32>, from: impl Into<u32>, bytes: u16) -> Result<Pafe, Abort> {
        Ok(match db_len? {
            Ok(len) if len >= from.into() + u32::from(bytes) => Pafe::Ok,
            Ok(_) => Pafe::Short,
            Err(refused) => Pafe::of(refused).unwrap_or(Pafe::Ok),
        })
    }
}
