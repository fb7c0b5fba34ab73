//! The differences between the CPs of the family, one row per type.

use ob1_params::CpKind;

/// Longest job of any of them in bytes. [TIA help "PtP data link CP 341"]
pub(crate) const JOB_MAX: usize = 4096;

/// Longest job, and longest telegram, of a CP 340. [CP 340 manual 04/2011, p. 67]
pub(crate) const JOB_MAX_340: usize = 1024;

/// What one type of the family has of its own.
#[derive(Debug)]
pub(crate) struct Model {
    pub(crate) kind: CpKind,
    /// Longest job, longest telegram, and size of the receive buffer, in bytes.
    pub(crate) bytes: usize,
    /// STATUS of a job that is longer, or of no bytes. (docs/cp341-events.md)
    pub(crate) length: u16,
    /// First byte of the diagnostic data when the parameters are wrong. [CP 341 manual 09/2008, p. 204]
    pub(crate) parameters_wrong: u8,
}

const CP341: Model = Model { kind: CpKind::Cp341, bytes: JOB_MAX, length: 0x0518, parameters_wrong: 0x83 };

/// [CP 340 manual 04/2011, p. 143]
const CP340: Model = Model { kind: CpKind::Cp340, bytes: JOB_MAX_340, length: 0x0517, parameters_wrong: 0x81 };

impl Model {
    /// The row of a type; those of another family have none and get that of the CP 341.
    pub(crate) const fn of(kind: CpKind) -> &'static Self {
        match kind {
            CpKind::Cp340 => &CP340,
            CpKind::Cp341 | CpKind::Cp240 | CpKind::Cp040 | CpKind::Cp343 => &CP341,
        }
    }
}
