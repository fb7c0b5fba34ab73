//! What the blocks remember of a module beside their instances.

use std::cell::Cell;

ob1_sdk::state! {
    /// Per module and station, zeroed at every start-up of the CPU.
    #[derive(Debug, Default)]
    pub struct CpState {
        /// P_SEND, P_SND_RK or P_PRINT: they share a channel.
        pub(crate) send: Claim,
        /// P_RCV or P_RCV_RK.
        pub(crate) receive: Claim,
    }
}

ob1_sdk::state! {
    /// A block's start number at the CP; 0: none since the start-up. An instance with another one is of an earlier
    /// life: instances lie in data blocks, which outlast a start-up.
    #[derive(Debug, Default)]
    pub struct Claim {
        /// The number.
        pub(crate) start: Cell<u16>,
    }
}
