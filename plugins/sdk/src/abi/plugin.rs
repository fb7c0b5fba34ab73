//! The table a plugin gives to the host.

use core::ffi::c_void;

use crate::abi::{CallContext, HostTable, Status};

/// UTF-8 text: pointer and length, no terminator. Lives as long as the plugin.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Text {
    /// First byte; may be null when `len` is 0.
    pub ptr: *const u8,
    /// Length of the text in bytes.
    pub len: u32,
}

/// A parameter or an instance variable of a block.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ParamDesc {
    /// `sizeof` this struct in the plugin.
    pub size: u32,
    /// Name of the parameter, as the manual prints it.
    pub name: Text,
    /// Other spellings, separated by `|`.
    pub aliases: Text,
    /// Where it is declared: a value of `SECTION_*`.
    pub section: u8,
    /// A value of [`crate::abi::ty`].
    pub ty: u8,
    /// Length of `STRING` and `BYTES`, else 0.
    pub length: u16,
    /// Initial value of instance data (FB), right-aligned; elementary types only.
    pub initial: u32,
}

/// A block's entry. `state` is the plugin's memory for this station (see [`BlockDesc::state_size`]).
pub type BlockEntry =
    Option<unsafe extern "C" fn(host: *const HostTable, call: *mut CallContext, state: *mut c_void) -> Status>;

/// A block of a plugin.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BlockDesc {
    /// `sizeof` this struct in the plugin.
    pub size: u32,
    /// `KIND_*`; `KIND_SFB` and `KIND_SFC` since 1.1.
    pub kind: u8,
    /// Padding; a plugin must set it to 0.
    pub reserved: u8,
    /// The number it wants; a station file may give it another.
    pub number: u16,
    /// The manual's name, `SEND`.
    pub name: Text,
    /// Parameters in the manual's order, then instance variables of an FB or SFB. The place in this table, from 0,
    /// is the parameter index in the host's functions, for inputs, outputs, in/outs and the function value
    /// `RET_VAL` alike, in any order; instance variables have no index.
    pub params: *const ParamDesc,
    /// Number of entries of `params`.
    pub param_count: u32,
    /// Bytes of memory this block keeps per station: allocated by the host, zeroed at every start-up, aligned to 16
    /// bytes, given to `entry`. 0: `state` is null. Data that must survive belongs in the instance data block.
    pub state_size: u32,
    /// The code of the block; it runs on the scan thread.
    pub entry: BlockEntry,
}

/// What [`crate::abi::ENTRY_SYMBOL`] returns. Static data of the plugin.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PluginTable {
    /// `sizeof` this struct in the plugin.
    pub size: u32,
    /// [`crate::abi::ABI_MAJOR`] the plugin was built with.
    pub abi_major: u16,
    /// [`crate::abi::ABI_MINOR`] the plugin was built with.
    pub abi_minor: u16,
    /// The plugin's name, `cp240`.
    pub name: Text,
    /// The plugin's version, `0.1.0`.
    pub version: Text,
    /// The first of `block_count` blocks, one after the other.
    pub blocks: *const BlockDesc,
    /// Number of blocks at `blocks`.
    pub block_count: u32,
    /// Bytes of memory the plugin keeps per module it serves ([`HostTable::module_state`]): zeroed at every start-up.
    pub module_state_size: u32,
    /// Called once after loading, on the loading thread, before any block runs; may be null. Not `OK`: the plugin is
    /// refused.
    pub init: Option<unsafe extern "C" fn() -> Status>,
    /// Copies the message of the last panic (UTF-8, at most `len` bytes) and returns its length; may be null.
    pub panic_message: Option<unsafe extern "C" fn(into: *mut u8, len: u32) -> u32>,
}

/// The type of the exported function [`crate::abi::ENTRY_SYMBOL`].
pub type PluginEntry = unsafe extern "C" fn() -> *const PluginTable;
