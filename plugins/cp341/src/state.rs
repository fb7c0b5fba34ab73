//! What the blocks remember of a module beside their instances.

use std::cell::Cell;

ob1_sdk::state! {
    /// Per module and station, zeroed at every start-up of the CPU.
    #[derive(Debug, Default)]
    pub(crate) struct CpState {
        pub(crate) send: Claim,
        pub(crate) receive: Claim,
    }
}

ob1_sdk::state! {
    /// A block's start number at the CP; 0: none since the start-up. An instance with another one is of an earlier
    /// life: instances lie in data blocks, which outlast a start-up.
    #[derive(Debug, Default)]
    pub(crate) struct Claim {
        pub(crate) start: Cell<u16>,
    }
}
