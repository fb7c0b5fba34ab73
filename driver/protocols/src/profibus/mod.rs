//! PROFIBUS on the wire: telegrams of the data link layer, and the diagnosis of a DP slave. ["EN 50170-2", DIN 19245
//! parts 1 and 3]
//!
//! The master is a separate stack; this module contains what all readers of the line must agree on.

pub mod diagnosis;
pub mod telegram;

pub use diagnosis::{Block, Diagnosis};
pub use telegram::{Parsed, Telegram};

/// Bits of a character: start bit, eight data bits, even parity, one stop bit.
pub const CHARACTER_BITS: u32 = 11;
/// TSYN: the line is quiet for this many bits before a request, so that all know that one begins.
pub const SYNC_BITS: u32 = 33;
/// The shortest time from a request to its answer, in bits (min TSDR).
pub const MIN_ANSWER_BITS: u32 = 11;
/// The highest address a station can have.
pub const LAST_ADDRESS: u8 = 125;
/// Address of all stations.
pub const BROADCAST: u8 = 127;
/// Maximum bytes of user data in a telegram.
pub const DATA_BYTES: usize = 244;
/// The longest telegram in bytes, delimiters included.
pub const TELEGRAM_BYTES: usize = 255;

/// Service access points of DP: the service that a telegram to a slave addresses.
pub mod sap {
    /// The master's own services (MS0).
    pub const MASTER: u8 = 62;
    /// A new address for the slave.
    pub const SET_ADDRESS: u8 = 55;
    /// Its inputs, for others.
    pub const READ_INPUTS: u8 = 56;
    /// Its outputs, for others.
    pub const READ_OUTPUTS: u8 = 57;
    /// Sync, freeze, clear; to all or a group.
    pub const GLOBAL_CONTROL: u8 = 58;
    /// Its configuration, for any master.
    pub const GET_CONFIG: u8 = 59;
    /// Slave_Diag: the slave gives its diagnosis.
    pub const DIAGNOSIS: u8 = 60;
    /// Set_Prm: the slave gets its parameters.
    pub const PARAMETERS: u8 = 61;
    /// The configuration that it must check.
    pub const CHECK_CONFIG: u8 = 62;

    /// The name of the service.
    pub const fn text(sap: Option<u8>) -> &'static str {
        match sap {
            None => "Data_Exchange",
            Some(SET_ADDRESS) => "Set_Slave_Add",
            Some(READ_INPUTS) => "RD_Inp",
            Some(READ_OUTPUTS) => "RD_Outp",
            Some(GLOBAL_CONTROL) => "Global_Control",
            Some(GET_CONFIG) => "Get_Cfg",
            Some(DIAGNOSIS) => "Slave_Diag",
            Some(PARAMETERS) => "Set_Prm",
            Some(CHECK_CONFIG) => "Chk_Cfg",
            Some(_) => "unknown SAP",
        }
    }
}

/// Function codes: the low bits of FC.
pub mod function {
    /// Bit of a request; without it FC is that of an answer.
    pub const REQUEST: u8 = 0x40;
    /// Frame count bit: changes with each new request.
    pub const COUNT: u8 = 0x20;
    /// The frame count bit is valid.
    pub const COUNT_VALID: u8 = 0x10;
    /// Send data without acknowledge, low priority.
    pub const SDN: u8 = 4;
    /// The same with high priority.
    pub const SDN_HIGH: u8 = 6;
    /// Request of the status of the data link layer.
    pub const STATUS: u8 = 9;
    /// Send and request data, low priority.
    pub const SRD: u8 = 12;
    /// The same with high priority.
    pub const SRD_HIGH: u8 = 13;

    /// Answer: done, no data.
    pub const OK: u8 = 0;
    /// Answer: the service access point is not open.
    pub const NOT_OPEN: u8 = 3;
    /// Answer: data of the slave.
    pub const DATA: u8 = 8;
    /// Answer: data, and a diagnosis to be fetched.
    pub const DATA_HIGH: u8 = 10;

    /// The function code of a request or an answer, in words.
    pub const fn text(fc: u8) -> &'static str {
        if fc & REQUEST != 0 {
            return match fc & 0x0F {
                SDN | SDN_HIGH => "SDN",
                STATUS => "FDL status",
                SRD => "SRD low",
                SRD_HIGH => "SRD high",
                _ => "request",
            };
        }
        match fc & 0x0F {
            OK => "ok",
            1 => "user error",
            2 => "no resources",
            NOT_OPEN => "SAP not open",
            DATA => "data",
            9 => "no data",
            DATA_HIGH => "data, diagnosis waits",
            12 | 13 => "not received",
            _ => "answer",
        }
    }
}
