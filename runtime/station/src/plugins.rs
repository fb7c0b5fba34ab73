//! The plugins of a station: where they are looked for, how they are loaded, why one is refused.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use ob1_host::plugin::{Plugin, PluginError, Refusal};
use ob1_model::BlockId;
use ob1_rt::SideThread;
use ob1_station_file::finding::{Finding, Level};

use crate::exit::Exit;
use crate::{drivers, whole_library};

/// Plugins, each with the renumbering of its blocks.
pub type Plugins = Vec<(Arc<Plugin>, BTreeMap<BlockId, BlockId>)>;

/// A plugin that has been loading for so long is told of.
const SLOW: Duration = Duration::from_secs(5);

/// Loads the plugins of a list.
///
/// # Errors
/// One finding for each that was refused.
pub fn load(plugins: &[ob1_station_file::Plugin]) -> Result<Plugins, Vec<Finding>> {
    let mut loaded = Vec::new();
    let mut refused = Vec::new();
    for config in plugins {
        let Some(path) = find_plugin(config) else {
            refused.push(not_found(config));
            continue;
        };
        if let Some(why) = whole_library::cut_off(&path) {
            refused.push(of_plugin(config, &PluginError { path, refusal: Refusal::NotALibrary(why) }));
            continue;
        }
        match load_watched(&path) {
            Ok(plugin) => loaded.push((plugin, config.blocks.iter().copied().collect())),
            Err(error) => refused.push(of_plugin(config, &error)),
        }
    }
    if refused.is_empty() { Ok(loaded) } else { Err(refused) }
}

/// Loads a plugin. One that ends the process meanwhile, or does not return, is named.
fn load_watched(path: &Path) -> Result<Arc<Plugin>, PluginError> {
    let name = path.display().to_string();
    let _exit = ob1_rt::ExitGuard::raise(move |way| {
        err!("\nob1: the plugin {name} has called {way} while it was loaded");
        ob1_process::log::flush(ob1_process::log::LAST_WORDS);
        Exit::EndedByPlugin as u8
    });
    let name = path.display().to_string();
    let (up, is_up) = mpsc::channel();
    let _slow = SideThread::looking("ob1-loading", move |loaded| {
        // A thread that begins to run, and one that waits for the first time, needs the lock that is held from here on.
        let _ = loaded.recv_timeout(Duration::from_millis(1));
        let _ = up.send(());
        if loaded.recv_timeout(SLOW) == Err(RecvTimeoutError::Timeout) {
            err!("ob1: the plugin {name} does not return: it has been loading for {} s", SLOW.as_secs());
        }
    });
    let _ = is_up.recv();
    Plugin::load(path)
}

fn file_name(config: &ob1_station_file::Plugin) -> String {
    format!("lib{}.so", config.name)
}

fn find_plugin(config: &ob1_station_file::Plugin) -> Option<PathBuf> {
    if config.path.is_some() {
        return config.path.clone();
    }
    plugin_folders().into_iter().map(|folder| folder.join(file_name(config))).find(|path| path.exists())
}

fn not_found(config: &ob1_station_file::Plugin) -> Finding {
    let searched = plugin_folders().iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ");
    let remedy = format!("looked for {} in {searched}; set OB1_PLUGIN_DIR, or give a path with a /", file_name(config));
    match &config.place {
        Some(place) => {
            let message = format!("the plugin {} cannot be found", config.name);
            place.finding(Level::Error, "P001", message, remedy)
        }
        None => Finding::whole(Level::Error, "P001", &config.name, "the plugin cannot be found", remedy),
    }
}

/// At the line of the station file that names the plugin, if one does.
fn of_plugin(config: &ob1_station_file::Plugin, error: &PluginError) -> Finding {
    let Some(place) = &config.place else { return of_error(error) };
    let message = format!("{}: {}", error.path.display(), error.refusal);
    place.finding(Level::Error, error.refusal.number(), message, error.refusal.remedy().to_owned())
}

pub(crate) fn of_error(error: &PluginError) -> Finding {
    let file = error.path.display().to_string();
    Finding::whole(Level::Error, error.refusal.number(), &file, error.refusal.to_string(), error.refusal.remedy())
}

/// Where plugins with a bare name are looked for, in this order: `OB1_PLUGIN_DIR`, the folder of the executable,
/// `../lib/ob1` beside it.
#[must_use]
pub fn plugin_folders() -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = drivers::set_variable("OB1_PLUGIN_DIR").map(PathBuf::from).into_iter().collect();
    if let Some(beside) = std::env::current_exe().ok().as_deref().and_then(Path::parent) {
        folders.push(beside.to_owned());
        folders.push(beside.join("../lib/ob1"));
    }
    folders
}
