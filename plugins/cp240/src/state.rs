//! What the blocks store for a module in addition to the parameters of the program.

use std::cell::Cell;

use crate::claim::Claim;
use crate::rk512::Rk512State;

ob1_sdk::state! {
    /// One for each module and station, zeroed at every start-up.
    #[derive(Debug, Default)]
    pub(crate) struct CpState {
        pub(crate) send: Claim,
        pub(crate) receive: Claim,
        /// The unit of ABD in bytes; 0: not read yet.
        pub(crate) abd_bytes: Cell<u8>,
        /// The blocks the protocol of the CP supports; 0: not read yet.
        pub(crate) service: Cell<u8>,
        /// A call without function has been reported.
        pub(crate) told: Cell<bool>,
        /// FC 2, FC 3 and FC 4.
        pub(crate) rk512: Rk512State,
        /// A line command of FC 8 is in `TX`.
        pub(crate) line: Claim,
        /// That command only reads.
        pub(crate) reads: Cell<bool>,
        /// STATUS and DELTA_STATUS of the last answer, if there was one.
        pub(crate) lines_known: Cell<bool>,
        pub(crate) lines: Cell<u8>,
        pub(crate) lines_changed: Cell<u8>,
        /// The blocks of the current telegram do not match: wait until the CP has ended it.
        pub(crate) discard: Cell<bool>,
        /// Modbus slave "long": start of the changed area that is being received.
        pub(crate) offset: Cell<u16>,
        /// Number of the start-up that FC 9 acknowledged last; 0 for none.
        pub(crate) acknowledged: Cell<u8>,
        /// Both output words have been set to 0 after that acknowledgement: the CP works.
        pub(crate) emptied: Cell<bool>,
    }
}
