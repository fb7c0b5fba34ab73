//! The programs of drivers: how they are started, where they are found, how they are.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use ob1_backplane::{DriverState, Monitor};

/// How the drivers of a station are started.
#[derive(Clone, Debug)]
pub struct DriverSettings {
    /// Path of the program `ob1-cp`.
    pub program: PathBuf,
    /// Path of the program `ob1-io`.
    pub io: PathBuf,
    /// Variables added to its environment.
    pub env: Vec<(OsString, OsString)>,
}

/// A variable of the environment; an empty one counts as not set.
pub(crate) fn set_variable(name: &str) -> Option<OsString> {
    std::env::var_os(name).filter(|value| !value.is_empty())
}

/// A driver program: named by its variable, beside this executable, or in `PATH`.
///
/// # Errors
/// The variable names a file that is not there, or the program is nowhere: where it was looked for, in words.
pub fn find_driver(name: &str, variable: &str) -> Result<PathBuf, String> {
    if let Some(path) = set_variable(variable) {
        let path = PathBuf::from(path);
        return if path.exists() {
            Ok(path)
        } else {
            Err(format!("{variable} names {}, which is not there", path.display()))
        };
    }
    find_program(name).map_err(|why| format!("the driver {why}; set {variable}"))
}

/// A program of this project: beside this executable, or in `PATH`.
///
/// # Errors
/// The program is nowhere: where it was looked for, in words.
pub fn find_program(name: &str) -> Result<PathBuf, String> {
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.join(name)));
    let in_path = std::env::var_os("PATH").unwrap_or_default();
    let candidates = beside.into_iter().chain(std::env::split_paths(&in_path).map(|folder| folder.join(name)));
    let mut searched: BTreeMap<PathBuf, ()> = BTreeMap::new();
    for candidate in candidates {
        if candidate.is_file() {
            return Ok(candidate);
        }
        searched.insert(candidate.parent().unwrap_or(Path::new("/")).to_owned(), ());
    }
    let searched: Vec<String> = searched.keys().map(|p| p.display().to_string()).collect();
    Err(format!("{name} is not to be found in {}", searched.join(", ")))
}

/// The state of a driver, in words.
pub(crate) fn state_text(monitor: &Monitor) -> String {
    match monitor.driver_state() {
        Ok(DriverState::Absent) => "absent".into(),
        Ok(DriverState::Starting) => "starting".into(),
        Ok(DriverState::NoParameters) => "no parameters".into(),
        Ok(DriverState::ParameterError(code)) => format!("parameter error {code}"),
        Ok(DriverState::Ready) => "ready".into(),
        Ok(DriverState::LineError(code)) => format!("line error {code}"),
        Err(fault) => fault.to_string(),
    }
}
