//! The station file: what a station is made of. Read, checked, and turned into a [`Station`].
//!
//! The format is documented in `docs/station-file.md`. Unknown keys are refused with the nearest known one; every
//! finding names file, line and column; all checks that are not about the syntax of the file report together.

pub mod alarm_texts;
mod building;
mod buses;
mod check;
mod connection;
mod coupler;
mod cp040;
mod cp_keys;
mod devices;
mod dp;
mod dp_master;
mod duration;
mod engine;
pub mod finding;
pub mod findings;
mod gpio;
mod interrupts;
mod keyed;
mod keys;
pub mod library;
mod line;
mod link;
mod misplaced_keys;
mod modules;
mod mqtt;
mod pattern;
pub mod program_files;
mod remote;
mod retentive;
mod simulated;
pub mod sources;
mod tables;
mod traces;
mod types;
mod values;

pub use check::standard;

pub use duration::{parse_duration, parse_run};
pub use engine::EngineChoice;
pub use line::{Line, LineError};
pub use retentive::RetentiveFile;
pub use traces::StationTrace;
pub use types::*;
pub use values::{NAME_RULE, choice, is_name, places};

use std::io::ErrorKind;
use std::path::Path;

use crate::finding::{Finding, Level, Text};

/// Reads and checks a station file.
///
/// # Errors
/// All findings, at least one of them an error.
pub fn load(path: &Path) -> Result<Station, Vec<Finding>> {
    parse(&read(path)?, &path.display().to_string(), folder_of(path))
}

/// The same with warnings for what is not there now, such as serial devices. `ob1_station::look` reads the files beside
/// it, too.
///
/// # Errors
/// All findings, at least one of them an error.
pub fn load_and_look(path: &Path) -> Result<(Station, Vec<Finding>), Vec<Finding>> {
    let (text, name, folder) = (read(path)?, path.display().to_string(), folder_of(path));
    let source = Text { file: &name, text: &text };
    let file = tables(source, folder)?;
    let (mut station, mut warnings) = check::check(&file, source, folder)?;
    if let Some((path, place)) = &station.alarms {
        station.alarm_texts = alarm_texts::load(path, place)?;
    }
    warnings.extend(devices::not_ready(&file, source, folder, devices::state));
    warnings.extend(coupler::unwatched(&file, source));
    warnings.extend(unplayed(&file, source));
    warnings.extend(link::absent(&file.link, source, folder));
    warnings.extend(link::away(&file.link, source, link::is_here));
    Ok((station, warnings))
}

/// A warning for a stimulus whose inputs no module has.
fn unplayed(file: &tables::StationFile, source: Text<'_>) -> Option<Finding> {
    let stimulus = file.process_io.stimulus.as_ref()?;
    if file.module.iter().any(|table| matches!(table.get_ref().kind.get_ref().as_str(), "di" | "ai")) {
        return None;
    }
    let message = "the station has no module of type di or ai: nothing plays this stimulus".to_owned();
    let remedy = "add [[module]] with type = \"di\" at the addresses of its cells (docs/process-io.md)".to_owned();
    Some(source.finding(Level::Warning, findings::VALUE, stimulus.span(), message, remedy))
}

/// The user a station file wants its runtime to become (`[station] user`), before anything else is done with it. A file
/// that cannot be read or understood names none: what is wrong with it is reported when it is loaded.
#[must_use]
pub fn user_of(path: &Path) -> Option<String> {
    let (text, name) = (read(path).ok()?, path.display().to_string());
    Some(tables(Text { file: &name, text: &text }, folder_of(path)).ok()?.station.user?.into_inner())
}

/// Checks the text of a station file. `name` is its name in findings, `folder` what relative paths start from.
///
/// # Errors
/// All findings, at least one of them an error.
pub fn parse(text: &str, name: &str, folder: &Path) -> Result<Station, Vec<Finding>> {
    let source = Text { file: name, text };
    Ok(check::check(&tables(source, folder)?, source, folder)?.0)
}

fn read(path: &Path) -> Result<String, Vec<Finding>> {
    if path.is_file() && program_files::is_known(path) {
        let message = "this is a source or a symbol table, not a station file";
        let remedy = "`ob1 exec` runs sources; a station file names them in [program], `ob1 new station` writes one";
        return Err(vec![Finding::whole(
            Level::Error,
            findings::UNREADABLE,
            &path.display().to_string(),
            message,
            remedy,
        )]);
    }
    ob1_process::files::read_text(path).map_err(|error| {
        let remedy = match error.kind() {
            ErrorKind::NotFound => "name an existing station file, such as examples/two-stations/station-a.toml",
            ErrorKind::InvalidData => "a station file is UTF-8 text",
            ErrorKind::IsADirectory => "name the station file in it, such as press/station.toml",
            ErrorKind::FileTooLarge | ErrorKind::InvalidInput => "name a station file, such as press/station.toml",
            _ => "make it readable for this user",
        };
        let message = format!("the station file cannot be read: {error}");
        vec![Finding::whole(Level::Error, findings::UNREADABLE, &path.display().to_string(), message, remedy)]
    })
}

fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

fn tables(source: Text<'_>, folder: &Path) -> Result<tables::StationFile, Vec<Finding>> {
    let mut file = toml::from_str(source.text).map_err(|error| {
        if source.file.ends_with(program_files::TEST_FILE) {
            let (message, remedy) = ("this is a test file, not a station file", "`ob1 test` runs it");
            return vec![Finding::whole(Level::Error, findings::SYNTAX, source.file, message, remedy)];
        }
        vec![findings::of_toml(source, &error, "docs/station-file.md", misplaced_keys::remedy)]
    })?;
    pattern::expand(&mut file, source, folder)?;
    Ok(file)
}

/// Whether a path looks like a station file: for commands that take files of either kind.
#[must_use]
pub fn is_station_file(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}
