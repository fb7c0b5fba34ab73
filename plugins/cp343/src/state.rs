//! What the blocks store for a module: which job is in which box.

use std::cell::Cell;

use ob1_words::boxes::BOXES;

ob1_sdk::state! {
    /// One for each module and station, zeroed at every start-up of the CPU.
    #[derive(Debug)]
    pub struct CpState {
        slots: [Slot; BOXES],
        /// Counts the uses of the slots: the one that has been idle longest is released first.
        clock: Cell<u32>,
        /// Number of the start-up; 0: not asked for yet. See [`CpState::start_up`].
        start_up: Cell<u32>,
    }
}

ob1_sdk::state! {
    /// A box and the owner of the job in it.
    #[derive(Debug)]
    pub struct Slot {
        /// The block that uses the box; 0: none.
        pub(crate) owner: Cell<u64>,
        /// The start of the CP to which it belongs.
        pub(crate) generation: Cell<u32>,
        /// Number of the job.
        pub(crate) job: Cell<u16>,
        /// The last job whose data were all taken.
        pub(crate) had: Cell<u16>,
        /// How far the job is: a [`Phase`].
        phase: Cell<u8>,
        /// The piece shown last, or the number of pieces taken.
        pub(crate) piece: Cell<u16>,
        /// The room for data when the job began.
        pub(crate) room: Cell<u32>,
        /// Bytes for the CP when the job began.
        pub(crate) len: Cell<u32>,
        used: Cell<u32>,
    }
}

/// The phase of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    Idle,
    /// Data are being passed to the CP, or the CP executes the job.
    Giving,
    /// Data are being received.
    Taking,
}

impl Slot {
    pub(crate) fn phase(&self) -> Phase {
        match self.phase.get() {
            1 => Phase::Giving,
            2 => Phase::Taking,
            _ => Phase::Idle,
        }
    }

    pub(crate) fn set(&self, phase: Phase) {
        self.phase.set(phase as u8);
    }
}

impl CpState {
    /// A number for the current start-up, created at the first call. A number that a retentive data block has kept from
    /// an earlier start-up differs, with one exception: the number is a time that repeats every four seconds.
    pub(crate) fn start_up(&self, now: u64) -> u32 {
        if self.start_up.get() == 0 {
            self.start_up.set(now as u32 | 1);
        }
        self.start_up.get()
    }

    /// The box of a block; with `begins`, a block without a box gets one.
    pub(crate) fn slot(&self, owner: u64, begins: bool) -> Option<(usize, &Slot)> {
        let find = |wanted: u64| self.slots.iter().position(|slot| slot.owner.get() == wanted);
        let resting = || {
            let idle = self.slots.iter().enumerate().filter(|(_, slot)| slot.phase() == Phase::Idle);
            idle.min_by_key(|(_, slot)| slot.used.get()).map(|(index, _)| index)
        };
        let index = match find(owner) {
            Some(index) => index,
            None if begins => find(0).or_else(resting)?,
            None => return None,
        };
        let slot = self.slots.get(index)?;
        if begins {
            slot.owner.set(owner);
            self.clock.set(self.clock.get().wrapping_add(1));
            slot.used.set(self.clock.get());
        }
        Some((index, slot))
    }
}
