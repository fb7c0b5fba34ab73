//! Event numbers of the driver, class and number as in STATUS. [S4 "7.3 Table of Errors / Events"]
//!
//! Their meanings and remedies are in [`cp341_events`](ob1_words::cp341_events).

/// Invalid parameters: the interface could not be parametrised. (docs/cp341-events.md)
pub const PARAMETERS: u16 = 0x020F;
/// The job was aborted. (docs/cp341-events.md)
pub const ABORTED: u16 = 0x0501;
/// The interface has no parameters to work with. (docs/cp341-events.md)
pub const NOT_READY: u16 = 0x0502;
/// Nothing, or more than 4096 bytes, came from the CPU. [S4 L1742]
pub const LENGTH: u16 = 0x0518;
/// A job before the end of the previous one. (docs/cp341-events.md)
pub const BUSY: u16 = 0x0522;

/// Character delay time exceeded. [S4 L1748]
pub const CHARACTER_DELAY: u16 = 0x0806;
/// Parity, stop bit or overrun error in a character. [S4 L1749]
pub const TRANSMISSION: u16 = 0x080C;
/// BREAK on the receiving line. [S4 L1750]
pub const BREAK: u16 = 0x080D;
/// DSR or CTS is OFF. [S4 L1751]
pub const SIGNALS: u16 = 0x0818;
/// The reply did not begin in time. [S4 L1754]
pub const NO_REPLY: u16 = 0x0830;
/// The reply does not fit the receive buffer. [S4 L1755]
pub const OVERFLOW: u16 = 0x0832;
/// The reply does not begin with a colon. [S4 L1756]
pub const START: u16 = 0x0833;
/// A colon inside a reply; reception begins again. [S4 L1757]
pub const RESTART: u16 = 0x0834;

/// Data bits other than 7. [S4 L1776]
pub const DATA_BITS: u16 = 0x0E20;
/// Character delay time out of range; 1000 ms is used. [S4 L1777]
pub const CHARACTER_DELAY_RANGE: u16 = 0x0E21;
/// No such operating mode. [S4 L1778]
pub const OPERATING_MODE: u16 = 0x0E22;
/// Response time-out out of range; 2000 ms is used. [S4 L1779]
pub const RESPONSE_TIMEOUT_RANGE: u16 = 0x0E23;

/// An acknowledgement of the CPU nobody waits for. [S4 L1784]
pub const UNEXPECTED_TAKEN: u16 = 0x0E30;
/// The CPU does not take the data in time. [S4 L1785]
pub const TRANSFER_TIMEOUT: u16 = 0x0E31;
/// The CPU cannot take the data; the reason is in the diagnostic buffer before this entry. [S4 L1786]
pub const TRANSFER_FAILED: u16 = 0x0E32;

/// LEN below 2. [S4 L1792]
pub const LEN_MINIMUM: u16 = 0x0E40;
/// LEN below what the function code needs. [S4 L1793]
pub const LEN_FUNCTION: u16 = 0x0E41;
/// No such function code. [S4 L1794]
pub const FUNCTION: u16 = 0x0E42;
/// Broadcast with a function that does not write. [S4 L1795]
pub const BROADCAST: u16 = 0x0E43;
/// Number of bits to read. [S4 L1796]
pub const READ_BITS: u16 = 0x0E44;
/// Number of registers to read. [S4 L1797]
pub const READ_REGISTERS: u16 = 0x0E45;
/// Number of bits or registers to write. [S4 L1798]
pub const WRITE_COUNT: u16 = 0x0E46;
/// LEN below what the number of bits or registers needs. [S4 L1799]
pub const LEN_COUNT: u16 = 0x0E47;
/// Bit status other than FF00h and 0000h. [S4 L1800]
pub const BIT_STATE: u16 = 0x0E48;
/// Diagnostic code other than 0000h. [S4 L1801]
pub const DIAGNOSTIC_CODE: u16 = 0x0E49;
/// 32-bit registers with another function than 03, 06, 16. [S4 L1802]
pub const LONG_REGISTERS: u16 = 0x0E4A;
/// `R_TYP` is not 'X'. [S4 L1803]
pub const R_TYP: u16 = 0x0E4F;

/// Another slave's address. [S4 L1807]
pub const REPLY_ADDRESS: u16 = 0x0E50;
/// Another function code. [S4 L1808]
pub const REPLY_FUNCTION: u16 = 0x0E51;
/// Fewer bytes than the byte counter or the function code says. [S4 L1809]
pub const REPLY_SHORT: u16 = 0x0E52;
/// More bytes than the byte counter or the function code says. [S4 L1810]
pub const REPLY_LONG: u16 = 0x0E53;
/// Byte counter too small. [S4 L1811]
pub const COUNTER_SMALL: u16 = 0x0E54;
/// Byte counter wrong. [S4 L1812]
pub const COUNTER_WRONG: u16 = 0x0E55;
/// The echo differs from the request. [S4 L1813]
pub const ECHO: u16 = 0x0E56;
/// LRC wrong. [S4 L1814]
pub const LRC: u16 = 0x0E57;
/// A character other than 0-9, A-F. [S4 L1815]
pub const CHARACTER: u16 = 0x0E58;
/// Exception codes 1 to 7 are this number plus the code. [S4 L1819-L1825]
pub const EXCEPTION: u16 = 0x0E60;
