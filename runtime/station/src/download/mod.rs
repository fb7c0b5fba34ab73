//! Blocks that came into a running station over the network: what they make of the program of the sources, how they
//! take effect, and how they outlast the runtime. (docs/s7-link.md)
//!
//! The sources stay what they are. What was downloaded or deleted lies over them as [`Changes`], in the folder of
//! `[station] state`, and is put over them again at each start.

mod changes;
mod file;
mod loader;

pub use changes::{Changes, Download};
pub use file::{read, write};
pub(crate) use loader::Loader;
pub use loader::{Downloading, Newcomers};

use std::path::{Path, PathBuf};

/// The file of a station in a folder.
#[must_use]
pub fn path(folder: &Path, station: &str) -> PathBuf {
    folder.join(format!(".{station}.downloaded"))
}
