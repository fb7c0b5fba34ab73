//! Retentive memory over power cycles: read before the start, written while the station runs and when it stops.
//! docs/station-file.md

pub mod format;
pub mod health;
pub mod keeper;
pub mod store;

use ob1_cpu::Cpu;
use ob1_ir::Program;
use ob1_model::Event;
use ob1_station_file::RetentiveFile;

use ob1_station_file::finding::{Finding, Level, Spot};
use store::{Store, StoreError};

/// Number of the finding of [`not_kept`].
const NOT_RETAINED: &str = "L023";

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

/// Data blocks and ranges that are named in one message, at most.
const NAMED: usize = 12;

/// Puts the newest generation back of which the program can keep something, and returns what was refused and what had
/// no place; that is kept under another name. The diagnostic buffer gets an entry of it.
///
/// # Errors
/// [`StoreError::InUse`]: another runtime has the files; [`StoreError::Folder`]: the folder cannot be used.
pub fn restore(file: &RetentiveFile, station: &str, cpu: &mut Cpu) -> Result<(Store, Vec<String>), StoreError> {
    let (mut store, found) = Store::open(&file.folder, station)?;
    let mut told = found.refused;
    let mut reason = None;
    for generation in &found.generations {
        let sequence = generation.sequence;
        match cpu.restore_retentive(&generation.image) {
            Ok(left) if left.is_empty() => return Ok((store, told)),
            Ok(left) => {
                let more = left.len().saturating_sub(NAMED);
                let mut names = left[..left.len() - more].join(", ");
                if more > 0 {
                    names += &format!(" and {more} more");
                }
                let kept = store.keep_too(sequence);
                told.push(format!("generation {sequence}: the program has no place for {names}; {kept}"));
                cpu.diagnose(Event::RETENTIVE_PARTLY, 0, &format!("no place for {names}"));
                return Ok((store, told));
            }
            Err(why) => {
                let kept = store.refuse(sequence);
                told.push(format!("generation {sequence}: {why}; {kept}"));
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
