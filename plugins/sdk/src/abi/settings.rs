//! Extension "settings": what the station file says about a module for the plugins that serve it.

use crate::abi::{CallContext, Status, Text};

/// Name of the extension, for [`crate::abi::HostTable::extension`]; it returns a [`SettingsTable`].
pub const EXTENSION_SETTINGS: &str = "settings";

/// What [`EXTENSION_SETTINGS`] names. Lives as long as the host.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SettingsTable {
    /// `sizeof` this struct in the host.
    pub size: u32,
    /// A setting that is a number, of the module at a logical base address. `NO_MODULE`; `NO_SETTING` when the station
    /// file does not give it, or gives it as a text.
    pub get_int: unsafe extern "C" fn(call: *mut CallContext, address: u32, name: Text, value: *mut i64) -> Status,
    /// A setting that is a text (UTF-8): copies at most `len` bytes of it, `read` gets its whole length. `NO_MODULE`;
    /// `NO_SETTING` when the station file does not give it, or gives it as a number.
    pub get_text: unsafe extern "C" fn(
        call: *mut CallContext,
        address: u32,
        name: Text,
        into: *mut u8,
        len: u32,
        read: *mut u32,
    ) -> Status,
}
