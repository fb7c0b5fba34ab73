//! Extension "settings": what the station file says about a module for its plugins.

use ob1_sdk::abi::{CallContext, NO_MODULE, NO_SETTING, SettingsTable, Status, Text};

use super::edge::{BAD_ARGUMENT, NotOk, bytes_mut, put, with};
use crate::plugin::frame::Frame;
use crate::plugin::settings::Setting;
use crate::plugin::text::given;

/// What the extension answers.
pub(super) static SETTINGS: SettingsTable =
    SettingsTable { size: size_of::<SettingsTable>() as u32, get_int, get_text };

/// # Safety
/// As for [`given`].
unsafe fn find<'f>(frame: &'f Frame<'_>, address: u32, name: Text) -> Result<&'f Setting, NotOk> {
    // SAFETY: the caller's word.
    let name = unsafe { given(name) }.ok_or(BAD_ARGUMENT)?;
    let settings = frame.memory.settings(address).ok_or(NotOk(NO_MODULE))?;
    settings.get(name).ok_or(NotOk(NO_SETTING))
}

unsafe extern "C" fn get_int(call: *mut CallContext, address: u32, name: Text, value: *mut i64) -> Status {
    // SAFETY: see the head of `host_table`; the same holds for every block of this file.
    unsafe {
        with(call, |frame| match find(frame, address, name)? {
            Setting::Int(number) => put(value, *number),
            Setting::Text(_) => Err(NotOk(NO_SETTING)),
        })
    }
}

unsafe extern "C" fn get_text(
    call: *mut CallContext,
    address: u32,
    name: Text,
    into: *mut u8,
    len: u32,
    read: *mut u32,
) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| match find(frame, address, name)? {
            Setting::Text(text) => {
                let into = bytes_mut(into, len)?;
                for (to, from) in into.iter_mut().zip(text.as_bytes()) {
                    *to = *from;
                }
                put(read, text.len() as u32)
            }
            Setting::Int(_) => Err(NotOk(NO_SETTING)),
        })
    }
}
