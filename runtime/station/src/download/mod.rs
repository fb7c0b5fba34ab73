//! Blocks that came into a running station over the network: the program they result in together with the sources, how
//! they take effect, and how they outlast the runtime. (docs/s7-link.md)
//!
//! The sources are not changed. What was downloaded or deleted is kept as [`Changes`] in the folder of `[station]
//! state`, and is applied to the sources again at each start.

mod changes;
mod file;
mod loader;
mod order;

pub use changes::Changes;
pub use file::{read, write};
pub(crate) use loader::Loader;
pub use loader::{Downloading, Newcomers};
pub use order::{LoadOrder, LoadStatus, Loads};

use std::path::{Path, PathBuf};

/// The file of a station in a folder.
#[must_use]
pub fn path(folder: &Path, station: &str) -> PathBuf {
    folder.join(format!(".{station}.downloaded"))
}
