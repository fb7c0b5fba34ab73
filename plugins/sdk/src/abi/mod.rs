//! What two binaries must agree on: the plugin interface, version 1. `repr(C)` only, no code but constants.
//!
//! A plugin is a shared library with one exported C function, [`ENTRY_SYMBOL`], that returns a [`PluginTable`]. The
//! table lists the blocks the plugin brings. When the program calls one of them, the host calls the block's `entry`
//! with a [`HostTable`] and an opaque call context; everything the block does goes through the host's functions.
//! Pointers a block is given live until its entry returns, no longer, and no host function may be called from another
//! thread or after the return.
//!
//! Every function of the host table runs on the scan thread and neither blocks nor allocates.
//!
//! Versions: [`ABI_MAJOR`] must match. Every struct begins with its `size` in bytes and grows at the end only; a reader
//! uses no field beyond the size it is given. Later additions are found by name through [`HostTable::extension`].
#![deny(unsafe_code)]

mod codes;
mod host;
mod plugin;
mod settings;

pub use codes::*;
pub use host::*;
pub use plugin::*;
pub use settings::*;
