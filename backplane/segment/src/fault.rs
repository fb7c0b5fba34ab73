//! Faults of a segment, or of what the other side has written into it.

use thiserror::Error;

/// The other side has written something without a meaning. A fault of that CP, never of the scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Fault {
    /// The word with the driver's state has no meaning.
    #[error("the driver's state word {0:#x} has no meaning")]
    DriverState(u64),
    /// The word with the CPU's state has no meaning.
    #[error("the CPU's state word {0:#x} has no meaning")]
    CpuState(u64),
    /// The counters of the event ring contradict each other; the events in it are dropped.
    #[error("the event ring's counters contradict each other ({produced} produced, {consumed} consumed)")]
    EventRing {
        /// Events the driver says it has produced.
        produced: u64,
        /// Events the CPU side has consumed.
        consumed: u64,
    },
    /// An event of an unknown kind, or with more data than fits; it is dropped.
    #[error("an event with the head word {0:#x} has no meaning")]
    Event(u64),
    /// A record claims to be longer than fits.
    #[error("a data record claims {0} bytes")]
    RecordLength(u64),
    /// The JSON text of the parameter record claims to be longer than fits.
    #[error("the parameter record claims {0} bytes of JSON")]
    ParameterLength(u64),
}

/// A segment cannot be created, opened or attached to.
#[derive(Debug, Error)]
pub enum SegmentError {
    /// The operating system refused.
    #[error("{action}: {source}")]
    Io {
        /// What was being done when it failed ("mapping the segment").
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not sealed against shrinking and growing: whoever holds it could kill every process that maps it.
    #[error("the segment is not sealed against shrinking and growing")]
    NotSealed,
    /// The file does not have the size of a segment.
    #[error("the segment has {found} bytes instead of {expected}")]
    Size {
        /// Its size in bytes.
        found: u64,
        /// The size it must have; for a segment, the size without boxes.
        expected: u64,
    },
    /// A word of the header is not what this layout version requires.
    #[error("the segment's header is wrong: {field} is {found:#x}")]
    Header {
        /// Name of the field as in `docs/backplane.md`.
        field: &'static str,
        /// What the word contains instead.
        found: u64,
    },
    /// Another driver is attached: a segment has one at a time.
    #[error("a driver is attached to the segment already")]
    InUse,
    /// The number of register bytes is outside 8 to 64.
    #[error("a module cannot have {0} register bytes each way (8 to 64)")]
    IoBytes(usize),
}

/// Data that does not fit. Nothing was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{found} bytes do not fit into {room}")]
pub struct TooLong {
    /// Bytes of the data offered.
    pub found: usize,
    /// Bytes there is room for.
    pub room: usize,
}
