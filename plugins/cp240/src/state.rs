//! What the blocks store for a module in addition to the parameters of the program.

use std::cell::Cell;

use crate::module::Told;
use crate::reception::Reception;
use crate::rk512::Rk512State;
use crate::tx::Tx;

ob1_sdk::state! {
    /// One for each module and station, zeroed at every start-up.
    #[derive(Debug, Default)]
    pub(crate) struct CpState {
        pub(crate) tx: Tx,
        pub(crate) reception: Reception,
        /// FC 2, FC 3 and FC 4.
        pub(crate) rk512: Rk512State,
        /// The control bits of FC 0 are from this start of the CPU: FC 9 has cleared them, or FC 0 has had an order.
        pub(crate) has_own_bits: Cell<bool>,
        /// The unit of ABD in bytes; 0: not read yet.
        pub(crate) abd_bytes: Cell<u8>,
        /// The blocks the protocol of the CP supports; 0: not read yet.
        pub(crate) service: Cell<u8>,
        pub(crate) told: Told,
        /// Number of the start-up that FC 9 acknowledged last; 0 for none.
        pub(crate) acknowledged: Cell<u8>,
        /// Both output words have been set to 0 after that acknowledgement: the CP works.
        pub(crate) emptied: Cell<bool>,
    }
}
