//! A station file before a run: what it says, and warnings about what is beside it.

use std::path::Path;

use crate::finding::Finding;
use crate::io::Stimulus;
use crate::station_file::{self, ModuleKind, Station};

/// Reads and checks a station file, with warnings for what is not there now and for cells of its stimulus that no
/// module reads.
///
/// # Errors
/// All findings, at least one of them an error.
pub fn load(path: &Path) -> Result<(Station, Vec<Finding>), Vec<Finding>> {
    let (station, mut warnings) = station_file::load_and_look(path)?;
    // Without any module for inputs the whole stimulus is reported instead.
    let reads = station.modules.iter().any(|module| matches!(module.kind, ModuleKind::Inputs { .. }));
    if let Some((stimulus, _)) = station.stimulus.as_ref().filter(|_| reads) {
        warnings.extend(Stimulus::unread(stimulus, &station.modules));
    }
    Ok((station, warnings))
}
