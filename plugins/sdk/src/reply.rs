//! Answers of the host.

use core::fmt;

use crate::abi::{self as abi, Status};

/// The CPU is on its way to STOP, or the run ends: the block must return at once. Only the host creates it; pass it on
/// with `?`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "return it: the CPU is going to STOP"]
pub struct Abort(pub(crate) ());

/// Declares [`Refused`] from a row for each value: the host's status and the text.
macro_rules! refusals {
    ($(#[$meta:meta])* pub enum Refused { $($(#[$doc:meta])* $name:ident = $status:ident, $text:literal;)* }) => {
        $(#[$meta])*
        pub enum Refused { $($(#[$doc])* $name,)* }

        impl fmt::Display for Refused {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(match self { $(Self::$name => $text,)* })
            }
        }

        #[cold]
        fn refused(status: Status) -> Refused {
            match status { $(abi::$status => Refused::$name,)* _ => Refused::BadArgument }
        }
    };
}

refusals! {
    /// Why the host refused a request; the block decides what that means.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Refused {
        /// No such parameter, or not of the kind asked for; no instance in an FC.
        NoParam = NO_PARAM, "there is no such parameter";
        /// The address lies outside its area; no timer or counter of this number.
        Outside = OUTSIDE, "the address lies outside its area";
        /// The data block does not exist.
        NoDb = NO_DB, "the data block does not exist";
        /// An impossible data block number: 0, or above the CPU's limit.
        DbNumber = DB_NUMBER, "the data block number cannot be";
        /// The data block is write-protected.
        ReadOnly = READ_ONLY, "the data block is write-protected";
        /// No module at this logical address.
        NoModule = NO_MODULE, "there is no such module at this address";
        /// The module's driver is down.
        Absent = ABSENT, "the module does not answer";
        /// The module is busy with another request; a later request may succeed.
        Busy = BUSY, "the module is busy";
        /// The module has no such record.
        NoRecord = NO_RECORD, "the module has no such record";
        /// The block to call does not exist, or its parameters do not match.
        NoBlock = NO_BLOCK, "the block does not exist, or its parameters do not match";
        /// The station file does not give the module this setting, or the host has no settings.
        NoSetting = NO_SETTING, "the station file does not give this setting";
        /// An impossible length, or a status this version of the interface does not know.
        BadArgument = BAD_ARGUMENT, "an argument cannot be";
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
