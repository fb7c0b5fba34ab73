//! Who has something that one block at a time uses: `TX`, the own order of RK 512, the telegram in `RX`.
//!
//! A claim has an owner, a reason to end (the job has ended, the CP has restarted, FC 9 has synchronised, the owner is
//! no longer called while another block asks) and, where several blocks ask, a queue: who asks in vain comes next, in
//! the order of asking. So no block starves another, whatever the order and frequency of the calls (ours).

use std::cell::Cell;

use ob1_sdk::ModuleInfo;

/// An owner that has not been called for this time, in nanoseconds, loses its claim to a block that asks.
pub(crate) const GIVEN_UP: u64 = 2_000_000_000;
/// The same for a block that only wants to look, and must not cost another one its job: the longest period of an OB
/// that may call it.
const GIVEN_UP_FOR_A_LOOK: u64 = 60_000_000_000;
/// A block that waits and has not been called for this time, in nanoseconds, loses its place.
const PATIENCE: u64 = 1_000_000_000;
/// Places in a queue; a block that finds none asks again.
const PLACES: usize = 8;

/// What a block does with a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Role {
    /// FC 0: the telegram from its data block.
    Send = 1,
    /// FC 8: a line command.
    Line,
    /// FC 2, FC 3: an order.
    Order,
    /// FC 4: the answer to an order of the partner.
    Answer,
    /// FC 1, FC 11: the telegram for its data block.
    Receive,
}

/// A block that has a claim or asks for it: its role, and what tells it from others of that role. The control bits of
/// the program are not sufficient for that, and the plugin does not see where they lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Key(u64);

impl Key {
    /// The key as a number other than 0.
    pub(crate) const fn number(self) -> u64 {
        self.0
    }

    /// `id`: up to 56 bits.
    pub(crate) const fn new(role: Role, id: u64) -> Self {
        Self((role as u64) << 56 | id & ((1 << 56) - 1))
    }

    /// FC 0, FC 1, FC 11: the data block and ABD.
    pub(crate) fn area(role: Role, db: u16, abd: u16) -> Self {
        Self::new(role, u64::from(db) << 16 | u64::from(abd))
    }
}

ob1_sdk::state! {
    /// The claim of a block: valid only for the start of the CP at which it was made. The control bits of the program
    /// are not sufficient: they may be in a retentive data block, or outside the bytes that FC 9 clears (as in the
    /// manual's EnOcean program [S0 L3164]).
    #[derive(Debug, Default)]
    pub(crate) struct Claim {
        /// The owner's key; 0: nobody.
        owner: Cell<u64>,
        generation: Cell<u32>,
        /// When the owner was called last.
        seen: Cell<u64>,
        /// What the control words of the owner contain while its job runs: they must match. 0: no job runs yet.
        progress: Cell<u32>,
        /// A job has lost its claim, and its control bits may still stand: only a call with the key of the owner
        /// continues a job.
        orphans: Cell<bool>,
    }
}

impl Claim {
    /// A block takes it for the current start of the CP. No job runs yet.
    pub(crate) fn take(&self, key: Key, module: &ModuleInfo, now: u64) {
        let before = self.owner.replace(key.0);
        self.orphans.set(self.orphans.get() || before != 0 && before != key.0);
        self.generation.set(module.generation);
        self.seen.set(now);
        self.progress.set(0);
    }

    /// The job has ended.
    pub(crate) fn release(&self) {
        self.owner.set(0);
        self.progress.set(0);
    }

    /// The owner does not end its job: its control bits may still stand.
    pub(crate) fn abandon(&self) {
        self.release();
        self.orphans.set(true);
    }

    /// FC 9 has reset the CP: no owner, no orphans.
    pub(crate) fn clear(&self) {
        self.release();
        self.orphans.set(false);
    }

    /// The control words of the job after this call.
    pub(crate) fn note(&self, progress: u32) {
        self.progress.set(progress);
    }

    /// True while somebody has it, the CP is present and has not restarted since.
    pub(crate) fn holds(&self, module: &ModuleInfo) -> bool {
        self.owner.get() != 0 && module.present && self.generation.get() == module.generation
    }

    /// The owner and the control words of its job.
    pub(crate) fn job(&self) -> (u64, u32) {
        (self.owner.get(), self.progress.get())
    }

    /// Whether this block has it, of whatever start of the CP.
    pub(crate) fn is_of(&self, key: Key) -> bool {
        self.owner.get() == key.0
    }

    /// The control words of the running job.
    pub(crate) fn progress(&self) -> u32 {
        self.progress.get()
    }

    /// When the owner was called last.
    pub(crate) fn seen(&self) -> u64 {
        self.seen.get()
    }

    /// Whether the control bits of a job that has lost its claim may still stand.
    pub(crate) fn has_orphans(&self) -> bool {
        self.orphans.get()
    }

    /// Whether a job is under way.
    pub(crate) fn is_busy(&self) -> bool {
        self.progress.get() != 0
    }

    /// Whether the running job is that of the calling block, which shows a running job with this key and these control
    /// words. The owner is then seen.
    pub(crate) fn continues(&self, key: Key, progress: u32, module: &ModuleInfo, now: u64) -> bool {
        let of_role = self.owner.get() >> 56 == key.0 >> 56;
        let is_mine = if self.orphans.get() { self.is_of(key) } else { of_role };
        let continues = self.holds(module) && is_mine && self.progress.get() == progress && progress != 0;
        if continues {
            self.seen.set(now);
        }
        continues
    }

    /// A block shows a running job that is none: from now on there is no other one.
    pub(crate) fn orphan_told(&self) {
        self.orphans.set(false);
    }

    /// Whether the owner was called less than [`GIVEN_UP`] ago.
    pub(crate) fn is_alive(&self, module: &ModuleInfo, now: u64) -> bool {
        self.holds(module) && now.saturating_sub(self.seen.get()) < GIVEN_UP
    }
}

ob1_sdk::state! {
    /// A block that waits: its key (0: the place is free), and when it asked last.
    #[derive(Debug, Default)]
    struct Waiter {
        key: Cell<u64>,
        asked: Cell<u64>,
    }
}

ob1_sdk::state! {
    /// A claim for which blocks wait.
    #[derive(Debug, Default)]
    pub(crate) struct Turn {
        pub(crate) claim: Claim,
        waiting: [Waiter; PLACES],
    }
}

/// The answer to a block that asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Take {
    /// Another block has it, or comes first: ask again.
    No,
    /// It is the block's.
    Yes,
    /// It is the block's, and its last owner has not ended its job.
    Over,
}

impl Turn {
    /// A block asks for the claim, or for the one it already has but whose job has not begun.
    pub(crate) fn take(&self, key: Key, module: &ModuleInfo, now: u64) -> Take {
        let claim = &self.claim;
        if claim.holds(module) {
            if claim.is_of(key) && !claim.is_busy() {
                claim.seen.set(now);
                return Take::Yes;
            }
            // The owner itself asks, without the control bits of its job: the program has reset them. A second block
            // with the same data waits: the owner is called between two of its calls.
            let resigned = claim.is_of(key) && self.asked(key).is_some_and(|asked| claim.seen.get() < asked);
            if claim.is_alive(module, now) && !resigned {
                self.wait(key, now);
                return Take::No;
            }
        }
        if self.first(now).is_some_and(|first| first != key.0) {
            self.wait(key, now);
            return Take::No;
        }
        self.forget(key);
        let over = claim.owner.get() != 0;
        claim.take(key, module, now);
        if over { Take::Over } else { Take::Yes }
    }

    /// Whether a block that only wants to look would get the claim at once.
    pub(crate) fn is_free(&self, key: Key, module: &ModuleInfo, now: u64) -> bool {
        let claim = &self.claim;
        let is_abandoned = now.saturating_sub(claim.seen.get()) >= GIVEN_UP_FOR_A_LOOK;
        (!claim.holds(module) || claim.is_of(key) || is_abandoned) && self.first(now).is_none_or(|first| first == key.0)
    }

    /// A block that has asked does so no longer, because its job has ended before it began or cannot begin: it keeps
    /// nobody waiting. Returns whether it had the claim.
    pub(crate) fn leave(&self, key: Key) -> bool {
        self.forget(key);
        let had = self.claim.is_of(key) && !self.claim.is_busy();
        if had {
            self.claim.release();
        }
        had
    }

    /// The place of this block is free.
    fn forget(&self, key: Key) {
        if let Some(place) = self.waiting.iter().find(|place| place.key.get() == key.0) {
            place.key.set(0);
        }
    }

    /// FC 9 has reset the CP: no owner, nobody waits.
    pub(crate) fn clear(&self) {
        self.claim.clear();
        self.waiting.iter().for_each(|place| place.key.set(0));
    }

    /// When this block asked last.
    fn asked(&self, key: Key) -> Option<u64> {
        self.waiting.iter().find(|place| place.key.get() == key.0).map(|place| place.asked.get())
    }

    /// The block that comes next.
    fn first(&self, now: u64) -> Option<u64> {
        let waits = |place: &&Waiter| place.key.get() != 0 && now.saturating_sub(place.asked.get()) < PATIENCE;
        self.waiting.iter().find(waits).map(|place| place.key.get())
    }

    /// Gives the block a place, or notes that it still waits. Places of those that no longer ask are free.
    fn wait(&self, key: Key, now: u64) {
        let (mut kept, mut has_place) = (0, false);
        for place in &self.waiting {
            let (waiting, asked) = (place.key.take(), place.asked.get());
            let is_key = waiting == key.0;
            if waiting == 0 || !is_key && now.saturating_sub(asked) >= PATIENCE {
                continue;
            }
            has_place |= is_key;
            self.waiting[kept].set(waiting, if is_key { now } else { asked });
            kept += 1;
        }
        if !has_place && let Some(place) = self.waiting.get(kept) {
            place.set(key.0, now);
        }
    }
}

impl Waiter {
    fn set(&self, key: u64, asked: u64) {
        self.key.set(key);
        self.asked.set(asked);
    }
}
