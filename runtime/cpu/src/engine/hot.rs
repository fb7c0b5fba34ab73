//! What an engine accesses all the time, in one structure with a layout that compiled code can rely on.

use std::sync::atomic::{AtomicBool, AtomicPtr};

use ob1_time::Instant;

use crate::arena::Db;
use crate::timers::{Counter, Timer};

/// The state of a CPU that engines read and write directly. One for each CPU; [`super::Context::hot`] hands it out.
///
/// The pointers are for compiled code. They are `AtomicPtr`, which has the layout of a plain pointer, because a CPU
/// moves between threads as a whole; nobody needs their atomicity. [`super::Context::hot`] fills them in, and they hold
/// until [`super::Engine::call`] returns: what they point to never moves while the CPU lives.
#[derive(Debug)]
#[repr(C)]
pub struct Hot {
    /// Statements executed that the clock has not been told of yet.
    pub pending: u32,
    /// With this many pending, a safe point reads the clock.
    pub look_after: u32,
    /// Bytes of the local data stack in use.
    pub local_top: u32,
    /// References to actual parameters on their stack.
    pub refs_top: u32,
    /// Bytes of the scratch of calls in use.
    pub scratch_top: u32,
    /// Blocks nested in the running organization block.
    pub depth: u32,
    /// A block requested STOP or a fault led to it: every safe point aborts.
    pub stopping: bool,
    /// The CPU's own time: moves at safe points and cycle control points, nowhere else.
    pub now: Instant,
    /// Not 0: the next safe point looks, whatever `pending` says. Other threads set it.
    pub due: AtomicPtr<AtomicBool>,
    /// The arena's first byte.
    pub arena: AtomicPtr<u8>,
    /// Length of the arena in bytes.
    pub arena_len: u32,
    /// References that the stack of references has room for.
    pub refs_len: u32,
    /// The stack of references to actual parameters: an [`super::ArenaBit`], a number, or, with [`super::RAW`] set, a
    /// pointer that is looked up at each access.
    pub refs: AtomicPtr<u32>,
    /// By the number of a data block: 1 + its place in `dbs`, 0 when it is not loaded.
    pub db_index: AtomicPtr<u16>,
    /// Entries of `db_index`; numbers beyond are not loaded.
    pub db_index_len: u32,
    /// Data blocks in `dbs`.
    pub dbs_len: u32,
    /// Places of the loaded data blocks, `dbs_len` of them.
    pub dbs: AtomicPtr<Db>,
    /// Timers, as many as [`super::Plan::timers`].
    pub timers: AtomicPtr<Timer>,
    /// Counters, as many as [`super::Plan::counters`].
    pub counters: AtomicPtr<Counter>,
}

impl Default for Hot {
    /// Nothing runs. The first safe point reads the clock.
    fn default() -> Self {
        Self {
            pending: 0,
            look_after: 1,
            local_top: 0,
            refs_top: 0,
            scratch_top: 0,
            depth: 0,
            stopping: false,
            now: Instant::START,
            due: AtomicPtr::default(),
            arena: AtomicPtr::default(),
            arena_len: 0,
            refs_len: 0,
            refs: AtomicPtr::default(),
            db_index: AtomicPtr::default(),
            db_index_len: 0,
            dbs_len: 0,
            dbs: AtomicPtr::default(),
            timers: AtomicPtr::default(),
            counters: AtomicPtr::default(),
        }
    }
}

/// The hot state without its pointers and without the flags that other threads set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Values {
    pub(crate) pending: u32,
    pub(crate) look_after: u32,
    pub(crate) local_top: u32,
    pub(crate) refs_top: u32,
    pub(crate) scratch_top: u32,
    pub(crate) depth: u32,
    pub(crate) stopping: bool,
    pub(crate) now: Instant,
}

impl Hot {
    pub(crate) const fn values(&self) -> Values {
        let Self { pending, look_after, local_top, refs_top, scratch_top, depth, stopping, now, .. } = *self;
        Values { pending, look_after, local_top, refs_top, scratch_top, depth, stopping, now }
    }

    pub(crate) fn set_values(&mut self, values: &Values) {
        let Values { pending, look_after, local_top, refs_top, scratch_top, depth, stopping, now } = *values;
        (self.pending, self.look_after, self.stopping, self.now) = (pending, look_after, stopping, now);
        (self.local_top, self.refs_top, self.scratch_top, self.depth) = (local_top, refs_top, scratch_top, depth);
    }

    /// Empties the stacks, as after an aborted run.
    pub(crate) fn unwind(&mut self) {
        (self.refs_top, self.scratch_top, self.local_top, self.depth) = (0, 0, 0, 0);
    }
}

const _: () = assert!(size_of::<AtomicPtr<u8>>() == size_of::<*mut u8>());
