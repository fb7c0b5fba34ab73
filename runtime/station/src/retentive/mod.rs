//! Retentive memory over power cycles: read before the start, written while the station runs and when it stops.
//! docs/station-file.md

pub mod format;
pub mod health;
pub mod keeper;
pub mod store;

use std::path::PathBuf;

use ob1_cpu::Cpu;
use ob1_model::Event;
use ob1_time::Span;

use store::{Store, StoreError};

/// Where and how often retentive memory is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RetentiveFile {
    /// The folder.
    pub folder: PathBuf,
    /// Time between two images in RUN.
    pub every: Span,
}

/// Puts the newest generation back that fits, and returns what was refused; that is kept under another name. The
/// diagnostic buffer has an entry if nothing is left to put back.
///
/// # Errors
/// [`StoreError`].
pub fn restore(file: &RetentiveFile, station: &str, cpu: &mut Cpu) -> Result<(Store, Vec<String>), StoreError> {
    let (mut store, found) = Store::open(&file.folder, station)?;
    let mut told = found.refused;
    let mut reason = None;
    for generation in &found.generations {
        match cpu.restore_retentive(&generation.image) {
            Ok(()) => return Ok((store, told)),
            Err(why) => {
                let kept = store.refuse(generation.sequence);
                told.push(format!("generation {}: {why}; {kept}", generation.sequence));
                // The newest one's says most.
                reason = reason.or(Some(why));
            }
        }
    }
    if !told.is_empty() {
        told.push("the station starts without retentive memory".into());
        let text = reason.map_or_else(|| "no file is whole and of this station".to_owned(), |why| why.to_string());
        cpu.diagnose(Event::RETENTIVE_REFUSED, 0, &text);
    }
    Ok((store, told))
}
