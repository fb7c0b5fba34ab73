//! STATUS of the three blocks. (docs/cp040-registers.md)

use ob1_words::slio::Failure;

/// No error, and no job runs.
pub(crate) const NONE: u16 = 0x0000;
/// A job runs; no error.
pub(crate) const RUNNING: u16 = 0x8181;
/// Block and CP are not synchronised (a synchronous reset corrects this), or IO_SIZE is not that of the module.
pub(crate) const NOT_SYNCHRONISED: u16 = 0x0202;
/// Data block not valid.
pub(crate) const DATA_BLOCK: u16 = 0x0301;
/// Length 0 or above 1024.
pub(crate) const LENGTH: u16 = 0x0517;
/// Transfer failed: the partner does not answer, the order was acknowledged negatively, or a reset has ended it.
pub(crate) const FAILED: u16 = 0x070A;
/// Peripheral access error when reading.
pub(crate) const READ_ACCESS: u16 = 0x80A0;
/// Peripheral access error when writing.
pub(crate) const WRITE_ACCESS: u16 = 0x80A1;
/// Receive data block too short.
pub(crate) const TOO_SHORT: u16 = 0x8323;
/// Receive data block not readable: not present, or write-protected.
pub(crate) const NOT_READABLE: u16 = 0x833A;

/// Whether the telegram waits in the CP until the data block can take it.
pub(crate) const fn is_of_data_block(status: u16) -> bool {
    matches!(status, TOO_SHORT | NOT_READABLE | DATA_BLOCK)
}

/// STATUS for a failure of the CP.
pub(crate) const fn of(failure: Failure) -> u16 {
    match failure {
        Failure::NotSynchronised => NOT_SYNCHRONISED,
        Failure::Length => LENGTH,
        Failure::Communication => FAILED,
    }
}
