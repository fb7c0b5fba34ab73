//! What is forced, as the station knows and keeps it: a file beside that of retentive memory, so that it outlasts a
//! restart and a power failure. A memory reset ends it.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ob1_model::Forced;
use parking_lot::Mutex;

/// The first line and the last one: between them a line for each cell.
const HEAD: &str = "ob1 force 1";
const END: &str = "end";

/// What is forced, shared by all who read or change it; see [the module](self).
#[derive(Clone, Debug)]
pub struct Forces(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    cells: Mutex<Vec<Forced>>,
    /// How many the CPU holds.
    count: Arc<AtomicU32>,
}

/// The file of a station in a folder.
#[must_use]
pub fn path(folder: &Path, station: &str) -> PathBuf {
    folder.join(format!(".{station}.forced"))
}

/// What a file holds; nothing where there is none.
///
/// # Errors
/// The file cannot be read, or its lines are not those of such a file; in words.
pub fn read(path: &Path) -> Result<Vec<Forced>, String> {
    let text = match ob1_process::files::read_text(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        text => text.map_err(|error| error.to_string())?,
    };
    let lines: Vec<&str> = text.lines().collect();
    match lines.as_slice() {
        [HEAD, cells @ .., END] => cells.iter().map(|line| Forced::parse(line)).collect::<Option<_>>(),
        _ => None,
    }
    .ok_or_else(|| "it is damaged".to_owned())
}

impl Forces {
    /// What is kept there, and how many the CPU holds.
    #[must_use]
    pub fn new(path: PathBuf, cells: Vec<Forced>, count: Arc<AtomicU32>) -> Self {
        Self(Arc::new(Inner { path, cells: Mutex::new(cells), count }))
    }

    /// What is forced now.
    #[must_use]
    pub fn now(&self) -> Vec<Forced> {
        if self.0.count.load(Ordering::Relaxed) == 0 { Vec::new() } else { self.0.cells.lock().clone() }
    }

    /// The CPU forces these from now on.
    pub(crate) fn set(&self, cells: Vec<Forced>) {
        let list: Vec<String> = cells.iter().map(ToString::to_string).collect();
        tracing::warn!("forced: {}", if list.is_empty() { "nothing any more".to_owned() } else { list.join(", ") });
        let mut kept = self.0.cells.lock();
        self.keep(&list);
        *kept = cells;
    }

    /// Ends what a memory reset has ended.
    pub(crate) fn tend(&self) {
        if self.0.count.load(Ordering::Relaxed) != 0 {
            return;
        }
        let mut kept = self.0.cells.lock();
        if !kept.is_empty() {
            kept.clear();
            self.keep(&[]);
            tracing::warn!("forced: nothing any more, after a memory reset");
        }
    }

    fn keep(&self, list: &[String]) {
        let path = &self.0.path;
        let written = if list.is_empty() {
            match std::fs::remove_file(path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
                _ => ob1_process::files::sync_folder_of(path),
            }
        } else {
            ob1_process::files::replace(path, format!("{HEAD}\n{}\n{END}\n", list.join("\n")).as_bytes())
        };
        if let Err(why) = written {
            tracing::error!("{}: what is forced is not kept: {why}", path.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_kept_until_it_ends() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = path(folder.path(), "press");
        assert_eq!(read(&path), Ok(Vec::new()));
        let count = Arc::new(AtomicU32::new(0));
        let forces = Forces::new(path.clone(), Vec::new(), Arc::clone(&count));
        let cells: Vec<Forced> = ["I0.3=1", "QW4=16#1234"].iter().filter_map(|text| Forced::parse(text)).collect();
        count.store(2, Ordering::Relaxed);
        forces.set(cells.clone());
        forces.tend();
        assert_eq!((forces.now(), read(&path)), (cells.clone(), Ok(cells)));
        let whole = std::fs::read_to_string(&path).expect("it is there");
        std::fs::write(&path, &whole[..whole.len() - 2]).expect("writable");
        assert_eq!(read(&path), Err("it is damaged".to_owned()));
        count.store(0, Ordering::Relaxed);
        assert_eq!(forces.now(), []);
        forces.tend();
        assert!(!path.exists());
    }
}
