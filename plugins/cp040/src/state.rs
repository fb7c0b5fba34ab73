//! What the blocks store for a module.

use std::cell::Cell;

use ob1_words::slio::{ReceiveJob, SendJob};

use crate::order::PATIENCE_MS;
use crate::status;

ob1_sdk::state! {
    /// One for each module and station, zeroed at every start-up.
    #[derive(Debug, Default)]
    pub(crate) struct CpState {
        send: Cell<u64>,
        receive: Cell<u64>,
        /// DB_NO and DBB_NO of the send job.
        source: Cell<u32>,
        /// DB_NO and DBB_NO of the telegram that is being received.
        target: Cell<u32>,
        /// The instance that owns the send job or reset.
        owner: Cell<u64>,
        /// Time of its last call, ms.
        seen: Cell<u64>,
        /// The instance that sends next: its request has waited longest. 0: none waits.
        next: Cell<u64>,
        /// Time of its last call, ms.
        next_seen: Cell<u64>,
        /// STATUS of an instance that has lost the send job or reset.
        lost: Cell<u16>,
        /// The start of the CP to which all this belongs.
        generation: Cell<u32>,
        /// Byte 0 of the outputs was written since that start.
        written: Cell<bool>,
        /// Byte 0 of the outputs as it was written last.
        byte0: Cell<u8>,
        /// A restart or reset of the CP interrupted a telegram: RECEIVE reports it once.
        cut_off: Cell<bool>,
    }
}

/// Output byte 0 with both nibbles idle: no command to send, none to receive.
const IDLE: u8 = 0x88;

/// DB_NO and DBB_NO as one number.
pub(crate) fn number(db: u16, byte: u16) -> u32 {
    u32::from(db) << 16 | u32::from(byte)
}

fn place(number: u32) -> (u16, u16) {
    ((number >> 16) as u16, number as u16)
}

impl CpState {
    pub(crate) fn send(&self) -> SendJob {
        SendJob::unpack(self.send.get())
    }

    pub(crate) fn set_send(&self, job: SendJob) {
        self.send.set(job.pack());
    }

    /// DB_NO and DBB_NO of the send job: all its fragments come from there, whatever the parameters of later calls are.
    pub(crate) fn source(&self) -> (u16, u16) {
        place(self.source.get())
    }

    pub(crate) fn set_source(&self, db: u16, byte: u16) {
        self.source.set(number(db, byte));
    }

    /// The same of the telegram that is being received: where its first fragment is.
    pub(crate) fn target(&self) -> (u16, u16) {
        place(self.target.get())
    }

    pub(crate) fn set_target(&self, db: u16, byte: u16) {
        self.target.set(number(db, byte));
    }

    pub(crate) fn receive(&self) -> ReceiveJob {
        ReceiveJob::unpack(self.receive.get())
    }

    pub(crate) fn set_receive(&self, job: ReceiveJob) {
        self.receive.set(job.pack());
    }

    /// Gives the send side to an instance. The one that had it learns by this STATUS that its job has ended.
    pub(crate) fn claim(&self, owner: u64, job: SendJob, lost: u16) {
        self.owner.set(owner);
        self.set_send(job);
        self.lost.set(lost);
    }

    /// STATUS of an instance whose job is no longer there; 0202h after a start-up, too.
    pub(crate) fn lost(&self) -> u16 {
        match self.lost.get() {
            0 => status::NOT_SYNCHRONISED,
            status => status,
        }
    }

    /// The owner of the send side is called.
    pub(crate) fn touch(&self, now_ms: u64) {
        self.seen.set(now_ms);
    }

    /// The owner of the send side is no longer called.
    pub(crate) fn is_abandoned(&self, now_ms: u64) -> bool {
        self.send().is_running() && now_ms.saturating_sub(self.seen.get()) >= u64::from(PATIENCE_MS)
    }

    pub(crate) fn is_owner(&self, instance: u64) -> bool {
        self.owner.get() == instance && self.send().is_running()
    }

    /// Whether the reset that runs is that of this instance. One of another ends its orders.
    pub(crate) fn is_resetting(&self, instance: u64) -> bool {
        self.owner.get() == instance && self.send().is_reset()
    }

    /// Whether a request of this instance must wait for that of another. Otherwise an instance that is called more
    /// often sends for ever, and the others never. One that is no longer called loses its place.
    pub(crate) fn is_behind(&self, instance: u64, now_ms: u64) -> bool {
        let is_there = now_ms.saturating_sub(self.next_seen.get()) < u64::from(PATIENCE_MS);
        self.next.get() != 0 && self.next.get() != instance && is_there
    }

    /// A request of this instance waits.
    pub(crate) fn queue(&self, instance: u64, now_ms: u64) {
        if !self.is_behind(instance, now_ms) {
            self.next.set(instance);
            self.next_seen.set(now_ms);
        }
    }

    /// It waits no longer.
    pub(crate) fn leave(&self, instance: u64) {
        if self.next.get() == instance {
            self.next.set(0);
        }
    }

    /// Byte 0 as it was written last.
    pub(crate) fn byte0(&self) -> u8 {
        self.byte0.get()
    }

    pub(crate) fn set_byte0(&self, byte: u8) {
        self.byte0.set(byte);
    }

    /// Notes the start of the CP; returns the byte 0 to write if it is a different start than before.
    pub(crate) fn see(&self, generation: u32) -> Option<u8> {
        if self.written.get() && self.generation.get() == generation {
            return None;
        }
        self.drop_receive();
        self.claim(0, SendJob::default(), status::NOT_SYNCHRONISED);
        self.generation.set(generation);
        self.written.set(true);
        self.byte0.set(IDLE);
        Some(IDLE)
    }

    /// Drops the telegram that is being received.
    pub(crate) fn drop_receive(&self) {
        if self.receive().is_running() {
            self.cut_off.set(true);
        }
        self.set_receive(ReceiveJob::default());
    }

    /// Whether a telegram was interrupted since the last call.
    pub(crate) fn take_cut_off(&self) -> bool {
        self.cut_off.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_start_of_the_cp_voids_everything() {
        let state = CpState::default();
        assert_eq!(state.see(1), Some(0x88), "the first look");
        assert_eq!(state.see(1), None);
        state.claim(7, SendJob::telegram(5).expect("1 to 1024"), 0);
        assert!(state.is_owner(7) && !state.is_owner(8));
        assert_eq!(state.see(2), Some(0x88));
        assert!(!state.is_owner(7) && !state.send().is_running());
        assert!(!state.take_cut_off(), "nothing was being received");
        assert_eq!(state.lost(), 0x0202);
    }
}
