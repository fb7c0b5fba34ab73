//! A station file before a run: what it says, and warnings about what is beside it.

use std::path::Path;

use crate::io::Stimulus;
use ob1_station_file::finding::Finding;
use ob1_station_file::{self, ModuleKind, Station};

/// Reads and checks a station file. It warns of what is not there now, and of cells of the stimulus that no module
/// reads.
///
/// # Errors
/// All findings, at least one of them an error.
pub fn load(path: &Path) -> Result<(Station, Vec<Finding>), Vec<Finding>> {
    let (station, mut warnings) = ob1_station_file::load_and_look(path)?;
    let has_inputs = station.modules.iter().any(|module| matches!(module.kind, ModuleKind::Inputs { .. }));
    // Without any module for inputs, `load_and_look` has reported the whole stimulus.
    if has_inputs && let Some((stimulus, _)) = &station.stimulus {
        warnings.extend(Stimulus::unread(stimulus, &station.modules));
    }
    Ok((station, warnings))
}
