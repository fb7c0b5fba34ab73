//! What FC 2, FC 3 and FC 4 store for the two roles of a CP.

use std::cell::Cell;

use crate::claim::Claim;

/// A block that has not been called for this time loses its claims: the reaction monitoring time of the CP [S0 L1678].
pub(super) const GIVEN_UP: u64 = 5_000_000_000;

ob1_sdk::state! {
    /// What the blocks store for the two roles.
    #[derive(Debug, Default)]
    pub(crate) struct Rk512State {
        /// The running order of this CPU.
        pub(crate) order: Claim,
        /// The mark of that order, and the time of the last call of its block.
        pub(super) token: Cell<u8>,
        pub(super) order_seen: Cell<u64>,
        /// The order of the partner that FC 4 is serving.
        pub(crate) partner: Claim,
        /// The error number of its answer, its coordination flag as in the header, its length in bytes.
        pub(super) refusal: Cell<u8>,
        pub(super) coordination: Cell<u16>,
        pub(super) length: Cell<u16>,
        /// The content of `RX echo`.
        pub(super) echo: Cell<u16>,
        /// The role that has a telegram in `TX`: 0, `OWN` or `PARTNER`; and the time of its last call.
        tx: Cell<u16>,
        pub(super) tx_seen: Cell<u64>,
    }
}

impl Rk512State {
    /// FC 9 has synchronised: no order runs, all words are 0.
    pub(crate) fn clear(&self) {
        self.order.release();
        self.partner.release();
        self.echo.set(0);
        self.tx.set(0);
    }

    /// Takes or keeps `TX` for a telegram; false while the other role uses it.
    pub(super) fn take_tx(&self, framing: u16, now: u64) -> bool {
        let other = self.tx.get() != 0 && self.tx.get() != framing;
        if other && now.saturating_sub(self.tx_seen.get()) < GIVEN_UP {
            return false;
        }
        self.tx.set(framing);
        self.tx_seen.set(now);
        true
    }

    /// Whether FC 2, FC 3 or FC 4 has a telegram in `TX`.
    pub(crate) fn uses_tx(&self) -> bool {
        self.tx.get() != 0
    }

    pub(super) fn release_tx(&self, framing: u16) {
        if self.tx.get() == framing {
            self.tx.set(0);
        }
    }
}
