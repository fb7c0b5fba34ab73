//! STATUS and RET_VAL. 8001h and 80FFh are those of the manual's FC 100 [S0 "FC 100"]; the others are ours.

use crate::records::Fault;

/// No error, or a job runs.
pub(crate) const OK: u16 = 0x0000;
/// No answer. [S0 "FC 100"]
pub(crate) const NO_ANSWER: u16 = 0x8001;
/// The bus is short-circuited.
pub(crate) const SHORT_CIRCUIT: u16 = 0x8003;
/// A response byte that does not exist. [S0 "FC 100"]
pub(crate) const UNDEFINED: u16 = 0x80FF;
/// The CP did not accept the order, or was reset: FC 0 or FC 1 has ended with an error.
pub(crate) const CP_FAILED: u16 = 0x8101;
/// FC 0 or FC 1 reports a parameter error, or does not exist under the given number.
pub(crate) const NO_HANDLING_BLOCK: u16 = 0x8102;
/// No end of the exchange within TIMEOUT.
pub(crate) const TIMEOUT: u16 = 0x8103;
/// No meter has acknowledged the selection.
pub(crate) const NOT_SELECTED: u16 = 0x8104;
/// The meter has answered without data.
pub(crate) const NO_DATA: u16 = 0x8105;
/// A CI field the library does not know.
pub(crate) const UNKNOWN_CI: u16 = 0x8106;
/// The meter reports an error of its application; the header has its code.
pub(crate) const APPLICATION: u16 = 0x8107;
/// The answer is truncated or malformed; the records before the fault are stored.
pub(crate) const MALFORMED: u16 = 0x8108;
/// The data block does not exist, is write-protected or has no room for the header.
pub(crate) const NO_DB: u16 = 0x8109;
/// The data block has no room for all records; the first ones are stored.
pub(crate) const DB_FULL: u16 = 0x810A;
/// The answer is encrypted.
pub(crate) const ENCRYPTED: u16 = 0x810B;
/// NEXT without a previous answer.
pub(crate) const NO_FIRST: u16 = 0x810C;

/// STATUS of an answer without records.
pub(crate) fn of(fault: Fault) -> u16 {
    match fault {
        Fault::NoData => NO_DATA,
        Fault::UnknownCi(_) => UNKNOWN_CI,
        Fault::Application(_) => APPLICATION,
        Fault::Malformed => MALFORMED,
        Fault::Encrypted => ENCRYPTED,
    }
}
