//! What the blocks store for a module in addition to their instances.

use std::cell::Cell;

ob1_sdk::state! {
    /// One for each module and station, zeroed at every start-up of the CPU.
    #[derive(Debug, Default)]
    pub struct CpState {
        /// P_SEND, P_SND_RK or P_PRINT: they share a channel.
        pub(crate) send: Claim,
        /// P_RCV or P_RCV_RK.
        pub(crate) receive: Claim,
    }
}

ob1_sdk::state! {
    /// The start number of a block at the CP; 0: none since the start-up. An instance with another number is from
    /// before the start-up: instances are in data blocks, which survive a start-up.
    #[derive(Debug, Default)]
    pub struct Claim {
        /// The number.
        pub(crate) start: Cell<u16>,
    }
}
