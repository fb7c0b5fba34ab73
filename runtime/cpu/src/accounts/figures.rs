//! What the accounts say at one moment, for readers outside the scan.

use ob1_model::BlockId;

use super::histogram::{Distribution, Histogram};

/// The figures of all accounts since load, or between two readings.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Figures {
    /// Finished cycles in RUN.
    pub scans: u64,
    /// Statements executed, of all organization blocks.
    pub statements: u64,
    /// Cycles that had not ended when the next was due.
    pub overruns: u64,
    /// Deadlines without a cycle: skipped after an overrun or after a late wake-up.
    pub missed: u64,
    /// Cycles in which the watchdog expired.
    pub watchdogs: u64,
    /// Scans that began late or took long, by the thresholds.
    pub late: u64,
    /// From the start of a cycle to the start of the next.
    pub cycle: Histogram,
    /// From the start of a cycle to its end, without the wait.
    pub execution: Histogram,
    /// From the deadline of a cycle to its start: one value a cycle.
    pub wake: Histogram,
    /// Like `wake`, with one more value for each missed deadline: how late the next cycle began after it. A pause of
    /// ten cycles counts as ten late deadlines here and as one late cycle in `wake`.
    pub deadlines: Histogram,
    /// Back plane and process image before OB 1: events of the modules, inputs.
    pub inputs: Histogram,
    /// Process image and back plane after OB 1: outputs, doorbells.
    pub outputs: Histogram,
    /// The exchange with links that read or write: their writes and the copy of what they watch. Part of `inputs`.
    pub links: Histogram,
    /// Each loaded organization block, in ascending order.
    pub obs: Vec<ObFigures>,
    /// Each block of a plugin, if the times of its calls are recorded
    /// ([`AccountsConfig::blocks`](super::AccountsConfig)).
    pub blocks: Vec<BlockFigures>,
}

impl Figures {
    /// The difference to an earlier reading of the same accounts.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        let ob =
            |(now, then): (&ObFigures, Option<&ObFigures>)| then.map_or_else(|| now.clone(), |then| now.since(then));
        let block = |(now, then): (&BlockFigures, Option<&BlockFigures>)| {
            let execution = then.map_or_else(|| now.execution.clone(), |then| now.execution.since(&then.execution));
            BlockFigures { execution, ..now.clone() }
        };
        Self {
            scans: self.scans.saturating_sub(earlier.scans),
            statements: self.statements.saturating_sub(earlier.statements),
            overruns: self.overruns.saturating_sub(earlier.overruns),
            missed: self.missed.saturating_sub(earlier.missed),
            watchdogs: self.watchdogs.saturating_sub(earlier.watchdogs),
            late: self.late.saturating_sub(earlier.late),
            cycle: self.cycle.since(&earlier.cycle),
            execution: self.execution.since(&earlier.execution),
            wake: self.wake.since(&earlier.wake),
            deadlines: self.deadlines.since(&earlier.deadlines),
            inputs: self.inputs.since(&earlier.inputs),
            outputs: self.outputs.since(&earlier.outputs),
            links: self.links.since(&earlier.links),
            obs: self.obs.iter().enumerate().map(|(i, now)| ob((now, earlier.obs.get(i)))).collect(),
            blocks: self.blocks.iter().enumerate().map(|(i, now)| block((now, earlier.blocks.get(i)))).collect(),
        }
    }

    /// The usual figures of the scan.
    #[must_use]
    pub fn statistics(&self) -> ScanStatistics {
        ScanStatistics {
            scans: self.scans,
            statements: self.statements,
            overruns: self.overruns,
            watchdogs: self.watchdogs,
            cycle: self.cycle.distribution(),
            execution: self.execution.distribution(),
        }
    }
}

/// The figures of one organization block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObFigures {
    /// Number of the organization block.
    pub ob: u16,
    /// Priority class of the organization block.
    pub priority: u8,
    /// Completed runs since load.
    pub runs: u64,
    /// Requests lost, periods skipped, and requests that came while it was still being executed.
    pub overruns: u64,
    /// From start to end, without the higher classes that ran meanwhile.
    pub execution: Histogram,
    /// From the due time to the start: OB 1 against its deadline, interrupts against theirs. Empty for the others.
    pub lateness: Histogram,
}

impl ObFigures {
    fn since(&self, earlier: &Self) -> Self {
        Self {
            runs: self.runs.saturating_sub(earlier.runs),
            overruns: self.overruns.saturating_sub(earlier.overruns),
            execution: self.execution.since(&earlier.execution),
            lateness: self.lateness.since(&earlier.lateness),
            ..*self
        }
    }
}

/// The figures of one block of a plugin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockFigures {
    /// Kind and number under which it is loaded.
    pub block: BlockId,
    /// Name of the block, as the plugin gives it.
    pub name: Box<str>,
    /// Each call, without organization blocks and plugin blocks that ran within it.
    pub execution: Histogram,
}

/// Figures of the scans since load.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanStatistics {
    /// Finished cycles in RUN.
    pub scans: u64,
    /// Statements executed, of all organization blocks.
    pub statements: u64,
    /// Cycles that had not ended when the next was due.
    pub overruns: u64,
    /// Cycles in which the watchdog expired.
    pub watchdogs: u64,
    /// From the start of a cycle to the start of the next.
    pub cycle: Distribution,
    /// From the start of a cycle to its end, without the wait.
    pub execution: Distribution,
}
