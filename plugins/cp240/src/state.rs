//! What the blocks remember of a module beside the parameters the program supplies.

use std::cell::Cell;

use ob1_sdk::ModuleInfo;

use crate::rk512::Rk512State;

ob1_sdk::state! {
    /// Per module and station, zeroed at every start-up.
    #[derive(Debug, Default)]
    pub(crate) struct CpState {
        pub(crate) send: Claim,
        pub(crate) receive: Claim,
        /// Bytes that ABD counts in; 0: not looked up yet.
        pub(crate) abd_bytes: Cell<u8>,
        /// What the CP's protocol has for the blocks; 0: not looked up yet.
        pub(crate) service: Cell<u8>,
        /// That a block was called for nothing has been told.
        pub(crate) told: Cell<bool>,
        /// FC 2, FC 3 and FC 4.
        pub(crate) rk512: Rk512State,
        /// A line command of FC 8 stands in `TX`.
        pub(crate) line: Claim,
        /// It only reads.
        pub(crate) reads: Cell<bool>,
        /// STATUS and DELTA_STATUS of the last answer, once there was one.
        pub(crate) lines_known: Cell<bool>,
        pub(crate) lines: Cell<u8>,
        pub(crate) lines_changed: Cell<u8>,
        /// The telegram that was being received does not fit together: wait until the CP has ended it.
        pub(crate) discard: Cell<bool>,
        /// Modbus slave "long": where the changed area that is being received begins.
        pub(crate) offset: Cell<u16>,
        /// Number of the start-up FC 9 has acknowledged last; 0 for none.
        pub(crate) acknowledged: Cell<u8>,
        /// After that acknowledgement both output words have been written 0: the CP works.
        pub(crate) emptied: Cell<bool>,
    }
}

ob1_sdk::state! {
    /// A running job's claim: made with one start of the CP, void with any other. Control bits alone cannot tell: they
    /// may lie in a retentive data block, or outside the bytes FC 9 clears (the manual's EnOcean program does that
    /// [S0 L3164]).
    #[derive(Debug, Default)]
    pub(crate) struct Claim {
        running: Cell<bool>,
        generation: Cell<u32>,
    }
}

impl Claim {
    /// A job starts on the CP as it is now.
    pub(crate) fn take(&self, module: &ModuleInfo) {
        self.running.set(true);
        self.generation.set(module.generation);
    }

    /// The job is over, or everything before is forgotten.
    pub(crate) fn release(&self) {
        self.running.set(false);
    }

    /// True while the CP is the one the job was started on.
    pub(crate) fn holds(&self, module: &ModuleInfo) -> bool {
        self.running.get() && module.present && self.generation.get() == module.generation
    }
}
