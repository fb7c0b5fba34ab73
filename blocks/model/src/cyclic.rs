//! Cyclic data of S7 communication: what a client may ask for, for those who serve it and for status list 0131/3.

/// Limits of cyclic data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CyclicLimits {
    /// Jobs at one time.
    pub jobs: u16,
    /// The longest period, in steps of 100 ms; the shortest is one.
    pub longest: u16,
    /// Bytes of a job of the operator interface, as the list tells them.
    pub bytes: u16,
}

/// Of an S7-300. [recorded from a 315-2]
pub const CYCLIC_300: CyclicLimits = CyclicLimits { jobs: 16, longest: 521, bytes: 240 };
/// Of an S7-400. [recorded from an S7-400 with a PDU of 480]
pub const CYCLIC_400: CyclicLimits = CyclicLimits { jobs: 32, longest: 900, bytes: 480 };
