//! What the blocks store for a module in addition to their instances.

use std::cell::Cell;

use ob1_sdk::{Abort, Cx, Instance};

ob1_sdk::state! {
    /// One for each module and station, zeroed at every start-up of the CPU.
    #[derive(Debug, Default)]
    pub struct CpState {
        /// P_SEND, P_SND_RK or P_PRINT: they share a channel.
        pub(crate) send: Claim,
        /// P_RCV or P_RCV_RK: the block that has the receive channel.
        pub(crate) receive: Claim,
    }
}

ob1_sdk::state! {
    /// Which instance has a channel: "At a given time, only one FB P_SND_RK and one FB P_RCV_RK can be called for each
    /// CP 341" [S4 L1584]. An instance that is not the owner has nothing of its own at the CP: it is from before the
    /// start-up, because instances are in data blocks, which survive a start-up; or another one has taken the channel.
    #[derive(Debug, Default)]
    pub struct Claim {
        /// The start number in use at the CP; 0: none since the start-up.
        pub(crate) start: Cell<u16>,
        /// The instance; 0: none since the start-up.
        owner: Cell<u64>,
        /// Counts the calls of the owner; wraps around.
        pub(crate) calls: Cell<u16>,
        /// Time of its last call, ms.
        seen: Cell<u64>,
        /// For how long after that it keeps the channel, ms.
        keeps: Cell<u32>,
    }
}

/// How long an instance with a job keeps its channel after its last call: as long as the CP waits for a block that is
/// not called. (ours)
pub(crate) const JOB_MS: u32 = 10_000;
/// The same for a receiving block that waits for a telegram. (ours)
pub(crate) const WAITING_MS: u32 = 1_000;

impl Claim {
    /// Whether this instance has the channel, with this start number.
    pub(crate) fn is_of(&self, instance: u64, start: u16) -> bool {
        self.owner.get() == instance && self.start.get() == start
    }

    /// Whether this instance had the channel, or nobody has it.
    pub(crate) fn is_unused_but_by(&self, instance: u64) -> bool {
        [0, instance].contains(&self.owner.get())
    }

    /// Whether the owner no longer keeps the channel.
    pub(crate) fn is_abandoned(&self, now_ms: u64) -> bool {
        now_ms.saturating_sub(self.seen.get()) >= u64::from(self.keeps.get())
    }

    /// Gives the channel to this instance; returns the start number that its next one must differ from.
    pub(crate) fn take(&self, instance: u64) -> u16 {
        self.owner.set(instance);
        self.start.get()
    }

    /// The end of a call: if this instance has the channel, it keeps it for so long.
    pub(crate) fn keep(&self, instance: u64, now_ms: u64, for_ms: u32) {
        if self.owner.get() == instance {
            self.calls.set(self.calls.get().wrapping_add(1));
            self.seen.set(now_ms);
            self.keeps.set(for_ms);
        }
    }
}

/// The called instance as a number, and the time in ms.
pub(crate) fn called(cx: &mut Cx<'_, CpState>) -> Result<(u64, u64), Abort> {
    let instance = cx.instance()?.map_or(u64::MAX, Instance::key);
    Ok((instance, cx.now() / 1_000_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_is_kept_until_its_owner_is_no_longer_called() {
        let claim = Claim::default();
        assert!(claim.is_unused_but_by(7) && !claim.is_of(7, 0));
        assert_eq!(claim.take(7), 0);
        claim.start.set(3);
        claim.keep(7, 100, JOB_MS);
        claim.keep(8, 5_000, 0);
        assert!(claim.is_of(7, 3) && !claim.is_of(8, 3) && !claim.is_unused_but_by(8));
        assert!(!claim.is_abandoned(10_099) && claim.is_abandoned(10_100));
        assert_eq!(claim.take(8), 3, "the start number in use");
        assert!(!claim.is_of(7, 3));
    }
}
