//! The interface between FC 1 to FC 4 and a CP 342-5: four data records at its address. (docs/cp342.md)
//!
//! | record | | content |
//! |---|---|---|
//! | [`SEND`] | written | the send area from its first byte on |
//! | [`RECEIVE`] | read | [`HEAD_BYTES`]: whether data are exchanged, DPSTATUS; then the whole receive area |
//! | [`JOB`] | written | [`JOB_DIAG`], DTYPE, STATION; or [`JOB_CONTROL`] and the job field |
//! | [`JOB`] | read | STATUS, high byte first, and what the job gives |

/// The record of the send area.
pub const SEND: u8 = 0xD0;
/// The record of the receive area.
pub const RECEIVE: u8 = 0xD1;
/// The record of jobs and their answers.
pub const JOB: u8 = 0xD2;

/// Maximum bytes of the send area and of the receive area.
pub const AREA_BYTES: usize = 2160;
/// Bytes before the receive area: 1 if data are exchanged, and DPSTATUS.
pub const HEAD_BYTES: usize = 2;
/// Maximum bytes of a job field, and of the answer to a job.
pub const FIELD_BYTES: usize = 240;
/// Bytes before the answer to a job: STATUS.
pub const STATUS_BYTES: usize = 2;
/// First byte of a job of DP_DIAG.
pub const JOB_DIAG: u8 = 1;
/// First byte of a job of DP_CTRL.
pub const JOB_CONTROL: u8 = 2;
/// Bytes of a list with one bit for each of 128 stations: station n is bit n modulo 8 of byte n / 8.
pub const LIST_BYTES: usize = 16;
/// Bytes of the shortest diagnosis of a slave.
pub const DIAGNOSIS_LEAST: usize = 6;
/// Instead of a station: all stations.
pub const ALL_STATIONS: u8 = 127;

/// Bits of DPSTATUS for a master.
pub mod dp_status {
    /// No data exchange with a slave: see the station list.
    pub const STATIONS: u8 = 0x02;
    /// There is an unread diagnosis: see the diagnostic list.
    pub const DIAGNOSIS: u8 = 0x04;
    /// First of the two bits with the mode of the master.
    pub const MODE_AT: u8 = 4;
}

/// Modes of a DP master: in DPSTATUS, and in the job fields.
pub mod mode {
    /// RUN: data are exchanged, outputs are active.
    pub const RUN: u8 = 0;
    /// CLEAR: data are exchanged, outputs are sent as zero.
    pub const CLEAR: u8 = 1;
    /// No data are exchanged.
    pub const STOP: u8 = 2;
    /// Not on the bus.
    pub const OFFLINE: u8 = 3;
}

/// DTYPE of DP_DIAG: what the block asks for.
pub mod dtype {
    /// The station list: one bit per address, set for slaves without data exchange.
    pub const STATIONS: u8 = 0;
    /// The diagnostic list: one bit per address, set for slaves with a new diagnosis.
    pub const DIAGNOSES: u8 = 1;
    /// The newest diagnosis of a slave.
    pub const CURRENT: u8 = 2;
    /// The next older diagnosis; each is returned once.
    pub const OLDER: u8 = 3;
    /// The mode that DP_CTRL has requested.
    pub const MODE: u8 = 4;
    /// The mode while the CPU is in STOP.
    pub const MODE_CPU_STOP: u8 = 5;
    /// The mode while the CP is in STOP.
    pub const MODE_CP_STOP: u8 = 6;
    /// Inputs of a slave of another master.
    pub const INPUTS: u8 = 7;
    /// Outputs of a slave of another master.
    pub const OUTPUTS: u8 = 8;
    /// State of a slave.
    pub const SLAVE: u8 = 10;
}

/// CTYPE of DP_CTRL: the first byte of the job field.
pub mod ctype {
    /// SYNC, FREEZE, CLEAR once.
    pub const GLOBAL: u8 = 0;
    /// SYNC, FREEZE, CLEAR cyclically.
    pub const CYCLIC_GLOBAL: u8 = 1;
    /// Deletes the older diagnoses that the CP keeps.
    pub const FORGET: u8 = 3;
    /// Sets the mode of the DP master (see the module `mode`).
    pub const MODE: u8 = 4;
    /// Sets the mode while the CPU is in STOP.
    pub const MODE_CPU_STOP: u8 = 5;
    /// Sets the mode while the CP is in STOP.
    pub const MODE_CP_STOP: u8 = 6;
    /// Reads inputs of a slave of another master.
    pub const INPUTS: u8 = 7;
    /// Reads outputs of a slave of another master.
    pub const OUTPUTS: u8 = 8;
    /// Ends the reading from a slave of another master.
    pub const END: u8 = 9;
    /// Deactivates or activates a slave.
    pub const SLAVE: u8 = 10;
}

/// STATUS of FC 1 to FC 4.
pub mod status {
    /// There is nothing new.
    pub const NOTHING: u16 = 0x8182;
    /// A parameter is not valid.
    pub const PARAMETER: u16 = 0x8184;
    /// Unknown DTYPE or CTYPE.
    pub const TYPE: u16 = 0x8311;
    /// The area of the parameter is too short.
    pub const SHORT: u16 = 0x8312;
    /// The address is not valid for a slave.
    pub const STATION: u16 = 0x8313;
    /// No slave with this address is configured.
    pub const NOT_CONFIGURED: u16 = 0x8341;
    /// The module does not support this job.
    pub const UNKNOWN: u16 = 0x80B0;
}
