//! To which start of the CP a running job belongs.

use std::cell::Cell;

use ob1_sdk::ModuleInfo;

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
