//! What an engine can read and change, except references and frames of calls in progress.

use crate::arena::Db;
use crate::engine::hot::Values;
use crate::engine::regs::Interrupted;
use crate::machine::Machine;
use crate::made_data_blocks::Made;
use crate::timers::{Counter, Timer};

/// Bytes that are compared at one time.
const PIECE: usize = 64;

/// A copy of this state.
#[derive(Clone)]
pub(super) struct State {
    pub(super) arena: Box<[u8]>,
    pub(super) rest: Rest,
    interrupted: Option<Interrupted>,
}

/// All but the arena.
#[derive(Clone, PartialEq)]
pub(super) struct Rest {
    pub(super) hot: Values,
    pub(super) timers: Box<[Timer]>,
    pub(super) counters: Box<[Counter]>,
    made: Box<[Made]>,
    dbs: Box<[Db]>,
    /// Numbers of data blocks; the same as long as `made` is.
    numbers: Box<[u16]>,
    freed: bool,
}

impl Rest {
    pub(super) fn of(m: &Machine) -> Self {
        Self {
            hot: m.hot.values(),
            timers: m.timers.clone(),
            counters: m.counters.clone(),
            made: m.memory.made.clone(),
            dbs: m.memory.dbs.clone(),
            numbers: m.memory.by_number.clone(),
            freed: m.memory.freed,
        }
    }

    pub(super) fn restore(&self, m: &mut Machine) {
        m.hot.set_values(&self.hot);
        m.timers.copy_from_slice(&self.timers);
        m.counters.copy_from_slice(&self.counters);
        m.memory.made.copy_from_slice(&self.made);
        m.memory.dbs.copy_from_slice(&self.dbs);
        m.memory.by_number.copy_from_slice(&self.numbers);
        m.memory.freed = self.freed;
    }
}

/// Detects whether more than the hot state has changed.
pub(super) struct Marks {
    timers: Box<[Timer]>,
    counters: Box<[Counter]>,
    made: Box<[Made]>,
}

impl Marks {
    pub(super) fn of(m: &Machine) -> Self {
        Self { timers: m.timers.clone(), counters: m.counters.clone(), made: m.memory.made.clone() }
    }

    pub(super) fn are_still(&self, m: &Machine) -> bool {
        self.timers == m.timers && self.counters == m.counters && self.made == m.memory.made
    }
}

impl State {
    pub(super) fn of(m: &Machine) -> Self {
        Self { arena: m.memory.bytes.to_vec().into(), rest: Rest::of(m), interrupted: m.interrupted }
    }

    pub(super) fn restore(&self, m: &mut Machine) {
        m.memory.bytes.copy_from_slice(&self.arena);
        self.rest.restore(m);
        m.interrupted = self.interrupted;
    }
}

/// Bytes that have changed: where each piece begins, and what it holds now.
#[derive(Clone, Default)]
pub(super) struct Writes(Vec<(usize, Box<[u8]>)>);

impl Writes {
    /// What differs from `shadow`, which becomes the same.
    pub(super) fn since(shadow: &mut [u8], now: &[u8]) -> Self {
        let mut writes = Vec::new();
        for (index, (old, new)) in shadow.chunks_mut(PIECE).zip(now.chunks(PIECE)).enumerate() {
            if old != new {
                old.copy_from_slice(new);
                writes.push((index * PIECE, new.into()));
            }
        }
        Self(writes)
    }

    pub(super) fn apply(&self, to: &mut [u8]) {
        for (at, bytes) in &self.0 {
            if let Some(place) = to.get_mut(*at..*at + bytes.len()) {
                place.copy_from_slice(bytes);
            }
        }
    }
}
