//! Numbers that host and plugin share.

/// The interface's major version; plugin and host must have the same.
pub const ABI_MAJOR: u16 = 1;
/// The minor version: grows with additions. 1: a plugin's block may be an SFB or an SFC.
pub const ABI_MINOR: u16 = 1;
/// The exported C function: `const struct Ob1PluginTable *ob1_plugin(void)`.
pub const ENTRY_SYMBOL: &str = "ob1_plugin";

/// Result of a host function or of a block. Zero is success; a block that gets [`ABORT`] must return it at once.
pub type Status = i32;
/// Success: the function or the block has done its work.
pub const OK: Status = 0;
/// The CPU is going to STOP (or a higher priority asked to end this call): return this value at once.
pub const ABORT: Status = 1;
/// A parameter index outside the block's interface, or not of the kind asked for.
pub const NO_PARAM: Status = -1;
/// The address lies outside its area.
pub const OUTSIDE: Status = -2;
/// The data block does not exist.
pub const NO_DB: Status = -3;
/// An impossible data block number (0, or above the CPU's limit).
pub const DB_NUMBER: Status = -4;
/// No module at this logical address, or a module of a kind without this function.
pub const NO_MODULE: Status = -5;
/// The module does not answer: its driver is down.
pub const ABSENT: Status = -6;
/// The module is busy with another request; a later request may succeed.
pub const BUSY: Status = -7;
/// The record does not exist.
pub const NO_RECORD: Status = -8;
/// The block to call does not exist or its parameters do not match.
pub const NO_BLOCK: Status = -9;
/// A pointer was null or a length impossible.
pub const BAD_ARGUMENT: Status = -10;
/// The data block is write-protected.
pub const READ_ONLY: Status = -11;
/// The station file does not give the module this setting.
pub const NO_SETTING: Status = -12;
/// Returned by a block's entry: it panicked; the message is in the plugin's panic buffer.
pub const PANICKED: Status = -100;

/// Block kinds, [`crate::abi::BlockDesc::kind`]: organization block.
pub const KIND_OB: u8 = 0;
/// Function block: it has an instance data block.
pub const KIND_FB: u8 = 1;
/// Function: a block without instance.
pub const KIND_FC: u8 = 2;
/// System function block. Of a plugin's own blocks since 1.1.
pub const KIND_SFB: u8 = 3;
/// System function. Of a plugin's own blocks since 1.1.
pub const KIND_SFC: u8 = 4;

/// Sections, [`crate::abi::ParamDesc::section`]: `VAR_INPUT`, read by the block.
pub const SECTION_IN: u8 = 0;
/// `VAR_OUTPUT`, written by the block.
pub const SECTION_OUT: u8 = 1;
/// `VAR_IN_OUT`, read and written by the block.
pub const SECTION_IN_OUT: u8 = 2;
/// Instance data of an FB or SFB that is not a parameter.
pub const SECTION_STATIC: u8 = 3;
/// The function value `RET_VAL` of an FC or SFC. Its index is its place among the parameters, as that of the others.
pub const SECTION_RETURN: u8 = 4;

/// Data types, the values of [`crate::abi::ParamDesc::ty`].
#[expect(missing_docs, reason = "the data types of the STL reference")]
pub mod ty {
    pub const BOOL: u8 = 1;
    pub const BYTE: u8 = 2;
    pub const CHAR: u8 = 3;
    pub const WORD: u8 = 4;
    pub const INT: u8 = 5;
    pub const DWORD: u8 = 6;
    pub const DINT: u8 = 7;
    pub const REAL: u8 = 8;
    pub const S5TIME: u8 = 9;
    pub const TIME: u8 = 10;
    pub const DATE: u8 = 11;
    pub const TIME_OF_DAY: u8 = 12;
    pub const DATE_AND_TIME: u8 = 13;
    /// `STRING[n]`: n in [`crate::abi::ParamDesc::length`].
    pub const STRING: u8 = 14;
    /// An opaque array of `length` bytes (instance data only).
    pub const BYTES: u8 = 15;
    pub const POINTER: u8 = 16;
    pub const ANY: u8 = 17;
    pub const BLOCK_DB: u8 = 20;
    pub const BLOCK_FB: u8 = 21;
    pub const BLOCK_FC: u8 = 22;
    pub const TIMER: u8 = 24;
    pub const COUNTER: u8 = 25;
    /// A timer's number, given as a timer or as a WORD.
    pub const TIMER_OR_WORD: u8 = 26;
}

/// Areas of [`crate::abi::HostTable::area_read`]: inputs (process image).
pub const AREA_E: u8 = 0;
/// Outputs A (Q), in the process image.
pub const AREA_A: u8 = 1;
/// Bit memory M, by byte address.
pub const AREA_M: u8 = 2;
/// A data block, by number.
pub const AREA_DB: u8 = 3;
/// The block's instance data (FB), from its first byte; multi-instances included.
pub const AREA_INSTANCE: u8 = 4;
/// Local data of the calling block (the block that called this one), for pointers with area code 87h.
pub const AREA_L: u8 = 5;

/// Timer kinds of [`crate::abi::HostTable::timer_run`]: `SI`, pulse.
pub const TIMER_PULSE: u8 = 0;
/// `SV`, extended pulse: runs its whole time.
pub const TIMER_EXTENDED_PULSE: u8 = 1;
/// `SE`, on-delay: needs 1 while it runs.
pub const TIMER_ON_DELAY: u8 = 2;
/// `SS`, retentive on-delay: runs on without its 1.
pub const TIMER_RETENTIVE_ON_DELAY: u8 = 3;
/// `SA`, off-delay: starts when the 1 goes.
pub const TIMER_OFF_DELAY: u8 = 4;

/// Log levels, [`crate::abi::HostTable::log`]: something does not work.
pub const LOG_ERROR: u8 = 1;
/// Warning: something is odd, and work goes on.
pub const LOG_WARN: u8 = 2;
/// Information: something happened, as it should.
pub const LOG_INFO: u8 = 3;

/// Longest text of [`crate::abi::HostTable::log`] and [`crate::abi::HostTable::diag_entry`] in bytes; the rest is cut.
pub const TEXT_MAX: u32 = 200;
