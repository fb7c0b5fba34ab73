//! What happened while a recording ran, besides rows and runs of organization blocks.

use ob1_timing::snapshot::LateEntry;
use serde::{Deserialize, Serialize};

/// An event. Times are those of the recording's clock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A part begins: the rows after this event belong to it, history first.
    Part {
        /// Number of the part, from 1.
        number: u64,
        /// When its trigger fired.
        time_ns: u64,
        /// What fired.
        why: String,
    },
    /// A part is complete.
    Complete {
        /// Number of the part.
        number: u64,
        /// When it ended.
        time_ns: u64,
    },
    /// An entry of the diagnostic buffer.
    Diagnosis {
        /// When it was entered.
        time_ns: u64,
        /// Its number: `4562h`.
        number: String,
        /// What it says.
        text: String,
    },
    /// A late scan and its cause.
    Late(LateEntry),
    /// The process of a driver, a bus or a link is there, or is not any more.
    Process {
        /// When that was seen.
        time_ns: u64,
        /// Name of the module, bus or link.
        name: String,
        /// It is there.
        up: bool,
    },
    /// An order of a CP, from the block that gave it to the acknowledgement.
    Order {
        /// Name of the module.
        module: String,
        /// When the block handed it over.
        time_ns: u64,
        /// From then to the acknowledgement.
        took_ns: u64,
        /// What it was.
        what: String,
        /// What the CP said: 0 without an error.
        status: u32,
    },
    /// The recording has ended.
    End {
        /// When.
        time_ns: u64,
        /// Why: `time`, `size`, `station`.
        why: String,
        /// Rows written.
        rows: u64,
        /// Rows lost.
        lost: u64,
    },
}

impl Event {
    /// When it was; of a late scan when it was due.
    pub const fn time_ns(&self) -> u64 {
        match self {
            Self::Part { time_ns, .. }
            | Self::Complete { time_ns, .. }
            | Self::Diagnosis { time_ns, .. }
            | Self::Process { time_ns, .. }
            | Self::Order { time_ns, .. }
            | Self::End { time_ns, .. } => *time_ns,
            Self::Late(late) => late.planned_ns,
        }
    }
}
