//! The accounts of every scan: what the scan thread writes down, and what others read of it without the scan noticing.
//!
//! One writer, the scan; any number of readers. Everything is a relaxed atomic of its own, allocated at load: writing
//! takes no lock, allocates nothing and never waits, and reading costs the scan nothing. Nothing is ever reset
//! here: for figures from a moment on, a reader takes the difference of two snapshots ([`Figures::since`]).

mod count;
mod figures;
mod histogram;
mod record;
mod recorder;
mod trace;

pub use figures::{BlockFigures, Figures, ObFigures, ScanStatistics};
pub use histogram::{Distribution, Histogram};
pub(crate) use record::WORDS;
pub use record::{Flags, ScanRecord};
pub use recorder::Flight;

use ob1_model::BlockId;
use ob1_time::Span;

use crate::interrupts::priority_of;
pub(crate) use count::Count;
use histogram::Recording;
use recorder::Recorder;
pub(crate) use trace::{Ended, Trace, plugin_blocks};

/// What is recorded, and the thresholds for a late scan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AccountsConfig {
    /// A scan that begins this long after its deadline, or later, is late. 0: a tenth of the minimum cycle time, at
    /// least 100 µs.
    pub late: Span,
    /// A scan that takes this long, or longer, is late. 0: the minimum cycle time, or 10 ms without one.
    pub long: Span,
    /// Scans the flight recorder holds, 1 to 65536.
    pub recorder: usize,
    /// Keep nothing but the counters: for measuring what the rest costs.
    pub off: bool,
    /// Take the time of each call of a plugin's block: two more readings of the clock for each.
    pub blocks: bool,
}

impl Default for AccountsConfig {
    fn default() -> Self {
        Self { late: Span::ZERO, long: Span::ZERO, recorder: 256, off: false, blocks: true }
    }
}

impl AccountsConfig {
    /// The thresholds that apply with this minimum cycle time: (late, long).
    #[must_use]
    pub fn thresholds(&self, min_cycle: Span) -> (Span, Span) {
        let late = if self.late.is_zero() { (min_cycle / 10).max(Span::from_micros(100)) } else { self.late };
        let long = match (self.long, min_cycle) {
            (Span::ZERO, Span::ZERO) => Span::from_millis(10),
            (Span::ZERO, cycle) => cycle,
            (long, _) => long,
        };
        (late, long)
    }
}

/// The account of one organization block.
#[derive(Debug)]
pub(crate) struct ObAccount {
    pub(crate) ob: u16,
    pub(crate) runs: Count,
    pub(crate) overruns: Count,
    pub(crate) execution: Recording,
    pub(crate) lateness: Recording,
}

impl ObAccount {
    fn figures(&self) -> ObFigures {
        ObFigures {
            ob: self.ob,
            priority: priority_of(self.ob),
            runs: self.runs.get(),
            overruns: self.overruns.get(),
            execution: self.execution.read(),
            lateness: self.lateness.read(),
        }
    }
}

/// The account of one block of a plugin.
#[derive(Debug)]
pub(crate) struct BlockAccount {
    pub(crate) block: BlockId,
    pub(crate) name: Box<str>,
    pub(crate) execution: Recording,
}

impl BlockAccount {
    fn figures(&self) -> BlockFigures {
        BlockFigures { block: self.block, name: self.name.clone(), execution: self.execution.read() }
    }
}

/// Sums over all scans since load. The difference between two readings covers the scans between them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sums {
    /// Finished cycles in RUN.
    pub scans: u64,
    /// Those of them that were late.
    pub late: u64,
    /// From the deadlines of cycles to their starts.
    pub wake: Span,
    /// From the starts of cycles to their ends.
    pub execution: Span,
}

/// All accounts of one CPU. Written by its scan alone.
#[derive(Debug)]
pub struct Accounts {
    pub(crate) scans: Count,
    pub(crate) statements: Count,
    pub(crate) overruns: Count,
    pub(crate) missed: Count,
    pub(crate) watchdogs: Count,
    pub(crate) late: Count,
    pub(crate) cycle: Recording,
    pub(crate) execution: Recording,
    pub(crate) wake: Recording,
    /// Deadlines without a scan. Those with one are in `wake`.
    pub(crate) skipped: Recording,
    pub(crate) inputs: Recording,
    pub(crate) outputs: Recording,
    pub(crate) links: Recording,
    pub(crate) obs: Box<[ObAccount]>,
    pub(crate) blocks: Box<[BlockAccount]>,
    recorder: Recorder,
    late_from: Span,
    long_from: Span,
    pub(crate) off: bool,
}

impl Accounts {
    pub(crate) fn new(
        config: &AccountsConfig,
        min_cycle: Span,
        obs: &[u16],
        blocks: impl Iterator<Item = (BlockId, Box<str>)>,
    ) -> Self {
        let (late_from, long_from) = config.thresholds(min_cycle);
        let ob = |&ob: &u16| ObAccount {
            ob,
            runs: Count::default(),
            overruns: Count::default(),
            execution: Recording::new(),
            lateness: Recording::new(),
        };
        Self {
            scans: Count::default(),
            statements: Count::default(),
            overruns: Count::default(),
            missed: Count::default(),
            watchdogs: Count::default(),
            late: Count::default(),
            cycle: Recording::new(),
            execution: Recording::new(),
            wake: Recording::new(),
            skipped: Recording::new(),
            inputs: Recording::new(),
            outputs: Recording::new(),
            links: Recording::new(),
            obs: obs.iter().map(ob).collect(),
            blocks: blocks.map(|(block, name)| BlockAccount { block, name, execution: Recording::new() }).collect(),
            recorder: Recorder::new(config.recorder),
            late_from,
            long_from,
            off: config.off,
        }
    }

    /// The figures since load. May be read at any time from any thread; single figures of one reading may belong to
    /// neighbouring scans.
    #[must_use]
    pub fn figures(&self) -> Figures {
        let wake = self.wake.read();
        Figures {
            scans: self.scans.get(),
            statements: self.statements.get(),
            overruns: self.overruns.get(),
            missed: self.missed.get(),
            watchdogs: self.watchdogs.get(),
            late: self.late.get(),
            cycle: self.cycle.read(),
            execution: self.execution.read(),
            deadlines: wake.and(&self.skipped.read()),
            wake,
            inputs: self.inputs.read(),
            outputs: self.outputs.read(),
            links: self.links.read(),
            obs: self.obs.iter().map(ObAccount::figures).collect(),
            blocks: self.blocks.iter().map(BlockAccount::figures).collect(),
        }
    }

    /// Number of finished scans since load.
    #[must_use]
    pub fn scans(&self) -> u64 {
        self.scans.get()
    }

    /// The sums over all scans. May be read at any time from any thread; the running scan may already be in some of
    /// them.
    #[must_use]
    pub fn sums(&self) -> Sums {
        Sums { scans: self.scans.get(), late: self.late.get(), wake: self.wake.sum(), execution: self.execution.sum() }
    }

    /// The thresholds for a late scan: (start after its deadline, execution time).
    #[must_use]
    pub fn thresholds(&self) -> (Span, Span) {
        (self.late_from, self.long_from)
    }

    /// The last scans, oldest first. Records overwritten while they were copied are left out.
    #[must_use]
    pub fn flight(&self) -> Vec<ScanRecord> {
        self.recorder.read()
    }

    /// Takes the flight that an overrun has frozen, which makes room for the next one. There is one reader.
    #[must_use]
    pub fn take_frozen(&self) -> Option<Flight> {
        self.recorder.take_frozen()
    }

    /// Overruns that could not freeze the recorder because the previous flight had not been taken.
    #[must_use]
    pub fn freezes_skipped(&self) -> u64 {
        self.recorder.skipped()
    }
}
