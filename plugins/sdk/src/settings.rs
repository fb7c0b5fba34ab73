//! What the station file says about a module for the plugins that serve it (extension "settings").

use crate::abi::{EXTENSION_SETTINGS, SettingsTable};

use crate::Cx;
use crate::reply::{Refused, Reply, reply};
use crate::text::text;

/// With this address [`Cx::setting_int`] and [`Cx::setting_text`] read settings of the whole station: `connection.3` is
/// the address of the CP that has connection 3.
pub const STATION: u32 = u32::MAX;

impl<M> Cx<'_, M> {
    /// The host's table; `None` on a host without settings.
    fn settings(&mut self) -> Option<&'static SettingsTable> {
        let (host, call) = self.edge();
        // SAFETY: `host` and `call` belong to the running entry (Cx::new); the name is static.
        let answer = unsafe { (host.extension)(call, text(EXTENSION_SETTINGS)) };
        // SAFETY: the host answers null or a table of this type that lives as long as the process; plugins are never
        // unloaded and neither is the host.
        let table = unsafe { answer.cast::<SettingsTable>().as_ref() }?;
        (table.size as usize >= size_of::<SettingsTable>()).then_some(table)
    }

    /// A setting that is a number, of the module at a logical base address. It does not change while the station runs;
    /// read it once and keep it in the module's state.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `NoModule`, `NoSetting`.
    pub fn setting_int(&mut self, address: u32, name: &str) -> Reply<i64> {
        let Some(table) = self.settings() else { return Ok(Err(Refused::NoSetting)) };
        let ((_, call), mut value) = (self.edge(), 0);
        // SAFETY: as above; the pointers live through the call.
        Ok(reply(unsafe { (table.get_int)(call, address, text(name), &raw mut value) })?.map(|()| value))
    }

    /// The same for a text (UTF-8), copied into `into` and cut to its length.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused as by [`Cx::setting_int`], a number instead of a text with `NoSetting`.
    pub fn setting_text<'b>(&mut self, address: u32, name: &str, into: &'b mut [u8]) -> Reply<&'b [u8]> {
        let Some(table) = self.settings() else { return Ok(Err(Refused::NoSetting)) };
        let ((_, call), mut read, len) = (self.edge(), 0, into.len());
        // SAFETY: as in `setting_int`; pointer and length are those of a slice.
        let status =
            unsafe { (table.get_text)(call, address, text(name), into.as_mut_ptr(), len as u32, &raw mut read) };
        Ok(reply(status)?.map(|()| &into[..len.min(read as usize)]))
    }
}
