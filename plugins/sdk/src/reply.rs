//! Answers of the host.

use core::fmt;

use ob1_abi::{self as abi, Status};

/// The CPU is on its way to STOP, or the run ends: the block must return at once. Only the host creates it; pass it on
/// with `?`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "return it: the CPU is going to STOP"]
pub struct Abort(pub(crate) ());

/// Why the host refused a request; the block decides what that means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// No such parameter, or not of the kind asked for; no instance in an FC.
    NoParam,
    /// The address lies outside its area; no timer or counter of this number.
    Outside,
    /// The data block does not exist.
    NoDb,
    /// An impossible data block number: 0, or above the CPU's limit.
    DbNumber,
    /// The data block is write-protected.
    ReadOnly,
    /// No module at this logical address.
    NoModule,
    /// The module's driver is down.
    Absent,
    /// The module is busy with another request; a later request may succeed.
    Busy,
    /// The module has no such record.
    NoRecord,
    /// The block to call does not exist, or its parameters do not match.
    NoBlock,
    /// The station file does not give the module this setting, or the host has no settings.
    NoSetting,
    /// An impossible length, or a status this version of the interface does not know.
    BadArgument,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Refused::NoParam => "there is no such parameter",
            Refused::Outside => "the address lies outside its area",
            Refused::NoDb => "the data block does not exist",
            Refused::DbNumber => "the data block number cannot be",
            Refused::ReadOnly => "the data block is write-protected",
            Refused::NoModule => "there is no such module at this address",
            Refused::Absent => "the module does not answer",
            Refused::Busy => "the module is busy",
            Refused::NoRecord => "the module has no such record",
            Refused::NoBlock => "the block does not exist, or its parameters do not match",
            Refused::NoSetting => "the station file does not give this setting",
            Refused::BadArgument => "an argument cannot be",
        })
    }
}

/// The host's answer: `Err(Abort)` is passed on with `?`, a refusal is handled by the block itself.
pub type Reply<T> = Result<Result<T, Refused>, Abort>;

/// Converts a status of the host.
#[inline]
pub(crate) fn reply(status: Status) -> Reply<()> {
    match status {
        abi::OK => Ok(Ok(())),
        abi::ABORT => Err(Abort(())),
        other => Ok(Err(refused(other))),
    }
}

#[cold]
fn refused(status: Status) -> Refused {
    match status {
        abi::NO_PARAM => Refused::NoParam,
        abi::OUTSIDE => Refused::Outside,
        abi::NO_DB => Refused::NoDb,
        abi::DB_NUMBER => Refused::DbNumber,
        abi::READ_ONLY => Refused::ReadOnly,
        abi::NO_MODULE => Refused::NoModule,
        abi::ABSENT => Refused::Absent,
        abi::BUSY => Refused::Busy,
        abi::NO_RECORD => Refused::NoRecord,
        abi::NO_BLOCK => Refused::NoBlock,
        abi::NO_SETTING => Refused::NoSetting,
        _ => Refused::BadArgument,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_status_has_its_answer() {
        assert_eq!(reply(abi::OK), Ok(Ok(())));
        assert_eq!(reply(abi::ABORT), Err(Abort(())));
        let refusals: Vec<_> = (-12..=-1).map(|status| reply(status).map(Result::unwrap_err)).collect();
        for (i, refusal) in refusals.iter().enumerate() {
            assert!(!refusals[..i].contains(refusal), "two statuses give {refusal:?}");
        }
        assert_eq!(reply(77), Ok(Err(Refused::BadArgument)));
    }
}
