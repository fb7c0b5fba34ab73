//! What the blocks store for a module in addition to the parameters of the program.

use std::cell::Cell;

use ob1_sdk::ModuleInfo;

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

ob1_sdk::state! {
    /// The claim of a running job: valid only for the start of the CP at which it was made. The control bits are not
    /// sufficient: they may be in a retentive data block, or outside the bytes that FC 9 clears (as in the manual's
    /// EnOcean program [S0 L3164]).
    #[derive(Debug, Default)]
    pub(crate) struct Claim {
        running: Cell<bool>,
        generation: Cell<u32>,
    }
}

impl Claim {
    /// A job starts with the current start of the CP.
    pub(crate) fn take(&self, module: &ModuleInfo) {
        self.running.set(true);
        self.generation.set(module.generation);
    }

    /// The job has ended, or everything is reset.
    pub(crate) fn release(&self) {
        self.running.set(false);
    }

    /// True if the CP is present and has not restarted since the job began.
    pub(crate) fn holds(&self, module: &ModuleInfo) -> bool {
        self.running.get() && module.present && self.generation.get() == module.generation
    }
}
