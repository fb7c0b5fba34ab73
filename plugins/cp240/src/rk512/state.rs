//! What FC 2, FC 3 and FC 4 store for the two roles of a CP.

use std::cell::Cell;

use crate::turn::{Claim, Turn};

ob1_sdk::state! {
    /// What the blocks store for the two roles.
    #[derive(Debug, Default)]
    pub(crate) struct Rk512State {
        /// The running order of this CPU, and the mark of the last one.
        pub(crate) order: Turn,
        pub(super) token: Cell<u8>,
        /// The order of the partner that FC 4 is serving.
        pub(super) partner: Claim,
        /// The error number of its answer, its coordination flag as in the header, its length in bytes.
        pub(super) refusal: Cell<u8>,
        pub(super) coordination: Cell<u16>,
        pub(super) length: Cell<u16>,
        /// The data block that was not there for the last order of the partner: number, first byte, and bytes.
        pub(super) bad: Cell<bool>,
        pub(super) bad_db: Cell<u16>,
        pub(super) bad_from: Cell<u16>,
        pub(super) bad_bytes: Cell<u16>,
        /// FC 9 has synchronised since the order of a block that was not called since: its control bits stand.
        pub(super) cut_off: Cell<bool>,
        /// The content of `RX echo`.
        pub(super) echo: Cell<u16>,
    }
}

impl Rk512State {
    /// Whether an order of either side has not ended for its block, be it that another one got its turn meanwhile.
    pub(crate) fn is_running(&self) -> bool {
        let own = &self.order.claim;
        own.is_busy() || own.has_orphans() || self.partner.is_busy() || self.cut_off.get()
    }

    /// FC 9 has synchronised: no order runs, all words are 0.
    pub(crate) fn clear(&self) {
        self.cut_off.set(self.is_running());
        self.order.clear();
        self.partner.clear();
        self.bad.set(false);
        self.echo.set(0);
    }
}
