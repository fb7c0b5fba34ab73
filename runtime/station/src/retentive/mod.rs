//! Retentive memory over power cycles: read before the start, written while the station runs and when it stops.
//! docs/station-file.md

pub mod format;
pub mod health;
pub mod keeper;
pub mod store;

use std::path::PathBuf;

use ob1_cpu::Cpu;
use ob1_ir::Program;
use ob1_model::Event;
use ob1_time::Span;

use crate::finding::{Finding, Level, Spot};
use store::{Store, StoreError};

/// Number of the finding of [`not_kept`].
const NOT_RETAINED: &str = "L023";

/// Where and how often retentive memory is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RetentiveFile {
    /// The folder.
    pub folder: PathBuf,
    /// Time between two images in RUN.
    pub every: Span,
    /// The data blocks that the station file names, each with its place.
    pub named: Vec<(u16, Spot)>,
}

/// Data blocks that are named as retentive, while the program says that they are not: they are not kept.
pub(crate) fn not_kept(program: &Program, file: &RetentiveFile) -> Vec<Finding> {
    let is_non_retain = |number: u16| program.data.iter().any(|db| db.number == number && db.non_retain);
    let named = file.named.iter().filter(|(number, _)| is_non_retain(*number));
    let finding = |(number, place): &(u16, Spot)| {
        let message = format!("DB {number} has the property \"Non-Retain\" (NON_RETAIN): it is not kept");
        let remedy = "remove NON_RETAIN from its source if it is to be kept, otherwise leave it out here";
        place.finding(Level::Warning, NOT_RETAINED, message, remedy.to_owned())
    };
    named.map(finding).collect()
}

/// Puts the newest generation back that fits, and returns what was refused; that is kept under another name. If every
/// generation is refused, the diagnostic buffer gets an entry.
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
                // The reason of the newest generation says most.
                reason.get_or_insert(why);
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
